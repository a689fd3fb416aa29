"""Linear prediction of a line's position from field to field: what is expected, what is not."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["outlying", "prediction_error", "predictor", "robust_scale"]

_Array = NDArray[np.float64]
_Mask = NDArray[np.bool_]

_ORDER = 12  # fields from which one is predicted: up to six vibrations at once
_ROUNDS = 6
_SIGMAS, _LEAST = 8.0, 1.5  # prediction errors [std, lines] beyond which a line has moved
_PATIENCE = 8  # fields that may lie off in a row before they count as the new place
_RIDGE = 1e-9
_ENOUGH = 1000  # predictions settle the coefficients
_LEAST_FIELDS = 8


def predictor(z: _Array, breaks: _Mask) -> tuple[_Array, float]:
    """Fit the coefficients that predict a value from those before it, or after it.

    Parameters
    ----------
    z : ndarray, shape (field,)
        Positions about their mean; NaN where missing.
    breaks : ndarray of bool, shape (field,)
        Fields before which time went on unseen.

    Returns
    -------
    coefficient : ndarray, shape (order,)
        Of the values 1, 2, ... fields away.
    scale : float
        Standard deviation of the prediction error, outliers apart.

    Notes
    -----
    Forward and backward least squares (the modified covariance method: Marple, Digital Spectral
    Analysis, 1987), reweighted so that outlying values do not shape the prediction. Sums of up to
    order / 2 steady sines are predicted without error.
    """
    order = int(np.clip(np.isfinite(z).sum() // 5, 2, _ORDER))
    whole = _whole_windows(z, breaks, order)
    whole = whole[:: -(-2 * whole.size // _ENOUGH) or 1]
    rows = _windows(z, order)[whole]
    rows = np.concatenate([rows, rows[:, ::-1]])
    if len(rows) < 2 * order + 2:
        return np.zeros(order), robust_scale(z)
    before, here = rows[:, -2::-1], rows[:, -1]
    weight = np.ones(len(here))
    coefficient, scale = np.zeros(order), np.inf
    for _ in range(_ROUNDS):
        weighted = before * weight[:, None]
        matrix = before.T @ weighted
        matrix += _RIDGE * (np.trace(matrix) + 1e-12) * np.eye(order)
        coefficient = np.linalg.solve(matrix, weighted.T @ here)
        error = here - before @ coefficient
        scale = robust_scale(error)
        weight = np.clip(1 - (error / (6 * scale)) ** 2, 0, 1) ** 2
    return coefficient, scale


def outlying(z: _Array, std: _Array, breaks: _Mask) -> _Mask:
    """Say which values lie far from where those around them put them.

    Parameters
    ----------
    z, std : ndarray, shape (field,)
        Positions and their noise [lines]; NaN where missing.
    breaks : ndarray of bool, shape (field,)
        Fields before which time went on unseen; nothing is predicted across.

    Returns
    -------
    ndarray of bool, shape (field,)
        Values more than 8 standard deviations of the prediction error, and 1.5 lines, away.
        Where a line stays at its new place, the fewer fields are taken to be wrong.
    """
    known = np.isfinite(z)
    far = np.zeros(z.size, np.bool_)
    if known.sum() < _LEAST_FIELDS:
        return far
    noise = float(np.median(std[known]))
    for _ in range(2):  # the second time, what lay off does not shape the prediction
        again = _outlying(z, noise, breaks, known & ~far)
        if (again == far).all():
            break
        far = again & known
    return far


def _outlying(z: _Array, noise: float, breaks: _Mask, usual: _Mask) -> _Mask:
    level = z - np.median(z[usual])
    coefficient, scale = predictor(np.where(usual, level, np.nan), breaks)
    limit = max(_SIGMAS * max(scale, noise), _LEAST)
    error = prediction_error(level, coefficient, breaks)
    surprising = np.abs(error) > limit
    if not surprising.any():
        return np.zeros(z.size, np.bool_)
    runs = _longest_runs(np.isfinite(error) & ~surprising)
    tried = [_far_from(level, breaks, run, coefficient, limit) for run in runs]
    known = np.isfinite(z)
    return min(tried, key=lambda far: np.count_nonzero(far & known), default=~usual & known)


def _far_from(
    z: _Array, breaks: _Mask, trusted: tuple[int, int], coefficient: _Array, limit: float
) -> _Mask:
    """Say what lies off if a run of fields is trusted, walking on from it to both sides."""
    first, last = trusted
    bounds = float(np.nanmin(z[first:last])) - limit, float(np.nanmax(z[first:last])) + limit
    far = np.zeros(z.size, np.bool_)
    far[last:] = _walk(z, breaks, last, coefficient, limit, bounds)
    back_breaks = np.concatenate([[False], breaks[:0:-1]])
    back = _walk(z[::-1], back_breaks, z.size - first, coefficient, limit, bounds)
    far[:first] = back[::-1]
    return far


def prediction_error(z: _Array, coefficient: _Array, breaks: _Mask) -> _Array:
    """Departure of each value from its prediction by those before; NaN where it has none."""
    order = coefficient.size
    error = np.full(z.size, np.nan)
    rows = _windows(z, order)
    if len(rows):
        error[order:] = rows[:, -1] - rows[:, -2::-1] @ coefficient
        error[order:][_crossed(breaks, order)] = np.nan
    return error


def _walk(
    z: _Array,
    breaks: _Mask,
    start: int,
    coefficient: _Array,
    limit: float,
    bounds: tuple[float, float],
) -> _Mask:
    """Go on from `start` through values that may lie off; those that do count as predicted.

    After more than eight in a row nothing can be predicted, and a value has only to lie within
    `bounds` until there are enough of them again.
    """
    order, off = coefficient.size, 0
    clean = z.copy()
    far = np.zeros(z.size, np.bool_)
    for k in range(start, z.size):
        if breaks[k]:
            clean[:k] = np.nan
        expected = clean[max(k - order, 0) : k][::-1] @ coefficient[: min(k, order)]
        if k >= order and np.isfinite(expected):
            far[k] = abs(z[k] - expected) > limit
            lost = far[k] or not np.isfinite(z[k])
            off = off + 1 if lost else 0
            if lost:
                clean[k] = expected if off <= _PATIENCE else np.nan
        else:
            far[k] = not bounds[0] <= z[k] <= bounds[1]
            clean[k], off = np.nan if far[k] else z[k], 0
    return far[start:]


def _whole_windows(z: _Array, breaks: _Mask, order: int) -> NDArray[np.intp]:
    """First fields of the windows of `order` + 1 values that lack none and cross no break."""
    missing = np.concatenate([[0], np.cumsum(~np.isfinite(z))])
    crossed = np.concatenate([[0], np.cumsum(breaks)])
    n = max(z.size - order, 0)
    end = order + 1
    lacks = missing[end : end + n] - missing[:n]
    crosses = crossed[end : end + n] - crossed[1 : 1 + n]
    return np.flatnonzero((lacks == 0) & (crosses == 0))


def _longest_runs(good: _Mask) -> list[tuple[int, int]]:
    """First index, and one past the last, of the longest three runs."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]])))
    runs = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    return sorted(runs, key=lambda run: run[0] - run[1])[:3]


def _crossed(breaks: _Mask, order: int) -> _Mask:
    """Whether a break lies within the `order` + 1 values that end here."""
    return np.asarray(_windows(breaks[1:], order - 1).any(axis=1))


def robust_scale(values: _Array) -> float:
    """Return the standard deviation as the median absolute value tells it, at least 1e-6."""
    known = values[np.isfinite(values)]
    return max(1.4826 * float(np.median(np.abs(known))), 1e-6) if known.size else 1e-6


def _windows(z: NDArray[Any], order: int) -> NDArray[Any]:
    if z.size <= order:
        return np.empty((0, order + 1), z.dtype)
    return np.lib.stride_tricks.sliding_window_view(z, order + 1)
