"""A wing seen from the side: sections with disc targets, twisted and bent, as fields of pixels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from render_sim.discs import paint
from render_sim.motion import rotation_y
from render_sim.projection import Pinhole
from render_sim.scene import Scene
from render_sim.sensor import Levels, record

__all__ = ["WingSection", "render_wing"]

Floats = NDArray[np.float64]

_CORNERS = 72  # of a disc's outline


@dataclass(frozen=True, eq=False)
class WingSection:
    """Disc targets of one station, which move as one rigid piece.

    Attributes
    ----------
    centres_m : ndarray, shape (target, 3)
        Centres of the discs in the tunnel frame [m].
    radius_m : float
        Their radius [m].
    normal : tuple of float
        Normal of the discs in the tunnel frame.
    """

    centres_m: Floats
    radius_m: float
    normal: tuple[float, float, float] = (0.0, -1.0, 0.0)

    def twisted(
        self,
        angle: float,
        *,
        axis_m: tuple[float, float],
        nose: str,
        shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> "WingSection":
        """Return the section turned about an axis along Y, then shifted.

        Parameters
        ----------
        angle : float
            Leading edge up is positive [rad].
        axis_m : tuple of float
            X and Z of the axis [m].
        nose : {"left", "right"}
            Where the leading edge points in the image.
        shift_m : tuple of float
            Displacement by bending, X, Y, Z [m].
        """
        # A right-handed turn about Y, which points away from the camera, raises the left side.
        turn = rotation_y(angle if nose == "left" else -angle)
        about = np.array([axis_m[0], 0.0, axis_m[1]])
        moved = (self.centres_m - about) @ turn.T + about + np.array(shift_m)
        x, y, z = turn @ np.array(self.normal)
        return replace(self, centres_m=moved, normal=(float(x), float(y), float(z)))

    def outlines_m(self) -> list[Floats]:
        """Return points of the discs' edges [_, 3] in the tunnel frame [m]."""
        _, _, arms = np.linalg.svd(np.array([self.normal]))
        t = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
        circle = self.radius_m * np.stack([np.cos(t), np.sin(t)], axis=1) @ arms[1:]
        return [centre + circle for centre in self.centres_m]


def render_wing(
    scene: Scene,
    sections: Sequence[WingSection],
    *,
    parity: int = 0,
    rng: np.random.Generator,
    surface_level: float = 25.0,
    gradient: float = 0.2,
) -> Levels:
    """Render one field of the targets of a wing.

    Discs are evenly bright and the wing's surface is dark; the light falls off across the
    picture. Areas are integrated over the pixels and blurred by the lens, as wide along the
    columns as along the lines in metres.

    Parameters
    ----------
    scene : Scene
        Camera, window, lens and sensor; the rest of it is not used.
    sections : sequence of WingSection
        The stations.
    parity : int
        0 for an even field or a frame, 1 for an odd field.
    rng : numpy.random.Generator
        Source of the noise.
    surface_level : float
        Light of the wing's surface [grey levels above black].
    gradient : float
        How much of its light the picture loses from left to right [-].

    Returns
    -------
    ndarray, shape (row, column)
        Grey levels.
    """
    camera, sensor = Pinhole.of(scene), scene.sensor
    first = np.array(
        [scene.fields.first_column or 0, (scene.fields.first_line or 0) + 0.5 * parity]
    )
    outlines = [
        np.stack(camera.project(edge), axis=-1) - first
        for section in sections
        for edge in section.outlines_m()
    ]
    blur = scene.optics.blur_lines
    share = paint(
        outlines, (sensor.rows, sensor.columns), blur=(blur * camera.fx / camera.fy, blur)
    )
    bright = sensor.peak_level - sensor.black_level - surface_level
    fall = 1 - gradient * np.arange(sensor.columns) / sensor.columns
    return record((surface_level + bright * share) * fall, sensor, rng=rng)
