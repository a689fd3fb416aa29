"""Compiled kernel that cuts a strip of lines about the coarse line out of a field.

Column by column the strip's rows lie at the same place about the line, so that the compiler can do
several columns at a time.
"""

# mypy: disable-error-code="no-untyped-def"

import numba
import numpy as np

PADDING = 32  # columns, to which strips are padded: what the compiler does in one step
_RUN = 16  # adjacent columns at the same rows that are copied together


@numba.njit(cache=True, nogil=True, error_model="numpy")
def are_apart(columns):
    """Whether hardly any columns are adjacent."""
    return columns[-1] - columns[0] >= 2 * columns.size


@numba.njit(cache=True, nogil=True, error_model="numpy")
def strip_width(columns):
    """Width of a strip: the columns' number, padded, and room for what is copied too much."""
    padded = (columns.size + PADDING - 1) // PADDING * PADDING
    return padded, padded if are_apart(columns) else padded + PADDING


@numba.njit(cache=True, nogil=True, error_model="numpy")
def strip_base(start, half, base):
    """Fill the first row of each column's strip; columns without a start get row 0."""
    for i in range(start.size):
        known = start[i] if start[i] == start[i] else float(half)
        base[i] = np.int32(np.floor(known + 0.5)) - half


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cut_strip(field, columns, base, sign, strip, grey):
    """Fill `strip` [row, column] with the grey levels from row `base` on; NaN beyond the field.

    Returns whether all of it lies in the field. `grey` is memory of the strip's size.
    """
    n, size = columns.size, strip.shape[0]
    whole = base[:n].min() >= 0 and base[:n].max() + size <= field.shape[0]
    if whole and are_apart(columns):
        _gather(field, columns, base, grey)
        flat, cut = grey.reshape(-1), strip.reshape(-1)
        for i in range(flat.size):
            cut[i] = sign * np.float32(flat[i])
        return True
    i = 0
    while i < n:
        j = i + 1
        while j < n and base[j] == base[i] and columns[j] == columns[i] + (j - i):
            j += 1
        _copy_run(field, columns[i], base[i], sign, strip, i, j)
        i = j
    return whole


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _gather(field, columns, base, grey):
    """Fill `grey` [row, column] with the grey levels of single columns."""
    flat, cut = field.reshape(-1), grey.reshape(-1)
    # Counted without sign, for the compiler to see that no index counts from the end.
    pitch, width = np.uint64(field.shape[1]), np.uint64(grey.shape[1])
    for r in range(np.uint64(grey.shape[0])):
        for c in range(np.uint64(columns.size)):
            place = np.uint64(base[c]) * pitch + np.uint64(columns[c])
            cut[r * width + c] = flat[place + r * pitch]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _copy_run(field, column, base, sign, strip, i, j):
    """Copy adjacent columns that begin at the same row."""
    size = strip.shape[0]
    first = min(max(-base, 0), size)
    last = max(min(field.shape[0] - base, size), first)
    strip[:first, i:j] = np.nan
    strip[last:, i:j] = np.nan
    grey, cut = field.reshape(-1), strip.reshape(-1)
    source = np.uint64((base + first) * field.shape[1] + column)
    target, rows = np.uint64(first * strip.shape[1] + i), np.uint64(last - first)
    pitch, width = np.uint64(field.shape[1]), np.uint64(strip.shape[1])
    # What is copied too much is overwritten by the next run, or pads the strip.
    run = np.uint64((j - i + PADDING - 1) // PADDING * PADDING)
    beyond = np.uint64(i) + run > width or source + rows * pitch + run > np.uint64(grey.size)
    if j - i < _RUN or beyond:
        run = np.uint64(j - i)
    for _ in range(rows):
        for c in range(run):
            cut[target + c] = sign * np.float32(grey[source + c])
        source += pitch
        target += width
