"""Which circle of an image is which target, from where the targets were or should be."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

__all__ = ["track"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Index = NDArray[np.int64]

_BASELINES = 12  # pairs of targets that are tried on all pairs of circles
_SCALE = (0.8, 1.25)
_TURN = np.radians(30.0)
_MOST = 20_000  # hypotheses
_NEAR, _LESS_NEAR = 0.35, 0.5  # of the distance to the nearest other target: at first, then
_ROUNDS = 10
_FEWEST_AFFINE = 4


def track(expected: Floats, circles: Floats) -> Index:
    """Find the circle of each target.

    The similarity that brings most targets near to a circle is taken first; from the pairs that
    it makes follows an affine transformation, from which the next pairs, until none changes.

    Parameters
    ----------
    expected : ndarray, shape (target, 2)
        Where the targets are expected on the image plane, apart from a turn of up to 30 deg, a
        scale of 0.8 to 1.25 and any shift [m].
    circles : ndarray, shape (circle, 2)
        Where circles are [m].

    Returns
    -------
    ndarray of int, shape (target,)
        Number of its circle, -1 where there is none.
    """
    nothing = np.full(len(expected), -1)
    if len(circles) == 0 or len(expected) == 0:
        return nothing
    tree = KDTree(circles)
    apart = _to_neighbour(expected)
    moved = _moved(expected, circles, tree, _NEAR * apart)
    pairs = _pairs(moved, circles, tree, _NEAR * apart)
    for _ in range(_ROUNDS):
        if (pairs >= 0).sum() < 2:
            break
        moved = _fitted(expected, circles, pairs)
        again = _pairs(moved, circles, tree, _LESS_NEAR * apart)
        if (again == pairs).all():
            break
        pairs = again
    return pairs


def _to_neighbour(places: Floats) -> Floats:
    """Distance of each place to the next one; endless where it is alone."""
    distance, _ = KDTree(places).query(places, k=2)
    return np.asarray(distance, np.float64)[:, 1]


def _moved(expected: Floats, circles: Floats, tree: KDTree, near: Floats) -> Floats:
    """Move the targets by the similarity that brings most of them near to a circle.

    Where several do as well, as on a regular row of which an end is hidden, it is the one that
    moves them least.
    """
    here, there = (places @ np.array([1, 1j]) for places in (expected, circles))
    turn, shift = _hypotheses(here, there)
    moved = turn[:, None] * here + shift[:, None]
    distance, _ = tree.query(np.stack([moved.real, moved.imag], axis=-1))
    hits = (np.asarray(distance) < near).sum(axis=1)
    travel = np.mean(np.abs(moved - here) ** 2, axis=1)
    best = moved[np.lexsort((travel, -hits))[0]]
    return np.stack([best.real, best.imag], axis=-1)


def _hypotheses(here: Complexes, there: Complexes) -> tuple[Complexes, Complexes]:
    """Return turns and shifts that bring two targets onto two circles, or one onto one."""
    start, end = np.triu_indices(here.size, 1)
    longest = np.argsort(-np.abs(here[end] - here[start]), kind="stable")[:_BASELINES]
    start, end = start[longest], end[longest]
    steps = there - there[:, None]  # [from, to]
    turn = steps / (here[end] - here[start])[:, None, None]
    size = np.abs(turn)
    possible = (size > _SCALE[0]) & (size < _SCALE[1]) & (np.abs(np.angle(turn)) < _TURN)
    which, one, other = np.nonzero(possible)
    if which.size > _MOST:
        kept = np.linspace(0, which.size - 1, _MOST).astype(np.int64)
        which, one, other = which[kept], one[kept], other[kept]
    turns = turn[which, one, other]
    shifts = there[one] - turns * here[start[which]]
    plain = (there - here[:, None]).ravel()
    return np.append(turns, np.ones(plain.size + 1)), np.concatenate([shifts, plain, [0]])


def _pairs(moved: Floats, circles: Floats, tree: KDTree, near: Floats) -> Index:
    """Pair targets and circles that are nearest to each other."""
    distance, circle = (np.asarray(each) for each in tree.query(moved))
    _, target = KDTree(moved).query(circles)
    mutual = np.asarray(target)[circle] == np.arange(len(moved))
    return np.where(mutual & (distance < near), circle, -1).astype(np.int64)


def _fitted(expected: Floats, circles: Floats, pairs: Index) -> Floats:
    """Move all targets as those that have a circle moved: by an affine map, or a similarity."""
    known = pairs >= 0
    before, after = expected[known], circles[pairs[known]]
    middle = before.mean(axis=0)
    spread = np.linalg.svd(before - middle, compute_uv=False)
    if len(before) >= _FEWEST_AFFINE and spread[1] > 0.1 * spread[0]:
        design = np.column_stack([before - middle, np.ones(len(before))])
        matrix = np.linalg.lstsq(design, after, rcond=None)[0]
        mapped = np.column_stack([expected - middle, np.ones(len(expected))]) @ matrix
        return np.asarray(mapped, np.float64)
    here, there = ((each - each.mean(axis=0)) @ np.array([1, 1j]) for each in (before, after))
    turn = np.vdot(here, there) / np.vdot(here, here)
    moved = (expected - middle) @ np.array([1, 1j]) * turn
    return np.asarray(np.stack([moved.real, moved.imag], axis=-1) + after.mean(axis=0))
