"""The curve of one pitch sweep: onboard angle as a polynomial of the optical one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from calibration.sweep._hysteresis import Hysteresis, find_hysteresis
from calibration.sweep._outliers import ScaledPoints, find_outliers
from calibration.sweep._polynomial import PolynomialFit, corrected_criterion, fit_polynomial
from calibration.sweep.point import SweepPoint
from glint_aoa.errors import CalibrationError

__all__ = ["SweepCurve", "fit_curves"]

_MAX_DEGREE = 3
_SAME_ANGLE_DEG = 0.01  # the package's static accuracy: nearer angles are one angle of a sweep
_SAME_ANGLE_STDS = 5.0
_SIGNIFICANCE = 0.01
_PLAUSIBLE_SLOPE = (0.2, 5.0)  # a mix-up of degrees and radians gives 57 or 0.017

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SweepCurve:
    r"""A sweep at one tunnel temperature.

    .. math:: \alpha_{onboard} = \sum_k c_k t^k, \qquad
              t = (\alpha_{optical} - \alpha_{centre}) / h

    Attributes
    ----------
    coefficients_deg : ndarray [degree + 1]
        Coefficients :math:`c_k`, lowest power first [deg].
    covariance_deg2 : ndarray [power, power]
        Their covariance [deg^2], scatter beyond the stated uncertainties included; up to the
        highest power that was compared, since one left out is zero in the curve and yet not known
        to be.
    centre_deg, half_range_deg : float
        Centre and half width of the sweep's range of optical angle [deg].
    points : tuple of SweepPoint
        The points of the fit.
    left_out : mapping of SweepPoint to str
        Points that lie off the curve, and how far.
    chi_square : float
        Sum of squared residuals in units of their uncertainty, over both variables.
    temperature_k : float or None
        Mean tunnel temperature [K].
    scatter_deg : float
        How much points scatter about the curve beyond their stated uncertainty, 1 sigma [deg]; 0
        where that explains them.
    hysteresis : Hysteresis or None
        Whether angles taken on the way up and on the way down differ, where the sweep has both.
    criterion : mapping of int to float
        Corrected information criterion of each degree that was compared, relative to the
        least; empty where the degree was given.
    """

    coefficients_deg: Floats
    covariance_deg2: Floats
    centre_deg: float
    half_range_deg: float
    points: tuple[SweepPoint, ...]
    left_out: Mapping[SweepPoint, str]
    chi_square: float
    temperature_k: float | None = None
    scatter_deg: float = 0.0
    hysteresis: Hysteresis | None = None
    criterion: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def degree(self) -> int:
        """Degree of the polynomial."""
        return int(self.coefficients_deg.size - 1)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of points less number of coefficients."""
        return len(self.points) - self.coefficients_deg.size

    @property
    def is_widened(self) -> bool:
        """Whether the covariance was widened for scatter beyond the stated uncertainties."""
        return self.scatter_deg > 0

    @property
    def scatter_freedom(self) -> float:
        """Effective degrees of freedom of `scatter_deg`; infinite where it is 0.

        What is left of the residuals' variance once the stated one is taken off is less certain
        than the residuals' (Welch and Satterthwaite).
        """
        if not self.is_widened:
            return float("inf")
        excess = self.chi_square / self.degrees_of_freedom
        return self.degrees_of_freedom * (1 - 1 / excess) ** 2

    @property
    def range_deg(self) -> tuple[float, float]:
        """Least and greatest optical angle of the fit [deg]."""
        return (
            self.centre_deg - self.half_range_deg,
            self.centre_deg + self.half_range_deg,
        )

    @property
    def lasting_std_deg(self) -> float:
        """What a point at rest may be off that is neither its noise nor the curve's [deg].

        Scatter beyond the stated uncertainties, or half the hysteresis where that is significant
        and larger; the one holds the other.
        """
        loop = self.hysteresis
        half = loop.width_deg / 2 if loop is not None and loop.is_significant else 0.0
        return max(self.scatter_deg, abs(half))

    def predict(self, angle_deg: ArrayLike) -> Floats:
        """Return the onboard angle [deg] for optical angles [deg], within the range or not."""
        t = self._scaled(angle_deg)
        return np.asarray(np.polynomial.polynomial.polyval(t, self.coefficients_deg), np.float64)

    def derivative(self, angle_deg: ArrayLike) -> Floats:
        """Return d onboard / d optical at optical angles [deg]."""
        slopes = np.polynomial.polynomial.polyder(self.coefficients_deg) / self.half_range_deg
        t = self._scaled(angle_deg)
        return np.asarray(np.polynomial.polynomial.polyval(t, slopes), np.float64)

    def powers(self, angle_deg: ArrayLike) -> Floats:
        """Return t^k at optical angles [...] [deg], as [..., degree + 1]."""
        return self._powers(angle_deg, self.degree + 1)

    def covariance_of(self, angle_deg: ArrayLike) -> Floats:
        """Return the covariance of the curve at optical angles [angle] [deg^2]."""
        powers = self._powers(angle_deg, len(self.covariance_deg2))
        return np.asarray(powers @ self.covariance_deg2 @ powers.T)

    def variance_of(self, angle_deg: ArrayLike) -> Floats:
        """Return the variance of the curve at optical angles [...] [deg^2]."""
        powers = self._powers(angle_deg, len(self.covariance_deg2))
        variance = np.einsum("...i,ij,...j->...", powers, self.covariance_deg2, powers)
        return np.asarray(np.maximum(variance, 0.0), np.float64)

    def _powers(self, angle_deg: ArrayLike, count: int) -> Floats:
        return np.asarray(self._scaled(angle_deg)[..., None] ** np.arange(count))

    def _scaled(self, angle_deg: ArrayLike) -> Floats:
        return (np.asarray(angle_deg, np.float64) - self.centre_deg) / self.half_range_deg


