"""The second-harmonic method: the bias from the 2 w_r lines of the unfiltered output.

By eq. 6 a mode's centrifugal acceleration V^2 / (2 rho) (1 + cos 2 w t) shows at twice the mode's
frequency as large as in the mean. So the unfiltered output itself says how large the bias is; the
tangential accelerations say at which frequencies, and their squared integrals with which phase,
that is sign, and how the bias comes and goes. No radius is needed, and gains of the accelerometers
do not matter.
"""

from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.inertial.channels import Accelerometer, tangential
from glint_aoa.inertial.estimate import BiasEstimate, CorrectionTask
from glint_aoa.inertial.lateral import Resonance, integral_square, resonances
from glint_aoa.inertial.modes import PLANES, Plane

__all__ = [
    "BANDWIDTH_HZ",
    "HarmonicLine",
    "estimate_bias",
    "harmonic_lines",
    "missing",
    "servo_lag",
]

_Floats = NDArray[np.float64]
_Complex = NDArray[np.complex128]

_SIGNIFICANT = 3.0  # standard deviations: a line that is used
_HANN_BINS = 1.5  # neighbouring bins that one independent value of a Hann spectrum fills
_HIGHEST = 0.4  # of the sampling rate: where a second harmonic can be seen
_LEAKS = 0.03
"""Share of a transverse acceleration that the package may show by misalignment and tipping."""

_SHAPE_STD = 5e-4
"""Relative uncertainty of a line from tipping in gravity and from the ends of the record."""

_LAG = 0.5
"""Tangent of the phase beyond which a line is not the second harmonic of the motion seen."""

_CONTRADICTION = 0.25
"""Relative difference from a surveyed inverse radius beyond which neither is trusted."""

_ONE_MOTION = 0.99
"""Cosine between the second harmonics of two planes from which on one mode turns in both."""

_OUT_OF_PHASE = 2.0
"""Error in phase of a line over its part out of phase: that of two modes in quadrature."""

BANDWIDTH_HZ = 300.0
"""Of the package's unfiltered output [Hz]: a servo of second order that lags accordingly."""


@dataclass(frozen=True, eq=False)
class HarmonicLine:
    """Second harmonic of one mode in the package's output.

    Attributes
    ----------
    plane : {"yaw", "pitch"}
        Plane of the mode.
    resonance : Resonance
        The mode, in the tangential acceleration.
    square : ndarray [sample]
        Squared velocity of the accelerometer around it [(m/s)^2]; of those of both planes, where
        one mode turns in both.
    transfer : complex
        Output per `square` around twice the frequency, the servo's lag taken out [1/m]; -1 / rho
        for a mode.
    noise : float
        Standard uncertainty of its size [1/m] from noise and from what is linear in the motion.
    surveyed : float or None
        1 / rho of the mode that the setup lists at that frequency [1/m].
    """

    plane: Plane
    resonance: Resonance
    square: _Floats
    transfer: complex
    noise: float
    surveyed: float | None = None

    @property
    def inverse_radius(self) -> float:
        """1 / rho [1/m]: the size of the transfer, with the sign of its real part."""
        return -float(np.copysign(abs(self.transfer), self.transfer.real))

    @property
    def is_seen(self) -> bool:
        """Whether the line stands out of the noise, in phase or in opposition."""
        in_phase = abs(self.transfer.imag) <= _LAG * abs(self.transfer.real)
        return in_phase and abs(self.transfer) > _SIGNIFICANT * self.noise

    @property
    def std(self) -> float:
        """Standard uncertainty of `inverse_radius` [1/m].

        Noise; the part out of phase; by how much a survey contradicts it, beyond a quarter.
        """
        out_of_phase = _OUT_OF_PHASE * max(abs(self.transfer.imag) - self.noise, 0.0)
        contradiction = 0.0
        if self.surveyed is not None:
            contradiction = abs(self.inverse_radius - self.surveyed)
            if contradiction <= _CONTRADICTION * abs(self.surveyed):
                contradiction = 0.0
        own = _SHAPE_STD * abs(self.transfer)
        return float(np.sqrt(self.noise**2 + out_of_phase**2 + contradiction**2 + own**2))


