"""Vibration modes of the model on its sting, as the inertial sensor meets them.

Effective radii follow from measured mode shapes as in the paper (its section "Modal Correction
Technique", figures 3 and 4): a straight line through the fuselage's coefficients, its zero the
point of rotation, the distance from there forward to the sensor the radius.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import tomli_w
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from glint_aoa.setup import Inertial

__all__ = [
    "AXIS_OF_PLANE",
    "CREDIBLE_TURN",
    "PLANES",
    "TABLE_1",
    "Mode",
    "ModeShape",
    "Plane",
    "RotationPoint",
    "modes_from_setup",
    "modes_toml",
    "rotation_point",
]

Plane = Literal["yaw", "pitch"]

PLANES: tuple[Plane, ...] = ("yaw", "pitch")

AXIS_OF_PLANE: Mapping[Plane, str] = {"yaw": "y", "pitch": "z"}
"""Model axis along which the model moves in each plane."""

CREDIBLE_TURN = float(np.radians(1.0))
"""Amplitude of rotation of a single mode beyond which it is not believed [rad]; the paper's largest
moments turn the model by 0.3 deg."""

_Floats = NDArray[np.float64]

_INCH = 0.0254

_RIGID = 0.05
"""Largest residual of a rigid fuselage, over its largest coefficient."""

_NOISE_STDS = 3.0
"""Residuals and slopes within so many of their standard deviations may be noise."""


@dataclass(frozen=True)
class Mode:
    """One vibration mode: the fuselage turns as a rigid body about one point of its axis.

    Attributes
    ----------
    number : int
        Mode number.
    plane : {"yaw", "pitch"}
        Plane of the motion.
    frequency_hz : float
        Natural frequency [Hz].
    radius_m : float
        Effective radius [m]: distance from the point of rotation forward to the sensor, positive
        with the point of rotation aft of the sensor.
    radius_std_m : float
        Its standard deviation, 1 sigma [m]; counts where a bias is divided by the radius.
    """

    number: int
    plane: Plane
    frequency_hz: float
    radius_m: float
    radius_std_m: float = 0.0


TABLE_1 = (
    Mode(1, "yaw", 9.8, 31.0 * _INCH),
    Mode(2, "pitch", 9.2, 30.2 * _INCH),
    Mode(3, "yaw", 19.5, 0.18 * _INCH),
    Mode(4, "pitch", 20.3, -1.08 * _INCH),
    Mode(5, "yaw", 29.8, -7.14 * _INCH),
    Mode(6, "pitch", 34.2, -7.65 * _INCH),
)
"""The six modes of the paper's Table 1 (modal survey of July 1993), inches turned into metres.

