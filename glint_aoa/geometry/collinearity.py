"""Single-camera collinearity: where a ray meets the known vertical plane of the glint."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

from glint_aoa.geometry.camera import (
    OneOrMany,
    distort,
    image_plane,
    pixel_coordinates,
    ray_directions,
    rotation_matrix,
    undistort,
)
from glint_aoa.setup import Camera

__all__ = ["ColumnsToPlane", "PixelToPlane", "intersect_known_plane", "project"]

_DEGREE = 6
_ROUNDING = 64 * np.finfo(np.float64).eps  # of the largest coefficient


def intersect_known_plane(
    position: tuple[OneOrMany, OneOrMany, OneOrMany],
    directions: tuple[ArrayLike, ArrayLike, ArrayLike],
    *,
    y: OneOrMany,
    yaw: OneOrMany = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Intersect rays with a vertical plane of known Y and heading.

    Parameters
    ----------
    position : tuple of float
        Perspective centre X, Y, Z in the tunnel frame [m].
    directions : tuple of array_like
        Ray directions dX, dY, dZ.
    y : float
        Y of the plane at X = 0 [m].
    yaw : float, optional
        Heading of the plane, right-handed about tunnel Z [rad]; 0 for a plane of constant Y.

    Returns
    -------
    X, Z : ndarray
        Distance along the plane's heading from X = 0 (tunnel X itself for `yaw` 0), and
        height [m]. NaN where a ray does not meet the plane in front of the camera.
    """
    xc, yc, zc = position
    dx, dy, dz = (np.asarray(d, np.float64) for d in directions)
    sin, cos = np.sin(yaw), np.cos(yaw)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = ((y - yc) * cos + xc * sin) / (dy * cos - dx * sin)
    depth = np.where((depth > 0) & np.isfinite(depth), depth, np.nan)
    along = (xc + depth * dx) * cos + (yc + depth * dy - y) * sin
    return along, zc + depth * dz


