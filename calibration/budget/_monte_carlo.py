"""Propagation of distributions by the Monte Carlo method (JCGM 101:2008)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.budget._inputs import GeometryCovariance, InputBlock
from calibration.budget._model import AngleModel
from calibration.budget._parameters import PARAMETERS
from glint_aoa.errors import CalibrationError

__all__ = ["Distribution", "distributions", "draw_angles", "draw_geometries"]

Floats = NDArray[np.float64]

_TAILS = (0.025, 0.975)
_BATCHES = 10
_AT_A_TIME = 64  # draws, while they are in the cache
_TOLERANCE = 0.05  # of the expanded uncertainty: half a unit in its second digit at most
_MOST_LOST = 0.01  # of the draws
_POSITIVE = [
    number
    for number, each in enumerate(PARAMETERS)
    if each.name in {"focal_length_m", "pixel_pitch_h_m", "pixel_pitch_v_m"}
]


@dataclass(frozen=True)
class Distribution:
    """What the draws say of one angle; degrees.

    Attributes
    ----------
    mean_deg, std_deg : float
        Mean and standard deviation.
    low_deg, high_deg : float
        Ends of the interval that leaves out 2.5 % of the draws on either side.
    standard_error_deg : float
        Of an end of the interval, from batches of draws.
    """

    mean_deg: float
    std_deg: float
    low_deg: float
    high_deg: float
    standard_error_deg: float

    @property
    def u95_deg(self) -> float:
        """Half the length of the interval."""
        return (self.high_deg - self.low_deg) / 2

    @property
    def converged(self) -> bool:
        """Whether twice the standard error is within 5 % of the expanded uncertainty."""
        return 2 * self.standard_error_deg <= _TOLERANCE * self.u95_deg

    def departure(self, angle_deg: float, u95_deg: float) -> float:
        """Return how far an end of the interval lies off angle +- u95, as a share of u95.

        Parameters
        ----------
        angle_deg, u95_deg : float
            Angle and expanded uncertainty by the law of propagation [deg].
        """
        ends = abs(self.low_deg - angle_deg + u95_deg), abs(self.high_deg - angle_deg - u95_deg)
        return max(ends) / u95_deg if u95_deg > 0 else 0.0

    def confirms(self, angle_deg: float, u95_deg: float) -> bool:
        """Whether the ends are those by the law of propagation, within 5 % of u95 and chance."""
        chance = 2 * self.standard_error_deg / u95_deg if u95_deg > 0 else 0.0
        return self.departure(angle_deg, u95_deg) <= _TOLERANCE + chance


def draw_angles(
    model: AngleModel,
    geometries: Floats,
    *,
    row_std: float,
    rng: np.random.Generator,
    progress: Callable[[int], None] | None = None,
) -> Floats:
    """Send drawn geometries and centroids through the whole measurement.

    Parameters
    ----------
    model : AngleModel
        Lines, chain and sweep.
    geometries : ndarray [draw, parameter]
        From `draw_geometries`.
    row_std : float
        Noise of a column's centre [lines].
    rng : Generator
        Source of the noise.
    progress : callable, optional
        Called now and then with the number of draws that were done since.

    Returns
    -------
    ndarray [draw, line]
        Calibrated angles [deg]; NaN where a drawn camera does not see the line.
    """
    drawn = np.full((len(geometries), len(model.v)), np.nan)
    for start in range(0, len(geometries), _AT_A_TIME):
        some = geometries[start : start + _AT_A_TIME]
        v = model.v + row_std * rng.standard_normal((len(some), *model.v.shape))
        can_be = (some[:, _POSITIVE] > 0).all(axis=1)
        drawn[start : start + len(some)][can_be] = model.angles(
            some[can_be], v[can_be]
        ).calibrated_deg
        if progress is not None:
            progress(len(some))
    return drawn


def draw_geometries(
    nominal: Floats, covariance: GeometryCovariance, draws: int, rng: np.random.Generator
) -> Floats:
    """Draw geometries from their joint distribution.

    A block with finite degrees of freedom is drawn from the multivariate t distribution (JCGM 101,
    6.4.9), all others from the normal one.

    Parameters
    ----------
    nominal : ndarray [parameter]
        The setup's geometry.
    covariance : GeometryCovariance
        Its uncertainty.
    draws : int
        How many.
    rng : Generator
        Source of the draws.

    Returns
    -------
    ndarray [draw, parameter]
        The geometries, SI units and radians.
    """
    geometries = np.tile(nominal, (draws, 1))
    for block in covariance.blocks:
        geometries += _errors(block, draws, rng) @ block.response.T
    return geometries


def _errors(block: InputBlock, draws: int, rng: np.random.Generator) -> Floats:
    errors: Floats = rng.standard_normal((draws, len(block.parameters))) @ block.factor.T
    return errors * _students(block.degrees_of_freedom, draws, rng)[:, None]


def _students(degrees_of_freedom: float, draws: int, rng: np.random.Generator) -> Floats:
    """Return factors [draw] that turn normal deviates into ones of Student's distribution."""
    if np.isinf(degrees_of_freedom):
        return np.ones(draws)
    return np.sqrt(degrees_of_freedom / rng.chisquare(degrees_of_freedom, draws))


def distributions(drawn: Floats) -> list[Distribution]:
    """Summarise the draws of each line.

    Parameters
    ----------
    drawn : ndarray [draw, line]
        Angles [deg].

    Raises
    ------
    CalibrationError
        If more than one draw in a hundred is not finite.
    """
    lost = float((~np.isfinite(drawn)).mean(axis=0).max())
    if lost > _MOST_LOST:
        raise CalibrationError(
            f"in {lost:.0%} of the draws the camera does not see the line: the geometry is too "
            "uncertain for a budget; give smaller values in [uncertainty], or calibrate"
        )
    return [_distribution(each[np.isfinite(each)]) for each in drawn.T]


def _distribution(angle: Floats) -> Distribution:
    low, high = np.quantile(angle, _TAILS)
    batches = [np.quantile(batch, _TAILS) for batch in np.array_split(angle, _BATCHES)]
    scatter = np.std(batches, axis=0, ddof=1) / np.sqrt(_BATCHES)
    return Distribution(
        mean_deg=float(angle.mean()),
        std_deg=float(angle.std(ddof=1)),
        low_deg=float(low),
        high_deg=float(high),
        standard_error_deg=float(np.sqrt(np.mean(scatter**2))),
    )
