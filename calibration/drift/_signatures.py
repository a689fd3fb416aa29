"""What a small change of camera, lamp or model does to the optical angle and to the intercept.

Every change is made in space: the line, or the glint that a lamp makes on the body, is projected
by the changed camera and measured by the setup that does not know of it. Differences of the two
sides of a small step give the derivative; nothing is linearised by hand.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glint_aoa.geometry import GlintPrediction, PixelToPlane
from glint_aoa.setup import Camera, Reflection, Setup

__all__ = ["Signature", "SignatureModel"]

Floats = NDArray[np.float64]

_PLACES = 15  # along the line
_STEP = 1e-4  # rad and m
_AXIS_ROUNDS = 12
_MM, _DEG = 1e3, float(np.degrees(1.0))


class Signature(NamedTuple):
    """What one unit of a change does; arrays have shape (point,).

    Attributes
    ----------
    angle_deg : ndarray
        Change of the optical angle before calibration [deg].
    intercept_mm : ndarray
        Change of the line's Z at X = 0 [mm].
    mark : ndarray, shape (2,)
        Change of the reference mark's row and column [pixels]; its box must be far from the
        camera compared with what the camera moves.
    """

    angle_deg: Floats
    intercept_mm: Floats
    mark: Floats


@dataclass(frozen=True, eq=False)
class SignatureModel:
    """The scene as the setup has it, for points at given angles.

    Attributes
    ----------
    setup : Setup
        An oriented camera; with ``[glint.reflection]`` also lamp and body.
    angle_deg : ndarray, shape (point,)
        Optical angle before calibration [deg].
    intercept_mm : ndarray, shape (point,)
        Intercept [mm].
    columns : tuple of float
        First and last sensor column measured.
    mark : tuple of float or None
        Sensor line and column of the reference mark.
    """

    setup: Setup
    angle_deg: Floats
    intercept_mm: Floats
    columns: tuple[float, float]
    mark: tuple[float, float] | None = None

    def camera_turned(self, axis: int) -> Signature:
        """Return what a degree of omega, phi or kappa (axis 0, 1, 2) does."""
        return self._of_camera("rotation", axis, 1 / _DEG)

    def camera_moved(self, axis: int) -> Signature:
        """Return what a millimetre of the camera along X, Y or Z (axis 0, 1, 2) does."""
        return self._of_camera("position", axis, 1 / _MM)

    def model_raised(self) -> Signature:
        """Return what a millimetre of the model upwards does."""
        return self._derivative(lambda step: self._seen(raised=step), 1 / _MM)

    def lamp_moved(self, axis: int) -> Signature:
        """Return what a millimetre of the lamp along X, Y or Z (axis 0, 1, 2) does."""
        lamp = self._reflection.lamp

        def moved(step: float) -> tuple[Floats, Floats]:
            place = tuple(each + step * (k == axis) for k, each in enumerate(lamp))
            return self._seen(reflection=self._reflection.model_copy(update={"lamp": place}))

        return self._derivative(moved, 1 / _MM)

    @property
    def knows_lamp(self) -> bool:
        """Whether the setup says where the lamp is."""
        return self.setup.glint.reflection is not None

    @property
    def _reflection(self) -> Reflection:
        reflection = self.setup.glint.reflection
        if reflection is None:
            raise ValueError("the setup has no [glint.reflection]")
        return reflection

    def _of_camera(self, key: str, axis: int, unit: float) -> Signature:
        def changed(step: float) -> Camera:
            camera = self.setup.camera
            values = getattr(camera, key)
            moved = tuple(each + step * (k == axis) for k, each in enumerate(values))
            return camera.model_copy(update={key: moved})

        seen = self._derivative(lambda step: self._seen(camera=changed(step)), unit)
        marks = [self._mark_seen(changed(step), turned=key == "rotation") for step in _SIDES]
        return seen._replace(mark=(marks[0] - marks[1]) / (2 * _STEP) * unit)

    def _derivative(self, seen: Callable[[float], tuple[Floats, Floats]], unit: float) -> Signature:
        more, less = (np.array(seen(step)) for step in _SIDES)
        angle, intercept = (more - less) / (2 * _STEP) * unit
        return Signature(angle * _DEG, intercept * _MM, np.zeros(2))

    def _seen(
        self,
        *,
        camera: Camera | None = None,
        reflection: Reflection | None = None,
        raised: float = 0.0,
    ) -> tuple[Floats, Floats]:
        """Return angle [rad] and intercept [m] that the setup makes of a changed scene."""
        true = self._plane(camera or self.setup.camera)
        if self.knows_lamp:
            points = self._glint(true, reflection or self._reflection, raised)
        else:
            points = self._painted(raised)
        along, height = self._plane(self.setup.camera)(*true.project(points))
        spread = along - along.mean(axis=1, keepdims=True)
        slope = (spread * height).sum(axis=1) / (spread**2).sum(axis=1)
        middle = height.mean(axis=1) - slope * along.mean(axis=1)
        if self.knows_lamp:
            return self._attitude(slope, middle)
        return self._sign * np.arctan(slope), middle

    def _plane(self, camera: Camera) -> PixelToPlane:
        glint = self.setup.glint
        return PixelToPlane.of_camera(camera, y=glint.y, yaw=glint.yaw)

    @property
    def _sign(self) -> int:
        return self.setup.glint.nose_sign

    def _places(self, plane: PixelToPlane) -> Floats:
        """Distances along the known plane at which columns see it, for a typical line [m]."""
        height = float(np.mean(self.intercept_mm)) / _MM
        _, v = plane.to_pixels(0.0, height)
        columns = np.linspace(*self.columns, _PLACES)
        return plane(columns, np.full(_PLACES, v))[0]

    def _painted(self, raised: float) -> Floats:
        """Points [point, place, 3] of a line painted on the known plane [m]."""
        along = self._places(self._plane(self.setup.camera))
        slope = self._sign * np.tan(np.radians(self.angle_deg))
        height = self.intercept_mm[:, None] / _MM + raised + slope[:, None] * along
        heading = self.setup.glint.yaw
        x = np.broadcast_to(along * np.cos(heading), height.shape)
        y = np.broadcast_to(self.setup.glint.y + along * np.sin(heading), height.shape)
        return np.stack([x, y, height], axis=-1)

    def _predict(self, plane: PixelToPlane, reflection: Reflection) -> GlintPrediction:
        along = self._places(plane)
        return GlintPrediction.of_columns(reflection, plane, along, np.ones(along.size))

    def _glint(self, plane: PixelToPlane, reflection: Reflection, raised: float) -> Floats:
        """Points [point, place, 3] of the lamp's mirror image on the body [m]."""
        points = self._predict(plane, reflection).points(self._rise, self._axis + raised)
        return points[..., :-1, :]

    @property
    def _rise(self) -> Floats:
        return np.asarray(self._sign * np.radians(self.angle_deg), np.float64)

    @cached_property
    def _as_set_up(self) -> GlintPrediction:
        return self._predict(self._plane(self.setup.camera), self._reflection)

    @cached_property
    def _axis(self) -> Floats:
        """Heights of the body's axis at X = 0 whose glint has the intercept there [m]."""
        wanted = self.intercept_mm / _MM
        axis = wanted - self._reflection.radius
        for _ in range(_AXIS_ROUNDS):
            axis = axis + wanted - self._as_set_up.line(self._rise, axis)[3]
        return axis

    def _attitude(self, slope: Floats, intercept: Floats) -> tuple[Floats, Floats]:
        middle = intercept + slope * self._as_set_up.middle
        rise, _, glint, *_ = self._as_set_up.attitude(slope, middle)
        return self._sign * rise, glint

    def _mark_seen(self, camera: Camera, *, turned: bool) -> Floats:
        """Return the row and column [pixels] at which a far mark shows; zeros without one."""
        if self.mark is None or not turned:
            return np.zeros(2)
        row, column = self.mark
        plane = self._plane(self.setup.camera)
        (along,), (height,) = plane(np.array([column]), np.array([row]))
        heading = self.setup.glint.yaw
        place = [
            along * np.cos(heading),
            self.setup.glint.y + along * np.sin(heading),
            height,
        ]
        u, v = self._plane(camera).project(np.array(place))
        return np.array([float(v), float(u)])


_SIDES = (_STEP, -_STEP)
