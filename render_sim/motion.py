"""Where the model is: poses as functions of time.

A pose is a 4 x 4 matrix that takes model coordinates [m] to tunnel coordinates [m].
"""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from render_sim.scene import Scene

__all__ = ["Motion", "StaticMotion", "rigid", "rotation_x", "rotation_y", "rotation_z"]

Floats = NDArray[np.float64]


class Motion(Protocol):
    """Anything that knows where the model is at any time."""

    def pose(self, time_s: Floats) -> Floats:
        """Return the poses, model to tunnel [..., 4, 4], at the times `time_s` [...] [s]."""
        ...


def rotation_x(angle_rad: ArrayLike) -> Floats:
    """Return right-handed rotations [..., 3, 3] about x by `angle_rad` [...] [rad]."""
    return _rotation(angle_rad, 1, 2)


def rotation_y(angle_rad: ArrayLike) -> Floats:
    """Return right-handed rotations [..., 3, 3] about y by `angle_rad` [...] [rad]."""
    return _rotation(angle_rad, 2, 0)


def rotation_z(angle_rad: ArrayLike) -> Floats:
    """Return right-handed rotations [..., 3, 3] about z by `angle_rad` [...] [rad]."""
    return _rotation(angle_rad, 0, 1)


def _rotation(angle_rad: ArrayLike, first: int, second: int) -> Floats:
    """Turn axis `first` towards axis `second`."""
    angle = np.asarray(angle_rad, dtype=np.float64)
    matrix = np.zeros((*angle.shape, 3, 3))
    matrix[..., :, :] = np.eye(3)
    matrix[..., first, first] = matrix[..., second, second] = np.cos(angle)
    matrix[..., second, first] = np.sin(angle)
    matrix[..., first, second] = -np.sin(angle)
    return matrix


def rigid(rotation: Floats, translation_m: ArrayLike) -> Floats:
    """Join rotations [..., 3, 3] and translations [..., 3] [m] to poses [..., 4, 4]."""
    translation = np.asarray(translation_m, dtype=np.float64)
    shape = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    pose = np.zeros((*shape, 4, 4))
    pose[..., :3, :3] = rotation
    pose[..., :3, 3] = translation
    pose[..., 3, 3] = 1.0
    return pose


class StaticMotion:
    """A model held still by its support.

    The support turns the model about the point of its axis at `scene.view_station_m`, which it
    keeps at the tunnel's origin (raised by the heave), so the glint stays in the window.

    Parameters
    ----------
    scene : Scene
        Gives the station and where the nose points.
    pitch_rad : float
        Pitch, nose up positive [rad].
    yaw_rad : float
        Yaw after pitch, right-handed about tunnel +Z [rad].
    heave_m : float
        Tunnel Z of the held point [m].
    """

    def __init__(
        self, scene: Scene, pitch_rad: float = 0.0, *, yaw_rad: float = 0.0, heave_m: float = 0.0
    ) -> None:
        base = np.pi if scene.nose == "left" else 0.0
        # nose up turns model x towards model z: a negative turn about model y
        rotation = rotation_z(base + yaw_rad) @ rotation_y(-pitch_rad)
        held = np.array([0.0, 0.0, heave_m])
        self._pose = rigid(rotation, held - rotation[:, 0] * scene.view_station_m)

    def pose(self, time_s: Floats) -> Floats:
        """Return the same pose for every time; see `Motion.pose`."""
        return np.broadcast_to(self._pose, (*np.shape(time_s), 4, 4)).copy()
