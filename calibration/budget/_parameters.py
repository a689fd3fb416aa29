"""The geometry as a vector of numbers: what the parameters are called, and what they stand for."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.geometry import (
    PixelToPlane,
    image_plane,
    intersect_known_plane,
    ray_directions,
    rotation_matrix,
    undistort,
)
from glint_aoa.setup import Reflection, Setup

__all__ = [
    "CAMERA",
    "PARAMETERS",
    "POSE",
    "Parameter",
    "geometry_vector",
    "on_planes",
    "reflection_of",
    "to_plane",
]

Floats = NDArray[np.float64]

_DEGREE = np.degrees(1.0)


@dataclass(frozen=True)
class Parameter:
    """A parameter of the geometry.

    Attributes
    ----------
    name : str
        As in the files of calibrations; ends with its SI unit where it has one.
    label : str
        In words.
    unit : str
        Unit that people read it in.
    per_si : float
        What the SI value is multiplied by to be in `unit`.
    step : float
        For derivatives by central differences [SI]; small against what bends the geometry, large
        against rounding.
    """

    name: str
    label: str
    unit: str
    per_si: float
    step: float


_INTERIOR = (
    Parameter("focal_length_m", "principal distance", "mm", 1e3, 1e-5),
    Parameter("pixel_pitch_h_m", "pixel pitch, horizontal", "um", 1e6, 1e-9),
    Parameter("pixel_pitch_v_m", "pixel pitch, vertical", "um", 1e6, 1e-9),
    Parameter("principal_point_u", "principal point u", "px", 1.0, 0.05),
    Parameter("principal_point_v", "principal point v", "px", 1.0, 0.05),
    Parameter("k1", "distortion k1", "1", 1.0, 1e-3),
    Parameter("k2", "distortion k2", "1", 1.0, 1e-2),
    Parameter("p1", "distortion p1", "1", 1.0, 1e-4),
    Parameter("p2", "distortion p2", "1", 1.0, 1e-4),
    Parameter("k3", "distortion k3", "1", 1.0, 1e-1),
)
_POSE = (
    *(Parameter(f"{axis}_m", f"position {axis}", "mm", 1e3, 1e-4) for axis in "XYZ"),
    *(
        Parameter(f"{name}_rad", f"rotation {name}", "deg", _DEGREE, 1e-4)
        for name in ("omega", "phi", "kappa")
    ),
)
_PLANE = (
    Parameter("y_m", "known Y", "mm", 1e3, 1e-4),
    Parameter("yaw_rad", "yaw", "deg", _DEGREE, 1e-4),
)
_REFLECTION = (
    Parameter("radius_m", "body's radius", "mm", 1e3, 1e-4),
    Parameter("axis_y_m", "axis Y", "mm", 1e3, 1e-4),
    *(Parameter(f"lamp_{axis}_m", f"lamp {axis}", "mm", 1e3, 1e-3) for axis in "XYZ"),
    Parameter("lamp_heading_rad", "lamp's heading", "deg", _DEGREE, 1e-3),
    Parameter("lamp_elevation_rad", "lamp's elevation", "deg", _DEGREE, 1e-3),
)

PARAMETERS = (*_INTERIOR, *_POSE, *_PLANE, *_REFLECTION)
"""All parameters, in the order of the vector; the last seven are zero without a reflection."""

CAMERA = tuple(each.name for each in _INTERIOR)
"""Names of the parameters that a camera calibration may estimate."""

POSE = tuple(each.name for each in _POSE)
"""Names of the parameters that a space resection estimates."""


def geometry_vector(setup: Setup) -> Floats:
    """Return the setup's geometry as the vector [parameter] of `PARAMETERS`, in SI units.

    Parameters
    ----------
    setup : Setup
        A setup whose camera is oriented.
    """
    plane = PixelToPlane.of_camera(setup.camera, y=setup.glint.y, yaw=setup.glint.yaw)
    values = [
        *(plane.focal_length, *plane.pixel_pitch, *plane.principal_point, *plane.distortion),
        *(*(plane.position or (np.nan,) * 3), *plane.rotation, plane.y, plane.yaw),
    ]
    reflection = setup.glint.reflection
    if reflection is not None:
        x, y, z = reflection.lamp_direction
        heading, elevation = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
        values += [reflection.radius, reflection.axis_y, *reflection.lamp, heading, elevation]
    return np.array(values + [0.0] * (len(PARAMETERS) - len(values)))


def to_plane(geometry: Floats) -> PixelToPlane:
    """Return the mapping of pixels to the known plane that a vector of the geometry stands for."""
    value = [float(each) for each in geometry]
    return PixelToPlane(
        focal_length=value[0],
        pixel_pitch=(value[1], value[2]),
        principal_point=(value[3], value[4]),
        distortion=tuple(value[5:10]),
        position=(value[10], value[11], value[12]),
        rotation=(value[13], value[14], value[15]),
        y=value[16],
        yaw=value[17],
    )


def on_planes(geometries: Floats, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Map pixels to the known plane for many geometries at once.

    Parameters
    ----------
    geometries : ndarray [draw, parameter]
        Vectors of the geometry.
    u : ndarray [column]
        Sensor columns [pixels].
    v : ndarray [draw, line, column]
        Sensor lines [pixels]; one for all draws, or one for each.

    Returns
    -------
    s, z : ndarray [draw, line, column]
        Distance along the plane and height [m], as `to_plane` gives them for each geometry.
    """
    value = geometries.T[:18, :, None, None]
    x, z = image_plane(u, v, principal_point=(value[3], value[4]), pixel_pitch=(value[1], value[2]))
    x, z = undistort(x, z, focal_length=value[0], distortion=tuple(value[5:10]))
    turned = np.stack([rotation_matrix(*each) for each in geometries[:, 13:16]], axis=-1)
    rays = ray_directions(x, z, focal_length=value[0], rotation=turned[..., None, None])
    place = (value[10], value[11], value[12])
    return intersect_known_plane(place, rays, y=value[16], yaw=value[17])


def reflection_of(geometry: Floats, nominal: Reflection) -> Reflection:
    """Return body and lamp of a vector of the geometry; the lamp's shape is the nominal's."""
    radius, axis_y, *lamp, heading, elevation = (float(each) for each in geometry[18:])
    level = np.cos(elevation)
    direction = (level * np.cos(heading), level * np.sin(heading), np.sin(elevation))
    return nominal.model_copy(
        update={
            "radius": radius,
            "axis_y": axis_y,
            "lamp": tuple(lamp),
            "lamp_direction": tuple(float(each) for each in direction),
        }
    )
