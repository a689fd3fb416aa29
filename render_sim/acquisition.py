"""The two acquisition records of the test: 12 channels and the 16-channel analyser.

Sensors see the exact rigid-body kinematics on a grid eight times finer than the record. Each
sensor has its noise once; each channel band-limits (linear phase, delay taken out), samples and
turns into 16-bit counts for itself.

The band limit passes 0 to 300 Hz and takes out all from 500 Hz on, by 100 dB; what lies between 400
and 500 Hz is folded to between 300 and 400 Hz, above the package's band.

The balance's loads are zero with the motionless model hanging on it (tared); for signs see
`render_sim.instruments`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.records.acquisition import Channel
from glint_aoa.units import STANDARD_GRAVITY
from render_sim.instruments import (
    ANALYSER,
    DAS,
    FULL_COUNT,
    TEMPERATURE,
    Input,
    Sensor,
    SensorErrors,
    accelerometer_stations,
    sensors,
)
from render_sim.kinematics import BodyKinematics, body_kinematics
from render_sim.modal_motion import Signal
from render_sim.modes import ModelSystem, Plane
from render_sim.motion import Motion
from render_sim.package import (
    InertialPackage,
    PackageOutputs,
    package_outputs,
    sensed_force,
)

__all__ = ["Acquisition", "Recording", "acquire", "balance_loads"]

Floats = NDArray[np.float64]

_BAND = (300.0, 500.0)
_IDEAL = "ideal filtered output"
_NEWTONS_PER_VOLT = 100.0


@dataclass(frozen=True)
class Recording:
    """How the channels are recorded.

    Attributes
    ----------
    duration_s : float
        Length of the record from `start_s` on [s]; 8 s are two periods of the modulation.
    start_s : float
        First sample after the trigger [s].
    rate_hz : float
        Samples a second [Hz].
    oversampling : int
        Kinematics are taken this many times finer.
    package : InertialPackage
        Filters and errors of the inertial package.
    errors : tuple of SensorErrors
        What is wrong with single sensors.
    strays : mapping of str to Signal
        What sensors feel beside the motion, by sensor and in its units.
    """

    duration_s: float = 8.0
    start_s: float = 0.0
    rate_hz: float = 800.0
    oversampling: int = 8
    package: InertialPackage = field(default_factory=InertialPackage)
    errors: tuple[SensorErrors, ...] = ()
    strays: Mapping[str, Signal] = field(default_factory=dict)

    @property
    def fine_rate_hz(self) -> float:
        """Samples a second of the kinematics [Hz]."""
        return self.rate_hz * self.oversampling

    @property
    def lead(self) -> int:
        """Fine samples ahead of the record, in which the package's filter settles."""
        return round(self.package.settling_s * self.rate_hz) * self.oversampling


@dataclass(frozen=True, eq=False)
class Acquisition:
    """What the acquisition recorded of a point, and the truth behind it.

    Attributes
    ----------
    channels : dict of str to Channel
        The 12-channel record, then the analyser's 16 with names that start with ``analyser_``.
    truth : dict of str to ndarray [sample]
        ``static_pitch_deg``, the motionless model's pitch; ``bias_deg``, the filtered output's
        angle, free of noise and of the package's errors, less that pitch.
    """

    channels: dict[str, Channel]
    truth: dict[str, Floats]


