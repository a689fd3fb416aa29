"""Compiled kernel of the plain line fit. Plain arrays in and out, no state."""

# mypy: disable-error-code="no-untyped-def"

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fit_lines(s, z, column_weight, usual, outlier, figures, weight, residual, outlying):
    """Fit a weighted line to each row of z; NaN is no point.

    Fills `figures` [5, field] with slope, intercept, their variances and covariance (NaN below two
    points), `weight` and `residual` [field, column], and `outlying` [field]: how many points lie
    more than `outlier` standard deviations, the weight's, from the line and their usual place.
    """
    for k in range(z.shape[0]):
        total, s_sum, z_sum, count = 0.0, 0.0, 0.0, 0
        for i in range(z.shape[1]):
            there = z[k, i] == z[k, i] and s[k, i] == s[k, i]
            w = column_weight[i] if there else 0.0
            weight[k, i] = w
            total += w
            s_sum += w * s[k, i] if there else 0.0
            z_sum += w * z[k, i] if there else 0.0
            count += w > 0
        s_mean, z_mean = s_sum / total, z_sum / total
        spread, product = 0.0, 0.0
        for i in range(z.shape[1]):
            if weight[k, i] > 0:
                ds = s[k, i] - s_mean
                spread += weight[k, i] * ds * ds
                product += weight[k, i] * ds * (z[k, i] - z_mean)
        if count < 2 or not spread > 0:
            figures[:, k] = np.nan
            residual[k] = np.nan
            outlying[k] = 0
            continue
        slope = product / spread
        intercept = z_mean - slope * s_mean
        figures[0, k], figures[1, k] = slope, intercept
        figures[2, k] = 1 / spread
        figures[3, k] = 1 / total + s_mean * s_mean / spread
        figures[4, k] = -s_mean / spread
        beyond = 0
        limit = outlier * outlier
        for i in range(z.shape[1]):
            off = z[k, i] - intercept - slope * s[k, i]
            residual[k, i] = off
            beyond += (off - usual[i]) ** 2 * weight[k, i] > limit
        outlying[k] = beyond
