"""What every method of correction returns: the bias sample by sample, before any low-pass."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["BiasEstimate"]

_Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BiasEstimate:
    """Centripetal acceleration that the package took for gravity.

    Attributes
    ----------
    addition : ndarray [sample]
        What to add to the unfiltered specific force [m/s^2], sum of V^2 / rho.
    std_terms : list of ndarray [sample]
        Independent error terms [m/s^2] before the low-pass; after it, the absolute value of each
        is 1 sigma.
    clipped : ndarray [sample]
        Whether a channel used was at the end of its range.
    settling_s : float
        Time from either end of the record within which the estimate has not settled [s].
    why : str
        What was used, in one sentence.
    settings : mapping
        Figures behind the estimate, for the record of the result.
    """

    addition: _Floats
    std_terms: list[_Floats]
    clipped: NDArray[np.bool_]
    settling_s: float
    why: str
    settings: Mapping[str, object] = field(default_factory=dict)
