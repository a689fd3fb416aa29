"""The two acquisition records of the test: 12 channels and the 16-channel analyser.

Sensors see the exact rigid-body kinematics on a grid eight times finer than the record. Each
sensor has its noise once; each channel band-limits (linear phase, delay taken out), samples and
turns into 16-bit counts for itself.

Signs: forces and moments are those the model puts on the balance, zero with the motionless model
hanging on it (tared). Normal force along model +z, side force along +y (to port), axial force
along -x (aft); yaw moment about +z (nose to port), pitch moment about -y (nose up), roll moment
about +x (starboard side down), all about the balance moment centre.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.records.acquisition import Channel
from glint_aoa.units import STANDARD_GRAVITY
from render_sim.kinematics import BodyKinematics, body_kinematics
from render_sim.modal_motion import Signal
from render_sim.modes import ModelSystem, Plane
from render_sim.motion import Motion
from render_sim.package import InertialPackage, PackageOutputs, package_outputs

__all__ = ["Acquisition", "Recording", "acquire", "balance_loads"]

Floats = NDArray[np.float64]

AFT_STATION_M = 0.1
MID_STATION_M = 0.55
"""Stations of the fuselage accelerometers [m], one a plane at each."""

_FULL_COUNT = 32767
_BAND = (300.0, 500.0)
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
        Filters of the inertial package.
    """

    duration_s: float = 8.0
    start_s: float = 0.0
    rate_hz: float = 800.0
    oversampling: int = 8
    package: InertialPackage = field(default_factory=InertialPackage)


@dataclass(frozen=True, eq=False)
class Acquisition:
    """What the acquisition recorded of a point, and the truth behind it.

    Attributes
    ----------
    channels : dict of str to Channel
        The 12-channel record, then the analyser's 16 with names that start with ``analyser_``.
    truth : dict of str to ndarray [sample]
        ``static_pitch_deg``, the motionless model's pitch; ``bias_deg``, the filtered output's
        angle, free of noise, less that pitch.
    """

    channels: dict[str, Channel]
    truth: dict[str, Floats]


@dataclass(frozen=True)
class _Sensor:
    """One sensor: what it measures, where, and its noise in the record's band [units rms]."""

    quantity: str | None
    units: str
    noise: float
    station_m: float | None = None
    axis: str | None = None


@dataclass(frozen=True)
class _Input:
    """One channel of an acquisition: the sensor on it and the range [sensor's units]."""

    name: str
    sensor: str
    full_scale: float


_MILLI_G = STANDARD_GRAVITY * 1e-3
_FACE_RANGE = 100.0
_FUSELAGE_RANGE = 20 * STANDARD_GRAVITY

_BALANCE_INPUTS = (
    ("normal_force", 10_000.0),
    ("axial_force", 2_000.0),
    ("pitch_moment", 1_500.0),
    ("roll_moment", 500.0),
    ("yaw_moment", 1_500.0),
    ("side_force", 5_000.0),
)
_PACKAGE_INPUTS = (
    ("aoa_unfiltered", 1.0),
    ("aoa_filtered", 0.35),
    ("ay_face", _FACE_RANGE),
    ("az_face", _FACE_RANGE),
)
_FUSELAGE_INPUTS = tuple(
    (name, _FUSELAGE_RANGE) for name in ("ay_aft", "az_aft", "ay_mid", "az_mid")
)

