"""Long records of a vibrating angle, segment by segment: covariance, weights and variance."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from glint_aoa.optical.vibration import fit_vibration, trust_in_noise

__all__ = ["SegmentedCovariance", "segment_weights", "segmented_covariance", "variance_of"]

_Array = NDArray[np.float64]

_LENGTH = 128  # fields of a segment
_HOP = 32
_LEAST_SEGMENTS = 3  # without a gap, for a spectrum
_AT_A_TIME = 256  # segments
_KAISER_SHAPE = 10.0  # side lobes at -100 dB
_DRIFT_BINS = 4  # of a segment: the window's main lobe about zero
_QUIET_BINS = 8  # what lies between tells the noise at zero


class SegmentedCovariance(NamedTuple):
    """Covariance of noise and vibration, from segments of a long record.

    Attributes
    ----------
    lags : ndarray [lag]
        Of lags 0 to 127 [unit of the angle, squared]; zero beyond.
    dof : float
        Degrees of freedom of its sum over all lags, to which the variance of a mean is
        proportional.
    """

    lags: _Array
    dof: float


def segmented_covariance(angle: _Array, *, noise: float | None = None) -> SegmentedCovariance:
    """Covariance of noise and vibration over the lag in fields.

    Parameters
    ----------
    angle : ndarray [field]
        More than 128 angles at equal intervals; NaN for a field that was not measured.
    noise : float, optional
        Noise of a field [unit of the angle]; it steadies what the record tells of slow motion.

    Returns
    -------
    SegmentedCovariance
        From the mean periodogram (Welch 1967, doi:10.1109/TAU.1967.1161901) of the segments
        without a gap. Below four cycles a segment it is that of four to eight: slower motion is a
        drift, not noise. Where gaps leave fewer than three segments, it is that of the fullest
        segment as `fit_vibration` sees it.
    """
    segments = np.lib.stride_tricks.sliding_window_view(angle, _LENGTH)[:: _HOP // 2]
    counts = np.isfinite(segments).sum(axis=1)
    whole = np.flatnonzero(counts == _LENGTH)
    if whole.size < _LEAST_SEGMENTS:
        vibration = fit_vibration(segments[int(counts.argmax())], noise=noise)
        return SegmentedCovariance(_faded(vibration.covariance), 2 / vibration.uncertainty[0, 0])
    window = np.kaiser(_LENGTH, _KAISER_SHAPE)
    power = np.zeros(_LENGTH + 1)
    for few in np.array_split(whole, 1 + whole.size // _AT_A_TIME):
        departure = _straightened(segments[few]) * window
        power += (np.abs(np.fft.rfft(departure, 2 * _LENGTH)) ** 2).sum(axis=0)
    power /= whole.size * (window**2).sum()
    slow = float(power[2 * _DRIFT_BINS : 2 * _QUIET_BINS].mean())
    slow, dof = _steadied(slow, _dof(whole), noise)
    power[: 2 * _DRIFT_BINS] = slow
    return SegmentedCovariance(np.asarray(np.fft.irfft(power)[:_LENGTH], np.float64), dof)


def _straightened(segments: _Array) -> _Array:
    """Take mean and trend out of segments [segment, field]."""
    place = np.arange(_LENGTH) - (_LENGTH - 1) / 2
    trend = segments @ place / (place @ place)
    left: _Array = segments - segments.mean(axis=1, keepdims=True) - trend[:, None] * place
    return left


def _dof(whole: NDArray[np.int64]) -> float:
    """Degrees of freedom of a mean over overlapping segments and the bins that tell the noise."""
    there = np.zeros(int(whole[-1]) + 1)
    there[whole] = 1.0
    power = np.abs(np.fft.rfft(there, 2 * there.size)) ** 2
    apart = np.fft.irfft(power, 2 * there.size)[: there.size]  # pairs of segments, by distance
    shared = _shared_power()[: apart.size]
    pairs = apart[: shared.size] * np.where(np.arange(shared.size) == 0, 1.0, 2.0)
    return float(2 * whole.size**2 / (pairs @ shared))


@cache
def _shared_power() -> _Array:
    """Variance that segments of white noise share, by distance in hops; of one bin alone, 1."""
    window = np.kaiser(_LENGTH, _KAISER_SHAPE)
    bins = np.arange(2 * _DRIFT_BINS, 2 * _QUIET_BINS)
    waves = window * np.exp(1j * np.pi / _LENGTH * np.outer(bins, np.arange(_LENGTH)))
    waves /= np.sqrt((window**2).sum())
    shared = []
    for moved in range(0, _LENGTH, _HOP // 2):
        one, other = waves[:, moved:], waves[:, : _LENGTH - moved]
        # A real signal's wave correlates with itself and with its conjugate.
        both = np.abs(one @ other.conj().T) ** 2 + np.abs(one @ other.T) ** 2
        shared.append(both.mean())
    return np.array(shared)


def _steadied(variance: float, dof: float, noise: float | None) -> tuple[float, float]:
    """Join a variance of some degrees of freedom with the noise that was stated."""
    if noise is None:
        return variance, dof
    off = float(np.log(variance / noise**2))
    prior = 2 / trust_in_noise(off) ** 2
    return float(variance * np.exp(-off * prior / (dof + prior))), dof + prior


def _faded(covariance: _Array) -> _Array:
    """Let a covariance run out within a segment; cut off there, it would be none."""
    window = np.kaiser(_LENGTH, _KAISER_SHAPE)
    fading = np.correlate(window, window, "full")[_LENGTH - 1 :] / (window @ window)
    faded: _Array = np.pad(covariance, (0, _LENGTH - covariance.size)) * fading
    return faded


def segment_weights(there: NDArray[np.bool_], covariance: _Array) -> _Array:
    """Weights of generalised least squares in overlapping segments, added up.

    Parameters
    ----------
    there : ndarray [field]
        Whether each field was measured.
    covariance : ndarray [lag]
        As from `segmented_covariance`.

    Returns
    -------
    ndarray [field]
        Weights, not normalised; 0 where not measured. In the record's middle they are flat, so
        that next to nothing is lost against equal weights.
    """
    matrix = linalg.toeplitz(covariance)
    whole = np.linalg.solve(matrix, np.ones(_LENGTH))
    weights = np.zeros(there.size)
    for start in _starts(there.size):
        here = there[start : start + _LENGTH]
        part = weights[start : start + _LENGTH]
        if here.all():
            part += whole
        elif here.any():
            part[here] += np.linalg.solve(matrix[np.ix_(here, here)], np.ones(int(here.sum())))
    return weights


def _starts(length: int) -> NDArray[np.int64]:
    """Place segments so that they cover the record to its last field."""
    last = length - _LENGTH
    return np.unique(np.append(np.arange(0, last, _HOP), last))


def variance_of(weights: _Array, covariance: _Array) -> float:
    """Variance of a weighted mean.

    Parameters
    ----------
    weights : ndarray [field]
        The weights.
    covariance : ndarray [lag]
        Of the angle [angle^2]; zero beyond.

    Returns
    -------
    float
        The variance [angle^2].
    """
    size = weights.size
    overlap = [weights[lag:] @ weights[: size - lag] for lag in range(covariance.size)]
    return 2 * float(covariance @ overlap) - float(covariance[0] * overlap[0])
