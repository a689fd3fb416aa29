"""The camera's noise: how the variance of a pixel grows with its grey level."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glint_aoa.optical.estimator import Sample
from glint_aoa.optical.shape import GlintShape
from glint_aoa.setup import Glint

__all__ = ["NoiseModel", "photon_transfer", "sample_noise"]

_Array = NDArray[np.float64]

ROUNDING = 1 / 12
"""Variance of rounding to whole grey levels [grey^2]."""

_BINS = 24
_LEAST_IN_BIN = 200
_ROUNDS = 3
_MOST_COLUMNS = 48  # of the sample show the noise
_LEAST_FIELDS = 8
_ALIKE = 0.25  # lines between phases beyond which the profile is not straight


@dataclass(frozen=True)
class NoiseModel:
    """Variance of a pixel against its expected grey level.

    Attributes
    ----------
    read_variance : float
        Read noise and rounding together [grey^2].
    variance_per_grey : float
        Growth with the grey level above black: 1 / (electrons behind one grey level) [grey].
    black : float
        Grey level of no light.
    saturation : float
        Grey level at which pixels clip.
    source : {"setup", "stack", "stack, no gain seen", "background"}
        Where the figures come from.
    """

    read_variance: float
    variance_per_grey: float
    black: float
    saturation: float
    source: str = "setup"

    def variance(self, grey: ArrayLike) -> _Array:
        """Variance of pixels whose expected grey levels are `grey` [grey^2]."""
        above = np.maximum(np.asarray(grey, np.float64) - self.black, 0.0)
        return self.read_variance + self.variance_per_grey * above


def photon_transfer(
    grey: ArrayLike,
    difference: ArrayLike,
    *,
    saturation: float,
    black: float = 0.0,
) -> NoiseModel:
    """Estimate read noise and gain from differences of pixels that expect the same light.

    Parameters
    ----------
    grey : array_like, shape (pixel,)
        Expected grey level of each pixel.
    difference : array_like, shape (pixel,)
        Difference of two independent readings of it, everything but noise removed [grey].
    saturation : float
        Grey level at which pixels clip; levels within a tenth of it are left out.
    black : float, optional
        Grey level of no light.

    Returns
    -------
    NoiseModel
        Half the variance of the differences in each of 24 bins of the grey level, as a straight
        line fitted with the bins' own uncertainties; both of its terms are kept from going below
        zero, and where the levels hardly differ all of the noise is read noise.

    Notes
    -----
    The photon-transfer method (Janesick, Photon Transfer, SPIE PM170, 2007), with the spread in a
    bin taken from the median absolute difference, since a moving edge or a flicker spoils a few.
    """
    expected, apart = np.asarray(grey, np.float64), np.asarray(difference, np.float64)
    usable = np.isfinite(expected) & np.isfinite(apart) & (expected < 0.9 * saturation)
    expected, apart = expected[usable], apart[usable]
    if expected.size < _LEAST_IN_BIN:
        alone = float(np.var(apart) / 2) if apart.size > 1 else ROUNDING
        return NoiseModel(max(alone, ROUNDING), 0.0, black, saturation, "stack, no gain seen")
    level, variance, count = _binned(expected, apart)
    read, per_grey = _variance_line(level - black, variance, count)
    source = "stack" if per_grey > 0 else "stack, no gain seen"
    return NoiseModel(max(read, ROUNDING), per_grey, black, saturation, source)


def sample_noise(sample: Sample, shape: GlintShape, glint: Glint) -> NoiseModel:
    """Take the noise from the setup, or from a sample in which the line is known.

    In each column the fields are put in order of where the line lies between two rows; a pixel is
    then held against the straight line between its neighbours in that order, which saw the same
    part of the glint's profile but for some hundredths of a line. What stands still, such as
    texture and a pixel's own gain, drops out.

    Parameters
    ----------
    sample : Sample
        Fields in which the line is known.
    shape : GlintShape
        What is known of the glint.
    glint : Glint
        The setup's section; its read noise and gain are taken where both are given.

    Returns
    -------
    NoiseModel
        The noise.
    """
    black = max(float(np.percentile(sample.fields, 1)), 0.0)
    if glint.read_noise is not None and glint.electrons_per_grey is not None:
        read = glint.read_noise**2 + ROUNDING
        return NoiseModel(read, 1 / glint.electrons_per_grey, black, shape.saturation, "setup")
    reach = min(int(np.ceil(shape.half_width)), sample.fields.shape[1] // 4)
    grey, difference = _neighbours(sample, reach)
    if grey.size < _LEAST_IN_BIN:
        model = NoiseModel(shape.noise**2, 0.0, black, shape.saturation, "background")
    else:
        model = photon_transfer(grey, difference, saturation=shape.saturation, black=black)
    if glint.read_noise is not None:
        model = replace(model, read_variance=glint.read_noise**2 + ROUNDING)
    if glint.electrons_per_grey is not None:
        model = replace(model, variance_per_grey=1 / glint.electrons_per_grey)
    return model


def _neighbours(sample: Sample, reach: int) -> tuple[_Array, _Array]:
    """Hold pixels against what their neighbours in phase let expect.

    Returns the expected grey levels, and differences like those of two equal readings.
    """
    offsets = np.arange(-reach, reach + 1)
    greys, differences = [], []
    sample = sample.thinned(_MOST_COLUMNS)
    for c in range(sample.columns.size):
        row = sample.row[:, c]
        known = np.flatnonzero(np.isfinite(row))
        if known.size < _LEAST_FIELDS:
            continue
        whole = np.round(row[known])
        known = known[(whole >= reach) & (whole < sample.fields.shape[1] - reach)]
        phase = row[known] - np.round(row[known])
        known = known[np.argsort(phase, kind="stable")]
        phase = np.sort(phase)
        if known.size < _LEAST_FIELDS:
            continue
        rows = np.round(row[known]).astype(np.int64)[:, None] + offsets
        grey = sample.fields[known[:, None], rows, sample.columns[c]].astype(np.float64)
        gap = phase[2:] - phase[:-2]
        share = np.where(gap > 0, (phase[1:-1] - phase[:-2]) / np.where(gap > 0, gap, 1), 0.5)
        share = share[:, None]
        between = (1 - share) * grey[:-2] + share * grey[2:]
        alike = gap < _ALIKE
        scale = np.sqrt(2 / (1 + share**2 + (1 - share) ** 2))
        greys.append(between[alike].ravel())
        differences.append((scale * (grey[1:-1] - between))[alike].ravel())
    if not greys:
        return np.empty(0), np.empty(0)
    return np.concatenate(greys), np.concatenate(differences)


def _binned(grey: _Array, difference: _Array) -> tuple[_Array, _Array, _Array]:
    """Mean level, variance of one reading and number of pixels in bins of the level."""
    edges = np.linspace(grey.min(), grey.max() + 1e-9, _BINS + 1)
    index = np.clip(np.searchsorted(edges, grey, side="right") - 1, 0, _BINS - 1)
    level: list[float] = []
    variance: list[float] = []
    count: list[int] = []
    for k in range(_BINS):
        inside = index == k
        if inside.sum() < _LEAST_IN_BIN:
            continue
        level.append(grey[inside].mean())
        variance.append(_variance(difference[inside]) / 2)
        count.append(inside.sum())
    return np.array(level), np.array(variance), np.array(count, np.float64)


def _variance(difference: _Array) -> float:
    """Variance without the few that lie far off; whole grey levels forbid a median."""
    spread = difference.std()
    for _ in range(_ROUNDS):
        kept = np.abs(difference - difference.mean()) <= 4 * spread
        spread = difference[kept].std()
    return float(spread**2)


def _variance_line(level: _Array, variance: _Array, count: _Array) -> tuple[float, float]:
    """Straight line through the variances, weighted by how well each is known, neither below 0."""
    if level.size < 2:
        return float(variance[0]) if level.size else ROUNDING, 0.0
    fitted = variance
    read, slope = float(np.average(variance, weights=count)), 0.0
    for _ in range(_ROUNDS):  # a variance is known to sqrt(2 / n) of its true value
        weight = count / np.maximum(fitted, ROUNDING) ** 2
        mean = np.average(level, weights=weight)
        spread = (weight * (level - mean) ** 2).sum()
        slope = float((weight * (level - mean) * variance).sum() / spread)
        slope = max(slope, 0.0)
        read = float(np.average(variance - slope * level, weights=weight))
        if read < ROUNDING:
            read = ROUNDING
            slope = max(
                0.0,
                float(np.average((variance - read) * level, weights=weight))
                / float(np.average(level**2, weights=weight)),
            )
        fitted = read + slope * np.maximum(level, 0.0)
    return read, slope
