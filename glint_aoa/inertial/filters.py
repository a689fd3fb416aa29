"""Filters of the inertial corrections: low-pass, band-pass, integration within a band."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import scipy.fft
import scipy.signal
from numpy.typing import ArrayLike, NDArray

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.setup import InertialFilter

__all__ = [
    "band_pass",
    "band_settling_s",
    "filter_spectrum",
    "integrate_band",
    "low_pass",
    "low_pass_sos",
    "noise_bandwidth_hz",
    "settling_s",
]

_Floats = NDArray[np.float64]
_Response = Callable[[_Floats], NDArray[np.float64] | NDArray[np.complex128]]

_SETTLED = 0.01
"""A filter has settled when its step response stays within this of its end."""

_PAD_S = 4.0
"""Reflected samples at either end of a record before its spectrum is filtered [s]."""


def low_pass_sos(filter_: InertialFilter, rate_hz: float) -> _Floats:
    """Design the package's low-pass as second-order sections.

    Parameters
    ----------
    filter_ : InertialFilter
        Kind, order and cutoff; the response at the cutoff is -3 dB for both kinds.
    rate_hz : float
        Samples a second [Hz].

    Returns
    -------
    ndarray [section, 6]
        Second-order sections as `scipy.signal.sosfilt` takes them.

    Raises
    ------
    InputError
        If the cutoff is not below half the sampling rate.
    """
    if not 0 < filter_.cutoff < rate_hz / 2:
        raise InputError(
            f"inertial.filter: a cutoff of {filter_.cutoff:g} Hz cannot be had at {rate_hz:g} "
            "samples a second; it must lie below half of them"
        )
    if filter_.kind == "bessel":
        sections = scipy.signal.bessel(
            filter_.order, filter_.cutoff, norm="mag", output="sos", fs=rate_hz
        )
    else:
        sections = scipy.signal.butter(filter_.order, filter_.cutoff, output="sos", fs=rate_hz)
    return np.asarray(sections, np.float64)


def low_pass(
    samples: ArrayLike, rate_hz: float, filter_: InertialFilter, *, causal: bool = False
) -> _Floats:
    """Run the package's low-pass over a signal.

    Parameters
    ----------
    samples : array_like [sample]
        The signal, in any unit.
    rate_hz : float
        Samples a second [Hz].
    filter_ : InertialFilter
        Kind, order and cutoff.
    causal : bool
        True: once forward, as on-line, from the steady state of the first sample; the result
        lags. False: forward and backward, without delay; the magnitude of the response is then
        squared (-6 dB at the cutoff), so fast changes are smoothed more.

    Returns
    -------
    ndarray [sample]
        The filtered signal, in its unit.

    Raises
    ------
    RecordingError
        If the record is shorter than the filter's settling time.

    Notes
    -----
    The forward-backward run continues the signal by its mirror image over one settling time at
    either end, which keeps the mean of a vibration. Within `settling_s` of an end the result
    still depends on that continuation.
    """
    signal = np.asarray(samples, np.float64)
    sections = low_pass_sos(filter_, rate_hz)
    settling = settling_s(filter_)
    if signal.size < settling * rate_hz:
        raise RecordingError(
            f"the record lasts {signal.size / rate_hz:.3g} s, but the {filter_.cutoff:g} Hz "
            f"low-pass needs {settling:.3g} s to settle; record longer or raise the cutoff"
        )
    if causal:
        state = scipy.signal.sosfilt_zi(sections) * signal[0]
        return np.asarray(scipy.signal.sosfilt(sections, signal, zi=state)[0])
    pad = min(signal.size - 1, round(settling * rate_hz))
    return np.asarray(
        scipy.signal.sosfiltfilt(sections, signal, padtype="even", padlen=pad), np.float64
    )


def settling_s(filter_: InertialFilter) -> float:
    """Time after which the low-pass stays within 1 % of its answer to a step [s]."""
    return _characteristics(filter_.kind, filter_.order)[0] / filter_.cutoff


def noise_bandwidth_hz(filter_: InertialFilter, *, causal: bool = False) -> float:
    """Bandwidth of white noise that the low-pass lets through, one-sided [Hz].

    Variance after the filter = one-sided power spectral density before it times this.
    """
    _, forward, both_ways = _characteristics(filter_.kind, filter_.order)
    return (forward if causal else both_ways) * filter_.cutoff


@cache
def _characteristics(kind: str, order: int) -> tuple[float, float, float]:
    """Settling time times cutoff, and noise bandwidths over cutoff, once and both ways."""
    rate, length = 100.0, 4000  # samples in a period of the cutoff; 40 periods
    unit = InertialFilter.model_validate({"kind": kind, "order": order, "cutoff": "1 Hz"})
    impulse = np.zeros(length)
    impulse[0] = 1.0
    response = scipy.signal.sosfilt(low_pass_sos(unit, rate), impulse)
    late = np.flatnonzero(np.abs(1.0 - np.cumsum(response)) > _SETTLED)
    forward = rate / 2 * np.sum(response**2)
    both_ways = rate / 2 * np.sum(scipy.signal.fftconvolve(response, response) ** 2)
    return (float(late[-1]) + 1) / rate, float(forward), float(both_ways)


def band_pass(
    samples: ArrayLike, rate_hz: float, low_hz: float, high_hz: float, *, order: int = 4
) -> _Floats:
    """Isolate a band around a mode, without delay.

    A Butterworth band-pass run forward and backward; the magnitude is squared, so the edges of
    the band are at -6 dB.

    Parameters
    ----------
    samples : array_like [sample]
        The signal, in any unit.
    rate_hz : float
        Samples a second [Hz].
    low_hz, high_hz : float
        Edges of the band [Hz].
    order : int
        Order of the low-pass prototype.

    Returns
    -------
    ndarray [sample]
        The signal within the band; unsettled within `band_settling_s` of an end.

    Raises
    ------
    InputError
        If the band does not lie between zero and half the sampling rate.
    RecordingError
        If the record is shorter than the band's settling time.
    """
    signal = _checked_band(samples, rate_hz, low_hz, high_hz)
    sections = scipy.signal.butter(
        order, (low_hz, high_hz), btype="bandpass", output="sos", fs=rate_hz
    )
    pad = min(signal.size - 1, round(band_settling_s(low_hz, high_hz) * rate_hz))
    filtered = scipy.signal.sosfiltfilt(sections, signal, padtype="odd", padlen=pad)
    return np.asarray(filtered, np.float64)


def integrate_band(
    acceleration: ArrayLike, rate_hz: float, *, low_hz: float, high_hz: float
) -> _Floats:
    """Integrate an acceleration to a velocity within a band.

    Division by j w of the spectrum, so there is neither drift nor an error of phase or
    amplitude inside the band; the band's flanks are raised cosines, half a flank of a tenth
    of the band's width outside either edge.

    Parameters
    ----------
    acceleration : array_like [sample]
        Acceleration [m/s^2].
    rate_hz : float
        Samples a second [Hz].
    low_hz, high_hz : float
        Edges of the band [Hz], -6 dB.

    Returns
    -------
    ndarray [sample]
        Velocity [m/s]; unsettled within `band_settling_s` of an end.

    Raises
    ------
    InputError
        If the band does not lie between zero and half the sampling rate.
    RecordingError
        If the record is shorter than the band's settling time.
    """
    signal = _checked_band(acceleration, rate_hz, low_hz, high_hz)
    flank = min(0.1 * (high_hz - low_hz), low_hz)

    def response(frequency_hz: _Floats) -> NDArray[np.complex128]:
        rise = np.clip((frequency_hz - low_hz) / flank + 0.5, 0.0, 1.0)
        fall = np.clip((high_hz - frequency_hz) / flank + 0.5, 0.0, 1.0)
        gain = np.sin(np.pi / 2 * rise) ** 2 * np.sin(np.pi / 2 * fall) ** 2
        circular = 2 * np.pi * np.maximum(frequency_hz, 1e-12)
        return np.asarray(gain / (1j * circular), np.complex128)

    return filter_spectrum(signal, rate_hz, [response])[0]


def band_settling_s(low_hz: float, high_hz: float) -> float:
    """Time from an end of the record within which a band is not to be trusted [s].

    Two periods of the band's width: a signal cannot be told from its continuation faster.
    """
    return 2.0 / (high_hz - low_hz)


def filter_spectrum(
    samples: ArrayLike, rate_hz: float, responses: Sequence[_Response]
) -> list[_Floats]:
    """Filter signals by several frequency responses, sharing their spectra.

    Parameters
    ----------
    samples : array_like [..., sample]
        One signal or more, in any unit; means are removed.
    rate_hz : float
        Samples a second [Hz].
    responses : sequence of callables
        Each takes frequencies [Hz] from zero up and returns the complex response.

    Returns
    -------
    list of ndarray [..., sample]
        The filtered signals of each response.

    Notes
    -----
    The record is continued by its mirror image, faded out over four seconds, so that its ends
    do not meet.
    """
    signal = np.asarray(samples, np.float64)
    signal = signal - signal.mean(axis=-1, keepdims=True)
    length = signal.shape[-1]
    pad = min(length - 1, round(_PAD_S * rate_hz))
    size = scipy.fft.next_fast_len(length + 2 * pad, real=True)
    padded = np.zeros((*signal.shape[:-1], size))
    fade = np.sin(np.pi / 2 * (np.arange(pad) + 0.5) / max(pad, 1)) ** 2
    padded[..., :pad] = signal[..., pad:0:-1] * fade
    padded[..., pad : pad + length] = signal
    padded[..., pad + length : 2 * pad + length] = signal[..., -2 : -pad - 2 : -1] * fade[::-1]
    spectrum = scipy.fft.rfft(padded)
    frequency = scipy.fft.rfftfreq(size, 1 / rate_hz)
    inside = slice(pad, pad + length)
    return [
        np.asarray(scipy.fft.irfft(spectrum * response(frequency), n=size)[..., inside])
        for response in responses
    ]


def _checked_band(samples: ArrayLike, rate_hz: float, low_hz: float, high_hz: float) -> _Floats:
    if not 0 < low_hz < high_hz < rate_hz / 2:
        raise InputError(
            f"the band from {low_hz:g} to {high_hz:g} Hz cannot be had at {rate_hz:g} samples a "
            "second; it must rise from above zero to below half of them"
        )
    signal = np.asarray(samples, np.float64)
    settling = band_settling_s(low_hz, high_hz)
    if signal.size < settling * rate_hz:
        raise RecordingError(
            f"the record lasts {signal.size / rate_hz:.3g} s, but the band from {low_hz:g} to "
            f"{high_hz:g} Hz needs {settling:.3g} s to settle; record longer or widen the band"
        )
    return signal
