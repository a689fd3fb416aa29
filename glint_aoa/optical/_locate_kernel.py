"""Compiled kernel that finds the coarse line of each field. Plain arrays in and out, no state.

Fields come as words of eight bytes: the sum of a word's pixels, a patch of the line, has less
noise than a pixel and takes one step of the processor.
"""

# mypy: disable-error-code="no-untyped-def"

import numba
import numpy as np

_AGREE = 2.0  # lines between a patch's peak and the coarse line, besides half the box
_ENOUGH = 0.8  # of the bright patches on the first coarse line end the search
_MAX_VOTERS = 48  # patches that vote for the coarse line
_STRAIGHT = 0.3  # lines rms about a straight line from which a parabola is fitted
_SURE_VOTES, _SURE_CONTRAST = 0.6, 0.5  # of the sample's: below, all rows are searched


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sum_bytes(words, first, last, sign, level):
    """Fill `level` [row, word] with the sums of eight 8-bit pixels."""
    even, lowest = np.uint64(0x00FF00FF00FF00FF), np.uint64(0xFFFF)
    for row in range(first, last):
        for p in range(words.shape[1]):
            word = words[row, p]
            word = (word & even) + ((word >> np.uint64(8)) & even)
            word = word + (word >> np.uint64(32))
            level[row, p] = sign * np.int32((word + (word >> np.uint64(16))) & lowest)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sum_pairs(words, first, last, sign, level):
    """Fill `level` [row, word] with the sums of four 16-bit pixels."""
    even, lowest = np.uint64(0x0000FFFF0000FFFF), np.uint64(0xFFFFFFFF)
    for row in range(first, last):
        for p in range(words.shape[1]):
            word = words[row, p]
            word = (word & even) + ((word >> np.uint64(16)) & even)
            level[row, p] = sign * np.int32((word + (word >> np.uint64(32))) & lowest)


