"""Multiple linear regression of slow signals, with standard errors that hold for them.

Samples behind a low-pass are far from independent, so the usual standard errors would be several
times too small.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glint_aoa.coverage import coverage_factor
from glint_aoa.errors import InputError

__all__ = ["INDEPENDENT_HZ", "LinearFit", "fit_line"]

_Floats = NDArray[np.float64]

INDEPENDENT_HZ = 0.9
"""Independent samples a second behind the package's low-pass of 0.4 Hz [1/s]."""

_SLOW_HZ = 0.1
"""The errors are taken as white below this: a quarter of the package's cutoff [Hz]."""

_LEAST_COSINES, _MOST_COSINES = 3, 24


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Response = intercept + sum of coefficient * regressor + residual.

    Attributes
    ----------
    intercept : float
        In the response's unit.
    coefficient : ndarray [regressor]
        Unit of the response over that of the regressor.
    covariance : ndarray [regressor, regressor]
        Of the coefficients. Widened so that 1.96 of its roots hold 95 %, as Student's t does.
    intercept_std : float
        Standard uncertainty of the intercept, likewise.
    residual : ndarray [sample]
        Response less fit.
    standard_error : float
        Standard error of the regression: rms residual over the degrees of freedom left.
    explained : float
        Fraction of the response's variance that the fit explains, R^2.
    """

    intercept: float
    coefficient: _Floats
    covariance: _Floats
    intercept_std: float
    residual: _Floats
    standard_error: float
    explained: float

    @property
    def coefficient_std(self) -> _Floats:
        """Standard uncertainty of each coefficient [regressor]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def fit_line(
    response: ArrayLike,
    regressors: Sequence[ArrayLike],
    rate_hz: float,
    *,
    use: NDArray[np.bool_] | None = None,
) -> LinearFit:
    """Fit a response by a constant and regressors, by least squares.

    Parameters
    ----------
    response : array_like [sample]
        Slow signal.
    regressors : sequence of array_like [sample]
        Sampled with it; may be empty.
    rate_hz : float
        Samples a second [Hz].
    use : ndarray of bool [sample], optional
        Samples to fit; all of them by default. Residuals are given for all.

    Returns
    -------
    LinearFit
        The fit. A regressor that does not vary gets the coefficient 0 with infinite uncertainty.

    Raises
    ------
    InputError
        If there are too few samples for the number of regressors.

    Notes
    -----
    The covariance is the sandwich (X'X)^-1 S (X'X)^-1 with the long-run variance S of the scores
    from equal-weighted cosine transforms, B of them below 0.1 Hz, and Student's t of B degrees of
    freedom (Lazarus, Lewis, Stock and Watson 2018, doi:10.1080/07350015.2018.1506926), times
    n / (n - parameters) for n independent samples. It does not cover noise in the regressors,
    which draws coefficients towards zero.
    """
    y = np.asarray(response, np.float64)
    columns = [np.asarray(each, np.float64) for each in regressors]
    chosen = np.ones(y.size, bool) if use is None else use
    least = len(columns) + _LEAST_COSINES + 1
    if np.count_nonzero(chosen) < least:
        raise InputError(
            f"{np.count_nonzero(chosen)} samples are too few to fit {len(columns)} regressors; "
            f"give at least {least}"
        )
    centre = np.array([column[chosen].mean() for column in columns])
    spread = np.array([column[chosen].std() for column in columns])
    varies = spread > 1e-9 * np.abs(centre)
    scale = np.where(varies, spread, 1.0)
    standard = [
        np.where(v, (c - m) / s, 0.0)
        for c, m, s, v in zip(columns, centre, scale, varies, strict=True)
    ]
    design = np.stack([np.ones(y.size), *standard], axis=1)
    inverse = np.linalg.pinv(design[chosen].T @ design[chosen])
    solution = inverse @ (design[chosen].T @ y[chosen])
    residual = y - design @ solution
    sandwich = _sandwich(inverse, design[chosen] * residual[chosen, None], rate_hz)
    covariance = sandwich[1:, 1:] / np.outer(scale, scale)
    covariance[~varies, :] = covariance[:, ~varies] = 0.0
    covariance[~varies, ~varies] = np.inf
    to_intercept = np.concatenate([[1.0], -np.where(varies, centre / scale, 0.0)])
    left = float(np.sum(residual[chosen] ** 2))
    total = float(np.sum((y[chosen] - y[chosen].mean()) ** 2))
    freedom = np.count_nonzero(chosen) - 1 - len(columns)
    return LinearFit(
        intercept=float(to_intercept @ solution),
        coefficient=solution[1:] / scale,
        covariance=covariance,
        intercept_std=float(np.sqrt(to_intercept @ sandwich @ to_intercept)),
        residual=residual,
        standard_error=float(np.sqrt(left / freedom)),
        explained=1 - left / total if total > 0 else 0.0,
    )


def _sandwich(inverse: _Floats, scores: _Floats, rate_hz: float) -> _Floats:
    """Covariance of the solution from the scores [sample, parameter], widened for the fit."""
    independent = INDEPENDENT_HZ * len(scores) / rate_hz
    lost = independent / max(independent - scores.shape[1], 1.0)
    return np.asarray(lost * inverse @ _long_run(scores, rate_hz) @ inverse)


def _long_run(scores: _Floats, rate_hz: float) -> _Floats:
    """Sum of the autocovariances of the scores' sum [parameter, parameter], widened for few."""
    size = len(scores)
    count = int(np.clip(2 * _SLOW_HZ * size / rate_hz, _LEAST_COSINES, _MOST_COSINES))
    angles = np.pi * (np.arange(size) + 0.5) / size
    cosines = np.cos(np.outer(np.arange(1, count + 1), angles))
    parts = np.sqrt(2.0) * (cosines @ scores)
    return np.asarray(_wider(count) ** 2 * (parts.T @ parts) / count)


@cache
def _wider(freedom: int) -> float:
    """Half-width of 95 % of Student's t over that of the normal distribution."""
    return coverage_factor(freedom) / coverage_factor()
