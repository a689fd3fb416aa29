"""The vibration of one plane from its accelerometers, and how it hangs on what is not known.

Accelerometers at distances d ahead of the package sense f = v' + p' d - g sin(alpha) theta, with v
the package's velocity across its axis, p the rate of turning and theta its angle. At two stations
or more, heave and turning of the rigid model are the plane's coordinates. At one station each
resonance is a coordinate of its own; it turns the model by the inverse of its radius, which is
unknown then and learnt from video and package.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.fusion.oscillators import (
    BAND_HZ,
    STATES,
    Coordinate,
    Oscillators,
    fit_coordinate,
)
from glint_aoa.fusion.smoother import Beliefs, Measurements, Smoothed, smooth
from glint_aoa.inertial.channels import Accelerometer, PackageOutput, accelerometers, tangential
from glint_aoa.inertial.lateral import Resonance, resonances
from glint_aoa.inertial.modes import Mode, Plane
from glint_aoa.inertial.motion import rigid_weights
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.units import STANDARD_GRAVITY

__all__ = [
    "Motion",
    "PlaneSignals",
    "PlaneVibration",
    "Unknown",
    "motion_of",
    "motion_rows",
    "plane_signals",
    "sensed",
    "vibration",
]

_Floats = NDArray[np.float64]
_Mask = NDArray[np.bool_]

_LEAST_BASELINE_M = 0.05
_MOST_USELESS = 0.5  # of an accelerometer's samples
_NOISE_BAND = (0.125, 0.475)  # times the rate: above the vibration
_OFFSET_STD = 0.5  # m/s^2, what is left of an accelerometer's zero once its mean is off
_LEAST_STATIONS = 2  # show a rigid body; more can contradict each other
_UNKNOWN_TURN = 10.0  # 1/m: radii from a tenth of a metre up
_RADIUS_STD = 0.1  # of a radius in the setup that states no uncertainty, relative
_SAME_MODE = 0.05  # of the frequency
_QUIETEST = 1e-12  # m^2/s^4


@dataclass(frozen=True)
class Unknown:
    """A constant that is not known: its name, standard deviation and mean before the record."""

    name: str
    std: float
    mean: float = 0.0


@dataclass(frozen=True, eq=False)
class PlaneSignals:
    """Accelerometers of one plane and the coordinates that they show.

    Attributes
    ----------
    plane : {"yaw", "pitch"}
        The plane.
    sensors : list of Accelerometer
        From the foremost back.
    signals : ndarray [sensor, sample]
        Without their means; straight lines over what was clipped or lost [m/s^2].
    usable : ndarray [sensor, sample]
        Whether a sample was measured.
    noise : ndarray [sensor]
        Variances of their white noise [m^2/s^4].
    weights : ndarray [2, sensor]
        What takes the signals to heave and turning; of one sensor, to heave alone.
    coordinates : tuple of Coordinate
        Of the plane's motion.
    turns : tuple of Unknown
        Inverse radii about the accelerometer, one a coordinate; empty with two stations or more.
    resonances : list of Resonance
        Found in the turning, or the only signal.
    """

    plane: Plane
    sensors: list[Accelerometer]
    signals: _Floats
    usable: _Mask
    noise: _Floats
    weights: _Floats
    coordinates: tuple[Coordinate, ...]
    turns: tuple[Unknown, ...]
    resonances: list[Resonance]

    @property
    def ahead_m(self) -> _Floats:
        """Distances of the sensors ahead of the package [m]."""
        return np.array([sensor.ahead_m for sensor in self.sensors])

    def turned(self, changes: Sequence[float]) -> "PlaneSignals":
        """Start from other turns: those that a first fusion found, as changes [1/m]."""
        ahead, coordinates, turns = float(self.ahead_m[0]), [], []
        for each, unknown, change in zip(self.coordinates, self.turns, changes, strict=True):
            turn = each.turning + change
            coordinates.append(replace(each, heave=1.0 - ahead * turn, turning=turn))
            turns.append(replace(unknown, mean=unknown.mean - change))
        return replace(self, coordinates=tuple(coordinates), turns=tuple(turns))

    @property
    def clipped(self) -> _Mask:
        """Whether a sensor was clipped [sample]."""
        return np.asarray(np.any([sensor.channel.clipped for sensor in self.sensors], axis=0))

    @property
    def lost(self) -> _Mask:
        """Whether a sample of a sensor was missing [sample]."""
        missing = [s.channel.bridged | ~np.isfinite(s.acceleration) for s in self.sensors]
        return np.asarray(np.any(missing, axis=0))

    def felt(self, ahead_m: _Floats) -> _Floats:
        """Acceleration [station, sample] at distances ahead of the package [m/s^2]."""
        heave, turning = self.weights @ self.signals
        return np.asarray(heave + np.multiply.outer(ahead_m, turning))


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion in a plane; columns: value with all unknowns zero, then what to take off for each.

    Attributes
    ----------
    angle, rate, velocity : ndarray [sample, 1 + unknown]
        Of the model [rad, rad/s] and of the package [m/s].
    angle_variance : ndarray [sample]
        Of the angle, the unknowns given [rad^2].
    coordinates : ndarray [turn, 2, sample]
        Displacement and rate of the coordinates whose turn is unknown.
    """

    angle: _Floats
    rate: _Floats
    velocity: _Floats
    angle_variance: _Floats
    coordinates: _Floats


