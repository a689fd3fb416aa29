"""The signal analyser's part of the test: averaged spectra and frequency responses.

In the paper a 16-channel dynamic signal analyser watched shaker force, balance moments, package
output and accelerations, and found the natural frequencies from sine sweeps. Here the same follows
from any record that holds the channels: a sweep, a random record or a burst.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial.channels import check_same_clock, finite
from glint_aoa.inertial.coherence import independent_averages
from glint_aoa.records.acquisition import AcquisitionRecord, Channel

__all__ = [
    "AveragedSpectra",
    "Estimator",
    "FrequencyResponses",
    "averaged_spectra",
    "frequency_responses",
]

_Floats = NDArray[np.float64]
_Complex = NDArray[np.complex128]
Estimator = Literal["H1", "H2"]

_SEGMENT_S = 8.0  # bins of 0.125 Hz: several to a resonance of 1 % damping at 9 Hz
_LEAST_SEGMENTS = 2  # the coherence of one alone is 1


@dataclass(frozen=True, eq=False)
class AveragedSpectra:
    """One-sided averaged power spectral densities.

    Attributes
    ----------
    frequency_hz : ndarray [bin]
        Frequencies [Hz], evenly spaced from zero.
    density : ndarray [channel, bin]
        Densities, square of each channel's unit per Hz.
    channels : tuple of Channel
        In the order of `density`.
    averages : float
        Number of independent segments averaged; each bin's relative standard deviation is
        one over its square root, for a random signal.
    """

    frequency_hz: _Floats
    density: _Floats
    channels: tuple[Channel, ...]
    averages: float


@dataclass(frozen=True, eq=False)
class FrequencyResponses:
    """Frequency responses of several channels to one reference.

    Attributes
    ----------
    frequency_hz : ndarray [bin]
        Frequencies [Hz], evenly spaced from zero.
    response : ndarray [channel, bin]
        Complex responses, unit of the channel per unit of the reference; NaN where the reference
        has no power.
    coherence : ndarray [channel, bin]
        Ordinary coherence with the reference, 0 to 1.
    reference : Channel
        What they are responses to.
    channels : tuple of Channel
        In the order of `response`.
    averages : float
        Number of independent segments averaged.
    """

    frequency_hz: _Floats
    response: _Complex
    coherence: _Floats
    reference: Channel
    channels: tuple[Channel, ...]
    averages: float

    @property
    def relative_std(self) -> _Floats:
        """Standard deviation of the magnitude over the magnitude, 1 sigma [channel, bin].

        sqrt((1 - coherence) / (2 n coherence)) with n averages (Bendat and Piersol, Random Data,
        table 9.6); infinite where nothing is coherent. It does not hold the bias of a resonance
        narrower than a bin.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = (1 - self.coherence) / (2 * self.averages * self.coherence)
        return np.asarray(np.sqrt(np.where(self.coherence > 0, np.maximum(ratio, 0.0), np.inf)))


def averaged_spectra(
    record: AcquisitionRecord, names: Sequence[str], *, segment_s: float = _SEGMENT_S
) -> AveragedSpectra:
    """Average the power spectra of channels over a record.

    Welch's method, Hann windows half overlapped, mean of each segment removed (scipy.signal.welch).

    Parameters
    ----------
    record : AcquisitionRecord
        The record.
    names : sequence of str
        Channels, in the order of the result; all on one clock.
    segment_s : float
        Length of a segment [s]; bins are its inverse apart. Cut down to the record's length.

    Returns
    -------
    AveragedSpectra
        In the channels' own units.

    Raises
    ------
    InputError
        If no channel is named or `segment_s` is not above zero.
    RecordingError
        If a channel is missing or not finite, or clocks differ.
    """
    channels = _on_one_clock(record, names)
    segment = _segment(channels[0], segment_s)
    rate = channels[0].rate_hz
    signals = np.array([_signal(record, channel) for channel in channels])
    frequency, density = scipy.signal.welch(signals, rate, nperseg=segment)
    return AveragedSpectra(
        np.asarray(frequency),
        np.asarray(density),
        channels,
        independent_averages(len(channels[0]), segment),
    )


