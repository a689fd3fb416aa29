"""The covariance of a vibrating angle, learnt from one short record of it.

The record is taken as a mean and a slow trend, plus noise, plus vibration lines. A line is a
Gaussian process, a^2 exp(-(2 pi b t)^2 / 2) cos(2 pi f t): a sine of frequency f whose amplitude
and phase wander with a bandwidth b; b = 0 is a sine proper. Broad-band motion that a force above
some frequency drives is a floor, white from a lower edge up to half the field rate. Frequencies
are as the fields show them, folded about half the field rate.

The parameters maximise the restricted likelihood (Patterson and Thompson 1971,
doi:10.1093/biomet/58.3.545), which knows that mean and trend are fitted too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import accumulate, pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from glint_aoa.optical._likelihood_kernel import restricted_likelihood

__all__ = ["Vibration", "VibrationLine", "fit_vibration", "folded", "trust_in_noise"]

_Array = NDArray[np.float64]

_MOST_LINES = 5
_FIELDS_A_LINE = 6  # at least
_LEAST_CYCLES = 1.5  # a record; what is slower is drift
_LINE_GAIN = 6.0  # log likelihood that a line must bring: chance does so once in about 100 records
_FLOOR_GAIN = 3.0
_TREND_GAIN = 7.0
_WORTH_A_TRY = 6.0  # periodogram over its expectation
_START_BANDWIDTHS = (0.01, 0.3)  # cycles a record: a sine, and an amplitude that changes
_NOISE_TRUST = 0.4  # 1 sigma of the logarithm of a variance that the caller states, downwards
_EXCESS_TRUST = 0.8  # and upwards: what aliases to slow motion looks like more noise
_EDGE_ORDER = 16  # of the floor's edge, as a filter's
_EDGE_START = 0.5  # of the frequency of the lowest line
_FREQUENCIES = (np.arange(256) + 0.5) / 512  # at which a floor's spectrum is held
_COARSE, _FINE = 3e-5, 1e-10  # relative change of the likelihood at which to stop
_FREE = 1e3  # prior variance of a parameter that nothing is known of
_TREND = 1  # degree
_CURVED_TREND = 3


@dataclass(frozen=True)
class VibrationLine:
    """A vibration as the fields show it.

    Attributes
    ----------
    frequency : float
        Cycles a field; cycles a second [Hz] once scaled by the field rate.
    amplitude : float
        Root 2 times the rms of the motion over the record [unit of the angle].
    bandwidth : float
        Of the wandering of amplitude and phase, in the unit of `frequency`; 0 for a sine.
    """

    frequency: float
    amplitude: float
    bandwidth: float


@dataclass(frozen=True, eq=False)
class Vibration:
    """What `fit_vibration` learns.

    Attributes
    ----------
    lines : tuple of VibrationLine
        Vibration lines by frequency, cycles a field.
    covariance : ndarray [lag]
        Covariance of noise and vibration over the lag in fields [unit of the angle, squared].
    trend : ndarray [field, term]
        Ones, then the terms of the slow trend, without mean over the measured fields.
    changes : ndarray [parameter, lag]
        Derivatives of `covariance` to its parameters.
    uncertainty : ndarray [parameter, parameter]
        Covariance of the parameters as the record tells them.
    """

    lines: tuple[VibrationLine, ...]
    covariance: _Array
    trend: _Array
    changes: _Array
    uncertainty: _Array


def folded(frequency: float) -> float:
    """Frequency [cycles a field] as the fields show it: 0 to 0.5."""
    return abs(frequency - round(frequency))


class _Term(Protocol):
    """One term of the covariance."""

    @property
    def start(self) -> _Array: ...
    @property
    def bounds(self) -> list[tuple[float, float]]: ...

    def lags(self, theta: _Array, lag: _Array) -> list[_Array]:
        """Return the covariance over `lag`, then its derivative to each parameter."""


@dataclass(frozen=True)
class _Noise:
    """White noise; parameter: log variance."""

    start: _Array
    bounds: list[tuple[float, float]]

    def lags(self, theta: _Array, lag: _Array) -> list[_Array]:
        value = np.exp(theta[0]) * (lag == 0)
        return [value, value]


@dataclass(frozen=True, eq=False)
class _Floor:
    """Broad-band motion above an edge; parameters: log variance, log edge [cycles a field]."""

    start: _Array
    bounds: list[tuple[float, float]]
    shape: _Array  # [frequency], spectrum without the edge

    def lags(self, theta: _Array, lag: _Array) -> list[_Array]:
        passed = 1 / (1 + np.exp(_EDGE_ORDER * (theta[1] - np.log(_FREQUENCIES))))
        spectrum = np.exp(theta[0]) * self.shape * passed
        moved = -_EDGE_ORDER * spectrum * (1 - passed)
        value, slope = np.stack([spectrum, moved]) @ _cosines(lag.size)
        return [value, value, slope]


@dataclass(frozen=True)
class _Line:
    """Vibration line; parameters: log variance, frequency and log bandwidth in cycles a record."""

    start: _Array
    bounds: list[tuple[float, float]]
    length: int

    def lags(self, theta: _Array, lag: _Array) -> list[_Array]:
        wander = 2 * np.pi * np.exp(theta[2]) / self.length * lag
        turn = 2 * np.pi / self.length * lag
        envelope = np.exp(theta[0] - wander**2 / 2)
        value = envelope * np.cos(theta[1] * turn)
        slope = -turn * envelope * np.sin(theta[1] * turn)
        return [value, value, slope, -(wander**2) * value]


@dataclass(frozen=True, eq=False)
class _Record:
    """The measured fields, scaled to unit variance, and the trend to take out."""

    angle: _Array  # [measured]
    place: NDArray[np.int64]  # [measured], number of the field
    trend: _Array  # [measured, term]
    noise: float | None  # log of the stated variance, scaled
    lag: NDArray[np.int64] = field(init=False)  # [measured, measured]

    def __post_init__(self) -> None:
        object.__setattr__(self, "lag", np.abs(self.place[:, None] - self.place))

    @property
    def length(self) -> int:
        return int(self.place[-1] - self.place[0]) + 1

    @cached_property
    def waves(self) -> tuple[_Array, list[_Array]]:
        """Cycles a record to look for a line at, and cosines and sines [measured, cycles]."""
        cycles = np.arange(_LEAST_CYCLES, self.length / 2, 1 / 8)
        turn = 2 * np.pi / self.length * np.outer(self.place, cycles)
        return cycles, [np.cos(turn), np.sin(turn)]

    def spread(self, covariance: _Array) -> _Array:
        """Matrix [measured, measured] of a covariance [lag]."""
        spread: _Array = covariance[self.lag]
        return spread

    def likelihood(self, covariance: _Array) -> tuple[float, _Array, _Array]:
        """Cost of a covariance [lag], K^-1 without the trend, and the cost's derivatives [lag]."""
        projector, by_lag = np.empty(self.lag.shape), np.empty(self.length)
        trend, angle = self.trend, self.angle
        cost = restricted_likelihood(covariance, self.place, trend, angle, projector, by_lag)
        return cost, projector, by_lag


