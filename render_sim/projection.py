"""The camera, forward and backward: tunnel points to pixels and pixels to rays.

The simulator has its own camera model on purpose; the measurement has another. Pixel coordinates
are those of the project: column u and sensor line v, integer at the pixel's centre, v down, and an
odd field's lines half a line lower.
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glint_aoa.errors import InputError
from render_sim.motion import rotation_x, rotation_y, rotation_z
from render_sim.scene import Scene

__all__ = ["Pinhole", "distort", "undistort", "window_columns", "window_lines"]

Floats = NDArray[np.float64]
Value = TypeVar("Value", float, Floats)


def distort(x: Value, y: Value, k: Floats) -> tuple[Value, Value]:
    """Apply the Brown-Conrady distortion to normalised image coordinates.

    Parameters
    ----------
    x, y : float or ndarray
        Undistorted coordinates, y down [focal lengths].
    k : ndarray
        k1, k2, p1, p2, k3, OpenCV's order [5].

    Returns
    -------
    x, y : float or ndarray
        Distorted coordinates [focal lengths].
    """
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    return (
        x * radial + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x),
        y * radial + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y,
    )


def undistort(x: Value, y: Value, k: Floats) -> tuple[Value, Value]:
    """Invert `distort` by Newton's method, to rounding error for any lens in use.

    Works on numbers and arrays alike, so that the compiled ray tracer shares it.
    """
    a = x + 0.0
    b = y + 0.0
    for _ in range(6):
        r2 = a * a + b * b
        radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
        growth = k[0] + r2 * (2.0 * k[1] + 3.0 * r2 * k[4])
        error_x = a * radial + 2.0 * k[2] * a * b + k[3] * (r2 + 2.0 * a * a) - x
        error_y = b * radial + k[2] * (r2 + 2.0 * b * b) + 2.0 * k[3] * a * b - y
        xx = radial + 2.0 * a * a * growth + 2.0 * k[2] * b + 6.0 * k[3] * a
        yy = radial + 2.0 * b * b * growth + 6.0 * k[2] * b + 2.0 * k[3] * a
        xy = 2.0 * (a * b * growth + k[2] * a + k[3] * b)
        determinant = xx * yy - xy * xy
        a = a - (yy * error_x - xy * error_y) / determinant
        b = b - (xx * error_y - xy * error_x) / determinant
    return a, b


@dataclass(frozen=True)
class Pinhole:
    """A camera ready for use.

    Attributes
    ----------
    centre_m : ndarray
        Perspective centre in the tunnel frame [3] [m].
    rotation : ndarray
        Camera axes (x right, y along the optical axis, z up) to tunnel axes [3, 3].
    fx, fy : float
        Focal length [columns] and [field lines].
    u0, v0 : float
        Principal point [columns] and [sensor lines of an even field].
    distortion : ndarray
        k1, k2, p1, p2, k3 [5].
    """

    centre_m: Floats
    rotation: Floats
    fx: float
    fy: float
    u0: float
    v0: float
    distortion: Floats

    @classmethod
    def of(cls, scene: Scene) -> "Pinhole":
        """Make the scene's camera.

        Raises
        ------
        InputError
            If the scene's camera has no position, and so no place in the tunnel.
        """
        camera = scene.camera
        if camera.position is None or camera.focal_length is None or camera.pixel_pitch is None:
            raise InputError("camera.position is missing; a simulated camera needs a place")
        omega, phi, kappa = camera.rotation
        return cls(
            centre_m=np.array(camera.position),
            rotation=rotation_z(kappa) @ rotation_y(phi) @ rotation_x(omega),
            fx=camera.focal_length / camera.pixel_pitch[0],
            fy=camera.focal_length / camera.pixel_pitch[1],
            u0=_principal_point(scene)[0],
            v0=_principal_point(scene)[1],
            distortion=np.array(camera.distortion),
        )

    def project(self, points_m: Floats) -> tuple[Floats, Floats]:
        """Return u [columns] and v [sensor lines] of tunnel points [..., 3] [m]."""
        camera = (points_m - self.centre_m) @ self.rotation
        depth = camera[..., 1]
        x, y = distort(camera[..., 0] / depth, -camera[..., 2] / depth, self.distortion)
        return self.u0 + self.fx * x, self.v0 + self.fy * y

    def directions(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """Return tunnel directions [..., 3], unit depth, of the rays through pixels u, v."""
        x, y = np.broadcast_arrays(
            (np.asarray(u, dtype=np.float64) - self.u0) / self.fx,
            (np.asarray(v, dtype=np.float64) - self.v0) / self.fy,
        )
        if self.distortion.any():
            x, y = undistort(x, y, self.distortion)
        return np.stack([x, np.ones_like(x), -y], axis=-1) @ self.rotation.T


def _principal_point(scene: Scene) -> tuple[float, float]:
    camera = scene.camera
    if camera.principal_point is not None:
        return camera.principal_point
    columns, lines = camera.sensor or (scene.sensor.columns, scene.sensor.rows)
    return (columns - 1) / 2, (lines - 1) / 2


def window_columns(scene: Scene) -> Floats:
    """Return the sensor columns u of the recorded window [columns]."""
    return (scene.fields.first_column or 0) + np.arange(scene.sensor.columns, dtype=np.float64)


def window_lines(scene: Scene, *, parity: int = 0) -> Floats:
    """Return the sensor lines v of the window's rows [rows]; parity is 0 even, 1 odd."""
    rows = np.arange(scene.sensor.rows, dtype=np.float64)
    return (scene.fields.first_line or 0) + rows + 0.5 * parity
