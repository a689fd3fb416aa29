"""The model vibrating in its modes about a static attitude."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from render_sim.modes import ModelSystem, VibrationMode
from render_sim.motion import Floats, Motion, rigid, rotation_y, rotation_z

__all__ = ["ModalMotion", "Signal"]


class Signal(Protocol):
    """Anything that has a value at any time, such as `render_sim.excitation.Tones`."""

    def at(self, time_s: Floats) -> Floats:
        """Return the values at the times `time_s` [s], of its shape."""
        ...


class ModalMotion:
    """A rigid model that turns about the fixed points of its vibration modes.

    pose(t) = static(t) M1(t) M2(t) ..., each M a rotation about the mode's own fixed point on the
    model axis, modes by rising frequency. With one mode in one plane the sensor moves on an arc of
    the effective radius.

    Parameters
    ----------
    static : Motion
        Where the model is without vibration.
    system : ModelSystem
        Gives each mode's fixed point.
    angles : sequence of (VibrationMode, Signal)
        Modal angles [rad]: nose to port (yaw) and nose up (pitch) positive.
    """

    def __init__(
        self,
        static: Motion,
        system: ModelSystem,
        angles: Sequence[tuple[VibrationMode, Signal]],
    ) -> None:
        self._static = static
        self._system = system
        self._angles = sorted(angles, key=lambda pair: pair[0].frequency)

    def pose(self, time_s: Floats) -> Floats:
        """Return the poses, model to tunnel [..., 4, 4], at the times `time_s` [...] [s]."""
        pose = self._static.pose(time_s)
        for mode, angle in self._angles:
            pose = pose @ self._turn(mode, angle.at(time_s))
        return pose

    def _turn(self, mode: VibrationMode, angle_rad: Floats) -> Floats:
        # nose up turns model x towards model z: a negative turn about model y
        other = mode.out_of_plane * angle_rad
        yaw, pitch = (angle_rad, other) if mode.plane == "yaw" else (other, angle_rad)
        rotation = rotation_z(yaw) @ rotation_y(-pitch)
        fixed = np.array([self._system.fixed_point(mode), 0.0, 0.0])
        return rigid(rotation, fixed - rotation @ fixed)