# The next two run along lines, in whole numbers of 32 bits and without branches, for the compiler
# to do several patches at a time.
@numba.njit(cache=True, nogil=True, error_model="numpy")
def _boxes(level, first, last, half_box, box):
    """Fill the sums of boxes of lines; `box` [row, patch] holds the one whose middle is `row`."""
    width = 2 * half_box + 1
    top = first + half_box
    for p in range(box.shape[1]):
        box[top, p] = 0
    for row in range(first, first + width):
        for p in range(box.shape[1]):
            box[top, p] = np.int32(box[top, p] + level[row, p])
    for row in range(top + 1, last - half_box):
        for p in range(box.shape[1]):
            box[row, p] = np.int32(
                np.int32(box[row - 1, p] + level[row + half_box, p]) - level[row - half_box - 1, p]
            )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _peaks(box, first, last, surround, best, peak):
    """Fill twice the height, and the row, of the box that stands out most in each patch.

    The height is over the mean of the boxes `surround` rows above and below, so that light which
    grows from line to line does not count. `first` and `last` bound the rows that have boxes.
    """
    for p in range(best.size):
        best[p] = np.iinfo(np.int32).min
        peak[p] = np.int32(first)
    for row in range(first, last):
        above, below = max(row - surround, first), min(row + surround, last - 1)
        for p in range(best.size):
            around = np.int32(box[above, p] + box[below, p])
            here = np.int32(np.int32(box[row, p] + box[row, p]) - around)
            was, was_at = best[p], peak[p]
            best[p] = max(here, was)
            peak[p] = np.int32(row) if here > was else was_at


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _votes(peak, voters, slope, intercept, tolerance):
    count = 0
    for j in range(voters.size):
        p = voters[j]
        count += abs(peak[p] - intercept - slope * p) <= tolerance
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _consensus(peak, contrast, threshold, tolerance):
    """Line through most of the bright patches' peaks; the share of votes is 0 if there is none."""
    bright = np.flatnonzero(contrast >= threshold)
    if bright.size < 3:
        return 0.0, 0.0, 0.0
    voters = bright[:: (bright.size + _MAX_VOTERS - 1) // _MAX_VOTERS]
    n = voters.size
    best_slope, best_intercept, best_count = 0.0, 0.0, 0
    # Pairs from far apart to close: the first ones fix a clean line at once.
    for gap in range(n // 2, 0, -1):
        for a in range(n - gap):
            p, q = voters[a], voters[a + gap]
            slope = (peak[q] - peak[p]) / (q - p)
            intercept = peak[p] - slope * p
            count = _votes(peak, voters, slope, intercept, tolerance)
            if count > best_count:
                best_slope, best_intercept, best_count = slope, intercept, count
            if best_count >= _ENOUGH * n:
                return best_slope, best_intercept, best_count / n
    if best_count < 3:
        return 0.0, 0.0, 0.0
    return best_slope, best_intercept, best_count / n


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _refine(box, first, last, peak, contrast, threshold, slope, intercept, tolerance, fine):
    """Fill the patches' peaks to a part of a line, NaN off the coarse line.

    `first` and `last` bound the rows that have boxes. Returns the mean contrast on the line.
    """
    total, count = 0.0, 0
    for p in range(peak.size):
        row = peak[p]
        if contrast[p] < threshold or abs(row - intercept - slope * p) > tolerance:
            fine[p] = np.nan
            continue
        total += contrast[p]
        count += 1
        shift = 0.0
        if first < row < last - 1:
            above, below = box[row - 1, p], box[row + 1, p]
            bend = above - 2 * box[row, p] + below
            shift = 0.5 * (above - below) / bend if bend < 0 else 0.0
        fine[p] = row + shift
    return total / max(count, 1)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _straight(fine, line):
    """Least-squares line through the patches; fills `line` and returns the rms about it."""
    n, sp, sy = 0, 0.0, 0.0
    for p in range(fine.size):
        if not np.isnan(fine[p]):
            n += 1
            sp += p
            sy += fine[p]
    mean_p, mean_y = sp / n, sy / n
    spp, spy = 0.0, 0.0
    for p in range(fine.size):
        if not np.isnan(fine[p]):
            spp += (p - mean_p) ** 2
            spy += (p - mean_p) * (fine[p] - mean_y)
    line[2] = 0.0
    line[1] = spy / spp
    line[0] = mean_y - line[1] * mean_p
    square = 0.0
    for p in range(fine.size):
        if not np.isnan(fine[p]):
            square += (fine[p] - line[0] - line[1] * p) ** 2
    return np.sqrt(square / n)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _parabola(fine, line):
    """Least-squares parabola through the patches, for a bent line."""
    there = np.flatnonzero(~np.isnan(fine))
    middle, reach = 0.5 * (there[0] + there[-1]), max(0.5 * (there[-1] - there[0]), 1.0)
    x = (there - middle) / reach
    design = np.empty((there.size, 3))
    design[:, 0], design[:, 1], design[:, 2] = 1.0, x, x * x
    a, b, c = np.linalg.solve(design.T @ design, design.T @ fine[there])
    line[2] = c / reach**2
    line[1] = b / reach - 2 * line[2] * middle
    line[0] = a - b * middle / reach + line[2] * middle**2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _search(
    level, first, last, half_box, surround, threshold, pixels, box, best, peak, contrast, fine, line
):
    """Coarse line from rows whose patches are summed; returns share of votes and contrast."""
    half_box = min(half_box, (last - first - 1) // 2)
    top, bottom = first + half_box, last - half_box
    _boxes(level, first, last, half_box, box)
    _peaks(box, top, bottom, surround, best, peak)
    scale = 0.5 / (pixels * (2 * half_box + 1))
    for p in range(best.size):
        contrast[p] = scale * best[p]
    tolerance = half_box + _AGREE
    slope, intercept, share = _consensus(peak, contrast, threshold, tolerance)
    if share == 0.0:
        return share, 0.0
    mean = _refine(box, top, bottom, peak, contrast, threshold, slope, intercept, tolerance, fine)
    if _straight(fine, line) > _STRAIGHT and np.sum(~np.isnan(fine)) > 8:
        _parabola(fine, line)
    return share, mean


@numba.njit(cache=True, nogil=True, error_model="numpy")
def coarse_lines(
    words,
    wide,
    first,
    last,
    band_first,
    band_last,
    half_box,
    surround,
    sign,
    threshold,
    usual_contrast,
    line,
    share,
    contrast,
):
    """Fill the coarse line of each field: `line` [field, 3] in powers of the word's number.

    `share` [field] is the share of bright patches that lie on it, 0 where there is no line, and
    `contrast` [field] their mean height over what surrounds them [grey levels]. The rows of the
    band are searched first; unless they show a line like the sample's, all are.
    """
    n = words.shape[2]
    pixels = 4 if wide else 8
    # One allocation each: parts of one array the compiler takes to overlap.
    level, box = np.empty(words.shape[1:], np.int32), np.empty(words.shape[1:], np.int32)
    best, peak = np.empty(n, np.int32), np.empty(n, np.int32)
    height, fine = np.empty(n), np.empty(n)
    sign = np.int32(sign)
    for k in range(words.shape[0]):
        line[k] = np.nan
        for low, high in ((band_first, band_last), (first, last)):
            if wide:
                _sum_pairs(words[k], low, high, sign, level)
            else:
                _sum_bytes(words[k], low, high, sign, level)
            share[k], contrast[k] = _search(
                level,
                low,
                high,
                half_box,
                surround,
                threshold,
                pixels,
                box,
                best,
                peak,
                height,
                fine,
                line[k],
            )
            sure = share[k] >= _SURE_VOTES and contrast[k] >= _SURE_CONTRAST * usual_contrast
            if sure or (low == first and high == last):
                break
