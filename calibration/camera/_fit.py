"""The fit of a camera to its boards: noise told from the residuals, bad images and corners out."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibration.camera._bundle import (
    ASPECT,
    DISTORTION,
    FOCAL,
    N_INTERIOR,
    PRINCIPAL,
    Adjusted,
    Observation,
    Problem,
    State,
    adjust,
    image_parts,
    inverted,
)
from calibration.camera._checks import refuse_alike
from calibration.camera._start import board_poses, first_state

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

ORDERS = (0, 1, 2, 4, 5)
"""Numbers of distortion coefficients, in the order k1, k2, p1, p2, k3."""

_ROUNDS = 8
_SAME_NOISE = 0.003  # relative: two results alike
_FIRST_NOISE = 0.1  # pixels
_FAR_IMAGE = 3.0  # times the others' residuals
_FAR_CORNER = 6.0  # standard deviations of its image's others
_MOST_CORNERS_OUT = 0.2  # of an image's corners
_LEAST_JURY = 6  # images of which one may be said to disagree with the others
_RANK = 1e-9  # of the greatest eigenvalue
_CHANCE = 1e-5  # of leaving out a good image
_ONE_SIDE = 0.998  # cosine of the angle between normals that are one pose's
_MAD = 1.4826  # standard deviations in a median absolute deviation


@dataclass(frozen=True, eq=False)
class Fit:
    """A camera fitted to the images that are kept.

    Attributes
    ----------
    problem : Problem
        What was adjusted at last.
    adjusted : Adjusted
        Its result.
    kept : tuple of int
        Numbers of the images, of those that were given.
    out : mapping of int to str
        Numbers of images that were left out, and why.
    corners_out : mapping of int to int
        How many corners were left out of an image that is kept.
    """

    problem: Problem
    adjusted: Adjusted
    kept: tuple[int, ...]
    out: Mapping[int, str] = field(default_factory=dict)
    corners_out: Mapping[int, int] = field(default_factory=dict)

    @property
    def degrees_of_freedom(self) -> float:
        """Number of observations less that of the unknowns they determine."""
        return float(sum(np.sum(each) for each in self.adjusted.freedom))


def free_parameters(order: int, hold: Sequence[str]) -> Mask:
    """Return which of the interior's parameters are adjusted.

    Parameters
    ----------
    order : int
        Number of distortion coefficients, one of `ORDERS`.
    hold : sequence of str
        "pixel_pitch_v" and "principal_point" keep what is given.
    """
    free = np.zeros(N_INTERIOR, np.bool_)
    free[FOCAL] = True
    free[ASPECT] = "pixel_pitch_v" not in hold
    free[PRINCIPAL] = "principal_point" not in hold
    free[DISTORTION[:order]] = True
    return free


def first_fit(
    observations: Sequence[Observation],
    places: Floats,
    *,
    radius: float,
    sensor: tuple[int, int],
    aspect: float,
    hold: Sequence[str],
    order: int,
) -> Fit:
    """Fit a camera from scratch to an exact board: in closed form, with k1 alone, then with k2.

    Raises
    ------
    CalibrationError
        If all boards are turned alike.
    numpy.linalg.LinAlgError
        If the images do not determine a camera at all.
    """
    held = "pixel_pitch_v" in hold
    state = first_state(observations, places, sensor, aspect, hold_aspect=held)
    few = free_parameters(min(order, 1), (*hold, "principal_point"))
    problem = Problem(tuple(observations), places, 0.0, radius, few, np.full(2, _FIRST_NOISE))
    adjusted = adjust(problem, state)
    refuse_alike(adjusted.state)
    more = dataclasses.replace(problem, free=free_parameters(min(order, 2), hold))
    tried = adjust(more, adjusted.state)
    if tried.converged:
        problem, adjusted = more, adjust(more, _turned_over(more, tried))
    return Fit(problem, adjusted, tuple(range(len(observations))))


def _turned_over(problem: Problem, adjusted: Adjusted) -> State:
    """Return the state with each board as this camera sees it best.

    A first camera that is far off may have taken the wrong one of the two sides from which a small
    board looks nearly alike.
    """
    state = adjusted.state
    again = board_poses(problem.observations, state.places, state.interior)
    turns = [
        (cv2.Rodrigues(one)[0][:, 2], cv2.Rodrigues(other)[0][:, 2])
        for one, other in zip(state.poses[:, :3], again[:, :3], strict=True)
    ]
    other_side = [number for number, (a, b) in enumerate(turns) if a @ b < _ONE_SIDE]
    if not other_side:
        return state
    poses = state.poses.copy()
    poses[other_side] = again[other_side]
    tried = adjust(problem, state._replace(poses=poses))
    return tried.state if tried.cost < adjusted.cost else state


def settled(fit: Fit) -> Fit:
    """Repeat the adjustment until the noise that weighs it is the noise that it leaves."""
    for _ in range(_ROUNDS):
        noise = _noise(fit.adjusted)
        same = np.abs(noise / fit.problem.noise - 1).max() < _SAME_NOISE
        if same:
            break
        problem = dataclasses.replace(fit.problem, noise=noise)
        fit = dataclasses.replace(
            fit, problem=problem, adjusted=adjust(problem, fit.adjusted.state)
        )
    return fit


def with_order(
    fit: Fit,
    order: int,
    hold: Sequence[str],
    *,
    settle: bool,
    place_std: float | None = None,
) -> Fit:
    """Fit the same images with another number of distortion coefficients, or another board."""
    free = free_parameters(order, hold)
    start = fit.adjusted.state
    values = np.where(free | ~_distorts(), start.interior.values, 0.0)
    std = fit.problem.place_std if place_std is None else place_std
    problem = dataclasses.replace(fit.problem, free=free, place_std=std)
    state = start._replace(interior=dataclasses.replace(start.interior, values=values))
    again = dataclasses.replace(fit, problem=problem, adjusted=adjust(problem, state))
    return settled(again) if settle else again


def _distorts() -> Mask:
    mask = np.zeros(N_INTERIOR, np.bool_)
    mask[DISTORTION] = True
    return mask


def _noise(adjusted: Adjusted) -> Floats:
    """Noise of u and v [pixels], from residuals and their degrees of freedom."""
    squares = sum(np.sum(each**2, axis=0) for each in adjusted.residuals)
    freedom = sum(np.sum(each, axis=0) for each in adjusted.freedom)
    noise: Floats = np.maximum(np.sqrt(squares / np.maximum(freedom, 1.0)), 1e-9)
    return noise


def cleaned(fit: Fit, n_least: int) -> Fit:
    """Leave out images that disagree with the others, the worst first, and single corners.

    An image is left out where its residuals are more than three times the others' (by medians, so
    that a few bad corners do not condemn it), or where the camera that it asks for is not that of
    the others. Of an image that is kept, corners go that lie six of its standard deviations off.

    Parameters
    ----------
    fit : Fit
        All images.
    n_least : int
        How many images to keep at least.
    """
    while len(fit.kept) > n_least:
        levels = _levels(fit)
        worst = int(np.argmax(levels))
        others = float(np.median(np.delete(levels, worst)))
        if levels[worst] <= _FAR_IMAGE * others:
            break
        pixels = float(np.mean(fit.problem.noise))
        reason = (
            f"its corners miss the fit by {pixels * levels[worst]:.2g} pixels, the other images' "
            f"by {pixels * others:.2g}: the board moved or bent, the picture is blurred, or "
            "another board is seen; photograph it again at rest"
        )
        fit = without(fit, worst, reason)
    fit = _without_far_corners(fit)
    while len(fit.kept) > max(n_least, _LEAST_JURY):
        discord, limit = _discord(fit)
        worst = int(np.argmax(discord))
        if discord[worst] <= limit:
            break
        reason = (
            "it asks for another camera than the other images do, although its corners fit: the "
            "board moved while the picture was read out, or it was scaled or refocused; "
            "photograph it again at rest"
        )
        fit = without(fit, worst, reason)
    return fit


def _discord(fit: Fit) -> tuple[Floats, float]:
    """Return how far each image's camera is from the others', as chi-square, and the limit.

    With N the others' and N_i the image's normal matrix and g_i its right-hand side at the common
    solution, g_i has the covariance N_i - N_i (N + N_i)^-1 N_i. Where all images disagree, because
    of errors that they share, the limit rises with their median.
    """
    problem = dataclasses.replace(fit.problem, place_std=0.0)
    parts = image_parts(problem, fit.adjusted.state)
    total = np.sum([normal for normal, _ in parts], axis=0)
    scale = 1 / np.sqrt(np.diag(total))  # unknowns differ by many powers of ten
    every = inverted(total * np.outer(scale, scale))
    discord = np.empty(len(parts))
    for number, (own, right) in enumerate(parts):
        normal, scaled = own * np.outer(scale, scale), right * scale
        covariance = normal - normal @ every @ normal
        discord[number] = scaled @ np.linalg.pinv(covariance, _RANK, hermitian=True) @ scaled
    n = problem.n_free
    excess = max(1.0, float(np.median(discord) / special.chdtri(n, 0.5)))
    return discord, excess * float(special.chdtri(n, _CHANCE / len(parts)))


def without(fit: Fit, image: int, reason: str) -> Fit:
    """Leave one of the kept images out, and fit again."""
    rest = [number for number in range(len(fit.kept)) if number != image]
    problem = dataclasses.replace(
        fit.problem, observations=tuple(fit.problem.observations[number] for number in rest)
    )
    state = fit.adjusted.state._replace(poses=fit.adjusted.state.poses[rest])
    return settled(
        Fit(
            problem,
            adjust(problem, state),
            tuple(fit.kept[number] for number in rest),
            {**fit.out, fit.kept[image]: reason},
            fit.corners_out,
        )
    )


def _levels(fit: Fit) -> Floats:
    """Return each image's residuals, in units of the noise."""
    return np.array(
        [
            _MAD * np.median(np.abs(residual) / fit.problem.noise / np.sqrt(np.maximum(free, 0.05)))
            for residual, free in zip(fit.adjusted.residuals, fit.adjusted.freedom, strict=True)
        ]
    )


def _without_far_corners(fit: Fit) -> Fit:
    levels, observations, corners_out = _levels(fit), [], dict(fit.corners_out)
    for number, one in enumerate(fit.problem.observations):
        scaled = np.abs(fit.adjusted.residuals[number]) / fit.problem.noise / levels[number]
        good = scaled.max(axis=1) < _FAR_CORNER
        if np.mean(~good) > _MOST_CORNERS_OUT:
            good[:] = True
        if not good.all():
            corners_out[fit.kept[number]] = int(np.sum(~good))
        observations.append(Observation(one.corner[good], one.uv[good]))
    if corners_out == fit.corners_out:
        return fit
    problem = dataclasses.replace(fit.problem, observations=tuple(observations))
    return settled(
        dataclasses.replace(
            fit,
            problem=problem,
            adjusted=adjust(problem, fit.adjusted.state),
            corners_out=corners_out,
        )
    )
