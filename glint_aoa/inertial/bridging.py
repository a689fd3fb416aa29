"""Bridge short stretches of a vibration signal that were clipped or lost.

The vibration of a model is a few lightly damped modes, sampled many times a period: each sample
is a linear prediction of its neighbours but for a small innovation. The missing samples are those
that make the innovations smallest (Janssen, Veldhuis and Vries 1986,
doi:10.1109/TASSP.1986.1164824), the prediction being learnt from the good samples around them, in
turns.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

__all__ = ["Bridged", "bridge"]

_Floats = NDArray[np.float64]
_Mask = NDArray[np.bool_]
_Solve = Callable[[_Floats], _Floats]

_ORDERS = (16, 32, 32, 32, 32)
"""Of the predictions learnt in turns, the first one from what lies between the gaps."""

_DRAWS = 8
_MOST_MISSING = 0.3  # of the samples: with more, too little is left to learn from
_LONGEST_S = 0.04  # about a period of the highest modes: longer stretches are guessed, not bridged
_ROWS_PER_COEFFICIENT = 20
_MOST_ROWS = 5_000
_RIDGE = 1e-9  # of the signal's power, -90 dB: keeps noise-free sines solvable


@dataclass(frozen=True, eq=False)
class Bridged:
    """A signal whose missing samples were filled.

    Attributes
    ----------
    samples : ndarray [sample]
        The signal, in its unit.
    draws : ndarray [draw, sample]
        Deviations from `samples`, each as likely as the next given the good samples; zero where
        the signal is good. Their mean square is the variance of what was filled.
    """

    samples: _Floats
    draws: _Floats


def bridge(samples: ArrayLike, missing: ArrayLike, rate_hz: float) -> Bridged | None:
    """Fill missing samples from their surroundings.

    Parameters
    ----------
    samples : array_like [sample]
        The signal, in any unit. Where it is missing a finite value is a bound that the true one
        lies beyond (a clipped sample); NaN is no bound.
    missing : array_like of bool [sample]
        Samples to fill.
    rate_hz : float
        Samples a second [Hz].

    Returns
    -------
    Bridged or None
        None if more than a quarter of the samples is missing, or 0.04 s without a break, or too
        few good ones stand together.

    Notes
    -----
    The draws follow the autoregressive model's own innovations, so they know of noise but not of
    a record in which the gaps are unlike the rest, such as a knock that clipped. Deterministic:
    the draws come from a fixed seed.
    """
    signal, holes = np.asarray(samples, np.float64), np.asarray(missing, bool)
    if holes.mean() > _MOST_MISSING or _longest(holes) > _LONGEST_S * rate_hz:
        return None
    level = float(np.mean(signal[~holes]))
    bound = signal - level
    filled = np.where(np.isfinite(bound), bound, 0.0)
    unknown = np.flatnonzero(holes)
    learn_from = ~holes
    for order in _ORDERS:
        learnt = _prediction(filled, learn_from, order)
        if learnt is None:
            return None
        prediction, innovation_std = learnt
        solve = _solver(prediction, unknown)
        known = np.where(holes, 0.0, filled)
        pull = _innovations(known, prediction)
        filled[unknown] = solve(-_back(pull, prediction)[unknown])
        _keep_beyond(filled, bound, unknown)
        learn_from = np.ones_like(holes)
    draws = np.zeros((_DRAWS, signal.size))
    rng = np.random.default_rng(0)
    for draw in draws:
        white = rng.normal(0.0, innovation_std, signal.size + prediction.size - 1)
        draw[unknown] = solve(_back(white, prediction)[unknown])
    return Bridged(filled + level, draws)


def _longest(holes: _Mask) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holes.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _prediction(signal: _Floats, good: _Mask, order: int) -> tuple[_Floats, float] | None:
    """Learn the filter [order + 1] that whitens the signal, and the std of what it leaves."""
    window = np.lib.stride_tricks.sliding_window_view(signal, order + 1)
    whole = np.lib.stride_tricks.sliding_window_view(good, order + 1).all(axis=1)
    if np.count_nonzero(whole) < _ROWS_PER_COEFFICIENT * order:
        return None
    at = np.flatnonzero(whole)
    rows = window[at[:: max(at.size // _MOST_ROWS, 1)], ::-1]
    normal = rows.T @ rows
    inner = normal[1:, 1:] + _RIDGE * np.trace(normal) * np.eye(order)
    coefficients = np.linalg.solve(inner, -normal[1:, 0])
    prediction = np.concatenate([[1.0], coefficients])
    return prediction, float(np.sqrt(np.mean((rows @ prediction) ** 2)))


def _innovations(signal: _Floats, prediction: _Floats) -> _Floats:
    return np.convolve(signal, prediction)


def _back(innovations: _Floats, prediction: _Floats) -> _Floats:
    """Apply the transpose of `_innovations`."""
    return np.correlate(innovations, prediction, mode="valid")


def _solver(prediction: _Floats, unknown: NDArray[np.int64]) -> _Solve:
    """Factor the normal equations of the unknown samples; they couple over the filter's length."""
    gram = np.correlate(prediction, prediction, mode="full")[prediction.size - 1 :]
    number = np.full(unknown[-1] + gram.size, -1)
    number[unknown] = np.arange(unknown.size)
    banded = np.zeros((gram.size, unknown.size))
    for lag, weight in enumerate(gram):
        later = number[unknown + lag]
        pairs = np.flatnonzero(later >= 0)
        banded[later[pairs] - pairs, pairs] = weight
    factor = scipy.linalg.cholesky_banded(banded, lower=True)
    return lambda right: np.asarray(scipy.linalg.cho_solve_banded((factor, True), right))


def _keep_beyond(filled: _Floats, bound: _Floats, unknown: NDArray[np.int64]) -> None:
    """Move what fell short of a clipped value out to it."""
    limit = bound[unknown]
    short = np.isfinite(limit) & (filled[unknown] * np.sign(limit) < np.abs(limit))
    filled[unknown[short]] = limit[short]
