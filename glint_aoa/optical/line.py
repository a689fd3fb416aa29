"""Robust weighted straight lines, many fields at a time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LineFit", "fit_lines", "fit_lines_robustly", "row_medians"]

_Array = NDArray[np.float64]


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


def fit_lines(s: _Array, z: _Array, std: _Array) -> LineFit:
    """Fit a weighted straight line to each row.

    Parameters
    ----------
    s, z : ndarray, shape (field, column)
        Abscissa and ordinate, in the same unit; NaN in z where there is no point.
    std : ndarray, shape (column,)
        Noise of z in each column, 1 sigma; infinite for a column to leave out.

    Returns
    -------
    LineFit
        The lines.
    """
    return _fitted(s, z, std, np.zeros(std.size), robust=False)


def fit_lines_robustly(s: _Array, z: _Array, std: _Array, usual: _Array) -> LineFit:
    """Fit a straight line to each row, columns that do not belong to it weighted down.

    Rows in which every column lies within 4.5 standard deviations of the line keep the plain
    weighted fit, so nothing is lost on clean data. In the others Tukey's bisquare weights are
    iterated, with the larger of the stated noise and the row's own scatter as scale; where more
    than a tenth of the columns lie off, from a line by repeated medians (Siegel, Biometrika 69,
    1982, 242).

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
    return _fitted(s, z, std, usual, robust=True)


def _fitted(s: _Array, z: _Array, std: _Array, usual: _Array, *, robust: bool) -> LineFit:
    from glint_aoa.optical import _line_kernel as kernel  # noqa: PLC0415  compiles

    figures = np.empty((len(z), 5))
    weight, residual = np.empty(z.shape), np.empty(z.shape)
    kernel.fit_rows(s, z, std, usual, robust, figures, weight, residual)
    slope, intercept, slope_var, intercept_var, covariance = np.ascontiguousarray(figures.T)
    return LineFit(slope, intercept, slope_var, intercept_var, covariance, weight, residual)


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
