"""The collinearity equations with their derivatives by pose, target and interior orientation."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import SetupError
from glint_aoa.geometry import PixelToPlane, image_plane, rotation_matrix, undistort
from glint_aoa.setup import Camera

Floats = NDArray[np.float64]

INTERIOR = (
    "focal_length_m",
    "pixel_pitch_h_m",
    "pixel_pitch_v_m",
    "principal_point_u",
    "principal_point_v",
    "k1",
    "k2",
    "p1",
    "p2",
    "k3",
)
"""Interior parameters of `Interior.derivatives`, as a camera file names them."""

_ABOUT = np.array(  # cross products with X, Y and Z
    [
        [[0.0, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[0.0, 0, 1], [0, 0, 0], [-1, 0, 0]],
        [[0.0, -1, 0], [1, 0, 0], [0, 0, 0]],
    ]
)


class Projection(NamedTuple):
    """Where targets are seen, and how that changes.

    Attributes
    ----------
    uv : ndarray [target, 2]
        Sensor column and line of an even field [pixels].
    depth : ndarray [target]
        Distance from the perspective centre along the optical axis [m].
    by_pose : ndarray [target, 2, 6]
        Derivatives by X, Y, Z of the perspective centre [pixels/m] and omega, phi, kappa
        [pixels/rad].
    by_point : ndarray [target, 2, 3]
        Derivatives by the target's X, Y, Z [pixels/m].
    """

    uv: Floats
    depth: Floats
    by_pose: Floats
    by_point: Floats


@dataclass(frozen=True)
class Interior:
    """Interior orientation of a camera; metres and pixels.

    Attributes
    ----------
    focal_length : float
        Principal distance [m].
    pixel_pitch : tuple of float
        Horizontal pitch, and vertical pitch per field line [m].
    principal_point : tuple of float
        u and v of an even field [pixels].
    distortion : tuple of float
        k1, k2, p1, p2, k3.
    """

    focal_length: float
    pixel_pitch: tuple[float, float]
    principal_point: tuple[float, float]
    distortion: tuple[float, ...]

    @classmethod
    def of_camera(cls, camera: Camera) -> "Interior":
        """Take the interior orientation out of a setup's camera."""
        if camera.focal_length is None or camera.pixel_pitch is None:
            raise SetupError(
                "the camera has no focal_length; give focal_length, pixel_pitch and an "
                "approximate position in [camera]"
            )
        mapping = PixelToPlane.of_camera(camera, y=0.0, yaw=0.0)
        return cls(
            camera.focal_length, camera.pixel_pitch, mapping.principal_point, camera.distortion
        )

    @property
    def values(self) -> tuple[float, ...]:
        """The parameters in the order of their names, `INTERIOR` [m, pixels]."""
        return (
            self.focal_length,
            *self.pixel_pitch,
            *self.principal_point,
            *self.distortion,
        )

    @property
    def scale(self) -> Floats:
        """Pixels per unit of normalised coordinates, of u and v."""
        return self.focal_length / np.array(self.pixel_pitch)

    def normalised(self, uv: Floats) -> Floats:
        """Take distortion and pixels out of image points: x / y_c to the right, and down."""
        x, z = image_plane(
            *uv.T, principal_point=self.principal_point, pixel_pitch=self.pixel_pitch
        )
        x, z = undistort(x, z, focal_length=self.focal_length, distortion=self.distortion)
        return np.stack([x, -z], axis=-1) / self.focal_length

    def project(self, points: Floats, pose: Floats) -> Projection:
        """Project targets.

        Parameters
        ----------
        points : ndarray [target, 3]
            X, Y, Z [m].
        pose : ndarray [6]
            X, Y, Z of the perspective centre [m] and omega, phi, kappa [rad].

        Returns
        -------
        Projection
            Targets behind the camera have a depth below zero, and pixels without a meaning.
        """
        rotation = rotation_matrix(*pose[3:])
        offset = points - pose[:3]
        in_camera = offset @ rotation
        depth, xy = in_camera[:, 1], _normalised(in_camera)
        distorted, by_xy = _distorted(xy, self.distortion)
        by_camera = np.zeros((len(points), 2, 3))
        by_camera[:, 0, 0], by_camera[:, 1, 2] = 1 / depth, -1 / depth
        by_camera[:, :, 1] = -xy / depth[:, None]
        by_camera = self.scale[:, None] * (by_xy @ by_camera)
        by_point = by_camera @ rotation.T
        turned = offset @ _rotation_derivatives(pose[3:], rotation)  # [angle, target, 3]
        by_angles = np.einsum("nij,anj->nia", by_camera, turned)
        return Projection(
            uv=distorted * self.scale + self.principal_point,
            depth=depth,
            by_pose=np.concatenate([-by_point, by_angles], axis=-1),
            by_point=by_point,
        )

    def derivatives(self, points: Floats, pose: Floats) -> Floats:
        """Return derivatives [target, 2, 10] of `project` by the parameters of `INTERIOR`."""
        xy = _normalised((points - pose[:3]) @ rotation_matrix(*pose[3:]))
        distorted, _ = _distorted(xy, self.distortion)
        derivatives = np.zeros((len(points), 2, len(INTERIOR)))
        derivatives[:, :, 0] = distorted / self.pixel_pitch
        for axis in range(2):
            per_pitch = -self.scale[axis] / self.pixel_pitch[axis]
            derivatives[:, axis, 1 + axis] = distorted[:, axis] * per_pitch
            derivatives[:, axis, 3 + axis] = 1.0
        r2 = np.sum(xy**2, axis=1)
        powers = np.stack([r2, r2**2, r2**3], axis=-1)[:, None, :]
        derivatives[:, :, [5, 6, 9]] = self.scale[:, None] * xy[:, :, None] * powers
        derivatives[:, :, 7:9] = self.scale[:, None] * _tangential(xy)
        return derivatives


def _normalised(in_camera: Floats) -> Floats:
    right, depth, up = in_camera.T
    return np.asarray(np.stack([right, -up], axis=-1) / depth[:, None], np.float64)


def _rotation_derivatives(angles: Floats, rotation: Floats) -> Floats:
    """Return derivatives [angle, 3, 3] of R = Rz(kappa) Ry(phi) Rx(omega)."""
    about_z = rotation_matrix(0.0, 0.0, angles[2])
    axes = rotation @ _ABOUT[0], about_z @ _ABOUT[1] @ about_z.T @ rotation, _ABOUT[2] @ rotation
    return np.stack(axes)


def _tangential(xy: Floats) -> Floats:
    """Return what p1 and p2 multiply [point, 2, 2]."""
    x, y = xy.T
    r2, product = x * x + y * y, 2 * x * y
    columns = [[product, r2 + 2 * y * y], [r2 + 2 * x * x, product]]
    return np.asarray(np.transpose(columns), np.float64)


def _distorted(xy: Floats, distortion: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Distort normalised points [point, 2], with the derivatives [point, 2, 2] by them."""
    k1, k2, p1, p2, k3 = distortion
    x, y = xy.T
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    by_xy = np.empty((len(xy), 2, 2))
    by_xy[:, 0, 0] = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
    by_xy[:, 1, 1] = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
    by_xy[:, 0, 1] = by_xy[:, 1, 0] = x * y * slope + 2 * (p1 * x + p2 * y)
    distorted: Floats = xy * radial[:, None] + _tangential(xy) @ np.array([p1, p2])
    return distorted, by_xy
