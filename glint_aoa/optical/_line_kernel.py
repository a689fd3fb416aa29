"""Compiled kernel of straight lines through a field's columns. Plain arrays in and out, no state.

Most loops run along the columns without branches and fill whole arrays, for the compiler to do
several columns at a time.
"""

# mypy: disable-error-code="no-untyped-def"

import numba
import numpy as np

_OUTLIER = 4.5  # standard deviations at which a field's columns are looked at again
_FEW = 0.1  # of the columns outlying leave the plain line fit to start from
_BISQUARE = 6.0  # standard deviations at which a column loses all weight; 99 % efficient
_ROUNDS = 5
_MEDIAN_COLUMNS = 48  # are enough to start from


@numba.njit(cache=True, nogil=True, error_model="numpy")
def total(values):
    """Sum in eight parts, so that no addition has to wait for the one before it."""
    a, b, c, d, e, f, g, h = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    whole = values.size // 8 * 8
    for i in range(0, whole, 8):
        a += values[i]
        b += values[i + 1]
        c += values[i + 2]
        d += values[i + 3]
        e += values[i + 4]
        f += values[i + 5]
        g += values[i + 6]
        h += values[i + 7]
    for i in range(whole, values.size):
        a += values[i]
    return ((a + b) + (c + d)) + ((e + f) + (g + h))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def plain_line(s, z, weight, spare, line):
    """Fill `line` with slope, intercept, their variances and covariance; NaN below two points.

    `weight` is the inverse variance, 0 where there is no point; `s` and `z` are finite there too.
    Returns the number of points.
    """
    n, count = s.size, 0
    for i in range(n):
        count += weight[i] > 0.0
        spare[i] = weight[i] * s[i]
    whole = total(weight)
    s_mean = total(spare) / whole
    for i in range(n):
        spare[i] = weight[i] * z[i]
    z_mean = total(spare) / whole
    for i in range(n):
        spare[i] = weight[i] * (s[i] - s_mean) * (s[i] - s_mean)
    spread = total(spare)
    if count < 2 or not spread > 0.0:
        line[:] = np.nan
        return count
    for i in range(n):
        spare[i] = weight[i] * (s[i] - s_mean) * (z[i] - z_mean)
    line[0] = total(spare) / spread
    line[1] = z_mean - line[0] * s_mean
    line[2] = 1.0 / spread
    line[3] = 1.0 / whole + s_mean * s_mean / spread
    line[4] = -s_mean / spread
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def residuals(s, z, line, residual):
    """Fill the departures of z from the line."""
    slope, intercept = line[0], line[1]
    for i in range(s.size):
        residual[i] = z[i] - intercept - slope * s[i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _outlying(residual, usual, weight):
    """Count the points that lie off the line and their usual place."""
    count, limit = 0, _OUTLIER * _OUTLIER
    for i in range(residual.size):
        off = residual[i] - usual[i]
        count += off * off * weight[i] > limit
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _scale(residual, usual, std, own, spare):
    """Scatter of the points in units of their noise, by the median; at least 1."""
    count = 0
    for i in range(residual.size):
        if own[i] > 0.0:
            spare[count] = abs(residual[i] - usual[i]) / std[i]
            count += 1
    return max(1.0, 1.4826 * np.median(spare[:count]))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _median_line(s, z, usual, line):
    """Line by repeated medians, which just under half of the columns cannot spoil.

    Siegel, Biometrika 69 (1982) 242. `z` is NaN where there is no point.
    """
    n = s.size
    step = (n + _MEDIAN_COLUMNS - 1) // _MEDIAN_COLUMNS
    level, each, slopes = np.empty(n), np.empty(n), np.empty(n)
    lines = 0
    for i in range(0, n, step):
        count = 0
        for j in range(0, n, step):
            slopes[count] = ((z[i] - usual[i]) - (z[j] - usual[j])) / (s[i] - s[j])
            count += np.isfinite(slopes[count])
        if count > 0:
            each[lines] = np.median(slopes[:count])
            lines += 1
    line[0] = np.median(each[:lines]) if lines > 0 else np.nan
    count = 0
    for i in range(n):
        level[count] = z[i] - usual[i] - line[0] * s[i]
        count += np.isfinite(level[count])
    line[1] = np.median(level[:count]) if count > 0 else np.nan


@numba.njit(cache=True, nogil=True, error_model="numpy")
def robust_line(s, z, known, own, std, usual, weight, residual, spare, line):
    """Fit a line, points that do not belong to it weighted down.

    Parameters beyond the obvious: `z` is NaN where there is no point, `known` 0 there as `s` is;
    `own` is a point's inverse variance, 0 where there is none, `std` the column's noise, `usual`
    its usual departure. Fills `line` as `plain_line`, and `weight` and `residual` [column].
    """
    n = s.size
    for i in range(n):
        weight[i] = own[i]
    plain_line(s, known, weight, spare, line)
    residuals(s, known, line, residual)
    outlying = _outlying(residual, usual, weight)
    if outlying == 0:
        return
    if outlying > _FEW * n:
        _median_line(s, z, usual, line)
        residuals(s, known, line, residual)
    for _ in range(_ROUNDS):
        reach = _BISQUARE * _scale(residual, usual, std, own, spare)
        for i in range(n):
            distance = (residual[i] - usual[i]) / (std[i] * reach)
            rest = max(1.0 - distance * distance, 0.0)
            weight[i] = own[i] * rest * rest
        plain_line(s, known, weight, spare, line)
        residuals(s, known, line, residual)
        if np.isnan(line[0]):
            weight[:] = 0.0
            return


@numba.njit(cache=True, nogil=True, error_model="numpy")
def points(s, z, column_weight, known, own):
    """Keep the points that there are: `s`, `known` and `own`, the weight, are 0 at the others."""
    for i in range(z.size):
        s[i] = s[i] if z[i] == z[i] else 0.0
    for i in range(z.size):
        known[i] = z[i] if z[i] == z[i] else 0.0
    for i in range(z.size):
        own[i] = column_weight[i] if z[i] == z[i] else 0.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fit_rows(s, z, std, usual, robust, figures, weight, residual):
    """Fit a line to each row of `z`, NaN where there is no point.

    Fills `figures` [row, 5] as `plain_line` does one line, `weight` and `residual` [row, column];
    the latter is NaN where `z` is.
    """
    n = z.shape[1]
    column_weight, own, known = 1.0 / std**2, np.empty(n), np.empty(n)
    place, spare = np.empty(n), np.empty(n)
    for k in range(z.shape[0]):
        place[:] = s[k]
        points(place, z[k], column_weight, known, own)
        if robust:
            robust_line(
                place, z[k], known, own, std, usual, weight[k], residual[k], spare, figures[k]
            )
        else:
            weight[k] = own
            plain_line(place, known, own, spare, figures[k])
        residuals(s[k], z[k], figures[k], residual[k])
