"""Compiled kernel of the Gaussian fits. Plain arrays in and out, no state.

Around a centre c0 the expected grey level is linear in what is not known,

    mu = A g + A (c - c0) dg/dc + level + tilt (v - middle) [+ A (s - s0) dg/ds],

with g the Gaussian of height 1 integrated over each pixel. So each round is one weighted linear
regression, and its fixed point is the maximum of the likelihood.
"""

# mypy: disable-error-code="no-untyped-def"

import math

import numba
import numpy as np

from glint_aoa.optical._window_kernel import CUT, DIM, SEARCH, USED, clips, coarse

_ROUNDS = 15
_SETTLED = 2e-4  # lines; what the last step leaves is a part of it
_CENTRE, _TILT, _WIDTH = 1, 3, 4  # places of the regressors; 0 height, 2 level
_FREE, _FREE_WITH_WIDTH = 4, 5
_ROOT_2, _ROOT_2_PI = math.sqrt(2.0), math.sqrt(2 * math.pi)
_LEAST_WEIGHT = 1e-12


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _hazard(z):
    """Return the standard normal density over what lies above z."""
    if z > 12.0:
        return z + 1 / z
    return math.exp(-0.5 * z * z) / (0.5 * _ROOT_2_PI * math.erfc(z / _ROOT_2))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _observation(grey, mu, read, per_grey, black, saturation):
    """Weight of a pixel and the grey level to regress.

    A clipped pixel says only that it is at least `saturation` - 0.5: Tobit's likelihood, by its
    score and curvature at mu.
    """
    variance = read + per_grey * max(mu - black, 0.0)
    if grey < saturation:
        return 1 / variance, grey
    std = math.sqrt(variance)
    z = (saturation - 0.5 - mu) / std
    hazard = _hazard(z)
    return max(hazard * (hazard - z), _LEAST_WEIGHT) / variance, mu + std / (hazard - z)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _accumulate(grey, first, centre, sigma, middle, state, noise, free, normal, right):
    """Fill the normal equations of the regression [free, free] and [free]."""
    normal[:] = 0.0
    right[:] = 0.0
    terms = np.empty(_FREE_WITH_WIDTH)
    low = (first - 0.5 - centre) / sigma
    cdf_low, bell_low = math.erf(low / _ROOT_2), math.exp(-0.5 * low * low)
    for k in range(grey.size):
        high = low + 1 / sigma
        cdf, bell = math.erf(high / _ROOT_2), math.exp(-0.5 * high * high)
        terms[0] = 0.5 * _ROOT_2_PI * sigma * (cdf - cdf_low)
        terms[_CENTRE] = bell_low - bell
        terms[2] = 1.0
        terms[_TILT] = first + k - middle
        terms[_WIDTH] = terms[0] / sigma - (high * bell - low * bell_low)
        mu = state[0] * terms[0] + state[2] + state[_TILT] * terms[_TILT]
        weight, level = _observation(grey[k], mu, noise[0], noise[1], noise[2], noise[3])
        for i in range(free):
            weighted = weight * terms[i]
            right[i] += weighted * level
            for j in range(i + 1):
                normal[i, j] += weighted * terms[j]
        low, cdf_low, bell_low = high, cdf, bell


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _factor(normal, free):
    """Cholesky factor in place, lower half; False if the equations are singular."""
    for i in range(free):
        for j in range(i + 1):
            total = normal[i, j]
            for k in range(j):
                total -= normal[i, k] * normal[j, k]
            if i == j:
                if not total > 1e-12 * abs(normal[i, i]):
                    return False
                normal[i, i] = math.sqrt(total)
            else:
                normal[i, j] = total / normal[j, j]
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _solve(factor, right, free):
    """Solve in place by a Cholesky factor."""
    for i in range(free):
        for k in range(i):
            right[i] -= factor[i, k] * right[k]
        right[i] /= factor[i, i]
    for i in range(free - 1, -1, -1):
        for k in range(i + 1, free):
            right[i] -= factor[k, i] * right[k]
        right[i] /= factor[i, i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fit(field, column, start, learnt, geometry, noise, free, state, normal, right):
    """Fit one column; fills `state` [height, centre, level, tilt].

    Leaves the factor of the last normal equations in `normal`. Returns the status.
    """
    sign, half_width, flank = geometry[0], geometry[1], geometry[2]
    sigma, tilt, tilt_precision = learnt[0], learnt[1], learnt[2]
    centre = coarse(field, column, start, sigma, sign, half_width, state)
    middle = np.inf
    first, grey = 0, np.empty(0)
    for _ in range(_ROUNDS):
        if centre - half_width < -0.5 or centre + half_width > field.shape[0] - 0.5:
            return CUT
        if abs(centre - middle) > 1.0:  # the rows stay while the centre settles among them
            middle = centre
            first = max(math.ceil(middle - half_width - flank), 0)
            last = min(math.floor(middle + half_width + flank), field.shape[0] - 1)
            grey = field[first : last + 1, column].astype(np.float64)
        _accumulate(grey, first, centre, sigma, middle, state, noise, free, normal, right)
        normal[_TILT, _TILT] += tilt_precision
        right[_TILT] += tilt_precision * tilt
        if not _factor(normal, free):
            return DIM
        _solve(normal, right, free)
        if not sign * right[0] > 0:
            return DIM
        step = right[_CENTRE] / right[0]
        limit = max(sigma, 0.5)
        step = min(max(step, -limit), limit)
        centre += step
        state[0], state[_CENTRE], state[2], state[_TILT] = right[0], centre, right[2], right[_TILT]
        if abs(step) < _SETTLED:
            break
    return USED


@numba.njit(cache=True, nogil=True, error_model="numpy")
def column_centres(
    fields,
    columns,
    start,
    learnt,
    geometry,
    noise,
    threshold,
    centre,
    height,
    status,
    clipped,
):
    """Fill `centre`, `height`, `status` and `clipped` [field, column].

    `learnt` [column] is the width, the usual tilt of the background and its precision;
    `geometry` is sign, half width and flank; `noise` is read variance, variance per grey level,
    black and saturation. `height` is that of the fitted Gaussian.
    """
    state, right = np.zeros(_FREE_WITH_WIDTH), np.empty(_FREE_WITH_WIDTH)
    normal = np.empty((_FREE_WITH_WIDTH, _FREE_WITH_WIDTH))
    for f in range(fields.shape[0]):
        for i in range(columns.size):
            centre[f, i], height[f, i] = np.nan, 0.0
            clipped[f, i], status[f, i] = False, DIM
            if not math.isfinite(start[f, i]):
                continue
            outcome = _fit(
                fields[f],
                columns[i],
                start[f, i],
                learnt[i],
                geometry,
                noise,
                _FREE,
                state,
                normal,
                right,
            )
            if outcome == USED:
                height[f, i] = geometry[0] * state[0]
                off = abs(state[_CENTRE] - start[f, i]) > geometry[1] + SEARCH
                outcome = DIM if off or height[f, i] < threshold / 2 else USED
            status[f, i] = outcome
            if outcome == USED:
                centre[f, i] = state[_CENTRE]
                clipped[f, i] = clips(fields[f], columns[i], state[_CENTRE], geometry[1], noise[3])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def width_and_tilt(fields, columns, start, learnt, geometry, noise, value, variance):
    """Fill what each column asks of its shape, and the variances [figure, field, column].

    The figures are the change of the width and the tilt; NaN where there is no fit.
    """
    state, right = np.zeros(_FREE_WITH_WIDTH), np.empty(_FREE_WITH_WIDTH)
    normal = np.empty((_FREE_WITH_WIDTH, _FREE_WITH_WIDTH))
    value[:] = np.nan
    variance[:] = np.nan
    for f in range(fields.shape[0]):
        for i in range(columns.size):
            if not math.isfinite(start[f, i]):
                continue
            outcome = _fit(
                fields[f],
                columns[i],
                start[f, i],
                learnt[i],
                geometry,
                noise,
                _FREE_WITH_WIDTH,
                state,
                normal,
                right,
            )
            if outcome != USED:
                continue
            height, tilt = right[0], right[_TILT]
            value[0, f, i], value[1, f, i] = right[_WIDTH] / height, tilt
            for figure, place in enumerate((_WIDTH, _TILT)):
                right[:] = 0.0
                right[place] = 1.0
                _solve(normal, right, _FREE_WITH_WIDTH)
                scale = 1.0 if place == _TILT else height
                variance[figure, f, i] = right[place] / scale**2