@dataclass(frozen=True, eq=False)
class PlaneVibration:
    """Smoothed vibration of a plane, and what is known of its accelerometers.

    Attributes
    ----------
    signals : PlaneSignals
        Where it comes from.
    unknowns : list of Unknown
        Gains, directions and offsets of the sensors, then the turns.
    beliefs : Beliefs
        Of the unknowns, from the accelerometers alone.
    motion : Motion
        Its motion.
    consistency : dict of str to float
        By accelerometer.
    normal : (ndarray [unknown, unknown], ndarray [unknown])
        What the accelerometers by themselves say of the unknowns, the size of the motion included.
    """

    signals: PlaneSignals
    unknowns: list[Unknown]
    beliefs: Beliefs
    motion: Motion
    consistency: dict[str, float]
    normal: tuple[_Floats, _Floats]


def plane_signals(
    record: AcquisitionRecord, plane: Plane, package: PackageOutput, modes: Sequence[Mode]
) -> PlaneSignals | None:
    """Take a plane's accelerometers and find its coordinates.

    Returns
    -------
    PlaneSignals or None
        None if the record has no accelerometer in the plane.

    Raises
    ------
    RecordingError
        If a channel is no acceleration, or half of the samples of all are clipped or missing.
    """
    found = accelerometers(record, plane, package)
    if not found:
        nearest = tangential(record, plane, package)
        found = [] if nearest is None else [nearest]
    if not found:
        return None
    whole = [each for each in found if np.mean(~_usable(each)) <= _MOST_USELESS]
    if not whole:
        raise RecordingError(
            f"{record.name}: half of the samples of {found[0].channel.name} or more are clipped or "
            f"missing, and {plane} has no better accelerometer; record with a wider range"
        )
    if whole[0].ahead_m - whole[-1].ahead_m < _LEAST_BASELINE_M:
        whole = [min(whole, key=lambda each: abs(each.ahead_m))]
    rate_hz = package.channel.rate_hz
    usable = np.array([_usable(each) for each in whole])
    signals = np.array([_filled(each, good) for each, good in zip(whole, usable, strict=True)])
    noise = np.array([_noise(each, rate_hz) for each in signals])
    if len(whole) > 1:
        weights = rigid_weights(np.array([each.ahead_m for each in whole]), np.sqrt(noise))
        coordinates = _rigid(weights, signals, noise, rate_hz)
        seen = resonances(weights[1] @ signals, rate_hz)
        turns: tuple[Unknown, ...] = ()
    else:
        weights = np.array([[1.0], [0.0]])
        seen = resonances(signals[0], rate_hz)
        coordinates, turns = _modal(
            whole[0].ahead_m, plane, signals[0], noise[0], seen, modes, rate_hz
        )
    return PlaneSignals(plane, whole, signals, usable, noise, weights, coordinates, turns, seen)


