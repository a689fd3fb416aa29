"""Compiled kernel of the smoother. Plain arrays in and out, no state.

Kalman filter and smoother of a linear model with scalar measurements taken one after the other
(univariate treatment: Koopman and Durbin 2000, doi:10.1111/1467-9892.00186), run alike on the
measurements and on the regressors of constant unknowns (de Jong 1991,
doi:10.1214/aos/1176348139), so that constants cost no states. The smoother goes backward without
the inverse of a covariance (Bryson and Frazier's recursion).

The transition is made of blocks; only the columns of a row's block are looked at. Inner loops run
along rows of memory, for the compiler to do several numbers at a time.
"""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: PLR0912

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _times(matrix, first, last, right, product):
    """Fill `product` with a block matrix times another."""
    columns = right.shape[1]
    for i in range(matrix.shape[0]):
        for c in range(columns):
            product[i, c] = 0.0
        for j in range(first[i], last[i]):
            factor = matrix[i, j]
            for c in range(columns):
                product[i, c] += factor * right[j, c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _blocks(matrix):
    """First and one past the last column of each row that are not zero in it or below it."""
    n = matrix.shape[0]
    first, last = np.empty(n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        first[i], last[i] = i, i + 1
        for j in range(n):
            if matrix[i, j] != 0.0 or matrix[j, i] != 0.0:
                first[i] = min(first[i], j)
                last[i] = max(last[i], j + 1)
    return first, last


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _times_symmetric(left, symmetric, product):
    """Fill `product` with a few rows times a symmetric matrix."""
    n = symmetric.shape[0]
    for i in range(left.shape[0]):
        for c in range(n):
            product[i, c] = 0.0
        for j in range(n):
            factor = left[i, j]
            if factor != 0.0:
                for c in range(n):
                    product[i, c] += factor * symmetric[j, c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def filtered(transition, process, start, covariance, sample, row, rows, values, variance, samples):
    """Run the filter over all measurements, which come in order of their samples.

    `values` [measurement, column] holds the measurement in column 0, then the regressors. Returns
    for each sample the predicted states [sample, state, column] and covariance
    [sample, state, state]; for each measurement gain [measurement, state], innovations
    [measurement, column] and their variance.
    """
    n, columns = start.shape
    count = sample.size
    predicted = np.empty((samples, n, columns))
    spread = np.empty((samples, n, n))
    gain = np.empty((count, n))
    innovation = np.empty((count, columns))
    innovation_variance = np.empty(count)
    first, last = _blocks(transition)
    x, p = start.copy(), covariance.copy()
    moved, turned = np.empty((n, columns)), np.empty((n, n))
    ph = np.empty(n)
    k = 0
    for t in range(samples):
        if t:
            _times(transition, first, last, x, moved)
            x[:] = moved
            _times(transition, first, last, p, turned)
            _times(transition, first, last, np.ascontiguousarray(turned.T), p)
            p += process
        predicted[t] = x
        spread[t] = p
        while k < count and sample[k] == t:
            h = rows[row[k]]
            ph[:] = 0.0
            for c in range(columns):
                innovation[k, c] = values[k, c]
            for i in range(n):
                if h[i] != 0.0:
                    for j in range(n):
                        ph[j] += h[i] * p[i, j]
                    for c in range(columns):
                        innovation[k, c] -= h[i] * x[i, c]
            f = variance[k]
            for i in range(n):
                f += h[i] * ph[i]
            innovation_variance[k] = f
            for i in range(n):
                share = ph[i] / f
                gain[k, i] = share
                for c in range(columns):
                    x[i, c] += share * innovation[k, c]
                for j in range(n):
                    p[i, j] -= share * ph[j]
            k += 1
        for i in range(n):
            for j in range(i):
                p[i, j] = p[j, i]
    return predicted, spread, gain, innovation, innovation_variance


@numba.njit(cache=True, nogil=True, error_model="numpy")
def smoothed(
    transition, sample, row, rows, predicted, spread, gain, innovation, innovation_variance, seen
):
    """Run the smoother backward over what `filtered` left.

    Returns the combinations `seen` [seen, state] of the smoothed states, [sample, seen, column],
    and their covariance [sample, seen, seen].
    """
    samples, n, columns = predicted.shape
    wanted = seen.shape[0]
    states = np.empty((samples, wanted, columns))
    shown = np.empty((samples, wanted, wanted))
    back = np.ascontiguousarray(transition.T)
    first, last = _blocks(transition)
    r, moved = np.zeros((n, columns)), np.empty((n, columns))
    big, turned = np.zeros((n, n)), np.empty((n, n))
    across, pulled = np.empty((wanted, n)), np.empty((wanted, n))
    nk, pull = np.empty(n), np.empty(columns)
    k = sample.size - 1
    for t in range(samples - 1, -1, -1):
        while k >= 0 and sample[k] == t:
            h, f = rows[row[k]], innovation_variance[k]
            for c in range(columns):
                pull[c] = innovation[k, c] / f
            nk[:] = 0.0
            for i in range(n):
                share = gain[k, i]
                for c in range(columns):
                    pull[c] -= share * r[i, c]
                for j in range(n):
                    nk[j] += share * big[i, j]
            knk = 1.0 / f
            for i in range(n):
                knk += gain[k, i] * nk[i]
            for i in range(n):
                if h[i] != 0.0:
                    for c in range(columns):
                        r[i, c] += h[i] * pull[c]
                for j in range(n):
                    big[i, j] += h[i] * (h[j] * knk - nk[j]) - nk[i] * h[j]
            k -= 1
        _times_symmetric(seen, spread[t], across)
        _times_symmetric(across, big, pulled)
        for i in range(wanted):
            for c in range(columns):
                states[t, i, c] = 0.0
            for j in range(n):
                for c in range(columns):
                    states[t, i, c] += seen[i, j] * predicted[t, j, c] + across[i, j] * r[j, c]
            for j in range(wanted):
                shown[t, i, j] = 0.0
                for c in range(n):
                    shown[t, i, j] += across[i, c] * seen[j, c] - pulled[i, c] * across[j, c]
        _times(back, first, last, r, moved)
        r[:] = moved
        _times(back, first, last, big, turned)
        _times(back, first, last, np.ascontiguousarray(turned.T), big)
    return states, shown