def fit_curves(
    groups: Sequence[Sequence[SweepPoint]], *, degree: int | None = None
) -> tuple[SweepCurve, ...]:
    """Fit the curves of sweeps at one temperature each; all have one degree.

    Parameters
    ----------
    groups : sequence of sequence of SweepPoint
        The points of each sweep in the order in which they were taken.
    degree : int, optional
        Degree of the polynomials, 1 or more; by default the one of 1, 2 and 3 with the least
        corrected Akaike criterion over all sweeps that leaves points to spare.

    Returns
    -------
    tuple of SweepCurve
        One for each group. Where a chi-square test at 1 % says that the stated uncertainties
        cannot explain the scatter, the covariance is multiplied by the reduced chi-square
        (Birge's ratio); it is never reduced. Where the degree was chosen, the covariance holds
        that another might be right: each degree's covariance and its difference from the chosen
        one count with its Akaike weight (Burnham and Anderson, *Model Selection*, 2002, 4.3).

    Raises
    ------
    CalibrationError
        If the points do not determine a polynomial: too few, too few different angles, or angles
        that cannot be the same motion.
    """
    for group in groups:
        _check_degree(group, degree)
    outliers = [find_outliers(_scaled(group), _spare_degree(group)) for group in groups]
    kept = [
        [point for number, point in enumerate(group) if number not in found]
        for group, found in zip(groups, outliers, strict=True)
    ]
    degrees = [degree] if degree else range(1, min(map(_supported_degree, kept)) + 1)
    fits = {each: [fit_polynomial(*_scaled(group)[:4], each) for group in kept] for each in degrees}
    totals = {each: sum(fit.chi_square for fit in found) for each, found in fits.items()}
    n_points = sum(map(len, kept))
    criterion = {} if degree else corrected_criterion(totals, n_points, curves=len(kept))
    chosen = min(criterion, key=criterion.__getitem__) if criterion else min(degrees)
    curves = []
    for number, (group, found) in enumerate(zip(groups, outliers, strict=True)):
        compared = {each: fits[each][number] for each in degrees}
        whole = _unconditional(compared, chosen, criterion)
        curves.append(_curve(group, kept[number], whole, found, criterion))
    return tuple(curves)


def _unconditional(
    fits: Mapping[int, PolynomialFit], chosen: int, criterion: Mapping[int, float]
) -> PolynomialFit:
    """Return the chosen fit with the covariance that it has before the degree is known."""
    if not criterion:
        return fits[chosen]
    size = max(fits) + 1
    weight = {degree: np.exp(-0.5 * criterion[degree]) for degree in fits}
    covariance = np.zeros((size, size))
    for degree, fit in fits.items():
        other = np.zeros(size)
        other[: degree + 1] = fit.coefficients
        other[: chosen + 1] -= fits[chosen].coefficients
        spread = np.outer(other, other)
        spread[: degree + 1, : degree + 1] += fit.covariance
        covariance += weight[degree] / sum(weight.values()) * spread
    return fits[chosen]._replace(covariance=covariance)


