"""Compiled kernel of Steger's line points. Plain arrays in and out, no state.

The pixels' steps are convolved with derivatives of a Gaussian at any row between them, so the
point is the zero of the first derivative itself, not that of a series about the nearest pixel.
"""

# mypy: disable-error-code="no-untyped-def"

import math

import numba
import numpy as np

from glint_aoa.optical._window_kernel import CUT, DIM, SEARCH, USED, clips, coarse

_ROUNDS = 15
_SETTLED = 1e-4  # lines; Newton leaves its square
_ROOT_2_PI = math.sqrt(2 * math.pi)
_REACH = 4.0  # scales of the filter, on each side
_LEVEL = 0.7  # least cosine of the line's slope


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _along(field, column, first, taps, reach, smooth):
    """Fill `smooth` [derivative along the line, row] around a column, from row `first` on."""
    centre = taps.shape[1] // 2
    smooth[:] = 0.0
    for k in range(smooth.shape[1]):
        row = field[first + k]
        for j in range(-reach, reach + 1):
            grey = float(row[column + j])
            for order in range(3):
                smooth[order, k] += taps[order, centre + j] * grey


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _derivatives(smooth, level, first, row, scale, out):
    """Fill `out` with Ly, Lyy, Lx, Lxy, Lxx of the filtered field at `row`; `level` lies beyond."""
    out[:] = 0.0
    norm = 1 / (_ROOT_2_PI * scale)
    low = (first - 0.5 - row) / scale
    bell_low = norm * math.exp(-0.5 * low * low)
    for k in range(smooth.shape[1]):
        high = low + 1 / scale
        bell = norm * math.exp(-0.5 * high * high)
        weight, slope = 0.5 * (bell_low + bell), bell_low - bell
        grey = smooth[0, k] - level
        out[0] += slope * grey
        out[1] += (low * bell_low - high * bell) / scale * grey
        out[2] += weight * smooth[1, k]
        out[3] += slope * smooth[1, k]
        out[4] += weight * smooth[2, k]
        low, bell_low = high, bell


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _step(d, sign):
    """Step of the row to where the derivative across the line vanishes; NaN if it is no line.

    Across is the direction of the Hessian's largest eigenvalue of the line's polarity.
    """
    angle = 0.5 * math.atan2(-sign * 2 * d[3], sign * (d[1] - d[4]))
    across_x, across_y = math.cos(angle), math.sin(angle)
    if abs(across_y) < _LEVEL:
        return np.nan
    first = d[2] * across_x + d[0] * across_y
    second = (
        d[4] * across_x * across_x + 2 * d[3] * across_x * across_y + d[1] * across_y * across_y
    )
    if not sign * second < 0:
        return np.nan
    return -first / second / across_y


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _point(field, column, start, scale, geometry, taps, reach, found):
    """Find the line's point in one column; fills `found` [row, second derivative]."""
    sign, half_width = geometry[0], geometry[1]
    state = np.zeros(4)
    row = coarse(field, column, start, scale, sign, half_width, state)
    middle, first = np.inf, 0
    extent = _REACH * scale + 1.0
    smooth, out = np.empty((3, 0)), np.empty(5)
    level = 0.0
    for _ in range(_ROUNDS):
        if row - half_width < -0.5 or row + half_width > field.shape[0] - 0.5:
            return CUT
        if abs(row - middle) > 1.0:  # the rows stay while the point settles among them
            middle = row
            first = max(math.ceil(middle - extent), 0)
            last = min(math.floor(middle + extent), field.shape[0] - 1)
            smooth = np.empty((3, last - first + 1))
            _along(field, column, first, taps[reach], reach, smooth)
            level = 0.5 * (smooth[0, 0] + smooth[0, -1])
        _derivatives(smooth, level, first, row, scale, out)
        step = _step(out, sign)
        if math.isnan(step):
            return DIM
        step = min(max(step, -scale), scale)
        row += step
        if abs(step) < _SETTLED:
            break
    found[0], found[1] = row, out[1]
    return USED


@numba.njit(cache=True, nogil=True, error_model="numpy")
def column_centres(
    fields,
    columns,
    start,
    scale,
    geometry,
    to_height,
    taps,
    reach,
    threshold,
    saturation,
    centre,
    height,
    status,
    clipped,
):
    """Fill `centre`, `height`, `status` and `clipped` [field, column].

    `taps` [reach, derivative, tap] filter along the line; `reach` says which of them a column
    takes. `to_height` turns the second derivative of a line of this width into its height.
    """
    found = np.empty(2)
    for f in range(fields.shape[0]):
        for i in range(columns.size):
            centre[f, i], height[f, i] = np.nan, 0.0
            clipped[f, i], status[f, i] = False, DIM
            if not math.isfinite(start[f, i]):
                continue
            outcome = _point(
                fields[f], columns[i], start[f, i], scale, geometry, taps, reach[i], found
            )
            if outcome == USED:
                height[f, i] = -geometry[0] * to_height * found[1]
                off = abs(found[0] - start[f, i]) > geometry[1] + SEARCH
                outcome = DIM if off or height[f, i] < threshold / 2 else USED
            status[f, i] = outcome
            if outcome == USED:
                centre[f, i] = found[0]
                clipped[f, i] = clips(fields[f], columns[i], found[0], geometry[1], saturation)
