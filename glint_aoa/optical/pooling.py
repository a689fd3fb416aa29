"""What columns have in common and what is their own: means weighed by what is known of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Pooled", "over_fields", "shrunk"]

_Array = NDArray[np.float64]

_MEDIAN_VARIANCE = np.pi / 2  # of a median over that of the mean, normal noise
_SURE = 2.0  # standard deviations at which columns are taken to differ


@dataclass(frozen=True)
class Pooled:
    """One figure for each column from its values in many fields.

    Attributes
    ----------
    value, variance : ndarray, shape (column,)
        Median over the fields and its variance; NaN and infinite where there is none.
    spread : float
        Variance between fields beyond the noise; infinite where a single field cannot tell.
    """

    value: _Array
    variance: _Array
    spread: float


def over_fields(value: _Array, variance: _Array) -> Pooled:
    """Pool values over fields.

    Parameters
    ----------
    value, variance : ndarray, shape (field, column)
        Values and the variances of their noise; NaN where there is none.

    Returns
    -------
    Pooled
        Medians over the fields. The spread is that of DerSimonian and Laird (Control Clin Trials
        7 (1986) 177), pooled over the columns.
    """
    there = np.isfinite(value) & np.isfinite(variance) & (variance > 0)
    precision = np.where(there, 1 / np.where(there, variance, 1.0), 0.0)
    total = precision.sum(axis=0)
    known = total > 0
    middle = np.full(total.size, np.nan)
    middle[known] = np.nanmedian(np.where(there, value, np.nan)[:, known], axis=0)
    spread = _spread(np.where(there, value - middle, 0.0), precision)
    with np.errstate(divide="ignore"):
        return Pooled(middle, _MEDIAN_VARIANCE / total, spread)


def shrunk(value: _Array, variance: _Array) -> tuple[_Array, float]:
    """Shrink each column's value towards the common one by as much as its noise asks for.

    Where the columns differ by no more than noise often makes them, they all get the common one.

    Parameters
    ----------
    value, variance : ndarray, shape (column,)
        Values and the variances of their noise; NaN where there is none.

    Returns
    -------
    value : ndarray, shape (column,)
        The common value plus the share of the departure that is not noise; the common value where
        there is none.
    common : float
        The columns' median; NaN without any column.
    """
    there = np.isfinite(value) & np.isfinite(variance) & (variance > 0)
    if not there.any():
        return np.full(value.size, np.nan), np.nan
    common = float(np.median(value[there]))
    noise = np.where(there, variance, 1.0)
    away = np.where(there, value - common, 0.0)
    between = _spread(away[:, None], (there / noise)[:, None], margin=_SURE)
    if not np.isfinite(between):
        return common + away, common
    return common + away * between / (between + noise), common


def _spread(away: _Array, precision: _Array, *, margin: float = 0.0) -> float:
    """Variance beyond the noise, pooled over the second axis; infinite without a repetition.

    `margin` is how many standard deviations of the noise's own sum of squares do not count.
    """
    total = precision.sum(axis=0)
    known = total > 0
    freedom = float(((precision > 0).sum(axis=0) - 1)[known].sum())
    if freedom <= 0:
        return np.inf
    excess = (precision * away**2).sum() - freedom - margin * np.sqrt(2 * freedom)
    effective = total[known] - (precision**2).sum(axis=0)[known] / total[known]
    return max(0.0, float(excess / effective.sum()))
