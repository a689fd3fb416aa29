"""Closed-form poses to start from, of which a few wrong targets do not decide."""

from itertools import combinations
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.resection._attitude import angle_between, tunnel_angles
from glint_aoa.geometry import rotation_matrix

Floats = NDArray[np.float64]

_TO_OPENCV = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # x right, y down, z ahead
_TRIALS = 60  # of three targets; with 30 % of all wrong, one in 1e11 fields has no good trial
_FLATTEST = 0.05  # height of a triangle over its longest side
_SAME_POSE = np.radians(3.0)
_CUT = 3.5  # standard deviations
_MUCH_WORSE = 10.0  # times the best pose's spread: not worth a fit


class Start(NamedTuple):
    """A pose to start from.

    Attributes
    ----------
    pose : ndarray [6]
        X, Y, Z [m], omega, phi, kappa [rad].
    spread : float
        Residuals of the better half of the targets, as a robust standard deviation, in units of
        the stated one.
    """

    pose: Floats
    spread: float


def closed_form_starts(points: Floats, xy: Floats, scale: Floats) -> list[Start]:
    """Find poses from four targets or more.

    Three targets at a time give up to four poses each (P3P); the pose whose better half of
    residuals is least tells which targets to trust. From these come the two poses that a plane
    allows (IPPE: T. Collins, A. Bartoli, Int. J. Computer Vision 109, 252, 2014) and the one of
    targets in space (SQPnP: G. Terzakis, M. Lourakis, ECCV 2020).

    Parameters
    ----------
    points : ndarray [target, 3]
        X, Y, Z [m].
    xy : ndarray [target, 2]
        Normalised image coordinates, to the right and down.
    scale : ndarray [target, 2]
        What one unit of these is in standard deviations of the measurement.

    Returns
    -------
    list of Start
        Poses that differ by more than 3 deg and see most targets in front, best first.
    """
    centre = points.mean(axis=0)
    size = np.sqrt(np.mean(np.sum((points - centre) ** 2, axis=1)))
    shape = (points - centre) / size
    rotations, shifts = _three_at_a_time(shape, xy)
    spread, distance2 = _judged(rotations, shifts, shape, xy, scale)
    if not np.isfinite(spread).any():
        return []
    best = int(np.argmin(spread))
    trusted = distance2[best] <= (_CUT * max(spread[best], np.finfo(float).tiny)) ** 2
    if np.sum(trusted) >= 4:
        more = _of_many(shape[trusted], xy[trusted])
        rotations, shifts = (
            np.concatenate(each) for each in zip((rotations, shifts), more, strict=True)
        )
        spread, _ = _judged(rotations, shifts, shape, xy, scale)
    starts: list[tuple[Floats, Start]] = []
    for i in np.argsort(spread):
        if spread[i] > _MUCH_WORSE * spread.min():
            break
        to_tunnel = rotations[i].T @ _TO_OPENCV
        if all(angle_between(to_tunnel, other) > _SAME_POSE for other, _ in starts):
            place = centre - size * (rotations[i].T @ shifts[i])
            pose = np.concatenate([place, tunnel_angles(to_tunnel)])
            starts.append((to_tunnel, Start(pose, float(spread[i]))))
    return [start for _, start in starts]


def place_of_rotation(
    points: Floats, xy: Floats, angles: Floats, fixed: tuple[NDArray[np.bool_], Floats]
) -> Floats:
    """Solve for the perspective centre of a camera whose rotation is known.

    Parameters
    ----------
    points : ndarray [target, 3]
        X, Y, Z [m].
    xy : ndarray [target, 2]
        Normalised image coordinates, to the right and down.
    angles : ndarray [3]
        omega, phi, kappa [rad].
    fixed : tuple of ndarray [3]
        Which of X, Y, Z are known, and their values [m].

    Returns
    -------
    ndarray [3]
        X, Y, Z that come nearest to all rays [m].
    """
    ones = np.ones(len(xy))
    rays = np.stack([xy[:, 0], ones, -xy[:, 1]], axis=-1) @ rotation_matrix(*angles).T
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    is_fixed, value = fixed
    place = np.where(is_fixed, value, 0.0)
    wanted = np.einsum("nij,nj->ni", across, points - place).ravel()
    solved = np.linalg.lstsq(across[:, :, ~is_fixed].reshape(wanted.size, -1), wanted)[0]
    place[~is_fixed] = solved
    return place