_DAS = tuple(
    _Input(name, name, full)
    for name, full in (*_PACKAGE_INPUTS, *_BALANCE_INPUTS, ("shaker", 10.0), ("aux_aoa", 20.0))
)
_ANALYSER = tuple(
    _Input(f"analyser_{name}", name, full)
    for name, full in (
        ("force_y", 500.0),
        ("force_z", 500.0),
        *_BALANCE_INPUTS,
        *_PACKAGE_INPUTS,
        *_FUSELAGE_INPUTS,
    )
)


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
    rate = recording.rate_hz * recording.oversampling
    lead = round(recording.package.settling_s * recording.rate_hz) * recording.oversampling
    record = _samples(recording) * recording.oversampling
    pad = len(_anti_alias(rate)) // 2
    body = body_kinematics(
        motion, start_s=recording.start_s - lead / rate, samples=lead + record + pad, rate_hz=rate
    )
    up = static.pose(np.zeros(1))[0, 2, :3]
    outputs = package_outputs(
        body.specific_force(system.sensor_station)[:, 0],
        rest_force=STANDARD_GRAVITY * up[0],
        rate_hz=rate,
        package=recording.package,
    )
    plane = next(iter(forces), None)
    fine = _sensor_signals(
        system,
        body,
        outputs,
        rest_up=up,
        push=_push(forces, body.time_s),
        driven=_ALONG[plane or "yaw"],
    )
    sampled = {name: _decimate(signal, lead, recording) for name, signal in fine.items()}
    truth = _truth(sampled["aoa_filtered"], rest_pitch_rad=float(np.arcsin(up[0])))
    sensors = _sensors(system, plane)
    noisy = {
        name: signal + sensors[name].noise * rng.standard_normal(signal.size)
        for name, signal in sampled.items()
    }
    channels = {
        each.name: _channel(each, sensors[each.sensor], noisy[each.sensor], recording)
        for each in (*_DAS, *_ANALYSER)
    }
    return Acquisition(channels=channels, truth=truth)


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
        Forces [N] and moments [N m] by channel name, signs as in the module's head.
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
    push: Floats,
    driven: int,
) -> dict[str, Floats]:
    signals = {
        "aoa_unfiltered": outputs.unfiltered,
        "aoa_filtered": outputs.filtered,
        **balance_loads(system, body, rest_up=rest_up, push=push),
        "shaker": push[:, driven] / _NEWTONS_PER_VOLT,
        "aux_aoa": np.rad2deg(np.arcsin(body.rotation[:, 2, 0])),
        "force_y": push[:, 1],
        "force_z": push[:, 2],
    }
    for place, station in _accelerometer_stations(system):
        felt = body.specific_force(station)
        signals |= {f"ay_{place}": felt[:, 1], f"az_{place}": felt[:, 2]}
    return signals


def _accelerometer_stations(
    system: ModelSystem,
) -> Iterator[tuple[str, float]]:
    yield "face", system.sensor_station
    yield "aft", AFT_STATION_M
    yield "mid", MID_STATION_M


def _sensors(system: ModelSystem, plane: Plane | None) -> dict[str, _Sensor]:
    package, shaker = system.sensor_station, system.shaker_station
    drive_axis = {"yaw": "+y", "pitch": "+z", None: None}[plane]
    sensors = {
        "aoa_unfiltered": _Sensor("aoa_unfiltered", "g_0", 50e-6, package, "+x"),
        "aoa_filtered": _Sensor("aoa_filtered", "g_0", 5e-6, package, "+x"),
        "normal_force": _Sensor("force", "N", 0.3, 0.0, "+z"),
        "axial_force": _Sensor("force", "N", 0.1, 0.0, "-x"),
        "pitch_moment": _Sensor("moment", "N*m", 0.05, 0.0, "-y"),
        "roll_moment": _Sensor("moment", "N*m", 0.02, 0.0, "+x"),
        "yaw_moment": _Sensor("moment", "N*m", 0.05, 0.0, "+z"),
        "side_force": _Sensor("force", "N", 0.3, 0.0, "+y"),
        "shaker": _Sensor("excitation", "V", 1e-3, shaker, drive_axis),
        "aux_aoa": _Sensor(None, "deg", 0.01),
        "force_y": _Sensor("excitation", "N", 0.02, shaker, "+y"),
        "force_z": _Sensor("excitation", "N", 0.02, shaker, "+z"),
    }
    for place, station in _accelerometer_stations(system):
        for axis in "yz":
            sensors[f"a{axis}_{place}"] = _Sensor(
                "acceleration", "m/s^2", 0.5 * _MILLI_G, station, f"+{axis}"
            )
    return sensors


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


def _decimate(signal: Floats, lead: int, recording: Recording) -> Floats:
    """Band-limit to 300 Hz and keep the record's samples, sample `lead` of `signal` the first."""
    step = recording.oversampling
    taps = _anti_alias(recording.rate_hz * step)
    delay = len(taps) // 2
    skip = -(-2 * delay // step)  # outputs before the filter is full, and in step with the record
    kept = scipy.signal.upfirdn(taps, signal[lead + delay - skip * step :], down=step)
    return np.asarray(kept[skip : skip + _samples(recording)], np.float64)


def _channel(each: _Input, sensor: _Sensor, values: Floats, recording: Recording) -> Channel:
    scale = each.full_scale / _FULL_COUNT
    counts = np.clip(np.rint(values / scale), -_FULL_COUNT, _FULL_COUNT).astype(np.int16)
    limit = _FULL_COUNT * scale
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
