"""The calibrated angle as a function of the geometry: the sweep is fitted again with each one."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from calibration.budget._chain import Chain
from calibration.budget._inputs import InputBlock
from calibration.budget._parameters import PARAMETERS
from calibration.sweep.fit import PitchSweep, SweepCurve

__all__ = ["AngleModel", "Angles", "Recalibration"]

Floats = NDArray[np.float64]

_ROUNDING_DEG = 1e-11
_STEP = np.array([each.step for each in PARAMETERS])
_NUMBER = {each.name: number for number, each in enumerate(PARAMETERS)}


class Angles(NamedTuple):
    """Angles [deg] of lines, as [line] or with one more axis in front: before and after a sweep."""

    raw_deg: Floats
    calibrated_deg: Floats


@dataclass(frozen=True, eq=False)
class Recalibration:
    """A pitch sweep whose optical angles come out otherwise with another geometry.

    Attributes
    ----------
    sweep : PitchSweep
        The sweep as it was fitted with the setup's geometry.
    temperature_k : float or None
        Tunnel temperature at which it is applied [K].
    v : ndarray [point, column]
        Where the lines of its points, curve by curve, cross the columns [pixels].
    """

    sweep: PitchSweep
    temperature_k: float | None
    v: Floats

    @classmethod
    def of(
        cls, sweep: PitchSweep, chain: Chain, *, row: float, temperature_k: float | None = None
    ) -> Self:
        """Place the sweep's lines where its file says that they were.

        Parameters
        ----------
        sweep : PitchSweep
            The sweep.
        chain : Chain
            From pixels to its optical angles.
        row : float
            Sensor line at which the lines of points without a known place cross the middle of
            the columns [pixels].
        temperature_k : float, optional
            As the attribute.
        """
        angle = np.radians([point.optical_deg for point in sweep.points])
        intercept = chain.intercepts(angle, row)
        for number, point in enumerate(sweep.points):
            if point.intercept_mm is not None:
                intercept[number] = point.intercept_mm / 1e3
        return cls(sweep, temperature_k, chain.check_seen(chain.pixels(angle, intercept)))

    def apply(self, raw_deg: Floats, points_deg: Floats) -> Floats:
        """Calibrate angles by the sweep that is fitted to other optical angles of its points.

        A curve changes by what least squares make of the change of the residuals, each weighted
        by its stated uncertainty; with the angles that the sweep was fitted to it stays as it is.

        Parameters
        ----------
        raw_deg : ndarray [..., line]
            Angles before calibration [deg].
        points_deg : ndarray [..., point]
            Optical angles of the sweep's points, with the same geometry [deg].
        """
        calibrated = self.sweep.predict(raw_deg, temperature_k=self.temperature_k)
        first = 0
        for part in self._parts:
            moved = points_deg[..., first : first + part.weight.size]
            change = part.residual_fit(moved) - part.fitted
            calibrated = calibrated + part.share * np.einsum(
                "...lk,...k->...l", part.curve.powers(raw_deg), change
            )
            first += part.weight.size
        return np.asarray(calibrated)

    @cached_property
    def _parts(self) -> list["_Part"]:
        parts = []
        for number, curve in enumerate(self.sweep.curves):
            std = np.array([self.sweep.residual_std_deg(point) for point in curve.points])
            part = _Part(curve, 1 / std, self._share(number), np.zeros(curve.degree + 1))
            optical = np.array([point.optical_deg for point in curve.points])
            parts.append(replace(part, fitted=part.residual_fit(optical)))
        return parts

    def _share(self, number: int) -> float:
        """Return what a curve counts at the temperature: by how much it raises the whole."""
        curves = list(self.sweep.curves)
        up = np.eye(curves[number].degree + 1)[0]
        curves[number] = replace(
            curves[number], coefficients_deg=curves[number].coefficients_deg + up
        )
        raised = replace(self.sweep, curves=tuple(curves))
        here = curves[number].centre_deg
        whole, before = (
            each.predict(here, temperature_k=self.temperature_k) for each in (raised, self.sweep)
        )
        return float(whole - before)


@dataclass(frozen=True, eq=False)
class _Part:
    """A curve of the sweep: its points' weights, its share, and the fit of its own residuals."""

    curve: SweepCurve
    weight: Floats
    share: float
    fitted: Floats

    def residual_fit(self, optical_deg: Floats) -> Floats:
        """Fit what the curve leaves of other optical angles [..., point]: [..., degree + 1]."""
        onboard = np.array([point.onboard_deg for point in self.curve.points])
        residual = (onboard - self.curve.predict(optical_deg)) * self.weight
        powers = self.curve.powers(optical_deg) * self.weight[:, None]
        return np.asarray(np.einsum("...kp,...p->...k", np.linalg.pinv(powers), residual))


@dataclass(frozen=True, eq=False)
class AngleModel:
    """From the geometry to the angles of certain lines.

    Attributes
    ----------
    chain : Chain
        From pixels to angles before calibration.
    recalibration : Recalibration or None
        The pitch sweep, where one is applied.
    v : ndarray [line, column]
        Where the lines cross the columns [pixels].
    """

    chain: Chain
    recalibration: Recalibration | None
    v: Floats

    def angles(self, geometries: Floats, v: Floats | None = None) -> Angles:
        """Return the angles of the lines for given geometries, as [draw, line].

        Parameters
        ----------
        geometries : ndarray [draw, parameter]
            The geometries.
        v : ndarray [draw, line, column], optional
            Other pixels than those of the attribute; those of the sweep stay.
        """
        draws, n_lines = len(geometries), len(self.v)
        v = np.broadcast_to(self.v, (draws, *self.v.shape)) if v is None else v
        if self.recalibration is None:
            raw = np.degrees(self.chain.angles(v, geometries))
            return Angles(raw, raw)
        points = np.broadcast_to(self.recalibration.v, (draws, *self.recalibration.v.shape))
        both = np.degrees(self.chain.angles(np.concatenate([v, points], axis=1), geometries))
        raw = both[:, :n_lines]
        return Angles(raw, self.recalibration.apply(raw, both[:, n_lines:]))

    def sensitivities(self, block: InputBlock) -> Angles:
        """Differentiate the angles by the inputs of a block.

        Parameters
        ----------
        block : InputBlock
            The inputs; the geometry follows them by the block's response.

        Returns
        -------
        Angles
            Derivatives [input, line] by central differences, degrees per SI unit or radian.
        """
        numbers = [_NUMBER[name] for name in block.parameters]
        steps = _STEP[numbers, None]
        moved = self.chain.geometry + steps * block.response.T
        back = self.chain.geometry - steps * block.response.T
        changes = np.subtract(self.angles(moved), self.angles(back))
        changes[np.abs(changes) < _ROUNDING_DEG] = 0.0
        return Angles(*(changes / (2 * steps)))
