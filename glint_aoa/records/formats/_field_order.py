"""Whether frames are interlaced, and which field came first, found from what moves in them."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["FieldOrder", "Scan", "find_field_order", "thinned"]

Scan = Literal["progressive", "even first", "odd first"]

_BATCH = 4  # frames: motion in neighbouring ones is not independent
_LEAST_BATCHES = 4
_SIGMAS = 5.0  # by which one lag must differ from the other two
_RATIO = 3.0  # how much more it must differ than they do from each other
_MOST_COLUMNS = 200
_SHARE = 0.1  # of the pixels: those where a motion shows most

_ODD_ONE: tuple[Scan, Scan, Scan] = ("progressive", "odd first", "even first")


@dataclass(frozen=True)
class FieldOrder:
    """How frames were scanned, as far as their content tells.

    Attributes
    ----------
    scan : {"progressive", "even first", "odd first"} or None
        None where the content does not tell.
    sigmas : float
        By how many standard deviations the motion speaks for it, or for the best guess.
    """

    scan: Scan | None
    sigmas: float


def find_field_order(stretches: Iterable[NDArray[np.generic]]) -> FieldOrder:
    """Find the scan of frames from three energies of motion between even and odd lines.

    Within a frame, from odd lines to the next frame's even ones, and from even lines to the next
    frame's odd ones. Two of the three lags are equal in size, and so are the energies: the first
    two, half a frame, where even lines came first; the first and the last where odd ones did; the
    last two, a whole frame, where all lines were taken at once. Which one differs is asked, not
    which is greater, so that vibration up to twice the frame rate does not mislead.

    Parameters
    ----------
    stretches : iterable of ndarray [frame, line, column]
        Successive frames; several stretches from different places.

    Returns
    -------
    FieldOrder
        Undecided where nothing moves enough.

    Notes
    -----
    Fails to decide where motion repeats with every frame or nearly with every second one, is a
    slow drift, or lasts for a few frames only. What moves must do so alike in either direction of
    time, as vibration does. A vibration that stays locked to half the frame rate throughout the
    file makes interlaced frames look progressive.
    """
    batches = [batch for frames in stretches for batch in _batches(frames)]
    energy = np.array(batches).reshape(-1, 3)
    energy = energy[energy.sum(axis=1) > 0]
    if len(energy) < _LEAST_BATCHES:
        return FieldOrder(None, 0.0)
    energy /= energy.sum(axis=1, keepdims=True)  # a vibration turns: not all batches move alike
    mean = energy.mean(axis=0)
    pair = [abs(mean[1] - mean[2]), abs(mean[0] - mean[2]), abs(mean[0] - mean[1])]
    odd = int(np.argmin(pair))
    others = np.delete(energy, odd, axis=1).mean(axis=1)
    apart = energy[:, odd] - others
    std = float(apart.std(ddof=1)) / np.sqrt(len(apart))
    size = float(apart.mean())
    sigmas = float(abs(size) / std) if std > 0 else 0.0
    sure = sigmas > _SIGMAS and abs(size) > _RATIO * pair[odd] and (odd != 0 or size < 0)
    return FieldOrder(_ODD_ONE[odd] if sure else None, sigmas)


def thinned(frames: NDArray[Any]) -> NDArray[Any]:
    """Return as many columns [..., line, column] as are looked at, in memory of their own."""
    step = -(-frames.shape[-1] // _MOST_COLUMNS)
    return frames[..., ::step].copy()


def _batches(frames: NDArray[np.generic]) -> list[NDArray[np.float64]]:
    """Energies of the three lags [lag], averaged over a few frames at a time."""
    if len(frames) <= _BATCH or frames.shape[1] < 4:
        return []
    thin = thinned(frames).astype(np.float32)
    half = thin.shape[1] // 2
    even, odd = thin[:, 0 : 2 * half : 2], thin[:, 1 : 2 * half : 2][:, :-1]
    between = (even[:, :-1] + even[:, 1:]) / 2  # even lines, where the odd ones lie
    lags = (odd[:-1] - between[:-1], odd[:-1] - between[1:], odd[1:] - between[:-1])
    telling = _telling(even.mean(axis=0))
    series = np.stack([_energy(lag, telling) for lag in lags], axis=-1)
    count = len(series) // _BATCH
    return list(series[: count * _BATCH].reshape(count, _BATCH, 3).mean(axis=1))


def _energy(lag: NDArray[Any], telling: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Mean square of what changes in time [frame]; what stands still is no motion."""
    changing = lag[:, telling]
    changing = changing - changing.mean(axis=0)
    energy: NDArray[np.float64] = np.mean(changing**2, axis=1, dtype=np.float64)
    return energy


def _telling(picture: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether a pixel is one of those across which the picture changes most [line, column]."""
    change = np.abs(np.diff(picture, axis=0))
    telling: NDArray[np.bool_] = change >= np.quantile(change, 1 - _SHARE)
    return telling
