"""Which circle of an image is which target: from an approximate pose, then from a better one."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from calibration.resection._attitude import angle_between
from calibration.resection._pose_fit import Problem, fit_robustly
from calibration.resection._pose_start import closed_form_starts
from calibration.resection._projection import Interior
from glint_aoa.geometry import rotation_matrix

Floats = NDArray[np.float64]
Index = NDArray[np.int64]

_PAIRS = 40
_HYPOTHESES = 20_000
_SCALE = (0.6, 1.6)
_TURN = np.radians(25.0)
_NEAR = 0.3  # of the distance between neighbouring targets
_NEARER = 0.15
_FAR_TURNED = np.radians(45.0)
_ROUNDS = 10
_FEWEST = 4


class Match(NamedTuple):
    """Pairs of target and circle, as indices [pair]."""

    target: Index
    circle: Index


def match(points: Floats, uv: Floats, interior: Interior, pose: Floats) -> Match | None:
    """Find which circle is which target.

    The targets are projected with the approximate pose. The similarity in the image that brings
    most of them onto circles gives the first pairs; from these follows a pose, from which the
    next, until none changes.

    Parameters
    ----------
    points : ndarray [target, 3]
        X, Y, Z [m].
    uv : ndarray [circle, 2]
        Column and line of the circles [pixels].
    interior : Interior
        Interior orientation.
    pose : ndarray [6]
        Approximate pose [m, rad]; the turn in the image may be wrong by 25 deg and the distance
        by a factor 1.6.

    Returns
    -------
    Match or None
        None where too few belong together.
    """
    seen = interior.project(points, pose)
    ahead = np.flatnonzero(seen.depth > 0)
    if ahead.size < _FEWEST or len(uv) < _FEWEST:
        return None
    pitch = np.array(interior.pixel_pitch)
    expected, circles = seen.uv[ahead] * pitch, uv * pitch
    moved = _moved_onto(expected, circles)
    found = _pairs(moved, circles, _NEAR * _spacing(moved))
    found = Match(ahead[found.target], found.circle)
    for _ in range(_ROUNDS):
        if found.target.size < _FEWEST:
            return None
        better = _pose_of(points[found.target], uv[found.circle], interior, pose)
        if better is None:
            return None
        predicted = interior.project(points, better).uv * pitch
        again = _pairs(predicted, circles, _NEARER * _spacing(predicted))
        is_same = np.array_equal(again.target, found.target) and np.array_equal(
            again.circle, found.circle
        )
        found = again
        if is_same:
            break
    few = min(len(points), len(uv)) / 2
    return found if found.target.size >= max(_FEWEST, few) else None


def _moved_onto(expected: Floats, circles: Floats) -> Floats:
    """Move projected targets by the similarity that brings most of them near to a circle."""
    here, there = (each[:, 0] + 1j * each[:, 1] for each in (expected, circles))
    turn, shift = _similarities(here, there)
    if not turn.size:
        return expected
    moved = turn[:, None] * here + shift[:, None]  # [hypothesis, target]
    places = np.stack([moved.real, moved.imag], axis=-1)
    near = _NEAR * _spacing(expected) * np.abs(turn)
    distance, _ = KDTree(circles).query(places)
    hits = np.sum(distance < near[:, None], axis=1)
    # where several do as well, as on a regular grid, the one that moves least
    travel = np.sqrt(np.mean(np.abs(moved - here) ** 2, axis=1))
    best = np.lexsort((travel, -hits))[0]
    return np.asarray(places[best], np.float64)


def _similarities(
    here: NDArray[np.complex128], there: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return turns and shifts that bring two targets that are far apart onto two circles."""
    distance = np.abs(here[:, None] - here)
    far = np.argsort(distance, axis=1)[:, ::-1][:, :3]
    one = np.repeat(np.arange(here.size), far.shape[1])
    pairs = np.stack([one, far.ravel()], axis=1)
    rng = np.random.default_rng(here.size)
    pairs = rng.permutation(pairs[distance[pairs[:, 0], pairs[:, 1]] > 0])[:_PAIRS]
    steps = there[None, :] - there[:, None]  # [from, to]
    wanted = here[pairs[:, 1]] - here[pairs[:, 0]]
    turn = steps[None] / wanted[:, None, None]
    size = np.abs(turn)
    possible = (size > _SCALE[0]) & (size < _SCALE[1]) & (np.abs(np.angle(turn)) < _TURN)
    which, start, end = np.nonzero(possible)
    if which.size > _HYPOTHESES:
        keep = rng.choice(which.size, _HYPOTHESES, replace=False)
        which, start, end = which[keep], start[keep], end[keep]
    turns = turn[which, start, end]
    return turns, there[start] - turns * here[pairs[which, 0]]


def _spacing(places: Floats) -> float:
    """Return the distance between neighbours, of the closest tenth."""
    distance = np.asarray(KDTree(places).query(places, k=2)[0], np.float64)
    return float(np.quantile(distance[:, 1], 0.1))


def _pairs(predicted: Floats, circles: Floats, near: float) -> Match:
    """Pair what is nearest to each other."""
    to_circle, circle = (np.asarray(each) for each in KDTree(circles).query(predicted))
    _, target = KDTree(predicted).query(circles)
    is_mutual = np.asarray(target)[circle] == np.arange(len(predicted))
    chosen = np.flatnonzero(is_mutual & (to_circle < near))
    return Match(chosen, circle[chosen])


def _pose_of(points: Floats, uv: Floats, interior: Interior, near: Floats) -> Floats | None:
    """Return a pose that a few wrong pairs do not disturb, on the approximate one's side."""
    ratio = interior.pixel_pitch[0] / interior.pixel_pitch[1]
    starts = closed_form_starts(
        points, interior.normalised(uv), np.broadcast_to(interior.scale, uv.shape) / [1.0, ratio]
    )
    rotation = rotation_matrix(*near[3:])
    start = next(
        (
            each
            for each in starts
            if angle_between(rotation, rotation_matrix(*each.pose[3:])) < _FAR_TURNED
        ),
        None,
    )
    if start is None:
        return None
    problem = Problem(
        interior=interior,
        points=points,
        point_variance=np.zeros_like(points),
        uv=uv,
        covariance=np.broadcast_to(np.diag([1.0, ratio**2]), (len(uv), 2, 2)),
        noise_known=False,
        held=np.zeros(6, bool),
        value=near,
        std=np.full(6, np.inf),
    )
    return fit_robustly(problem, start.pose, start.spread)[0]
