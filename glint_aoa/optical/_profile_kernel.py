"""Compiled kernel that matches the line's profile to columns. Plain arrays in and out, no state."""

# mypy: disable-error-code="no-untyped-def"

import math

import numba
import numpy as np

USED, DIM, CUT = 0, 1, 2  # what `status` says of a column: measured, too dim, out of the window

_ROUNDS = 12
_NEAR = 0.05  # lines: a match this near to where it was expanded is not repeated
_SURE = 4.0  # standard deviations within which noise alone may put a match away from its start
_SETTLED = 1e-4
_ROOT_2, _ROOT_2_PI = math.sqrt(2.0), math.sqrt(2 * math.pi)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _phase(row, n_phases):
    """Whole row and number of the tabulated phase nearest to a row."""
    steps = int(np.floor(row * n_phases + 0.5))
    whole = (steps + n_phases // 2) // n_phases
    return whole, steps - whole * n_phases + n_phases // 2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _match(pixel, filters, bend, tilt_gain, tilt, phase):
    """Height and shift of the line against the phase, by the linear filters of that phase."""
    height, moved = 0.0, 0.0
    for j in range(pixel.size):
        height += filters[phase, 0, j] * pixel[j]
        moved += filters[phase, 1, j] * pixel[j]
    shift = (moved - tilt * tilt_gain[phase]) / height
    return height, shift - bend[phase] * shift * shift


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _hazard(z):
    """Mean by which a normal variable exceeds z where it is known to exceed it, plus z."""
    if z > 8.0:
        return z + 1.0 / z
    return math.exp(-0.5 * z * z) / _ROOT_2_PI / max(0.5 * math.erfc(z / _ROOT_2), 1e-300)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _solve(a, b):
    """Solve three equations in place; False if they do not hold together."""
    for k in range(3):
        if not a[k, k] > 0.0:
            return False
        for i in range(k + 1, 3):
            factor = a[i, k] / a[k, k]
            for j in range(k, 3):
                a[i, j] -= factor * a[k, j]
            b[i] -= factor * b[k]
    for k in range(2, -1, -1):
        for j in range(k + 1, 3):
            b[k] -= a[k, j] * b[j]
        b[k] /= a[k, k]
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _scored(value, model, variance, saturation):
    """Score and information of one pixel; one at the top of the scale is censored there."""
    if value < saturation:
        return (value - model) / variance, 1.0 / variance
    z = (saturation - 0.5 - model) / math.sqrt(variance)
    hazard = _hazard(z)
    return hazard / math.sqrt(variance), max(hazard * (hazard - z), 1e-6) / variance


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _likeliest(field, column, start, sign, profile, reach, noise, saturation, tilt, state, a, b):
    """Maximum likelihood of one column from the pixels that there are, clipped ones censored.

    `state` holds height, level and row, and is improved in place; returns the row's variance,
    NaN where nothing was found.
    """
    n_phases, rows = profile.shape[1], field.shape[0]
    side = (profile.shape[2] - 1) // 2
    variance_of_row = np.nan
    for _ in range(_ROUNDS * 2):
        whole, phase = _phase(state[2], n_phases)
        a[:] = 0.0
        b[:] = 0.0
        for j in range(2 * side + 1):
            row = whole + j - side
            if row < 0 or row >= rows:
                continue
            t = row - state[2]
            shape, slope = profile[0, phase, j], profile[1, phase, j]
            model = state[1] + state[0] * shape + tilt * t
            variance = noise[0] + noise[1] * max(sign * model - noise[2], 0.0)
            score, weight = _scored(sign * field[row, column], model, variance, saturation)
            g = (shape, 1.0, -state[0] * slope)
            taper = profile[2, phase, j]
            for p in range(3):
                b[p] += taper * g[p] * score
                for q in range(3):
                    a[p, q] += taper * weight * g[p] * g[q]
        kept = a[2, 2]
        for p in range(3):
            a[p, p] *= 1.0 + 1e-9
        if not _solve(a, b) or not kept > 0.0:
            return np.nan
        variance_of_row = 1.0 / a[2, 2]  # what is left of it after the other two
        step = min(max(b[2], -0.5), 0.5)
        state[0] += b[0]
        state[1] += b[1]
        state[2] += step
        if not state[0] > 0.0 or not abs(state[2] - start) <= reach:
            return np.nan
        if abs(step) < _SETTLED:
            break
    return variance_of_row


@numba.njit(cache=True, nogil=True, error_model="numpy")
def match_columns(
    fields,
    columns,
    start,
    sign,
    profile,
    filters,
    bend,
    tilt_gain,
    spread,
    tilt,
    usual,
    noise,
    core,
    reach,
    threshold,
    saturation,
    row,
    height,
    status,
    clipped,
):
    """Fill `row`, `height`, `status` and `clipped` [field, column].

    Parameters beyond the obvious: `profile` [3, phase, line] the profile, its slope, and the
    weight's taper; `filters` [phase, 2, line] give height and height times shift; `bend` and
    `tilt_gain` [phase] the shift's second order and its answer to a tilted background; `spread`
    [phase] the shift's standard deviation times the height; `tilt` and `usual` [column] the
    background's tilt and level; `core` half of what must lie within the window [lines].
    """
    n_phases, size = profile.shape[1], profile.shape[2]
    side = (size - 1) // 2
    rows = fields.shape[1]
    pixel = np.empty(size, np.float32)
    state, a, b = np.empty(3), np.empty((3, 3)), np.empty(3)
    for k in range(fields.shape[0]):
        for i in range(columns.size):
            begun = start[k, i]
            row[k, i] = np.nan
            height[k, i] = 0.0
            clipped[k, i] = False
            status[k, i] = DIM
            if np.isnan(begun):
                continue
            if begun - core < -0.5 or begun + core > rows - 0.5:
                status[k, i] = CUT
                continue
            whole, phase = _phase(begun, n_phases)
            whole_window = whole - side >= 0 and whole + side < rows
            top = 0.0
            if whole_window:
                for j in range(size):
                    value = fields[k, whole - side + j, columns[i]]
                    pixel[j] = sign * value
                    top = max(top, value)
            found, high = np.nan, 0.0
            if whole_window and top < saturation:
                for _ in range(_ROUNDS):
                    high, shift = _match(pixel, filters, bend, tilt_gain, tilt[i], phase)
                    if not high > 0.0 or not abs(shift) <= side:
                        break
                    now = whole + (phase - n_phases // 2) / n_phases
                    found = now + shift
                    if abs(shift) <= max(_NEAR, _SURE * spread[phase] / high):
                        break
                    if abs(found - begun) > reach:
                        break
                    whole, phase = _phase(found, n_phases)
                    if whole - side < 0 or whole + side >= rows:
                        whole_window = False
                        break
                    for j in range(size):
                        pixel[j] = sign * fields[k, whole - side + j, columns[i]]
            if not whole_window or top >= saturation:
                state[0] = usual[0, i]
                state[1] = usual[1, i]
                state[2] = begun
                variance = _likeliest(
                    fields[k],
                    columns[i],
                    begun,
                    sign,
                    profile,
                    reach,
                    noise,
                    saturation if sign > 0 else np.inf,
                    tilt[i],
                    state,
                    a,
                    b,
                )
                high, found = state[0], state[2] if variance > 0.0 else np.nan
                clipped[k, i] = top >= saturation
            height[k, i] = high
            if np.isnan(found):
                continue
            if found - core < -0.5 or found + core > rows - 0.5:
                status[k, i] = CUT
            elif high >= 0.5 * threshold and abs(found - begun) <= reach:
                status[k, i] = USED
                row[k, i] = found
