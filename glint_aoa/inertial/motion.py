"""How the package moves in one plane, from accelerometers at several stations.

The model is taken as a rigid body: the accelerometers of a plane at distances d ahead of the
package sense

    f(d) = v' - g sin(alpha) theta + p' d,

with v the package's velocity across the axis, p = theta' the rate of turning and theta the angle
of the vibration. Slope and value at the package follow by weighted least squares over the
stations; integration runs in the spectrum, without delay.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.inertial.bridging import Bridged, bridge
from glint_aoa.inertial.channels import Accelerometer, accelerometers
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.inertial.filters import filter_spectrum
from glint_aoa.inertial.modes import Plane
from glint_aoa.units import STANDARD_GRAVITY

__all__ = ["PlaneMotion", "Repair", "plane_motions", "rigid_weights"]

_Floats = NDArray[np.float64]
_Mask = NDArray[np.bool_]
_Complex = NDArray[np.complex128]

_BAND_HZ = (4.0, 60.0)
_FLANK = 0.5  # half-width of the lower flank over its middle
_BELOW, _ABOVE = 0.6, 1.5  # times lowest and highest mode of the setup: must lie in the band
_NOISE_FROM = 1.2  # times the band's end: only noise from there on
_SEGMENT_S = 8.0
_QUIETEST = 1e-9  # m/s: stands in for the noise of a signal that has none
_LEAST_SENSORS = 2


@dataclass(frozen=True, eq=False)
class Repair:
    """A signal whose clipped or missing samples were bridged, integrated.

    Attributes
    ----------
    sensor : int
        Its index among the sensors.
    restored : ndarray [sample]
        What bridging added [m/s].
    draws : ndarray [draw, sample]
        Deviations that the good samples allow [m/s]; their mean square is the variance.
    """

    sensor: int
    restored: _Floats
    draws: _Floats


@dataclass(frozen=True, eq=False)
class PlaneMotion:
    """Motion of the package in one plane.

    Attributes
    ----------
    sensors : list of Accelerometer
        Those used, from the foremost back.
    weights : ndarray [2, sensor]
        What takes their signals to that at the package and to the slope [1/m].
    velocities : ndarray [sensor, sample]
        Their integrated signals [m/s].
    velocity, rate : ndarray [sample]
        Of the package across its axis [m/s] and of turning [rad/s]; gravity is taken out.
    foreign : ndarray [sensor, sample]
        What they may hold of the other plane's motion, 1 sigma [m/s].
    misfit : float
        Rms of what a rigid body leaves of them over what noise, gains and directions explain;
        0 for two accelerometers, which any motion fits.
    repairs : list of Repair
        One for each signal that was bridged.
    clipped, lost : ndarray [sample]
        Whether a sample of a sensor used was clipped or missing.
    left_out : list of str
        Channels with more clipped or missing samples than can be bridged.
    """

    sensors: list[Accelerometer]
    weights: _Floats
    velocities: _Floats
    velocity: _Floats
    rate: _Floats
    foreign: _Floats
    misfit: float
    repairs: list[Repair]
    clipped: _Mask
    lost: _Mask
    left_out: list[str]

    @cached_property
    def sensitivity(self) -> _Floats:
        """Change of velocity times rate with each integrated signal [sensor, sample]."""
        return np.asarray(
            self.weights[0][:, None] * self.rate + self.weights[1][:, None] * self.velocity
        )


@dataclass(frozen=True, eq=False)
class _Signals:
    """Accelerometers of a plane with whole signals, and how those that were not became so."""

    sensors: list[Accelerometer]
    samples: list[_Floats]
    bridged: dict[int, tuple[_Floats, Bridged]]
    clipped: _Mask
    lost: _Mask
    left_out: list[str]

    @property
    def ahead_m(self) -> _Floats:
        return np.array([sensor.ahead_m for sensor in self.sensors])


def plane_motions(
    task: CorrectionTask, planes: Sequence[Plane], sine: _Floats
) -> dict[Plane, PlaneMotion]:
    """Find velocity and rate of turning of the package in each plane.

    Parameters
    ----------
    task : CorrectionTask
        A record with two or more accelerometers a plane at different stations.
    planes : sequence of {"yaw", "pitch"}
        Planes of the motion.
    sine : ndarray [sample]
        Sine of the slow pitch angle, for the tilt of the accelerometers in gravity.

    Returns
    -------
    dict of PlaneMotion
        Within 4 to 60 Hz, or wider where a mode of the setup asks for it.

    Raises
    ------
    RecordingError
        If so many samples are clipped or missing that fewer than two stations remain.

    Notes
    -----
    Weights follow from each accelerometer's noise and the uncertainties of its gain and its
    direction: what it may sense of the other plane is found with weights that leave that out.
    """
    rate_hz, band = task.package.channel.rate_hz, _band(task)
    signals = {plane: _whole_signals(task, plane) for plane in planes}
    velocities = {
        plane: filter_spectrum(each.samples, rate_hz, [_integral(band, 1)])[0]
        for plane, each in signals.items()
    }
    std = {plane: _own_std(task, each, velocities[plane], band) for plane, each in signals.items()}
    motions: dict[Plane, PlaneMotion] = {}
    for plane, each in signals.items():
        other: Plane = "pitch" if plane == "yaw" else "yaw"
        foreign = np.zeros_like(velocities[plane])
        if other in signals:
            line = rigid_weights(signals[other].ahead_m, std[other]) @ velocities[other]
            foreign = task.misalignment_std * (line[0] + each.ahead_m[:, None] * line[1])
        motions[plane] = _motion(each, velocities[plane], foreign, std[plane], sine, rate_hz, band)
    return motions


def rigid_weights(ahead_m: _Floats, std: _Floats) -> _Floats:
    """Give the weighted least squares of a line over stations.

    Parameters
    ----------
    ahead_m : ndarray [sensor]
        Distances ahead of the package [m], two of them different.
    std : ndarray [sensor]
        Uncertainties of the signals, in any one unit.

    Returns
    -------
    ndarray [2, sensor]
        Row 0 takes the signals to the value at the package, row 1 to the slope [1/m].
    """
    line = np.stack([np.ones_like(ahead_m), ahead_m], axis=1) / std[:, None]
    return np.asarray(np.linalg.pinv(line) / std)


def _band(task: CorrectionTask) -> tuple[float, float]:
    """Edges of the band of integration [Hz]."""
    low, high = _BAND_HZ
    if task.modes:
        low = min(low, _BELOW * task.modes[0].frequency_hz)
        high = max(high, _ABOVE * task.modes[-1].frequency_hz)
    return low, min(high, 0.4 * task.package.channel.rate_hz)


def _integral(band_hz: tuple[float, float], times: int) -> Callable[[_Floats], _Complex]:
    low, high = band_hz

    def response(frequency_hz: _Floats) -> _Complex:
        rise = np.clip((frequency_hz / low - 1) / (2 * _FLANK) + 0.5, 0.0, 1.0)
        fall = np.clip((high - frequency_hz) / (0.1 * high) + 0.5, 0.0, 1.0)
        gain = np.sin(np.pi / 2 * rise) ** 2 * np.sin(np.pi / 2 * fall) ** 2
        circular = 2 * np.pi * np.maximum(frequency_hz, (1 - _FLANK) * low)
        return np.asarray(gain / (1j * circular) ** times, np.complex128)

    return response


def _whole_signals(task: CorrectionTask, plane: Plane) -> _Signals:
    """Bridge what is clipped or missing; leave out what cannot be bridged."""
    found = accelerometers(task.record, plane, task.package)
    good = np.zeros(len(task.package.channel), bool)
    whole = _Signals([], [], {}, clipped=good, lost=good.copy(), left_out=[])
    for sensor in found:
        lost = sensor.channel.bridged | ~np.isfinite(sensor.acceleration)
        clipped = sensor.channel.clipped & ~lost
        bad, samples = clipped | lost, sensor.acceleration
        if bad.any():
            samples = np.where(lost, np.nan, samples)
            bridged = bridge(samples, bad, sensor.channel.rate_hz)
            if bridged is None:
                whole.left_out.append(sensor.channel.name)
                continue
            restored = np.where(bad, bridged.samples - np.where(lost, 0.0, samples), 0.0)
            whole.bridged[len(whole.sensors)] = restored, bridged
            samples = bridged.samples
            whole.clipped[clipped] = True
            whole.lost[lost] = True
        whole.sensors.append(sensor)
        whole.samples.append(samples)
    if len(whole.sensors) < _LEAST_SENSORS:
        raise RecordingError(
            f"{task.record.name}: too many samples of {' and '.join(whole.left_out)} are clipped "
            f"or missing to correct {plane} by kinematics; use another method, or record with a "
            "wider range"
        )
    return whole


def _own_std(
    task: CorrectionTask, signals: _Signals, velocities: _Floats, band: tuple[float, float]
) -> _Floats:
    """Uncertainty of the integrated signals by noise and gain [sensor, m/s]."""
    noise = np.array(
        [_noise_density(each, task.package.channel.rate_hz, band[1]) for each in signals.samples]
    )
    drift = noise / (4 * np.pi**2 * band[0])  # variance of white noise integrated from the edge up
    gain = task.relative_std**2 * np.mean(velocities**2, axis=1)
    return np.asarray(np.sqrt(drift + gain + _QUIETEST**2))


def _motion(
    signals: _Signals,
    velocities: _Floats,
    foreign: _Floats,
    own_std: _Floats,
    sine: _Floats,
    rate_hz: float,
    band: tuple[float, float],
) -> PlaneMotion:
    std = np.sqrt(own_std**2 + np.mean(foreign**2, axis=1))
    weights = rigid_weights(signals.ahead_m, std)
    at_package, rate = weights @ velocities
    left = velocities - at_package - np.outer(signals.ahead_m, rate)
    slope = weights[1] @ np.array(signals.samples)
    tilt = filter_spectrum(slope, rate_hz, [_integral(band, 3)])[0]
    return PlaneMotion(
        sensors=signals.sensors,
        weights=weights,
        velocities=velocities,
        velocity=at_package + STANDARD_GRAVITY * sine * tilt,
        rate=rate,
        foreign=foreign,
        misfit=_misfit(left, std),
        repairs=_repairs(signals, rate_hz, _integral(band, 1)),
        clipped=signals.clipped,
        lost=signals.lost,
        left_out=signals.left_out,
    )


def _misfit(left: _Floats, std: _Floats) -> float:
    freedom = left.shape[0] - _LEAST_SENSORS
    if freedom == 0:
        return 0.0
    return float(np.sqrt(np.sum(np.mean(left**2, axis=1) / std**2) / freedom))


def _noise_density(samples: _Floats, rate_hz: float, above_hz: float) -> float:
    """Power spectral density of the noise, from above the band [(m/s^2)^2/Hz]."""
    segment = min(samples.size, round(_SEGMENT_S * rate_hz))
    bins, density = scipy.signal.welch(samples, rate_hz, nperseg=segment)
    free = density[(bins > min(_NOISE_FROM * above_hz, 0.42 * rate_hz)) & (bins < 0.48 * rate_hz)]
    return float(np.median(free)) if free.size else 0.0


def _repairs(
    signals: _Signals, rate_hz: float, integral: Callable[[_Floats], _Complex]
) -> list[Repair]:
    return [
        Repair(
            sensor=index,
            restored=filter_spectrum(restored, rate_hz, [integral])[0],
            draws=filter_spectrum(bridged.draws, rate_hz, [integral])[0],
        )
        for index, (restored, bridged) in signals.bridged.items()
    ]
