"""The two-dimensional conformal transformation between two sets of the same points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from glint_aoa.coverage import coverage_factor
from glint_aoa.errors import CalibrationError

__all__ = ["Conformal", "fit_conformal"]

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STEPS = 20
_CONVERGED = 1e-12
_SIGNIFICANCE = 0.01
_LEAST_FOR_OUTLIER = 4  # with three points none can be said to be the wrong one
_SAME_PLACE = 1e-6  # of a metre: nothing that is glued to a wing is nearer


@dataclass(frozen=True, eq=False)
class Conformal:
    r"""A fitted transformation.

    .. math:: q_i - \bar q = t + s R(\theta) (p_i - \bar p)

    with the bars marking the means of the points that were used.

    Attributes
    ----------
    rotation : float
        Angle from the first axis towards the second [rad].
    shift : ndarray, shape (2,)
        Displacement of the middle of the points that were used [m].
    scale : float
        Scale s; exactly 1 where it was held.
    covariance : ndarray, shape (3, 3) or (4, 4)
        Of rotation [rad], shift [m] and, where it was free, scale; the excess is in it.
    residuals : ndarray, shape (point, 2)
        Measured less transformed end points [m], of all points.
    used : ndarray of bool, shape (point,)
        Which points the fit rests on.
    chi_square : float
        Of the points that were used.
    degrees_of_freedom : int
        Twice their number less the number of parameters.
    excess : float
        What the covariance was multiplied by: the reduced chi-square where a test at 1 % says
        that the stated noise does not explain the residuals, 1 otherwise.
    """

    rotation: float
    shift: Floats
    scale: float
    covariance: Floats
    residuals: Floats
    used: Mask
    chi_square: float
    degrees_of_freedom: int
    excess: float

    @property
    def rotation_std(self) -> float:
        """Standard deviation of the rotation, 1 sigma [rad]."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def rotation_u95(self) -> float:
        """Half the 95 % interval of the rotation [rad]; Student's t where noise was scaled."""
        freedom = self.degrees_of_freedom if self.excess > 1 else np.inf
        return coverage_factor(freedom) * self.rotation_std

    @property
    def rms(self) -> float:
        """Root mean square distance of the used points from where they are expected [m]."""
        return float(np.sqrt(np.mean((self.residuals[self.used] ** 2).sum(axis=1))))


def fit_conformal(
    start: Floats,
    end: Floats,
    start_covariance: Floats,
    end_covariance: Floats,
    *,
    free_scale: bool = False,
) -> Conformal:
    r"""Fit rotation and translation, and optionally scale, between two sets of points.

    Weighted least squares with errors in both sets: the residual of a point has the covariance
    :math:`C_q + s^2 R C_p R^T`. Points that do not move as the others are left out.

    Parameters
    ----------
    start, end : ndarray, shape (point, 2)
        The points before and after [m].
    start_covariance, end_covariance : ndarray, shape (point, 2, 2)
        Their covariances [m^2].
    free_scale : bool, optional
        Whether to fit the scale too; a body that does not change its size has 1.

    Returns
    -------
    Conformal
        The transformation.

    Raises
    ------
    CalibrationError
        If there are fewer than two points, or they all lie in one place.

    Notes
    -----
    The transformation is that of P. R. Wolf and B. A. Dewitt, *Elements of Photogrammetry*
    (appendix on coordinate transformations), used for wing twist by A. W. Burner (J. Aircraft
    38(4), 2001, doi:10.2514/2.2826). A point is an outlier if, held against the fit without it,
    it is further off than the largest of so many by chance at 1 % (Bonferroni), from Fisher's F
    where the scatter of the others exceeds what their noise explains. Four points at least are
    needed for that; with two or three, a point that slipped shows in the excess at best. A wing
    that bends along its chord between the points is not rotated as one piece: it shows in the
    excess, and the rotation is a mean over the chord.
    """
    _check(start, end)
    points = _Points(start, end, start_covariance, end_covariance)
    used = np.ones(len(start), bool)
    fit = _fit(points, used, free_scale)
    while used.sum() >= _LEAST_FOR_OUTLIER and fit.chi_square > _limit(int(used.sum())):
        fits = {}
        for number in np.flatnonzero(used):
            without = used.copy()
            without[number] = False
            fits[number] = without, _fit(points, without, free_scale)
        ratios = {
            number: _ratio(points, each, number, len(fits)) for number, (_, each) in fits.items()
        }
        worst = max(ratios, key=ratios.__getitem__)
        if ratios[worst] <= 1:
            break
        used, fit = fits[worst]
    return _with_excess(fit, used)


