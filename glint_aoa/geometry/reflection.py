"""The body's own axis from the line of its glint.

The glint is not paint. It is where the surface's normal bisects lamp and camera, and with both at
finite distance that place walks round a pitched body along its length: the glint is not parallel
to the axis, and a body that yaws or rises moves it too. With the body's radius and the lamp's
place known this is predicted, and undone, without a sweep.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from glint_aoa.errors import SetupError
from glint_aoa.geometry.collinearity import PixelToPlane
from glint_aoa.geometry.specular import Cylinder, glint_points
from glint_aoa.setup import Reflection

__all__ = ["AxisLine", "GlintPrediction", "GlintReflection"]

_Array = NDArray[np.float64]

_PLACES = 9  # along the line at which the glint is computed
_STEEPEST = float(np.tan(np.radians(14.0)))  # slope that the table reaches to
_DEGREES = (8, 4)  # of the table, in slope and in height
_ROUNDS = 20
_STEP = 1e-5  # rad and m, for derivatives
_CONVERGED = 1e-11  # rad and m
_LEAST_ALONG = 0.5  # cosine of the angle between lamp and body below which no line is mirrored


@dataclass(frozen=True)
class AxisLine:
    """The body's axis, one entry a field; every array has shape (field,) unless said.

    Attributes
    ----------
    pitch : ndarray
        Elevation of the axis, positive where it rises along the known plane's heading [rad].
    axis_intercept : ndarray
        Z of the axis at X = 0 [m].
    glint_intercept : ndarray
        Z of the glint at X = 0, there where it lies on the body and not on the known plane [m].
    sagitta : ndarray
        How far the predicted glint's middle lies above its ends, seen on the known plane [m].
    pitch_jacobian, axis_jacobian, glint_jacobian : ndarray, shape (field, 2)
        Derivatives of pitch [rad; rad/m] and of the two intercepts [m; 1] by the slope and by the
        intercept of the line that was measured.
    """

    pitch: _Array
    axis_intercept: _Array
    glint_intercept: _Array
    sagitta: _Array
    pitch_jacobian: _Array
    axis_jacobian: _Array
    glint_jacobian: _Array

    def stds(
        self, slope_var: _Array, intercept_var: _Array, covariance: _Array
    ) -> tuple[_Array, _Array, _Array]:
        """Propagate the noise of the lines that were measured.

        Parameters
        ----------
        slope_var, intercept_var, covariance : ndarray, shape (field,)
            Variances of slope [1] and intercept [m^2], and their covariance [m].

        Returns
        -------
        pitch_std, axis_std, glint_std : ndarray, shape (field,)
            Of the pitch [rad] and of the two intercepts [m], 1 sigma.
        """
        first, second, third = (
            np.sqrt(a**2 * slope_var + 2 * a * b * covariance + b**2 * intercept_var)
            for a, b in (each.T for each in self._jacobians)
        )
        return first, second, third

    @property
    def _jacobians(self) -> tuple[_Array, _Array, _Array]:
        return self.pitch_jacobian, self.axis_jacobian, self.glint_jacobian


@dataclass(frozen=True, eq=False)
class GlintPrediction:
    """What line the glint of a body of known attitude shows on the known plane.

    Attributes
    ----------
    reflection : Reflection
        Body and lamp.
    eye : ndarray, shape (3,)
        Perspective centre [m].
    yaw : float
        Heading of the body and of the known plane [rad].
    sight : ndarray, shape (place, 2)
        From the camera to places along the known plane, X and Y [m].
    to_line : ndarray, shape (3, place)
        From heights at the places to the fitted line's slope, its height at `middle` and its
        sagitta.
    middle : float
        Weighted mean of the columns' distance along the plane from X = 0 [m].
    """

    reflection: Reflection
    eye: _Array
    yaw: float
    sight: _Array
    to_line: _Array
    middle: float

    @classmethod
    def of_columns(
        cls, reflection: Reflection, to_plane: PixelToPlane, along: _Array, weight: _Array
    ) -> Self:
        """Prepare to predict lines that are fitted over given columns.

        Parameters
        ----------
        reflection : Reflection
            Body and lamp.
        to_plane : PixelToPlane
            The oriented camera and the known plane.
        along : ndarray, shape (column,)
            Distance along the known plane at which each column sees it [m].
        weight : ndarray, shape (column,)
            Weight of each column in the line.
        """
        eye, yaw = np.array(_checked(reflection, to_plane)), to_plane.yaw
        places, to_columns = _interpolation(along)
        middle = float(np.average(along, weights=weight))
        ground = places[:, None] * [np.cos(yaw), np.sin(yaw)] + [0.0, to_plane.y]
        return cls(
            reflection=reflection,
            eye=eye,
            yaw=yaw,
            sight=ground - eye[:2],
            to_line=_line_operator(along - middle, weight) @ to_columns,
            middle=middle,
        )

    def points(self, rise: ArrayLike, axis: ArrayLike) -> _Array:
        """Return the glint where it lies on the body.

        Parameters
        ----------
        rise, axis : array_like, shape (...)
            Elevation of the axis along the heading [rad], and its Z at X = 0 [m].

        Returns
        -------
        ndarray, shape (..., place + 1, 3)
            Tunnel X, Y, Z as seen at each place, and last at X = 0 [m]; NaN where the body
            mirrors nothing.
        """
        body = Cylinder.of_attitude(
            rise, axis, yaw=self.yaw, axis_y=self.reflection.axis_y, radius=self.reflection.radius
        )
        level = np.zeros(len(self.sight))
        upright = np.stack([self.sight[:, 1], -self.sight[:, 0], level], axis=-1)
        normal = np.concatenate([upright, [[1.0, 0.0, 0.0]]])
        offset = np.append(upright @ self.eye, 0.0)
        return glint_points(body, normal, offset, eye=self.eye, lamp=self.reflection)

    def seen(self, points: _Array) -> _Array:
        """Return the heights [m], shape (..., place), at which `points` show on the known plane."""
        away = points[..., :-1, :] - self.eye
        nearer = np.einsum("...px,px->...p", away[..., :2], self.sight)
        height: _Array = self.eye[2] + away[..., 2] * (self.sight**2).sum(axis=1) / nearer
        return height

    def line(self, rise: ArrayLike, axis: ArrayLike) -> _Array:
        """Return slope, height at `middle`, sagitta and true Z at X = 0 of the predicted glint.

        Parameters
        ----------
        rise, axis : array_like, shape (...)
            As for `points`.

        Returns
        -------
        ndarray, shape (4, ...)
            Slope [1] and lengths [m].
        """
        points = self.points(rise, axis)
        fitted = np.einsum("lp,...p->l...", self.to_line, self.seen(points))
        return np.concatenate([fitted, points[None, ..., -1, 2]])

    def attitude(self, slope: _Array, height: _Array) -> _Array:
        """Find the body whose predicted line is the measured one, by Newton's method.

        Parameters
        ----------
        slope, height : ndarray, shape (field,)
            The measured line's slope [1] and height at `middle` [m].

        Returns
        -------
        ndarray, shape (10, field)
            Elevation of the axis [rad], its Z at X = 0, the glint's, the sagitta [m]; then the
            derivatives of the first three by slope and by height, one after the other. NaN
            where no attitude explains the line.
        """
        rise, axis = np.arctan(slope), height - slope * self.middle - self.reflection.radius
        for _ in range(_ROUNDS):
            line, by_rise, by_axis = self._derivatives(rise, axis)
            inverse = _inverse(by_rise[:2], by_axis[:2])
            change = np.einsum("ijf,jf->if", inverse, np.stack([slope, height]) - line[:2])
            rise, axis = rise + change[0], axis + change[1]
            if np.nanmax(np.abs(change), initial=0.0) < _CONVERGED:
                break
        glint = by_rise[3] * inverse[0] + by_axis[3] * inverse[1]
        values = np.stack([rise, axis, line[3], line[2], *inverse[0], *inverse[1], *glint])
        return np.where(np.abs(change).max(axis=0) < _CONVERGED, values, np.nan)

    def _derivatives(self, rise: _Array, axis: _Array) -> tuple[_Array, _Array, _Array]:
        trials = _STEP * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])[..., None]
        line = self.line(rise + trials[:, 0], axis + trials[:, 1])
        here, rise_more, rise_less, axis_more, axis_less = line.transpose(1, 0, 2)
        return here, (rise_more - rise_less) / (2 * _STEP), (axis_more - axis_less) / (2 * _STEP)


@dataclass(frozen=True, eq=False)
class GlintReflection:
    """Turns lines that were fitted on the known plane into the body's axis.

    Attributes
    ----------
    prediction : GlintPrediction
        What line the glint of a body shows.
    heights : tuple of float
        Lowest and highest line at the columns' middle for which there is a table [m].
    table : ndarray, shape (10, 9, 5)
        Chebyshev coefficients over slope and height of what `GlintPrediction.attitude` returns.
    departure : ndarray, shape (column,)
        How far a level body's glint is predicted to depart from its line, seen on the known
        plane [m]. Taken off what was measured before the line is fitted, it keeps the line right
        where part of the columns is missing; nothing to speak of under a long lamp.
    """

    prediction: GlintPrediction
    heights: tuple[float, float]
    table: _Array
    departure: _Array

    @classmethod
    def of_window(
        cls,
        reflection: Reflection,
        to_plane: PixelToPlane,
        columns: _Array,
        lines: tuple[float, float],
        *,
        weight: _Array | None = None,
    ) -> Self:
        """Prepare for the fields of one recorded window.

        Parameters
        ----------
        reflection : Reflection
            Body and lamp.
        to_plane : PixelToPlane
            The oriented camera and the known plane on which lines are fitted.
        columns : ndarray, shape (column,)
            Sensor columns that lines are fitted over [pixels].
        lines : tuple of float
            First and last sensor line of the window [pixels].
        weight : ndarray, shape (column,), optional
            Weight of each column in the line; equal if not given.

        Raises
        ------
        SetupError
            If the camera has no place or does not see the known plane, a long lamp lies across the
            body, or the body does not mirror the lamp to where the camera looks.
        """
        weight = np.ones(columns.size) if weight is None else weight
        along, _ = to_plane(columns, np.full(columns.size, sum(lines) / 2))
        _, edges = to_plane(np.full(2, columns[columns.size // 2]), np.array(lines))
        if to_plane.position is not None and not np.isfinite([*along, *edges]).all():
            raise SetupError(
                "glint.reflection: the camera does not see the plane of glint.y in all columns; "
                "check position and rotation in [camera]"
            )
        prediction = GlintPrediction.of_columns(reflection, to_plane, along, weight)
        heights = (float(edges.min()), float(edges.max()))
        return cls(
            prediction=prediction,
            heights=heights,
            table=_tabulated(prediction, heights),
            departure=_departure(prediction, along, sum(heights) / 2),
        )

    def axis_line(self, slope: ArrayLike, intercept: ArrayLike) -> AxisLine:
        """Find the body's axis.

        The glint that a body of trial attitude would show is computed from the law of reflection,
        projected on the known plane and fitted with a line; the attitude whose line is the
        measured one is the answer. This was done beforehand for a grid of slopes and heights, and
        is read from a Chebyshev series, within 1e-6 deg of the full solution. Lines outside the
        grid (steeper than 14 deg, or with their middle out of the window) are solved in full.

        Parameters
        ----------
        slope, intercept : array_like, shape (field,)
            Lines fitted on the known plane: slope [1] and height at X = 0 [m].

        Returns
        -------
        AxisLine
            NaN where there is no line, and where no attitude explains it.

        Notes
        -----
        The body is a circular cylinder and the lamp a line or a point, see `glint_points`; of a
        nose or a tapered tail it is wrong by the taper. The yaw must be known.
        """
        slope, intercept = np.broadcast_arrays(
            np.atleast_1d(np.asarray(slope, np.float64)), np.asarray(intercept, np.float64)
        )
        middle, (low, high) = self.prediction.middle, self.heights
        height = intercept + slope * middle
        inside = (np.abs(slope) <= _STEEPEST) & (height >= low) & (height <= high)
        values = self._looked_up(slope, height)
        if not inside.all():
            values[:, ~inside] = np.nan
            outside = ~inside & np.isfinite(height)
            values[:, outside] = self.prediction.attitude(slope[outside], height[outside])
        values[4::2] += middle * values[5::2]  # by slope with the intercept held, not the middle
        return AxisLine(*values[:4], *values[4:].reshape(3, 2, -1).transpose(0, 2, 1))

    def _looked_up(self, slope: _Array, height: _Array) -> _Array:
        outputs, *sizes = self.table.shape
        low, high = self.heights
        in_slope = chebyshev.chebvander(slope / _STEEPEST, sizes[0] - 1)
        in_height = chebyshev.chebvander((2 * height - low - high) / (high - low), sizes[1] - 1)
        products = (in_slope[:, :, None] * in_height[:, None, :]).reshape(slope.size, -1)
        # not by matrix product, whose last bits would depend on how many fields come at once
        values: _Array = np.einsum("ot,ft->of", self.table.reshape(outputs, -1), products)
        values[0] += np.arctan(slope)
        values[1:3] += height - slope * self.prediction.middle
        return values


def _checked(reflection: Reflection, to_plane: PixelToPlane) -> tuple[float, float, float]:
    """Return the camera's place."""
    if to_plane.position is None:
        raise SetupError("glint.reflection needs the camera's place; give position in [camera]")
    direction = np.array(reflection.lamp_direction)
    heading = np.array([np.cos(to_plane.yaw), np.sin(to_plane.yaw), 0.0])
    share = abs(direction @ heading) / np.linalg.norm(direction)
    if reflection.lamp_shape == "long" and share < _LEAST_ALONG:
        raise SetupError(
            f"glint.reflection: the lamp runs {np.degrees(np.arccos(share)):.0f} deg off the body, "
            "and only a lamp along the body makes a line of light; correct lamp_direction, or give "
            'lamp_shape = "small"'
        )
    return to_plane.position