@dataclass(frozen=True, eq=False)
class _Fit:
    """Terms with their parameters, and how likely they make the record."""

    record: _Record
    terms: tuple[_Term, ...]
    theta: _Array
    cost: float  # minus the log likelihood

    def covariances(self) -> list[_Array]:
        return [part[0] for part in _lags(self.record, self.terms, self.theta)]

    def projector(self) -> _Array:
        """K^-1 without the trend."""
        cost, projector, _ = self.record.likelihood(np.sum(self.covariances(), axis=0))
        if np.isinf(cost):  # pragma: no cover  the optimiser has been here
            raise FloatingPointError("covariance is not positive definite")
        return projector


def fit_vibration(
    angle: _Array,
    *,
    given: Sequence[float] = (),
    candidates: Sequence[float] = (),
    noise: float | None = None,
) -> Vibration:
    """Learn the covariance of a vibrating angle from a record of some 8 to 250 fields.

    Lines are added one by one where the periodogram, whitened by what has been found, stands out
    most; a line, a floor or a curved trend stays if the likelihood gains enough.

    Parameters
    ----------
    angle : ndarray [field]
        Angles at equal intervals; NaN for a field that was not measured.
    given : sequence of float
        Frequencies of lines that are there [cycles a field]; they are not searched for.
    candidates : sequence of float
        Frequencies at which a line may be expected [cycles a field].
    noise : float, optional
        Noise of a field [unit of the angle]; taken as a variance known to 40 %.

    Returns
    -------
    Vibration
        Lines, covariance and trend.

    Notes
    -----
    Motion slower than 1.5 cycles a record cannot be told from a drift. Two lines closer than
    about half a cycle a record are found as one whose amplitude wanders. Without `noise`, strong
    broad-band motion leaves only the few bins below its edge to tell the noise.
    """
    there = np.flatnonzero(np.isfinite(angle))
    scale = float(angle[there].std())
    known = None if noise is None else 2 * float(np.log(noise / scale))
    centred = (angle[there] - angle[there].mean()) / scale
    record = _Record(centred, there, _trend(there, _TREND), known)
    fit = _search(_first_fit(record, given), [folded(each) for each in candidates])
    fit = _fitted(fit.record, fit.terms, [fit.theta], tolerance=_FINE)
    changes = _changes(fit)
    return Vibration(
        tuple(sorted(_found(fit, scale), key=lambda line: line.frequency)),
        scale**2 * np.sum(fit.covariances(), axis=0),
        fit.record.trend,
        scale**2 * changes,
        _uncertainty(fit, changes),
    )


