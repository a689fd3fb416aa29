"""Least squares of a pose: weighted, robust, and with doubtful targets tested one by one."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from calibration.resection._pose_start import spread_of
from calibration.resection._projection import Interior, Projection
from glint_aoa.errors import CalibrationError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

POSE = ("X", "Y", "Z", "omega", "phi", "kappa")
"""Names of the parameters of a pose, in order."""

_SINGULAR = 1e-9
_SHARE = 0.3  # of the largest part in what is not determined
_SIGNIFICANCE = 0.01
_DOUBT = 0.1  # level from which on the stated noise is not what an outlier is judged by
_CUT = 3.5  # standard deviations at which a target is first left out, to be tested later
_ROUNDS = 20
_SETTLED = 1e-3  # relative change of the estimated noise
_LEAST_NOISE = 1e-12  # of its nominal variance: measurements without noise


@dataclass(frozen=True, eq=False)
class Problem:
    """Targets, measurements and what is held of a pose.

    Attributes
    ----------
    interior : Interior
        Interior orientation.
    points, point_variance : ndarray [target, 3]
        X, Y, Z of the targets [m] and their variances [m^2].
    uv : ndarray [target, 2]
        Measured column and line [pixels].
    covariance : ndarray [target, 2, 2]
        Of the measurements [pixels^2]; nominal where `noise_known` is False.
    noise_known : bool
        Whether the covariance is stated; if not, its size is estimated from the residuals.
    held : ndarray of bool [6]
        Which of X, Y, Z, omega, phi, kappa are not estimated.
    value : ndarray [6]
        What is known of them beforehand [m, rad].
    std : ndarray [6]
        How well: 1 sigma of a parameter that is measured otherwise as well [m, rad], infinite
        where nothing counts but the targets.
    """

    interior: Interior
    points: Floats
    point_variance: Floats
    uv: Floats
    covariance: Floats
    noise_known: bool
    held: Bools
    value: Floats
    std: Floats

    @property
    def also_measured(self) -> Bools:
        """Which parameters have a value that takes part in the fit, as [6]."""
        return np.asarray(~self.held & np.isfinite(self.std), np.bool_)

    @property
    def is_free_of_scale(self) -> bool:
        """Whether the pose is the same whatever the size of the measurements' noise."""
        return not (self.also_measured.any() or self.point_variance.any())

    @property
    def n_free(self) -> int:
        """Number of parameters that are estimated."""
        return int(np.sum(~self.held))

    def whitening(self, seen: Projection, noise: float) -> Floats:
        """Return what turns residuals into independent ones of unit variance, [target, 2, 2]."""
        root = np.linalg.cholesky(self._image_covariance(seen, noise))
        return np.asarray(np.linalg.inv(root), np.float64)

    def image_std(self, seen: Projection, noise: float) -> Floats:
        """Return the uncertainty of u and v [target, 2], that of the target's place included."""
        variance = np.diagonal(self._image_covariance(seen, noise), axis1=1, axis2=2)
        return np.asarray(np.sqrt(variance), np.float64)

    def _image_covariance(self, seen: Projection, noise: float) -> Floats:
        by_point = seen.by_point
        of_places = np.einsum("nij,nj,nkj->nik", by_point, self.point_variance, by_point)
        return np.asarray(noise * self.covariance + of_places, np.float64)

    def white(self, pose: Floats, noise: float) -> tuple[Floats, Floats]:
        """Return residuals [target, 2] in standard deviations and their Jacobian by the pose."""
        seen = self.interior.project(self.points, pose)
        whiten = self.whitening(seen, noise)
        residual = np.einsum("nij,nj->ni", whiten, self.uv - seen.uv)
        return residual, -whiten @ seen.by_pose


class PoseFit(NamedTuple):
    """A weighted least-squares pose.

    Attributes
    ----------
    pose : ndarray [6]
        X, Y, Z [m], omega, phi, kappa [rad].
    chi_square : float
        Sum of squared residuals in units of their variance; the degrees of freedom where the
        noise is estimated.
    degrees_of_freedom : int
        Equations less unknowns.
    noise : float
        Variance of the measurements over the stated or nominal one; 1 where it is known.
    residual : ndarray [target, 2]
        In standard deviations, of all targets.
    jacobian : ndarray [target, 2, 6]
        Of these residuals by the pose.
    inverse : ndarray [6, 6]
        Covariance of the pose if the stated noise is right; zero for what is held.
    """

    pose: Floats
    chi_square: float
    degrees_of_freedom: int
    noise: float
    residual: Floats
    jacobian: Floats
    inverse: Floats

    @property
    def excess(self) -> float:
        """Chi-square over its expectation where a test at 1 % finds it too large, else 1."""
        freedom = self.degrees_of_freedom
        if freedom < 1 or stats.chi2.sf(self.chi_square, freedom) >= _SIGNIFICANCE:
            return 1.0
        return self.chi_square / freedom


