"""A polynomial through points with errors in both variables."""

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from glint_aoa.errors import CalibrationError

__all__ = ["PolynomialFit", "corrected_criterion", "fit_polynomial"]

Floats = NDArray[np.float64]

_MOST_STEPS = 50
_SAME_ABSCISSA = 1e-15  # of half the range
_ROUGH = 1e-6  # relative: what a resistant curve is needed to


class PolynomialFit(NamedTuple):
    """Coefficients [degree + 1], lowest power first, their covariance, and chi-square."""

    coefficients: Floats
    covariance: Floats
    chi_square: float


def fit_polynomial(
    t: Floats,
    st: Floats,
    y: Floats,
    sy: Floats,
    degree: int,
    *,
    loss: Literal["linear", "soft_l1"] = "linear",
    loss_scale: float = 1.0,
) -> PolynomialFit:
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
    loss : {"linear", "soft_l1"}
        Least squares; or nearly least absolute deviations, which few wrong points hardly move.
    loss_scale : float
        Distance, in standard deviations, from which "soft_l1" counts a point by its distance
        and no longer by the square of it.

    Returns
    -------
    PolynomialFit
        The covariance is that of least squares whatever the loss.

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
    tolerance = 1e-14 if loss == "linear" else _ROUGH
    solution = optimize.least_squares(
        distances,
        start,
        jac=jacobian,
        method="lm" if loss == "linear" else "trf",
        x_scale="jac",
        xtol=tolerance,
        ftol=tolerance,
        gtol=tolerance,
        loss=loss,
        f_scale=loss_scale,
    )
    if not solution.success:
        raise CalibrationError(
            f"the fit of degree {degree} to the pitch sweep does not converge; "
            "look for a point that is wrong, or choose a lower degree"
        )
    inverse = np.linalg.inv(np.linalg.qr(jacobian(solution.x), mode="r"))
    return PolynomialFit(solution.x, inverse @ inverse.T, float(np.sum(solution.fun**2)))


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
    """Evaluate a polynomial and its derivative together (Horner)."""
    value, slope = np.zeros_like(t), np.zeros_like(t)
    for coefficient in coefficients[::-1]:
        slope = slope * t + value
        value = value * t + coefficient
    return value, slope


def corrected_criterion(
    chi_square: Mapping[int, float], n_points: int, *, curves: int = 1
) -> dict[int, float]:
    """Akaike's criterion, corrected for few points and for scatter beyond the stated one.

    Parameters
    ----------
    chi_square : mapping of int to float
        Chi-square of each degree, summed over the curves.
    n_points : int
        Points of all curves.
    curves : int
        Curves that share the degree.

    Returns
    -------
    dict of int to float
        By degree, relative to the least; empty where there is nothing to choose from.

    Notes
    -----
    Hurvich and Tsai, Biometrika 76, 297 (1989); the dispersion is that of the highest degree, as
    for overdispersed data (Burnham and Anderson, *Model Selection*, 2002, section 2.5).
    """
    largest = max(chi_square)
    freedom = n_points - curves * (largest + 1)
    if len(chi_square) < 2 or freedom < 1:
        return {}
    dispersion = max(1.0, chi_square[largest] / freedom)
    criterion = {}
    for degree, chi2 in chi_square.items():
        k = curves * (degree + 1)
        correction = 2 * k * (k + 1) / (n_points - k - 1)
        criterion[degree] = chi2 / dispersion + 2 * k + correction
    least = min(criterion.values())
    return {degree: value - least for degree, value in criterion.items()}
