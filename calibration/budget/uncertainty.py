"""The uncertainty budget of the angle, and the geometry's uncertainty carried to measured angles.

The measurement's own steps (pixel, image plane, distortion, collinearity with the known Y,
straight line, angle, reflection, pitch sweep) are taken as one function of what it was given:
camera, pose, known plane, body and lamp, sweep, centroids. The uncertainties of these go through
it to first order (JCGM 100:2008, the GUM) and by Monte Carlo (JCGM 101:2008).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.budget._carried import (
    CarriedUncertainty,
    geometry_uncertainty,
    uncertain_geometry,
)
from calibration.budget._chain import Chain
from calibration.budget._first_order import FirstOrder
from calibration.budget._inputs import GeometryCovariance, geometry_covariance
from calibration.budget._lines import Lines, sensor_columns
from calibration.budget._model import AngleModel, Recalibration
from calibration.budget._monte_carlo import (
    Distribution,
    distributions,
    draw_angles,
    draw_geometries,
)
from calibration.budget._parameters import CAMERA, PARAMETERS, POSE
from calibration.budget._rows import BudgetBlock, BudgetRow
from calibration.sweep.fit import PitchSweep
from calibration.sweep.point import is_of_a_tunnel
from glint_aoa.coverage import coverage_factor
from glint_aoa.errors import CalibrationError
from glint_aoa.setup import Setup

__all__ = [
    "AngleBudget",
    "BudgetBlock",
    "BudgetRow",
    "CarriedUncertainty",
    "Distribution",
    "GeometryCovariance",
    "UncertaintyBudget",
    "geometry_covariance",
    "geometry_uncertainty",
    "uncertain_geometry",
    "uncertainty_budget",
]

Floats = NDArray[np.float64]

_DRAWS, _DRAWS_REFLECTION = 10_000, 4_000
_LEAST_DRAWS = 1000
_MOST_DRAWS = 1_000_000  # a few gigabytes
_STEEPEST_DEG = 60.0
_ROUNDS = 50
_SAME_ANGLE_DEG = 1e-10


@dataclass(frozen=True)
class AngleBudget:
    """The budget of one angle at one place of the picture.

    Attributes
    ----------
    angle_deg, raw_angle_deg : float
        Angle after and before the pitch sweep [deg].
    intercept_mm : float
        The glint's Z at X = 0 [mm].
    line : float
        Sensor line at which the glint crosses the middle of the measured columns [pixels].
    in_view : bool
        Whether all measured columns see it.
    outside_sweep : bool
        Whether the angle lies outside the range of the pitch sweep.
    rows : tuple of BudgetRow
        One row an input.
    blocks : tuple of BudgetBlock
        The inputs of one source together.
    std_deg : float
        Standard uncertainty to first order [deg].
    degrees_of_freedom : float
        Effective ones (Welch-Satterthwaite).
    u95_deg : float
        Expanded uncertainty: half a 95 % interval [deg].
    monte_carlo : Distribution
        What the draws say.
    """

    angle_deg: float
    raw_angle_deg: float
    intercept_mm: float
    line: float
    in_view: bool
    outside_sweep: bool
    rows: tuple[BudgetRow, ...]
    blocks: tuple[BudgetBlock, ...]
    std_deg: float
    degrees_of_freedom: float
    u95_deg: float
    monte_carlo: Distribution

    @property
    def departure(self) -> float:
        """How far the Monte Carlo interval's ends lie off those to first order, over u95."""
        return self.monte_carlo.departure(self.angle_deg, self.u95_deg)

    @property
    def confirmed(self) -> bool:
        """Whether the Monte Carlo interval confirms the one to first order within 5 %."""
        return self.monte_carlo.confirms(self.angle_deg, self.u95_deg)