@dataclass(frozen=True)
class _Points:
    start: Floats
    end: Floats
    start_covariance: Floats
    end_covariance: Floats

    def weights(self, turn: Floats, which: Mask | np.intp) -> Floats:
        """Inverse covariances of the residuals under s R."""
        noise = self.end_covariance[which] + turn @ self.start_covariance[which] @ turn.T
        return np.asarray(np.linalg.inv(noise), np.float64)


@dataclass(frozen=True)
class _Fit:
    parameters: Floats  # rotation, shift of the middle, scale
    covariance: Floats
    middles: tuple[Floats, Floats]
    residuals: Floats
    chi_square: float
    freedom: int

    @property
    def turn(self) -> Floats:
        """Scale times rotation."""
        return _turn(self.parameters)


def _turn(parameters: Floats) -> Floats:
    cos, sin = np.cos(parameters[0]), np.sin(parameters[0])
    return np.asarray(parameters[3] * np.array([[cos, -sin], [sin, cos]]), np.float64)


_QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])


def _check(start: Floats, end: Floats) -> None:
    if len(start) < 2:
        raise CalibrationError(
            f"a rotation needs two points or more, got {len(start)}; measure more targets"
        )
    for places in (start, end):
        if np.linalg.norm(places - places.mean(axis=0), axis=1).max() < _SAME_PLACE:
            raise CalibrationError(
                "all points lie in one place, which has no direction; measure targets that are "
                "apart"
            )


def _fit(points: _Points, used: Mask, free_scale: bool) -> _Fit:
    start, end = points.start[used], points.end[used]
    middles = start.mean(axis=0), end.mean(axis=0)
    before, after = start - middles[0], end - middles[1]
    # The closed form for equal weights: complex numbers turn about their mean.
    turned = np.vdot(before @ [1, 1j], after @ [1, 1j])
    size = abs(turned) / (before**2).sum() if free_scale else 1.0
    parameters = np.array([np.angle(turned), 0.0, 0.0, size])
    count = 4 if free_scale else 3
    for _ in range(_STEPS):
        turn = _turn(parameters)
        moved = before @ turn.T
        left = after - moved - parameters[1:3]
        slope = np.stack(
            [moved @ _QUARTER.T, *np.broadcast_to(np.eye(2)[:, None], (2, *moved.shape)), moved]
        )
        slope[3] /= parameters[3]
        weights = points.weights(turn, used)
        normal = np.einsum("aij,ijk,bik->ab", slope[:count], weights, slope[:count])
        covariance = np.linalg.inv(normal)
        step = covariance @ np.einsum("aij,ijk,ik->a", slope[:count], weights, left)
        parameters[:count] += step
        if (np.abs(step) <= _CONVERGED).all():
            break
    turn = _turn(parameters)
    expected = (points.start - middles[0]) @ turn.T + parameters[1:3] + middles[1]
    residuals = points.end - expected
    weights = points.weights(turn, used)
    chi_square = float(np.einsum("ij,ijk,ik->", residuals[used], weights, residuals[used]))
    return _Fit(parameters, covariance, middles, residuals, chi_square, 2 * len(start) - count)


def _limit(count: int) -> float:
    """Squared distance that the largest of so many points exceeds by chance at 1 %."""
    return float(stats.chi2.isf(_SIGNIFICANCE / count, 2))


def _ratio(points: _Points, without: _Fit, number: np.intp, count: int) -> float:
    """How far off a point lies of the fit without it, over what chance allows."""
    off, turn = without.residuals[number], without.turn
    arm = (points.start[number] - without.middles[0]) @ turn.T
    slope = np.stack([_QUARTER @ arm, *np.eye(2), arm / without.parameters[3]])
    slope = slope[: len(without.covariance)]
    noise = np.linalg.inv(points.weights(turn, number)) + slope.T @ without.covariance @ slope
    distance = float(off @ np.linalg.solve(noise, off))
    limit, scatter = _limit(count), without.chi_square / without.freedom
    if scatter > 1:
        by_scatter = 2 * float(stats.f.isf(_SIGNIFICANCE / count, 2, without.freedom))
        limit = max(limit, scatter * by_scatter)
    return distance / limit


def _with_excess(fit: _Fit, used: Mask) -> Conformal:
    excess = 1.0
    if fit.freedom and stats.chi2.sf(fit.chi_square, fit.freedom) < _SIGNIFICANCE:
        excess = fit.chi_square / fit.freedom
    return Conformal(
        rotation=float(fit.parameters[0]),
        shift=fit.middles[1] - fit.middles[0] + fit.parameters[1:3],
        scale=float(fit.parameters[3]),
        covariance=excess * fit.covariance,
        residuals=fit.residuals,
        used=used,
        chi_square=fit.chi_square,
        degrees_of_freedom=fit.freedom,
        excess=excess,
    )
