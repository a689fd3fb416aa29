r"""Patches of the body with a surface of their own: paint stripes, panel joints, screws.

What a marking changes is the light of the body behind its outline,

.. math::

    I' = I + \iint p(u, v) \sum_k c_k (L_k - L_0) \, du \, dv,

with p a pixel's response, the lens's blur included, across the columns too, where a marking's edge
is as sharp as across the lines; L the radiance with the body's own surface (0) and with that of
each marking; and c the share of each in what is seen, later ones over earlier ones.
"""

import numpy as np
from numpy.typing import NDArray

from render_sim.pixel import Blur
from render_sim.scene import Body, Marking, Scene

__all__ = ["column_blur", "extents"]

Floats = NDArray[np.float64]
_ENDLESS = 1e6


def extents(scene: Scene) -> Floats:
    """Return where the markings of a scene's body lie, and which surface each has.

    Returns
    -------
    ndarray
        Of each marking [marking, 6]: station of its middle and half its length [m]; azimuth of its
        middle and half its width [rad]; 1 for an ellipse, 0 for a rectangle; place of its surface
        in `Scene.surfaces`. What has no end is 1e6 to either side.
    """
    surfaces = scene.surfaces
    rows = [
        (
            each.station_m,
            _ENDLESS if each.length_m is None else 0.5 * each.length_m,
            each.azimuth_rad,
            _half_angle(each, scene.body),
            float(each.outline == "ellipse"),
            float(surfaces.index(each.surface_on(scene.surface))),
        )
        for each in scene.body.markings
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 6)


def _half_angle(marking: Marking, body: Body) -> float:
    """Return half of a marking's width as an angle about the axis; endless if it closes."""
    if marking.width_m is None:
        return _ENDLESS
    y, z = np.sin(marking.azimuth_rad), np.cos(marking.azimuth_rad)
    half_width, half_height = body.half_axes_m
    power = 2.0 if body.is_round else body.exponent
    away = (abs(y / half_width) ** power + abs(z / half_height) ** power) ** (-1.0 / power)
    half = 0.5 * marking.width_m / float(away)
    return half if half < np.pi else _ENDLESS


def column_blur(scene: Scene) -> Blur:
    """Return the lens's blur across the columns: as wide on the sensor as across the lines."""
    lines = Blur.of(scene)
    pitch = scene.camera.pixel_pitch
    if pitch is None:
        return lines
    ratio = pitch[1] / pitch[0]
    return Blur(lines.gaussian * ratio, lines.disc * ratio, lines.cutoff / ratio)
