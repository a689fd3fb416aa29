"""From pixels to the tunnel: image plane, pose, the known vertical plane, and the reflection."""

from glint_aoa.geometry.camera import (
    distort,
    image_plane,
    pixel_coordinates,
    ray_directions,
    rotation_matrix,
    undistort,
)
from glint_aoa.geometry.collinearity import (
    ColumnsToPlane,
    PixelToPlane,
    intersect_known_plane,
    project,
)
from glint_aoa.geometry.reflection import AxisLine, GlintPrediction, GlintReflection
from glint_aoa.geometry.specular import Cylinder, glint_points

__all__ = [
    "AxisLine",
    "ColumnsToPlane",
    "Cylinder",
    "GlintPrediction",
    "GlintReflection",
    "PixelToPlane",
    "distort",
    "glint_points",
    "image_plane",
    "intersect_known_plane",
    "pixel_coordinates",
    "project",
    "ray_directions",
    "rotation_matrix",
    "undistort",
]
