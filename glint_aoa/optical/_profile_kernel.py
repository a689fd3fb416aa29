"""Compiled kernel that matches the line's profile to columns. Plain arrays in and out, no state."""

# mypy: disable-error-code="no-untyped-def"

import math

import numba
import numpy as np

from glint_aoa.optical._line_kernel import plain_line
from glint_aoa.optical._locate_kernel import coarse_rows
from glint_aoa.optical._locate_kernel import scratch_for as search_scratch_for
from glint_aoa.optical._summary_kernel import scratch_for as summary_scratch_for
from glint_aoa.optical._summary_kernel import summarise_field

_ROUNDS = 12
_NEAR = 0.05  # lines: a match this near to where it was expanded is not repeated
_SURE = 4.0  # standard deviations within which noise alone may put a match away from its start
_SETTLED = 1e-4
_LEAST_COLUMNS = 8  # that tell together where the line is
_FAR = 4.0  # times the scatter: columns that do not count for that
_ROOT_2, _ROOT_2_PI = math.sqrt(2.0), math.sqrt(2 * math.pi)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _phase(row, n_phases):
    """Whole row and number of the tabulated phase nearest to a row."""
    steps = int(np.floor(row * n_phases + 0.5))
    whole = (steps + n_phases // 2) // n_phases
    return whole, steps - whole * n_phases + n_phases // 2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _match(pixel, filters, bend, gain, tilt, step, phase):
    """Height and shift of the line against the phase, by the linear filters of that phase."""
    height, moved = 0.0, 0.0
    for j in range(pixel.size):
        height += filters[phase, 0, j] * pixel[j]
        moved += filters[phase, 1, j] * pixel[j]
    shift = (moved - tilt * gain[0, phase] - step * gain[1, phase]) / height
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
def _gather(field, column, sign, profile, noise, saturation, tilt, step, state, a, b):
    """Fill the normal equations of height, level and row; returns whether a pixel is clipped."""
    n_phases, side = profile.shape[1], (profile.shape[2] - 1) // 2
    whole, phase = _phase(state[2], n_phases)
    beyond = state[2] - whole - (phase - n_phases // 2) / n_phases  # the phase that is tabulated
    a[:] = 0.0
    b[:] = 0.0
    clips = False
    for j in range(2 * side + 1):
        row = whole + j - side
        if row < 0 or row >= field.shape[0]:
            continue
        slope = profile[1, phase, j]
        shape = profile[0, phase, j] - beyond * slope
        model = state[1] + state[0] * shape + tilt * (row - state[2])
        model += step * profile[3, phase, j]
        variance = noise[0] + noise[1] * max(sign * model - noise[2], 0.0)
        value = sign * np.float64(field[row, column])
        clips = clips or value >= saturation
        score, weight = _scored(value, model, variance, saturation)
        g = (shape, 1.0, -state[0] * slope)
        taper = profile[2, phase, j]
        for p in range(3):
            b[p] += taper * g[p] * score
            for q in range(3):
                a[p, q] += taper * weight * g[p] * g[q]
    return clips


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _likeliest(
    field, column, start, sign, profile, reach, noise, saturation, tilt, step, state, a, b
):
    """Maximum likelihood of one column from the pixels that there are, clipped ones censored.

    `state` holds height, level and row, and is improved in place; returns the row, NaN where
    nothing was found, and whether a pixel is clipped.
    """
    clips = False
    for _ in range(2 * _ROUNDS):
        clips = _gather(field, column, sign, profile, noise, saturation, tilt, step, state, a, b)
        for p in range(3):
            a[p, p] *= 1.0 + 1e-9
        if not _solve(a, b):
            return np.nan, clips
        move = min(max(b[2], -0.5), 0.5)
        state[0] += b[0]
        state[1] += b[1]
        state[2] += move
        if not state[0] > 0.0 or not abs(state[2] - start) <= reach:
            return np.nan, clips
        if abs(move) < _SETTLED:
            break
    return state[2], clips


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _read(field, column, first, sign, pixel):
    """Copy a column's rows from `first` on; returns the largest grey level."""
    top = 0
    for j in range(pixel.size):
        value = field[first + j, column]
        pixel[j] = sign * np.float32(value)
        top = max(top, value)
    return top


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _filtered(field, column, start, sign, tables, tilt, step, reach, ceiling, pixel):
    """Row and height of one column by the filters of its phase.

    Returns NaN and 0 where nothing is found, and whether the filters can be used at all: they
    need all rows of the profile, and none at the top of the scale.
    """
    filters, bend, gain, spread = tables
    n_phases, side = filters.shape[0], (pixel.size - 1) // 2
    found, row = np.nan, start
    for _ in range(_ROUNDS):
        whole, phase = _phase(row, n_phases)
        if whole - side < 0 or whole + side >= field.shape[0]:
            return np.nan, 0.0, False
        if _read(field, column, whole - side, sign, pixel) >= ceiling:
            return np.nan, 0.0, False
        height, shift = _match(pixel, filters, bend, gain, tilt, step, phase)
        if not height > 0.0:
            return np.nan, 0.0, True
        found = whole + (phase - n_phases // 2) / n_phases + shift
        if abs(shift) <= max(_NEAR, _SURE * spread[phase] / height):
            return found, height, True
        if not abs(found - start) <= reach:
            return np.nan, height, True
        row = found
    return found, height, True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def scratch_for(settings):
    """Memory for `match_field`."""
    profile, n = settings[1], settings[3].shape[1]
    own = np.empty(profile.shape[2], np.float32), np.empty(3), np.empty((3, 3)), np.empty(3)
    return own, np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(5)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def match_field(field, columns, start, settings, scratch, row, height, cut, clipped):
    """Fill what `_match_columns` does, from a start as good as the field allows.

    Where one column tells little, its match is best taken from where all together put the line:
    by then the profile's change with the row is the straight one that the filters assume.
    """
    own, again, place, known, weight, spare, line = scratch
    _match_columns(field, columns, start, settings, own, row, height, cut, clipped)
    if not settings[10]:
        return
    for i in range(columns.size):
        off = row[i] - start[i]
        weight[i] = 1.0 if off == off else 0.0  # noqa: PLR0124  NaN is not
        known[i] = off if off == off else 0.0  # noqa: PLR0124
        place[i] = np.float64(columns[i])
    if plain_line(place, known, weight, spare, line) < _LEAST_COLUMNS:
        return
    scatter = _least_scatter(place, known, weight, line)
    for i in range(columns.size):
        is_far = abs(known[i] - line[1] - line[0] * place[i]) > _FAR * scatter
        weight[i] = 0.0 if is_far else weight[i]
    if plain_line(place, known, weight, spare, line) < _LEAST_COLUMNS:
        return
    for i in range(columns.size):
        again[i] = start[i] + line[1] + line[0] * place[i]
    _match_columns(field, columns, again, settings, own, row, height, cut, clipped)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _least_scatter(place, known, weight, line):
    """Scatter about a line by the median of what there is."""
    off = np.empty(place.size)
    count = 0
    for i in range(place.size):
        if weight[i] > 0.0:
            off[count] = abs(known[i] - line[1] - line[0] * place[i])
            count += 1
    return 1.4826 * np.median(off[:count])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _match_columns(field, columns, start, settings, own, row, height, cut, clipped):
    """Fill `row`, NaN where there is none, `height`, `cut` and `clipped` [column].

    `settings` are sign; `profile` [4, phase, line], the profile, its slope, the weights' taper, and
    a step across the line; `tables`, the filters [phase, 2, line] that give height and height times
    shift, the shift's second order [phase], its answers to tilt and step of the background
    [2, phase], and its standard deviation times the height [phase]; `uneven` [2, column] that tilt
    and step, `usual` [2, column] height and level; `noise`; `core`, half of what must lie within
    the window, and how far a centre may lie from its start [lines]; the least height, and the level
    that clips; whether single columns are noisy. `own` is the first of `scratch_for`.
    """
    sign, profile, tables, uneven, usual, noise, core, reach, threshold, saturation, _ = settings
    pixel, state, a, b = own
    rows = field.shape[0]
    ceiling = saturation if sign > 0 else np.inf  # the glint of a dark line is far from the top
    for i in range(columns.size):
        begun = start[i]
        row[i], height[i], cut[i], clipped[i] = np.nan, 0.0, False, False
        if np.isnan(begun):
            continue
        if begun - core < -0.5 or begun + core > rows - 0.5:
            cut[i] = True
            continue
        tilt, step = uneven[0, i], uneven[1, i]
        found, high, done = _filtered(
            field, columns[i], begun, sign, tables, tilt, step, reach, ceiling, pixel
        )
        if not done:
            state[0], state[1], state[2] = usual[0, i], usual[1, i], begun
            found, clipped[i] = _likeliest(
                field,
                columns[i],
                begun,
                sign,
                profile,
                reach,
                noise,
                ceiling,
                tilt,
                step,
                state,
                a,
                b,
            )
            high = state[0]
        height[i] = high
        if np.isnan(found):
            continue
        if found - core < -0.5 or found + core > rows - 0.5:
            cut[i] = True
        elif high >= 0.5 * threshold and abs(found - begun) <= reach:
            row[i] = found


@numba.njit(cache=True, nogil=True, error_model="numpy")
def column_centres(fields, columns, start, settings, row, height, cut, clipped):
    """Fill what `match_field` does for a block [field, column]."""
    scratch = scratch_for(settings)
    for k in range(fields.shape[0]):
        match_field(
            fields[k],
            columns,
            start[k],
            settings,
            scratch,
            row[k],
            height[k],
            cut[k],
            clipped[k],
        )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def measure_fields(
    fields, columns, search, settings, first_line, sums, figures, counts, fingerprint
):
    """Find the line in each field, measure its columns and sum them up, while it is in the cache.

    Fills what `glint_aoa.optical._summary_kernel.summed_part` does; `search` are that of
    `coarse_line`, `sums` that of `summarise_field`.
    """
    n, scratch = columns.size, scratch_for(settings)
    coarse, summing = search_scratch_for(fields, search), summary_scratch_for(sums)
    line, start, row, height = np.empty(3), np.empty(n), np.empty(n), np.empty(n)
    cut, clipped = np.empty(n, np.bool_), np.empty(n, np.bool_)
    for k in range(fields.shape[0]):
        coarse_rows(fields[k], search, columns, coarse, line, start)
        match_field(fields[k], columns, start, settings, scratch, row, height, cut, clipped)
        fingerprint[k] = summarise_field(
            row, height, cut, clipped, first_line[k], sums, summing, figures[k], counts[k]
        )