def fit_robustly(problem: Problem, start: Floats, spread: float) -> tuple[Floats, float]:
    """Fit with Cauchy's loss, which lets distant targets pull less and less.

    Parameters
    ----------
    problem : Problem
        What to fit.
    start : ndarray [6]
        Where to start.
    spread : float
        Robust standard deviation of the residuals, in units of the stated one.

    Returns
    -------
    pose : ndarray [6]
        The pose.
    cost : float
        By which fits from several starts can be ranked.
    """
    scale = max(spread, 1.0 if problem.noise_known else _LEAST_NOISE)
    pose = _least_squares(problem, start, np.ones(len(problem.uv), bool), 1.0, loss_scale=scale)
    distance2 = np.sum(problem.white(pose, 1.0)[0] ** 2, axis=1)
    return pose, float(np.sum(np.log1p(distance2 / scale**2)))


def fit_used(
    problem: Problem, start: Floats, used: Bools, *, noise: float | None = None
) -> PoseFit:
    """Fit the targets that are used.

    The noise is estimated from them where it is neither stated by the problem nor given.
    """
    pose, estimated = start, not problem.noise_known and noise is None
    noise = 1.0 if noise is None else noise
    freedom = 2 * int(used.sum()) + int(problem.also_measured.sum()) - problem.n_free
    for _ in range(_ROUNDS):
        pose = _least_squares(problem, pose, used, noise)
        residual, jacobian = problem.white(pose, noise)
        chi_square = _chi_square(problem, pose, residual[used])
        if not estimated or not freedom:
            break
        change = chi_square / freedom
        noise = max(noise * change, _LEAST_NOISE)
        residual, jacobian = problem.white(pose, noise)
        chi_square = _chi_square(problem, pose, residual[used])
        if abs(change - 1) < _SETTLED or noise == _LEAST_NOISE or problem.is_free_of_scale:
            break
    inverse = _inverse(problem, jacobian[used])
    return PoseFit(pose, chi_square, freedom, noise, residual, jacobian, inverse)


def without_outliers(
    problem: Problem, start: Floats, may_leave: Callable[[Bools], bool]
) -> tuple[PoseFit, Bools]:
    """Leave out targets that the others contradict, and fit the rest.

    The robust fit proposes; the studentised residual of each target decides, at a level of 1 %
    for all of them together (R. D. Cook, S. Weisberg, *Residuals and Influence in Regression*,
    1982). A target that was proposed and passes comes back.

    Parameters
    ----------
    problem : Problem
        What to fit.
    start : ndarray [6]
        A robust pose.
    may_leave : callable
        Whether the targets of a mask suffice for a pose.

    Returns
    -------
    PoseFit
        Of the targets that are used.
    ndarray of bool [target]
        Which these are.
    """
    distance2 = np.sum(problem.white(start, 1.0)[0] ** 2, axis=1)
    spread = float(spread_of(distance2))
    used = distance2 <= (_CUT * (max(spread, 1.0) if problem.noise_known else spread)) ** 2
    if not may_leave(used):
        used = np.ones_like(used)
    level = _SIGNIFICANCE / used.size
    tried: set[bytes] = set()
    fit = fit_used(problem, start, used)
    while used.tobytes() not in tried:
        tried.add(used.tobytes())
        chance = _chances(problem, fit, used)
        changed = used.copy()
        if (~used & (chance >= level)).any():
            changed[np.argmax(np.where(used, -1.0, chance))] = True
        elif (used & (chance < level)).any():
            changed[np.argmin(np.where(used, chance, 2.0))] = False
        if (changed == used).all() or not may_leave(changed):
            break
        used, fit = changed, fit_used(problem, fit.pose, changed)
    return fit, used


