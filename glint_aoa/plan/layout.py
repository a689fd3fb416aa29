"""Where camera and lamp stand, and what the recorded window is: one layout of a test."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import SetupError
from glint_aoa.geometry.camera import rotation_matrix
from glint_aoa.geometry.collinearity import PixelToPlane
from glint_aoa.optical.columns import used_columns
from glint_aoa.setup import Camera, Reflection, Setup

__all__ = ["Layout", "check_setup"]

_Array = NDArray[np.float64]


@dataclass(frozen=True)
class Layout:
    """One place of camera and lamp.

    Attributes
    ----------
    camera : Camera
        An oriented camera that says what sensor it has.
    reflection : Reflection
        Body and lamp.
    y, yaw : float
        The known plane [m, rad].
    first_line, lines : int
        The recorded window on the sensor [lines].
    column_step : int
        Every how many columns are measured.
    """

    camera: Camera
    reflection: Reflection
    y: float
    yaw: float
    first_line: int
    lines: int
    column_step: int

    @classmethod
    def of_setup(cls, setup: Setup) -> Self:
        """Return the layout that a setup describes.

        Raises
        ------
        SetupError
            If the setup does not say enough for a plan.
        """
        reflection = check_setup(setup)
        first, lines = _window(setup)
        layout = cls(
            camera=setup.camera,
            reflection=reflection,
            y=setup.glint.y,
            yaw=setup.glint.yaw,
            first_line=first,
            lines=lines,
            column_step=setup.glint.column_step,
        )
        layout.aim()  # refuses a camera that looks elsewhere
        return layout

    @property
    def plane(self) -> PixelToPlane:
        """The camera's mapping to the known plane."""
        return PixelToPlane.of_camera(self.camera, y=self.y, yaw=self.yaw)

    @property
    def columns(self) -> _Array:
        """Sensor columns that are measured [pixels]."""
        return used_columns(self._sensor[0], self.column_step).astype(np.float64)

    @property
    def lamp_yz(self) -> tuple[float, float]:
        """Y and Z of the lamp's middle [m]."""
        return self.reflection.lamp[1], self.reflection.lamp[2]

    @property
    def focal_length(self) -> float:
        """Principal distance [m]."""
        assert self.camera.focal_length is not None
        return self.camera.focal_length

    def aim(self) -> _Array:
        """Return where the optical axis meets the known plane, tunnel X, Y, Z [m], shape (3,).

        Raises
        ------
        SetupError
            If it does not.
        """
        eye, axis = self._eye, self._optical_axis
        across = np.array([-np.sin(self.yaw), np.cos(self.yaw), 0.0])
        depth = (across @ (np.array([0.0, self.y, 0.0]) - eye)) / (across @ axis)
        if not (np.isfinite(depth) and depth > 0):
            raise SetupError(
                "the camera does not look at the plane of glint.y; check position and rotation "
                "in [camera]"
            )
        return np.asarray(eye + depth * axis)

    @property
    def distance(self) -> float:
        """From the camera along its optical axis to the known plane [m]."""
        return float(np.linalg.norm(self.aim() - self._eye))

    def moved(self, *, distance: float, lamp_y: float, lamp_z: float) -> Self:
        """Return the layout with the camera at another distance from what it looks at.

        Camera and lamp keep their direction, the lamp its X.
        """
        eye = self.aim() - distance * self._optical_axis
        x, y, z = (float(each) for each in eye)
        lamp = (self.reflection.lamp[0], lamp_y, lamp_z)
        return replace(
            self,
            camera=self.camera.model_copy(update={"position": (x, y, z)}),
            reflection=self.reflection.model_copy(update={"lamp": lamp}),
        )

    def with_lens(self, focal_length: float) -> Self:
        """Return the layout with another lens, of which no distortion is known."""
        if focal_length == self.focal_length:
            return self
        changed = {"focal_length": focal_length, "distortion": (0.0,) * 5}
        return replace(self, camera=self.camera.model_copy(update=changed))

    def with_window_about(self, line: float) -> Self:
        """Return the layout with its window moved so that a sensor line is in its middle."""
        last = max(self._sensor[1] - self.lines, 0)
        return self.with_window(int(np.clip(round(line - (self.lines - 1) / 2), 0, last)))

    def with_window(self, first_line: int) -> Self:
        """Return the layout with its window from another line of the sensor on."""
        return replace(self, first_line=first_line)

    @property
    def _sensor(self) -> tuple[int, int]:
        assert self.camera.sensor is not None
        return self.camera.sensor

    @property
    def _eye(self) -> _Array:
        return np.array(self.camera.position)

    @property
    def _optical_axis(self) -> _Array:
        return rotation_matrix(*self.camera.rotation)[:, 1]


def check_setup(setup: Setup) -> Reflection:
    """Return body and lamp of a setup that says enough for a plan.

    Raises
    ------
    SetupError
        If body and lamp, or the sensor, are missing.
    """
    if setup.glint.reflection is None:
        raise SetupError(
            "a plan needs to know what is mirrored; give body and lamp in [glint.reflection]"
        )
    if setup.camera.sensor is None:
        raise SetupError(
            "camera.sensor is missing, so nobody knows how far the picture reaches; give it in "
            "[camera], columns and lines per field"
        )
    return setup.glint.reflection


def _window(setup: Setup) -> tuple[int, int]:
    """Return first line and number of lines of the window in which the glint may lie."""
    assert setup.camera.sensor is not None
    height = setup.camera.sensor[1]
    first = setup.fields.first_line or 0
    lines = height - first if setup.plan.lines is None else setup.plan.lines
    if lines < 1 or first + lines > height:
        raise SetupError(
            f"the recorded window, lines {first} to {first + lines - 1}, is not on the sensor of "
            f"{height} lines; correct fields.first_line or plan.lines"
        )
    top, bottom = setup.glint.search_window or (0, lines)
    if top >= lines:
        raise SetupError(
            f"glint.search_window {[top, bottom]} lies beyond the {lines} recorded lines; correct "
            "it, or plan.lines"
        )
    return first + top, min(bottom, lines) - top
