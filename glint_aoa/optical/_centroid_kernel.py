"""Compiled kernel of the column centroids. Plain arrays in and out, no state.

Each pixel of a column is read once, into a running sum of grey levels; boxes, flanks and single
pixels after that are differences of two of its entries.
"""

# mypy: disable-error-code="no-untyped-def"

import numba
import numpy as np

USED, DIM, CUT = 0, 1, 2  # what `status` says of a column: measured, too dim, out of the window

_ITERATIONS = 12
_SETTLED = 1e-3  # lines; Newton leaves its square, and a fiftieth of it for the background
_AGREE = 2.0  # lines between a column's peak and the coarse line, besides half the box
_ENOUGH = 0.8  # of the bright columns on the first coarse line end the search
_MAX_COARSE = 48  # columns that vote for the coarse line


# The next two run along lines, in small whole numbers and without branches, for the compiler to do
# several columns at a time.
@numba.njit(cache=True, nogil=True, error_model="numpy")
def _run_sums(field, columns, sign, line, grey):
    """Fill the running sums of grey levels down the columns [row, column]."""
    for i in range(columns.size):
        grey[0, i] = 0
    for row in range(field.shape[0]):
        whole = field[row]
        for i in range(columns.size):
            line[i] = whole[columns[i]]
        for i in range(line.size):
            grey[row + 1, i] = grey[row, i] + sign * line[i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _peaks(grey, first, last, half_box, box, peak):
    """Fill the sum and the row of the brightest box of lines in each column."""
    box[:] = grey[first + 2 * half_box + 1] - grey[first]
    peak[:] = first + half_box
    for row in range(first + half_box + 1, last - half_box):
        for i in range(box.size):
            here, best, best_row = (
                grey[row + half_box + 1, i] - grey[row - half_box, i],
                box[i],
                peak[i],
            )
            box[i] = max(here, best)
            peak[i] = np.int32(row) if here > best else best_row


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _votes(columns, peak, voters, slope, intercept, tolerance):
    count = 0
    for j in range(voters.size):
        i = voters[j]
        count += abs(peak[i] - intercept - slope * columns[i]) <= tolerance
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _coarse_line(columns, peak, contrast, threshold, tolerance):
    """Line through most of the bright columns' peaks; the count of votes is 0 if there is none."""
    bright = np.flatnonzero(contrast >= threshold)
    if bright.size < 3:
        return 0.0, 0.0, 0
    voters = bright[:: (bright.size + _MAX_COARSE - 1) // _MAX_COARSE]
    n = voters.size
    best_slope, best_intercept, best_count = 0.0, 0.0, 0
    # Pairs from far apart to close: the first ones fix a clean line at once.
    for gap in range(n // 2, 0, -1):
        for a in range(n - gap):
            i, j = voters[a], voters[a + gap]
            slope = (peak[j] - peak[i]) / (columns[j] - columns[i])
            intercept = peak[i] - slope * columns[i]
            count = _votes(columns, peak, voters, slope, intercept, tolerance)
            if count > best_count:
                best_slope, best_intercept, best_count = slope, intercept, count
            if best_count >= _ENOUGH * n:
                return best_slope, best_intercept, best_count
    return best_slope, best_intercept, best_count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _up_to(grey, i, line):
    """Integral of the grey level from the window's top to `line`."""
    row = min(max(int(np.floor(line + 0.5)), 0), grey.shape[0] - 2)
    return grey[row, i] + (line - row + 0.5) * (grey[row + 1, i] - grey[row, i])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _flank(grey, i, low, high):
    """Mean grey level between two lines, as far as the window goes; NaN outside it."""
    low, high = max(low, -0.5), min(high, grey.shape[0] - 1.5)
    if high - low < 0.5:
        return np.nan
    return (_up_to(grey, i, high) - _up_to(grey, i, low)) / (high - low)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _moments(grey, i, centre, half_width, level, tilt, cos_step, sin_step):
    """Weighted sum over the window, its first moment, and minus that moment's slope in `centre`.

    The weight is cos^2(pi t / (2 half_width)), t lines from the centre.
    """
    first, last = int(np.ceil(centre - half_width)), int(np.floor(centre + half_width))
    rate = np.pi / half_width
    cos, sin = np.cos(rate * (first - centre)), np.sin(rate * (first - centre))
    volume, moment, slope = 0.0, 0.0, 0.0
    for row in range(first, last + 1):
        t = row - centre
        net = grey[row + 1, i] - grey[row, i] - level - tilt * t
        weight = 0.5 + 0.5 * cos
        volume += weight * net
        moment += weight * net * t
        slope += (weight - 0.5 * rate * t * sin) * net
        cos, sin = cos * cos_step - sin * sin_step, sin * cos_step + cos * sin_step
    return volume, moment, slope


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _centroid(grey, i, start, half_width, flank, cos_step, sin_step):
    """Background-subtracted centroid in a soft window that settles on its own centre.

    Returns the centre, the weighted sum over the window and the status.
    """
    centre = start
    volume = 0.0
    for _ in range(_ITERATIONS):
        low, high = centre - half_width, centre + half_width
        if low < -0.5 or high > grey.shape[0] - 1.5:
            return centre, volume, CUT
        above = _flank(grey, i, low - flank, low)
        below = _flank(grey, i, high, high + flank)
        if np.isnan(above):
            above = below
        if np.isnan(below):
            below = above
        tilt = (below - above) / (2 * half_width + flank)
        volume, moment, slope = _moments(
            grey, i, centre, half_width, (below + above) / 2, tilt, cos_step, sin_step
        )
        if not volume > 0:
            return centre, volume, DIM
        # Newton's step where the moment falls with the centre as it does near its zero.
        step = moment / slope if slope > 0.1 * volume else moment / volume
        step = min(max(step, -0.5 * half_width), 0.5 * half_width)
        centre += step
        if abs(step) < _SETTLED:
            break
    return centre, volume, USED


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _clips(grey, i, centre, half_width, saturation):
    low, high = int(np.ceil(centre - half_width)), int(np.floor(centre + half_width))
    for row in range(max(low, 0), min(high + 1, grey.shape[0] - 1)):
        if grey[row + 1, i] - grey[row, i] >= saturation:
            return True
    return False


@numba.njit(cache=True, nogil=True, error_model="numpy")
def column_centres(
    fields,
    columns,
    first,
    last,
    half_box,
    half_width,
    flank,
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
    mean grey level of the window over its background.
    """
    n = columns.size
    grey = np.empty((fields.shape[1] + 1, n), np.int32)
    line, box, peak = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    contrast = np.empty(n)
    width, rest = 2 * half_box + 1, max(last - first - 2 * half_box - 1, 1)
    tolerance = half_box + _AGREE
    cos_step, sin_step = np.cos(np.pi / half_width), np.sin(np.pi / half_width)
    for k in range(fields.shape[0]):
        _run_sums(fields[k], columns, np.int32(sign), line, grey)
        _peaks(grey, first, last, half_box, box, peak)
        for i in range(n):
            contrast[i] = box[i] / width - (grey[last, i] - grey[first, i] - box[i]) / rest
        slope, intercept, votes = _coarse_line(columns, peak, contrast, threshold, tolerance)
        for i in range(n):
            centre[k, i] = np.nan
            height[k, i] = contrast[i]
            clipped[k, i] = False
            status[k, i] = DIM
            if votes < 3:
                continue
            on_line = intercept + slope * columns[i]
            if on_line < first - 0.5 or on_line > last - 0.5:
                status[k, i] = CUT
                continue
            near = abs(peak[i] - on_line) <= tolerance
            start = peak[i] if near else on_line
            found, volume, state = _centroid(grey, i, start, half_width, flank, cos_step, sin_step)
            height[k, i] = volume / half_width
            off = abs(found - on_line) > tolerance + half_width
            if state == USED and (height[k, i] < threshold / 2 or off):
                state = DIM
            status[k, i] = state
            if state == USED:
                centre[k, i] = found
                clipped[k, i] = _clips(grey, i, found, half_width, saturation)
