"""The no-flow pitch sweep: optical angle against the onboard sensor's.

The reflection of a lamp at finite distance, a known Y that is wrong and a camera that is turned
change the scale of the optical angle and bend it a little. With no flow the onboard sensor gives
the angle itself, so a sweep over pitch gives the polynomial onboard = p(optical) that takes all
of this out; one for each tunnel temperature, with interpolation between.
"""

import math
from collections.abc import Sequence

from numpy.typing import ArrayLike

from calibration.sweep._file import Provenance
from calibration.sweep._hysteresis import Hysteresis
from calibration.sweep.curve import SweepCurve, fit_curves
from calibration.sweep.pitch_sweep import CalibratedAngle, PitchSweep
from calibration.sweep.point import (
    DEFAULT_ONBOARD_STD_DEG,
    SweepPoint,
    check_no_duplicates,
    in_order_of_time,
    sweep_points,
)
from calibration.sweep.setup import SweepSetup
from calibration.sweep.temperatures import temperature_groups
from glint_aoa.errors import CalibrationError

__all__ = [
    "DEFAULT_ONBOARD_STD_DEG",
    "CalibratedAngle",
    "Hysteresis",
    "PitchSweep",
    "Provenance",
    "SweepCurve",
    "SweepPoint",
    "SweepSetup",
    "fit_sweep",
    "fit_sweep_points",
    "sweep_points",
]


def fit_sweep_points(
    points: Sequence[SweepPoint],
    *,
    degree: int | None = None,
    onboard_accuracy_deg: float = 0.0,
    setup: SweepSetup | None = None,
    provenance: Provenance | None = None,
) -> PitchSweep:
    r"""Fit onboard = p(optical) to no-flow pitch sweeps, with errors in both angles.

    The coefficients and the true optical angles :math:`\xi_i` minimise

    .. math:: \chi^2 = \sum_i \frac{(x_i - \xi_i)^2}{\sigma_{x,i}^2}
                     + \frac{(y_i - p(\xi_i))^2}{\sigma_{y,i}^2}

    which is the maximum likelihood for normal errors (Fuller, *Measurement Error Models*, 1987).
    A straight line is York's (Am. J. Phys. 72, 367, 2004).

    Parameters
    ----------
    points : sequence of SweepPoint
        The points. Those whose temperatures follow each other within 2 K are of one sweep; their
        order is that of their times, or the one given where a time is unknown.
    degree : int, optional
        Degree of the polynomials, 1 or more. By default the one of 1, 2 and 3 with the least
        corrected Akaike criterion over all sweeps that leaves points to spare.
    onboard_accuracy_deg : float
        Static accuracy of the onboard sensor, 1 sigma [deg]: an error that all points share.
        At 0 the calibrated angle's uncertainty is relative to the onboard sensor.
    setup : SweepSetup, optional
        What the optical angles were measured with.
    provenance : Provenance, optional
        Files, setup and date, to be saved with the calibration.

    Returns
    -------
    PitchSweep
        The calibration. Points off the curve are left out and named. Where a chi-square test at
        1 % says that the stated uncertainties cannot explain the scatter, the covariance is
        multiplied by the reduced chi-square (Birge's ratio); it is never reduced.

    Raises
    ------
    CalibrationError
        If the points do not determine the polynomials: too few, too few different angles, a point
        given twice, or angles that cannot be the same motion.
    """
    if not (math.isfinite(onboard_accuracy_deg) and onboard_accuracy_deg >= 0):
        raise CalibrationError(
            f"onboard_accuracy_deg is {onboard_accuracy_deg}; give zero or more [deg]"
        )
    check_no_duplicates(points)
    groups = [in_order_of_time(group) for group in _by_temperature(points)]
    return PitchSweep(
        curves=fit_curves(groups, degree=degree),
        onboard_accuracy_deg=onboard_accuracy_deg,
        setup=setup,
        provenance=provenance or Provenance(),
    )


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
    """Fit a pitch sweep at one temperature that is given as arrays [point] in the order of time.

    Parameters
    ----------
    optical_deg, optical_std_deg, onboard_deg, onboard_std_deg
        As for `sweep_points`.
    degree, onboard_accuracy_deg, provenance
        As for `fit_sweep_points`.

    Returns
    -------
    PitchSweep
        The calibration.

    Raises
    ------
    CalibrationError
        As for both.
    """
    return fit_sweep_points(
        sweep_points(optical_deg, optical_std_deg, onboard_deg, onboard_std_deg),
        degree=degree,
        onboard_accuracy_deg=onboard_accuracy_deg,
        provenance=provenance,
    )


def _by_temperature(points: Sequence[SweepPoint]) -> list[list[SweepPoint]]:
    known = [point for point in points if point.temperature_k is not None]
    groups = temperature_groups([p.temperature_k for p in known if p.temperature_k is not None])
    if len(groups) < 2:
        return [list(points)]
    silent = next((point for point in points if point.temperature_k is None), None)
    if silent is not None:
        raise CalibrationError(
            f"{silent.name} does not say its tunnel temperature, and the others were taken at "
            f"{len(groups)} temperatures; give tunnel_temperature_K in its /meta or leave it out"
        )
    return [[known[number] for number in group] for group in groups]