def _trend(place: NDArray[np.int64], degree: int) -> _Array:
    """Ones and polynomials orthogonal to them over the measured fields."""
    span = (place - place.mean()) / max(1.0, float(np.ptp(place)))
    basis, _ = np.linalg.qr(np.vander(span, degree + 1, increasing=True))
    return np.column_stack([np.ones(place.size), basis[:, 1:]])


def _first_fit(record: _Record, given: Sequence[float]) -> _Fit:
    bounds = [(np.log(1e-14), 2.0)]
    terms: list[_Term] = [_Noise(np.zeros(1), bounds)]
    for frequency in given:
        cycles = folded(frequency) * record.length
        start = np.array([-1.0, cycles, np.log(_START_BANDWIDTHS[0])])
        terms.append(_line(record, start, fixed=True))
    return _fitted(record, terms, [term.start for term in terms])


def _search(fit: _Fit, candidates: Sequence[float]) -> _Fit:
    while True:
        curved = _with_curved_trend(fit)
        if curved is not None:
            fit = curved
            continue
        tries = _with_line(fit, candidates) + _with_floor(fit)
        better = [(gain, each) for each, least in tries if (gain := fit.cost - each.cost) > least]
        if not better:
            return fit
        fit = max(better, key=lambda pair: pair[0])[1]


def _with_curved_trend(fit: _Fit) -> _Fit | None:
    """Fit a cubic trend, if that explains more than any line could."""
    record = fit.record
    if record.trend.shape[1] > _TREND + 1:
        return None
    trend = _trend(record.place, _CURVED_TREND)
    projector = fit.projector()
    curved = trend[:, _TREND + 1 :]
    seen = curved.T @ projector @ record.angle
    gain = 0.5 * float(seen @ np.linalg.solve(curved.T @ projector @ curved, seen))
    if gain < _TREND_GAIN or gain < _peak(fit, projector)[1]:
        return None
    return _fitted(replace(record, trend=trend), fit.terms, [fit.theta])


