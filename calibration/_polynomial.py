"""A polynomial through points with errors in both variables."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from glint_aoa.errors import CalibrationError

Floats = NDArray[np.float64]

_MOST_STEPS = 50
_SAME_ABSCISSA = 1e-15  # of half the range


class PolynomialFit(NamedTuple):
    """Coefficients [degree + 1], lowest power first, their covariance, and chi-square."""

    coefficients: Floats
    covariance: Floats
    chi_square: float


def fit_polynomial(t: Floats, st: Floats, y: Floats, sy: Floats, degree: int) -> PolynomialFit:
    """Minimise the distances of the points from the curve, in units of both uncertainties.

    The point of the curve nearest to a measured one is found anew for each trial of the
    coefficients, so that these are all that `scipy.optimize.least_squares` has to adjust. The
    distance changes with the coefficients as the residual in y does, divided by the effective
    standard deviation sqrt(sy^2 + p'^2 st^2).

    Parameters
    ----------
    t, st : ndarray [point]
        Abscissae, scaled to -1 ... 1, and their uncertainties, 1 sigma.
    y, sy : ndarray [point]
        Ordinates and their uncertainties, 1 sigma.
    degree : int
        Degree of the polynomial.

    Raises
    ------
    CalibrationError
        If the minimum is not found.
    """

    def distances(coefficients: Floats) -> Floats:
        nearest = _nearest_abscissae(coefficients, t, st, y, sy)
        value, slope = _value_and_slope(coefficients, nearest)
        return (value - y) * np.hypot(sy, slope * st) / sy**2

    def jacobian(coefficients: Floats) -> Floats:
        nearest = _nearest_abscissae(coefficients, t, st, y, sy)
        _, slope = _value_and_slope(coefficients, nearest)
        powers = np.polynomial.polynomial.polyvander(nearest, degree)
        return np.asarray(powers / np.hypot(sy, slope * st)[:, None], np.float64)

    start = np.polynomial.polynomial.polyfit(t, y, degree, w=1 / sy)
    solution = optimize.least_squares(
        distances, start, jac=jacobian, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    if not solution.success:
        raise CalibrationError(
            f"the fit of degree {degree} to the pitch sweep does not converge; "
            "look for a point that is wrong, or choose a lower degree"
        )
    inverse = np.linalg.inv(np.linalg.qr(jacobian(solution.x), mode="r"))
    return PolynomialFit(solution.x, inverse @ inverse.T, float(2 * solution.cost))


def _nearest_abscissae(
    coefficients: Floats, t: Floats, st: Floats, y: Floats, sy: Floats
) -> Floats:
    """Return where the curve comes nearest to each point, by steps along its tangent."""
    nearest = t
    for _ in range(_MOST_STEPS):
        value, slope = _value_and_slope(coefficients, nearest)
        off_tangent = y - value - slope * (t - nearest)
        stepped = t + off_tangent * slope * st**2 / (sy**2 + (slope * st) ** 2)
        moved = np.max(np.abs(stepped - nearest))
        nearest = stepped
        if moved < _SAME_ABSCISSA:
            break
    return nearest


def _value_and_slope(coefficients: Floats, t: Floats) -> tuple[Floats, Floats]:
    derivative = np.polynomial.polynomial.polyder(coefficients)
    return (
        np.asarray(np.polynomial.polynomial.polyval(t, coefficients), np.float64),
        np.asarray(np.polynomial.polynomial.polyval(t, derivative), np.float64),
    )


def corrected_criterion(fits: Mapping[int, PolynomialFit], n_points: int) -> dict[int, float]:
    """Akaike's criterion, corrected for few points and for scatter beyond the stated one."""
    largest = max(fits)
    freedom = n_points - (largest + 1)
    if len(fits) < 2 or freedom < 1:
        return {}
    dispersion = max(1.0, fits[largest].chi_square / freedom)
    criterion = {}
    for degree, fit in fits.items():
        k = degree + 1
        correction = 2 * k * (k + 1) / (n_points - k - 1)
        criterion[degree] = fit.chi_square / dispersion + 2 * k + correction
    least = min(criterion.values())
    return {degree: value - least for degree, value in criterion.items()}
