"""The spectral method of the paper's reference 7 (Young and others): peaks and radii.

Natural frequencies and peak accelerations A_r of the modes are read from the spectra of the
tangential accelerations; the bias is the second term of eq. 9, sum of A_r^2 / (2 w_r^2 rho_r). One
figure holds for the whole record.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.inertial import nlr
from glint_aoa.inertial.channels import Accelerometer, tangential
from glint_aoa.inertial.consistency import shown_by_package
from glint_aoa.inertial.estimate import BiasEstimate, CorrectionTask
from glint_aoa.inertial.filters import integrate_band
from glint_aoa.inertial.harmonic import servo_lag
from glint_aoa.inertial.lateral import sensor_per_accelerometer
from glint_aoa.inertial.modes import CREDIBLE_TURN, PLANES, Mode
from glint_aoa.inertial.spectrum import PlaneSpectrum
from glint_aoa.inertial.unlisted import named_unlisted, unlisted_resonances, unlisted_terms

__all__ = ["SpectralPeak", "estimate_bias", "missing", "spectral_peak"]

_Floats = NDArray[np.float64]

_STANDS_OUT = 4.0  # times the background's energy: a peak
_HALF_WIDTH = 0.15  # of the frequency: a resonance with its modulation
_NOT_DENIED = 0.05
"""Relative difference of mean bias and second harmonic that linear vibration explains."""

_MEDIAN_OF_CHI_SQUARE = np.log(2.0)
"""Median over mean of the power of noise in a bin."""


@dataclass(frozen=True)
class SpectralPeak:
    """A mode as its acceleration's spectrum shows it.

    Attributes
    ----------
    frequency_hz : float
        Frequency w_r / 2 pi at which peak acceleration and peak velocity agree [Hz].
    acceleration : float
        Peak acceleration A_r of a sine of the peak's energy, background taken off [m/s^2].
    background : float
        Part of the energy in the peak's band that is background, 0 to 1.
    """

    frequency_hz: float
    acceleration: float
    background: float


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
    return nlr.missing(task)


def spectral_peak(
    acceleration: _Floats, rate_hz: float, *, low_hz: float, high_hz: float
) -> SpectralPeak | None:
    """Read a mode's peak acceleration and frequency from the spectrum of a whole record.

    Parameters
    ----------
    acceleration : ndarray [sample]
        Tangential acceleration [m/s^2].
    rate_hz : float
        Samples a second [Hz].
    low_hz, high_hz : float
        Band of the mode [Hz].

    Returns
    -------
    SpectralPeak or None
        None if the band holds less than four times the energy that the background on either
        side of it has.

    Notes
    -----
    Energies are summed over the band of the Hann-windowed spectrum, so a sine between two bins,
    and one whose amplitude changes, count in full: A_r^2 / 2 is the mean square.
    """
    bins, power = _spectrum(acceleration, rate_hz)
    inside = (bins >= low_hz) & (bins <= high_hz)
    background = _beside(bins, power, low_hz, high_hz)
    velocity = power[inside] / (2 * np.pi * bins[inside]) ** 2
    noise = background / (2 * np.pi * bins[inside]) ** 2
    own = float(np.sum(velocity) - np.sum(noise))
    if own < (_STANDS_OUT - 1) * float(np.sum(noise)) or own <= 0:
        return None
    squared = float(np.sum(power[inside])) / float(np.sum(velocity))
    return SpectralPeak(
        frequency_hz=float(np.sqrt(squared)) / (2 * np.pi),
        acceleration=float(np.sqrt(2 * squared * own)),
        background=float(np.sum(noise) / np.sum(velocity)),
    )


def estimate_bias(task: CorrectionTask) -> BiasEstimate:
    """Estimate the mean bias of a record from the peaks of its spectra, eq. 9.

    Parameters
    ----------
    task : CorrectionTask
        A record with an accelerometer on the package for each plane that has modes.

    Returns
    -------
    BiasEstimate
        The same addition [m/s^2] for every sample. Error terms: the radii, the background under
        each peak, by how much the package's second harmonic denies a mode's bias, and by how much
        the bias of the moment departs from its mean.

    Notes
    -----
    The method holds for stationary vibration; where the vibration grows and fades the mean of the
    record is still right and single rows are not, which their uncertainty says. Energy of another
    mode within 15 % of a mode's frequency is taken for its own: with a small radius that is wrong
    by any factor. A resonance that no mode lists is named and widens the uncertainty, as in the
    modal correction. A peak whose radius implies a turning of more than 1 deg corrects nothing.
    """
    found = []
    for plane in PLANES:
        modes = tuple(mode for mode in task.modes if mode.plane == plane)
        sensor = tangential(task.record, plane, task.package) if modes else None
        if sensor is not None:
            found.append(_plane(task, modes, sensor))
    mean = sum(each.mean for each in found)
    unlisted = [each for plane in found for each in plane.unlisted_hz]
    peaks = {number: peak for each in found for number, peak in each.peaks.items()}
    return BiasEstimate(
        addition=np.full(len(task.package.channel), mean),
        std_terms=[term for each in found for term in each.std_terms],
        channels=tuple(each.sensor.channel for each in found),
        settling_s=0.0,
        why=(
            "peaks of the spectra of "
            f"{' and '.join(each.sensor.channel.name for each in found)}, one mean bias for the "
            f"record; {_named(peaks)}{named_unlisted(unlisted)}"
        ),
        settings={
            "relative_std": task.relative_std,
            "mode_frequencies_hz": {k: peak.frequency_hz for k, peak in peaks.items()},
            "peak_accelerations_m_s2": {k: peak.acceleration for k, peak in peaks.items()},
            "unlisted_hz": tuple(unlisted),
        },
    )


@dataclass(frozen=True, eq=False)
class _PlaneMean:
    sensor: Accelerometer
    mean: float
    std_terms: list[_Floats]
    peaks: dict[int, SpectralPeak]
    unlisted_hz: list[float]


def _plane(task: CorrectionTask, modes: tuple[Mode, ...], sensor: Accelerometer) -> _PlaneMean:
    rate_hz = sensor.channel.rate_hz
    spectrum = PlaneSpectrum.of(sensor.acceleration, rate_hz, modes)
    unlisted = unlisted_resonances(spectrum)
    terms = unlisted_terms(task.package, sensor, modes, unlisted)
    mean = 0.0
    peaks: dict[int, SpectralPeak] = {}
    for mode, (low, high) in zip(modes, _bands(spectrum.peaks_hz), strict=True):
        peak = spectral_peak(sensor.acceleration, rate_hz, low_hz=low, high_hz=high)
        centre = (low + high) / 2 if peak is None else peak.frequency_hz
        factor = _per_square(task, mode, sensor, centre)
        velocity = integrate_band(sensor.acceleration, rate_hz, low_hz=low, high_hz=high)
        if peak is None or not _turns_credibly(peak, mode):
            terms.append(_unknown(velocity, factor, centre))
            continue
        bias = factor * (peak.acceleration / (2 * np.pi * peak.frequency_hz)) ** 2 / 2
        mean += bias
        peaks[mode.number] = peak
        passing = factor * velocity**2
        doubt = peak.background + _denied(task, passing, 2 * low, 2 * high)
        relative = float(np.hypot(task.relative_std, doubt))
        terms += [np.full(velocity.size, relative * bias), passing - np.mean(passing)]
    return _PlaneMean(sensor, mean, terms, peaks, unlisted)


def _turns_credibly(peak: SpectralPeak, mode: Mode) -> bool:
    """Whether the turning that the mode's radius implies is one that a sting allows."""
    turning = peak.acceleration / (2 * np.pi * peak.frequency_hz) ** 2 / abs(mode.radius_m)
    return bool(turning <= CREDIBLE_TURN)