def frequency_responses(
    record: AcquisitionRecord,
    reference: str,
    names: Sequence[str],
    *,
    estimator: Estimator = "H1",
    segment_s: float = _SEGMENT_S,
) -> FrequencyResponses:
    """Estimate the frequency responses of channels to a reference, and their coherence.

    H1 = S_xy / S_xx, H2 = S_yy / S_yx, coherence = |S_xy|^2 / (S_xx S_yy), with the reference x and
    spectra averaged over Hann windows, half overlapped (scipy.signal.csd).

    Parameters
    ----------
    record : AcquisitionRecord
        A random record, or a sine sweep whatever its rate: segments count by the power that the
        reference has in them.
    reference : str
        The reference's channel, such as the shaker's force or a balance moment.
    names : sequence of str
        Channels to take the responses of, on the reference's clock.
    estimator : {"H1", "H2"}
        H1 is biased low by noise of the reference, as near a resonance, where a shaker's force
        drops; H2 is biased high by noise of the response, as between resonances.
    segment_s : float
        Length of a segment [s]; bins are its inverse apart.

    Returns
    -------
    FrequencyResponses
        In the order of `names`.

    Raises
    ------
    InputError
        If the estimator is unknown, no channel is named, or `segment_s` is not above zero.
    RecordingError
        If a channel is missing, not finite or on another clock, or the record is shorter than two
        segments, whose coherence would be 1 whatever they hold.

    Notes
    -----
    A resonance narrower than about four bins is lowered and widened by the window, in all channels
    alike: mode shapes keep, dampings grow.
    """
    if estimator not in ("H1", "H2"):
        raise InputError(f"estimator is {estimator!r}; choose H1 or H2")
    first, *others = _on_one_clock(record, [reference, *names])
    segment = _segment(first, segment_s)
    if len(first) < _LEAST_SEGMENTS * segment:
        raise RecordingError(
            f"{record.name}: lasts {len(first) / first.rate_hz:.3g} s, but coherence takes two "
            f"segments of {segment_s:g} s; record longer or shorten the segments"
        )
    drive = _signal(record, first)
    answers = np.array([_signal(record, channel) for channel in others])
    rate = first.rate_hz
    frequency, drive_power = scipy.signal.welch(drive, rate, nperseg=segment)
    cross = scipy.signal.csd(drive, answers, rate, nperseg=segment)[1]
    power = scipy.signal.welch(answers, rate, nperseg=segment)[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        response = cross / drive_power if estimator == "H1" else power / cross.conj()
        coherence = np.abs(cross) ** 2 / (drive_power * power)
    return FrequencyResponses(
        frequency_hz=np.asarray(frequency),
        response=np.where(np.isfinite(response), response, np.nan),
        coherence=np.nan_to_num(np.clip(coherence, 0.0, 1.0)),
        reference=first,
        channels=tuple(others),
        averages=independent_averages(len(first), segment),
    )


def _on_one_clock(record: AcquisitionRecord, names: Sequence[str]) -> tuple[Channel, ...]:
    if not names:
        raise InputError("no channels are named; name those to analyse")
    channels = tuple(record[name] for name in names)
    for other in channels[1:]:
        check_same_clock(record, channels[0], other)
    return channels


def _segment(channel: Channel, segment_s: float) -> int:
    if not segment_s > 0:
        raise InputError(f"segment_s is {segment_s:g}; give a length above zero [s]")
    return min(len(channel), max(2, round(segment_s * channel.rate_hz)))


def _signal(record: AcquisitionRecord, channel: Channel) -> _Floats:
    return finite(record, channel, np.asarray(channel.samples, np.float64) * channel.scale)
