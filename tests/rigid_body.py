"""Records of a vibrating rigid body from kinematics, for the tests of the inertial corrections.

The sensor's position on composed rotations is differentiated twice; the bias formula appears
nowhere. Axes as in the project's conventions with the nose to the right.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.records.acquisition import AcquisitionRecord, Channel

GRAVITY = 9.80665
INCH = 0.0254
RATE_HZ = 800.0
OVERSAMPLING = 8
STATION_M = 0.9

TABLE = {  # number: plane, natural frequency [Hz], effective radius [m]
    1: ("yaw", 9.8, 31.0 * INCH),
    2: ("pitch", 9.2, 30.2 * INCH),
    3: ("yaw", 19.5, 0.18 * INCH),
    4: ("pitch", 20.3, -1.08 * INCH),
    5: ("yaw", 29.8, -7.14 * INCH),
    6: ("pitch", 34.2, -7.65 * INCH),
}

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Rotation [rad, sample] of each mode on a fine time base [s]."""

    time_s: Floats
    angles: Mapping[int, Floats]


def fine_time(duration_s: float) -> Floats:
    rate = RATE_HZ * OVERSAMPLING
    return np.arange(-4, round(duration_s * rate) + 4) / rate


def sine_amplitude(number: int, bias_deg: float, frequency_hz: float, pitch_deg: float) -> float:
    """Choose a rotation amplitude [rad] of about that bias; only sets the level of a test."""
    speed2 = 2 * GRAVITY * np.cos(np.radians(pitch_deg)) * np.radians(abs(bias_deg))
    radius = abs(TABLE[number][2])
    return float(np.sqrt(speed2 * radius) / (2 * np.pi * frequency_hz * radius))


def sine(
    number: int,
    *,
    bias_deg: float = 0.15,
    duration_s: float = 20.0,
    frequency_hz: float | None = None,
    pitch_deg: float = 0.0,
    modulation_hz: float = 0.0,
    phase: float = 0.4,
) -> Motion:
    frequency_hz = frequency_hz or TABLE[number][1]
    time = fine_time(duration_s)
    envelope = 0.5 - 0.5 * np.cos(2 * np.pi * modulation_hz * time) if modulation_hz else 1.0
    amplitude = sine_amplitude(number, bias_deg, frequency_hz, pitch_deg)
    return Motion(
        time, {number: amplitude * envelope * np.sin(2 * np.pi * frequency_hz * time + phase)}
    )


def random(
    rms_rate: Mapping[int, float],
    *,
    rng: np.random.Generator,
    duration_s: float = 40.0,
    damping: float = 0.01,
    common_force: bool = True,
    band_hz: tuple[float, float] = (5.0, 60.0),
) -> Motion:
    """Force white in a band through each mode's resonance; rms angular rates as given [rad/s]."""
    time = fine_time(duration_s)
    frequency = np.fft.rfftfreq(time.size, time[1] - time[0])
    inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])

    def force() -> NDArray[np.complex128]:
        white = rng.normal(size=frequency.size) + 1j * rng.normal(size=frequency.size)
        return np.where(inside, white, 0.0)

    shared = force()
    angles = {}
    for number, rms in rms_rate.items():
        natural = TABLE[number][1]
        receptance = 1 / (natural**2 - frequency**2 + 2j * damping * natural * frequency)
        spectrum = receptance * (shared if common_force else force())
        rate = np.fft.irfft(2j * np.pi * frequency * spectrum, n=time.size)
        angles[number] = np.fft.irfft(spectrum, n=time.size) * rms / rate.std()
    return Motion(time, angles)


def together(*motions: Motion) -> Motion:
    angles = {number: angle for motion in motions for number, angle in motion.angles.items()}
    return Motion(motions[0].time_s, angles)


