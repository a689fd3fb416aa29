"""Compiled kernel of the restricted likelihood. Plain arrays in and out, no state.

With K the covariance of the fields and X the trend, minus the log likelihood is, but for a
constant, (log |K| + log |X' K^-1 X| + y' P y) / 2, where P is K^-1 less the trend (Patterson and
Thompson 1971, doi:10.1093/biomet/58.3.545).
"""

# mypy: disable-error-code="no-untyped-def"

import math

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, error_model="numpy")
def restricted_likelihood(covariance, place, trend, angle, projector, by_lag):
    """Minus the log likelihood of the angles [field]; infinite if K is not positive definite.

    `covariance` [lag] is that of fields with the numbers `place` [field], `trend` [field, term] is
    X. Fills `projector` [field, field] with P, and `by_lag` [lag] with the derivatives to the
    covariance of each lag.
    """
    if place[-1] - place[0] == place.size - 1:
        log_det = _invert_toeplitz(covariance, projector)
    else:
        log_det = _invert(covariance, place, projector)
    if not math.isfinite(log_det):
        return math.inf
    for k in range(trend.shape[1]):
        log_det += _take_out(trend[:, k].copy(), projector)
    whitened = projector @ angle
    by_lag[:] = 0.0
    for i in range(place.size):
        for j in range(i):
            by_lag[place[i] - place[j]] += projector[i, j] - whitened[i] * whitened[j]
        by_lag[0] += 0.5 * (projector[i, i] - whitened[i] * whitened[i])
    return 0.5 * (log_det + angle @ whitened)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _take_out(term, projector):
    """Project a term out of `projector`; log of what it measured there."""
    half = projector @ term
    square = term @ half
    for i in range(term.size):
        share = half[i] / square
        for j in range(term.size):
            projector[i, j] -= share * half[j]
    return math.log(square)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _invert_toeplitz(covariance, inverse):
    """Fill `inverse` with K^-1 for fields without a gap; log |K|, NaN if not positive definite.

    Durbin's recursion gives the filter that predicts a field from all others of its record, which
    is the first column of K^-1; Trench (1964, doi:10.1137/0112045) fills in the rest.
    """
    n = inverse.shape[0]
    column, turned = np.zeros(n), np.zeros(n)
    column[0], error, log_det = 1.0, covariance[0], 0.0
    for order in range(n):
        if order > 0:
            reflection = 0.0
            for i in range(order):
                reflection -= column[i] * covariance[order - i] / error
            for i in range(order):
                turned[order - i] = column[i]
            for i in range(1, order + 1):
                column[i] += reflection * turned[i]
            error *= (1 - reflection) * (1 + reflection)
        if not error > 0:
            return math.nan
        log_det += math.log(error)
    for i in range(n):
        inverse[i, 0] = inverse[0, i] = column[i] / error
    for i in range(1, n):
        ahead, back = column[i] / error, column[n - i] / error
        for j in range(1, n):
            inverse[i, j] = inverse[i - 1, j - 1] + ahead * column[j] - back * column[n - j]
    return log_det


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _invert(covariance, place, inverse):
    """Fill `inverse` with K^-1 by Cholesky's factor; log |K|, NaN if not positive definite."""
    n = place.size
    upper, root = np.empty((n, n)), np.zeros((n, n))  # root: inverse of the lower factor
    for i in range(n):
        for j in range(i, n):
            upper[i, j] = covariance[place[j] - place[i]]
    inverse[:] = 0.0
    log_det = 0.0
    for k in range(n):
        pivot = upper[k, k]
        if not pivot > 0:
            return math.nan
        log_det += math.log(pivot)
        scale = 1 / math.sqrt(pivot)
        for j in range(k, n):
            upper[k, j] *= scale
        for i in range(k + 1, n):
            factor = upper[k, i]
            for j in range(i, n):
                upper[i, j] -= factor * upper[k, j]
        root[k, k] = 1.0
        for i in range(k):
            factor = upper[i, k]
            for j in range(i + 1):
                root[k, j] -= factor * root[i, j]
        for j in range(k + 1):
            root[k, j] *= scale
        for i in range(k + 1):
            factor = root[k, i]
            for j in range(k + 1):
                inverse[i, j] += factor * root[k, j]
    return log_det
