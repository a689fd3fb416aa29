"""The camera's rotation as angles: those of the tunnel frame, and the textbook's."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_TO_TEXTBOOK = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # x right, y up, z to the viewer


def tunnel_angles(rotation: Floats) -> Floats:
    """Return omega, phi, kappa [rad] of R = Rz(kappa) Ry(phi) Rx(omega), camera to tunnel."""
    return np.array(
        [
            np.arctan2(rotation[2, 1], rotation[2, 2]),
            -np.arcsin(np.clip(rotation[2, 0], -1.0, 1.0)),
            np.arctan2(rotation[1, 0], rotation[0, 0]),
        ]
    )


def textbook_angles(rotation: Floats) -> Floats:
    """Return the photogrammetric omega, phi, kappa [rad] of the same rotation.

    These are the angles of M = R3(kappa) R2(phi) R1(omega), which takes tunnel axes to camera
    axes x right, y up, z towards the viewer (P. R. Wolf, *Elements of Photogrammetry*). A camera
    that looks along +Y with its up along +Z has omega = 90 deg, phi = kappa = 0.
    """
    m = _TO_TEXTBOOK @ rotation.T
    return np.array(
        [
            np.arctan2(-m[2, 1], m[2, 2]),
            np.arcsin(np.clip(m[2, 0], -1.0, 1.0)),
            np.arctan2(-m[1, 0], m[0, 0]),
        ]
    )


def angle_between(first: Floats, second: Floats) -> float:
    """Return by how much two rotations differ [rad]."""
    skew = first.T @ second
    sine = np.linalg.norm(
        [skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1]]
    )
    return float(np.arctan2(sine, np.trace(skew) - 1))