def vibration(
    own: PlaneSignals,
    other: PlaneSignals | None,
    *,
    sine: float,
    rate_hz: float,
    gain_std: float,
    misalignment_std: float,
) -> PlaneVibration:
    """Smooth a plane's vibration from its accelerometers alone.

    Of the unknowns only the offsets are learnt here, and gains and directions as far as more than
    two accelerometers contradict each other: the size of the motion must not speak for a gain.

    Parameters
    ----------
    own, other : PlaneSignals
        Of the plane, and of the other one, which a crooked accelerometer senses too.
    sine : float
        Of the slow pitch angle, for the tilt of the accelerometers in gravity.
    rate_hz : float
        Samples a second [Hz].
    gain_std, misalignment_std : float
        Of the accelerometers, 1 sigma [relative, rad].
    """
    count = len(own.sensors)
    names = [sensor.channel.name for sensor in own.sensors]
    unknowns = [
        *(Unknown(f"gain of {name}", gain_std) for name in names),
        *(Unknown(f"direction of {name}", misalignment_std) for name in names),
        *(Unknown(f"offset of {name}", _OFFSET_STD) for name in names),
        *own.turns,
    ]
    std = np.array([each.std for each in unknowns])
    prior = Beliefs(np.array([each.mean for each in unknowns]), np.diag(std**2))
    offsets = np.zeros(std.size, bool)
    offsets[2 * count : 3 * count] = True
    model = Oscillators(own.coordinates, rate_hz)
    found = smooth(
        model,
        sensed(own, other, model, sine=sine, size=std.size, informs=offsets),
        _compared(own, other, prior),
        samples=own.signals.shape[1],
        seen=motion_rows(own, model),
    )
    return PlaneVibration(
        own,
        unknowns,
        found.unknowns,
        motion_of(own, found),
        found.consistency,
        found.normal,
    )


def motion_rows(own: PlaneSignals, model: Oscillators) -> _Floats:
    """Combine a model's states as `motion_of` takes them; the slow angle is in the first."""
    angle = model.row(0, turning=1.0)
    if model.drift is not None:
        angle[-1] = 1.0
    rows = [angle, model.row(1, turning=1.0), model.row(1, heave=1.0)]
    for index in range(len(own.turns)):
        rows += list(np.eye(model.size)[STATES * index : STATES * index + 2])
    return np.array(rows)


def motion_of(own: PlaneSignals, found: Smoothed) -> Motion:
    """Turn what the smoother found for `motion_rows` into a motion; turns enter it directly."""
    angle, rate, velocity = np.moveaxis(found.columns[:, :3], 1, 0).copy()
    states = found.columns[:, 3:, 0] - found.columns[:, 3:, 1:] @ found.unknowns.mean
    coordinates = states.T.reshape(len(own.turns), 2, len(found.columns))
    for index, (displacement, speed) in enumerate(coordinates):
        column = 1 + 3 * len(own.sensors) + index
        angle[:, column] -= displacement
        rate[:, column] -= speed
        velocity[:, column] += own.sensors[0].ahead_m * speed
    return Motion(angle, rate, velocity, found.spread[:, 0, 0], coordinates)


def sensed(
    own: PlaneSignals,
    other: PlaneSignals | None,
    model: Oscillators,
    *,
    sine: float,
    size: int,
    informs: _Mask,
) -> list[Measurements]:
    """Give the accelerometers' samples as measurements of a model's states.

    Parameters
    ----------
    own, other, sine
        As for `vibration`.
    model : Oscillators
        With the coordinates of `own` first.
    size : int
        Number of unknowns, those of the plane first.
    informs : ndarray [size] of bool
        Which of them may be learnt.
    """
    count, samples = own.signals.shape
    across = np.zeros_like(own.signals) if other is None else other.felt(own.ahead_m)
    along = own.felt(own.ahead_m)
    found = []
    for index, sensor in enumerate(own.sensors):
        regressors = np.zeros((samples, size))
        regressors[:, index] = along[index]
        regressors[:, count + index] = across[index]
        regressors[:, 2 * count + index] = 1.0
        tilt = STANDARD_GRAVITY * sine * model.row(0, turning=1.0)
        good = np.flatnonzero(own.usable[index])
        found.append(
            Measurements(
                source=sensor.channel.name,
                sample=good,
                rows=(model.row(2, heave=1.0, turning=sensor.ahead_m) - tilt)[None],
                kind=np.zeros(good.size, np.int64),
                value=own.signals[index, good],
                regressors=regressors[good],
                variance=np.full(good.size, own.noise[index]),
                informs=informs,
            )
        )
    return found


