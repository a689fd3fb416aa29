"""Records of a vibrating rigid body in closed form, fast enough for thousands of draws.

The position of a sensor on nested rotations is differentiated by the chain rule, exactly; the
bias formula appears nowhere. Modes compose by frequency, the lowest outermost, as the project's
conventions say.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.records.acquisition import AcquisitionRecord, Channel

GRAVITY = 9.80665
RATE_HZ = 800.0
STATIONS_M = {"face": 0.9, "mid": 0.55, "aft": 0.1}

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ModeMotion:
    """One mode and its angle with two derivatives [sample; rad, rad/s, rad/s^2]."""

    number: int
    plane: str
    frequency_hz: float
    radius_m: float
    angle: Floats
    rate: Floats
    acceleration: Floats


@dataclass(frozen=True)
class Imperfections:
    """What is wrong with the sensors: relative gain errors, tilts [rad] and noise [m/s^2 rms]."""

    gain_std: float = 0.01
    misalignment_std: float = float(np.radians(0.5))
    accelerometer_noise: float = 0.5e-3 * GRAVITY
    package_noise: float = 50e-6 * GRAVITY


def time_of(duration_s: float) -> Floats:
    """Sample times [s]."""
    return np.arange(round(duration_s * RATE_HZ)) / RATE_HZ


def tones(
    time_s: Floats, frequencies_hz: Sequence[float], amplitudes: Sequence[float], phases: Floats
) -> tuple[Floats, Floats, Floats]:
    """Sum sines of given amplitudes [rad]: angle, rate and acceleration."""
    angle, rate, acceleration = np.zeros((3, time_s.size))
    for frequency, amplitude, phase in zip(frequencies_hz, amplitudes, phases, strict=True):
        circular = 2 * np.pi * frequency
        sine = amplitude * np.sin(circular * time_s + phase)
        angle += sine
        rate += circular * amplitude * np.cos(circular * time_s + phase)
        acceleration -= circular**2 * sine
    return angle, rate, acceleration


def specific_forces(
    modes: Sequence[ModeMotion], stations_m: Sequence[float], *, pitch_deg: float
) -> Floats:
    """Specific force [station, sample, xyz] in model axes; radii count from ``face``."""
    samples = modes[0].angle.size
    points = np.zeros((3, len(stations_m), samples))  # of the stations, then their derivatives
    points[0] = np.asarray(stations_m, np.float64)[:, None]
    motion = [points, np.zeros_like(points), np.zeros_like(points)]
    pitch = np.radians(pitch_deg)
    # tunnel's up in the motionless model's axes, turned into the moving model's from outside in
    up = np.zeros((3, samples))
    up[0], up[2] = np.sin(pitch), np.cos(pitch)
    ordered = sorted(modes, key=lambda each: each.frequency_hz)
    for mode in reversed(ordered):
        motion = _turned(mode, *motion)
    acceleration = motion[2]
    for mode in ordered:
        up = _turn(mode, up, np.cos(mode.angle), -np.sin(mode.angle))
        acceleration = _turn(mode, acceleration, np.cos(mode.angle), -np.sin(mode.angle))
    return np.moveaxis(acceleration + GRAVITY * up[:, None], 0, -1)


def record(
    modes: Sequence[ModeMotion],
    *,
    pitch_deg: float,
    rng: np.random.Generator,
    imperfections: Imperfections | None = None,
    places: Sequence[str] = ("face", "mid", "aft"),
) -> AcquisitionRecord:
    """Record package and accelerometers with the imperfections drawn for each sensor."""
    wrong = imperfections or Imperfections()
    stations = [STATIONS_M[place] for place in places]
    forces = specific_forces(modes, [STATIONS_M["face"], *stations], pitch_deg=pitch_deg)
    axial = forces[0, :, 0] + rng.normal(0.0, wrong.package_noise, forces.shape[1])
    channels = [_channel("aoa_unfiltered", axial, STATIONS_M["face"], "+x", GRAVITY)]
    for place, station, felt in zip(places, stations, forces[1:], strict=True):
        for axis, along, across in (("y", 1, 2), ("z", 2, 1)):
            gain = 1 + rng.normal(0.0, wrong.gain_std)
            tilts = rng.normal(0.0, wrong.misalignment_std, 2)
            signal = gain * (felt[:, along] + tilts[0] * felt[:, across] + tilts[1] * felt[:, 0])
            noisy = signal + rng.normal(0.0, wrong.accelerometer_noise, signal.size)
            channels.append(_channel(f"a{axis}_{place}", noisy, station, f"+{axis}", 20 * GRAVITY))
    return AcquisitionRecord("tones", {channel.name: channel for channel in channels})


def _turned(
    mode: ModeMotion, position: Floats, velocity: Floats, acceleration: Floats
) -> list[Floats]:
    """Turn points about the mode's fixed point; the derivatives by the chain rule."""
    cos, sin = np.cos(mode.angle), np.sin(mode.angle)
    apart = position.copy()
    apart[0] -= STATIONS_M["face"] - mode.radius_m
    first, second = mode.rate, mode.acceleration
    turned = _turn(mode, apart, cos, sin)
    turned[0] += STATIONS_M["face"] - mode.radius_m
    return [
        turned,
        _swept(mode, apart, -sin * first, cos * first) + _turn(mode, velocity, cos, sin),
        _swept(mode, apart, -cos * first**2 - sin * second, -sin * first**2 + cos * second)
        + 2 * _swept(mode, velocity, -sin * first, cos * first)
        + _turn(mode, acceleration, cos, sin),
    ]


def _turn(mode: ModeMotion, vectors: Floats, cos: Floats, sin: Floats) -> Floats:
    """Rotate vectors [xyz, ..., sample] in the mode's plane, towards +y or +z."""
    result = _swept(mode, vectors, cos, sin)
    fixed = 2 if mode.plane == "yaw" else 1
    result[fixed] = vectors[fixed]
    return result


def _swept(mode: ModeMotion, vectors: Floats, cos: Floats, sin: Floats) -> Floats:
    across = 1 if mode.plane == "yaw" else 2
    result = np.zeros_like(vectors)
    result[0] = cos * vectors[0] - sin * vectors[across]
    result[across] = sin * vectors[0] + cos * vectors[across]
    return result


def _channel(name: str, values: Floats, station_m: float, axis: str, full_scale: float) -> Channel:
    scale = full_scale / 32767
    counts = np.clip(np.rint(values / scale), -32767, 32767).astype(np.int16)
    return Channel(
        name=name,
        samples=counts,
        rate_hz=RATE_HZ,
        quantity="aoa_unfiltered" if axis == "+x" else "acceleration",
        units="m/s^2",
        scale=scale,
        station_m=station_m,
        axis=axis,
        limits=(-full_scale, full_scale),
    )
