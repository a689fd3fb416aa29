"""The mean angle of a point, which need not be the mean of its fields."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glint_aoa.coverage import ONE_SIGMA, coverage_factor, effective_freedom
from glint_aoa.optical._small_sample import LearntVariance
from glint_aoa.optical.segments import segment_weights, segmented_covariance, variance_of
from glint_aoa.optical.vibration import Vibration, VibrationLine, fit_vibration

__all__ = ["MeanAngle", "MeanMethod", "mean_angle"]

_Array = NDArray[np.float64]

MeanMethod = Literal["plain", "lines", "tapered", "process"]

_LEAST_FIELDS = 8  # to see a vibration in
_MOST_FIELDS = 240  # for a likelihood; longer records are taken in segments
_AS_GOOD = 1.02  # a simpler method may have this much more standard deviation
_KAISER = (4.0, 6.0, 8.0, 10.0)  # shape: side lobes from -45 to -100 dB
_AMPLITUDE_DEGREES = (0, 1, 2, 3, 4)
"""Degrees of the polynomials that the amplitude of a fitted line may follow."""
_LEARNT: frozenset[MeanMethod] = frozenset({"lines", "process"})
"""Methods whose weights follow what was learnt from the record."""


@dataclass(frozen=True, eq=False)
class MeanAngle:
    """Mean of a point's angles.

    Attributes
    ----------
    mean, std : float
        The mean and its uncertainty, 1 sigma [as given]: within it lies the truth in 68 % of all
        records, few fields and what was learnt from them allowed for.
    method : {"plain", "lines", "tapered", "process"}
        How it was taken; see `mean_angle`.
    weights : ndarray [field]
        What each field counts; the sum is 1, and 0 for a field that was not measured.
    lines : tuple of VibrationLine
        Vibrations found, by frequency [Hz], as the fields show them: below half the field rate.
    dof : float
        Degrees of freedom of `std`: how well the variance is known.
    """

    mean: float
    std: float
    method: MeanMethod
    weights: _Array
    lines: tuple[VibrationLine, ...] = ()
    dof: float = np.inf

    def expanded(self, systematic_std: float = 0.0, *, systematic_dof: float = np.inf) -> float:
        """Return half the 95 % interval [as given], a systematic part included.

        Parameters
        ----------
        systematic_std : float
            What all fields share, 1 sigma [as given].
        systematic_dof : float
            Its degrees of freedom.
        """
        own = self.std / coverage_factor(self.dof, ONE_SIGMA)
        parts = own**2, systematic_std**2
        freedom = float(effective_freedom(parts, (self.dof, systematic_dof)))
        return coverage_factor(freedom) * math.hypot(own, systematic_std)

    def of(self, values: ArrayLike) -> float:
        """Mean of other values [field] of the same fields, with the same weights."""
        used = self.weights != 0
        values = np.asarray(values, np.float64)
        return float(self.weights[used] @ values[used]) if used.any() else np.nan


def mean_angle(
    angle: ArrayLike,
    *,
    method: Literal["auto"] | MeanMethod = "auto",
    rate_hz: float = 1.0,
    vibration_hz: Sequence[float] = (),
    candidates_hz: Sequence[float] = (),
    noise: float | None = None,
) -> MeanAngle:
    """Average the angles of consecutive fields.

    The plain mean of a vibrating angle keeps what does not close in the record: amplitude *
    sin(pi f T) / (pi f T) of a vibration of frequency f over T seconds. Each method is a set of
    weights of the fields, so that what it does to noise and to a vibration can be predicted:

    ``"plain"``
        equal weights;
    ``"lines"``
        least squares of mean, trend and vibration lines together, the amplitude of each line a
        polynomial in time;
    ``"tapered"``
        a Kaiser window;
    ``"process"``
        generalised least squares with the covariance of the vibration (Aitken 1936,
        doi:10.1017/S0370164600014346), which nothing linear and unbiased can better if the
        covariance is right.

    ``"auto"`` takes the first of these whose predicted standard deviation is within 2 % of the
    least.

    Parameters
    ----------
    angle : array_like, shape (field,)
        Angles at equal intervals; NaN for a field that was not measured.
    method : {"auto", "plain", "lines", "tapered", "process"}, optional
        How to weight the fields.
    rate_hz : float, optional
        Fields a second [Hz]; unless given, frequencies are in cycles a field.
    vibration_hz : sequence of float, optional
        Known frequencies of vibration [Hz]; more are still found from the record.
    candidates_hz : sequence of float, optional
        Frequencies near which a vibration may be expected [Hz].
    noise : float, optional
        Noise of one field [as given], if known. It steadies the standard deviation where
        broad-band motion covers the noise.

    Returns
    -------
    MeanAngle
        Mean, its 1-sigma standard deviation, method, weights and vibrations; NaN where no field
        was measured.

    Notes
    -----
    The covariance is learnt from the record itself: up to 240 fields by `fit_vibration`, beyond
    from the spectra of segments; then ``"lines"`` is not offered and ``"process"`` stands in for
    it. What learning leaves open is in the standard deviation, after Kenward and Roger (1997,
    doi:10.2307/2533558) and by Student's t.

    A motion slower than 1.5 cycles a record (of up to 240 fields) is a drift, and the mean is
    that of the drifting angle: of a strong vibration no stated uncertainty is honest below 1.5
    cycles of it, nor in much less than 20 fields. What aliases to so low a frequency, motion near
    a multiple of the field rate, falls on the mean and cannot be told from it; under random
    excitation up to the field rate 1 sigma may therefore cover less than 68 %.
    """
    angle = np.asarray(angle, np.float64)
    there = np.isfinite(angle)
    n_there = int(there.sum())
    if n_there < _LEAST_FIELDS or np.ptp(angle[there]) <= 1e-13 * np.abs(angle[there]).max():
        return _simple_mean(angle, there)
    if angle.size > _MOST_FIELDS:
        return _mean_of_long(angle, there, method, noise)
    vibration = fit_vibration(
        angle,
        given=[each / rate_hz for each in vibration_hz],
        candidates=[each / rate_hz for each in candidates_hz],
        noise=noise,
    )
    found = _mean_of_short(angle, there, vibration, method)
    lines = tuple(_in_hz(line, rate_hz) for line in vibration.lines)
    return replace(found, lines=lines)


@dataclass(frozen=True, eq=False)
class _Offer:
    """Weights, and what they make of the mean."""

    weights: _Array
    std: float
    dof: float

    @classmethod
    def of(cls, weights: _Array, variance: float, dof: float) -> Self:
        return cls(weights, float(np.sqrt(variance)) * coverage_factor(dof, ONE_SIGMA), dof)

    def mean_of(self, angle: _Array, method: MeanMethod) -> MeanAngle:
        used = self.weights != 0
        mean = float(self.weights[used] @ angle[used])
        return MeanAngle(mean, self.std, method, self.weights, dof=self.dof)


def _simple_mean(angle: _Array, there: NDArray[np.bool_]) -> MeanAngle:
    count = int(there.sum())
    if count == 0:
        return MeanAngle(np.nan, np.nan, "plain", np.zeros(angle.size))
    variance = float(angle[there].var(ddof=1)) / count if count > 1 else np.nan
    return _Offer.of(there / count, variance, count - 1.0).mean_of(angle, "plain")


def _mean_of_short(
    angle: _Array, there: NDArray[np.bool_], vibration: Vibration, method: str
) -> MeanAngle:
    place = np.flatnonzero(there)
    variance, gls = LearntVariance.of_vibration(vibration, place, angle[there])
    span = int(place[-1] - place[0]) + 1
    weights: dict[MeanMethod, list[_Array]] = {
        "plain": [np.full(place.size, 1 / place.size)],
        "lines": _line_weights(vibration, place),
        "tapered": [_normalised(each[place - place[0]]) for each in _tapers(span)],
        "process": [gls],
    }

    def offer(name: MeanMethod, each: _Array) -> _Offer:
        whole = np.zeros(angle.size)
        whole[there] = each
        return _Offer.of(whole, *variance.of(each, learnt=name in _LEARNT))

    offered = {name: [offer(name, each) for each in some] for name, some in weights.items()}
    return _best_mean(angle, offered, method)


def _mean_of_long(
    angle: _Array, there: NDArray[np.bool_], method: str, noise: float | None
) -> MeanAngle:
    covariance, dof = segmented_covariance(angle, noise=noise)
    weights: dict[MeanMethod, list[_Array]] = {
        "plain": [there / there.sum()],
        "tapered": [_normalised(each * there) for each in _tapers(angle.size)],
        "process": [_normalised(segment_weights(there, covariance))],
    }
    offered = {
        name: [_Offer.of(each, variance_of(each, covariance), dof) for each in some]
        for name, some in weights.items()
    }
    return _best_mean(angle, offered, "process" if method == "lines" else method)


def _best_mean(angle: _Array, offered: dict[MeanMethod, list[_Offer]], method: str) -> MeanAngle:
    """Take the first, simplest method nearly as good as the best, unless one is asked for."""
    best = {name: min(some, key=lambda each: each.std) for name, some in offered.items()}
    enough = _AS_GOOD * min(each.std for each in best.values())
    good: list[MeanMethod] = [name for name, each in best.items() if each.std <= enough]
    chosen = next((name for name in best if name == method), good[0])
    return best[chosen].mean_of(angle, chosen)


def _line_weights(vibration: Vibration, place: NDArray[np.int64]) -> list[_Array]:
    """Weights of least squares, for each degree of the amplitudes that leaves enough fields."""
    phase = 2 * np.pi * np.outer(place, [line.frequency for line in vibration.lines])
    waves = np.hstack([np.cos(phase), np.sin(phase)])
    time = (place - place.mean()) / max(1.0, float(np.ptp(place)))
    fits = []
    for degree in _AMPLITUDE_DEGREES:
        powers = [waves * time[:, None] ** each for each in range(degree + 1)]
        design = np.hstack([vibration.trend, *powers])
        if 2 * design.shape[1] <= place.size or degree == 0:
            fits.append(np.linalg.pinv(design, rcond=1e-9)[0])
    return fits


def _tapers(length: int) -> list[_Array]:
    return [np.kaiser(length, shape) for shape in _KAISER]


def _normalised(weight: _Array) -> _Array:
    share: _Array = weight / weight.sum()
    return share


def _in_hz(line: VibrationLine, rate_hz: float) -> VibrationLine:
    return VibrationLine(line.frequency * rate_hz, line.amplitude, line.bandwidth * rate_hz)
