"""Lens models of several orders, and one camera from them all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.camera import _checks as checks
from calibration.camera._bundle import Interior, resampled
from calibration.camera._fit import ORDERS, Fit, with_order
from glint_aoa.errors import CalibrationError

Floats = NDArray[np.float64]

_COMPARED = 2  # models
_LEAST_WEIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class LensModels:
    """Fits with different numbers of distortion coefficients, and how far each is believed.

    Attributes
    ----------
    fits : tuple of Fit
        The fits; one alone where the number was given.
    weights : ndarray [fit]
        Their weights, of sum one.
    criterion : mapping of int to float
        Akaike's criterion of each number that was compared, relative to the least; empty where
        the number was given.
    """

    fits: tuple[Fit, ...]
    weights: Floats
    criterion: Mapping[int, float]

    @property
    def best(self) -> Fit:
        """The fit of greatest weight."""
        return self.fits[int(np.argmax(self.weights))]

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters any of them estimates."""
        return np.asarray(np.any([fit.problem.free for fit in self.fits], axis=0), np.bool_)

    @property
    def interior(self) -> Interior:
        """Mean camera; a coefficient that a model leaves out is zero there."""
        return Interior(self.weights @ self._values)

    @property
    def covariance(self) -> Floats:
        """Its covariance, with the doubt about the number of coefficients."""
        return self._joined([fit.adjusted.covariance for fit in self.fits])

    def bootstrap_covariance(self, counts: Floats) -> Floats:
        """Return the same from resampled images.

        Parameters
        ----------
        counts : ndarray [draw, image]
            How often each image is counted in each draw.
        """
        every = []
        for fit in self.fits:
            drawn = resampled(fit.problem, fit.adjusted.state, counts)
            drawn = drawn[np.isfinite(drawn).all(axis=1)]
            covariance, free = np.zeros((self.free.size, self.free.size)), fit.problem.free
            covariance[np.ix_(free, free)] = np.cov(drawn.T)
            every.append(covariance)
        return self._joined(every)

    @property
    def _values(self) -> Floats:
        return np.array([fit.adjusted.state.interior.values for fit in self.fits])

    def _joined(self, covariances: Sequence[Floats]) -> Floats:
        """Mean covariance, and the covariance of the means."""
        off = self._values - self.weights @ self._values
        mean = np.einsum("m,mij->ij", self.weights, np.array(covariances))
        joined: Floats = mean + np.einsum("m,mi,mj->ij", self.weights, off, off)
        return joined


def lens_models(
    fit: Fit, order: int | None, hold: Sequence[str], sensor: tuple[int, int]
) -> LensModels:
    """Fit with the number of distortion coefficients asked for, or with the two richest models.

    To choose a number by a criterion and to state the uncertainty as if it had been known before
    is wrong: with 0 to 5 coefficients to choose from, 95 % intervals held the truth in 75 to 90 %
    of trials, those of the principal point above all, whose uncertainty is four times smaller
    where p1 and p2 are taken to be zero. So the richest lens model that the images determine, as
    a rule all five coefficients, is averaged with the next poorer one, which lacks k3, by Akaike's
    weights exp(-AIC / 2): AIC is chi-square plus twice the number of parameters, for the noise
    that the richest model leaves (K. P. Burnham and D. R. Anderson, *Model Selection and
    Multimodel Inference*, 2002, section 4.3). Models that fold over on the sensor do not count.

    Raises
    ------
    CalibrationError
        If none is left.
    """
    if order is not None:
        return LensModels((with_order(fit, order, hold, settle=True),), np.ones(1), {})
    tried: dict[int, Fit] = {}
    why: Exception | None = None
    for each in reversed(ORDERS):
        try:
            one = with_order(fit, each, hold, settle=False)
            checks.refuse_undetermined(one.adjusted, sensor)
            checks.refuse_folds(one.adjusted.state.interior, sensor, each)
        except (CalibrationError, np.linalg.LinAlgError) as error:
            why = error
            continue
        tried[each] = one
        if len(tried) == _COMPARED:
            break
    if not tried:
        raise why or CalibrationError("no lens model fits")
    criterion = {each: one.adjusted.cost + 2 * each for each, one in tried.items()}
    least = min(criterion.values())
    criterion = {each: value - least for each, value in criterion.items()}
    weights = {each: float(np.exp(-0.5 * value)) for each, value in criterion.items()}
    kept = [each for each in tried if weights[each] > _LEAST_WEIGHT]
    shares = np.array([weights[each] for each in kept])
    return LensModels(tuple(tried[each] for each in kept), shares / shares.sum(), criterion)
