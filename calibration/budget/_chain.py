"""The way from pixels of a line to its angle, for any geometry: the measurement's own steps."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.budget._parameters import geometry_vector, on_planes, reflection_of, to_plane
from glint_aoa.errors import CalibrationError
from glint_aoa.geometry import GlintPrediction
from glint_aoa.optical.line import fit_lines
from glint_aoa.setup import Reflection, Setup

__all__ = ["Chain", "middle_of"]

Floats = NDArray[np.float64]

_ROUNDS = 30
_SAME_ROW = 1e-10  # lines
_SAME_HEIGHT = 1e-12  # m
_STEP = 1e-3  # lines


class _PlaneLines(NamedTuple):
    """Straight lines on the known plane: slope and height at X = 0 [m], as [line]."""

    slope: Floats
    intercept: Floats


@dataclass(frozen=True, eq=False)
class Chain:
    """What turns pixels into an angle before a pitch sweep is applied.

    Attributes
    ----------
    u, std : ndarray [column]
        Sensor columns that are measured [pixels], and the noise of each one's centre, up to a
        factor; infinite for a column that does not count in the line.
    geometry : ndarray [parameter]
        The setup's geometry; see `PARAMETERS`.
    nose_sign : int
        +1 for a nose that points right.
    reflection : Reflection or None
        Body and lamp, where the setup describes them.
    """

    u: Floats
    std: Floats
    geometry: Floats
    nose_sign: int
    reflection: Reflection | None

    @classmethod
    def of_setup(cls, setup: Setup, u: ArrayLike, *, std: ArrayLike | None = None) -> Self:
        """Prepare for lines that are measured in given columns.

        Parameters
        ----------
        setup : Setup
            A setup whose camera is oriented.
        u, std : array_like [column]
            As the attributes; the same noise in all if not given.
        """
        u = np.asarray(u, np.float64)
        return cls(
            u=u,
            std=np.ones(u.size) if std is None else np.asarray(std, np.float64),
            geometry=geometry_vector(setup),
            nose_sign=setup.glint.nose_sign,
            reflection=setup.glint.reflection,
        )

    def angles(self, v: Floats, geometries: Floats) -> Floats:
        """Return the angles [rad] of lines for given geometries, as [draw, line].

        Parameters
        ----------
        v : ndarray [draw, line, column]
            Sensor lines at which each line crosses the columns [pixels].
        geometries : ndarray [draw, parameter]
            The geometries.
        """
        s, z = on_planes(geometries, self.u, v)
        fit = fit_lines(s.reshape(-1, self.u.size), z.reshape(-1, self.u.size), self.std)
        slope, intercept = (each.reshape(v.shape[:2]) for each in (fit.slope, fit.intercept))
        if self.reflection is None:
            return np.asarray(self.nose_sign * np.arctan(slope))
        rises = [self._rise(*each) for each in zip(geometries, s, slope, intercept, strict=True)]
        return self.nose_sign * np.array(rises)

    def _rise(self, geometry: Floats, s: Floats, slope: Floats, intercept: Floats) -> Floats:
        """Return the rise of the bodies [rad] whose glints are given lines, as [line]."""
        prediction = self._prediction(geometry, s.mean(axis=0))
        height = intercept + slope * prediction.middle
        return np.asarray(prediction.attitude(slope, height)[0])

    def pixels(self, angle: ArrayLike, intercept: ArrayLike) -> Floats:
        """Return the sensor lines [line, column] at which glints cross the columns [pixels].

        Parameters
        ----------
        angle, intercept : array_like [line]
            Angles before a pitch sweep is applied [rad], and the glints' Z at X = 0 [m].

        Returns
        -------
        ndarray [line, column]
            NaN for a line that the camera does not see in all columns.
        """
        angle, intercept = np.broadcast_arrays(
            np.atleast_1d(np.asarray(angle, np.float64)), np.asarray(intercept, np.float64)
        )
        with np.errstate(all="ignore"):
            return self._rows(self._plane_lines(angle, intercept))

    def check_seen(self, v: Floats) -> Floats:
        """Return `v`, or raise CalibrationError if it has a line that the camera does not see."""
        if not np.isfinite(v).all():
            raise CalibrationError(
                "the camera of the setup does not see such a line in all columns; check position "
                "and rotation in [camera], the angles and the intercepts"
            )
        return v

    def intercepts(self, angle: ArrayLike, row: float) -> Floats:
        """Return Z at X = 0 [m], as [line], of glints that cross the picture's middle at a line.

        Parameters
        ----------
        angle : array_like [line]
            Angles before a pitch sweep is applied [rad].
        row : float
            Sensor line at the middle of the columns [pixels].
        """
        angle = np.atleast_1d(np.asarray(angle, np.float64))
        plane = to_plane(self.geometry)
        s, z = plane(np.array([(self.u[0] + self.u[-1]) / 2]), np.array([row]))
        self.check_seen(s)
        if self.reflection is None:
            slope = np.tan(self.nose_sign * angle)
            return np.asarray(z - slope * s)
        prediction = self._nominal_prediction()
        axis = self._axes(prediction, angle, np.broadcast_to(z, angle.shape), row=1)
        glint: Floats = prediction.line(self.nose_sign * angle, axis)[3]
        return glint

    def noise(self, v: Floats) -> Floats:
        """Return the derivative of the angles by the columns' lines [rad / line].

        Parameters
        ----------
        v : ndarray [line, column]
            Sensor lines [pixels].

        Returns
        -------
        ndarray [line]
            Square root of the summed squares over the columns: it turns the noise of one
            column's centre into that of the angle.
        """
        s, z = to_plane(self.geometry)(self.u, v)
        weight = self.std**-2.0
        fit, share = fit_lines(s, z, self.std), weight / weight.sum()
        middle = (s @ share)[:, None]
        spread = ((s - middle) ** 2 @ share)[:, None]
        off_line = self._off_line(v, fit.slope)
        on_slope = off_line * share * (s - middle) / spread
        if self.reflection is None:
            return _root_sum(on_slope) / (1 + fit.slope**2)
        prediction = self._prediction(self.geometry, s.mean(axis=0))
        on_height = off_line * share + on_slope * (prediction.middle - middle)
        height = fit.intercept + fit.slope * prediction.middle
        by_slope, by_height = prediction.attitude(fit.slope, height)[4:6]
        return _root_sum(by_slope[:, None] * on_slope + by_height[:, None] * on_height)

    def _off_line(self, v: Floats, slope: Floats) -> Floats:
        """Height over the line that a column gains by a line [m / line]; along it none."""
        plane = to_plane(self.geometry)
        more, less = (plane(self.u, v + step) for step in (_STEP, -_STEP))
        ds, dz = ((a - b) / (2 * _STEP) for a, b in zip(more, less, strict=True))
        return np.asarray(dz - slope[:, None] * ds)

    def _plane_lines(self, angle: Floats, intercept: Floats) -> _PlaneLines:
        if self.reflection is None:
            return _PlaneLines(np.tan(self.nose_sign * angle), intercept)
        prediction = self._nominal_prediction()
        axis = self._axes(prediction, angle, intercept, row=3)
        slope, height, _, _ = prediction.line(self.nose_sign * angle, axis)
        return _PlaneLines(slope, height - slope * prediction.middle)

    def _axes(
        self, prediction: GlintPrediction, angle: Floats, target: Floats, *, row: int
    ) -> Floats:
        """Find the height of the body's axis at which a row of `prediction.line` has a value."""
        assert self.reflection is not None
        axis = target - self.reflection.radius
        for _ in range(_ROUNDS):
            miss = target - prediction.line(self.nose_sign * angle, axis)[row]
            axis = axis + miss
            if np.nanmax(np.abs(miss), initial=0.0) < _SAME_HEIGHT:
                break
        return axis

    def _rows(self, lines: _PlaneLines) -> Floats:
        """Find by Newton's method where lines of the known plane cross the columns."""
        plane = to_plane(self.geometry)
        slope, intercept = (each[:, None] for each in lines)
        v = np.full((slope.size, self.u.size), self.geometry[4])
        for _ in range(_ROUNDS):
            s, z = plane(self.u, v)
            s_more, z_more = plane(self.u, v + _STEP)
            miss = z - slope * s - intercept
            change = miss * _STEP / (z_more - slope * s_more - intercept - miss)
            v = v - change
            if np.nanmax(np.abs(change), initial=0.0) < _SAME_ROW:
                break
        seen = (np.abs(change) < _SAME_ROW).all(axis=1, keepdims=True)
        return np.where(seen, v, np.nan)

    def _nominal_prediction(self) -> GlintPrediction:
        s, _ = to_plane(self.geometry)(self.u, np.full(self.u.size, self.geometry[4]))
        self.check_seen(s)
        return self._prediction(self.geometry, s)

    def _prediction(self, geometry: Floats, along: Floats) -> GlintPrediction:
        assert self.reflection is not None
        reflection = reflection_of(geometry, self.reflection)
        return GlintPrediction.of_columns(reflection, to_plane(geometry), along, self.std**-2.0)


def _root_sum(values: Floats) -> Floats:
    return np.asarray(np.sqrt((values**2).sum(axis=1)))


def middle_of(v: Floats) -> Floats:
    """Return the sensor lines [line] of lines [line, column] in the middle of the columns."""
    last = v.shape[1] - 1
    return np.asarray((v[:, last // 2] + v[:, last - last // 2]) / 2)