def acquire(
    system: ModelSystem,
    motion: Motion,
    static: Motion,
    *,
    forces: Mapping[Plane, Signal] | None = None,
    recording: Recording | None = None,
    rng: np.random.Generator,
) -> Acquisition:
    """Record a motion with both acquisition systems.

    Parameters
    ----------
    system : ModelSystem
        Mass properties and stations.
    motion : Motion
        The moving model.
    static : Motion
        The model without vibration; its pitch at the trigger is the truth.
    forces : mapping of "yaw" or "pitch" to Signal, optional
        The shaker's force [N] along model +y (yaw) or +z (pitch); none with the shaker off. Where
        both planes are driven, the shaker's channel records the first.
    recording : Recording, optional
        Length, rate and package.
    rng : Generator
        Draws the noise.

    Returns
    -------
    Acquisition
        28 channels in record order, and the truth at the same samples.
    """
    recording, forces = recording or Recording(), forces or {}
    plane = next(iter(forces), None)
    fine = _fine_signals(system, motion, static, forces=forces, recording=recording)
    sampled = {name: _decimate(signal, recording) for name, signal in fine.items()}
    time = recording.start_s + np.arange(_samples(recording)) / recording.rate_hz
    sampled |= {name: sampled[name] + stray.at(time) for name, stray in recording.strays.items()}
    truth = _truth(sampled.pop(_IDEAL), rest_pitch_rad=_rest_pitch(static))
    at_hand = sensors(system, plane)
    at_hand |= {each.name: each.applied(at_hand[each.name]) for each in recording.errors}
    noisy = {
        name: at_hand[name].indicated(signal)
        + at_hand[name].noise * rng.standard_normal(signal.size)
        for name, signal in sampled.items()
    }
    extra = () if recording.package.temperature is None else (TEMPERATURE,)
    channels = {
        each.name: _channel(each, at_hand[each.sensor], noisy[each.sensor], recording)
        for each in (*DAS, *ANALYSER, *extra)
    }
    return Acquisition(channels=channels, truth=truth)


def _fine_signals(
    system: ModelSystem,
    motion: Motion,
    static: Motion,
    *,
    forces: Mapping[Plane, Signal],
    recording: Recording,
) -> dict[str, Floats]:
    """Return every sensor's signal on the fine grid, lead-in first; free of noise."""
    rate, package = recording.fine_rate_hz, recording.package
    lead, pad = recording.lead, len(_anti_alias(rate)) // 2
    samples = lead + _samples(recording) * recording.oversampling + pad
    body = body_kinematics(
        motion, start_s=recording.start_s - lead / rate, samples=samples, rate_hz=rate
    )
    up = static.pose(np.zeros(1))[0, 2, :3]
    felt = body.specific_force(system.sensor_station)
    kelvin = package.temperature_at(body.time_s)
    outputs = package_outputs(
        sensed_force(felt, package, temperature_k=kelvin),
        rest_force=float(sensed_force(STANDARD_GRAVITY * up, package, temperature_k=kelvin[0])),
        rate_hz=rate,
        package=package,
    )
    ideal = package_outputs(
        felt[:, 0], rest_force=STANDARD_GRAVITY * up[0], rate_hz=rate, package=package
    )
    signals = _sensor_signals(system, body, outputs, rest_up=up, forces=forces)
    if package.temperature is not None:
        signals[TEMPERATURE.sensor] = kelvin
    return signals | {_IDEAL: ideal.filtered}


def _rest_pitch(static: Motion) -> float:
    return float(np.arcsin(static.pose(np.zeros(1))[0, 2, 0]))


def balance_loads(
    system: ModelSystem, body: BodyKinematics, *, rest_up: Floats, push: Floats
) -> dict[str, Floats]:
    """Return what the moving model puts on its balance, tared with the model at rest.

    Newton and Euler for the rigid model: force F = P - m f and moment about the balance moment
    centre M = x_s e_x x P - (I w' + w x I w) - r_cg x m f, where P is the shaker's force, f the
    specific force at the centre of gravity and w the angular rate, all in model axes; the values
    with the model at rest are taken off.

    Parameters
    ----------
    system : ModelSystem
        Mass properties and stations.
    body : BodyKinematics
        The motion.
    rest_up : ndarray [3]
        Tunnel's up in the axes of the motionless model.
    push : ndarray [sample, 3]
        The shaker's force in model axes [N].

    Returns
    -------
    dict of str to ndarray [sample]
        Forces [N] and moments [N m] by channel name, signs as in `render_sim.instruments`.
    """
    at_rest = STANDARD_GRAVITY * rest_up
    inertial = system.mass * (body.specific_force(system.center_of_gravity) - at_rest)
    inertia = np.array([system.roll_inertia, system.pitch_inertia, system.yaw_inertia])
    rate = body.angular_rate
    force = push - inertial
    moment = (
        _along_x_cross(system.shaker_station, push)
        - inertia * body.angular_acceleration
        - np.cross(rate, inertia * rate)
        - _along_x_cross(system.center_of_gravity, inertial)
    )
    return {
        "normal_force": force[:, 2],
        "axial_force": -force[:, 0],
        "pitch_moment": -moment[:, 1],
        "roll_moment": moment[:, 0],
        "yaw_moment": moment[:, 2],
        "side_force": force[:, 1],
    }