def project(
    points: ArrayLike, *, camera: Camera
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Project points of the tunnel to distorted sensor pixels (the collinearity equations).

    Parameters
    ----------
    points : array_like, shape (..., 3)
        X, Y, Z [m].
    camera : Camera
        An oriented camera.

    Returns
    -------
    u, v : ndarray, shape (...)
        Sensor column and sensor field line of an even field [pixels].
    """
    return PixelToPlane.of_camera(camera, y=0.0, yaw=0.0).project(points)


@dataclass(frozen=True)
class PixelToPlane:
    """Maps sensor pixels to the known plane in the tunnel, or to the image plane alone.

    Without a `position` the camera is not oriented and `__call__` returns image-plane
    coordinates.
    """

    principal_point: tuple[float, float]
    pixel_pitch: tuple[float, float]
    focal_length: float = 1.0
    distortion: tuple[float, ...] = (0.0,) * 5
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    position: tuple[float, float, float] | None = None
    y: float = 0.0
    yaw: float = 0.0

    @classmethod
    def of_camera(
        cls,
        camera: Camera,
        *,
        y: float,
        yaw: float,
        window: tuple[float, float] = (0.0, 0.0),
    ) -> Self:
        """Build the mapping from a setup.

        Parameters
        ----------
        camera : Camera
            The camera; with nothing but a pixel pitch, or empty, it is not oriented.
        y, yaw : float
            The known plane [m, rad].
        window : tuple of float, optional
            u and v of the recorded window's centre: the principal point of a camera that gives
            neither that nor its sensor [pixels].
        """
        point = camera.principal_point or (
            ((camera.sensor[0] - 1) / 2, (camera.sensor[1] - 1) / 2) if camera.sensor else window
        )
        pitch = camera.pixel_pitch or (1.0, 1.0)
        if camera.focal_length is None or camera.position is None:
            return cls(principal_point=point, pixel_pitch=pitch)
        return cls(
            principal_point=point,
            pixel_pitch=pitch,
            focal_length=camera.focal_length,
            distortion=camera.distortion,
            rotation=camera.rotation,
            position=camera.position,
            y=y,
            yaw=yaw,
        )

    def __call__(
        self, u: ArrayLike, v: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Map sensor pixels to horizontal distance and height [m, or pixels without a pitch]."""
        x, z = image_plane(u, v, principal_point=self.principal_point, pixel_pitch=self.pixel_pitch)
        if self.position is None:
            return np.broadcast_to(x, np.broadcast_shapes(x.shape, z.shape)), z
        x, z = np.broadcast_arrays(x, z)
        x, z = undistort(x, z, focal_length=self.focal_length, distortion=self.distortion)
        rays = ray_directions(
            x, z, focal_length=self.focal_length, rotation=rotation_matrix(*self.rotation)
        )
        return intersect_known_plane(self.position, rays, y=self.y, yaw=self.yaw)

    def of_columns(self, u: ArrayLike, v: tuple[float, float]) -> "ColumnsToPlane":
        """Prepare the mapping of certain columns, for many rows.

        Parameters
        ----------
        u : array_like, shape (column,)
            Sensor columns [pixels].
        v : tuple of float
            Sensor lines between which it is to hold [pixels].
        """
        u = np.asarray(u, np.float64)
        middle, half = (v[0] + v[1]) / 2, max((v[1] - v[0]) / 2, 1.0)
        nodes = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
        mapped = self(u, np.broadcast_to((middle + half * nodes)[:, None], (nodes.size, u.size)))
        to_powers = np.linalg.inv(np.vander(nodes, increasing=True))
        s, z = (_without_rounding(to_powers @ values) for values in mapped)
        return ColumnsToPlane(middle, half, s, z)

    def project(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Project points of the tunnel [m], shape (..., 3), to sensor pixels."""
        rotation = rotation_matrix(*self.rotation)
        in_camera = (np.asarray(points, np.float64) - np.asarray(self.position)) @ rotation
        scale = self.focal_length / in_camera[..., 1]
        x, z = distort(
            in_camera[..., 0] * scale,
            in_camera[..., 2] * scale,
            focal_length=self.focal_length,
            distortion=self.distortion,
        )
        return self._to_pixels(x, z)

    def to_pixels(
        self, along: ArrayLike, height: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Map points of the plane back to sensor pixels; the inverse of `__call__`."""
        along, height = np.broadcast_arrays(
            np.asarray(along, np.float64), np.asarray(height, np.float64)
        )
        if self.position is None:
            return self._to_pixels(along, height)
        points = np.stack(
            [along * np.cos(self.yaw), self.y + along * np.sin(self.yaw), height], axis=-1
        )
        return self.project(points)

    def _to_pixels(
        self, x: NDArray[np.float64], z: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return pixel_coordinates(
            x, z, principal_point=self.principal_point, pixel_pitch=self.pixel_pitch
        )


@dataclass(frozen=True, eq=False)
class ColumnsToPlane:
    """Maps rows of certain columns to the known plane; made by `PixelToPlane.of_columns`.

    For a column the mapping is a smooth function of the line: a polynomial of degree 6 through
    Chebyshev's nodes gives it to rounding over a window, distortion included.

    Attributes
    ----------
    middle, half : float
        Middle and half height of the window [pixels].
    s, z : ndarray, shape (power, column)
        Coefficients of distance and height in rising powers of (v - middle) / half; at most 7.
    """

    middle: float
    half: float
    s: NDArray[np.float64]
    z: NDArray[np.float64]

    def __call__(self, v: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Map sensor lines `v` [field, column] to distance and height [m, or pixels]."""
        t = (v - self.middle) / self.half
        return _evaluated(self.s, t), _evaluated(self.z, t)


def _evaluated(powers: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Evaluate the columns' polynomials [power, column] at `t` [field, column]."""
    return np.asarray(polynomial.polyval(t, powers[:, None], tensor=False), np.float64)


def _without_rounding(powers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leave off the highest powers [power, column] that rounding alone has filled."""
    size = np.nan_to_num(np.abs(powers), posinf=0.0).max(axis=1)
    known = np.flatnonzero(size > _ROUNDING * size.max())
    return np.ascontiguousarray(powers[: known[-1] + 1 if known.size else 1])
