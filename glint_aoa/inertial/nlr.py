"""The correction of the National Aerospace Laboratory (NLR): one mode a plane.

The tangential acceleration is integrated, squared, divided by an adjustable radius and added to
the package's output before the low-pass (paper, section "Bias Error Correction"). The radius was
tuned by a potentiometer while the model was shaken by hand; `tune` does that by regression.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.inertial.channels import Accelerometer, tangential, tangential_missing
from glint_aoa.inertial.estimate import BiasEstimate, CorrectionTask
from glint_aoa.inertial.filters import integrate_band
from glint_aoa.inertial.lateral import sensor_per_accelerometer, tipping_m
from glint_aoa.inertial.modes import CREDIBLE_TURN, PLANES, Mode, Plane
from glint_aoa.inertial.record_fit import regress

__all__ = ["TunedRadius", "estimate_bias", "missing", "tune"]

_Floats = NDArray[np.float64]

_LOWEST = 0.5  # of the mode's frequency: below is drift
_HIGHEST_HZ = 60.0
_OWN_BAND = 0.15  # of the mode's frequency: what counts as its motion

_SIGNIFICANT = 3.0  # standard errors


@dataclass(frozen=True)
class TunedRadius:
    """Effective radius of the mode of a plane, from the record of a shaken model.

    Attributes
    ----------
    plane : {"yaw", "pitch"}
        Plane of the motion.
    frequency_hz : float
        Frequency of the mode [Hz].
    radius_m : float
        Effective radius [m]; negative with the point of rotation ahead of the package.
    radius_std_m : float
        Its standard error, 1 sigma [m]; gains of the accelerometer and of the package are not in
        it, and need not be: the radius makes up for them.
    explained : float
        Fraction of the variance of the filtered angle that follows V^2.
    """

    plane: Plane
    frequency_hz: float
    radius_m: float
    radius_std_m: float
    explained: float


def missing(task: CorrectionTask) -> str | None:
    """Say what the method lacks, or None if it can be used.

    Parameters
    ----------
    task : CorrectionTask
        Record, package output and modes.

    Returns
    -------
    str or None
        The missing channels or modes, as the end of a sentence.
    """
    modes = _modes(task)
    if not modes:
        return "the mode of each plane: list it as [[inertial.mode]] in the setup"
    return tangential_missing(task.record, [mode.plane for mode in modes], task.package)


def estimate_bias(task: CorrectionTask) -> BiasEstimate:
    """Estimate the bias from the lowest mode of each plane.

    Parameters
    ----------
    task : CorrectionTask
        A record with an accelerometer on the package for each plane that has a mode.

    Returns
    -------
    BiasEstimate
        V^2 / rho of all motion between half the mode's frequency and 60 Hz, [m/s^2]. Error terms:
        the radius, and motion more than 15 % away from the mode's frequency.

    Notes
    -----
    Motion in other modes of the plane is divided by the wrong radius; the paper calls this the
    method's limit. Where the setup lists them, their radii bound the error; where not, a turning
    of 1 deg does, and the result is flagged for all but small motion.
    """
    addition, terms = np.zeros(len(task.package.channel)), []
    channels, parts = [], []
    for mode in _modes(task):
        sensor = tangential(task.record, mode.plane, task.package)
        if sensor is not None:
            own_addition, own_terms = _plane_bias(task, mode, sensor)
            addition += own_addition
            terms += own_terms
            channels.append(sensor.channel)
            parts.append(f"mode {mode.number} in {sensor.channel.name}")
    return BiasEstimate(
        addition=addition,
        std_terms=terms,
        channels=tuple(channels),
        settling_s=1.0,
        why=f"NLR's correction, one mode a plane: {' and '.join(parts)}",
        settings={
            "relative_std": task.relative_std,
            "radii_m": {mode.number: mode.radius_m for mode in _modes(task)},
        },
    )


def tune(
    task: CorrectionTask, plane: Plane, *, between_s: tuple[float, float] | None = None
) -> TunedRadius:
    """Find the radius of a plane's mode from a record of the model shaken by hand.

    Parameters
    ----------
    task : CorrectionTask
        A record of at least 10 s in which the vibration grows and fades, at a fixed attitude; its
        modes are not used.
    plane : {"yaw", "pitch"}
        Plane in which the model was shaken.
    between_s : (float, float), optional
        First and last time to use [s].

    Returns
    -------
    TunedRadius
        From the regression of the filtered output on V^2.

    Raises
    ------
    InputError
        If no accelerometer along the plane's axis is recorded.
    RecordingError
        If the record is too short, or no bias is seen to follow the motion.
    """
    found = regress(task, source="acceleration", planes=(plane,), between_s=between_s)
    coefficient = float(found.fit.coefficient[0]) if found.terms else 0.0
    std = float(found.fit.coefficient_std[0]) if found.terms else np.inf
    if not abs(coefficient) > _SIGNIFICANT * std:
        raise RecordingError(
            f"{task.record.name}: the output does not follow the motion in {plane}; shake the "
            "model harder, several times, and let it come to rest between"
        )
    term = found.terms[0]
    station, own = term.signal.channel.station_m, task.package.channel.station_m
    ahead = station - own if station is not None and own is not None else 0.0
    frequency = term.resonance.frequency_hz
    force = float(np.mean(task.package.specific_force))
    longer = ahead + tipping_m(frequency, force)
    radius = _radius(-coefficient, longer)
    return TunedRadius(
        plane, frequency, radius, std / coefficient**2, explained=found.fit.explained
    )


def _radius(inverse: float, longer_m: float) -> float:
    """Solve rho / (rho + e)^2 = inverse for the root that is 1 / inverse where e is 0."""
    product = inverse * longer_m
    return float((1 - 2 * product + np.sqrt(max(1 - 4 * product, 0.0))) / (2 * inverse))


def _modes(task: CorrectionTask) -> list[Mode]:
    """Lowest mode of each plane."""
    return [
        next(mode for mode in task.modes if mode.plane == plane)
        for plane in PLANES
        if any(mode.plane == plane for mode in task.modes)
    ]


def _plane_bias(
    task: CorrectionTask, mode: Mode, sensor: Accelerometer
) -> tuple[_Floats, list[_Floats]]:
    rate_hz, centre = sensor.channel.rate_hz, mode.frequency_hz
    force = float(np.mean(task.package.specific_force))
    ratio = sensor_per_accelerometer(mode, centre, ahead_m=sensor.ahead_m, force=force)
    highest = max(min(_HIGHEST_HZ, 0.4 * rate_hz), 1.5 * centre)
    whole = ratio * integrate_band(
        sensor.acceleration, rate_hz, low_hz=_LOWEST * centre, high_hz=highest
    )
    own = ratio * integrate_band(
        sensor.acceleration,
        rate_hz,
        low_hz=(1 - _OWN_BAND) * centre,
        high_hz=(1 + _OWN_BAND) * centre,
    )
    addition = whole**2 / mode.radius_m
    terms = [task.relative_std * addition, *_foreign(task, mode, own, whole - own, rate_hz)]
    return addition, terms


def _foreign(
    task: CorrectionTask, mode: Mode, own: _Floats, other: _Floats, rate_hz: float
) -> list[_Floats]:
    """Error terms of motion that is not the mode's."""
    others = [each for each in task.modes if each.plane == mode.plane and each != mode]
    if others:
        wrong = max(abs(1 / each.radius_m) for each in others) + abs(1 / mode.radius_m)
        return [wrong * other**2, wrong * own * other]
    speed = float(np.sqrt(np.mean(other**2)))
    if speed == 0:
        return []
    circular = float(np.sqrt(np.mean((np.diff(other) * rate_hz) ** 2))) / speed
    return [CREDIBLE_TURN * circular * np.abs(other)]
