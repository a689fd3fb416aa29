"""The glint's profile across the line, as pixels see it: its model and how it is learnt."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicSpline

from glint_aoa.optical._line_models import edge
from glint_aoa.optical._profile_fit import (
    Bins,
    ProfileFit,
    best_fit,
    gaussian,
    height_and_level,
    refined,
)
from glint_aoa.optical.estimator import Sample
from glint_aoa.optical.noise import NoiseModel
from glint_aoa.optical.shape import GlintShape

__all__ = [
    "ColumnLight",
    "LineProfile",
    "background_shapes",
    "learn_profile",
    "phases_covered",
]

_Array = NDArray[np.float64]
_Curve = Callable[[_Array], _Array]

_MOST_COLUMNS = 96  # of the sample serve to learn the profile
_EDGE_WIDTH = 0.5  # lines: blur of an edge that the line hides
_FARTHEST = 1.0  # lines that a centre may be shifted in one round
_ROUNDS = 5
_LEAST_BINS = 6
_BIN = 1 / 16  # lines
_KNOTS = 0.5  # lines: the correction follows nothing finer, nor does a pixel's integral
_PHASE_BINS, _LEAST_SHARE = 8, 0.25
_OUTLYING = 6.0  # standard deviations at which a pixel does not count
_CLEAR_OF_TOP = 4.0  # standard deviations that a pixel's light must lie below the top of the scale
_GRID = 1 / 32  # lines between the points of the finished profile


@dataclass(frozen=True)
class LineProfile:
    """Profile of the glint across the line, integrated over pixels.

    Attributes
    ----------
    curve : CubicSpline
        Height against lines from the centre, 1 at the top.
    reach : float
        Lines from the centre within which it is known.
    source : {"learnt", "parametric"}
        Whether the sample showed enough of a line's phases to correct the parametric model.
    model : str
        Name of the parametric model, its width and its other figures.
    misfit : float
        What it leaves of the sample's pixels, rms, over their noise: 1 where all columns have the
        same profile.
    """

    curve: CubicSpline
    reach: float
    source: str
    model: str
    misfit: float = 1.0


@dataclass(frozen=True)
class _Cloud:
    """Pixels of the sample about the line: [point] unless said otherwise."""

    t: _Array  # lines from the centre
    grey: _Array
    column: NDArray[np.int64]  # 0 ... n_columns - 1
    n_columns: int
    uneven: _Array  # shapes of an uneven background there [shape, point]

    def moved(self, by: _Array) -> "_Cloud":
        """Return the same pixels, the line `by` lines further down in each."""
        t = self.t - by
        return replace(self, t=t, uneven=background_shapes(t))

    def only(self, kept: NDArray[np.bool_]) -> "_Cloud":
        """Return some of the pixels."""
        return _Cloud(
            self.t[kept], self.grey[kept], self.column[kept], self.n_columns, self.uneven[:, kept]
        )


@dataclass(frozen=True)
class ColumnLight:
    """Light in each column [grey levels].

    Attributes
    ----------
    height, level : ndarray, shape (column,)
        Height of the profile, and level of the background at the line.
    uneven, uneven_std : ndarray, shape (2, column)
        The background's tilt from line to line and its step across the line, see
        `background_shapes`, and their standard deviations; infinite where unknown.
    shift : ndarray, shape (column,)
        What the line lies beyond where the sample puts it [lines]: an uneven background has
        drawn the centres by which it was found.
    """

    height: _Array
    level: _Array
    uneven: _Array
    uneven_std: _Array
    shift: _Array


def background_shapes(t: _Array) -> _Array:
    """Tilt and step of a background at `t` lines from the line's centre, along a first axis."""
    return np.stack([t, edge(t, _EDGE_WIDTH) - 0.5])


def phases_covered(row: _Array) -> bool:
    """Say whether the line's motion covers the phases of a line: what a learnt profile needs.

    Parameters
    ----------
    row : ndarray, shape (field, column)
        Centres in rows; NaN is left out.

    Returns
    -------
    bool
        Whether each eighth of a line holds at least a quarter of its share, counted from each
        column's own first. Phases that only differ from column to column do not count: there a
        profile can change along with the columns' centres and explain the sample as well.
    """
    known = np.isfinite(row)
    first = np.take_along_axis(row, known.argmax(axis=0)[None], axis=0)
    phase = np.mod((row - first)[known], 1.0)
    if phase.size < _PHASE_BINS:
        return False
    count = np.histogram(phase, bins=_PHASE_BINS, range=(0.0, 1.0))[0]
    return bool(count.min() >= _LEAST_SHARE * phase.size / _PHASE_BINS)


