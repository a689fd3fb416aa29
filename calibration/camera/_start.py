"""Where the adjustment of a camera starts: focal length and poses in closed form."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.camera._bundle import Interior, Observation, State
from glint_aoa.geometry import undistort

Floats = NDArray[np.float64]

_WIDTHS = (0.5, 50.0)  # plausible principal distances, in widths of the sensor
_GUESS = 3.0
_OTHER_ASPECT = 1.3  # of the one given: not an error of some per cent
_TINY = float(np.finfo(np.float64).tiny)


def first_interior(
    observations: Sequence[Observation],
    places: Floats,
    sensor: tuple[int, int],
    aspect: float,
    *,
    hold_aspect: bool,
) -> Interior:
    """Return a camera with the principal point amid the sensor and no distortion.

    The first two columns of a homography are images of orthogonal unit vectors, which gives two
    equations in 1/fx^2 and 1/fy^2 for each image (Z. Zhang, "A flexible new technique for camera
    calibration", IEEE Trans. PAMI 22(11), 2000, doi:10.1109/34.888718).

    Parameters
    ----------
    observations : sequence of Observation
        Corners of each image.
    places : ndarray [corner, 3]
        The board [m].
    sensor : tuple of int
        Columns and lines.
    aspect : float
        Vertical over horizontal pixel pitch as given; taken unless the images say clearly
        otherwise.
    hold_aspect : bool
        Whether it is taken in any case.
    """
    middle = (np.array(sensor) - 1) / 2
    equations = np.concatenate(
        [_equations(places[one.corner], one.uv - middle, sensor[0]) for one in observations]
    )
    found = np.linalg.lstsq(equations[:, :2], -equations[:, 2], rcond=None)[0]
    if not hold_aspect and (found > 0).all():
        seen = float(np.sqrt(found[1] / found[0]))
        aspect = seen if not 1 / _OTHER_ASPECT < seen / aspect < _OTHER_ASPECT else aspect
    both = equations[:, 0] + equations[:, 1] * aspect**2
    inverse_square = -float(both @ equations[:, 2]) / max(float(both @ both), _TINY)
    distance = inverse_square**-0.5 if inverse_square > 0 else _GUESS
    distance = float(np.clip(distance, *_WIDTHS)) * sensor[0]
    return Interior(np.array([distance, aspect, *middle, *[0.0] * 5]))


def _equations(places: Floats, points: Floats, width: int) -> Floats:
    """Return factors of 1/fx^2 and 1/fy^2, and constants, of two equations."""
    homography, _ = cv2.findHomography(places[:, :2], points / width, 0)
    a, b = homography[:, 0], homography[:, 1]
    rows = np.array([a * b, a * a - b * b])
    scaled: Floats = rows / float(a[:2] @ a[:2] + b[:2] @ b[:2])
    return scaled


def board_poses(observations: Sequence[Observation], places: Floats, interior: Interior) -> Floats:
    """Return the pose [image, 6] of each board for a known camera.

    A small or distant board is seen nearly alike from two sides; of the two poses (T. Collins and
    A. Bartoli, "Infinitesimal plane-based pose estimation", IJCV 109, 2014,
    doi:10.1007/s11263-014-0725-5) the one that fits better is taken.
    """
    poses = np.empty((len(observations), 6))
    for pose, one in zip(poses, observations, strict=True):
        flat = places[one.corner] * [1.0, 1.0, 0.0]
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            flat, normalised(one.uv, interior), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
        pose[:3], pose[3:] = turns[0].ravel(), shifts[0].ravel()
    return poses


def normalised(uv: Floats, interior: Interior) -> Floats:
    """Take pixels and distortion out of image points [point, 2]."""
    focal, aspect, u, v = interior.values[:4]
    x, z = undistort(
        uv[:, 0] - u,
        (v - uv[:, 1]) * aspect,
        focal_length=focal,
        distortion=tuple(interior.distortion.tolist()),
    )
    rays: Floats = np.column_stack([x, -z]) / focal
    return rays


def first_state(
    observations: Sequence[Observation],
    places: Floats,
    sensor: tuple[int, int],
    aspect: float,
    *,
    hold_aspect: bool = False,
) -> State:
    """Return where the adjustment starts; see `first_interior` and `board_poses`."""
    interior = first_interior(observations, places, sensor, aspect, hold_aspect=hold_aspect)
    return State(interior, board_poses(observations, places, interior), places.copy())