def _rotation(plane: str, angle: Floats) -> Floats:
    cos, sin, one, nil = np.cos(angle), np.sin(angle), np.ones_like(angle), np.zeros_like(angle)
    rows = (
        [[cos, -sin, nil], [sin, cos, nil], [nil, nil, one]]
        if plane == "yaw"
        else [[cos, nil, -sin], [nil, one, nil], [sin, nil, cos]]
    )
    return np.moveaxis(np.array(rows), -1, 0)


def _place(motion: Motion, station_m: float, pitch_deg: float) -> tuple[Floats, Floats]:
    """Tunnel position [sample, 3] of a station on the axis, and the body's rotation."""
    n = motion.time_s.size
    position = np.tile([station_m, 0.0, 0.0], (n, 1))
    rotation = np.tile(np.eye(3), (n, 1, 1))
    for number in sorted(motion.angles, key=lambda each: -TABLE[each][1]):
        plane, _, radius = TABLE[number]
        turn = _rotation(plane, motion.angles[number])
        pivot = np.array([STATION_M - radius, 0.0, 0.0])
        position = pivot + np.einsum("nij,nj->ni", turn, position - pivot)
        rotation = turn @ rotation
    static = _rotation("pitch", np.array([np.radians(pitch_deg)]))[0]
    return position @ static.T, static @ rotation


def specific_force(motion: Motion, *, station_m: float, pitch_deg: float = 0.0) -> Floats:
    """Specific force [800 Hz sample, xyz] in the body frame at a station of its axis."""
    position, rotation = _place(motion, station_m, pitch_deg)
    step = motion.time_s[1] - motion.time_s[0]
    weights = np.array([-1, 16, -30, 16, -1]) / (12 * step**2)
    acceleration = sum(
        weight * position[2 + shift : position.shape[0] - 2 + shift]
        for weight, shift in zip(weights, range(-2, 3), strict=True)
    )
    total = acceleration + np.array([0.0, 0.0, GRAVITY])
    force = np.einsum("nij,ni->nj", rotation[2:-2], total)
    return force[2:-2:OVERSAMPLING]


def quantise(samples: Floats, full_scale: float) -> Floats:
    step = full_scale / 2**15
    return np.clip(np.round(samples / step) * step, -full_scale, full_scale)


def record(
    motion: Motion,
    *,
    pitch_deg: float = 0.0,
    rng: np.random.Generator | None = None,
    noise: Sequence[float] = (2e-4, 5e-3),
    angle_units: bool = False,
    station_m: float = STATION_M,
) -> AcquisitionRecord:
    """Package output and its two tangential accelerometers; noise of each [m/s^2, rms]."""
    axial = specific_force(motion, station_m=STATION_M, pitch_deg=pitch_deg)[:, 0]
    face = specific_force(motion, station_m=station_m, pitch_deg=pitch_deg)
    signals = {"aoa_unfiltered": axial, "ay_face": face[:, 1], "az_face": face[:, 2]}
    if rng is not None:
        for name, signal in signals.items():
            level = noise[0] if name == "aoa_unfiltered" else noise[1]
            noisy = signal + rng.normal(0.0, level, signal.size)
            signals[name] = quantise(noisy, 0.5 * GRAVITY if level == noise[0] else 20 * GRAVITY)
    axes = {"aoa_unfiltered": "+x", "ay_face": "+y", "az_face": "-z"}
    channels = {}
    for name, signal in signals.items():
        is_package = name == "aoa_unfiltered"
        samples = signal if name != "az_face" else -signal
        if is_package and angle_units:
            samples = np.degrees(np.arcsin(samples / GRAVITY))
        channels[name] = Channel(
            name=name,
            samples=samples,
            rate_hz=RATE_HZ,
            quantity="aoa_unfiltered" if is_package else "acceleration",
            units="deg" if is_package and angle_units else "m/s^2",
            station_m=STATION_M if is_package else station_m,
            axis=axes[name],
            limits=None,
        )
    return AcquisitionRecord(name="rigid-body", channels=channels, meta={})
