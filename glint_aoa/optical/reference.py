"""A static mark or edge in view, by which a moved camera shows."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from glint_aoa.setup import Reference

__all__ = ["FIRST_FIELDS", "Mark", "has_moved", "learn_mark", "mark_shift", "moved_fields"]

_Array = NDArray[np.float64]

FIRST_FIELDS = 6
"""Fields from which a mark is learnt: three of each parity."""

_ROUNDS = 8
_LEAST_STEEPNESS = 2.0  # grey levels over the profile that make an edge
_LEAST_LIKENESS = 0.7  # correlation with the mark as learnt
_STEEP = 0.4  # of the steepest step, which counts for the mark's place
_CERTAIN = 0.25  # pixels: a shift that a single field shows, whatever its noise
_SIGMAS = 6.0  # by which the mark's places before and after must differ
_LEAST_SHIFT = 0.005  # pixels: about what a turn of 0.002 deg moves a mark 300 columns away by
_LEAST_FIELDS = 3  # at one place
_LAGS = 8  # fields: shorter ones and this one tell how the mark sways


class _Profile(NamedTuple):
    grey: _Array
    place: float  # of the mark, NaN where the profile has no edge


@dataclass(frozen=True)
class Mark:
    """The mark as the first fields of a point show it.

    Attributes
    ----------
    reference : Reference
        Its box and tolerance.
    row, column : float
        Where it lies in the recorded window, rows as in an even field [pixels]; NaN in a
        direction in which it has no edge.
    """

    reference: Reference
    row: float
    column: float
    down: tuple[_Profile, ...]
    across: tuple[_Profile, ...]


def learn_mark(
    fields: NDArray[np.integer], parity: NDArray[np.int64], reference: Reference
) -> Mark:
    """Learn a mark from the first fields of a point.

    Parameters
    ----------
    fields : ndarray, shape (field, line, column)
        The first `FIRST_FIELDS` fields, or fewer.
    parity : ndarray, shape (field,)
        Their parities; 0 throughout for progressive fields.
    reference : Reference
        The setup's box, which must lie within the window.

    Returns
    -------
    Mark
        To be given to `mark_shift`.
    """
    rows, columns = _profiles(fields, reference)
    down = tuple(_mean_profile(rows, parity == p) for p in (0, 1))
    across = tuple(_mean_profile(columns, parity == p) for p in (0, 1))
    places = [down[0].place, down[1].place + 0.5]
    return Mark(
        reference=reference,
        row=reference.rows[0] + _mean_known(places),
        column=reference.columns[0] + _mean_known([each.place for each in across]),
        down=down,
        across=across,
    )


def mark_shift(
    fields: NDArray[np.integer], parity: NDArray[np.int64], mark: Mark
) -> NDArray[np.float64]:
    """Measure how far the mark lies from its place.

    Parameters
    ----------
    fields : ndarray, shape (field, line, column)
        Grey levels.
    parity : ndarray, shape (field,)
        Parity of each field.
    mark : Mark
        From `learn_mark`.

    Returns
    -------
    ndarray, shape (field, 2)
        Shift down and to the right [pixels]: from the setup's place where it gives one, from that
        of the first fields where not. NaN in a direction in which the mark has no edge, infinite
        where the mark cannot be recognised.

    Notes
    -----
    The box's mean profiles, down and across, are matched to those of the first fields of the same
    parity: the best whole pixel by correlation, then least squares in shift, gain and background
    (Lucas and Kanade, IJCAI 1981). Noise is that of a pixel divided by the edge's steepness and
    the root of the box's width: a few thousandths of a pixel for an edge of 100 grey levels. It
    is biased by what moves through the box, so the box must keep clear of the model.
    """
    rows, columns = _profiles(fields, mark.reference)
    shift = np.full((len(fields), 2), np.nan)
    for p in (0, 1):
        here = parity == p
        shift[here, 0] = _match(rows[here], mark.down[p])
        shift[here, 1] = _match(columns[here], mark.across[p])
    stated = (mark.reference.row, mark.reference.column)
    for axis, (place, found) in enumerate(zip(stated, (mark.row, mark.column), strict=True)):
        if place is not None:
            shift[:, axis] += found - place
    return shift


def has_moved(shift: NDArray[np.float64], mark: Mark) -> NDArray[np.bool_]:
    """Whether a shift [field, 2] passes the tolerance, or 0.25 pixel, in either direction."""
    limit = mark.reference.tolerance or _CERTAIN
    return np.asarray((np.abs(shift) > limit).any(axis=1))


def moved_fields(shift: NDArray[np.float64], mark: Mark) -> NDArray[np.bool_]:
    """Say in which fields of a record the camera is not where it was at first.

    Parameters
    ----------
    shift : ndarray, shape (field, 2)
        From `mark_shift`, all fields of a record in order [pixels].
    mark : Mark
        From `learn_mark`.

    Returns
    -------
    ndarray of bool, shape (field,)
        Fields in which `has_moved` holds; unless the setup states a tolerance, also those where
        the mark lies off its first place by 6 standard deviations and 0.005 pixel.

    Notes
    -----
    A shift by itself does not turn the line, but it comes with a turn that one mark cannot tell:
    rolled by 0.002 deg, the camera moves a mark 300 columns from its axis by 0.004 to 0.01 pixel.
    So every shift counts that the record can show. Its steps are found by binary segmentation
    (Scott and Knott, Biometrics 30 (1974) 507, doi:10.2307/2529204); the noise is how much the
    mark moves within 8 fields, a camera that sways included. A turn about the mark itself, or one
    that a shift makes up for at the mark, is not seen.
    """
    moved = has_moved(shift, mark)
    if mark.reference.tolerance is None:
        for along in shift.T:
            moved |= _off_first_place(along)
    return moved


def _off_first_place(shift: _Array) -> NDArray[np.bool_]:
    off = np.zeros(shift.size, np.bool_)
    known = np.flatnonzero(np.isfinite(shift))
    if known.size < 2 * _LEAST_FIELDS:
        return off
    z = shift[known]
    noise = _sway(z)
    edges = [0, *_steps(z, noise), z.size]
    n_first = edges[1]
    place = z[:n_first].mean()
    for start, stop in pairwise(edges):
        deviation = noise * np.sqrt(1 / (stop - start) + 1 / n_first)
        lasting = abs(z[start:stop].mean() - place) > max(_SIGMAS * deviation, _LEAST_SHIFT)
        sudden = np.abs(z[start:stop] - place) > max(_SIGMAS * noise, _LEAST_SHIFT)
        off[known[start:stop]] = lasting | sudden
    return off


def _sway(z: _Array) -> float:
    """Tell the standard deviation about a steady place from differences of near fields."""
    lags = range(1, min(_LAGS, z.size // 6) + 1)  # a step is in a fifth of the differences at most
    apart = [float(np.median(np.abs(z[lag:] - z[:-lag]))) for lag in lags]
    return max(1.4826 * max(apart) / math.sqrt(2), 1e-6)


def _steps(z: _Array, noise: float) -> list[int]:
    """Where the mean steps, in order."""
    steps: list[int] = []
    left = [(0, z.size)]
    while left:
        start, stop = left.pop()
        at = start + _step(z[start:stop], noise)
        if at > start:
            steps.append(at)
            left += [(start, at), (at, stop)]
    return sorted(steps)


def _step(z: _Array, noise: float) -> int:
    """Count the values before the most significant step of the mean; 0 for none."""
    if z.size < 2 * _LEAST_FIELDS:
        return 0
    before = np.arange(_LEAST_FIELDS, z.size - _LEAST_FIELDS + 1)
    after = z.size - before
    total = np.cumsum(z - z.mean())[before - 1]  # of the values before; those after are minus it
    significance = np.abs(total) * np.sqrt(z.size / (before * after)) / noise
    top = int(significance.argmax())
    return int(before[top]) if significance[top] > _SIGMAS else 0


def _profiles(fields: NDArray[np.integer], reference: Reference) -> tuple[_Array, _Array]:
    """Mean grey levels of the box's rows and of its columns [field, row], [field, column]."""
    (top, bottom), (left, right) = reference.rows, reference.columns
    box = fields[:, top:bottom, left:right]
    return box.mean(axis=2, dtype=np.float64), box.mean(axis=1, dtype=np.float64)


