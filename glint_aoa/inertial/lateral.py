"""Signals of lateral motion: accelerometers, balance moments and forces, and their resonances.

Each is proportional to the acceleration of a mode near its resonance, so its integral is
proportional to the mode's velocity and the square of that to the bias (paper, steps 2 and 3 of the
time and frequency domain regression).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.signal
from numpy.typing import ArrayLike, NDArray

from glint_aoa.errors import InputError
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.inertial.filters import integrate_band
from glint_aoa.inertial.modes import Mode, Plane
from glint_aoa.records.acquisition import Channel
from glint_aoa.units import convert

__all__ = [
    "BAND_HZ",
    "LateralSignal",
    "Resonance",
    "SourceKind",
    "integral_square",
    "lateral_signals",
    "resonances",
    "sensor_per_accelerometer",
    "tipping_m",
]

_Floats = NDArray[np.float64]
SourceKind = Literal["acceleration", "moment", "force"]

_UNITS: dict[SourceKind, str] = {"acceleration": "m/s^2", "moment": "N*m", "force": "N"}
_AXIS: dict[tuple[SourceKind, Plane], str] = {
    ("acceleration", "yaw"): "y",
    ("acceleration", "pitch"): "z",
    ("moment", "yaw"): "z",
    ("moment", "pitch"): "y",
    ("force", "yaw"): "y",
    ("force", "pitch"): "z",
}

_LEAST_ARM_M = 1e-3
_SEGMENT_S = 4.0
BAND_HZ = (4.0, 60.0)
"""Where the modes of a model on a sting lie [Hz]."""

_PROMINENT = 1.0  # decades of the velocity's power above the deeper side's valley
_WEAKEST = 1e-4  # of the power of the strongest
_APART = 0.08  # of the frequency: peaks nearer than that are one resonance
_HALF_WIDTH = 0.15  # of the frequency: a resonance with its modulation


@dataclass(frozen=True, eq=False)
class LateralSignal:
    """One channel that shows the motion in a plane.

    Attributes
    ----------
    kind : {"acceleration", "moment", "force"}
        What it measures.
    plane : {"yaw", "pitch"}
        Plane of the motion.
    channel : Channel
        Where it comes from.
    samples : ndarray [sample]
        Mean removed [m/s^2, N m or N], along the channel's axis.
    """

    kind: SourceKind
    plane: Plane
    channel: Channel
    samples: _Floats


@dataclass(frozen=True)
class Resonance:
    """Where a mode answers: its frequency and the band around it [Hz]."""

    frequency_hz: float
    low_hz: float
    high_hz: float


def lateral_signals(task: CorrectionTask, plane: Plane) -> list[LateralSignal]:
    """Take the channels that show the motion in a plane, at most one of each kind.

    Parameters
    ----------
    task : CorrectionTask
        The record and its package output.
    plane : {"yaw", "pitch"}
        Plane of the motion.

    Returns
    -------
    list of LateralSignal
        Accelerometer nearest to the package, moment, force: those that are recorded with an axis,
        with the package's clock and without missing samples; of several, the first in record
        order.
    """
    found = (_signal(task, kind, plane) for kind in _UNITS)
    return [signal for signal in found if signal is not None]


def resonances(samples: ArrayLike, rate_hz: float, *, most: int = 4) -> list[Resonance]:
    """Find the resonances that a signal shows between 4 and 60 Hz.

    Parameters
    ----------
    samples : array_like [sample]
        Acceleration, moment or force, in any unit.
    rate_hz : float
        Samples a second [Hz].
    most : int
        Keep the strongest of them.

    Returns
    -------
    list of Resonance
        By rising frequency; empty if nothing stands out by a factor of ten. Bands reach 15 % to
        either side, to the middle between two neighbours at most.

    Notes
    -----
    Peaks of the averaged spectrum of the integral of the signal, at least 8 % apart and with 1e-4
    of the strongest one's power. The harmonics of a distorted signal look like modes.
    """
    signal = np.asarray(samples, np.float64)
    segment = min(signal.size, round(_SEGMENT_S * rate_hz))
    bins, power = scipy.signal.welch(signal, rate_hz, nperseg=segment)
    keep = (bins >= BAND_HZ[0]) & (bins <= min(BAND_HZ[1], 0.4 * rate_hz))
    bins, power = bins[keep], power[keep]
    if bins.size < 3 or not power.all():
        return []
    velocity = np.log10(power / bins**2)
    peaks, _ = scipy.signal.find_peaks(velocity, prominence=_PROMINENT)
    strongest = sorted(peaks, key=lambda peak: -velocity[peak])
    chosen: list[int] = []
    for peak in strongest:
        apart = all(abs(bins[peak] - bins[other]) > _APART * bins[peak] for other in chosen)
        if apart and velocity[peak] > velocity[strongest[0]] + np.log10(_WEAKEST):
            chosen.append(int(peak))
    frequencies = sorted(_refined(bins, velocity, peak) for peak in chosen[:most])
    return _bands(frequencies)


def integral_square(samples: ArrayLike, rate_hz: float, resonance: Resonance) -> _Floats:
    """Integrate a signal within a resonance's band and square it: y(t) of the paper.

    Parameters
    ----------
    samples : array_like [sample]
        Acceleration, moment or force.
    rate_hz : float
        Samples a second [Hz].
    resonance : Resonance
        The band.

    Returns
    -------
    ndarray [sample]
        In the signal's unit times seconds, squared: (m/s)^2 for an acceleration. Unsettled within
        `band_settling_s` of an end.
    """
    low, high = resonance.low_hz, resonance.high_hz
    return np.asarray(integrate_band(samples, rate_hz, low_hz=low, high_hz=high) ** 2)


def sensor_per_accelerometer(
    mode: Mode, frequency_hz: float, *, ahead_m: float, force: float
) -> float:
    """Velocity of the package over the integral of what an accelerometer near it shows.

    rho / (rho + d + A / w^2): an accelerometer ahead by d is on a longer arm, and turning tips it
    in gravity.

    Parameters
    ----------
    mode : Mode
        The mode, for its effective radius rho.
    frequency_hz : float
        Where it answers [Hz].
    ahead_m : float
        Distance d from the package forward to the accelerometer [m].
    force : float
        Mean specific force A along model x, g sin(alpha) [m/s^2].

    Returns
    -------
    float
        1 for an accelerometer on the package of a level model.

    Raises
    ------
    InputError
        If the point of rotation lies within 1 mm of the accelerometer, which cannot see the mode.
    """
    arm = mode.radius_m + ahead_m + tipping_m(frequency_hz, force)
    if abs(arm) < _LEAST_ARM_M:
        raise InputError(
            f"inertial.mode {mode.number}: its point of rotation lies within "
            f"{1e3 * _LEAST_ARM_M:g} mm of the accelerometer, which cannot see it; use another "
            "station or leave the mode out"
        )
    return mode.radius_m / arm


def tipping_m(frequency_hz: float, force: float) -> float:
    """Length that tipping in gravity adds to the arm of an accelerometer, A / w^2 [m]."""
    return force / (2 * np.pi * frequency_hz) ** 2


def _signal(task: CorrectionTask, kind: SourceKind, plane: Plane) -> LateralSignal | None:
    package = task.package.channel
    found = []
    for channel in task.record.with_quantity(kind):
        in_plane = channel.axis is not None and channel.axis[1:] == _AXIS[kind, plane]
        clock = (channel.rate_hz, channel.start_s, len(channel))
        if in_plane and clock == (package.rate_hz, package.start_s, len(package)):
            values = _values(channel, _UNITS[kind])
            if values is not None:
                found.append(LateralSignal(kind, plane, channel, values - values.mean()))
    return min(found, key=lambda each: _distance(each.channel, package), default=None)


def _values(channel: Channel, unit: str) -> _Floats | None:
    """Return samples in a unit, or None if they measure something else or some are missing."""
    if channel.units is None:
        return None
    try:
        convert(channel.units, unit)
    except ValueError:
        return None
    values = channel.values(unit)
    return values if np.isfinite(values).all() else None


def _distance(channel: Channel, package: Channel) -> float:
    if channel.station_m is None or package.station_m is None:
        return 0.0
    return abs(channel.station_m - package.station_m)


def _refined(bins: _Floats, height: _Floats, peak: int) -> float:
    """Top of the parabola through a peak and its neighbours."""
    left, middle, right = height[peak - 1 : peak + 2]
    return float(
        bins[peak] + 0.5 * (right - left) / (2 * middle - left - right) * (bins[1] - bins[0])
    )


def _bands(frequencies: list[float]) -> list[Resonance]:
    edges = [0.0, *(np.sqrt(np.multiply(frequencies[:-1], frequencies[1:]))), np.inf]
    return [
        Resonance(
            frequency,
            max(frequency * (1 - _HALF_WIDTH), float(edges[index])),
            min(frequency * (1 + _HALF_WIDTH), float(edges[index + 1])),
        )
        for index, frequency in enumerate(frequencies)
    ]
