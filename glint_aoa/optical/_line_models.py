"""Parametric profiles of a line, integrated over pixels, with their derivatives.

Each takes distances t from the line [point] and its figures, and returns value, derivative along t
and derivatives by the figures [figure, point]. Widths are in lines.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

__all__ = ["GAUSSIAN", "RICHER", "LineModel", "edge"]

_Array = NDArray[np.float64]
_Parts = tuple[_Array, _Array, _Array]

_ROOT_2_PI = float(np.sqrt(2 * np.pi))


@dataclass(frozen=True)
class LineModel:
    """A parametric profile.

    Attributes
    ----------
    name : str
        What it is called.
    parts : callable
        From t and the figures to value, derivative along t and derivatives by the figures.
    start : tuple of float
        Figures of what looks like a Gaussian of unit width.
    is_width : tuple of bool
        Which of the figures are widths, and scale with the line's.
    low, high : tuple of float
        Bounds of the figures.
    """

    name: str
    parts: Callable[..., _Parts]
    start: tuple[float, ...]
    is_width: tuple[bool, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


def edge(t: _Array, sigma: float) -> _Array:
    """Soft step at 0, integrated over a pixel."""
    return _edge(t, sigma)[0]


def _edge(t: _Array, sigma: float) -> tuple[_Array, _Array, _Array]:
    """Soft step and its derivatives along t and by sigma."""
    after, before = _ramp(t + 0.5, sigma), _ramp(t - 0.5, sigma)
    return after[0] - before[0], after[1] - before[1], after[2] - before[2]


def _ramp(t: _Array, sigma: float) -> tuple[_Array, _Array, _Array]:
    x = t / sigma
    step, bell = ndtr(x), np.exp(-0.5 * x * x) / _ROOT_2_PI
    return t * step + sigma * bell, step, bell


def _gaussian(t: _Array, sigma: float) -> _Parts:
    after, before = (t + 0.5) / sigma, (t - 0.5) / sigma
    at_after, at_before = np.exp(-0.5 * after * after), np.exp(-0.5 * before * before)
    mean = _ROOT_2_PI * (ndtr(after) - ndtr(before))
    by_sigma = mean - (after * at_after - before * at_before)
    return sigma * mean, at_after - at_before, by_sigma[None]


def _band(t: _Array, half: float, above: float, below: float) -> _Parts:
    upper, lower = _edge(t + half, above), _edge(t - half, below)
    by_figures = np.stack([upper[1] + lower[1], upper[2], -lower[2]])
    return upper[0] - lower[0], upper[1] - lower[1], by_figures


def _skirted(t: _Array, sigma: float, share: float, offset: float, wide: float) -> _Parts:
    narrow, skirt = _gaussian(t, sigma), _gaussian(t - offset, wide * sigma)
    by_figures = np.stack(
        [
            (1 - share) * narrow[2][0] + share * wide * skirt[2][0],
            skirt[0] - narrow[0],
            -share * skirt[1],
            share * sigma * skirt[2][0],
        ]
    )
    value, along = ((1 - share) * narrow[k] + share * skirt[k] for k in (0, 1))
    return value, along, by_figures


GAUSSIAN = LineModel("Gaussian", _gaussian, (1.0,), (True,), (0.25,), (40.0,))
RICHER = (
    LineModel(
        "band", _band, (1.2, 0.6, 0.6), (True, True, True), (0.1, 0.15, 0.15), (60.0, 20.0, 20.0)
    ),
    LineModel(
        "skirted",
        _skirted,
        (1.0, 0.1, 0.0, 2.0),
        (True, False, True, False),
        (0.25, 0.0, -9.0, 1.2),
        (40.0, 0.6, 9.0, 6.0),
    ),
)
