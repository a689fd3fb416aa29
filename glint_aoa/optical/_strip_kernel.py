"""Compiled kernel that cuts a strip of lines about the coarse line out of each field.

Every estimator works on the strip: column by column its rows lie at the same place about the line,
so that the compiler can do several columns at a time.
"""

# mypy: disable-error-code="no-untyped-def"

import numba
import numpy as np

_RUN = 8  # adjacent columns at the same rows from which they are copied together


@numba.njit(cache=True, nogil=True, error_model="numpy")
def strip_base(start, half, base):
    """Fill the first row of each column's strip; columns without a start get row 0."""
    for i in range(start.size):
        base[i] = int(np.floor(start[i] + 0.5)) - half if not np.isnan(start[i]) else 0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cut_strip(field, columns, base, sign, strip):
    """Fill `strip` [row, column] with the grey levels from row `base` on; NaN beyond the field."""
    n, i = columns.size, 0
    rows = field.shape[0]
    while i < n:
        j = i + 1
        while j < n and base[j] == base[i] and columns[j] == columns[i] + (j - i):
            j += 1
        if j - i >= _RUN:
            _copy_run(field, columns[i], base[i], sign, i, j, strip)
        else:
            for c in range(i, j):
                column, first = columns[c], base[c]
                for r in range(strip.shape[0]):
                    row = first + r
                    inside = 0 <= row < rows
                    strip[r, c] = sign * np.float32(field[row, column]) if inside else np.nan
        i = j


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _copy_run(field, column, first, sign, start, stop, strip):
    for r in range(strip.shape[0]):
        row = first + r
        copy = strip[r, start:stop]
        if 0 <= row < field.shape[0]:
            line = field[row, column : column + stop - start]
            for c in range(copy.size):
                copy[c] = sign * np.float32(line[c])
        else:
            copy[:] = np.nan
