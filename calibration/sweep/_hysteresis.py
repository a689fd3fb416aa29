"""Whether a sweep's points differ by the direction from which their angle was reached."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibration.sweep._outliers import ScaledPoints
from calibration.sweep._polynomial import PolynomialFit
from calibration.sweep.point import SweepPoint
from glint_aoa.coverage import coverage_factor

__all__ = ["Hysteresis", "directions", "find_hysteresis"]

Floats = NDArray[np.float64]

_SIGNIFICANCE = 0.01
_SAME_ANGLE_DEG = 0.01  # a step less than this has no direction of its own
_LEAST_POINTS = 3  # of each branch
_LEAST_OVERLAP = 0.5  # of the range, that both branches cover


@dataclass(frozen=True)
class Hysteresis:
    """The difference between points reached from above and from below.

    Attributes
    ----------
    width_deg, std_deg : float
        Onboard less calibrated angle of the points taken on the way down, less that of those on
        the way up, and its uncertainty, 1 sigma [deg].
    p_value : float
        Chance of so large a width without hysteresis.
    degrees_of_freedom : float
        Of `std_deg`; infinite where the points' stated uncertainties explain their scatter.
    up, down : tuple of str
        Names of the points of each branch.
    """

    width_deg: float
    std_deg: float
    p_value: float
    up: tuple[str, ...]
    down: tuple[str, ...]
    degrees_of_freedom: float = math.inf

    @property
    def u95_deg(self) -> float:
        """Half the 95 % interval of the width [deg]."""
        return coverage_factor(self.degrees_of_freedom) * self.std_deg

    @property
    def is_significant(self) -> bool:
        """Whether chance explains the width in less than one sweep of a hundred."""
        return self.p_value < _SIGNIFICANCE


def directions(points: Sequence[SweepPoint]) -> list[int]:
    """Return from where each point's angle was reached: 1 from below, -1 from above, 0 unknown.

    Parameters
    ----------
    points : sequence of SweepPoint
        In the order in which they were taken. Of the first the direction is unknown; one at the
        angle of the point before keeps its direction.
    """
    found = [0]
    for before, point in itertools.pairwise(points):
        step = point.onboard_deg - before.onboard_deg
        found.append(found[-1] if abs(step) < _SAME_ANGLE_DEG else int(np.sign(step)))
    return found[: len(points)]


def find_hysteresis(
    group: Sequence[SweepPoint],
    used: Sequence[SweepPoint],
    scaled: ScaledPoints,
    fit: PolynomialFit,
) -> Hysteresis | None:
    """Fit a constant difference of the branches together with the polynomial, and test it.

    Parameters
    ----------
    group : sequence of SweepPoint
        All points of the sweep in the order in which they were taken.
    used : sequence of SweepPoint
        Those of the fit, in the same order.
    scaled : ScaledPoints
        The same.
    fit : PolynomialFit
        The curve through both branches.

    Returns
    -------
    Hysteresis or None
        None if a branch has fewer than 3 points, or they cover less than half the range in common.

    Notes
    -----
    A loop that closes at both ends of the sweep has the same sign throughout; the constant is its
    mean width, two thirds of the widest for a parabola.
    """
    whence = dict(zip(group, directions(group), strict=True))
    direction = np.array([whence[point] for point in used])
    up, down = scaled.t[direction > 0], scaled.t[direction < 0]
    if min(up.size, down.size) < _LEAST_POINTS:
        return None
    overlap = min(up.max(), down.max()) - max(up.min(), down.min())
    if overlap < 2 * _LEAST_OVERLAP:
        return None
    width, std, freedom = _width(scaled, fit, -direction / 2)
    return Hysteresis(
        width_deg=width,
        std_deg=std,
        p_value=float(2 * special.stdtr(freedom, -abs(width) / std)),
        degrees_of_freedom=freedom,
        up=tuple(p.name for p, way in zip(used, direction, strict=True) if way > 0),
        down=tuple(p.name for p, way in zip(used, direction, strict=True) if way < 0),
    )


def _width(scaled: ScaledPoints, fit: PolynomialFit, branch: Floats) -> tuple[float, float, float]:
    """Fit the width by weighted least squares: itself, its std, and the degrees of freedom."""
    slopes = np.polynomial.polynomial.polyder(fit.coefficients)
    noise = np.hypot(scaled.sy, np.polynomial.polynomial.polyval(scaled.t, slopes) * scaled.st)
    powers = np.polynomial.polynomial.polyvander(scaled.t, fit.coefficients.size - 1)
    design = np.column_stack([branch, powers]) / noise[:, None]
    off = (scaled.y - np.polynomial.polynomial.polyval(scaled.t, fit.coefficients)) / noise
    solution, *_ = np.linalg.lstsq(design, off, rcond=None)
    std = float(np.sqrt(np.linalg.inv(design.T @ design)[0, 0]))
    freedom = off.size - design.shape[1]
    chi_square = float(np.sum((off - design @ solution) ** 2))
    width = float(solution[0])
    if freedom > 0 and special.chdtrc(freedom, chi_square) < _SIGNIFICANCE:
        std *= np.sqrt(chi_square / freedom)
        return width, std, float(freedom)
    return width, std, math.inf