def learn_profile(
    sample: Sample, shape: GlintShape, noise: NoiseModel
) -> tuple[LineProfile, ColumnLight]:
    """Learn the line's profile from a sample in which the line is known.

    Parametric profiles, integrated over pixels, are fitted to all columns together, each with its
    own height and background; the simplest that explains the sample is taken.
    Where the sample covers the phases of a line a spline corrects it.

    Parameters
    ----------
    sample : Sample
        Fields with known line.
    shape : GlintShape
        What is known of the glint.
    noise : NoiseModel
        The camera's noise.

    Returns
    -------
    LineProfile
        The profile.
    ColumnLight
        Light in the sample's columns.

    Notes
    -----
    The effective point-spread function of Anderson and King (PASP 112, 2000, 1360;
    doi:10.1086/316632) for a line. A line that stands still shows each column one phase only: what
    lies between them is then the parametric model's, since a spline there would follow the noise
    and the errors of the columns' centres (seen: 0.0003 deg of bias for a sigma of 0.7 lines).
    """
    reach = shape.half_width + shape.flank
    cloud = _cloud(sample.thinned(_MOST_COLUMNS), shape, reach)
    covered = phases_covered(sample.row)
    start = fit = gaussian(max(shape.half_width / 3.2, 0.3))
    profile = LineProfile(_spline_of(start.curve, reach), reach, "parametric", "")
    for number in range(_ROUNDS):
        light = _light(cloud, profile, noise)
        cloud = cloud.moved(light.shift[cloud.column])
        cloud = _without_outliers(cloud, profile, light, noise)
        bins = _binned(cloud, light, noise)
        if bins.t.size < _LEAST_BINS:
            break
        # Chosen anew at last: columns not yet aligned make a Gaussian look like something else.
        is_between = 0 < number < _ROUNDS - 1
        fit = refined(bins, fit) if is_between else best_fit(bins, start)
        profile = _finished(bins, fit, reach, covered=covered)
    profile = replace(profile, misfit=_misfit(cloud, profile, noise))
    whole = _cloud(sample, shape, reach)
    whole = _without_outliers(whole, profile, _light(whole, profile, noise), noise)
    return profile, _light(whole, profile, noise)


def _misfit(cloud: _Cloud, profile: LineProfile, noise: NoiseModel) -> float:
    model = _modelled(cloud, profile, _light(cloud, profile, noise))
    square = (cloud.grey - model) ** 2 / noise.variance(np.abs(model))
    known = np.isfinite(square)
    return float(np.sqrt(square[known].mean())) if known.any() else np.inf


def _cloud(sample: Sample, shape: GlintShape, reach: float) -> _Cloud:
    """Pixels within reach of the line that are not clipped."""
    field, column = np.nonzero(np.isfinite(sample.row))
    row = sample.row[field, column]
    side = int(np.ceil(reach))
    rows = np.round(row).astype(np.int64)[:, None] + np.arange(-side, side + 1)
    t = rows - row[:, None]
    inside = (rows >= 0) & (rows < sample.fields.shape[1]) & (np.abs(t) <= reach)
    rows = np.clip(rows, 0, sample.fields.shape[1] - 1)
    grey = sample.fields[field[:, None], rows, sample.columns[column][:, None]].astype(np.float64)
    usable = inside & (grey < shape.saturation)
    which = np.broadcast_to(column[:, None], t.shape)
    t = t[usable]
    return _Cloud(
        t, shape.sign * grey[usable], which[usable], sample.columns.size, background_shapes(t)
    )


def _light(cloud: _Cloud, profile: LineProfile, noise: NoiseModel) -> ColumnLight:
    """Least squares for height, level and uneven background of each column."""
    value, slope = profile.curve(cloud.t), profile.curve(cloud.t, 1)
    columns = (value, np.ones(cloud.t.size), *cloud.uneven, -slope)
    weight = 1 / noise.variance(np.abs(cloud.grey))
    normal, right = np.empty((cloud.n_columns, 5, 5)), np.empty((cloud.n_columns, 5))
    for i, one in enumerate(columns):
        weighted = weight * one
        right[:, i] = _sum_by_column(cloud, weighted * cloud.grey)
        for j, other in enumerate(columns[: i + 1]):
            normal[:, i, j] = normal[:, j, i] = _sum_by_column(cloud, weighted * other)
    known = normal[:, 0, 0] > 0
    normal[~known] = np.eye(5)
    normal += np.eye(5) * 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None]
    covariance = np.linalg.inv(normal)
    solution = np.where(known[:, None], np.einsum("cij,cj->ci", covariance, right), np.nan)
    variance = np.diagonal(covariance, axis1=1, axis2=2)[:, 2:4].T
    with np.errstate(invalid="ignore", divide="ignore"):
        shift = np.clip(solution[:, 4] / solution[:, 0], -_FARTHEST, _FARTHEST)
    return ColumnLight(
        solution[:, 0],
        solution[:, 1],
        np.ascontiguousarray(solution[:, 2:4].T),
        np.where(known, np.sqrt(np.maximum(variance, 0.0)), np.inf),
        np.where(solution[:, 0] > 0, shift, 0.0),
    )