def mirrored(points: Floats, pose: Floats) -> Floats:
    """Return the pose that shows targets in a plane alike, but for perspective.

    The plane is tilted the other way about the line of sight to its centre.

    Parameters
    ----------
    points : ndarray [target, 3]
        X, Y, Z [m].
    pose : ndarray [6]
        X, Y, Z [m], omega, phi, kappa [rad].
    """
    centre = points.mean(axis=0)
    normal = np.linalg.svd(points - centre)[2][2]
    to_camera = rotation_matrix(*pose[3:]).T
    seen = to_camera @ (centre - pose[:3])
    sight = seen / np.linalg.norm(seen)
    flip, turn = (np.eye(3) - 2 * np.outer(each, each) for each in (sight, normal))
    to_tunnel = (flip @ to_camera @ turn).T
    return np.concatenate([centre - to_tunnel @ seen, tunnel_angles(to_tunnel)])


def spread_of(distance2: Floats) -> Floats:
    """Return robust standard deviations from squared distances in the image.

    The least median of squares (P. J. Rousseeuw, J. Am. Stat. Assoc. 79, 871, 1984), with as many
    targets counted as three of them being met exactly asks for.

    Parameters
    ----------
    distance2 : ndarray [..., target]
        Squared distances, in units of a variance.

    Returns
    -------
    ndarray [...]
        In units of the standard deviation.
    """
    n = distance2.shape[-1]
    counted = min((n + 4) // 2, n)
    middle = np.partition(distance2, counted - 1, axis=-1)[..., counted - 1]
    expected = -2 * np.log1p(-(counted - 0.5) / n)  # quantile of chi-square with 2 degrees
    return np.asarray(np.sqrt(middle / expected), np.float64)


def _three_at_a_time(shape: Floats, xy: Floats) -> tuple[Floats, Floats]:
    """Return rotations [pose, 3, 3] and shifts [pose, 3] from the targets to OpenCV's camera."""
    rotations, shifts = [], []
    for chosen in _triples(shape):
        _, turns, places = cv2.solveP3P(
            shape[chosen], xy[chosen], np.eye(3), None, flags=cv2.SOLVEPNP_AP3P
        )
        rotations += [cv2.Rodrigues(turn)[0] for turn in turns]
        shifts += [place.ravel() for place in places]
    return np.array(rotations).reshape(-1, 3, 3), np.array(shifts).reshape(-1, 3)


def _triples(shape: Floats) -> NDArray[np.int64]:
    """Return triples of targets, as [triple, 3], that are no thin triangles."""
    n = len(shape)
    if n * (n - 1) * (n - 2) // 6 <= 2 * _TRIALS:
        chosen = np.array(list(combinations(range(n), 3)))
    else:
        shuffled = np.random.default_rng(n).random((_TRIALS, n)).argsort(axis=1)
        chosen = shuffled[:, :3]
    corners = shape[chosen]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    return np.asarray(chosen[areas >= _FLATTEST * sides**2], np.int64)


def _of_many(shape: Floats, xy: Floats) -> tuple[Floats, Floats]:
    """Poses from four targets or more: of the plane nearest to them, and of them in space."""
    middle = shape.mean(axis=0)
    normal = np.linalg.svd(shape - middle)[2][2]
    in_plane = shape - np.outer((shape - middle) @ normal, normal)
    rotations, shifts = [], []
    for corners, method in ((in_plane, cv2.SOLVEPNP_IPPE), (shape, cv2.SOLVEPNP_SQPNP)):
        try:
            _, turns, places, _ = cv2.solvePnPGeneric(corners, xy, np.eye(3), None, flags=method)
        except cv2.error:  # a shape that the method does not know; the others remain
            continue
        rotations += [cv2.Rodrigues(turn)[0] for turn in turns]
        shifts += [place.ravel() for place in places]
    return np.array(rotations).reshape(-1, 3, 3), np.array(shifts).reshape(-1, 3)


def _judged(
    rotations: Floats, shifts: Floats, shape: Floats, xy: Floats, scale: Floats
) -> tuple[Floats, Floats]:
    """Return the spread [pose] and squared distances [pose, target], infinite behind the camera."""
    seen = shape @ rotations.transpose(0, 2, 1) + shifts[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        residual = (seen[..., :2] / seen[..., 2:] - xy) * scale
        distance2 = np.where(seen[..., 2] > 0, np.sum(residual**2, axis=-1), np.inf)
    return spread_of(distance2), distance2