def _unknown(velocity: _Floats, factor: float, frequency_hz: float) -> _Floats:
    """Error term of motion that is not credited: by the mode's radius, or what a sting allows."""
    by_turning = CREDIBLE_TURN * 2 * np.pi * frequency_hz * np.abs(velocity)
    return np.asarray(np.minimum(abs(factor) * velocity**2, by_turning))


def _denied(task: CorrectionTask, passing: _Floats, low_hz: float, high_hz: float) -> float:
    """Part of a predicted bias that the package's second harmonic denies, where it is recorded."""
    rate_hz = task.package.channel.rate_hz
    if task.package.is_filtered or high_hz > 0.45 * rate_hz:
        return 0.0
    shown, std = shown_by_package(
        task.package.specific_force, passing, rate_hz, low_hz=low_hz, high_hz=high_hz
    )
    if not np.isfinite(std):
        return 0.0
    lag = np.clip(-np.angle(shown), 0.0, servo_lag((low_hz + high_hz) / 2))
    return float(max(abs(shown - np.exp(-1j * lag)) - 2 * std - _NOT_DENIED, 0.0))


def _per_square(
    task: CorrectionTask, mode: Mode, sensor: Accelerometer, frequency_hz: float
) -> float:
    """Bias per square of the velocity that the accelerometer shows [1/m]."""
    force = float(np.mean(task.package.specific_force))
    ratio = sensor_per_accelerometer(mode, frequency_hz, ahead_m=sensor.ahead_m, force=force)
    return ratio**2 / mode.radius_m


def _spectrum(samples: _Floats, rate_hz: float) -> tuple[_Floats, _Floats]:
    """Mean square in each bin of the Hann-windowed spectrum; they add up to that of the signal."""
    signal = np.asarray(samples, np.float64)
    window = scipy.signal.windows.hann(signal.size, sym=False)
    spectrum = scipy.fft.rfft(window * (signal - signal.mean()))
    power = 2 * np.abs(spectrum) ** 2 / (signal.size * np.sum(window**2))
    return scipy.fft.rfftfreq(signal.size, 1 / rate_hz), np.asarray(power)


def _beside(bins: _Floats, power: _Floats, low_hz: float, high_hz: float) -> _Floats:
    """Background in the bins of a band, between the levels on either side of it."""
    width = (high_hz - low_hz) / 3
    left = power[(bins >= low_hz - width) & (bins < low_hz)]
    right = power[(bins > high_hz) & (bins <= high_hz + width)]
    levels = [float(np.median(side)) / _MEDIAN_OF_CHI_SQUARE for side in (left, right)]
    inside = bins[(bins >= low_hz) & (bins <= high_hz)]
    return np.asarray(np.interp(inside, (low_hz, high_hz), levels))


def _bands(centres: list[float]) -> list[tuple[float, float]]:
    """Bands around the peaks, at most to the middle between two."""
    middles = [(one + two) / 2 for one, two in itertools.pairwise(centres)]
    edges = [0.0, *middles, np.inf]
    return [
        (max((1 - _HALF_WIDTH) * centre, low), min((1 + _HALF_WIDTH) * centre, high))
        for centre, low, high in zip(centres, edges[:-1], edges[1:], strict=True)
    ]


def _named(peaks: dict[int, SpectralPeak]) -> str:
    if not peaks:
        return "no mode stands out"
    return "modes " + ", ".join(
        f"{number} ({peak.acceleration:.3g} m/s^2 at {peak.frequency_hz:.3g} Hz)"
        for number, peak in sorted(peaks.items())
    )
