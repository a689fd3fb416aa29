"""The camera: pixels, image plane, distortion and rotation.

Conventions: column u and field line v count from 0 at the first pixel's centre, v down. On the
image plane x is to the right and z up, both in metres from the principal point. The camera looks
along +y of its own axes (x right, y along the optical axis, z up).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "distort",
    "image_plane",
    "pixel_coordinates",
    "ray_directions",
    "rotation_matrix",
    "undistort",
]

OneOrMany = float | NDArray[np.float64]
"""A property of one camera, or of many at once: an array that broadcasts with the points."""

_UNDISTORT_ITERATIONS = 100
_UNDISTORT_TOLERANCE = 1e-14


def image_plane(
    u: ArrayLike,
    v: ArrayLike,
    *,
    principal_point: tuple[OneOrMany, OneOrMany],
    pixel_pitch: tuple[OneOrMany, OneOrMany],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Turn sensor pixels into image-plane coordinates.

    Parameters
    ----------
    u, v : array_like
        Sensor column and sensor field line, parity included [pixels].
    principal_point : tuple of float
        u and v of the principal point [pixels].
    pixel_pitch : tuple of float
        Horizontal pitch, and vertical pitch per field line [m].

    Returns
    -------
    x, z : ndarray
        Image-plane coordinates [m], x to the right, z up.
    """
    x = (np.asarray(u, np.float64) - principal_point[0]) * pixel_pitch[0]
    z = (principal_point[1] - np.asarray(v, np.float64)) * pixel_pitch[1]
    return x, z


def pixel_coordinates(
    x: ArrayLike,
    z: ArrayLike,
    *,
    principal_point: tuple[float, float],
    pixel_pitch: tuple[float, float],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Turn image-plane coordinates [m] into sensor pixels; the inverse of `image_plane`."""
    u = np.asarray(x, np.float64) / pixel_pitch[0] + principal_point[0]
    v = principal_point[1] - np.asarray(z, np.float64) / pixel_pitch[1]
    return u, v


def distort(
    x: ArrayLike, z: ArrayLike, *, focal_length: float, distortion: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Apply Brown-Conrady distortion to ideal image-plane coordinates.

    Parameters
    ----------
    x, z : array_like
        Ideal image-plane coordinates [m], z up.
    focal_length : float
        Principal distance [m].
    distortion : tuple of float
        k1, k2, p1, p2, k3, in OpenCV's order, on normalised and y-down coordinates.

    Returns
    -------
    x, z : ndarray
        Coordinates where the lens puts them [m].

    Notes
    -----
    D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37(8), 1971.
    """
    xn, yn = np.asarray(x, np.float64) / focal_length, -np.asarray(z, np.float64) / focal_length
    xd, yd = _distort_normalised(xn, yn, distortion)
    return xd * focal_length, -yd * focal_length


def undistort(
    x: ArrayLike, z: ArrayLike, *, focal_length: OneOrMany, distortion: tuple[OneOrMany, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Remove Brown-Conrady distortion from measured image-plane coordinates.

    The fixed-point iteration stops when no point moves by more than 1e-14 of the principal
    distance, or after 100 rounds. Parameters and result are those of `distort`, the other way
    round.
    """
    x, z = np.asarray(x, np.float64), np.asarray(z, np.float64)
    if not any(np.any(each) for each in distortion):
        return x, z
    xd, yd = x / focal_length, -z / focal_length
    xn, yn = xd, yd
    for _ in range(_UNDISTORT_ITERATIONS):
        x_again, y_again = _distort_normalised(xn, yn, distortion)
        dx, dy = xd - x_again, yd - y_again
        xn, yn = xn + dx, yn + dy
        if max(np.nanmax(np.abs(dx), initial=0), np.nanmax(np.abs(dy), initial=0)) < (
            _UNDISTORT_TOLERANCE
        ):
            break
    return xn * focal_length, -yn * focal_length


def rotation_matrix(omega: float, phi: float, kappa: float) -> NDArray[np.float64]:
    """Rotation from camera axes to the tunnel, R = Rz(kappa) Ry(phi) Rx(omega).

    Parameters
    ----------
    omega, phi, kappa : float
        Right-handed angles about tunnel X, Y and Z [rad]. Positive omega lifts the optical axis,
        positive kappa turns it towards -X, positive phi lowers the image's right side.

    Returns
    -------
    ndarray, shape (3, 3)
        The rotation; the identity for a camera that looks along +Y with its up along +Z.
    """
    (so, sp, sk), (co, cp, ck) = np.sin([omega, phi, kappa]), np.cos([omega, phi, kappa])
    about_x = np.array([[1, 0, 0], [0, co, -so], [0, so, co]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[ck, -sk, 0], [sk, ck, 0], [0, 0, 1]])
    rotation: NDArray[np.float64] = about_z @ about_y @ about_x
    return rotation


def ray_directions(
    x: ArrayLike, z: ArrayLike, *, focal_length: OneOrMany, rotation: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Directions, in the tunnel frame, of the rays through image-plane points.

    Parameters
    ----------
    x, z : array_like
        Ideal (undistorted) image-plane coordinates [m].
    focal_length : float
        Principal distance [m].
    rotation : ndarray, shape (3, 3)
        Camera axes to tunnel, as from `rotation_matrix`; (3, 3, ...) of many cameras.

    Returns
    -------
    dX, dY, dZ : ndarray
        Components of d = R (x, f, z) [m], not normalised.
    """
    x, z = np.asarray(x, np.float64), np.asarray(z, np.float64)
    first, second, third = (row[0] * x + row[1] * focal_length + row[2] * z for row in rotation)
    return first, second, third


def _distort_normalised(
    x: NDArray[np.float64], y: NDArray[np.float64], distortion: tuple[OneOrMany, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xy = x * y
    return (
        x * radial + 2 * p1 * xy + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * xy,
    )