def missing(task: CorrectionTask) -> str | None:
    """Say what the method lacks, or None if it can be used.

    Parameters
    ----------
    task : CorrectionTask
        Record and package output; modes are not needed.

    Returns
    -------
    str or None
        The missing channels, as the end of a sentence.
    """
    if task.package.is_filtered:
        return "the package's unfiltered output, which alone shows second harmonics"
    if all(tangential(task.record, plane, task.package) is None for plane in PLANES):
        return "an accelerometer at the package along model y or z"
    return None


def estimate_bias(task: CorrectionTask) -> BiasEstimate:
    """Estimate the bias from the second harmonics of the unfiltered output.

    Parameters
    ----------
    task : CorrectionTask
        A record of the unfiltered output and a tangential accelerometer.

    Returns
    -------
    BiasEstimate
        Sum of V_r^2 / rho_r [m/s^2], with 1 / rho_r from the lines. Error terms: the noise of
        each line, and what the package may show of linear vibration at the same frequency.

    Notes
    -----
    The paper's caution holds: the lines are small, and with several modes linear vibration of one
    (mode 3 at 19.5 Hz) lies on the second harmonic of another (mode 1 at 9.8 Hz), and sums of two
    frequencies near twice a third. A line that does not stand out, or not in phase, corrects
    nothing, and its size is part of the uncertainty. Where one sine drives two modes out of phase
    with each other, mean and second harmonic differ; such a line is out of phase, which widens the
    uncertainty. So does a servo that lags otherwise than one of 300 Hz, and a mode listed in the
    setup whose radius is another.
    """
    lines = harmonic_lines(task)
    sensors = _sensors(task)
    addition, terms = np.zeros(len(task.package.channel)), []
    for line in lines:
        if line.is_seen:
            addition += line.inverse_radius * line.square
            terms.append(line.std * line.square)
        else:
            terms.append(float(np.hypot(abs(line.transfer), line.std)) * line.square)
    seen = [line for line in lines if line.is_seen]
    names = ", ".join(f"{2 * line.resonance.frequency_hz:.3g} Hz" for line in seen)
    return BiasEstimate(
        addition=addition,
        std_terms=terms,
        channels=tuple(sensor.channel for sensor in sensors.values()),
        settling_s=1.0,
        why=f"second harmonics in {task.package.channel.name}: {names or 'none stands out'}",
        settings={
            "mode_frequencies_hz": tuple(line.resonance.frequency_hz for line in seen),
            "inverse_radii_per_m": tuple(line.inverse_radius for line in seen),
            "inverse_radius_stds_per_m": tuple(line.std for line in seen),
        },
    )


def harmonic_lines(task: CorrectionTask) -> list[HarmonicLine]:
    """Measure the second harmonic of each resonance of both planes, all together.

    Parameters
    ----------
    task : CorrectionTask
        As for `estimate_bias`.

    Returns
    -------
    list of HarmonicLine
        By plane and rising frequency; empty if no resonance is seen below a fifth of the
        sampling rate.

    Notes
    -----
    Least squares of the output's Hann-windowed spectrum on those of the squared velocities, over
    the bins within 16 % of any second harmonic. A mode that turns in both planes, in phase, has two
    proportional spectra that no fit could tell apart: its squared velocities are added, and the
    stronger plane names it.
    """
    rate_hz = task.package.channel.rate_hz
    sensors = _sensors(task)
    found = [
        (plane, each, integral_square(sensor.acceleration, rate_hz, each))
        for plane, sensor in sensors.items()
        for each in resonances(sensor.acceleration, rate_hz)
        if 2 * each.high_hz < _HIGHEST * rate_hz
    ]
    if not found:
        return []
    bins = scipy.fft.rfftfreq(task.package.specific_force.size, 1 / rate_hz)
    near = np.zeros(bins.size, bool)
    for _, each, _ in found:
        near |= (bins > 2 * each.low_hz) & (bins < 2 * each.high_hz)
    found = _joined(found, near)
    design = np.stack([_spectrum(square)[near] for _, _, square in found], axis=1)
    transfer, variance = _solve(design, _spectrum(task.package.specific_force)[near])
    leaks = {plane: _spectrum(sensor.acceleration)[near] for plane, sensor in sensors.items()}
    return [
        HarmonicLine(
            plane,
            each,
            square,
            complex(transfer[index] * np.exp(1j * servo_lag(2 * each.frequency_hz))),
            float(np.hypot(np.sqrt(variance[index]), _leak(design[:, index], leaks))),
            _surveyed(task, plane, each),
        )
        for index, (plane, each, square) in enumerate(found)
    ]


