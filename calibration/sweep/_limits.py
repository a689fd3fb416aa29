"""What a pitch sweep covers: angles, tunnel temperatures, and places of the line on the image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.sweep.temperatures import SAME_TEMPERATURE_K

__all__ = ["SweepLimits"]

_ANGLE_MARGIN = 0.01  # of the width of the range: fields scatter about the sweep's last point
_LINE_MARGIN = 0.01  # of the sensor's lines: moves the angle of a badly turned camera by 0.003 deg
_LINE_MARGIN_LINES = 2.5  # where the number of lines is unknown

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class SweepLimits:
    """What the curves cover that count at one temperature.

    Attributes
    ----------
    angle_deg : (float, float)
        Least and greatest optical angle [deg].
    temperature_k : (float, float) or None
        Least and greatest tunnel temperature of the points [K].
    line_v : (float, float) or None
        Least and greatest place of the line [field lines].
    lines : int or None
        Field lines of the sensor.
    n_curves : int
        Temperatures at which there is a sweep.
    """

    angle_deg: tuple[float, float]
    temperature_k: tuple[float, float] | None
    line_v: tuple[float, float] | None
    lines: int | None
    n_curves: int

    def outside(
        self, angle_deg: Floats, temperature_k: float | None, line_v: ArrayLike | None
    ) -> tuple[Bools, tuple[str, ...]]:
        """Return which angles are not covered, in their shape, and why in words."""
        margin = _ANGLE_MARGIN * (self.angle_deg[1] - self.angle_deg[0])
        outside = _beyond(angle_deg, self.angle_deg, margin)
        doubts = _said(outside, angle_deg, "the optical angle", "deg", ".2f", self.angle_deg)
        if line_v is not None and self.line_v is not None:
            line = np.asarray(line_v, np.float64)
            margin = _LINE_MARGIN_LINES if self.lines is None else _LINE_MARGIN * self.lines
            off = _beyond(line, self.line_v, margin)
            doubts += _said(off, line, "the line's place", "field lines", ".1f", self.line_v)
            outside = outside | off
        warm = self._temperature(temperature_k)
        if warm:
            outside = outside | np.isfinite(angle_deg)
        return outside, tuple(doubts + warm)

    def _temperature(self, temperature_k: float | None) -> list[str]:
        if self.temperature_k is None:
            return []
        low, high = self.temperature_k
        if temperature_k is None:
            one = f"the sweep was taken at {self.n_curves} temperatures and the point states none"
            return [one] if self.n_curves > 1 else []
        if low - SAME_TEMPERATURE_K <= temperature_k <= high + SAME_TEMPERATURE_K:
            return []
        here = f"the tunnel temperature is {temperature_k:.1f} K"
        return [f"{here}, {_from_to(low, high, '.1f')} K in the sweep"]


def _beyond(values: Floats, limits: tuple[float, float], margin: float) -> Bools:
    low, high = limits
    return np.asarray((values < low - margin) | (values > high + margin))


def _said(
    outside: Bools, values: Floats, what: str, unit: str, spec: str, limits: tuple[float, float]
) -> list[str]:
    if not outside.any():
        return []
    there = values[outside]
    of = f" in {int(outside.sum())} of {outside.size}" if outside.size > 1 else ""
    here = _from_to(float(there.min()), float(there.max()), spec)
    return [f"{what} is {here} {unit}{of}, {_from_to(*limits, spec)} in the sweep"]


def _from_to(low: float, high: float, spec: str) -> str:
    first, last = format(low, spec), format(high, spec)
    return first if first == last else f"{first} to {last}"