Mode 1 was met between 8.8 and 9.8 Hz, depending on the set-up; most tests excited 9.8 Hz.
"""


def modes_from_setup(inertial: Inertial) -> tuple[Mode, ...]:
    """Return the modes that the setup lists, in order of frequency.

    Parameters
    ----------
    inertial : Inertial
        The setup's inertial section.

    Returns
    -------
    tuple of Mode
        Empty if the setup lists none.

    Raises
    ------
    InputError
        If two modes bear the same number.
    """
    numbers = [mode.number for mode in inertial.mode]
    for number in numbers:
        if numbers.count(number) > 1:
            raise InputError(f"inertial.mode: number {number} is listed twice; number modes apart")
    modes = (Mode(m.number, m.plane, m.frequency, m.radius, m.radius_std) for m in inertial.mode)
    return tuple(sorted(modes, key=lambda mode: mode.frequency_hz))


def modes_toml(modes: Iterable[Mode]) -> str:
    """Write modes as the ``[[inertial.mode]]`` tables of a setup file.

    Parameters
    ----------
    modes : iterable of Mode
        The modes, in the order in which to write them.

    Returns
    -------
    str
        TOML; frequencies to 0.001 Hz, radii to 0.01 mm.
    """
    tables = [
        {
            "number": mode.number,
            "plane": mode.plane,
            "frequency": f"{mode.frequency_hz:.3f} Hz",
            "radius": f"{1e3 * mode.radius_m:.2f} mm",
            **({"radius_std": f"{1e3 * mode.radius_std_m:.2f} mm"} if mode.radius_std_m else {}),
        }
        for mode in modes
    ]
    return "\n".join(f"[[inertial.mode]]\n{tomli_w.dumps(table)}" for table in tables)


@dataclass(frozen=True, eq=False)
class ModeShape:
    """A measured mode shape along the fuselage.

    Attributes
    ----------
    number : int
        Mode number.
    plane : {"yaw", "pitch"}
        Plane of the motion: coefficients along model y (yaw) or z (pitch).
    frequency_hz : float
        Natural frequency [Hz].
    station_m : ndarray [point]
        Stations of the fuselage, model x [m].
    coefficient : ndarray [point]
        Real mode shape coefficients, in any unit.
    coefficient_std : ndarray [point] or None
        Their standard deviations, 1 sigma, in the same unit; None if they are not known.
    frequency_std_hz, damping : float
        Standard deviation of the frequency [Hz] and fraction of critical damping; NaN if not known.
    collinearity : float
        Modal phase collinearity, 1 for a shape wholly in phase; NaN if it was given real.
    """

    number: int
    plane: Plane
    frequency_hz: float
    station_m: _Floats
    coefficient: _Floats
    coefficient_std: _Floats | None = None
    frequency_std_hz: float = float("nan")
    damping: float = float("nan")
    collinearity: float = float("nan")


@dataclass(frozen=True, eq=False)
class RotationPoint:
    """The point about which the fuselage turns in a mode, by a straight line through its shape.

    Attributes
    ----------
    mode : Mode
        Number, plane, frequency and effective radius.
    shape : ModeShape
        What the line was fitted to.
    station_m : float
        Where the line crosses zero, model x [m].
    covariance : ndarray [3, 3]
        Of frequency [Hz], `station_m` [m] and effective radius [m]; NaN where nothing tells it.
    residual : float
        Root mean square of what the line leaves over the largest coefficient, with the degrees of
        freedom taken off; NaN with two points, which every line meets.
    expected_residual : float
        The same from `ModeShape.coefficient_std`; NaN if it is not known.
    """

    mode: Mode
    shape: ModeShape
    station_m: float
    covariance: _Floats
    residual: float
    expected_residual: float

    @property
    def radius_std_m(self) -> float:
        """Standard deviation of the effective radius, 1 sigma [m]."""
        return float(np.sqrt(self.covariance[2, 2]))

    @property
    def is_rigid(self) -> bool | None:
        """Whether the fuselage moved as a rigid body; None if two points cannot tell.

        It did if the residual is at most 5 % of the largest coefficient, or three times what the
        coefficients' own noise brings.
        """
        if np.isnan(self.residual):
            return None
        return bool(self.residual <= np.fmax(_RIGID, _NOISE_STDS * self.expected_residual))


def rotation_point(
    shape: ModeShape, sensor_station_m: float, *, sensor_std_m: float = 0.0
) -> RotationPoint:
    """Find a mode's point of rotation and its effective radius at the inertial sensor.

    phi(x) = b (x - x_r) by (weighted) least squares; rho = x_sensor - x_r.

    Parameters
    ----------
    shape : ModeShape
        The fuselage's coefficients; leave out wings, sting and balance.
    sensor_station_m : float
        Station of the inertial sensor, model x [m].
    sensor_std_m : float
        Its standard deviation, 1 sigma [m].

    Returns
    -------
    RotationPoint
        Point, radius, covariance and the check on the rigid-body assumption.

    Raises
    ------
    InputError
        If there are fewer than two stations, values are not finite, the fuselage does not turn
        beyond its noise, or it turns about the sensor itself.

    Notes
    -----
    Standard deviations are those of the linearised fit. Coefficients with known noise are
    weighted by it; if they scatter about the line more than it says, by bending for one, the
    covariance is widened by that ratio. Without known noise it is the scatter alone, for which
    three points give one degree of freedom: of the right order, no better. A fuselage that bends
    has no one point of rotation: look at `RotationPoint.is_rigid`.
    """
    station, coefficient = _checked(shape)
    noise = shape.coefficient_std
    weight = np.ones(station.size) if noise is None else 1 / np.asarray(noise) ** 2
    middle = np.average(station, weights=weight)
    away = station - middle
    offset = np.average(coefficient, weights=weight)
    spread = np.sum(weight * away**2)
    slope = np.sum(weight * away * coefficient) / spread
    left = coefficient - offset - slope * away
    freedom = station.size - 2
    variance = _unit_variance(np.sum(weight * left**2), freedom, known=noise is not None)
    if not abs(slope) > _NOISE_STDS * np.sqrt(np.nan_to_num(variance) / spread):
        raise InputError(
            f"mode {shape.number}: the fuselage does not turn beyond the scatter of its shape, so "
            "it has no point of rotation; measure farther apart or leave the mode out"
        )
    point = middle - offset / slope
    radius = sensor_station_m - point
    if radius == 0:
        raise InputError(
            f"mode {shape.number}: it turns about the sensor itself, which it does not bias; "
            "leave the mode out"
        )
    point_variance = variance * (1 / np.sum(weight) + (offset / slope) ** 2 / spread) / slope**2
    largest = np.max(np.abs(coefficient))
    return RotationPoint(
        mode=Mode(
            shape.number,
            shape.plane,
            shape.frequency_hz,
            float(radius),
            float(np.nan_to_num(np.sqrt(point_variance + sensor_std_m**2))),
        ),
        shape=shape,
        station_m=float(point),
        covariance=np.array(
            [
                [shape.frequency_std_hz**2, 0.0, 0.0],
                [0.0, point_variance, -point_variance],
                [0.0, -point_variance, point_variance + sensor_std_m**2],
            ]
        ),
        residual=float(np.sqrt(np.sum(left**2) / freedom) / largest) if freedom else float("nan"),
        expected_residual=float("nan") if noise is None else float(_rms(noise) / largest),
    )


def _checked(shape: ModeShape) -> tuple[_Floats, _Floats]:
    station = np.asarray(shape.station_m, np.float64)
    coefficient = np.asarray(shape.coefficient, np.float64)
    if np.unique(station).size < 2:
        raise InputError(
            f"mode {shape.number}: its shape has {np.unique(station).size} stations, but a line "
            "takes two and its check three; measure at more"
        )
    noise = np.zeros(1) if shape.coefficient_std is None else np.asarray(shape.coefficient_std)
    if not (np.isfinite(station).all() and np.isfinite(coefficient).all()):
        raise InputError(
            f"mode {shape.number}: its shape holds values that are not finite; leave the points out"
        )
    if shape.coefficient_std is not None and not (np.isfinite(noise) & (noise > 0)).all():
        raise InputError(
            f"mode {shape.number}: coefficient_std must be above zero; give None if it is not known"
        )
    return station, coefficient


def _unit_variance(weighted_square: float, freedom: int, *, known: bool) -> float:
    """Variance of a coefficient of unit weight; NaN if neither noise nor scatter tells it."""
    if not freedom:
        return 1.0 if known else float("nan")
    scatter = weighted_square / freedom
    return max(1.0, scatter) if known else scatter


def _rms(values: _Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
