"""From standard uncertainties to 95 % intervals: effective degrees of freedom, coverage factors."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

__all__ = ["ONE_SIGMA", "coverage_factor", "effective_freedom"]

ONE_SIGMA = float(2 * special.ndtr(1.0) - 1)
"""Share of a normal distribution within one standard deviation."""


def effective_freedom(
    variances: Sequence[ArrayLike], freedoms: Sequence[ArrayLike]
) -> NDArray[np.float64]:
    """Effective degrees of freedom of a sum of independent variances (Welch-Satterthwaite).

    Parameters
    ----------
    variances : sequence of array_like [...]
        Variances that are added, of one shape and unit.
    freedoms : sequence of array_like [...]
        Degrees of freedom of each; infinite for one that is known.

    Returns
    -------
    ndarray [...]
        JCGM 100:2008, equation G.2b; infinite where all are known or none is greater than zero.
    """
    total = np.sum(np.broadcast_arrays(*variances), axis=0)
    parts = (np.square(v) / np.asarray(f) for v, f in zip(variances, freedoms, strict=True))
    spread = np.sum(np.broadcast_arrays(*parts), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(spread > 0, total**2 / spread, np.inf)


def coverage_factor(degrees_of_freedom: float = np.inf, level: float = 0.95) -> float:
    """Return Student's factor of a two-sided interval.

    Parameters
    ----------
    degrees_of_freedom : float, optional
        At least 1; infinite, as for a normal distribution, if not given.
    level : float, optional
        Share of all cases that the interval is to hold.
    """
    return float(special.stdtrit(max(degrees_of_freedom, 1.0), (1 + level) / 2))