def _compared(own: PlaneSignals, other: PlaneSignals | None, prior: Beliefs) -> Beliefs:
    """Learn of gains and directions where the accelerometers contradict a rigid body."""
    count = len(own.sensors)
    if count <= _LEAST_STATIONS:
        return prior
    line = np.stack([np.ones(count), own.ahead_m])
    beyond = scipy.linalg.null_space(line).T
    whole = own.usable.all(axis=0)
    across = np.zeros_like(own.signals) if other is None else other.felt(own.ahead_m)
    information, pull = np.zeros_like(prior.covariance), np.zeros_like(prior.mean)
    weight = np.linalg.inv(beyond @ np.diag(own.noise) @ beyond.T)
    # what a rigid body leaves is not correlated with the noise of what it feels
    told = np.concatenate([own.felt(own.ahead_m), across])[:, whole]
    shares = np.concatenate([beyond, beyond], axis=1)
    size = 2 * count
    information[:size, :size] = (shares.T @ weight @ shares) * (told @ told.T)
    left = shares.T @ weight @ beyond @ own.signals[:, whole]
    pull[:size] = np.sum(left * told, axis=1)
    return prior.after(information, pull)


def _usable(sensor: Accelerometer) -> _Mask:
    channel = sensor.channel
    return np.asarray(~channel.clipped & ~channel.bridged & np.isfinite(sensor.acceleration))


def _filled(sensor: Accelerometer, good: _Mask) -> _Floats:
    at = np.flatnonzero(good)
    values = np.interp(np.arange(good.size), at, sensor.acceleration[at])
    return np.asarray(values - values.mean())


def _noise(samples: _Floats, rate_hz: float) -> float:
    """Variance of the white noise, from above the vibration [m^2/s^4]."""
    bins, density = scipy.signal.welch(samples, rate_hz, nperseg=min(samples.size, 2048))
    free = (bins > _NOISE_BAND[0] * rate_hz) & (bins < _NOISE_BAND[1] * rate_hz)
    return max(float(np.median(density[free])) * rate_hz / 2, _QUIETEST)


def _rigid(
    weights: _Floats, signals: _Floats, noise: _Floats, rate_hz: float
) -> tuple[Coordinate, ...]:
    heave, turning = weights @ signals
    variance = weights**2 @ noise
    return (
        fit_coordinate(heave, float(variance[0]), rate_hz, heave=1.0, turning=0.0),
        fit_coordinate(turning, float(variance[1]), rate_hz, heave=0.0, turning=1.0),
    )


def _modal(
    ahead_m: float,
    plane: Plane,
    signal: _Floats,
    noise: float,
    seen: Sequence[Resonance],
    modes: Sequence[Mode],
    rate_hz: float,
) -> tuple[tuple[Coordinate, ...], tuple[Unknown, ...]]:
    """Give each resonance of a single accelerometer a coordinate, and what is known of its turn."""
    middles = [each.frequency_hz for each in seen]
    edges = [BAND_HZ[0], *np.sqrt(np.multiply(middles[:-1], middles[1:])), BAND_HZ[1]]
    listed = [mode for mode in modes if mode.plane == plane]
    coordinates, turns = [], []
    for number in range(len(edges) - 1):
        band = (float(edges[number]), float(edges[number + 1]))
        at = middles[number] if middles else None
        turn, std = _known_turn(at, listed, ahead_m)
        coordinates.append(
            fit_coordinate(
                signal, noise, rate_hz, heave=1.0 - ahead_m * turn, turning=turn, band_hz=band
            )
        )
        name = f"turn at {coordinates[-1].frequency_hz:.1f} Hz in {plane}"
        turns.append(Unknown(name, std))
    return tuple(coordinates), tuple(turns)


def _known_turn(
    frequency_hz: float | None, listed: Sequence[Mode], ahead_m: float
) -> tuple[float, float]:
    """Inverse distance from a mode's point of rotation to the accelerometer, and its std [1/m]."""
    for mode in listed:
        if frequency_hz is None or (
            abs(mode.frequency_hz - frequency_hz) < _SAME_MODE * frequency_hz
        ):
            arm = mode.radius_m + ahead_m
            std = mode.radius_std_m or _RADIUS_STD * abs(mode.radius_m)
            return 1 / arm, std / arm**2
    return 0.0, _UNKNOWN_TURN
