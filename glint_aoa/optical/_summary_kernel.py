"""Compiled kernel from a field's centres to its line and what tells of its quality.

Plain arrays in and out, no state. One pass over the columns of a field, while they are in the
cache, leaves a few figures.
"""

# mypy: disable-error-code="no-untyped-def"

import numba
import numpy as np

from glint_aoa.optical._line_kernel import plain_line, points, robust_line, total

# What stands where in `figures`, after the line's five.
SQUARES, OWN_SQUARES, HEIGHT, USUAL_HEIGHT = 5, 6, 7, 8
ROW, REACH, ROW_VAR = 9, 10, 11
N_FIGURES = 12
# What stands where in `counts`.
USED, DIM, CUT, CLIPPED = 0, 1, 2, 3
N_COUNTS = 4


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _polynomials(t, powers, values):
    """Fill `values` [column] with the columns' polynomials `powers` [power, column] in `t`."""
    last = powers.shape[0] - 1
    for i in range(t.size):
        values[i] = powers[last, i]
    for p in range(last - 1, -1, -1):
        for i in range(t.size):
            values[i] = values[i] * t[i] + powers[p, i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _squares(residual, usual, weight, used, spare):
    """Sum the squares of used columns' residuals, and weighted ones of those beyond the usual."""
    for i in range(residual.size):
        spare[i] = used[i] * residual[i] * residual[i]
    plain = total(spare)
    for i in range(residual.size):
        off = residual[i] - usual[i]
        spare[i] = weight[i] * off * off
    return plain, total(spare)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _heights(height, column_height, used, spare):
    """Sum of the used columns' heights, and what it usually is."""
    for i in range(height.size):
        spare[i] = height[i] if used[i] > 0.0 else 0.0
    own = total(spare)
    for i in range(height.size):
        spare[i] = used[i] * column_height[i]
    return own, total(spare)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _count(height, cut, clipped, used, threshold, counts):
    """Count the columns that are dim, cut, and used though clipped."""
    n_dim, n_cut, n_clipped = 0, 0, 0
    for i in range(used.size):
        n_dim += used[i] > 0.0 and height[i] < threshold
    for i in range(used.size):
        n_cut += cut[i]
    for i in range(used.size):
        n_clipped += clipped[i]
    if n_clipped > 0:
        n_clipped = 0
        for i in range(used.size):
            n_clipped += clipped[i] and used[i] > 0.0
    counts[DIM], counts[CUT], counts[CLIPPED] = n_dim, n_cut, n_clipped


@numba.njit(cache=True, nogil=True, error_model="numpy")
def row_line(row, place, used, spare, line):
    """Row of the line, its reach, the variance of the row; NaN below three columns; their number.

    `place` is -1 at the first measured column and 1 at the last; `row` is finite.
    """
    count = plain_line(place, row, used, spare, line)
    if count < 3:
        return np.nan, np.nan, np.nan, count
    for i in range(row.size):
        off = row[i] - line[1] - line[0] * place[i]
        spare[i] = used[i] * off * off
    return line[1], line[0], line[3] * total(spare) / (count - 2), count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fingerprint(bits, odd):
    """Tell rows of the same bits from all others that are met; wraps round."""
    whole = np.uint64(0)
    for i in range(bits.size):
        whole += bits[i] * odd[i]
    return whole


@numba.njit(cache=True, nogil=True, error_model="numpy")
def scratch_for(settings):
    """Memory for `summarise_field`."""
    std = settings[4]
    n = std.size
    # One allocation each: parts of one array the compiler takes to overlap.
    return (
        1.0 / std**2,
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(5),
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def summarise_field(row, height, cut, clipped, first_line, settings, scratch, figures, counts):
    """Fill `figures` [figure] and `counts` [count] of a field; returns its fingerprint.

    `row`, `height`, `cut` and `clipped` [column] are those of
    `glint_aoa.optical.estimator.ColumnCentres`; `first_line` is the sensor line of the window's
    row 0. `settings` are from `glint_aoa.optical.summary.Summariser`, `scratch` from `scratch_for`.
    """
    middle, half, s_powers, z_powers, std, usual, column_height, place, odd, threshold = settings
    column_weight, t, s, z, known, own, weight, used, residual, spare, fitted = scratch
    scale, offset = 1.0 / half, (first_line - middle) / half
    for i in range(row.size):
        t[i] = offset + scale * row[i]
    _polynomials(t, s_powers, s)
    _polynomials(t, z_powers, z)
    points(s, z, column_weight, known, own)
    robust_line(s, z, known, own, std, usual, weight, residual, spare, figures[:5])
    for i in range(row.size):
        used[i] = 1.0 if weight[i] > 0.0 else 0.0
        t[i] = row[i] if weight[i] > 0.0 else 0.0
    squares = _squares(residual, usual, weight, used, spare)
    figures[SQUARES], figures[OWN_SQUARES] = squares
    heights = _heights(height, column_height, used, spare)
    figures[HEIGHT], figures[USUAL_HEIGHT] = heights
    _count(height, cut, clipped, used, threshold, counts)
    line = row_line(t, place, used, spare, fitted)
    figures[ROW], figures[REACH], figures[ROW_VAR], counts[USED] = line
    return _fingerprint(row.view(np.uint64), odd)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def summed_part(row, height, cut, clipped, first_line, settings, figures, counts, fingerprint):
    """Fill what `summarise_field` does for a block: [field, figure], [field, count], [field]."""
    scratch = scratch_for(settings)
    for k in range(row.shape[0]):
        fingerprint[k] = summarise_field(
            row[k],
            height[k],
            cut[k],
            clipped[k],
            first_line[k],
            settings,
            scratch,
            figures[k],
            counts[k],
        )
