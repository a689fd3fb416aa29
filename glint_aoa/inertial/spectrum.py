"""The averaged spectrum of one plane's acceleration, and the resonances in it."""

from dataclasses import dataclass

import numpy as np
import scipy.signal
from numpy.typing import ArrayLike, NDArray

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial.modes import Mode

__all__ = ["SEARCH_BAND", "PlaneSpectrum", "find_peak"]

_Floats = NDArray[np.float64]
_Mask = NDArray[np.bool_]

SEARCH_BAND = 0.15
"""A resonance is searched for within this fraction of its nominal frequency."""

_SEGMENT_S = 4.0  # of the averaged periodogram: bins of 0.25 Hz keep slow modulation in one line
_LEAST_S = 1.0  # bins of 1 Hz: coarser ones do not show a resonance beside its surroundings
_LOWEST, _HIGHEST = 0.4, 1.8  # times lowest and highest mode: the range that is shared out
_STANDS_OUT = 4.0  # times the median of its surroundings: a peak
_QUIETEST = 1e-18  # (m/s^2)^2/Hz: below the noise of any accelerometer, for one that is dead
_QUIET = 1e-12  # of the highest power: stands in for a floor where the signal has none


@dataclass(frozen=True, eq=False)
class PlaneSpectrum:
    """Averaged periodogram (Hann windows, half overlapped) over the range of a plane's modes.

    Attributes
    ----------
    bins_hz : ndarray [bin]
        Frequencies [Hz], from 0.4 times the lowest to 1.8 times the highest mode.
    power : ndarray [bin]
        Power spectral density of the acceleration [(m/s^2)^2/Hz]; never zero.
    averages : float
        Number of independent periodograms averaged.
    peaks_hz : list of float [mode]
        Where each resonance was found, or its nominal frequency [Hz].
    """

    bins_hz: _Floats
    power: _Floats
    averages: float
    peaks_hz: list[float]

    @classmethod
    def of(
        cls, acceleration: ArrayLike, rate_hz: float, modes: tuple[Mode, ...]
    ) -> "PlaneSpectrum":
        """Compute it.

        Parameters
        ----------
        acceleration : array_like [sample]
            Tangential acceleration at the package [m/s^2].
        rate_hz : float
            Samples a second [Hz].
        modes : tuple of Mode
            All modes of the plane, in order of frequency.

        Raises
        ------
        InputError
            If a mode lies beyond what the sampling rate can show.
        RecordingError
            If the record is too short to show a resonance.
        """
        _check_rate(rate_hz, modes)
        signal = np.asarray(acceleration, np.float64)
        if signal.size < _LEAST_S * rate_hz:
            raise RecordingError(
                f"the record lasts {signal.size / rate_hz:.3g} s, but telling vibration modes "
                f"apart takes {_LEAST_S:g} s; record longer"
            )
        segment = min(signal.size, round(_SEGMENT_S * rate_hz))
        bins, power = scipy.signal.welch(signal, rate_hz, nperseg=segment)
        frequencies = [mode.frequency_hz for mode in modes]
        low, high = _LOWEST * min(frequencies), min(_HIGHEST * max(frequencies), 0.45 * rate_hz)
        keep = (bins >= low) & (bins <= high)
        segments = 1 + (signal.size - segment) // (segment - segment // 2)
        bins, power = bins[keep], power[keep]
        power = power + _QUIET * float(np.max(power)) + _QUIETEST
        peaks = [_peak_of(bins, power, modes, index) for index in range(len(modes))]
        return cls(bins, power, 1 + 0.9 * (segments - 1), peaks)

    @property
    def step_hz(self) -> float:
        """Distance between bins [Hz]."""
        return float(self.bins_hz[1] - self.bins_hz[0])

    def energy(self, power: _Floats, where: _Mask) -> float:
        """Energy of the velocity in some bins, up to a constant."""
        return float(np.sum(power[where] / self.bins_hz[where] ** 2))


def find_peak(
    bins_hz: ArrayLike, power: ArrayLike, nominal_hz: float, *, low_hz: float, high_hz: float
) -> float:
    """Find the resonance near a nominal frequency.

    Parameters
    ----------
    bins_hz : array_like [bin]
        Frequencies of the spectrum [Hz], evenly spaced.
    power : array_like [bin]
        Its power, in any unit.
    nominal_hz : float
        What is returned if no peak stands out [Hz].
    low_hz, high_hz : float
        Where to search [Hz].

    Returns
    -------
    float
        Frequency of the highest peak [Hz], refined by a parabola through the logarithms of
        three bins; the nominal one if the highest bin is not a peak (the skirt of a neighbour
        rises to the end of the band) or is less than four times the median of the band.
    """
    bins, spectrum = np.asarray(bins_hz, np.float64), np.asarray(power, np.float64)
    inside = np.flatnonzero((bins >= low_hz) & (bins <= high_hz))
    inside = inside[(inside > 0) & (inside < bins.size - 1)]
    if inside.size == 0:
        return nominal_hz
    top = int(inside[np.argmax(spectrum[inside])])
    left, middle, right = spectrum[top - 1 : top + 2]
    is_peak = middle > left and middle >= right
    if not is_peak or middle < _STANDS_OUT * np.median(spectrum[inside]):
        return nominal_hz
    if min(left, right) <= 0:
        return float(bins[top])
    slope, curve = np.log(right / left), np.log(middle**2 / (left * right))
    return float(bins[top] + 0.5 * slope / curve * (bins[1] - bins[0]))


def _check_rate(rate_hz: float, modes: tuple[Mode, ...]) -> None:
    for mode in modes:
        if mode.frequency_hz * (1 + SEARCH_BAND) >= 0.45 * rate_hz:
            raise InputError(
                f"inertial.mode {mode.number}: {mode.frequency_hz:g} Hz is too high for "
                f"{rate_hz:g} samples a second; leave the mode out or record faster"
            )


def _peak_of(bins_hz: _Floats, power: _Floats, modes: tuple[Mode, ...], index: int) -> float:
    nominal = modes[index].frequency_hz
    low, high = nominal * (1 - SEARCH_BAND), nominal * (1 + SEARCH_BAND)
    if index > 0:
        low = max(low, (modes[index - 1].frequency_hz + nominal) / 2)
    if index < len(modes) - 1:
        high = min(high, (modes[index + 1].frequency_hz + nominal) / 2)
    return find_peak(bins_hz, power / bins_hz**2, nominal, low_hz=low, high_hz=high)
