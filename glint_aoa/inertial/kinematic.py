"""The kinematic correction: centripetal acceleration is velocity times angular rate.

No modal test and no radii: two or more accelerometers a plane at different stations show how the
model moves as a rigid body, and with it every mode and every product of modes.

With u the package's velocity along model x, v and w across it in yaw and pitch, p and q the rates
of turning in yaw (nose to port) and in pitch (nose up), the package senses along model x

    f_x = g sin(alpha) + u' - v p - w q.

The products are the bias (for a single mode, v = rho p: V^2 / rho, eq. 7 of the paper) and are
added back. u vanishes for any single mode; of two modes r and s it holds
(rho_r - rho_s) theta_s theta_r', whose derivative is of the order of the products where it is
fast, but leaves the mean and, below the low-pass's 0.4 Hz, is smaller by the ratio of the beat to
the modes' own frequency. It cannot be told from a change of angle and is left in; so is the second
order of gravity, g sin(alpha) theta^2 / 2, under 0.0001 deg at 0.3 deg of vibration and 10 deg of
pitch. Roll rate enters in third order.

v and w are corrected for the tilt of the accelerometers in gravity (`motion`).

Where it fails: gains count in full (1 % on one of three accelerometers costs 1 % of the bias, on
the foremost of two 2 %), directions do where both planes move at one frequency, and a fuselage
that bends is no rigid body; motion below the band is not seen.
"""

from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.flags import Flag
from glint_aoa.inertial.channels import stations_missing
from glint_aoa.inertial.estimate import BiasEstimate, CorrectionTask
from glint_aoa.inertial.filters import low_pass
from glint_aoa.inertial.modes import PLANES, Mode, Plane
from glint_aoa.inertial.motion import PlaneMotion, plane_motions
from glint_aoa.units import STANDARD_GRAVITY

__all__ = ["BRIDGE_STD", "estimate_bias", "missing"]

_Floats = NDArray[np.float64]

_SETTLING_S = 1.0
"""The lower flank of the integration's band, 4 Hz wide, remembers four periods of that."""

BRIDGE_STD = 0.1
"""Of what bridging restored, 1 sigma, besides the noise: peaks that all clipped are learnt from
what did not."""

_MODE_BAND = 0.08  # half-width over frequency: a resonance and its modulation
_STANDS_OUT = 0.02  # of the plane's power of turning: less tells nothing of a mode's radius
_COHERENT = 0.9  # of velocity and turning in the band of a mode: it moves about one point
_CONTRADICTION = 0.25  # relative to the radius, besides three standard deviations
_STILL = 1e-20  # (rad/s)^2
_NOT_RIGID = 3.0  # times the misfit that gains explain


def missing(task: CorrectionTask) -> str | None:
    """Say what the method lacks, or None if it can be used.

    Parameters
    ----------
    task : CorrectionTask
        Record, package output and modes.

    Returns
    -------
    str or None
        The missing channels, as the end of a sentence. Both planes are needed, or the one that
        has modes if the setup lists modes in one plane only.
    """
    lacking = [stations_missing(task.record, plane, task.package) for plane in _planes(task)]
    each_once = dict.fromkeys(lack for lack in lacking if lack is not None)
    return " and ".join(each_once) or None


def estimate_bias(task: CorrectionTask) -> BiasEstimate:
    """Estimate the bias of the package's output from its velocity and rate of turning.

    Parameters
    ----------
    task : CorrectionTask
        A record with two or more accelerometers a plane at different stations.

    Returns
    -------
    BiasEstimate
        v p + w q [m/s^2] and its error terms: gain of each accelerometer (`relative_std`), its
        misalignment towards the other plane (`misalignment_std`), and the bridging of clipped or
        missing samples. `settings` holds the point of rotation found for each mode.

    Raises
    ------
    RecordingError
        If so many samples of a plane's accelerometers are clipped or missing that fewer than two
        stations remain.

    Notes
    -----
    The estimate is good from one second off the record's ends: before and after them the
    vibration is continued by its mirror image. An accelerometer that senses part of the axial
    motion does not matter: that has twice the frequency and a hundredth of the size. Noise of the
    accelerometers has no term: after multiplication it lies in the corrected signal just above the
    low-pass's cutoff too, where `correct` reads the noise.
    """
    sine = low_pass(task.package.specific_force, task.package.channel.rate_hz, task.filter)
    sine = np.clip(sine / STANDARD_GRAVITY, -1.0, 1.0)
    motions = plane_motions(task, _planes(task), sine)
    radii = [each for plane in motions for each in _radii(task, plane, motions[plane])]
    notes = [note for plane, motion in motions.items() for note in _notes(plane, motion)]
    notes += _contradictions(radii)
    terms = [term for motion in motions.values() for term in _error_terms(task, motion)]
    return BiasEstimate(
        addition=np.sum([motion.velocity * motion.rate for motion in motions.values()], axis=0),
        std_terms=[term for term in terms if np.any(term)],
        channels=(),
        settling_s=_SETTLING_S,
        why="; ".join([_why(motions), *notes]),
        settings={
            "relative_std": task.relative_std,
            "misalignment_std_deg": float(np.degrees(task.misalignment_std)),
            "measured_radii_m": {each.mode.number: each.radius_m for each in radii},
            "measured_radii_std_m": {each.mode.number: each.std_m for each in radii},
            "misfit": {plane: motion.misfit for plane, motion in motions.items()},
        },
        flags=np.bitwise_or.reduce([_flags(motion) for motion in motions.values()]),
    )


