"""Where a circular cylinder mirrors a lamp into the camera: the law of reflection, solved.

The way from the camera to a point of the surface and on to the lamp is stationary where the
normal bisects the two directions (Fermat). Only that is used; nothing is traced.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glint_aoa.setup import Reflection

__all__ = ["Cylinder", "glint_points"]

_Array = NDArray[np.float64]

_ROUNDS = 30
_LARGEST_TURN = 0.3  # rad a round, so that a poor start does not throw the search behind the body
_CONVERGED = 1e-12


@dataclass(frozen=True, eq=False)
class Cylinder:
    """Endless circular cylinders, one for each attitude.

    Attributes
    ----------
    origin : ndarray, shape (..., 3)
        A point of the axis [m].
    axis, side, up : ndarray, shape (..., 3)
        Unit vectors along the axis, across it and level, and across it in its vertical plane.
    radius : float
        Radius [m].
    """

    origin: _Array
    axis: _Array
    side: _Array
    up: _Array
    radius: float

    @classmethod
    def of_attitude(
        cls, rise: ArrayLike, height: ArrayLike, *, yaw: float, axis_y: float, radius: float
    ) -> "Cylinder":
        """Place cylinders whose axes lie in a vertical plane of known heading.

        Parameters
        ----------
        rise : array_like, shape (...)
            Elevation of the axis, positive where it rises towards +X [rad].
        height : array_like, shape (...)
            Z of the axis at X = 0 [m].
        yaw : float
            Heading of the vertical plane, right-handed about tunnel Z [rad].
        axis_y : float
            Y of the axis at X = 0 [m].
        radius : float
            Radius [m].
        """
        rise, height = np.broadcast_arrays(*(np.asarray(a, np.float64) for a in (rise, height)))
        zero, level, steep = np.zeros(rise.shape), np.cos(rise), np.sin(rise)
        sin, cos = np.sin(yaw), np.cos(yaw)
        return cls(
            origin=np.stack([zero, zero + axis_y, height], axis=-1),
            axis=np.stack([level * cos, level * sin, steep], axis=-1),
            side=np.stack([zero - sin, zero + cos, zero], axis=-1),
            up=np.stack([-steep * cos, -steep * sin, level], axis=-1),
            radius=radius,
        )


def glint_points(
    body: Cylinder, normal: _Array, offset: _Array, *, eye: ArrayLike, lamp: Reflection
) -> _Array:
    r"""Find the glint's points in given planes.

    With :math:`\hat v` and :math:`\hat l` the unit vectors from the point to camera and lamp, the
    glint is where :math:`t (\hat v + \hat l) = 0` for the tangent t round the body. Under a long
    lamp also :math:`a (\hat v + \hat l) = 0` for the axis a, which says what place of the lamp is
    mirrored there. Under a small one only the first holds: on a surface that is not quite smooth
    it is the brightest point of the cross-section.

    Parameters
    ----------
    body : Cylinder
        Bodies, one for each attitude.
    normal, offset : ndarray, shape (plane, 3) and (plane,)
        Planes normal P = offset that the points shall lie in; they must not contain the axis.
    eye : array_like, shape (3,)
        Perspective centre of the camera [m].
    lamp : Reflection
        Place, direction and shape of the lamp. A long one is taken as endless: where its end is
        mirrored into view the glint fades, and leaves the line that is found here.

    Returns
    -------
    ndarray, shape (..., plane, 3)
        Tunnel X, Y, Z [m]; NaN where the body mirrors nothing into the camera.
    """
    search = _Search(body, normal, offset, np.asarray(eye, np.float64), lamp)
    with np.errstate(divide="ignore", invalid="ignore"):
        return search.points(*search.solve(*search.start()))


class _Search:
    """Newton's method for the turn round the axis [rad] and the place along the lamp [m]."""

    def __init__(
        self, body: Cylinder, normal: _Array, offset: _Array, eye: _Array, lamp: Reflection
    ) -> None:
        self._origin = body.origin[..., None, :]
        self._axis, self._side, self._up = (
            each[..., None, :] for each in (body.axis, body.side, body.up)
        )
        self._radius, self._eye = body.radius, eye
        self._lamp = np.array(lamp.lamp)
        self._along = np.array(lamp.lamp_direction) / np.linalg.norm(lamp.lamp_direction)
        self._moves = lamp.lamp_shape == "long"
        self._normal = normal
        self._to_plane = offset - _dot(normal, self._origin)
        self._per_station = _dot(normal, self._axis)

    def start(self) -> tuple[_Array, _Array]:
        """Begin on the bisector of the directions from the axis to camera and lamp."""
        foot = self._origin + (self._to_plane / self._per_station)[..., None] * self._axis
        place = _dot(foot - self._lamp, self._along) * self._moves
        source = self._lamp + place[..., None] * self._along
        middle = _across(self._eye - foot, self._axis) + _across(source - foot, self._axis)
        return np.arctan2(_dot(middle, self._side), _dot(middle, self._up)), place

    def solve(self, turn: _Array, place: _Array) -> tuple[_Array, _Array]:
        for _ in range(_ROUNDS):
            d_turn, d_place = self._step(turn, place)
            turn, place = turn - d_turn, place - d_place
            if np.nanmax(np.abs(d_turn), initial=0.0) < _CONVERGED:
                break
        return turn, place

    def points(self, turn: _Array, place: _Array) -> _Array:
        """Return the points, NaN where camera or lamp are behind the surface."""
        normal, _, point, _ = self._surface(turn)
        view, _ = _unit(self._eye - point)
        light, _ = _unit(self._lamp + place[..., None] * self._along - point)
        d_turn, _ = self._step(turn, place)
        good = (np.abs(d_turn) < _CONVERGED**0.5) & (_dot(normal, view) > 0)
        good &= _dot(normal, light) > 0
        return np.where(good[..., None], point, np.nan)

    def _surface(self, turn: _Array) -> tuple[_Array, _Array, _Array, _Array]:
        """Return normal, tangent round the body, point, and how the point moves in its plane."""
        cos, sin = np.cos(turn)[..., None], np.sin(turn)[..., None]
        normal = cos * self._up + sin * self._side
        tangent = cos * self._side - sin * self._up
        station = (self._to_plane - self._radius * _dot(self._normal, normal)) / self._per_station
        point = self._origin + station[..., None] * self._axis + self._radius * normal
        slip = self._radius * _dot(self._normal, tangent) / self._per_station
        return normal, tangent, point, self._radius * tangent - slip[..., None] * self._axis

    def _step(self, turn: _Array, place: _Array) -> tuple[_Array, _Array]:
        normal, tangent, point, motion = self._surface(turn)
        view, view_distance = _unit(self._eye - point)
        light, light_distance = _unit(self._lamp + place[..., None] * self._along - point)
        both = view + light
        turned = -_across(motion, view) / view_distance - _across(motion, light) / light_distance
        moved = _across(self._along, light) / light_distance
        round_miss = _dot(tangent, both)
        round_turn = _dot(tangent, turned) - _dot(normal, both)
        if not self._moves:
            return _limited(round_miss / round_turn), np.zeros_like(place)
        round_move = _dot(tangent, moved)
        axial_miss, axial_turn, axial_move = (
            _dot(self._axis, each) for each in (both, turned, moved)
        )
        determinant = round_turn * axial_move - round_move * axial_turn
        d_turn = (round_miss * axial_move - round_move * axial_miss) / determinant
        d_place = (round_turn * axial_miss - axial_turn * round_miss) / determinant
        return _limited(d_turn), d_place


def _limited(turn: _Array) -> _Array:
    return np.clip(turn, -_LARGEST_TURN, _LARGEST_TURN)


def _dot(a: _Array, b: _Array) -> _Array:
    product: _Array = np.einsum("...i,...i->...", a, b)
    return product


def _unit(vector: _Array) -> tuple[_Array, _Array]:
    length = np.sqrt(_dot(vector, vector))[..., None]
    return vector / length, length


def _across(vector: _Array, unit: _Array) -> _Array:
    """Part of a vector across a unit vector."""
    return vector - _dot(vector, unit)[..., None] * unit
