"""Compiled kernel that finds the coarse line of each field. Plain arrays in and out, no state.

Fields come as words of eight bytes: the sum of a word's pixels, a patch of the line, has less
noise than a pixel and takes one step of the processor.

Loops run along lines, in whole numbers and without branches, for the compiler to do several patches
at a time. Rows of boxes are padded to what it does in one step, since single patches that are left
over would take as long again; what stands in the padding means nothing.
"""

# mypy: disable-error-code="no-untyped-def"

import numba
import numpy as np

from glint_aoa.optical._line_kernel import plain_line, total

_PADDING = 32  # patches to which a row of boxes is padded

_AGREE = 2.0  # lines between a patch's peak and the coarse line, besides half the box
_ENOUGH = 0.8  # of the bright patches on the first coarse line end the search
_MAX_VOTERS = 48  # patches that vote for the coarse line
_STRAIGHT = 0.3  # lines rms about a straight line from which a parabola is fitted
_SURE_VOTES, _SURE_CONTRAST = 0.6, 0.5  # of the sample's: below, all rows are searched
_STEP = 4  # every so many patches show a clear line


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sum_bytes(words, flip, level):
    """Fill `level` with the sums of a word's eight pixels, each bit turned that `flip` has."""
    even, lowest = np.uint64(0x00FF00FF00FF00FF), np.uint64(0xFFFF)
    for i in range(words.size):
        word = words[i] ^ flip
        word = (word & even) + ((word >> np.uint64(8)) & even)
        word = word + (word >> np.uint64(32))
        level[i] = (word + (word >> np.uint64(16))) & lowest


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sum_pairs(words, flip, level):
    """Fill `level` with the sums of a word's four pixels of 16 bits, as `_sum_bytes`."""
    even, lowest = np.uint64(0x0000FFFF0000FFFF), np.uint64(0xFFFFFFFF)
    for i in range(words.size):
        word = words[i] ^ flip
        word = (word & even) + ((word >> np.uint64(16)) & even)
        level[i] = (word + (word >> np.uint64(32))) & lowest


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _every_few(words, few):
    """Fill `few` with every `_STEP` words of each row; returns those that were filled."""
    n = (words.shape[1] + _STEP - 1) // _STEP
    flat, some = words.reshape(-1), few[: words.shape[0] * n]
    # Counted without sign, for the compiler to see that no index counts from the end.
    step, pitch, count = np.uint64(_STEP), np.uint64(words.shape[1]), np.uint64(n)
    for row in range(np.uint64(words.shape[0])):
        for p in range(count):
            some[row * count + p] = flat[row * pitch + step * p]
    return some


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _boxes(level, pitch, n_rows, half_box, box):
    """Fill the sums of boxes of lines; `box` [row, patch] holds the one whose middle is `row`.

    `level` holds `n_rows` of `pitch` patches, and what pads the last of them.
    """
    top, width = half_box, box.shape[1]
    here = box[top]
    here[:] = 0
    for row in range(2 * half_box + 1):
        added = level[row * pitch : row * pitch + width]
        for p in range(width):
            here[p] += added[p]
    for row in range(top + 1, n_rows - half_box):
        before, here = box[row - 1], box[row]
        start = (row + half_box) * pitch
        added = level[start : start + width]
        start = (row - half_box - 1) * pitch
        taken = level[start : start + width]
        for p in range(width):
            here[p] = before[p] + added[p] - taken[p]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _peaks(box, first, last, surround, best, peak):
    """Fill twice the height, and the row, of the box that stands out most in each patch.

    The height is over the mean of the boxes `surround` rows above and below, so that light which
    grows from line to line does not count. `first` and `last` bound the rows that have boxes.
    """
    integer = best.dtype.type
    best[:] = -1  # the highest box stands out by 0 at least
    peak[:] = first
    for row in range(first, last):
        above, below = max(row - surround, first), min(row + surround, last - 1)
        for p in range(best.size):
            around = integer(box[above, p] + box[below, p])
            here = integer(integer(box[row, p] + box[row, p]) - around)
            was, was_at = best[p], peak[p]
            best[p] = max(here, was)
            peak[p] = integer(row) if here > was else was_at


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _votes(place, row, n, slope, intercept, tolerance):
    count = 0
    for j in range(n):
        count += abs(row[j] - intercept - slope * place[j]) <= tolerance
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _consensus(peak, contrast, threshold, tolerance, place, row):
    """Line through most of the bright patches' peaks; the share of votes is 0 if there is none.

    `place` and `row` take the voters' places.
    """
    n_bright = 0
    for p in range(contrast.size):
        n_bright += contrast[p] >= threshold
    if n_bright < 3:
        return 0.0, 0.0, 0.0
    step = (n_bright + _MAX_VOTERS - 1) // _MAX_VOTERS
    n, number = 0, 0
    for p in range(contrast.size):
        if contrast[p] >= threshold:
            if number % step == 0:
                place[n], row[n] = p, peak[p]
                n += 1
            number += 1
    best_slope, best_intercept, best_count = 0.0, 0.0, 0
    # Pairs from far apart to close: the first ones fix a clean line at once.
    for gap in range(n // 2, 0, -1):
        for a in range(n - gap):
            slope = (row[a + gap] - row[a]) / (place[a + gap] - place[a])
            intercept = row[a] - slope * place[a]
            count = _votes(place, row, n, slope, intercept, tolerance)
            if count > best_count:
                best_slope, best_intercept, best_count = slope, intercept, count
            if best_count >= _ENOUGH * n:
                return best_slope, best_intercept, best_count / n
    if best_count < 3:
        return 0.0, 0.0, 0.0
    return best_slope, best_intercept, best_count / n


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _refine(box, first, last, peak, above, here, below, fine):
    """Fill the patches' peaks to a part of a line, by a parabola through three boxes.

    `first` and `last` bound the rows that have boxes; `above`, `here` and `below` take them.
    """
    most = max(last - 2, first)
    for p in range(fine.size):
        row = np.uint64(min(max(np.int64(peak[p]), first + 1), most))
        above[p], below[p] = box[row - np.uint64(1), p], box[row + np.uint64(1), p]
        here[p] = box[row, p]
    for p in range(fine.size):
        bend = above[p] + below[p] - 2.0 * here[p]
        is_inner = first < peak[p] < last - 1 and bend < 0.0
        fine[p] = peak[p] + (0.5 * (above[p] - below[p]) / bend if is_inner else 0.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _on_line(peak, place, contrast, threshold, slope, intercept, tolerance, spare, votes):
    """Fill `votes` with 1 for bright patches on the coarse line; returns their mean contrast."""
    for p in range(votes.size):
        is_near = abs(peak[p] - intercept - slope * place[p]) <= tolerance
        votes[p] = 1.0 if is_near and contrast[p] >= threshold else 0.0
        spare[p] = votes[p] * contrast[p]
    return total(spare) / max(total(votes), 1.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _straight(place, fine, votes, spare, fitted, line):
    """Least-squares line through the patches; fills `line` and returns the rms about it."""
    plain_line(place, fine, votes, spare, fitted)
    line[0], line[1], line[2] = fitted[1], fitted[0], 0.0
    for p in range(fine.size):
        off = fine[p] - fitted[1] - fitted[0] * place[p]
        spare[p] = votes[p] * off * off
    return np.sqrt(total(spare) / total(votes))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _parabola(fine, votes, line):
    """Least-squares parabola through the patches, for a bent line."""
    there = np.flatnonzero(votes)
    middle, reach = 0.5 * (there[0] + there[-1]), max(0.5 * (there[-1] - there[0]), 1.0)
    x = (there - middle) / reach
    design = np.empty((there.size, 3))
    design[:, 0], design[:, 1], design[:, 2] = 1.0, x, x * x
    a, b, c = np.linalg.solve(design.T @ design, design.T @ fine[there])
    line[2] = c / reach**2
    line[1] = b / reach - 2 * line[2] * middle
    line[0] = a - b * middle / reach + line[2] * middle**2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _search(words, n, bits, settings, scratch, line):
    """Coarse line in some rows of `n` words.

    Returns the share of votes, the contrast, and whether at least half of the patches voted for a
    line that is straight.
    """
    _, _, _, half_box, surround, sign, threshold, _, _, _ = settings
    level, box, best, peak, height, place, fine, votes, above, here, below, fitted = scratch
    n_rows, flip = words.size // n, np.uint64(0) if sign > 0 else ~np.uint64(0)
    if bits == 8:
        _sum_bytes(words, flip, level)
    else:
        _sum_pairs(words, flip, level)
    half_box = min(half_box, (n_rows - 1) // 2)
    top, bottom = half_box, n_rows - half_box
    _boxes(level, n, n_rows, half_box, box)
    _peaks(box, top, bottom, surround, best, peak)
    scale = 0.5 * bits / (64 * (2 * half_box + 1))
    for p in range(height.size):
        height[p] = scale * best[p]
    tolerance = half_box + _AGREE
    slope, intercept, share = _consensus(peak, height, threshold, tolerance, above, below)
    if share == 0.0:
        return share, 0.0, False
    _refine(box, top, bottom, peak, above, here, below, fine)
    mean = _on_line(peak, place, height, threshold, slope, intercept, tolerance, above, votes)
    n_votes = total(votes)
    is_straight = _straight(place, fine, votes, above, fitted, line) <= _STRAIGHT
    if not is_straight and n_votes > 8.0:
        _parabola(fine, votes, line)
    return share, mean, is_straight and n_votes >= 0.5 * n


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _room(n_rows, n_patches, kind):
    """Memory for `_search`: one allocation each, parts of one the compiler takes to overlap."""
    n, padded = n_patches, (n_patches + _PADDING - 1) // _PADDING * _PADDING
    return (
        np.empty(n_rows * n + padded, kind),
        np.empty((n_rows + 2, padded), kind),
        np.empty(padded, kind),
        np.empty(padded, kind),
        np.empty(n),
        np.arange(n) * 1.0,
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(5),
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def scratch_for(fields, settings):
    """Memory for `coarse_line`, for `fields` [field, line, column]."""
    n_rows, pixels = fields.shape[1], 8 // fields.itemsize
    n_words, kind = fields.shape[2] // settings[0], settings[9].dtype
    packed = np.empty((n_rows, n_words * pixels), fields.dtype)
    few = (n_words + _STEP - 1) // _STEP
    some = np.empty(n_rows * few, np.uint64)
    return packed, some, _room(n_rows, n_words, kind), _room(n_rows, few, kind)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _words_of(field, pitch, packed):
    """Return words of eight bytes, one a patch: the field itself, or `packed` where need be."""
    if packed.size == field.size:
        return field.view(np.uint64)
    pixels = 8 // packed.itemsize
    for row in range(packed.shape[0]):
        if pitch > 1:
            packed[row] = field[row, : packed.shape[1]]
        else:
            for i in range(packed.shape[1]):
                packed[row, i] = field[row, i // pixels]
    return packed.view(np.uint64)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def coarse_line(field, settings, scratch, line):
    """Fill the coarse line of a field: `line` [3] in rising powers of the column; NaN if none.

    Returns the share of bright patches that lie on it, 0 where there is no line, and their mean
    height over what surrounds them [grey levels]. The band's rows are searched first; unless they
    show a line like the sample's, all rows to look in are. `settings` are from
    `glint_aoa.optical.coarse.search_settings`, `scratch` from `scratch_for`.
    """
    pitch, band, rows, _, _, _, _, usual_contrast, _, _ = settings
    packed, _, room, _ = scratch
    words, bits = _words_of(field, pitch, packed), 8 * field.itemsize
    share, contrast = 0.0, 0.0
    line[:] = np.nan
    for first, last in (band, rows):
        part = words[first:last].reshape(-1)
        share, contrast, _ = _search(part, words.shape[1], bits, settings, room, line)
        if share > 0.0:
            _to_columns(first, pitch, 0.5 * (pitch - 1), line)
        sure = share >= _SURE_VOTES and contrast >= _SURE_CONTRAST * usual_contrast
        if sure or (first, last) == rows:
            break
    return share, contrast


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _quick_line(field, settings, scratch, line):
    """Fill `line` as `coarse_line`, from a part of the patches; says whether it is beyond doubt."""
    pitch, band, _, _, _, _, _, usual_contrast, _, _ = settings
    packed, some, _, room = scratch
    words, bits = _words_of(field, pitch, packed), 8 * field.itemsize
    few = _every_few(words[band[0] : band[1]], some)
    n = few.size // (band[1] - band[0])
    share, contrast, clear = _search(few, n, bits, settings, room, line)
    if share > 0.0:
        _to_columns(band[0], pitch * _STEP, 0.5 * (pitch - 1), line)
    return clear and share >= _ENOUGH and contrast >= _SURE_CONTRAST * usual_contrast


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _to_columns(first, pitch, offset, line):
    """Turn a line over the patches p and rows from `first` to columns u = pitch p + offset."""
    slope, bend = line[1] / pitch, line[2] / (pitch * pitch)
    line[0] += first + (bend * offset - slope) * offset
    line[1] = slope - 2.0 * bend * offset
    line[2] = bend


@numba.njit(cache=True, nogil=True, error_model="numpy")
def coarse_rows(field, settings, columns, scratch, line, start):
    """Fill the rows of a field's line at columns: NaN where none, far out beyond the rows.

    Where a part of the patches shows a line beyond doubt, the others are not looked at.
    """
    first, last = settings[2]
    far_out = settings[8]
    if not _quick_line(field, settings, scratch, line):
        coarse_line(field, settings, scratch, line)
    for i in range(columns.size):
        row = (line[2] * columns[i] + line[1]) * columns[i] + line[0]
        start[i] = far_out if row < first - 0.5 or row > last - 0.5 else row


@numba.njit(cache=True, nogil=True, error_model="numpy")
def coarse_lines(fields, settings, line, share, contrast):
    """Fill the coarse line [field, 3] of each field, and what `coarse_line` returns."""
    scratch = scratch_for(fields, settings)
    for k in range(fields.shape[0]):
        share[k], contrast[k] = coarse_line(fields[k], settings, scratch, line[k])
