"""What the compiled kernels of the column fits share: where to start, and what is clipped."""

# mypy: disable-error-code="no-untyped-def"

import math

import numba
import numpy as np

USED, DIM, CUT = 0, 1, 2  # what `status` says of a column: measured, too dim, out of the window

SEARCH = 2  # lines on both sides of the coarse line


@numba.njit(cache=True, nogil=True, error_model="numpy")
def coarse(field, column, start, sigma, sign, half_width, state):
    """Centre to start from: where a Gaussian fits best near the coarse line; fills `state`."""
    reach = math.ceil(min(2.0 * sigma + 1.0, half_width))
    size = 2 * reach + 1
    bell = np.empty(size)
    for k in range(size):
        bell[k] = math.exp(-0.5 * ((k - reach) / sigma) ** 2)
    mean = bell.mean()
    norm = ((bell - mean) ** 2).sum()
    best, best_row = -np.inf, -1
    nearest = math.floor(start + 0.5)
    for row in range(
        max(nearest - SEARCH, reach), min(nearest + SEARCH, field.shape[0] - 1 - reach) + 1
    ):
        product, total = 0.0, 0.0
        for k in range(size):
            grey = float(field[row - reach + k, column])
            product += (bell[k] - mean) * grey
            total += grey
        if sign * product > best:
            best, best_row = sign * product, row
            state[0] = product / norm
            state[2] = total / size - state[0] * mean
    state[3] = 0.0
    if best_row < 0:
        return start
    return start if abs(best_row - start) <= 1.0 else float(best_row)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def clips(field, column, centre, half_width, saturation):
    low, high = math.ceil(centre - half_width), math.floor(centre + half_width)
    for row in range(max(low, 0), min(high + 1, field.shape[0])):
        if field[row, column] >= saturation:
            return True
    return False
