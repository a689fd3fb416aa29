"""Camera, boards' poses and the board's own shape adjusted together: least squares over corners.

The corners' places on the board are observations too, as good as the board is known. The board is
the same in all images, so what it is not tells itself from what the camera does (K. H. Strobl and
G. Hirzinger, "More accurate pinhole camera calibration with imperfect planar target", ICCV
Workshops 2011, doi:10.1109/ICCVW.2011.6130369).
"""

import contextlib
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

N_INTERIOR = 9
FOCAL, ASPECT = 0, 1
PRINCIPAL = [2, 3]
DISTORTION = [4, 5, 6, 7, 8]

_MOST_STEPS = 100
_SMALL_STEP = 1e-4  # in standard deviations: no result will be told to more
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-12, 1e8
_ROUNDING = 1e-12


class Observation(NamedTuple):
    """Corners of one image.

    Attributes
    ----------
    corner : ndarray of int [corner]
        Which of the board's corners they are.
    uv : ndarray [corner, 2]
        Where they are seen: sensor column, and line of an even field [pixels].
    """

    corner: NDArray[np.int64]
    uv: Floats


@dataclass(frozen=True, eq=False)
class Interior:
    """What a camera has whatever it looks at.

    Attributes
    ----------
    values : ndarray [9]
        Principal distance [columns], ratio of vertical to horizontal pixel pitch, principal
        point u, v [pixels], k1, k2, p1, p2, k3.
    """

    values: Floats

    @property
    def matrix(self) -> Floats:
        """OpenCV's camera matrix."""
        focal, aspect, u, v = self.values[:4]
        return np.array([[focal, 0.0, u], [0.0, focal / aspect, v], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Floats:
        """k1, k2, p1, p2, k3."""
        return self.values[4:]


class State(NamedTuple):
    """What is adjusted.

    Attributes
    ----------
    interior : Interior
        The camera.
    poses : ndarray [image, 6]
        Rotation vector [rad] and translation [m] from the board to the camera (x right, y down).
    places : ndarray [corner, 3]
        The board's corners [m].
    """

    interior: Interior
    poses: Floats
    places: Floats


@dataclass(frozen=True, eq=False)
class Problem:
    """What is given, and what may be adjusted.

    Attributes
    ----------
    observations : tuple of Observation
        One for each image.
    places : ndarray [corner, 3]
        The board's corners as stated [m].
    place_std : float
        How well these are known, 1 sigma in each direction [m]; 0 holds them.
    radius : float
        Of the circles whose images' centres are observed [m]; 0 for corners.
    free : ndarray of bool [9]
        Which parameters of the interior are adjusted.
    noise : ndarray [2]
        Noise of u and v, 1 sigma [pixels].
    """

    observations: tuple[Observation, ...]
    places: Floats
    place_std: float
    radius: float
    free: Mask
    noise: Floats

    @property
    def n_free(self) -> int:
        """Number of the interior's parameters that are adjusted."""
        return int(self.free.sum())

    @property
    def n_shared(self) -> int:
        """Number of unknowns that all images share; those of the poses come after them."""
        return self.n_free + (self.places.size if self.place_std > 0 else 0)

    @cached_property
    def ends(self) -> NDArray[np.int64]:
        """First row of each image and one beyond the last, two rows a corner."""
        return np.concatenate([[0], 2 * np.cumsum([len(one.corner) for one in self.observations])])

    @cached_property
    def weight(self) -> Floats:
        """One over the variance of each row."""
        return np.tile(1 / self.noise**2, self.ends[-1] // 2)

    @cached_property
    def columns(self) -> NDArray[np.int64]:
        """Unknown that each entry of a row belongs to, [row, entry]."""
        corner = np.concatenate([one.corner for one in self.observations]).repeat(2)
        image = np.repeat(np.arange(len(self.observations)), np.diff(self.ends))
        parts = [np.broadcast_to(np.arange(self.n_free), (corner.size, self.n_free))]
        if self.place_std > 0:
            parts.append(self.n_free + 3 * corner[:, None] + np.arange(3))
        parts.append(self.n_shared + 6 * image[:, None] + np.arange(6))
        return np.concatenate(parts, axis=1)


class Adjusted(NamedTuple):
    """The least squares' result.

    Attributes
    ----------
    state : State
        Camera, poses and board.
    residuals : tuple of ndarray [corner, 2]
        Observed less computed [pixels], for each image.
    freedom : tuple of ndarray [corner, 2]
        One less the leverage of each: what it adds to the degrees of freedom.
    cost : float
        Sum of their squares and of the board's corrections, in units of their uncertainties.
    covariance : ndarray [9, 9]
        Covariance of the interior; zero where it was held.
    shape_std : float
        Uncertainty of the board's shape, 1 sigma, rms over its corners [m]; its place, attitude
        and size, which no picture tells, are not counted. 0 where it was held.
    converged : bool
        Whether the last step was small.
    """

    state: State
    residuals: tuple[Floats, ...]
    freedom: tuple[Floats, ...]
    cost: float
    covariance: Floats
    shape_std: float
    converged: bool


def project_board(
    places: Floats, interior: Interior, pose: Floats, *, radius: float = 0.0
) -> tuple[Floats, Floats]:
    r"""Project corners of a board, or the centres of the ellipses that its circles are seen as.

    Parameters
    ----------
    places : ndarray [corner, 3]
        Corners on the board [m].
    interior : Interior
        The camera.
    pose : ndarray [6]
        Rotation vector [rad] and translation [m] from board to camera (x right, y down).
    radius : float, optional
        Radius of the circles [m].

    Returns
    -------
    uv : ndarray [corner, 2]
        Sensor column and line [pixels].
    derivatives : ndarray [corner, 2, 15]
        By rotation vector, translation, fx, fy and the interior's other parameters.

    Notes
    -----
    The ellipse's centre is the image of the point :math:`c\,c_z - r^2 (\hat z - n\,n_z)`, with n
    the board's normal (see `calibration.targets.find.ellipse_correction`). How that small offset
    changes is left out of the derivatives, which the minimum does not notice.
    """
    seen, jacobian = cv2.projectPoints(
        places, pose[:3], pose[3:], interior.matrix, interior.distortion
    )
    uv = np.asarray(seen, np.float64).reshape(-1, 2)
    if radius:
        uv = uv + _ellipse_offset(places, uv, interior, pose, radius)
    return uv, np.asarray(jacobian, np.float64)[:, :15].reshape(-1, 2, 15)


def _ellipse_offset(
    places: Floats, uv: Floats, interior: Interior, pose: Floats, radius: float
) -> Floats:
    rotation = cv2.Rodrigues(pose[:3])[0]
    centre, normal = places @ rotation.T + pose[3:], rotation[:, 2]
    in_plane = np.array([0.0, 0.0, 1.0]) - normal * normal[2]
    ellipse = centre * centre[:, 2:] - radius**2 * in_plane
    nothing = np.zeros(3)
    seen, _ = cv2.projectPoints(ellipse, nothing, nothing, interior.matrix, interior.distortion)
    return np.asarray(seen, np.float64).reshape(-1, 2) - uv


def adjust(problem: Problem, start: State) -> Adjusted:
    """Adjust the camera, the poses and, as far as they are not exact, the board's corners.

    Levenberg and Marquardt's method on the normal equations.

    Returns
    -------
    Adjusted
        With `converged` False where 100 steps were not enough or none led further down.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the images do not determine the unknowns at all.
    """
    state, made = start, _linearised(problem, start)
    damping, converged = _FIRST_DAMPING, False
    for _ in range(_MOST_STEPS):
        step, size = made.step(damping)
        if size < _SMALL_STEP:
            converged = True
            break
        tried = _moved(problem, state, step)
        made_there = _linearised(problem, tried)
        if made_there.cost <= made.cost * (1 + _ROUNDING):
            state, made = tried, made_there
            damping = max(damping / 100, _LEAST_DAMPING)
        elif damping < _MOST_DAMPING:
            damping *= 10
        else:
            break
    return _finished(problem, state, made, converged)


class _Equations(NamedTuple):
    """The linearised problem."""

    rows: sparse.csr_array
    residual: Floats
    normal: Floats
    right: Floats
    cost: float

    def step(self, damping: float) -> tuple[Floats, float]:
        """Return the step of all unknowns, and its size in standard deviations."""
        damped = self.normal + np.diag(damping * np.diag(self.normal))
        scale = 1 / np.sqrt(np.diag(damped))
        factor = linalg.cho_factor(damped * np.outer(scale, scale), check_finite=False)
        solved = linalg.cho_solve(factor, scale * self.right, check_finite=False)
        step: Floats = scale * np.asarray(solved, np.float64)
        return step, max(float(np.dot(step, self.right)), 0.0) ** 0.5


def _linearised(problem: Problem, state: State) -> _Equations:
    seen, derivatives = [], []
    for one, pose in zip(problem.observations, state.poses, strict=True):
        uv, jacobian = project_board(
            state.places[one.corner], state.interior, pose, radius=problem.radius
        )
        parts = [jacobian]
        if problem.place_std > 0:
            parts.append(jacobian[..., 3:6] @ cv2.Rodrigues(pose[:3])[0])
        seen.append((one.uv - uv).ravel())
        derivatives.append(np.concatenate(parts, axis=-1))
    residual = np.concatenate(seen)
    entries = _entries(problem, state.interior, np.concatenate(derivatives))
    n_rows, n_entries = problem.columns.shape
    rows = sparse.csr_array(
        (entries.ravel(), problem.columns.ravel(), np.arange(n_rows + 1) * n_entries),
        shape=(n_rows, problem.n_shared + state.poses.size),
    )
    weighted = rows.multiply(problem.weight[:, None]).tocsr()
    normal = np.asarray((rows.T @ weighted).todense(), np.float64)
    right = np.asarray(weighted.T @ residual, np.float64)
    cost = float(problem.weight @ residual**2)
    stated, off = _statement(problem, state)
    shared = np.arange(problem.n_shared)
    normal[shared, shared] += stated
    right[shared] += stated * off
    cost += float(stated @ off**2)
    return _Equations(rows, residual, normal, right, cost if np.isfinite(cost) else np.inf)


def _entries(problem: Problem, interior: Interior, derivatives: Floats) -> Floats:
    """Order a row's derivatives as the unknowns are, with those by distance and aspect."""
    focal, aspect = interior.values[:2]
    rows = derivatives.reshape(-1, derivatives.shape[-1])
    by_interior = rows[:, 6:15].copy()
    by_fy = by_interior[:, 1] / aspect
    by_interior[:, FOCAL] += by_fy
    by_interior[:, ASPECT] = -by_fy * focal / aspect
    return np.concatenate([by_interior[:, problem.free], rows[:, 15:], rows[:, :6]], axis=1)


def _moved(problem: Problem, state: State, step: Floats) -> State:
    values, n_free, n_shared = state.interior.values.copy(), problem.n_free, problem.n_shared
    values[problem.free] += step[:n_free]
    places = state.places
    if problem.place_std > 0:
        places = places + step[n_free:n_shared].reshape(-1, 3)
    poses = state.poses + step[n_shared:].reshape(-1, 6)
    return State(Interior(values), poses, places)


def _finished(problem: Problem, state: State, made: _Equations, converged: bool) -> Adjusted:
    inverse = inverted(made.normal)
    leverage = np.concatenate(
        [_leverage(problem, made, inverse, image) for image in range(len(state.poses))]
    )
    covariance = np.zeros((N_INTERIOR, N_INTERIOR))
    covariance[np.ix_(problem.free, problem.free)] = inverse[: problem.n_free, : problem.n_free]
    shape = slice(problem.n_free, problem.n_shared)
    return Adjusted(
        state,
        _by_image(problem, made.residual),
        _by_image(problem, 1 - leverage),
        made.cost,
        covariance,
        _shape_std(inverse[shape, shape], state.places) if problem.place_std > 0 else 0.0,
        converged,
    )


def _shape_std(covariance: Floats, places: Floats) -> float:
    """Rms over the corners of their uncertainty, common motion and scale taken out [m]."""
    off = places - places.mean(axis=0)
    unit = np.eye(3)
    motions = [np.broadcast_to(each, places.shape) for each in unit]
    motions += [np.cross(each, off) for each in unit] + [off]
    basis = np.linalg.qr(np.stack([each.ravel() for each in motions], axis=1))[0]
    rest = np.trace(covariance) - np.trace(basis.T @ covariance @ basis)
    return float(np.sqrt(max(rest, 0.0) / len(places)))


def _leverage(problem: Problem, made: _Equations, inverse: Floats, image: int) -> Floats:
    span = slice(problem.ends[image], problem.ends[image + 1])
    rows = made.rows[span].toarray()
    leverage: Floats = problem.weight[span] * np.sum((rows @ inverse) * rows, axis=1)
    return leverage


def _by_image(problem: Problem, values: Floats) -> tuple[Floats, ...]:
    return tuple(part.reshape(-1, 2) for part in np.split(values, problem.ends[1:-1]))


def inverted(normal: Floats) -> Floats:
    """Invert a normal matrix whose unknowns differ in scale by many powers of ten.

    Raises
    ------
    numpy.linalg.LinAlgError
        If it is not positive definite.
    """
    diagonal = np.diag(normal)
    if not (np.isfinite(normal).all() and (diagonal > 0).all()):
        raise np.linalg.LinAlgError("the normal matrix is not positive definite")
    scale = 1 / np.sqrt(diagonal)
    factor = linalg.cho_factor(normal * np.outer(scale, scale))
    inverse: Floats = linalg.cho_solve(factor, np.eye(len(normal)))
    return inverse * np.outer(scale, scale)


def resampled(problem: Problem, state: State, counts: Floats) -> Floats:
    """Return the interior that other numbers of each image would have given, to first order.

    Parameters
    ----------
    problem : Problem
        The problem.
    state : State
        Its solution.
    counts : ndarray [draw, image]
        How often each image is counted in each draw.

    Returns
    -------
    ndarray [draw, free]
        Differences of the free parameters from the solution's; NaN where a draw does not
        determine them.
    """
    images = image_parts(problem, state)
    stated, off = _statement(problem, state)
    drawn = np.full((len(counts), problem.n_free), np.nan)
    for number, count in enumerate(counts):
        normal, right = np.diag(stated), stated * off
        for often, (part, part_right) in zip(count, images, strict=True):
            if often:
                normal, right = normal + often * part, right + often * part_right
        with contextlib.suppress(np.linalg.LinAlgError):
            drawn[number] = (inverted(normal) @ right)[: problem.n_free]
    return drawn


def image_parts(problem: Problem, state: State) -> list[tuple[Floats, Floats]]:
    """Return what each image adds to the shared unknowns' normal matrix and right-hand side.

    Each image's own pose is eliminated (Schur complement).
    """
    made = _linearised(problem, state)
    return [_reduced(problem, made, number) for number in range(len(state.poses))]


def _reduced(problem: Problem, made: _Equations, image: int) -> tuple[Floats, Floats]:
    n = problem.n_shared
    span = slice(problem.ends[image], problem.ends[image + 1])
    rows, weight = made.rows[span].toarray(), problem.weight[span, None]
    shared, pose = rows[:, :n], rows[:, n + 6 * image : n + 6 * image + 6]
    along = np.linalg.solve((weight * pose).T @ pose, (weight * pose).T @ shared)
    left = weight * (shared - pose @ along)
    return left.T @ shared, left.T @ made.residual[span]


def _statement(problem: Problem, state: State) -> tuple[Floats, Floats]:
    """Return what is stated of the shared unknowns: weights, and stated less present values."""
    weight, off = np.zeros(problem.n_shared), np.zeros(problem.n_shared)
    if problem.place_std > 0:
        weight[problem.n_free :] = 1 / problem.place_std**2
        off[problem.n_free :] = (problem.places - state.places).ravel()
    return weight, off
