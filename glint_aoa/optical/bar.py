"""The asymmetric bar: a line of constant brightness between backgrounds that differ."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

from glint_aoa.optical.estimator import Sample
from glint_aoa.optical.shape import GlintShape

__all__ = ["AsymmetricBar", "ColumnBars", "fit_bars"]

_Array = NDArray[np.float64]

_SHAPE_SAMPLE = (16, 32)  # fields and columns are enough for the common shape
_TOGETHER = 32  # columns, which bounds the memory taken
_LEAST_SCALE = 0.25  # lines
_LEAST_SHARE, _LARGEST_SHARE = 0.002, 0.97  # of the scale's square, the bar's own
_STEPS = 8
_HALF_AT = 1.18  # standard deviations of a Gaussian from its middle to half its height
_TERMS = 5  # bar, its change with the centre, level, tilt, step
_BAR, _LEVEL, _TILT, _STEP = 0, 2, 3, 4


@dataclass(frozen=True)
class AsymmetricBar:
    """Shape of the bar, alike in all columns.

    Attributes
    ----------
    half_width : float
        Half the width of the bar itself [lines].
    blur : float
        Standard deviation of the Gaussian by which the camera blurs it [lines].
    """

    half_width: float
    blur: float

    @property
    def scale(self) -> float:
        """Standard deviation of the blurred bar's profile [lines]."""
        return math.hypot(self.blur, self.half_width / math.sqrt(3))

    def bias(self, height: _Array, step: _Array, tilt: _Array, *, filter_scale: float) -> _Array:
        r"""Where the filtered profile's derivative vanishes, from the middle of the bar.

        Parameters
        ----------
        height : ndarray, shape (column,)
            Height of the bar over the background on its upper side [grey levels].
        step : ndarray, shape (column,)
            Background on the lower side minus that on the upper side [grey levels].
        tilt : ndarray, shape (column,)
            Tilt of the background on both sides [grey levels / line].
        filter_scale : float
            Standard deviation of the Gaussian filter [lines].

        Returns
        -------
        ndarray, shape (column,)
            Bias of the line point [lines]; NaN where no maximum is near.

        Notes
        -----
        With S the total scale of blur, pixel, its step and filter, the derivative is

        .. math:: h g_S(x + w) + (a - h) g_S(x - w) + t

        with height h, half width w, step a and tilt t. Without tilt it vanishes at
        -(S^2 / 2w) ln(1 - a/h), eq. 13 of Steger's paper (doi:10.1109/34.659930).
        """
        return _zero(self, height, step, tilt, filter_scale)[0]


@dataclass(frozen=True)
class ColumnBars:
    """The bar fitted to each column of a sample; arrays have shape (column,), NaN if not fitted.

    Attributes
    ----------
    bar : AsymmetricBar
        The common shape.
    height, step, tilt : ndarray
        As for `AsymmetricBar.bias`.
    level : ndarray
        Background on the upper side, at the line [grey levels].
    covariance : ndarray, shape (column, 2, 2)
        Of step and tilt.
    """

    bar: AsymmetricBar
    height: _Array
    step: _Array
    tilt: _Array
    level: _Array
    covariance: _Array

    def bias(self, filter_scale: float) -> tuple[_Array, _Array]:
        """Bias of each column's line point, and its variance [lines, lines^2]."""
        shift, by_step, by_tilt = _zero(self.bar, self.height, self.step, self.tilt, filter_scale)
        by = np.stack([by_step, by_tilt], axis=1)
        return shift, np.einsum("ci,cij,cj->c", by, self.covariance, by)

    def expected(self, n_lines: int, centre: _Array) -> _Array:
        """Return the grey levels expected of the bars at each centre [centre, line, column]."""
        away = np.arange(n_lines) - centre[:, None]
        terms = _terms(away, self.bar)
        none = np.zeros_like(self.height)
        figures = np.stack([self.height, none, self.level, self.tilt, self.step])
        grey: _Array = np.einsum("fli,ic->flc", terms, figures)
        return grey