@dataclass(frozen=True)
class UncertaintyBudget:
    """Budgets of several angles and what they have in common.

    Attributes
    ----------
    angles : tuple of AngleBudget
        By angle, then by place in the picture.
    centroid_std_lines : float
        Noise of one column's centre in one field, 1 sigma [lines].
    fields : int
        Fields that are averaged.
    columns : int
        Columns that are measured.
    draws, seed : int
        Of the Monte Carlo.
    is_stated : bool
        Whether anything is said about the geometry's uncertainty.
    sweep_degree : int or None
        Degree of the pitch sweep that is applied.
    held : tuple of str
        Inputs that a calibration held and did not estimate: they count as exact.
    """

    angles: tuple[AngleBudget, ...]
    centroid_std_lines: float
    fields: int
    columns: int
    draws: int
    seed: int
    is_stated: bool
    sweep_degree: int | None
    held: tuple[str, ...] = ()

    @property
    def exact(self) -> tuple[str, ...]:
        """Other inputs of which nobody says how uncertain they are: they count as exact, too."""
        rows = self.angles[0].rows
        return tuple(row.source for row in rows if row.std == 0 and row.source not in self.held)

    @property
    def worst(self) -> tuple[AngleBudget, ...]:
        """Of each angle the place in the picture where u95 is largest."""
        worst: dict[float, AngleBudget] = {}
        for each in self.angles:
            angle = round(each.angle_deg, 6)
            if angle not in worst or each.u95_deg > worst[angle].u95_deg:
                worst[angle] = each
        return tuple(worst.values())


def uncertainty_budget(
    setup: Setup,
    angles_deg: ArrayLike,
    *,
    intercepts_m: Sequence[float] | None = None,
    sweep: PitchSweep | None = None,
    temperature_k: float | None = None,
    centroid_std_lines: float = 0.01,
    fields: int = 60,
    draws: int | None = None,
    seed: int = 1,
    progress: Callable[[int], None] | None = None,
) -> UncertaintyBudget:
    r"""Carry all uncertainties of a setup to the angle.

    To first order, with the sensitivities :math:`c_i = \partial\alpha / \partial x_i` and the
    inputs' covariance U,

    .. math:: u^2(\alpha) = c^T U c

    (JCGM 100:2008, equation 13). Where a pitch sweep is applied :math:`\alpha` is the angle after
    a sweep that is fitted again with the changed geometry: what stays the same during sweep and
    test cancels as far as the sweep's polynomial can follow it. The Monte Carlo (JCGM 101:2008)
    sends drawn inputs through the same steps without linearising anything.

    Parameters
    ----------
    setup : Setup
        A setup whose camera is oriented.
    angles_deg : array_like [angle]
        Angles after calibration [deg].
    intercepts_m : sequence of float, optional
        The glint's Z at X = 0 [m]; glints through a quarter, a half and three quarters of the
        picture's height if not given.
    sweep : PitchSweep, optional
        The sweep that is applied.
    temperature_k : float, optional
        Tunnel temperature at which it is applied [K].
    centroid_std_lines : float, optional
        Noise of one column's centre in one field, 1 sigma [lines].
    fields : int, optional
        Fields that are averaged.
    draws : int, optional
        Of the Monte Carlo, 1000 at least; 10 000 if not given, 4000 with a reflection, which
        takes longer.
    seed : int, optional
        Of the Monte Carlo.
    progress : callable, optional
        Called with the number of draws that were done since.

    Returns
    -------
    UncertaintyBudget
        One budget for each angle and place.

    Raises
    ------
    SetupError
        If the setup has no camera in space, or no sensor.
    CalibrationError
        If a calibration cannot be used, or the camera does not see such a glint.

    Notes
    -----
    The budget knows of what it is told. Not in it are a camera that moves between sweep and test,
    a model that sags, a glint that is not straight, and a sweep whose points lie at other places
    of the picture than is supposed.
    """
    angle, draws = _checked_angles(angles_deg), _checked_draws(draws, setup)
    _check_noise(centroid_std_lines, fields)
    _check_temperature(temperature_k)
    covariance = geometry_covariance(setup)
    chain = Chain.of_setup(setup, sensor_columns(setup))
    raw = angle if sweep is None else _before(sweep, angle, temperature_k)
    lines = Lines.in_picture(setup, chain, raw, intercepts_m)
    again = None
    if sweep is not None:
        row = float(np.median(lines.middle))
        again = Recalibration.of(sweep, chain, row=row, temperature_k=temperature_k)
    model = AngleModel(chain, again, lines.v)
    first = FirstOrder.of(model, covariance, float(centroid_std_lines / np.sqrt(fields)))
    drawn = distributions(_drawn(model, first, draws, np.random.default_rng(seed), progress))
    budgets = (_angle_budget(number, lines, first, each) for number, each in enumerate(drawn))
    return UncertaintyBudget(
        angles=tuple(budgets),
        centroid_std_lines=centroid_std_lines,
        fields=fields,
        columns=chain.u.size,
        draws=draws,
        seed=seed,
        is_stated=covariance.is_stated,
        sweep_degree=None if sweep is None else sweep.degree,
        held=_held(setup, covariance),
    )


