"""Compiled kernel of the column centroids. Plain arrays in and out, no state."""

# mypy: disable-error-code="no-untyped-def"

import numba
import numpy as np

from glint_aoa.optical._locate_kernel import coarse_rows
from glint_aoa.optical._locate_kernel import scratch_for as search_scratch_for
from glint_aoa.optical._strip_kernel import are_apart, cut_strip, strip_base, strip_width
from glint_aoa.optical._summary_kernel import scratch_for as summary_scratch_for
from glint_aoa.optical._summary_kernel import summarise_field

_ITERATIONS = 12
_FEW = 16  # a share of columns below 1 / 16 settles column by column
_APART = 1.065  # half windows from the centre begin the flanks, off the glint's tail
_SETTLED = np.float32(0.03)  # lines; Newton's step leaves less than a tenth of its own square
_NAN = np.float32(np.nan)

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
def _background(strip, whole, n, centre, reach, half, flank, low, high, low_weight, high_weight):
    """Fill the sums of grey levels in the flanks above and below the window, and their weights."""
    least, most = reach
    edge, end = np.float32(_APART * half - 0.5), np.float32(_APART * half + flank + 0.5)
    one, zero = np.float32(1.0), np.float32(0.0)
    # The weights of rows that are all there add up to the flank's width.
    known = np.float32(flank) if whole else zero
    for i in range(n):
        low[i] = high[i] = zero
        low_weight[i] = high_weight[i] = known
    first, last = max(int(np.ceil(least - end)), 0), int(np.floor(most + end)) + 1
    for r in range(first, min(last, strip.shape[0])):
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
            if whole:
                total[i] += share * value
            else:
                there = value == value  # noqa: PLR0124  NaN is not
                weight[i] += share if there else zero
                total[i] += share * value if there else zero


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _level_and_tilt(low, high, low_weight, high_weight, half, flank, n):
    """Turn the flanks' sums into level and tilt of the background, in `low` and `high`."""
    span = np.float32(2 * _APART * half + flank)
    half_line = np.float32(0.5)
    for i in range(n):
        above = low[i] / low_weight[i] if low_weight[i] > half_line else _NAN
        below = high[i] / high_weight[i] if high_weight[i] > half_line else above
        above = above if above == above else below  # noqa: PLR0124  NaN is not
        low[i] = half_line * (above + below)
        high[i] = (below - above) / span


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _moments(strip, whole, n, centre, reach, half, level, tilt, volume, moment, slope):
    """Fill weighted sum, first moment, and minus that moment's slope in `centre`.

    The weight is w^2 with w = 1 - (t / half)^2, t lines from the centre; the slope of w^2 t is
    5 w^2 - 4 w.
    """
    inverse = np.float32(1 / half**2)
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(n):
        volume[i] = moment[i] = slope[i] = zero
    first, last = _inner_rows(strip, reach, half)
    for r in range(first, last):
        for i in range(n):
            t = np.float32(r) - centre[i]
            weight = max(one - t * t * inverse, zero)
            net = weight * (strip[r, i] - level[i] - tilt[i] * t)
            # A missing row in the window leaves NaN, but its edge, with no weight, must not.
            net = net if whole or weight > zero else zero
            slope[i] += net
            volume[i] += weight * net
            moment[i] += weight * net * t
    for i in range(n):
        slope[i] = np.float32(5.0) * volume[i] - np.float32(4.0) * slope[i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _newton(
    strip,
    whole,
    n,
    half,
    flank,
    centre,
    step,
    volume,
    low,
    high,
    low_weight,
    high_weight,
    moment,
    slope,
):
    """Move every centre by one step of Newton's method."""
    reach = _reach(centre, n)
    _background(strip, whole, n, centre, reach, half, flank, low, high, low_weight, high_weight)
    _level_and_tilt(low, high, low_weight, high_weight, half, flank, n)
    _moments(strip, whole, n, centre, reach, half, low, high, volume, moment, slope)
    tenth, most, zero = np.float32(0.1), np.float32(0.5 * half), np.float32(0.0)
    for i in range(n):
        # Newton's step where the moment falls with the centre as it does near its zero.
        divisor = slope[i] if slope[i] > tenth * volume[i] else volume[i]
        step[i] = min(max(moment[i] / divisor, -most), most) if volume[i] > zero else _NAN
        centre[i] += step[i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _finish(strip, i, half, flank, centre, step):
    """Settle a column that needs more steps, on its own; returns the centre and the volume."""
    rows = strip.shape[0]
    alone, one = np.empty((rows, 1), np.float32), np.empty((9, 1), np.float32)
    for r in range(rows):
        alone[r, 0] = strip[r, i]
    one[0, 0] = centre
    one[1, 0] = step
    for _ in range(_ITERATIONS):
        if not abs(one[1, 0]) > _SETTLED or not 0 <= one[0, 0] <= rows - 1:
            break
        _newton(
            alone,
            False,
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
def _brightest(field, columns, base, grey, whole):
    """Return the largest grey level in the strip, or in all columns of its rows."""
    if not (whole and are_apart(columns)):  # where `grey` is not filled
        first, last = max(base.min(), 0), base.max() + grey.shape[0]
        return _largest(field[first:last].reshape(-1))
    return _largest(grey.reshape(-1))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _largest(grey):
    top = grey.dtype.type(0)
    for i in range(grey.size):
        top = max(top, grey[i])
    return top


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _unsettled(step, n):
    count = 0
    for i in range(n):
        count += abs(step[i]) > _SETTLED
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _judge(centre, volume, base, start, half, rows, farthest, least, row, cut, used):
    """Fill `row`, NaN where a column does not count, `cut`, and 1 in `used` where it does.

    `centre` and `start` are rows of the strip, whose first is `base`; `least` is the least volume.
    """
    above, below = np.float32(half - 0.5), np.float32(rows - 0.5 - half)
    farthest, least = np.float32(farthest), np.float32(least)
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(row.size):
        # Where the strip has no centre, the start tells whether the line leaves the window.
        middle = centre[i] if centre[i] == centre[i] else start[i]
        first = np.float32(base[i])
        used[i] = zero if middle < above - first or middle > below - first else one
    for i in range(row.size):
        cut[i] = used[i] == zero
    for i in range(row.size):
        near = abs(centre[i] - start[i]) <= farthest and volume[i] >= least
        used[i] = used[i] if near else zero
    for i in range(row.size):
        row[i] = base[i] + np.float64(centre[i]) if used[i] > zero else np.nan


@numba.njit(cache=True, nogil=True, error_model="numpy")
def scratch_for(fields, columns, settings):
    """Memory for `centres_of_field`."""
    half, flank, reach = settings[:3]
    side = int(np.ceil(half + flank + reach + 1))
    n, width = strip_width(columns)
    floats = np.float32
    return (
        np.zeros((2 * side + 1, width), fields.dtype),
        np.zeros((2 * side + 1, width), floats),
        np.empty(n, np.int32),
        np.full(n, floats(side)),
        np.empty(n, floats),
        np.empty(n, floats),
        np.empty(n, floats),
        np.empty(n, floats),
        np.empty(n, floats),
        np.empty(n, floats),
        np.empty(n, floats),
        np.empty(n, floats),
        np.empty(n, floats),
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def centres_of_field(field, columns, start, settings, scratch, row, height, cut, clipped):
    """Fill `row`, `height`, `cut` and `clipped` [column].

    `row` is in rows of the recorded window, NaN where the column is dim or `cut`: its window leaves
    the field's. `height` is the light in the window over its background, divided by the glint's
    width. `settings` are half the window, the flank and how far a centre may lie from its start
    [lines], the glint's width [lines], its sign, the least height, and the level that clips;
    `scratch` is from `scratch_for`.
    """
    half, flank, reach, width, sign, threshold, saturation = settings
    grey, strip, base, begun, c, step, volume = scratch[:7]
    low, high, low_weight, high_weight, moment, slope = scratch[7:]
    n, side = c.size, strip.shape[0] // 2
    strip_base(start, side, base)
    whole = cut_strip(field, columns, base, np.float32(sign), strip, grey)
    for i in range(start.size):
        begun[i] = np.float32(start[i] - base[i])
    for i in range(n):
        c[i] = begun[i]
    unsettled = 0
    for _ in range(_ITERATIONS):
        _newton(
            strip,
            whole,
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
        unsettled = _unsettled(step, start.size)
        if unsettled * _FEW < start.size:
            break
    if unsettled > 0:
        for i in range(start.size):
            if abs(step[i]) > _SETTLED:
                c[i], volume[i] = _finish(strip, i, half, flank, c[i], step[i])
    for i in range(start.size):
        height[i] = np.float64(volume[i]) / width
    farthest, least = reach + half, 0.5 * threshold * width
    _judge(c, volume, base, begun, half, field.shape[0], farthest, least, row, cut, step)
    clipped[:] = False
    if _brightest(field, columns, base[: start.size], grey, whole) >= saturation:
        _tops(strip, n, c, half, low)
        for i in range(start.size):
            clipped[i] = step[i] > 0 and low[i] >= saturation


@numba.njit(cache=True, nogil=True, error_model="numpy")
def column_centres(fields, columns, start, settings, row, height, cut, clipped):
    """Fill what `centres_of_field` does for a block [field, column]."""
    scratch = scratch_for(fields, columns, settings)
    for k in range(fields.shape[0]):
        centres_of_field(
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
    n = columns.size
    coarse, scratch, summing = (
        search_scratch_for(fields, search),
        scratch_for(fields, columns, settings),
        summary_scratch_for(sums),
    )
    line, start, row, height = np.empty(3), np.empty(n), np.empty(n), np.empty(n)
    cut, clipped = np.empty(n, np.bool_), np.empty(n, np.bool_)
    for k in range(fields.shape[0]):
        coarse_rows(fields[k], search, columns, coarse, line, start)
        centres_of_field(fields[k], columns, start, settings, scratch, row, height, cut, clipped)
        fingerprint[k] = summarise_field(
            row, height, cut, clipped, first_line[k], sums, summing, figures[k], counts[k]
        )