def _sum_by_column(cloud: _Cloud, values: _Array) -> _Array:
    sums: _Array = np.bincount(cloud.column, values, minlength=cloud.n_columns).astype(np.float64)
    return sums


def _without_outliers(
    cloud: _Cloud, profile: LineProfile, light: ColumnLight, noise: NoiseModel
) -> _Cloud:
    model = _modelled(cloud, profile, light)
    scale = np.sqrt(noise.variance(np.abs(model)))
    departure = np.abs(cloud.grey - model) / scale
    known = departure[np.isfinite(departure)]
    usual = float(np.median(known)) / 0.6745 if known.size else 1.0
    with np.errstate(invalid="ignore"):
        kept = departure <= _OUTLYING * max(1.0, usual)
        # Near the top of the scale only the darker readings are left, which would bend the profile.
        kept &= np.abs(model) < noise.saturation - _CLEAR_OF_TOP * scale
    return cloud.only(kept)


def _modelled(cloud: _Cloud, profile: LineProfile, light: ColumnLight) -> _Array:
    c = cloud.column
    model: _Array = _background(cloud, light) + light.height[c] * profile.curve(cloud.t)
    return model


def _background(cloud: _Cloud, light: ColumnLight) -> _Array:
    c = cloud.column
    level: _Array = light.level[c] + (light.uneven[:, c] * cloud.uneven).sum(axis=0)
    return level


def _finished(bins: Bins, fit: ProfileFit, reach: float, *, covered: bool) -> LineProfile:
    """Parametric profile, corrected where the sample covers the phases."""
    if not covered or bins.t.size < 4 * reach:
        return LineProfile(_spline_of(fit.curve, reach), reach, "parametric", str(fit))
    correction = _correction(bins, fit.curve, reach)
    whole = _spline_of(lambda t: fit.curve(t) + correction(t), reach)
    return LineProfile(whole, reach, "learnt", str(fit))


def _binned(cloud: _Cloud, light: ColumnLight, noise: NoiseModel) -> Bins:
    """Pixels of all columns, brought to one height, in fine bins."""
    c = cloud.column
    height = np.where(light.height[c] > 0, light.height[c], np.nan)
    weight = height**2 / noise.variance(np.abs(cloud.grey))
    value = (cloud.grey - _background(cloud, light)) / height
    usable = np.isfinite(weight)
    t, value, weight = cloud.t[usable], value[usable], weight[usable]
    index = np.round(t / _BIN).astype(np.int64)
    index -= index.min(initial=0)
    total = np.bincount(index, weight).astype(np.float64)
    there = total > 0
    return Bins(
        np.bincount(index, weight * t)[there] / total[there],
        np.bincount(index, weight * value)[there] / total[there],
        total[there],
    )


def _correction(bins: Bins, curve: _Curve, reach: float) -> _Curve:
    """Least-squares spline through what the parametric profile leaves, zero beyond its knots."""
    shape, root = curve(bins.t), np.sqrt(bins.weight)
    height, level = height_and_level(bins, shape)
    left = (bins.value - level) / height - shape
    inner = np.arange(-np.floor(reach) + 0.5, np.floor(reach), _KNOTS)
    inner = inner[(inner > bins.t[0]) & (inner < bins.t[-1])]
    knots = np.concatenate([np.full(4, bins.t[0]), inner, np.full(4, bins.t[-1])])
    basis = BSpline.design_matrix(bins.t, knots, 3).toarray()
    weighted = basis * root[:, None] * height
    # A coefficient that the sample does not show stays at the parametric profile.
    ridge = np.sqrt(1e-6 * np.mean(bins.weight)) * np.eye(basis.shape[1])
    coefficients = np.linalg.lstsq(
        np.vstack([weighted, ridge]),
        np.concatenate([left * root * height, np.zeros(len(ridge))]),
        rcond=None,
    )[0]
    return BSpline(knots, coefficients, 3, extrapolate=True)


def _spline_of(curve: _Curve, reach: float) -> CubicSpline:
    """Cubic spline of a profile, its top at 1 and its centre where it matches itself best."""
    t = np.arange(-np.ceil(reach) - 1, np.ceil(reach) + 1 + _GRID / 2, _GRID)
    clipped = np.clip(t, -reach, reach)
    height = curve(clipped)
    return CubicSpline(t, height / height.max())