def _mean_profile(profiles: _Array, which: NDArray[np.bool_]) -> _Profile:
    if not which.any():
        return _Profile(np.full(profiles.shape[1], np.nan), np.nan)
    grey: _Array = profiles[which].mean(axis=0)
    step = np.abs(np.diff(grey))
    if step.max() < _LEAST_STEEPNESS:
        return _Profile(grey, np.nan)
    weight = np.maximum(step - _STEEP * step.max(), 0.0)
    place = float(weight @ (np.arange(step.size) + 0.5) / weight.sum())
    return _Profile(grey, place)


def _mean_known(values: list[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else np.nan


def _match(profiles: _Array, mark: _Profile) -> _Array:
    """Shift of each profile from the mark's."""
    if len(profiles) == 0 or not np.isfinite(mark.place):
        return np.full(len(profiles), np.nan)
    curve = CubicSpline(np.arange(mark.grey.size), mark.grey)
    slope = curve.derivative()
    shift = _best_whole_shift(profiles, mark.grey)
    for _ in range(_ROUNDS):
        at = np.arange(mark.grey.size) - shift[:, None]
        inside = (at >= 0) & (at <= mark.grey.size - 1)
        grey, steep = curve(at), -slope(at)
        gain, offset = _linear_fit(grey, profiles, inside)
        left = np.where(inside, profiles - gain * grey - offset, 0.0)
        steep = np.where(inside, gain * steep, 0.0)
        steep -= np.where(inside, steep.sum(axis=1, keepdims=True) / inside.sum(axis=1)[:, None], 0)
        step = (steep * left).sum(axis=1) / np.maximum((steep**2).sum(axis=1), 1e-12)
        shift = shift + np.clip(step, -0.7, 0.7)
    like = _likeness(curve(np.arange(mark.grey.size) - shift[:, None]), profiles, shift)
    return np.where(like >= _LEAST_LIKENESS, shift, np.inf)


def _best_whole_shift(profiles: _Array, grey: _Array) -> _Array:
    reach = grey.size // 2
    shifts = np.arange(-reach, reach + 1)
    padded = np.pad(grey, reach, mode="edge")
    shifted = np.stack([padded[reach - s : reach - s + grey.size] for s in shifts])
    shifted -= shifted.mean(axis=1, keepdims=True)
    norm = np.sqrt((shifted**2).sum(axis=1)) + 1e-9
    score = (profiles - profiles.mean(axis=1, keepdims=True)) @ shifted.T / norm
    best: _Array = shifts[np.argmax(score, axis=1)].astype(np.float64)
    return best


def _linear_fit(
    x: _Array, y: _Array, inside: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gain and offset [field, 1] that bring each row of x to y."""
    count = np.maximum(inside.sum(axis=1, keepdims=True), 1)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    x_mean, y_mean = x.sum(axis=1, keepdims=True) / count, y.sum(axis=1, keepdims=True) / count
    dx = np.where(inside, x - x_mean, 0.0)
    gain = (dx * y).sum(axis=1, keepdims=True) / np.maximum(
        (dx**2).sum(axis=1, keepdims=True), 1e-12
    )
    return gain, y_mean - gain * x_mean


def _likeness(expected: _Array, profiles: _Array, shift: _Array) -> _Array:
    """Correlation of each profile with the shifted mark, where they overlap."""
    size = profiles.shape[1]
    at = np.arange(size) - shift[:, None]
    inside = (at >= 0) & (at <= size - 1)
    count = np.maximum(inside.sum(axis=1, keepdims=True), 1)
    x, y = (
        np.where(inside, v - np.where(inside, v, 0).sum(axis=1, keepdims=True) / count, 0.0)
        for v in (expected, profiles)
    )
    scale = np.sqrt((x**2).sum(axis=1) * (y**2).sum(axis=1)) + 1e-9
    like: _Array = (x * y).sum(axis=1) / scale
    return np.where(inside.sum(axis=1) >= size / 3, like, 0.0)
