"""Compiled kernel that evaluates a pair of polynomials for each column."""

# mypy: disable-error-code="no-untyped-def"

import numba


@numba.njit(cache=True, nogil=True, error_model="numpy")
def evaluate(v, middle, half, s_powers, z_powers, s, z):
    """Fill `s` and `z` [row, column] with the columns' polynomials in (v - middle) / half."""
    last = s_powers.shape[1] - 1
    for k in range(v.shape[0]):
        for i in range(v.shape[1]):
            t = (v[k, i] - middle) / half
            along, height = s_powers[i, last], z_powers[i, last]
            for p in range(last - 1, -1, -1):
                along = along * t + s_powers[i, p]
                height = height * t + z_powers[i, p]
            s[k, i] = along
            z[k, i] = height
