"""The variance of a weighted mean whose covariance was learnt from the same record."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.vibration import Vibration

__all__ = ["LearntVariance"]

_Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LearntVariance:
    """Variance of weighted means of one record, by the covariance that the record itself showed.

    Weights that follow the learnt parameters are less good than they seem: the parameters were
    fitted to this record's noise. Kenward and Roger (Biometrics 53 (1997) 983,
    doi:10.2307/2533558) give to first order what this adds to the variance; degrees of freedom
    follow from how well the parameters are known (Satterthwaite, Biometrics Bulletin 2 (1946)
    110, doi:10.2307/3002019).

    Attributes
    ----------
    covariance, projector : ndarray, shape (field, field)
        Covariance of the measured fields, and its inverse without the trend.
    changes : ndarray, shape (parameter, field, field)
        Derivatives of the covariance.
    uncertainty : ndarray, shape (parameter, parameter)
        Covariance of the parameters.
    drift : ndarray, shape (field,)
        Slow motion; what a weighted mean keeps of it counts as an error.
    """

    covariance: _Array
    projector: _Array
    changes: _Array
    uncertainty: _Array
    drift: _Array

    @classmethod
    def of_vibration(
        cls, vibration: Vibration, place: NDArray[np.int64], angle: _Array
    ) -> tuple[Self, _Array]:
        """Set up for the fields measured; returns the weights of generalised least squares too.

        Parameters
        ----------
        vibration : Vibration
            What was learnt.
        place : ndarray, shape (field,)
            Numbers of the fields measured.
        angle : ndarray, shape (field,)
            Their angles.
        """
        lag = np.abs(place[:, None] - place)
        covariance, trend = vibration.covariance[lag], vibration.trend
        inverse = np.linalg.inv(covariance)
        half = inverse @ trend
        gls = np.linalg.solve(trend.T @ half, half.T)
        own = cls(
            covariance=covariance,
            projector=inverse - half @ gls,
            changes=vibration.changes[:, lag],
            uncertainty=vibration.uncertainty,
            drift=trend[:, 1:] @ (gls @ angle)[1:],
        )
        return own, gls[0]

    def of(self, weights: _Array, *, learnt: bool) -> tuple[float, float]:
        """Return the variance of a weighted mean and its degrees of freedom.

        Parameters
        ----------
        weights : ndarray, shape (field,)
            The weights.
        learnt : bool
            Whether they follow the learnt parameters.
        """
        moved = self.changes @ weights
        variance = float(weights @ self.covariance @ weights)
        if learnt:
            spread = (moved @ self.projector @ moved.T * self.uncertainty).sum()
            variance += 2 * float(spread)  # once for the weights, once for the variance's own bias
        variance += float(weights @ self.drift) ** 2
        slope = moved @ weights
        unsure = float(slope @ self.uncertainty @ slope)
        return variance, 2 * variance**2 / unsure if unsure > 0 else np.inf