def _held(setup: Setup, covariance: GeometryCovariance) -> tuple[str, ...]:
    """Return what the setup's calibrations of camera and pose did not estimate, in words."""
    calibrated: set[str] = set()
    if setup.camera_path is not None:
        calibrated.update(CAMERA)
    if setup.pose_path is not None:
        calibrated.update(POSE)
    uncertain = {name for block in covariance.uncertain().blocks for name in block.parameters}
    return tuple(each.label for each in PARAMETERS if each.name in calibrated - uncertain)


def _angle_budget(
    number: int, lines: Lines, first: FirstOrder, distribution: Distribution
) -> AngleBudget:
    std, freedom = first.std(number)
    return AngleBudget(
        angle_deg=round(float(first.angles.calibrated_deg[number]), 9) + 0.0,
        raw_angle_deg=float(first.angles.raw_deg[number]),
        intercept_mm=float(lines.intercept[number] * 1e3),
        line=float(lines.middle[number]),
        in_view=bool(lines.in_view[number]),
        outside_sweep=bool(first.sweep is not None and first.sweep.outside[number]),
        rows=first.rows(number),
        blocks=first.blocks(number),
        std_deg=std,
        degrees_of_freedom=freedom,
        u95_deg=coverage_factor(freedom) * std,
        monte_carlo=distribution,
    )


def _drawn(
    model: AngleModel,
    first: FirstOrder,
    draws: int,
    rng: np.random.Generator,
    progress: Callable[[int], None] | None,
) -> Floats:
    """Draw calibrated angles [draw, line], in degrees."""
    geometries = draw_geometries(model.chain.geometry, first.covariance, draws, rng)
    drawn = draw_angles(model, geometries, row_std=first.row_std, rng=rng, progress=progress)
    return drawn if first.sweep is None else drawn + first.sweep.draw(draws, rng)


def _checked_angles(angles_deg: ArrayLike) -> Floats:
    angle = np.atleast_1d(np.asarray(angles_deg, np.float64))
    bad = ~(np.abs(angle) <= _STEEPEST_DEG)
    if angle.ndim != 1 or not angle.size or bad.any():
        wrong = f"{angle[bad][0]:g} deg is none" if bad.any() else "there are none"
        raise CalibrationError(
            f"angles between -{_STEEPEST_DEG:g} and {_STEEPEST_DEG:g} deg are wanted and {wrong}; "
            "give angles in degrees"
        )
    return angle


def _checked_draws(draws: int | None, setup: Setup) -> int:
    if draws is None:
        return _DRAWS if setup.glint.reflection is None else _DRAWS_REFLECTION
    if draws < _LEAST_DRAWS:
        raise CalibrationError(
            f"draws is {draws}; a 95 % interval takes {_LEAST_DRAWS} at least, 10000 are better"
        )
    if draws > _MOST_DRAWS:
        raise CalibrationError(
            f"draws is {draws}; {_MOST_DRAWS} give three digits and are the most, 10000 are enough"
        )
    return draws


def _check_temperature(temperature_k: float | None) -> None:
    if temperature_k is not None and not is_of_a_tunnel(temperature_k):
        raise CalibrationError(
            f"a tunnel temperature of {temperature_k:g} K cannot be; give it in kelvins"
        )


def _check_noise(centroid_std_lines: float, fields: int) -> None:
    if not (np.isfinite(centroid_std_lines) and centroid_std_lines >= 0):
        raise CalibrationError(
            f"the centroids' noise is {centroid_std_lines} lines; give zero or more"
        )
    if fields < 1:
        raise CalibrationError(f"fields is {fields}; give 1 or more")


def _before(sweep: PitchSweep, angle_deg: Floats, temperature_k: float | None) -> Floats:
    """Return the angles [deg] that a sweep turns into given ones, by Newton's method."""
    raw = angle_deg
    for _ in range(_ROUNDS):
        applied = sweep.apply(raw, temperature_k=temperature_k)
        change = (applied.angle_deg - angle_deg) / applied.gain
        raw = raw - change
        if np.abs(change).max() < _SAME_ANGLE_DEG:
            return raw
    raise CalibrationError(
        "the pitch sweep does not reach the angles that are asked for; "
        f"its range is {sweep.range_deg[0]:.2f} to {sweep.range_deg[1]:.2f} deg"
    )
