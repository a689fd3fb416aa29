"""Power spectra, cross spectrum and coherence of two signals.

They tell a bias of vibration from a change of the angle: what the package takes for gravity
follows the squared velocity of the model, so the two are coherent (paper, eq. 10).
"""

from dataclasses import dataclass

import numpy as np
import scipy.signal
from numpy.typing import ArrayLike, NDArray

from glint_aoa.errors import InputError, RecordingError

__all__ = ["CrossSpectra", "cross_spectra"]

_Floats = NDArray[np.float64]

_LEAST_SAMPLES = 8


@dataclass(frozen=True, eq=False)
class CrossSpectra:
    """Averaged spectra of two signals, one-sided.

    Attributes
    ----------
    frequency_hz : ndarray [bin]
        Frequencies from zero up [Hz].
    first_power, second_power : ndarray [bin]
        Power spectral densities S_qq and S_yy [unit^2/Hz].
    cross : ndarray [bin]
        Cross spectral density S_qy [product of the units/Hz]; its angle is by how much the
        second signal lags.
    averages : float
        Number of independent segments in the average: powers of half-overlapped Hann windows
        are correlated by 1/36 (Welch 1967).
    """

    frequency_hz: _Floats
    first_power: _Floats
    second_power: _Floats
    cross: NDArray[np.complex128]
    averages: float

    @property
    def coherence(self) -> _Floats:
        """Coherence abs(S_qy)^2 / (S_qq S_yy) of eq. 10, squared as is usual [bin]; 0 to 1.

        It is 1 for any two signals where there is a single segment, and about 1 / `averages` for
        two that have nothing in common: see `by_chance`. Bins without power give 0.
        """
        product = self.first_power * self.second_power
        square = np.abs(self.cross) ** 2
        return np.asarray(np.divide(square, product, out=np.zeros(product.size), where=product > 0))

    def by_chance(self, probability: float = 0.05) -> float:
        """Coherence that independent signals exceed with a probability; 1 for one segment.

        1 - p^(1 / (n - 1)) for n independent segments (Carter, Knapp and Nuttall 1973,
        doi:10.1109/TAU.1973.1162496).
        """
        if self.averages <= 1:
            return 1.0
        return float(1 - probability ** (1 / (self.averages - 1)))

    def uncorrelated_rms(self, low_hz: float, high_hz: float) -> float:
        """Part of the second signal in a band that the first does not follow, rms.

        Parameters
        ----------
        low_hz, high_hz : float
            Edges of the band [Hz], both included.

        Returns
        -------
        float
            Root of the integral of S_yy (1 - coherence) [unit of the second signal]; the
            coherence's excess from averaging few segments is taken out.
        """
        inside = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        missing = 1 - self.coherence[inside]
        if self.averages > 1:
            missing = np.minimum(missing * self.averages / (self.averages - 1), 1.0)
        step = self.frequency_hz[1] - self.frequency_hz[0]
        return float(np.sqrt(np.sum(self.second_power[inside] * missing) * step))


def cross_spectra(
    first: ArrayLike, second: ArrayLike, rate_hz: float, *, segment_s: float
) -> CrossSpectra:
    """Average the spectra of two signals over half-overlapped Hann windows (Welch 1967).

    Parameters
    ----------
    first, second : array_like [sample]
        The signals q and y, sampled together; each segment's mean is removed.
    rate_hz : float
        Samples a second [Hz].
    segment_s : float
        Length of a segment [s]; one over it is the distance between bins. At most the record.

    Returns
    -------
    CrossSpectra
        As `scipy.signal.welch`, `csd` and `coherence` give them.

    Raises
    ------
    InputError
        If the signals differ in length, or a segment has fewer than 8 samples.
    RecordingError
        If the record is shorter than a segment.

    Notes
    -----
    Slow modulation, 0.3 Hz in the paper, takes segments of several of its periods and a record
    of several segments. The coherence of few segments is biased up, and that of a motion that
    comes and goes is an average over the record.
    """
    q, y = np.asarray(first, np.float64), np.asarray(second, np.float64)
    segment = round(segment_s * rate_hz)
    if q.shape != y.shape or q.ndim != 1:
        raise InputError(
            f"signals of shape {list(q.shape)} and {list(y.shape)} have no cross spectrum; give "
            "two of the same length"
        )
    if segment < _LEAST_SAMPLES:
        raise InputError(
            f"segment_s is {segment_s:g}, {segment} samples; give at least {_LEAST_SAMPLES}"
        )
    if q.size < segment:
        raise RecordingError(
            f"the record lasts {q.size / rate_hz:.3g} s, less than one segment of {segment_s:g} s; "
            "record longer or shorten segment_s"
        )
    frequency, cross = scipy.signal.csd(q, y, rate_hz, nperseg=segment)
    _, first_power = scipy.signal.welch(q, rate_hz, nperseg=segment)
    _, second_power = scipy.signal.welch(y, rate_hz, nperseg=segment)
    averages = independent_averages(q.size, segment)
    return CrossSpectra(frequency, first_power, second_power, cross, averages)


def independent_averages(samples: int, segment: int) -> float:
    """Count the independent segments among half-overlapped Hann windows, which share 1/36 of power.

    Welch 1967, IEEE Trans. Audio Electroacoust. 15(2), 70-73.

    Parameters
    ----------
    samples, segment : int
        Samples of the record and of a segment.

    Returns
    -------
    float
        Number of segments that would scatter as little without overlap.
    """
    count = 1 + (samples - segment) // (segment - segment // 2)
    return count / (1 + 2 / 36 * (count - 1) / count)