def _tabulated(prediction: GlintPrediction, heights: tuple[float, float]) -> _Array:
    x, y = (chebyshev.chebpts1(degree + 1) for degree in _DEGREES)
    low, high = heights
    slope, height = np.meshgrid(
        _STEEPEST * x, (low + high) / 2 + (high - low) / 2 * y, indexing="ij"
    )
    values = prediction.attitude(slope.ravel(), height.ravel()).reshape(-1, *slope.shape)
    if not np.isfinite(values).all():
        raise SetupError(
            "glint.reflection: the body does not mirror the lamp to where the camera looks; "
            "check radius, axis_y and lamp against the camera's position"
        )
    # What is known in closed form is not left to the series.
    values[0] -= np.arctan(slope)
    values[1:3] -= height - slope * prediction.middle
    to_slope, to_height = (
        np.linalg.inv(chebyshev.chebvander(nodes, nodes.size - 1)) for nodes in (x, y)
    )
    table: _Array = np.einsum("ij,ojk,lk->oil", to_slope, values, to_height)
    return table


def _departure(prediction: GlintPrediction, along: _Array, height: float) -> _Array:
    _, to_columns = _interpolation(along)
    rise, axis = prediction.attitude(np.zeros(1), np.array([height]))[:2]
    seen = prediction.seen(prediction.points(rise, axis))[0]
    slope, middle, _ = prediction.to_line @ seen
    departure: _Array = to_columns @ seen - middle - slope * (along - prediction.middle)
    return departure


