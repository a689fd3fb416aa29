"""The no-flow pitch sweep: optical angle against the onboard sensor's.

The reflection of a lamp at finite distance, a known Y that is wrong and a camera that is turned
change the scale of the optical angle and bend it a little. With no flow the onboard sensor gives
the angle itself, so a sweep over pitch gives the polynomial onboard = p(optical) that takes all
of this out.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from calibration._polynomial import corrected_criterion, fit_polynomial
from calibration._sweep_file import Provenance, SweepFile, read_sweep_file, write_sweep_file
from glint_aoa.errors import CalibrationError

__all__ = [
    "DEFAULT_ONBOARD_STD_DEG",
    "CalibratedAngle",
    "PitchSweep",
    "Provenance",
    "fit_sweep",
]

DEFAULT_ONBOARD_STD_DEG = 0.002
"""Noise of an onboard mean where the record's own cannot be evaluated [deg], 1 sigma."""

_MAX_DEGREE = 3
_SAME_ANGLE_DEG = 0.01  # the package's static accuracy: nearer angles are one angle of a sweep
_SAME_ANGLE_STDS = 5.0
_SIGNIFICANCE = 0.01
_PLAUSIBLE_SLOPE = (0.2, 5.0)  # a mix-up of degrees and radians gives 57 or 0.017
_MARGIN = 0.01  # of the width of the range: fields scatter about the sweep's last point

Floats = NDArray[np.float64]