def _along_x_cross(station_m: float, force: Floats) -> Floats:
    """Moment about the origin of forces [sample, 3] at a station of the model axis."""
    return station_m * np.stack([np.zeros(len(force)), -force[:, 2], force[:, 1]], axis=-1)


_ALONG: dict[Plane, int] = {"yaw": 1, "pitch": 2}
"""Model axis along which the shaker drives a plane."""


def _push(forces: Mapping[Plane, Signal], time_s: Floats) -> Floats:
    push = np.zeros((time_s.size, 3))
    for plane, force in forces.items():
        push[:, _ALONG[plane]] = force.at(time_s)
    return push


def _sensor_signals(
    system: ModelSystem,
    body: BodyKinematics,
    outputs: PackageOutputs,
    *,
    rest_up: Floats,
    forces: Mapping[Plane, Signal],
) -> dict[str, Floats]:
    push = _push(forces, body.time_s)
    driven = _ALONG[next(iter(forces), "yaw")]
    signals = {
        "aoa_unfiltered": outputs.unfiltered,
        "aoa_filtered": outputs.filtered,
        **balance_loads(system, body, rest_up=rest_up, push=push),
        "shaker": push[:, driven] / _NEWTONS_PER_VOLT,
        "aux_aoa": np.rad2deg(np.arcsin(body.rotation[:, 2, 0])),
        "force_y": push[:, 1],
        "force_z": push[:, 2],
    }
    for place, station in accelerometer_stations(system):
        felt = body.specific_force(station)
        signals |= {f"ay_{place}": felt[:, 1], f"az_{place}": felt[:, 2]}
    return signals


def _truth(filtered: Floats, *, rest_pitch_rad: float) -> dict[str, Floats]:
    return {
        "static_pitch_deg": np.full(filtered.size, np.rad2deg(rest_pitch_rad)),
        "bias_deg": np.rad2deg(np.arcsin(filtered) - rest_pitch_rad),
    }


def _samples(recording: Recording) -> int:
    return round(recording.duration_s * recording.rate_hz)


def _anti_alias(rate_hz: float) -> Floats:
    taps, beta = scipy.signal.kaiserord(100.0, (_BAND[1] - _BAND[0]) / (rate_hz / 2))
    taps += 1 - taps % 2  # an odd length delays by whole samples
    return np.asarray(
        scipy.signal.firwin(taps, sum(_BAND) / 2, window=("kaiser", beta), fs=rate_hz), np.float64
    )


def _decimate(signal: Floats, recording: Recording) -> Floats:
    """Band-limit to 300 Hz and keep the record's samples, the first after the lead-in."""
    step, lead = recording.oversampling, recording.lead
    taps = _anti_alias(recording.rate_hz * step)
    delay = len(taps) // 2
    skip = -(-2 * delay // step)  # outputs before the filter is full, and in step with the record
    kept = scipy.signal.upfirdn(taps, signal[lead + delay - skip * step :], down=step)
    return np.asarray(kept[skip : skip + _samples(recording)], np.float64)


def _channel(each: Input, sensor: Sensor, values: Floats, recording: Recording) -> Channel:
    scale = (sensor.range_limit or each.full_scale) / FULL_COUNT
    counts = np.clip(np.rint(values / scale), -FULL_COUNT, FULL_COUNT).astype(np.int16)
    limit = FULL_COUNT * scale
    return Channel(
        name=each.name,
        samples=counts,
        rate_hz=recording.rate_hz,
        start_s=recording.start_s,
        quantity=sensor.quantity,
        units=sensor.units,
        scale=scale,
        station_m=sensor.station_m,
        axis=sensor.axis,
        limits=(-limit, limit),
    )
