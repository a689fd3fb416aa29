"""From pixels to the tunnel: image plane, distortion, pose and the known vertical plane."""

from glint_aoa.geometry.camera import (
    distort,
    image_plane,
    pixel_coordinates,
    ray_directions,
    rotation_matrix,
    undistort,
)
from glint_aoa.geometry.collinearity import PixelToPlane, intersect_known_plane, project

__all__ = [
    "PixelToPlane",
    "distort",
    "image_plane",
    "intersect_known_plane",
    "pixel_coordinates",
    "project",
    "ray_directions",
    "rotation_matrix",
    "undistort",
]