def _interpolation(along: _Array) -> tuple[_Array, _Array]:
    """Return places that span the columns, and the matrix from values there to the columns."""
    low, high = along.min(), along.max()
    nodes = chebyshev.chebpts2(_PLACES)
    at_columns = chebyshev.chebvander((2 * along - low - high) / (high - low), _PLACES - 1)
    to_columns = at_columns @ np.linalg.inv(chebyshev.chebvander(nodes, _PLACES - 1))
    return (low + high) / 2 + (high - low) / 2 * nodes, to_columns


def _line_operator(s: _Array, weight: _Array) -> _Array:
    """Return the rows that take heights at columns to slope, height at s = 0, and sagitta."""
    root = np.sqrt(weight)
    powers = np.stack([s, np.ones(s.size), s**2], axis=1)
    straight = np.linalg.pinv(powers[:, :2] * root[:, None]) * root
    parabola = np.linalg.pinv(powers * root[:, None]) * root
    return np.concatenate([straight, -parabola[2:] * (np.ptp(s) / 2) ** 2])


def _inverse(first: _Array, second: _Array) -> _Array:
    """Invert 2 x 2 matrices given by columns, each of shape (2, field)."""
    determinant = first[0] * second[1] - first[1] * second[0]
    inverse: _Array = np.array([[second[1], -second[0]], [-first[1], first[0]]]) / determinant
    return inverse
