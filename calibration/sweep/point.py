"""A point of a pitch sweep, or one taken later to check it: all that is known of the point."""

import datetime
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glint_aoa.errors import CalibrationError

__all__ = [
    "DEFAULT_ONBOARD_STD_DEG",
    "SweepPoint",
    "check_no_duplicates",
    "in_order_of_time",
    "is_of_a_tunnel",
    "sweep_points",
]

DEFAULT_ONBOARD_STD_DEG = 0.002
"""Noise of an onboard mean where the record's own cannot be evaluated [deg], 1 sigma."""

_TEMPERATURES_K = (50.0, 500.0)  # of wind tunnels; 21 or 70 is another unit than kelvin

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SweepPoint:
    """One point: the model at rest at one angle, seen by the camera and by the onboard sensor.

    Attributes
    ----------
    name : str
        Its name.
    optical_deg, optical_std_deg : float
        Mean optical angle before calibration, and its uncertainty, 1 sigma [deg].
    onboard_deg, onboard_std_deg : float
        Mean onboard angle, and its uncertainty, 1 sigma [deg].
    time : str
        When it was taken, ISO 8601; empty if unknown.
    temperature_k : float or None
        Tunnel temperature [K].
    nominal_deg : float or None
        Angle at which the support was set [deg].
    intercept_mm, intercept_std_mm : float or None
        Mean of the line's Z at X = 0, and its uncertainty, 1 sigma [mm].
    line_v : float or None
        Where the line lies on the image: field line at the middle of the columns measured.
    mark_row, mark_column : float or None
        Where the reference mark lies on the sensor: field line and column; None in a direction in
        which it has no edge.
    mark_at : (float, float) or None
        Field line and column of the middle of its box.
    onboard_note : str
        What was done to the onboard angle, such as the bias of vibration taken out.
    """

    name: str
    optical_deg: float
    optical_std_deg: float
    onboard_deg: float
    onboard_std_deg: float
    time: str = ""
    temperature_k: float | None = None
    nominal_deg: float | None = None
    intercept_mm: float | None = None
    intercept_std_mm: float | None = None
    line_v: float | None = None
    mark_row: float | None = None
    mark_column: float | None = None
    mark_at: tuple[float, float] | None = None
    onboard_note: str = ""

    def __post_init__(self) -> None:
        """Refuse what cannot be; NaN of what may be unknown becomes None."""
        for each in fields(self):
            value = getattr(self, each.name)
            if each.default is None and isinstance(value, float) and not math.isfinite(value):
                object.__setattr__(self, each.name, None)
        for key in ("optical_deg", "onboard_deg"):
            if not math.isfinite(getattr(self, key)):
                raise CalibrationError(
                    f"{self.name}: {key} is {getattr(self, key):g}; "
                    "leave that point out or repeat it"
                )
        for key in ("optical_std_deg", "onboard_std_deg"):
            if not 0 < getattr(self, key) < math.inf:
                raise CalibrationError(
                    f"{self.name}: {key} is {getattr(self, key):g}; "
                    "an uncertainty must be greater than zero"
                )
        if self.temperature_k is not None and not is_of_a_tunnel(self.temperature_k):
            raise CalibrationError(
                f"{self.name}: a tunnel temperature of {self.temperature_k:g} K cannot be; "
                "give it in kelvins, or with its unit"
            )

    @property
    def moment(self) -> datetime.datetime | None:
        """When it was taken, or None; without a time zone it is taken as UTC."""
        try:
            moment = datetime.datetime.fromisoformat(self.time)
        except ValueError:
            return None
        return moment.replace(tzinfo=datetime.UTC) if moment.tzinfo is None else moment


def is_of_a_tunnel(temperature_k: float) -> bool:
    """Whether a temperature can be a wind tunnel's [K], and not degrees of another scale."""
    low, high = _TEMPERATURES_K
    return low < temperature_k < high


def sweep_points(
    optical_deg: ArrayLike,
    optical_std_deg: ArrayLike,
    onboard_deg: ArrayLike,
    onboard_std_deg: ArrayLike | None,
) -> tuple[SweepPoint, ...]:
    """Make points of arrays; they are called "point 1", "point 2" and so on.

    Parameters
    ----------
    optical_deg : array_like [point]
        Mean optical angle of each point of the sweep [deg].
    optical_std_deg : float or array_like [point]
        Uncertainty of these means, 1 sigma [deg].
    onboard_deg : array_like [point]
        Mean angle from the onboard sensor [deg].
    onboard_std_deg : float, array_like [point] or None
        Uncertainty of these means, 1 sigma, independent from point to point [deg];
        None takes `DEFAULT_ONBOARD_STD_DEG`.

    Raises
    ------
    CalibrationError
        If the arrays do not fit each other, or hold what no point can have.
    """
    x = _numbers("optical_deg", optical_deg)
    if x.ndim != 1:
        raise CalibrationError(f"optical_deg has {x.ndim} dimensions; give one value for a point")
    default = DEFAULT_ONBOARD_STD_DEG if onboard_std_deg is None else onboard_std_deg
    y = _like(x, "onboard_deg", onboard_deg)
    sx = _like(x, "optical_std_deg", optical_std_deg, may_broadcast=True)
    sy = _like(x, "onboard_std_deg", default, may_broadcast=True)
    rows = zip(x.tolist(), sx.tolist(), y.tolist(), sy.tolist(), strict=True)
    return tuple(SweepPoint(f"point {k}", *row) for k, row in enumerate(rows, 1))


def _numbers(name: str, values: ArrayLike) -> Floats:
    try:
        return np.array(values, np.float64)
    except (TypeError, ValueError):
        raise CalibrationError(f"{name} does not hold numbers only; give angles in deg") from None


def _like(x: Floats, name: str, values: ArrayLike, *, may_broadcast: bool = False) -> Floats:
    array = _numbers(name, values)
    if may_broadcast and array.ndim == 0:
        return np.full_like(x, float(array))
    if array.shape != x.shape:
        raise CalibrationError(
            f"{name} holds {array.size} values for {x.size} optical angles; give one for each point"
        )
    return array


def in_order_of_time(points: Iterable[SweepPoint]) -> list[SweepPoint]:
    """Sort by time; as given if the time of one is unknown."""
    given = list(points)
    moments = [point.moment for point in given]
    known = [moment for moment in moments if moment is not None]
    if len(known) < len(given):
        return given
    order = sorted(range(len(given)), key=known.__getitem__)
    return [given[k] for k in order]


def check_no_duplicates(points: Sequence[SweepPoint]) -> None:
    """Refuse a point that is given twice, under its own name or as a copy under another.

    Raises
    ------
    CalibrationError
        Naming both.
    """
    by_name: set[str] = set()
    by_content: dict[tuple[str, float, float], str] = {}
    for point in points:
        if point.name in by_name:
            raise CalibrationError(f"point {point.name} is given twice; give each point once")
        by_name.add(point.name)
        content = (point.time, point.optical_deg, point.onboard_deg)
        twin = by_content.setdefault(content, point.name)
        if point.time and twin != point.name:
            raise CalibrationError(
                f"points {twin} and {point.name} hold the same recording (taken at {point.time}, "
                "the same angles to the last digit); give one of them"
            )