def _planes(task: CorrectionTask) -> list[Plane]:
    listed = {mode.plane for mode in task.modes}
    return [plane for plane in PLANES if not listed or plane in listed]


def _error_terms(task: CorrectionTask, motion: PlaneMotion) -> list[_Floats]:
    """Gains, directions and bridging; more than gains where the sensors contradict each other."""
    gain_std = task.relative_std * (motion.misfit if motion.misfit > _NOT_RIGID else 1.0)
    return [
        *(gain_std * motion.velocities * motion.sensitivity),
        *(motion.foreign * motion.sensitivity),
        *_bridging_terms(motion),
    ]


def _bridging_terms(motion: PlaneMotion) -> list[_Floats]:
    """Return what was restored of each sensor, and draws of what all may have been instead."""
    sensitive = [(repair, motion.sensitivity[repair.sensor]) for repair in motion.repairs]
    if not sensitive:
        return []
    draws = np.sum([repair.draws * sensitivity for repair, sensitivity in sensitive], axis=0)
    restored = [BRIDGE_STD * repair.restored * sensitivity for repair, sensitivity in sensitive]
    return [*restored, *(draws / np.sqrt(len(draws)))]


@dataclass(frozen=True)
class _Radius:
    """Distance from a mode's point of rotation forward to the package [m], and its std."""

    mode: Mode
    radius_m: float
    std_m: float

    @property
    def contradicts(self) -> bool:
        apart = abs(self.radius_m - self.mode.radius_m)
        return apart > 3 * self.std_m + _CONTRADICTION * abs(self.mode.radius_m)


def _radii(task: CorrectionTask, plane: Plane, motion: PlaneMotion) -> list[_Radius]:
    """Regress velocity on rate around each mode that turns the model about one point."""
    rate_hz = task.package.channel.rate_hz
    window = scipy.signal.windows.hann(motion.rate.size, sym=False)
    velocity, rate = (scipy.fft.rfft(window * each) for each in (motion.velocity, motion.rate))
    bins = scipy.fft.rfftfreq(motion.rate.size, 1 / rate_hz)
    turning = np.abs(rate) ** 2
    ahead = np.array([sensor.ahead_m for sensor in motion.sensors])
    seen = np.sqrt(np.mean(motion.foreign**2, axis=1) / max(np.mean(motion.rate**2), _STILL))
    found = []
    for mode in (mode for mode in task.modes if mode.plane == plane):
        inside = np.abs(bins - mode.frequency_hz) <= _MODE_BAND * mode.frequency_hz
        power, cross = np.sum(turning[inside]), np.vdot(rate[inside], velocity[inside])
        moving = np.sum(np.abs(velocity[inside]) ** 2)
        if not power > _STANDS_OUT * np.sum(turning):
            continue
        radius = float(cross.real / power)
        gains = (motion.weights[0] - radius * motion.weights[1]) * (radius + ahead)
        foreign = (motion.weights[0] - radius * motion.weights[1]) * seen
        std = float(np.sqrt(np.sum((task.relative_std * gains) ** 2 + foreign**2)))
        one_point = cross.real**2 >= _COHERENT * power * (moving + power * std**2)
        if one_point or abs(radius) < 3 * std:
            found.append(_Radius(mode, radius, std))
    return found


def _flags(motion: PlaneMotion) -> NDArray[np.int64]:
    clipped = np.where(motion.clipped, int(Flag.CLIPPED_CHANNEL), 0)
    return np.asarray(clipped | np.where(motion.lost, int(Flag.GAP), 0), np.int64)


def _why(motions: dict[Plane, PlaneMotion]) -> str:
    parts = [
        f"{', '.join(sensor.channel.name for sensor in motion.sensors)} ({plane})"
        for plane, motion in motions.items()
    ]
    return f"kinematic correction from {' and '.join(parts)}"


def _notes(plane: Plane, motion: PlaneMotion) -> list[str]:
    """Say what is not as it should be."""
    notes = []
    if motion.left_out:
        notes.append(
            f"{' and '.join(motion.left_out)} left out: too many samples clipped or missing"
        )
    if motion.misfit > _NOT_RIGID:
        notes.append(
            f"the {plane} accelerometers contradict a rigid body by {motion.misfit:.0f} times "
            "what their gains and directions explain"
        )
    return notes


def _contradictions(radii: list[_Radius]) -> list[str]:
    return [
        f"at {each.mode.frequency_hz:g} Hz the model turns about a point {each.radius_m:.3g} m aft "
        f"of the package, where mode {each.mode.number} of the setup has {each.mode.radius_m:.3g} m"
        for each in radii
        if each.contradicts
    ]
