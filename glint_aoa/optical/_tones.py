"""Least squares of a series in tones that are found one by one."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

__all__ = ["TonesFit", "fit_tones"]

_Array = NDArray[np.float64]

_MAX_TONES = 4
_SPARE = 8  # values more than terms, at least
_OVERSAMPLING = 16
_LEAST_SQUARES = 1e-12
_RIDGE = 1e-10


@dataclass(frozen=True)
class TonesFit:
    """Least squares of several hypotheses; the first term's coefficient is the one wanted.

    Attributes
    ----------
    value, std : ndarray, shape (hypothesis,)
        Coefficient of the first term, and its standard deviation.
    squares, criterion : ndarray, shape (hypothesis,)
        Sum of squared residuals, and Bayesian information criterion (Schwarz, Ann. Statist. 6
        (1978) 461).
    freedom : ndarray, shape (hypothesis,)
        Values less terms.
    """

    value: _Array
    std: _Array
    squares: _Array
    criterion: _Array
    freedom: NDArray[np.int64]


def fit_tones(
    z: _Array, wanted: _Array, time: NDArray[np.int64], *, highest: float = 0.5
) -> TonesFit:
    """Fit terms of interest, a parabola, and tones for as long as they improve the fit.

    Parameters
    ----------
    z : ndarray, shape (hypothesis or 1, field)
        The series; NaN where missing.
    wanted : ndarray, shape (hypothesis, field, term)
        The terms of interest.
    time : ndarray, shape (hypothesis, field)
        Number of each field in time, from 0.
    highest : float, optional
        Highest frequency of a tone [cycles / field].

    Returns
    -------
    TonesFit
        One entry a hypothesis.

    Notes
    -----
    Up to four tones, the strongest of the residual first, each with both phases and their linear
    growth, which follows a small error of the frequency or a slow change of amplitude.
    """
    t = 2 * time / time[:, -1:] - 1
    terms = np.concatenate([wanted, np.stack([t**0, t, t**2], axis=-1)], axis=-1)
    there = np.broadcast_to(np.isfinite(z), time.shape)
    z = np.where(there, z, 0.0)
    best, residual = _least_squares(z, terms, there)
    for _ in range(_MAX_TONES):
        terms = np.concatenate([terms, _tone(residual, time, t, highest)], axis=-1)
        fit, residual = _least_squares(z, terms, there)
        better = (fit.criterion < best.criterion) & (fit.freedom >= _SPARE)
        if not better.any():
            break
        best = TonesFit(
            *(np.where(better, getattr(fit, f.name), getattr(best, f.name)) for f in fields(fit))
        )
    return best


def _least_squares(z: _Array, terms: _Array, there: NDArray[np.bool_]) -> tuple[TonesFit, _Array]:
    known = np.where(there[..., None], terms, 0.0)
    count, size = there.sum(axis=1), terms.shape[-1]
    across = known.transpose(0, 2, 1)
    ridge = _RIDGE * terms.shape[1] * np.eye(size)
    inverse = np.linalg.inv(across @ known + ridge)
    coefficient = inverse @ (across @ z[..., None])
    residual = np.where(there, z - (known @ coefficient)[..., 0], 0.0)
    squares = (residual**2).sum(axis=1) + _LEAST_SQUARES
    freedom = count - size
    std = np.sqrt(squares / np.maximum(freedom, 1) * inverse[:, 0, 0])
    criterion = count * np.log(squares) + size * np.log(np.maximum(count, 1))
    return TonesFit(coefficient[:, 0, 0], std, squares, criterion, freedom), residual


def _tone(residual: _Array, time: NDArray[np.int64], t: _Array, highest: float) -> _Array:
    """Terms of the strongest tone of each residual: both phases, and their growth."""
    series = np.zeros((len(residual), int(time.max()) + 1))
    np.put_along_axis(series, time, residual, axis=1)
    size = _OVERSAMPLING * series.shape[1]
    power = np.abs(np.fft.rfft(series, size, axis=1))[:, : int(highest * size) + 1]
    phase = 2 * np.pi * np.argmax(power, axis=1)[:, None] / size * time
    cos, sin = np.cos(phase), np.sin(phase)
    return np.stack([cos, sin, t * cos, t * sin], axis=-1)