def _curve(
    group: Sequence[SweepPoint],
    used: Sequence[SweepPoint],
    fit: PolynomialFit,
    outliers: Mapping[int, str],
    criterion: Mapping[int, float],
) -> SweepCurve:
    scaled = _scaled(used)
    _check_slope(fit.coefficients, scaled.half_deg)
    freedom = len(used) - fit.coefficients.size
    loop = find_hysteresis(group, used, scaled, fit)
    excess = _excess(fit.chi_square, freedom)
    temperatures = [point.temperature_k for point in used if point.temperature_k is not None]
    slopes = np.polynomial.polynomial.polyval(
        scaled.t, np.polynomial.polynomial.polyder(fit.coefficients)
    )
    stated = np.mean(scaled.sy**2 + (slopes * scaled.st) ** 2)
    return SweepCurve(
        coefficients_deg=fit.coefficients,
        covariance_deg2=fit.covariance * excess,
        centre_deg=scaled.centre_deg,
        half_range_deg=scaled.half_deg,
        points=tuple(used),
        left_out={group[number]: reason for number, reason in outliers.items()},
        chi_square=fit.chi_square,
        temperature_k=float(np.mean(temperatures)) if temperatures else None,
        scatter_deg=float(np.sqrt((excess - 1) * stated)),
        hysteresis=loop,
        criterion=criterion,
    )


def _scaled(points: Sequence[SweepPoint]) -> ScaledPoints:
    """Scale the optical angles to -1 ... 1."""
    x, sx, y, sy = np.array(
        [[p.optical_deg, p.optical_std_deg, p.onboard_deg, p.onboard_std_deg] for p in points]
    ).T
    centre, half = (x.min() + x.max()) / 2, (x.max() - x.min()) / 2
    return ScaledPoints((x - centre) / half, sx / half, y, sy, float(centre), float(half))


def _check_degree(points: Sequence[SweepPoint], degree: int | None) -> None:
    if len(points) < 3:
        raise CalibrationError(
            f"a pitch sweep needs at least 3 points at different angles, got {len(points)}"
            f"{_at(points)}; measure more points"
        )
    distinct = _count_angles(points)
    if distinct < 2:
        mean = np.mean([point.optical_deg for point in points])
        raise CalibrationError(
            f"the pitch sweep{_at(points)} holds one angle only (about {mean:.3f} deg); "
            "measure points over the range of angles to be calibrated"
        )
    if degree is None:
        return
    if not isinstance(degree, int) or degree < 1:
        raise CalibrationError(f"degree is {degree}; give 1 for a straight line, or more")
    if distinct < degree + 1:
        raise CalibrationError(
            f"a polynomial of degree {degree} needs {degree + 1} different angles, the pitch "
            f"sweep{_at(points)} holds {distinct}; choose a lower degree or measure more angles"
        )


def _at(points: Sequence[SweepPoint]) -> str:
    known = [point.temperature_k for point in points if point.temperature_k is not None]
    return f" at {np.mean(known):.1f} K" if known else ""


def _supported_degree(points: Sequence[SweepPoint]) -> int:
    to_spare = len(points) - 3  # the criterion needs two points more than coefficients
    return max(1, min(_MAX_DEGREE, _count_angles(points) - 1, to_spare))


def _spare_degree(points: Sequence[SweepPoint]) -> int:
    """Return the highest degree at which a point left out still shows; 0 if none does."""
    return max(0, min(_MAX_DEGREE, _count_angles(points) - 2, len(points) - 4))


def _count_angles(points: Sequence[SweepPoint]) -> int:
    count, last = 0, -np.inf
    for point in sorted(points, key=lambda each: each.optical_deg):
        if point.optical_deg - last > max(
            _SAME_ANGLE_DEG, _SAME_ANGLE_STDS * point.optical_std_deg
        ):
            count, last = count + 1, point.optical_deg
    return count


def _check_slope(coefficients: Floats, half_range: float) -> None:
    slope = coefficients[1] / half_range
    low, high = _PLAUSIBLE_SLOPE
    if slope < 0:
        raise CalibrationError(
            "the onboard angle falls where the optical angle rises; "
            "check glint.nose in the setup and the sign of the onboard channel"
        )
    if not low < slope < high:
        raise CalibrationError(
            f"the onboard angle changes {slope:.3g} deg per optical deg; "
            "check that both are in degrees and belong to the same points"
        )


def _excess(chi_square: float, freedom: int) -> float:
    if freedom < 1 or special.chdtrc(freedom, chi_square) >= _SIGNIFICANCE:
        return 1.0
    return chi_square / freedom