def _chances(problem: Problem, fit: PoseFit, used: Bools) -> Floats:
    """Return the probability of each target's residual, judged by the other targets."""
    spread = fit.jacobian @ fit.inverse @ fit.jacobian.transpose(0, 2, 1)
    own = np.eye(2) + np.where(used[:, None, None], -spread, spread)
    solved = np.linalg.solve(own, fit.residual[:, :, None])[:, :, 0]
    departure = np.sum(fit.residual * solved, axis=1)
    freedom = fit.degrees_of_freedom - 2 * used
    chi_square = fit.chi_square - np.where(used, departure, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        by_scatter = stats.f.sf(departure / 2 / (chi_square / freedom), 2, freedom)
    by_scatter = np.where((freedom < 1) | (chi_square <= 0), 1.0, by_scatter)
    if not problem.noise_known:
        return np.asarray(by_scatter, np.float64)
    doubtful = (freedom >= 1) & (stats.chi2.sf(chi_square, np.maximum(freedom, 1)) < _DOUBT)
    return np.where(doubtful, by_scatter, stats.chi2.sf(departure, 2))


def _chi_square(problem: Problem, pose: Floats, residual: Floats) -> float:
    return float(np.sum(residual**2) + np.sum(_own_residual(problem, pose) ** 2))


def _own_residual(problem: Problem, pose: Floats) -> Floats:
    """Return residuals of what is measured of the pose itself, in standard deviations."""
    which = problem.also_measured
    return np.asarray(((problem.value - pose) / problem.std)[which], np.float64)


def _own_jacobian(problem: Problem) -> Floats:
    return np.asarray(np.diag(-1 / problem.std)[problem.also_measured], np.float64)


def _inverse(problem: Problem, jacobian: Floats) -> Floats:
    rows = np.concatenate([jacobian.reshape(-1, 6), _own_jacobian(problem)])[:, ~problem.held]
    size = np.linalg.norm(rows, axis=0)
    _, strength, ways = np.linalg.svd(rows / size, full_matrices=False)
    if strength[-1] < _SINGULAR * strength[0]:
        weak = np.abs(ways[-1]) > _SHARE * np.abs(ways[-1]).max()
        names = [name for name, is_weak in zip(_names(problem), weak, strict=True) if is_weak]
        raise CalibrationError(
            f"the targets do not tell {' and '.join(names)} apart; add targets that are further "
            "apart, and at different distances from the camera"
        )
    root = ways.T / strength / size[:, None]
    covariance = np.zeros((6, 6))
    covariance[np.ix_(~problem.held, ~problem.held)] = root @ root.T
    return covariance


def _names(problem: Problem) -> list[str]:
    return [name for name, held in zip(POSE, problem.held, strict=True) if not held]


@dataclass
class _Cost:
    """Residuals and Jacobian for the solver, which asks for them one after the other."""

    problem: Problem
    used: Bools
    whiten: Floats
    _last: dict[bytes, Projection] = field(default_factory=dict)

    def whole(self, free: Floats) -> Floats:
        pose = self.problem.value.copy()
        pose[~self.problem.held] = free
        return pose

    def residuals(self, free: Floats) -> Floats:
        pose = self.whole(free)
        white = np.einsum("nij,nj->ni", self.whiten, self.problem.uv - self._seen(pose).uv)
        return np.concatenate([white[self.used].ravel(), _own_residual(self.problem, pose)])

    def jacobian(self, free: Floats) -> Floats:
        white = -self.whiten @ self._seen(self.whole(free)).by_pose
        rows = np.concatenate([white[self.used].reshape(-1, 6), _own_jacobian(self.problem)])
        return rows[:, ~self.problem.held]

    def _seen(self, pose: Floats) -> Projection:
        key = pose.tobytes()
        if key not in self._last:
            self._last = {key: self.problem.interior.project(self.problem.points, pose)}
        return self._last[key]


def _least_squares(
    problem: Problem, start: Floats, used: Bools, noise: float, *, loss_scale: float | None = None
) -> Floats:
    """Minimise; weights that depend on the pose are brought up to date once more at the end."""
    pose = np.where(problem.held, problem.value, start)
    rounds = 2 if problem.point_variance.any() else 1
    how: dict[str, Any] = {"method": "lm", "xtol": 1e-12, "ftol": 1e-13, "gtol": 1e-13}
    if loss_scale is not None:
        how = {"loss": "cauchy", "f_scale": loss_scale}
    for _ in range(rounds):
        seen = problem.interior.project(problem.points, pose)
        cost = _Cost(problem, used, problem.whitening(seen, noise))
        solution = optimize.least_squares(
            cost.residuals,
            pose[~problem.held],
            jac=cost.jacobian,
            x_scale="jac",
            **how,
        )
        pose = cost.whole(solution.x)
    return pose
