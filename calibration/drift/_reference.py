"""What a sweep says of the line's height, of the support's setting and of the reference mark."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.sweep.curve import SweepCurve
from calibration.sweep.pitch_sweep import PitchSweep
from calibration.sweep.point import SweepPoint
from calibration.sweep.temperatures import TemperatureWeights

__all__ = ["SUPPORT_STD_DEG", "SweepReference"]

Floats = NDArray[np.float64]

SUPPORT_STD_DEG = 0.005
"""How well a support finds a setting again, on another day and each time, 1 sigma [deg]."""

_LEAST_POINTS = 5
_INTERCEPT_DEGREE = 2
_LEAST_STD_MM, _LEAST_STD_PX, _LEAST_STD_DEG = 0.002, 0.01, 0.0005


@dataclass(frozen=True, eq=False)
class _Curve:
    """A polynomial of the onboard angle, its covariance, and the points' scatter about it."""

    coefficients: Floats
    covariance: Floats
    scatter: float

    @classmethod
    def fitted(cls, angle: Floats, values: Floats, degree: int, least_std: float) -> "_Curve":
        powers = np.polynomial.polynomial.polyvander(angle, degree)
        inverse = np.linalg.inv(powers.T @ powers)
        coefficients = np.asarray(np.linalg.lstsq(powers, values, rcond=None)[0], np.float64)
        left = values - powers @ coefficients
        scatter = max(float(np.sqrt(left @ left / (angle.size - degree - 1))), least_std)
        return cls(coefficients, np.asarray(scatter**2 * inverse, np.float64), scatter)

    def at(self, angle: Floats) -> tuple[Floats, Floats]:
        """Return values [point] and their covariance [point, point], scatter not included."""
        powers = np.polynomial.polynomial.polyvander(angle, self.coefficients.size - 1)
        return powers @ self.coefficients, powers @ self.covariance @ powers.T


@dataclass(frozen=True, eq=False)
class SweepReference:
    """Curves of what was seen beside the angle, one for each of the sweep's own curves.

    Attributes
    ----------
    temperatures_k : ndarray, shape (curve,)
        Temperatures of the sweep's curves [K]; NaN where unknown.
    curves : dict of str to list
        By kind: ``"intercept"`` [mm], ``"support"`` (onboard less nominal angle) [deg], ``"row"``
        and ``"column"`` of the mark [pixels]; each only if all of the sweep's curves have it.
    """

    temperatures_k: Floats
    curves: dict[str, list[_Curve]]

    @classmethod
    def of(cls, sweep: PitchSweep) -> "SweepReference":
        """Learn what the sweep's points say."""
        kinds = {
            "intercept": (_INTERCEPT_DEGREE, _LEAST_STD_MM),
            "support": (1, _LEAST_STD_DEG),
            "row": (0, _LEAST_STD_PX),
            "column": (0, _LEAST_STD_PX),
        }
        found = {
            kind: [_learnt(curve, kind, *how) for curve in sweep.curves]
            for kind, how in kinds.items()
        }
        whole = {
            kind: [each for each in curves if each is not None]
            for kind, curves in found.items()
            if None not in curves
        }
        return cls(sweep.temperatures_k, whole)

    def shifts(self, points: Sequence[SweepPoint]) -> dict[str, tuple[Floats, Floats]]:
        """Return how far points lie from the curves, and the covariance of that, by kind."""
        angle = np.array([point.onboard_deg for point in points])
        found = {}
        for kind, curves in self.curves.items():
            values = [_value(point, kind) for point in points]
            if None in values:
                continue
            expected, covariance = self._expected(curves, angle, points)
            noise = np.array([_noise(point, kind) for point in points])
            covariance[np.diag_indices(angle.size)] += noise**2
            if kind == "support":
                covariance += SUPPORT_STD_DEG**2 * (1 + np.eye(angle.size))
            found[kind] = (np.array(values, np.float64) - expected, covariance)
        return found

    def _expected(
        self, curves: Sequence[_Curve], angle: Floats, points: Sequence[SweepPoint]
    ) -> tuple[Floats, Floats]:
        """Values and covariance at the points' temperatures, the scatter of single points in it."""
        weights = np.array([self._weights(point.temperature_k) for point in points])
        expected, covariance = np.zeros(angle.size), np.zeros((angle.size, angle.size))
        for number, curve in enumerate(curves):
            share = weights[:, number]
            values, own = curve.at(angle)
            expected += share * values
            covariance += np.outer(share, share) * own + np.diag(share * curve.scatter**2)
        return expected, covariance

    def _weights(self, temperature_k: float | None) -> Floats:
        count = self.temperatures_k.size
        if count == 1 or temperature_k is None:
            return np.full(count, 1 / count)
        return TemperatureWeights.at(temperature_k, self.temperatures_k).straight


def _learnt(curve: SweepCurve, kind: str, degree: int, least_std: float) -> _Curve | None:
    pairs = [(point.onboard_deg, _value(point, kind)) for point in curve.points]
    known = np.array([(x, y) for x, y in pairs if y is not None], np.float64).reshape(-1, 2)
    if len(known) < _LEAST_POINTS:
        return None
    return _Curve.fitted(known[:, 0], known[:, 1], degree, least_std)


def _value(point: SweepPoint, kind: str) -> float | None:
    if kind == "support":
        nominal = point.nominal_deg
        return None if nominal is None else point.onboard_deg - nominal
    return {
        "intercept": point.intercept_mm,
        "row": point.mark_row,
        "column": point.mark_column,
    }[kind]


def _noise(point: SweepPoint, kind: str) -> float:
    if kind == "support":
        return point.onboard_std_deg
    return (point.intercept_std_mm or 0.0) if kind == "intercept" else 0.0
