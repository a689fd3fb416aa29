"""The mean angle of a point, which need not be the mean of its fields."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

__all__ = ["MeanAngle", "mean_angle"]

_Array = NDArray[np.float64]

_PADDING = 8  # times the record, so that a vibration between two bins is seen
_MAIN_LOBE = 2.0  # half the main lobe of a Hann window, in bins of the record
_LEAST_FIELDS = 8  # for a spectrum
_COVERAGE = 1.96  # of a normal distribution's 95 %


@dataclass(frozen=True)
class MeanAngle:
    """Mean of a point's angles [as given], its standard deviation, 1 sigma, and the method."""

    mean: float
    std: float
    method: Literal["plain", "tapered"]

    def expanded(self, systematic_std: float = 0.0) -> float:
        """Half the 95 % interval [as given], a systematic part included."""
        return _COVERAGE * float(np.hypot(self.std, systematic_std))


def mean_angle(
    angle: ArrayLike, *, method: Literal["auto", "plain", "tapered"] = "auto"
) -> MeanAngle:
    """Average the angles of consecutive fields.

    The plain mean of a vibrating angle keeps what does not close in the record: amplitude *
    sin(pi f T) / (pi f T) of a vibration of frequency f over T seconds. A Hann taper keeps next
    to none of it, at the price of 1.22 times the noise. ``"auto"`` takes the one whose predicted
    variance is smaller.

    Parameters
    ----------
    angle : array_like, shape (field,)
        Angles at equal intervals; NaN for a field that was not measured.
    method : {"auto", "plain", "tapered"}, optional
        How to weight the fields.

    Returns
    -------
    MeanAngle
        Mean, its 1-sigma standard deviation and the method; NaN where no field was measured.

    Notes
    -----
    The variance is the integral of the record's own spectrum (Hann-tapered periodogram, its
    lowest bins replaced by its noise level) times the squared response of the weights. A motion
    slower than two cycles a record cannot be told from the mean and is not in it.
    """
    angle = np.asarray(angle, np.float64)
    there = np.isfinite(angle)
    if there.sum() < _LEAST_FIELDS:
        return _short_mean(angle[there])
    filled = np.interp(np.arange(angle.size), np.flatnonzero(there), angle[there])
    candidates = {
        "plain": there / there.sum(),
        "tapered": _normalised(signal.windows.hann(angle.size + 2)[1:-1] * there),
    }
    spectrum = _spectrum(filled)
    predicted = {name: _variance_of_mean(w, spectrum) for name, w in candidates.items()}
    chosen = min(predicted, key=lambda name: predicted[name]) if method == "auto" else method
    mean = float(candidates[chosen] @ filled)
    return MeanAngle(mean, float(np.sqrt(predicted[chosen])), chosen)  # type: ignore[arg-type]


def _short_mean(angle: _Array) -> MeanAngle:
    if angle.size == 0:
        return MeanAngle(np.nan, np.nan, "plain")
    std = angle.std(ddof=1) / np.sqrt(angle.size) if angle.size > 1 else np.nan
    return MeanAngle(float(angle.mean()), float(std), "plain")


def _normalised(weight: _Array) -> _Array:
    share: _Array = weight / weight.sum()
    return share


def _spectrum(angle: _Array) -> _Array:
    """Two-sided power in each padded bin; the sum is the variance about the mean."""
    taper = signal.windows.hann(angle.size + 2)[1:-1]
    departure = angle - _normalised(taper) @ angle
    padded = angle.size * _PADDING
    power = np.abs(np.fft.fft(departure * taper, padded)) ** 2
    power /= padded * (taper**2).sum()
    frequency = np.abs(np.fft.fftfreq(padded)) * angle.size  # in bins of the record
    low = frequency < _MAIN_LOBE
    # The median passes over the lines of a vibration; for noise it is ln 2 times the mean.
    power[low] = np.median(power[~low]) / np.log(2)
    return power


def _variance_of_mean(weight: _Array, spectrum: _Array) -> float:
    response = np.abs(np.fft.fft(weight, spectrum.size)) ** 2
    return float((spectrum * response).sum())