class CalibratedAngle(NamedTuple):
    """What `PitchSweep.apply` makes of optical angles; all arrays have their shape.

    Attributes
    ----------
    angle_deg : ndarray
        Angle after calibration [deg].
    systematic_std_deg : ndarray
        Uncertainty of the calibration there, 1 sigma [deg]; averaging does not reduce it.
    outside : ndarray of bool
        Whether the optical angle lies outside the range of the sweep.
    """

    angle_deg: Floats
    systematic_std_deg: Floats
    outside: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class PitchSweep:
    r"""A calibration of the optical angle against the onboard sensor.

    .. math:: \alpha_{onboard} = \sum_k c_k t^k, \qquad
              t = (\alpha_{optical} - \alpha_{centre}) / h

    Attributes
    ----------
    coefficients_deg : ndarray [degree + 1]
        Coefficients :math:`c_k`, lowest power first [deg].
    covariance_deg2 : ndarray [degree + 1, degree + 1]
        Their covariance [deg^2], scatter beyond the stated uncertainties included.
    centre_deg, half_range_deg : float
        Centre and half width of the sweep's range of optical angle [deg].
    optical_deg, optical_std_deg : ndarray [point]
        Mean optical angles and their uncertainties, 1 sigma [deg].
    onboard_deg, onboard_std_deg : ndarray [point]
        Mean onboard angles and their uncertainties, 1 sigma [deg].
    chi_square : float
        Sum of squared residuals in units of their uncertainty, over both variables.
    onboard_accuracy_deg : float
        Error that all onboard angles share, 1 sigma [deg]; no number of points reduces it.
    criterion : mapping of int to float
        Corrected information criterion of each degree that was compared, relative to the
        least; empty where the degree was given.
    provenance : Provenance
        Files, setup and date the sweep came from.
    """

    coefficients_deg: Floats
    covariance_deg2: Floats
    centre_deg: float
    half_range_deg: float
    optical_deg: Floats
    optical_std_deg: Floats
    onboard_deg: Floats
    onboard_std_deg: Floats
    chi_square: float
    onboard_accuracy_deg: float = 0.0
    criterion: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    provenance: Provenance = field(default_factory=Provenance)

    @property
    def degree(self) -> int:
        """Degree of the polynomial."""
        return int(self.coefficients_deg.size - 1)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of points less number of coefficients."""
        return int(self.optical_deg.size - self.coefficients_deg.size)

    @property
    def reduced_chi_square(self) -> float | None:
        """Chi-square per degree of freedom; None where no point is to spare."""
        freedom = self.degrees_of_freedom
        return self.chi_square / freedom if freedom else None

    @property
    def range_deg(self) -> tuple[float, float]:
        """Least and greatest optical angle of the sweep [deg]."""
        return float(self.optical_deg.min()), float(self.optical_deg.max())

    @property
    def residuals_deg(self) -> Floats:
        """Onboard angle less calibrated optical angle [deg], as [point]."""
        return self.onboard_deg - self.predict(self.optical_deg)

    @property
    def residual_std_deg(self) -> Floats:
        """Stated uncertainty of the residuals from both angles, 1 sigma [deg], as [point]."""
        slope = self.derivative(self.optical_deg)
        return np.hypot(self.onboard_std_deg, slope * self.optical_std_deg)

    def predict(self, angle_deg: ArrayLike) -> Floats:
        """Return the calibrated angle [deg] for optical angles [deg], within the range or not."""
        t = self._scaled(angle_deg)
        return np.asarray(np.polynomial.polynomial.polyval(t, self.coefficients_deg), np.float64)

    def derivative(self, angle_deg: ArrayLike) -> Floats:
        """Return d onboard / d optical at optical angles [deg]; it scales a field's own noise."""
        slopes = np.polynomial.polynomial.polyder(self.coefficients_deg) / self.half_range_deg
        t = self._scaled(angle_deg)
        return np.asarray(np.polynomial.polynomial.polyval(t, slopes), np.float64)

    def apply(self, angle_deg: ArrayLike) -> CalibratedAngle:
        """Calibrate optical angles.

        Parameters
        ----------
        angle_deg : array_like
            Optical angles before calibration [deg]; NaN where nothing was measured.

        Returns
        -------
        CalibratedAngle
            Angle [deg], systematic uncertainty (1 sigma) [deg] and whether outside the range,
            in the shape of `angle_deg`. NaN stays NaN and is not outside.

        Notes
        -----
        The systematic uncertainty grows quickly outside the range, and still says nothing of
        powers that the sweep could not see: heed `outside`. A hundredth of the range's width
        is allowed on either side, since single fields scatter about the sweep's end points.
        """
        angle = np.asarray(angle_deg, np.float64)
        powers = np.polynomial.polynomial.polyvander(self._scaled(angle), self.degree)
        variance = np.einsum("...i,ij,...j->...", powers, self.covariance_deg2, powers)
        low, high = self.range_deg
        margin = _MARGIN * (high - low)
        return CalibratedAngle(
            self.predict(angle),
            np.sqrt(np.maximum(variance, 0.0) + self.onboard_accuracy_deg**2),
            np.asarray((angle < low - margin) | (angle > high + margin)),
        )

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the calibration as TOML, with units in the names and the points it came from.

        Parameters
        ----------
        path : str or Path
            The file; it appears under its name only when it is whole.
        overwrite : bool
            Whether a file of that name may be replaced.

        Raises
        ------
        OutputError
            If the file exists and `overwrite` is False, or it cannot be written.
        """
        content = SweepFile.model_validate(
            {
                "kind": "pitch sweep",
                "polynomial": {
                    "centre_deg": self.centre_deg,
                    "half_range_deg": self.half_range_deg,
                    "coefficients_deg": self.coefficients_deg.tolist(),
                    "covariance_deg2": self.covariance_deg2.tolist(),
                },
                "fit": {
                    "chi_square": self.chi_square,
                    "degrees_of_freedom": self.degrees_of_freedom,
                    "onboard_accuracy_deg": self.onboard_accuracy_deg,
                    "criterion": {str(degree): aicc for degree, aicc in self.criterion.items()},
                },
                "points": {
                    "optical_deg": self.optical_deg.tolist(),
                    "optical_std_deg": self.optical_std_deg.tolist(),
                    "onboard_deg": self.onboard_deg.tolist(),
                    "onboard_std_deg": self.onboard_std_deg.tolist(),
                },
                "provenance": self.provenance,
            }
        )
        write_sweep_file(Path(path), content, self._summary(), overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> "PitchSweep":
        """Read a calibration that `save` wrote.

        Parameters
        ----------
        path : str or Path
            The TOML file.

        Returns
        -------
        PitchSweep
            The same calibration, to the last bit.

        Raises
        ------
        CalibrationError
            If the file is missing, not TOML, or not a pitch sweep; the message names the key.
        """
        content = read_sweep_file(Path(path))
        return cls(
            coefficients_deg=np.array(content.polynomial.coefficients_deg),
            covariance_deg2=np.array(content.polynomial.covariance_deg2),
            centre_deg=content.polynomial.centre_deg,
            half_range_deg=content.polynomial.half_range_deg,
            optical_deg=np.array(content.points.optical_deg),
            optical_std_deg=np.array(content.points.optical_std_deg),
            onboard_deg=np.array(content.points.onboard_deg),
            onboard_std_deg=np.array(content.points.onboard_std_deg),
            chi_square=content.fit.chi_square,
            onboard_accuracy_deg=content.fit.onboard_accuracy_deg,
            criterion={int(degree): aicc for degree, aicc in content.fit.criterion.items()},
            provenance=content.provenance,
        )

    def _summary(self) -> str:
        low, high = self.range_deg
        ratio = self.reduced_chi_square
        fit = "no point to spare" if ratio is None else f"reduced chi-square {ratio:.2f}"
        return (
            f"Degree {self.degree}, {self.optical_deg.size} points from {low:.3f} to {high:.3f} "
            f"optical deg, {fit}, residuals {np.sqrt(np.mean(self.residuals_deg**2)):.4f} deg rms."
        )

    def _scaled(self, angle_deg: ArrayLike) -> Floats:
        return (np.asarray(angle_deg, np.float64) - self.centre_deg) / self.half_range_deg


def fit_sweep(
    optical_deg: ArrayLike,
    optical_std_deg: ArrayLike,
    onboard_deg: ArrayLike,
    onboard_std_deg: ArrayLike | None,
    *,
    degree: int | None = None,
    onboard_accuracy_deg: float = 0.0,
    provenance: Provenance | None = None,
) -> PitchSweep:
    r"""Fit onboard = p(optical) to a no-flow pitch sweep, with errors in both angles.

    The coefficients and the true optical angles :math:`\xi_i` minimise

    .. math:: \chi^2 = \sum_i \frac{(x_i - \xi_i)^2}{\sigma_{x,i}^2}
                     + \frac{(y_i - p(\xi_i))^2}{\sigma_{y,i}^2}

    which is the maximum likelihood for normal errors (Fuller, *Measurement Error Models*, 1987).
    A straight line is York's (Am. J. Phys. 72, 367, 2004).

    Parameters
    ----------
    optical_deg : array_like [point]
        Mean optical angle of each point of the sweep [deg].
    optical_std_deg : float or array_like [point]
        Uncertainty of these means, 1 sigma [deg].
    onboard_deg : array_like [point]
        Mean angle from the onboard sensor [deg].
    onboard_std_deg : float, array_like [point] or None
        Uncertainty of these means, 1 sigma, independent from point to point [deg];
        None takes `DEFAULT_ONBOARD_STD_DEG`.
    degree : int, optional
        Degree of the polynomial, 1 or more. By default the one of 1, 2 and 3 with the least
        corrected Akaike criterion that leaves points to spare.
    onboard_accuracy_deg : float
        Static accuracy of the onboard sensor, 1 sigma [deg]: an error that all points share.
        At 0 the calibrated angle's uncertainty is relative to the onboard sensor.
    provenance : Provenance, optional
        Files, setup and date, to be saved with the calibration.

    Returns
    -------
    PitchSweep
        The calibration. Where a chi-square test at 1 % says that the stated uncertainties
        cannot explain the scatter, the covariance is multiplied by the reduced chi-square
        (Birge's ratio); it is never reduced.

    Raises
    ------
    CalibrationError
        If the points do not determine the polynomial: too few, too few different angles, not
        finite, an uncertainty not greater than zero, or angles that cannot be the same motion.
    """
    points = _checked_points(optical_deg, optical_std_deg, onboard_deg, onboard_std_deg)
    x, _, y, _ = points
    if not (math.isfinite(onboard_accuracy_deg) and onboard_accuracy_deg >= 0):
        raise CalibrationError(
            f"onboard_accuracy_deg is {onboard_accuracy_deg}; give zero or more [deg]"
        )
    supported = _supported_degree(points, degree)
    low, high = float(x.min()), float(x.max())
    centre, half = (low + high) / 2, (high - low) / 2
    scaled = (x - centre) / half, points[1] / half, y, points[3]
    if degree is None:
        fits = {each: fit_polynomial(*scaled, each) for each in range(1, supported + 1)}
        criterion = corrected_criterion(fits, x.size)
        best = fits[min(criterion, key=criterion.__getitem__)] if criterion else fits[1]
    else:
        criterion, best = {}, fit_polynomial(*scaled, degree)
    _check_slope(best.coefficients, half)
    return PitchSweep(
        coefficients_deg=best.coefficients,
        covariance_deg2=best.covariance * _excess(best.chi_square, x.size - best.coefficients.size),
        centre_deg=centre,
        half_range_deg=half,
        optical_deg=x,
        optical_std_deg=points[1],
        onboard_deg=y,
        onboard_std_deg=points[3],
        chi_square=best.chi_square,
        onboard_accuracy_deg=onboard_accuracy_deg,
        criterion=criterion,
        provenance=provenance or Provenance(),
    )


def _checked_points(
    optical: ArrayLike, optical_std: ArrayLike, onboard: ArrayLike, onboard_std: ArrayLike | None
) -> tuple[Floats, Floats, Floats, Floats]:
    x = _numbers("optical_deg", optical)
    if x.ndim != 1 or x.size < 3:
        raise CalibrationError(
            f"a pitch sweep needs at least 3 points at different angles, got {x.size}; "
            "measure more points"
        )
    y = _like(x, "onboard_deg", onboard)
    sx = _like(x, "optical_std_deg", optical_std, may_broadcast=True)
    default = DEFAULT_ONBOARD_STD_DEG if onboard_std is None else onboard_std
    sy = _like(x, "onboard_std_deg", default, may_broadcast=True)
    for name, values in {"optical_deg": x, "onboard_deg": y}.items():
        _refuse_first(name, values, ~np.isfinite(values), "leave that point out or repeat it")
    for name, values in {"optical_std_deg": sx, "onboard_std_deg": sy}.items():
        bad = ~(np.isfinite(values) & (values > 0))
        _refuse_first(name, values, bad, "an uncertainty must be greater than zero")
    return x, sx, y, sy


def _numbers(name: str, values: ArrayLike) -> Floats:
    try:
        return np.array(values, np.float64)
    except (TypeError, ValueError):
        raise CalibrationError(f"{name} does not hold numbers only; give angles in deg") from None


def _like(x: Floats, name: str, values: ArrayLike, *, may_broadcast: bool = False) -> Floats:
    array = _numbers(name, values)
    if may_broadcast and array.ndim == 0:
        return np.full_like(x, float(array))
    if array.shape != x.shape:
        raise CalibrationError(
            f"{name} holds {array.size} values for {x.size} optical angles; give one for each point"
        )
    return array


def _refuse_first(name: str, values: Floats, bad: NDArray[np.bool_], advice: str) -> None:
    if bad.any():
        first = int(np.argmax(bad))
        raise CalibrationError(f"{name}[{first}] is {values[first]:g}; {advice}")


def _supported_degree(points: tuple[Floats, Floats, Floats, Floats], degree: int | None) -> int:
    x, sx, _, _ = points
    distinct = _count_angles(x, sx)
    if distinct < 2:
        raise CalibrationError(
            f"the pitch sweep holds one angle only (about {x.mean():.3f} deg); "
            "measure points over the range of angles to be calibrated"
        )
    if degree is None:
        to_spare = x.size - 3  # the criterion's correction needs two points more than coefficients
        return max(1, min(_MAX_DEGREE, distinct - 1, to_spare))
    if not isinstance(degree, int) or degree < 1:
        raise CalibrationError(f"degree is {degree}; give 1 for a straight line, or more")
    if distinct < degree + 1:
        raise CalibrationError(
            f"a polynomial of degree {degree} needs {degree + 1} different angles, the pitch "
            f"sweep holds {distinct}; choose a lower degree or measure more angles"
        )
    return degree


def _count_angles(x: Floats, sx: Floats) -> int:
    order = np.argsort(x)
    count, last = 0, -np.inf
    for angle, std in zip(x[order], sx[order], strict=True):
        if angle - last > max(_SAME_ANGLE_DEG, _SAME_ANGLE_STDS * std):
            count, last = count + 1, angle
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
