"""Compiled kernel of the column centroids. Plain arrays in and out, no state."""

# mypy: disable-error-code="no-untyped-def"

import numba
import numpy as np

from glint_aoa.optical._strip_kernel import cut_strip, strip_base

USED, DIM, CUT = 0, 1, 2  # what `status` says of a column: measured, too dim, out of the window

_ITERATIONS = 12
_FEW = 16  # a share of columns below 1 / 16 settles column by column
_APART = 1.065  # half windows from the centre begin the flanks, off the glint's tail
_SETTLED = 0.03  # lines; Newton's step leaves less than a tenth of its own square

# The loops run along lines in single precision and without branches, for the compiler to do several
# columns at a time. Grey levels, and places a few lines about a strip's middle, lose nothing there.


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _reach(centre, n):
    """Least and greatest centre."""
    least, most = np.float32(np.inf), np.float32(-np.inf)
    for i in range(n):
        least = centre[i] if centre[i] < least else least
        most = centre[i] if centre[i] > most else most
    return least, most


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _inner_rows(strip, reach, half):
    """First row in any window, and one past the last."""
    first = max(int(np.ceil(reach[0] - half)), 0)
    return first, min(int(np.floor(reach[1] + half)) + 1, strip.shape[0])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _background(strip, n, centre, reach, half, flank, low, high, low_weight, high_weight):
    """Fill the mean grey levels of the flanks above and below the window, and their weights."""
    least, most = reach
    edge, end = np.float32(_APART * half - 0.5), np.float32(_APART * half + flank + 0.5)
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(n):
        low[i] = low_weight[i] = high[i] = high_weight[i] = zero
    for r in range(strip.shape[0]):
        if most - edge <= r <= least + edge:
            continue  # inside every window
        if r < most:
            total, weight = low, low_weight
        else:
            total, weight = high, high_weight
        for i in range(n):
            value = strip[r, i]
            distance = abs(np.float32(r) - centre[i])
            share = min(max(min(distance - edge, end - distance), zero), one)
            there = value == value  # noqa: PLR0124  NaN is not
            weight[i] += share if there else zero
            total[i] += share * value if there else zero


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _level_and_tilt(low, high, low_weight, high_weight, half, flank, n):
    """Turn the flanks' sums into level and tilt of the background, in `low` and `high`."""
    span = np.float32(2 * _APART * half + flank)
    for i in range(n):
        above = low[i] / low_weight[i] if low_weight[i] > 0.5 else np.float32(np.nan)
        below = high[i] / high_weight[i] if high_weight[i] > 0.5 else above
        above = above if above == above else below  # noqa: PLR0124  NaN is not
        low[i] = np.float32(0.5) * (above + below)
        high[i] = (below - above) / span


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _moments(strip, n, centre, reach, half, level, tilt, volume, moment, slope):
    """Fill weighted sum, first moment, and minus that moment's slope in `centre`.

    The weight is (1 - (t / half)^2)^2, t lines from the centre.
    """
    inverse = np.float32(1 / half**2)
    zero, one, four = np.float32(0.0), np.float32(1.0), np.float32(4.0)
    for i in range(n):
        volume[i] = moment[i] = slope[i] = zero
    first, last = _inner_rows(strip, reach, half)
    for r in range(first, last):
        for i in range(n):
            t = np.float32(r) - centre[i]
            x = t * t * inverse
            rest = max(one - x, zero)
            net = strip[r, i] - level[i] - tilt[i] * t
            weighted = rest * rest * net
            # A missing row in the window leaves NaN, but its edge, with no weight, must not.
            weighted = weighted if rest > zero else zero
            part = rest * (rest - four * x) * net
            volume[i] += weighted
            moment[i] += weighted * t
            slope[i] += part if rest > zero else zero


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _newton(
    strip, n, half, flank, centre, step, volume, low, high, low_weight, high_weight, moment, slope
):
    """Move every centre by one step of Newton's method."""
    reach = _reach(centre, n)
    _background(strip, n, centre, reach, half, flank, low, high, low_weight, high_weight)
    _level_and_tilt(low, high, low_weight, high_weight, half, flank, n)
    _moments(strip, n, centre, reach, half, low, high, volume, moment, slope)
    tenth, most = np.float32(0.1), np.float32(0.5 * half)
    for i in range(n):
        # Newton's step where the moment falls with the centre as it does near its zero.
        divisor = slope[i] if slope[i] > tenth * volume[i] else volume[i]
        step[i] = min(max(moment[i] / divisor, -most), most) if volume[i] > 0 else np.nan
        centre[i] += step[i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _finish(strip, i, half, flank, centre, step, one):
    """Settle a column that needs more steps, on its own in `one` [11, 1] and a strip of it.

    Returns the centre and the volume.
    """
    rows = strip.shape[0]
    alone = np.empty((rows, 1), np.float32)
    for r in range(rows):
        alone[r, 0] = strip[r, i]
    one[0, 0] = centre
    one[1, 0] = step
    for _ in range(_ITERATIONS):
        if not abs(one[1, 0]) > _SETTLED or not 0 <= one[0, 0] <= rows - 1:
            break
        _newton(
            alone,
            1,
            half,
            flank,
            one[0],
            one[1],
            one[2],
            one[3],
            one[4],
            one[5],
            one[6],
            one[7],
            one[8],
        )
    return one[0, 0], one[2, 0]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _tops(strip, n, centre, half, top):
    """Fill the largest grey level in each column's window."""
    first, last = _inner_rows(strip, _reach(centre, n), half)
    half = np.float32(half)
    for i in range(n):
        top[i] = 0.0
    for r in range(first, last):
        for i in range(n):
            inside = abs(np.float32(r) - centre[i]) < half
            value = abs(strip[r, i]) if inside else np.float32(0.0)
            was = top[i]
            top[i] = value if value > was else was


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _unsettled(step):
    count = 0
    for i in range(step.size):
        count += abs(step[i]) > _SETTLED
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def column_centres(
    fields,
    columns,
    start,
    half,
    flank,
    reach,
    width,
    sign,
    threshold,
    saturation,
    centre,
    height,
    status,
    clipped,
):
    """Fill `centre`, `height`, `status` and `clipped` [field, column].

    `centre` is in rows of the recorded window, NaN where `status` is not USED. `height` is the
    light in the window over its background, divided by the glint's width. `reach` is how far a
    centre may lie from its start [lines].
    """
    n = columns.size
    side = int(np.ceil(half + flank + reach + 1))
    strip = np.empty((2 * side + 1, n), np.float32)
    base = np.empty(n, np.int64)
    c, step, volume = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    low, high = np.empty(n, np.float32), np.empty(n, np.float32)
    low_weight, high_weight = np.empty(n, np.float32), np.empty(n, np.float32)
    moment, slope = np.empty(n, np.float32), np.empty(n, np.float32)
    one = np.empty((9, 1), np.float32)
    rows = fields.shape[1]
    for k in range(fields.shape[0]):
        strip_base(start[k], side, base)
        cut_strip(fields[k], columns, base, np.float32(sign), strip)
        for i in range(n):
            c[i] = np.float32(start[k, i] - base[i])
        for _ in range(_ITERATIONS):
            _newton(
                strip,
                n,
                half,
                flank,
                c,
                step,
                volume,
                low,
                high,
                low_weight,
                high_weight,
                moment,
                slope,
            )
            if _unsettled(step) * _FEW < n:
                break
        _tops(strip, n, c, half, low)
        for i in range(n):
            found, size = np.float64(c[i]), np.float64(volume[i])
            if abs(step[i]) > _SETTLED:
                found, size = _finish(strip, i, half, flank, c[i], step[i], one)
            row = base[i] + found
            height[k, i] = size / width
            status[k, i] = _status(row, start[k, i], half, rows, reach)
            if status[k, i] == USED and not height[k, i] >= 0.5 * threshold:
                status[k, i] = DIM
            used = status[k, i] == USED
            centre[k, i] = row if used else np.nan
            clipped[k, i] = used and low[i] >= saturation


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _status(row, begun, half, rows, reach):
    """Judge a column by where its centre is and where it was expected."""
    if np.isnan(begun):
        return DIM
    middle = begun if np.isnan(row) else row
    if middle - half < -0.5 or middle + half > rows - 0.5:
        return CUT
    return USED if abs(row - begun) <= reach + half else DIM