def fit_bars(sample: Sample, shape: GlintShape) -> ColumnBars | None:
    """Fit asymmetric bars, integrated over the pixels, to a sample's columns.

    Half width and blur are common to all columns; height, centre, level, tilt and step are each
    column's own, the mean over the sample's fields.

    Parameters
    ----------
    sample : Sample
        Fields in which the line is known.
    shape : GlintShape
        What is known of the glint.

    Returns
    -------
    ColumnBars or None
        The bars; None where the sample holds no column with the line in it.
    """
    every = [max(1, -(-n // most)) for n, most in zip(sample.row.shape, _SHAPE_SAMPLE, strict=True)]
    some = Sample(
        sample.fields[:: every[0]],
        sample.columns[:: every[1]],
        sample.row[:: every[0], :: every[1]],
    )
    away, grey, there = _pixels(some, shape)
    if not there.any():
        return None

    def departure(scale_and_share: _Array) -> _Array:
        terms = _terms(away, _bar_of(scale_and_share))
        found = _regression(terms, grey, there)[0]
        fitted = np.einsum("fcpi,ci->fcp", terms, np.nan_to_num(found))
        return np.where(there, grey - fitted, 0.0).ravel()

    scale = (shape.half_box + 0.5) / _HALF_AT
    best = least_squares(
        departure,
        [min(scale, 0.9 * shape.half_width), 0.5],
        bounds=([_LEAST_SCALE, _LEAST_SHARE], [shape.half_width, _LARGEST_SHARE]),
        x_scale=[scale, 1.0],
        xtol=1e-4,
        ftol=1e-6,
        max_nfev=20,
    )
    return _columns(sample, shape, _bar_of(best.x))


def _bar_of(scale_and_share: _Array) -> AsymmetricBar:
    """Bar of a scale, a share of whose square is the bar's own and the rest the blur's."""
    scale, share = (float(x) for x in scale_and_share)
    return AsymmetricBar(scale * math.sqrt(3 * share), scale * math.sqrt(1 - share))


def _columns(sample: Sample, shape: GlintShape, bar: AsymmetricBar) -> ColumnBars:
    """Every column's own figures for a bar of this shape."""
    parts = []
    for first in range(0, sample.columns.size, _TOGETHER):
        few = slice(first, first + _TOGETHER)
        some = Sample(sample.fields, sample.columns[few], sample.row[:, few])
        away, grey, there = _pixels(some, shape)
        parts.append(_regression(_terms(away, bar), grey, there)[:2])
    found, covariance = (np.concatenate(each) for each in zip(*parts, strict=True))
    found[~(found[:, _BAR] * shape.sign > 0)] = np.nan
    own = covariance[:, [_TILT, _STEP]][:, :, [_TILT, _STEP]][:, ::-1, ::-1]
    return ColumnBars(bar, found[:, _BAR], found[:, _STEP], found[:, _TILT], found[:, _LEVEL], own)


def _pixels(sample: Sample, shape: GlintShape) -> tuple[_Array, _Array, NDArray[np.bool_]]:
    """Distance from the line, grey level and whether to use it [field, column, pixel]."""
    reach = math.ceil(shape.half_width + shape.flank)
    known = np.isfinite(sample.row)
    nearest = np.where(known, np.round(sample.row), 0).astype(np.int64)
    rows = nearest[:, :, None] + np.arange(-reach, reach + 1)
    last = sample.fields.shape[1] - 1
    inside = known[:, :, None] & (rows >= 0) & (rows <= last)
    field = np.arange(len(sample.fields))[:, None, None]
    grey = sample.fields[field, np.clip(rows, 0, last), sample.columns[None, :, None]]
    there = inside & (grey < shape.saturation)
    away = rows - np.where(known, sample.row, 0.0)[:, :, None]
    return away.astype(np.float64), grey.astype(np.float64), there


def _terms(away: _Array, bar: AsymmetricBar) -> _Array:
    """Regressors of the grey level [field, column, pixel, term], integrated over the pixels."""

    def side(edge: float) -> tuple[_Array, _Array]:
        """Return the unit step at `edge`, blurred, and its derivative."""
        low, high = ((away + half - edge) / bar.blur for half in (-0.5, 0.5))
        below, above = ndtr(low), ndtr(high)
        bell = (np.exp(-0.5 * high**2) - np.exp(-0.5 * low**2)) / math.sqrt(2 * math.pi)
        return bar.blur * (high * above - low * below + bell), above - below

    (upper, upper_slope), (lower, lower_slope) = side(-bar.half_width), side(bar.half_width)
    terms = [upper - lower, lower_slope - upper_slope, np.ones_like(away), away, lower]
    return np.stack(terms, axis=-1)


def _regression(
    terms: _Array, grey: _Array, there: NDArray[np.bool_]
) -> tuple[_Array, _Array, _Array]:
    """Least squares of each column over its fields.

    Returns coefficients [column, term], their covariances and the sums of squared residuals; NaN
    where the pixels do not suffice.
    """
    used = np.where(there[..., None], terms, 0.0)
    normal = np.einsum("fcpi,fcpj->cij", used, used)
    right = np.einsum("fcpi,fcp->ci", used, grey)
    count = there.sum(axis=(0, 2))
    good = (count > 2 * _TERMS) & (np.linalg.cond(normal) < 1e12)
    found = np.full(right.shape, np.nan)
    covariance = np.full(normal.shape, np.nan)
    inverse = np.linalg.inv(normal[good])
    found[good] = np.einsum("cij,cj->ci", inverse, right[good])
    total = np.where(there, grey**2, 0.0).sum(axis=(0, 2))
    left = np.where(good, total - np.einsum("ci,ci->c", right, np.nan_to_num(found)), 0.0)
    covariance[good] = inverse * (left[good] / (count[good] - _TERMS))[:, None, None]
    return found, covariance, left


def _zero(
    bar: AsymmetricBar, height: _Array, step: _Array, tilt: _Array, filter_scale: float
) -> tuple[_Array, _Array, _Array]:
    """Zero of the filtered derivative, and how it moves with step and tilt."""
    # A pixel blurs once as it gathers light and once as its grey level is filtered as a step.
    total = bar.blur**2 + filter_scale**2 + 2 / 12
    norm = 1 / math.sqrt(2 * math.pi * total)
    x = np.zeros_like(height)
    for _ in range(_STEPS):
        left, right = (
            norm * np.exp(-0.5 * (x + away) ** 2 / total)
            for away in (bar.half_width, -bar.half_width)
        )
        first = height * left + (step - height) * right + tilt
        second = (
            -(height * left * (x + bar.half_width) + (step - height) * right * (x - bar.half_width))
            / total
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            x = x - np.clip(first / second, -0.5 * total**0.5, 0.5 * total**0.5)
    return x, -right / second, -1 / second
