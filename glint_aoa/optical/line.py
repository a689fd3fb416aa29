"""Robust weighted straight lines, many fields at a time."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

__all__ = ["LineFit", "fit_lines", "fit_lines_robustly", "row_medians"]

_Array = NDArray[np.float64]

_OUTLIER = 4.5  # standard deviations at which a field's columns are looked at again
_FEW = 0.1  # of the columns outlying leave the plain line fit to start from
_BISQUARE = 6.0  # standard deviations at which a column loses all weight; 99 % efficient
_ROUNDS = 5
_MEDIAN_COLUMNS = 48  # are enough to start from


@dataclass(frozen=True)
class LineFit:
    """Straight lines z = intercept + slope * s, one a field.

    Attributes
    ----------
    slope, intercept : ndarray, shape (field,)
        Slope [1] and height at s = 0 [as z]; NaN where fewer than two columns have weight.
    slope_var, intercept_var, covariance : ndarray, shape (field,)
        Their variances and covariance if the weights are inverse variances [1, z^2, z].
    weight : ndarray, shape (field, column)
        The weights that were used in the end [1/z^2].
    residual : ndarray, shape (field, column)
        z minus the line [as z]; NaN where z is.
    """

    slope: _Array
    intercept: _Array
    slope_var: _Array
    intercept_var: _Array
    covariance: _Array
    weight: _Array
    residual: _Array


def fit_lines(s: _Array, z: _Array, weight: _Array) -> LineFit:
    """Fit a weighted straight line to each row.

    Parameters
    ----------
    s, z : ndarray, shape (field, column)
        Abscissa and ordinate, in the same unit; NaN in z where there is no point.
    weight : ndarray, shape (field, column) or (column,)
        Inverse variances of z.

    Returns
    -------
    LineFit
        The lines.
    """
    there = np.isfinite(z) & np.isfinite(s)
    weight = np.where(there, weight, 0.0)
    s0, z0 = np.where(there, s, 0.0), np.where(there, z, 0.0)
    total = weight.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s_mean = np.einsum("fc,fc->f", weight, s0) / total
        z_mean = np.einsum("fc,fc->f", weight, z0) / total
        ds = s0 - s_mean[:, None]
        spread = np.einsum("fc,fc,fc->f", weight, ds, ds)
        slope = np.einsum("fc,fc,fc->f", weight, ds, z0) / spread
        slope_var = 1 / spread
        intercept_var = 1 / total + s_mean**2 / spread
    bad = ~(np.isfinite(slope) & ((weight > 0).sum(axis=1) >= 2))
    slope, slope_var, intercept_var = (
        np.where(bad, np.nan, each) for each in (slope, slope_var, intercept_var)
    )
    covariance = -s_mean * slope_var
    intercept = z_mean - slope * s_mean
    residual = np.where(there, z, np.nan) - intercept[:, None] - slope[:, None] * s0
    return LineFit(slope, intercept, slope_var, intercept_var, covariance, weight, residual)


def fit_lines_robustly(s: _Array, z: _Array, std: _Array, usual: _Array) -> LineFit:
    """Fit a straight line to each row, columns that do not belong to it weighted down.

    Rows in which every column lies within 4.5 standard deviations of the line keep the plain
    weighted fit, so nothing is lost on clean data. In the others Tukey's bisquare weights are
    iterated, with the larger of the stated noise and the row's own scatter as scale.

    Parameters
    ----------
    s, z : ndarray, shape (field, column)
        Abscissa and ordinate, in the same unit; NaN in z where there is no point.
    std : ndarray, shape (column,)
        Noise of z in each column, 1 sigma; infinite for a column to leave out.
    usual : ndarray, shape (column,)
        The column's usual departure from the line, which does not count as outlying.

    Returns
    -------
    LineFit
        The lines.
    """
    fit, outlying = _plain_fit(s, z, std, usual)
    spoilt = outlying > _FEW * s.shape[1]
    for rows in (np.flatnonzero((outlying > 0) & ~spoilt), np.flatnonzero(spoilt)):
        if rows.size == 0:
            continue
        start = fit.residual[rows]
        if spoilt[rows[0]]:
            start = _about_median_line(s[rows], z[rows], usual)
        again = _bisquare(s[rows], z[rows], std, usual, start)
        for each in fields(LineFit):
            getattr(fit, each.name)[rows] = getattr(again, each.name)
    return fit


def _plain_fit(s: _Array, z: _Array, std: _Array, usual: _Array) -> tuple[LineFit, _Array]:
    """Weighted lines in one compiled pass, and how many columns of each lie off it."""
    from glint_aoa.optical import _line_kernel as kernel  # noqa: PLC0415  compiles

    n = len(z)
    figures, outlying = np.empty((5, n)), np.empty(n)
    weight, residual = np.empty(z.shape), np.empty(z.shape)
    kernel.fit_lines(s, z, 1 / std**2, usual, _OUTLIER, figures, weight, residual, outlying)
    slope, intercept, slope_var, intercept_var, covariance = figures
    fit = LineFit(slope, intercept, slope_var, intercept_var, covariance, weight, residual)
    return fit, outlying


def _bisquare(s: _Array, z: _Array, std: _Array, usual: _Array, residual: _Array) -> LineFit:
    """Iterate bisquare weights from the residuals of a first line."""
    prior = 1 / std**2
    for _ in range(_ROUNDS):
        distance = np.abs(residual - usual) / std
        with np.errstate(invalid="ignore"):
            known = np.where(np.isfinite(std) & np.isfinite(distance), distance, np.nan)
        scale = np.maximum(1.0, 1.4826 * row_medians(known))
        shrink = np.clip(1 - (distance / (_BISQUARE * scale[:, None])) ** 2, 0.0, 1.0) ** 2
        fit = fit_lines(s, z, prior * np.nan_to_num(shrink))
        residual = fit.residual
    return fit


def _about_median_line(s: _Array, z: _Array, usual: _Array) -> _Array:
    """Residuals from a line by repeated medians, which just under half of the columns cannot spoil.

    Siegel, Biometrika 69 (1982) 242.
    """
    some = slice(None, None, -(-s.shape[1] // _MEDIAN_COLUMNS))
    level = z - usual
    ds = s[:, some, None] - s[:, None, some]
    dz = level[:, some, None] - level[:, None, some]
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = np.where(ds == 0, np.nan, dz / ds)
    each = row_medians(slopes.reshape(-1, slopes.shape[2])).reshape(slopes.shape[:2])
    slope = row_medians(each)
    intercept = row_medians(level - slope[:, None] * s)
    return z - intercept[:, None] - slope[:, None] * s


def row_medians(values: _Array) -> _Array:
    """Median of each row without its NaN, whatever the other rows hold; NaN for an empty row.

    Parameters
    ----------
    values : ndarray, shape (row, column)
        Values; NaN where there is none.

    Returns
    -------
    ndarray, shape (row,)
        The medians.
    """
    ordered = np.sort(values, axis=1)  # NaN last
    count = np.isfinite(values).sum(axis=1)
    if values.shape[1] == 0:
        return np.full(len(values), np.nan)
    rows = np.arange(len(values))
    low, high = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, values.shape[1] - 1)
    median: _Array = np.where(count > 0, (ordered[rows, low] + ordered[rows, high]) / 2, np.nan)
    return median