def _joined(
    found: list[tuple[Plane, Resonance, _Floats]], near: NDArray[np.bool_]
) -> list[tuple[Plane, Resonance, _Floats]]:
    """Add up the squares of resonances that are one mode's turns in both planes."""
    left = sorted(found, key=lambda each: -float(np.mean(each[2])))
    kept: list[tuple[Plane, Resonance, _Floats]] = []
    while left:
        plane, resonance, square = left.pop(0)
        strong = _spectrum(square)[near]
        alike = [
            each
            for each in left
            if each[0] != plane and _cosine(strong, _spectrum(each[2])[near]) > _ONE_MOTION
        ]
        left = [each for each in left if all(each is not other for other in alike)]
        kept.append((plane, resonance, square + sum(each[2] for each in alike)))
    order = [id(resonance) for _, resonance, _ in found]
    return sorted(kept, key=lambda each: order.index(id(each[1])))


def _cosine(one: _Complex, other: _Complex) -> float:
    """Cosine of the angle between two spectra; 1 where they are proportional and in phase."""
    return float(np.vdot(one, other).real / (np.linalg.norm(one) * np.linalg.norm(other)))


def servo_lag(frequency_hz: float) -> float:
    """Phase by which the package's servo lags, a Butterworth of second order of 300 Hz [rad]."""
    ratio = frequency_hz / BANDWIDTH_HZ
    return float(np.arctan2(np.sqrt(2) * ratio, 1 - ratio**2))


def _surveyed(task: CorrectionTask, plane: Plane, resonance: Resonance) -> float | None:
    near = [
        1 / mode.radius_m
        for mode in task.modes
        if mode.plane == plane and resonance.low_hz < mode.frequency_hz < resonance.high_hz
    ]
    return near[0] if len(near) == 1 else None


def _sensors(task: CorrectionTask) -> dict[Plane, Accelerometer]:
    found = {plane: tangential(task.record, plane, task.package) for plane in PLANES}
    return {plane: sensor for plane, sensor in found.items() if sensor is not None}


def _spectrum(samples: _Floats) -> _Complex:
    window = scipy.signal.windows.hann(samples.size, sym=False)
    return np.asarray(scipy.fft.rfft(window * (samples - samples.mean())), np.complex128)


def _solve(design: _Complex, output: _Complex) -> tuple[_Complex, _Floats]:
    """Complex least squares, and the variance of the part of each value that is in phase."""
    scale = np.sqrt(np.sum(np.abs(design) ** 2, axis=0))
    solution, *_ = np.linalg.lstsq(design / scale, output, rcond=None)
    left = output - design / scale @ solution
    free = max(output.size / _HANN_BINS - scale.size, 1.0)
    level = float(np.sum(np.abs(left) ** 2)) / _HANN_BINS / free
    inverse = np.linalg.pinv((design / scale).conj().T @ (design / scale))
    variance = _HANN_BINS * level * np.real(np.diag(inverse)) / 2 / scale**2
    return np.asarray(solution / scale), np.asarray(variance)


def _leak(square: _Complex, transverse: dict[Plane, _Complex]) -> float:
    """Transfer that linear vibration coherent with the second harmonic could feign."""
    power = float(np.sum(np.abs(square) ** 2))
    shown = (abs(np.vdot(square, signal)) / power for signal in transverse.values())
    return _LEAKS * float(np.sqrt(sum(each**2 for each in shown)))
