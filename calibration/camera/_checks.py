"""What a camera calibration must show before it is believed."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.camera._bundle import (
    ASPECT,
    DISTORTION,
    FOCAL,
    PRINCIPAL,
    Adjusted,
    Interior,
    State,
)
from calibration.camera.boards import BoardImage
from glint_aoa.errors import CalibrationError

Floats = NDArray[np.float64]

LEAST_IMAGES = 3

_MOST_FOCAL_STD = 0.02  # relative: beyond, normal intervals do not hold
_MOST_PRINCIPAL_STD = 0.1  # of the sensor's width
_SQUARE_ON = 5.0  # degrees of tilt below which a board shows no foreshortening
_ALIKE = 5.0  # degrees between boards that are tilted alike
_FOCAL_M = (1e-3, 3.0)
_FAR_M = 300.0
_SAME_PITCH = 0.2  # relative
_FOLDS = "the lens model folds over inside the sensor"


def refuse_too_few(reasons: Mapping[str, str], n_found: int) -> None:
    """Refuse fewer than three images with a board, and name what the others lack.

    Raises
    ------
    CalibrationError
        If there are too few.
    """
    if n_found >= LEAST_IMAGES:
        return
    found = {0: "none is", 1: "1 is"}.get(n_found, f"{n_found} are")
    said = "".join(f"; {name}: {reason}" for name, reason in list(reasons.items())[:3])
    raise CalibrationError(
        f"a camera is calibrated from {LEAST_IMAGES} images of the board or more, better 12, and "
        f"{found} usable{said or '; photograph the board at other places and tilts'}"
    )


def refuse_off_sensor(images: Sequence[BoardImage], sensor: tuple[int, int]) -> None:
    """Refuse corners that do not lie on the sensor.

    Raises
    ------
    CalibrationError
        If there are such: the sensor's size, or a window's place on it, is wrong.
    """
    for image in images:
        low, high = image.uv.min(axis=0), image.uv.max(axis=0)
        if (low < -1).any() or (high > np.array(sensor)).any():
            raise CalibrationError(
                f"{image.name}: its corners reach from column {low[0]:.0f}, line {low[1]:.0f} to "
                f"{high[0]:.0f}, {high[1]:.0f}, beyond a sensor of {sensor[0]} x {sensor[1]}; "
                "correct camera.sensor, or the place of the recorded window on it"
            )


def tilts_deg(state: State) -> Floats:
    """Return how far each board is turned away from facing the camera squarely [deg]."""
    return np.array([_between(each, np.array([0.0, 0.0, 1.0])) for each in _normals(state)])


def _normals(state: State) -> list[Floats]:
    return [np.asarray(cv2.Rodrigues(pose[:3])[0][:, 2], np.float64) for pose in state.poses]


def _between(one: Floats, other: Floats) -> float:
    return float(np.degrees(np.arccos(np.clip(abs(one @ other), -1.0, 1.0))))


def refuse_alike(state: State) -> None:
    """Refuse boards that are not turned enough, to the camera and to each other.

    Noise alone shows tilts of a degree or so, and a focal length to go with them.

    Raises
    ------
    CalibrationError
        If all of them face the camera squarely, or are tilted alike.
    """
    if tilts_deg(state).max() < _SQUARE_ON or _most_apart(state) < _ALIKE:
        raise undetermined(state, "focal length")


def _most_apart(state: State) -> float:
    normals = _normals(state)
    return max(_between(one, other) for one in normals for other in normals)


def undetermined(state: State, what: str) -> CalibrationError:
    """Say why the images do not determine the camera, from how the boards are tilted."""
    tilts, apart = tilts_deg(state), _most_apart(state)
    if tilts.max() < _SQUARE_ON:
        cause = (
            f"all boards face the camera nearly squarely (tilted by {tilts.min():.1f} to "
            f"{tilts.max():.1f} deg), which does not tell focal length from distance; tilt the "
            "board by 20 to 40 deg, to another side in each image"
        )
    elif apart < _ALIKE:
        cause = (
            f"all boards are tilted alike (within {apart:.1f} deg); tilt the board to another "
            "side in each image"
        )
    else:
        cause = (
            "take more images, with the board tilted by 20 to 40 deg to all sides and reaching "
            "into every corner of the picture, or hold what is known"
        )
    return CalibrationError(f"the images do not determine the {what}: {cause}")


def refuse_undetermined(adjusted: Adjusted, sensor: tuple[int, int]) -> None:
    """Refuse a camera that the images leave open.

    Raises
    ------
    CalibrationError
        If the adjustment found no end, or focal length or principal point are too uncertain.
    """
    refuse_alike(adjusted.state)
    std, state = np.sqrt(np.diag(adjusted.covariance)), adjusted.state
    relative = std[FOCAL] / state.interior.values[FOCAL]
    if not adjusted.converged or not relative < _MOST_FOCAL_STD:
        known = f" (known to {100 * relative:.0f} %)" if relative < 10 else ""
        raise undetermined(state, f"focal length{known}")
    widest = std[PRINCIPAL] * [1.0, state.interior.values[ASPECT]]
    if not widest.max() < _MOST_PRINCIPAL_STD * sensor[0]:
        u, v = std[PRINCIPAL]
        raise undetermined(state, f"principal point (known to {u:.0f} columns, {v:.0f} lines)")


def refuse_units(
    state: State, pixel_pitch: tuple[float, float], hold: Sequence[str], spacing: float
) -> None:
    """Refuse results that only a mix-up of units, or of frames and fields, can give.

    Raises
    ------
    CalibrationError
        If focal length, distance of the boards or pixel pitch cannot be.
    """
    focal = float(state.interior.values[FOCAL]) * pixel_pitch[0]
    if not _FOCAL_M[0] < focal < _FOCAL_M[1]:
        raise CalibrationError(
            f"the focal length comes out as {1e3 * focal:.4g} mm for a horizontal pixel pitch of "
            f"{1e6 * pixel_pitch[0]:.4g} um; check the unit of the pixel pitch"
        )
    nearest, farthest = state.poses[:, 5].min(), state.poses[:, 5].max()
    if nearest < focal or farthest > _FAR_M:
        off = nearest if nearest < focal else farthest
        raise CalibrationError(
            f"squares of {1e3 * spacing:.4g} mm put the board {off:.3g} m from a lens of "
            f"{1e3 * focal:.4g} mm; check the unit of the board's spacing"
        )
    ratio = float(state.interior.values[ASPECT]) * pixel_pitch[0] / pixel_pitch[1]
    if "pixel_pitch_v" not in hold and abs(ratio - 1) > _SAME_PITCH:
        raise CalibrationError(
            f"the vertical pixel pitch comes out as {1e6 * ratio * pixel_pitch[1]:.4g} um where "
            f"{1e6 * pixel_pitch[1]:.4g} um was given; {_pitch_advice(ratio)}"
        )


def _pitch_advice(ratio: float) -> str:
    if abs(ratio - 0.5) < 0.5 * _SAME_PITCH:
        return "the pictures are frames where the pitch is that of fields: give --scan interlaced"
    if abs(ratio - 2.0) < 2.0 * _SAME_PITCH:
        return "the pictures are fields where the pitch is that of frames: give that of field lines"
    return "check both pixel pitches, and that the pictures were not scaled"


def folds(values: Floats, sensor: tuple[int, int]) -> bool:
    """Whether the lens model maps two directions to one point somewhere on the sensor.

    A polynomial that is not held by corners near the edges may turn back there, and then cannot
    be undone.
    """
    focal, aspect, u, v = values[:4]
    k1, k2, _, _, k3 = values[DISTORTION]
    edges = np.array([[x, y] for x in (0, sensor[0] - 1) for y in (0, sensor[1] - 1)])
    seen = np.hypot(edges[:, 0] - u, (edges[:, 1] - v) * aspect).max() / focal
    r = np.linspace(0.0, 2 * seen, 400)
    distorted = r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6)
    turns = np.diff(distorted) <= 0
    reach = distorted[int(np.argmax(turns))] if turns.any() else distorted[-1]
    return bool(reach < seen)


def refuse_folds(interior: Interior, sensor: tuple[int, int], order: int) -> None:
    """Refuse a lens model that cannot be undone on the whole sensor.

    Raises
    ------
    CalibrationError
        If it folds.
    """
    if folds(interior.values, sensor):
        raise CalibrationError(
            f"{_FOLDS} with {order} distortion coefficients: no corners near the edges hold it; "
            "photograph the board in the corners of the picture, or choose fewer coefficients"
        )