def _with_line(fit: _Fit, candidates: Sequence[float]) -> list[tuple[_Fit, float]]:
    """Fits with one line more, at the highest peak and at candidates near it."""
    record = fit.record
    most = min(_MOST_LINES, record.angle.size // _FIELDS_A_LINE)
    if sum(isinstance(term, _Line) for term in fit.terms) >= most:
        return []
    cycles, height, power = _peak(fit, fit.projector())
    if height < _WORTH_A_TRY:
        return []
    near = [f for each in candidates if abs((f := each * record.length) - cycles) < 1]
    tries = []
    for at in (cycles, *near):
        for bandwidth in _START_BANDWIDTHS:
            line = _line(record, np.array([np.log(power), at, np.log(bandwidth)]))
            tries.append(_fitted(record, (*fit.terms, line), [fit.theta, line.start]))
    return [(each, _LINE_GAIN) for each in tries]


def _with_floor(fit: _Fit) -> list[tuple[_Fit, float]]:
    lines = [term for term in fit.terms if isinstance(term, _Line)]
    if not lines or _has_floor(fit):
        return []
    length = fit.record.length
    length = fit.record.length
    own = _by_term(fit.terms, fit.theta)[1:]
    lowest = min(theta[1] for theta in own) / length
    bounds = [(np.log(1e-14), 2.0), (np.log(0.5 / length), np.log(0.9 * lowest))]
    quieter = fit.theta[:1] - 0.5
    tries = []
    for shape in (np.ones(_FREQUENCIES.size), _skirts(own, length)):
        start = np.array([fit.theta[0], np.log(_EDGE_START * lowest)])
        floor = _Floor(start, bounds, shape / shape.mean())
        terms: tuple[_Term, ...] = (fit.terms[0], floor, *fit.terms[1:])
        tries.append(_fitted(fit.record, terms, [quieter, start, fit.theta[1:]]))
    return [(each, _FLOOR_GAIN) for each in tries]


def _skirts(lines: Sequence[_Array], length: int) -> _Array:
    """Spectrum of resonances away from their peaks, those beyond half the field rate folded."""
    away = np.array([[_FREQUENCIES - theta[1] / length] for theta in lines])
    variance = np.exp([theta[0] for theta in lines])[:, None, None]
    skirts: _Array = (variance / (away**2 + length**-2)).sum(axis=(0, 1))
    return skirts


@cache
def _cosines(n_lags: int) -> _Array:
    """Return what each frequency of a spectrum adds to the covariance [frequency, lag]."""
    turn = 2 * np.pi * np.outer(_FREQUENCIES, np.arange(n_lags))
    return np.asarray(np.cos(turn) / _FREQUENCIES.size, np.float64)


def _has_floor(fit: _Fit) -> bool:
    return any(isinstance(term, _Floor) for term in fit.terms)


def _line(record: _Record, start: _Array, *, fixed: bool = False) -> _Line:
    length = record.length
    cycles = (start[1], start[1]) if fixed else (_LEAST_CYCLES, 0.5 * length)
    bounds = [(np.log(1e-14), 4.0), cycles, (np.log(1e-4), np.log(3.0))]
    return _Line(start, bounds, length)


def _peak(fit: _Fit, projector: _Array) -> tuple[float, float, float]:
    """Cycles a record, height over expectation and variance of the strongest line not fitted."""
    record = fit.record
    cycles, waves = record.waves
    whitened = projector @ record.angle
    power, expected = np.zeros(cycles.size), np.zeros(cycles.size)
    for wave in waves:
        power += (whitened @ wave) ** 2
        expected += np.einsum("ic,ic->c", wave, projector @ wave)
    height = power / np.maximum(expected, np.finfo(float).tiny)
    top = int(height.argmax())
    variance = 2 * power[top] / max(expected[top], np.finfo(float).tiny) ** 2
    return float(cycles[top]), float(height[top]), float(variance)


def _by_term(terms: Sequence[_Term], theta: _Array) -> list[_Array]:
    ends = list(accumulate(len(term.bounds) for term in terms))
    return [theta[low:high] for low, high in pairwise([0, *ends])]


def _lags(record: _Record, terms: Sequence[_Term], theta: _Array) -> list[list[_Array]]:
    lag = np.arange(record.length, dtype=np.float64)
    own = _by_term(terms, theta)
    return [term.lags(part, lag) for term, part in zip(terms, own, strict=True)]


def _fitted(
    record: _Record,
    terms: Sequence[_Term],
    start: Sequence[_Array],
    *,
    tolerance: float = _COARSE,
) -> _Fit:
    """Maximise the restricted likelihood from `start`."""
    bounds = [pair for term in terms for pair in term.bounds]
    low, high = np.array(bounds).T

    def cost(theta: _Array) -> tuple[float, _Array]:
        lags = _lags(record, terms, theta)
        value, _, by_lag = record.likelihood(np.sum([part[0] for part in lags], axis=0))
        if np.isinf(value):
            return 1e10, np.zeros_like(theta)
        gradient = np.array([by_lag @ each for part in lags for each in part[1:]])
        if record.noise is not None:
            off = theta[0] - record.noise
            trust = trust_in_noise(off)
            value, gradient[0] = value + (off / trust) ** 2 / 2, gradient[0] + off / trust**2
        return value, gradient

    found = optimize.minimize(
        cost,
        np.clip(np.concatenate(start), low, high),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": 60, "ftol": tolerance},
    )
    return _Fit(record, tuple(terms), found.x, float(found.fun))


def trust_in_noise(off: float) -> float:
    """How far a variance may well depart from the stated noise, 1 sigma of its logarithm.

    Parameters
    ----------
    off : float
        Logarithm of the variance over that stated: beyond it, motion may be in it as well.
    """
    return _NOISE_TRUST if off < 0 else _EXCESS_TRUST


def _found(fit: _Fit, scale: float) -> list[VibrationLine]:
    """List the lines, each with the amplitude that it most likely had in this record."""
    length, whitened = fit.record.length, fit.projector() @ fit.record.angle
    lines = []
    own = zip(fit.terms, _by_term(fit.terms, fit.theta), fit.covariances(), strict=True)
    for term, theta, covariance in own:
        if isinstance(term, _Line):
            motion = fit.record.spread(covariance) @ whitened
            amplitude = scale * float(np.sqrt(2 * np.mean(motion**2)))
            lines.append(VibrationLine(theta[1] / length, amplitude, np.exp(theta[2]) / length))
    return lines


def _changes(fit: _Fit) -> _Array:
    """Differentiate the covariance [parameter, lag]; zero for what is held."""
    lags = [each for part in _lags(fit.record, fit.terms, fit.theta) for each in part[1:]]
    held = [low == high for term in fit.terms for low, high in term.bounds]
    return np.where(np.array(held)[:, None], 0.0, np.stack(lags))


def _uncertainty(fit: _Fit, changes: _Array) -> _Array:
    """Covariance of the parameters from their Fisher information, weak priors added."""
    projector = fit.projector()
    moved = projector @ changes[:, fit.record.lag]
    information = np.einsum("aij,bji->ab", moved, moved, optimize=True) / 2
    information += np.eye(len(moved)) / _FREE
    if _has_floor(fit):
        information[1:3, 1:3] += np.eye(2)  # level and edge: known to a factor of e at worst
    if fit.record.noise is not None:
        information[0, 0] += trust_in_noise(fit.theta[0] - fit.record.noise) ** -2
    inverse: _Array = np.linalg.inv(information)
    return inverse
