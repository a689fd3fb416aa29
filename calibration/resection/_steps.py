"""The steps of a space resection: what is to be solved, from where, and what comes out."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calibration.resection._attitude import angle_between
from calibration.resection._checks import thickness
from calibration.resection._pose_fit import (
    POSE,
    PoseFit,
    Problem,
    fit_robustly,
    fit_used,
    without_outliers,
)
from calibration.resection._pose_start import (
    closed_form_starts,
    mirrored,
    place_of_rotation,
    spread_of,
)
from calibration.resection._projection import Interior
from calibration.resection.file import MirrorPose, ResectedTarget
from calibration.resection.target_field import ImageTargets, TargetField
from glint_aoa.errors import CalibrationError
from glint_aoa.geometry import rotation_matrix
from glint_aoa.setup import Camera

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_OTHER_POSE = np.radians(0.1)
_AS_GOOD = 9.0  # difference of chi-square below which two poses cannot be told apart
_HOPELESS = 100.0  # difference from which another pose is not worth a word
_FLATTISH = 0.3  # depth of targets over their width: more of it allows one pose only
_MOST_STARTS = 3
_PLAINLY_LINEAR = np.radians(0.1)
_STDS = 2.0
_REACHES = (4.0, 2.8, 2.0, 1.4, 1.0)  # times the standard deviations, from far to near


class Solution(NamedTuple):
    """The pose taken, the targets it was fitted to, and the other pose where there is one."""

    fit: PoseFit
    used: Bools
    mirror: MirrorPose | None


def make_problem(
    known: TargetField,
    measured: ImageTargets,
    camera: Camera,
    *,
    hold: Collection[str],
    distance: tuple[float, float] | None,
) -> Problem:
    """Gather what is to be solved; see `calibration.resection.resect.resect`."""
    interior = Interior.of_camera(camera)
    unknown = [name for name in hold if name not in POSE]
    if unknown:
        raise CalibrationError(f"{unknown[0]!r} cannot be held; choose from {', '.join(POSE)}")
    held = np.array([name in hold for name in POSE])
    if held.all():
        raise CalibrationError("all of the pose is held; leave a parameter to be estimated")
    value, std = np.array([*(camera.position or (0.0,) * 3), *camera.rotation]), np.full(6, np.inf)
    if distance is not None:
        if held[1]:
            raise CalibrationError(
                "Y is held and a taped distance is given, which says the same; leave one out"
            )
        value[1], std[1] = -distance[0], distance[1]
    covariance = measured.covariance
    if covariance is None:
        nominal = np.diag([1.0, (interior.pixel_pitch[0] / interior.pixel_pitch[1]) ** 2])
        covariance = np.broadcast_to(nominal, (len(measured), 2, 2))
    return Problem(
        interior=interior,
        points=known.points,
        point_variance=known.std**2,
        uv=measured.uv,
        covariance=covariance,
        noise_known=measured.covariance is not None,
        held=held,
        value=value,
        std=std,
    )


def checked_distance(distance: float | None, std: float | None) -> tuple[float, float] | None:
    """Return a taped distance and its uncertainty [m], or None where there is none."""
    if distance is None and std is None:
        return None
    if distance is None or std is None:
        raise CalibrationError(
            "a taped distance needs its uncertainty, and the uncertainty a distance; give both, "
            "e.g. 56 in and 5 mm"
        )
    for name, value in (("distance", distance), ("its uncertainty", std)):
        if not (np.isfinite(value) and value > 0):
            raise CalibrationError(f"the taped distance: {name} is {value:g} m; give more than 0")
    return distance, std


def loosened(problem: Problem, hold_std: Mapping[str, float]) -> Problem:
    """Return the problem with what is held, but not exactly known, as measured instead."""
    wrong = [name for name in hold_std if name not in POSE or not problem.held[POSE.index(name)]]
    if wrong:
        raise CalibrationError(f"hold_std names {wrong[0]}, which is not held; hold it as well")
    held_std = np.array([hold_std.get(name, 0.0) for name in POSE])
    if not (np.isfinite(held_std) & (held_std >= 0)).all():
        raise CalibrationError("a std of what is held is below zero; give 0 or more")
    return replace(
        problem,
        held=problem.held & (held_std == 0),
        std=np.where(held_std > 0, held_std, problem.std),
    )


def starting_poses(problem: Problem) -> list[Floats]:
    """Return poses to start from, best first."""
    xy = problem.interior.normalised(problem.uv)
    poses = []
    if problem.n_free == 6 or (len(xy) >= 4 and not problem.held[3:].all()):
        std = np.sqrt(np.diagonal(problem.covariance, axis1=1, axis2=2))
        found = closed_form_starts(problem.points, xy, problem.interior.scale / std)
        poses = [np.where(problem.held, problem.value, each.pose) for each in found]
    if problem.n_free < 6 or not poses:
        fixed = problem.held[:3], problem.value[:3]
        angles = problem.value[3:]
        place = place_of_rotation(problem.points, xy, angles, fixed)
        poses.append(np.concatenate([place, angles]))
    return poses[:_MOST_STARTS]


def solve(problem: Problem, starts: list[Floats], may_leave: Callable[[Bools], bool]) -> Solution:
    """Fit from all starts, and choose between the poses that they lead to.

    Where the targets cannot tell two poses apart, the one whose rotation is nearer to the
    camera's own is taken.
    """
    scale = min(float(spread_of(_distances2(problem, start))) for start in starts)
    robust = [fit_robustly(problem, start, scale) for start in starts]
    fit, used = without_outliers(problem, min(robust, key=lambda r: r[1])[0], may_leave)
    others = [pose for pose, _ in robust]
    if problem.n_free == 6 and thickness(problem.points[used])[1] < _FLATTISH:
        others.append(mirrored(problem.points[used], fit.pose))
    rival = _rival(problem, fit, used, others)
    if rival is None:
        return Solution(fit, used, None)
    above = (rival.chi_square - fit.chi_square) / fit.excess
    nearer = _angle(rival.pose, problem.value) < _angle(fit.pose, problem.value)
    is_ambiguous = abs(above) < _AS_GOOD
    if nearer if is_ambiguous else above < 0:
        better, rival, above = rival.pose, fit, -above
        fit, used = without_outliers(problem, better, may_leave)
    omega, phi, kappa = np.degrees(rival.pose[3:]).tolist()
    mirror = MirrorPose(
        rotation_deg=(omega, phi, kappa), chi_square_above=above, ambiguous=is_ambiguous
    )
    return Solution(fit, used, mirror)


def _rival(problem: Problem, fit: PoseFit, used: Bools, poses: list[Floats]) -> PoseFit | None:
    """Return the best fit of the same targets that is another pose, if it is anywhere near."""
    found = []
    for pose in poses:
        if _angle(pose, fit.pose) <= _OTHER_POSE:
            continue
        other = fit_used(problem, pose, used, noise=fit.noise)
        depth = problem.interior.project(problem.points, other.pose).depth
        if _angle(other.pose, fit.pose) > _OTHER_POSE and (depth > 0).all():
            found.append(other)
    best = min(found, key=lambda each: each.chi_square, default=None)
    limit = fit.chi_square + _HOPELESS * fit.excess
    return best if best is not None and best.chi_square < limit else None


def widening(problem: Problem, fit: PoseFit, used: Bools, *, excess: float) -> float:
    """Return by what the covariance is too small because chi-square is no parabola.

    Seen squarely, a plane shows a small tilt by perspective alone, and both senses of it nearly
    alike: chi-square then grows more slowly on one side than its curvature says. Each angle is
    moved to either side, the rest of the pose fitted anew, until chi-square has grown by 4 times
    its excess: where it was to have grown so at 2 standard deviations, these are too small by the
    ratio. Angles that are known well are not looked at.
    """
    std = np.sqrt(np.diagonal(fit.inverse) * excess)
    reaches = [
        _reach(problem, fit, used, angle, side * np.sqrt(excess))
        for angle in range(3, 6)
        if std[angle] >= _PLAINLY_LINEAR
        for side in (1.0, -1.0)
    ]
    return max(reaches, default=1.0) ** 2


def _reach(problem: Problem, fit: PoseFit, used: Bools, angle: int, scale: float) -> float:
    """Return how far chi-square takes to grow as at 2 standard deviations, over these; 1 to 4.

    It is looked at from far to near, since it may fall again towards the other pose of a plane.

    Parameters
    ----------
    problem : Problem
        What was solved.
    fit : PoseFit
        The pose.
    used : ndarray of bool [target]
        Targets of the fit.
    angle : int
        Which parameter to move.
    scale : float
        Standard deviations over what the stated noise gives; its sign is the side.
    """
    is_moved = np.arange(6) == angle
    along = scale * fit.inverse[:, angle] / np.sqrt(fit.inverse[angle, angle])
    beyond = np.nan, np.nan
    for reach in _REACHES:
        aside = fit.pose + _STDS * reach * along
        held = replace(
            problem,
            held=problem.held | is_moved,
            value=np.where(is_moved, aside, problem.value),
        )
        growth = fit_used(held, aside, used, noise=fit.noise).chi_square - fit.chi_square
        grown = np.sqrt(max(growth, 0.0)) / (_STDS * abs(scale))
        if grown < 1:
            between = (1 - grown) / (beyond[1] - grown)
            return reach + (beyond[0] - reach) * between if between >= 0 else reach
        beyond = reach, grown
    return 1.0


def sensitivity_to_interior(problem: Problem, fit: PoseFit, used: Bools) -> Floats:
    """Return d pose / d interior [6, 10], the pose being fitted anew for each change."""
    whiten = problem.whitening(problem.interior.project(problem.points, fit.pose), fit.noise)
    by_interior = whiten @ problem.interior.derivatives(problem.points, fit.pose)
    normal = np.einsum("nij,nik->jk", fit.jacobian[used], by_interior[used])
    return np.asarray(fit.inverse @ normal, np.float64)


def spread_of_held(fit: PoseFit, used: Bools, *, hard: Problem, loose: Problem) -> Floats:
    """Return what the uncertainty of what was held adds to the pose's covariance [6, 6].

    Parameters
    ----------
    fit : PoseFit
        Of the problem in which it is held.
    used : ndarray of bool [target]
        Targets of the fit.
    hard, loose : Problem
        With all held, and with the uncertain of it as measured.
    """
    variance = np.where(hard.held & ~loose.held, loose.std, 0.0) ** 2
    normal = np.einsum("nij,nik->jk", fit.jacobian[used], fit.jacobian[used])
    moved = np.diag(hard.held.astype(np.float64)) - fit.inverse @ normal * hard.held
    return np.asarray((moved * variance) @ moved.T, np.float64)


def target_rows(
    problem: Problem, fit: PoseFit, used: Bools, ids: tuple[str, ...]
) -> tuple[ResectedTarget, ...]:
    """Return residuals, and why targets were left out."""
    seen = problem.interior.project(problem.points, fit.pose)
    residual = problem.uv - seen.uv
    std = problem.image_std(seen, fit.noise)
    off = np.linalg.norm(fit.residual, axis=1)
    return tuple(
        ResectedTarget(
            id=name,
            u=float(problem.uv[i, 0]),
            v=float(problem.uv[i, 1]),
            std_u=float(std[i, 0]),
            std_v=float(std[i, 1]),
            residual_u=float(residual[i, 0]),
            residual_v=float(residual[i, 1]),
            used=bool(used[i]),
            reason=""
            if used[i]
            else f"{np.hypot(*residual[i]):.3g} pixels off, {off[i]:.0f} standard deviations",
        )
        for i, name in enumerate(ids)
    )


def _angle(first: Floats, second: Floats) -> float:
    return angle_between(rotation_matrix(*first[3:]), rotation_matrix(*second[3:]))


def _distances2(problem: Problem, pose: Floats) -> Floats:
    return np.asarray(np.sum(problem.white(pose, 1.0)[0] ** 2, axis=1), np.float64)
