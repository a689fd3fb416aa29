"""What cannot give a pose, and why: refused before the fit, or when its result cannot be."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.resection._attitude import angle_between
from calibration.resection._pose_fit import POSE, Problem
from calibration.resection.file import ResectedTarget
from glint_aoa.errors import CalibrationError
from glint_aoa.geometry import rotation_matrix

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_THIN = 0.005  # width of what counts as a line, of its length
_FLAT = 0.01
_FEWEST = 4
UNITS_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "ft": 304.8, "m": 1000.0}
"""Units that are taken for each other, in millimetres."""

UNIT_NAMES = {
    "mm": "millimetres",
    "cm": "centimetres",
    "in": "inches",
    "ft": "feet",
    "m": "metres",
}
"""Their names in words."""

_MIXED_UP = 2.0  # times as far as the setup says: from here on a unit may be the cause
_NEAR_UNIT = 0.2
_FAR_OFF = 5.0
_UNEXPLAINED = 0.05  # rms residual over the image's spread
_LEAST_PIXELS = 12.0  # a sensor's width in millimetres, or less
_SIDEWAYS = np.radians(89.0)
_VAGUE = np.radians(20.0)
_VAGUE_PLACE = 0.2  # of the distance


def least_number(problem: Problem) -> int:
    """Return how many targets are needed."""
    unknown = problem.n_free - int(problem.also_measured.sum())
    return _FEWEST if problem.n_free == 6 else max(2, unknown // 2 + 1)


def check_arrangement(ids: Sequence[str], problem: Problem) -> None:
    """Refuse too few targets, and targets on a line."""
    points, n, least = problem.points, len(ids), least_number(problem)
    free_turn = not problem.held[3:].all()
    if n >= 3 and free_turn and thickness(points)[0] < _THIN:
        raise CalibrationError(f"targets {_list(ids)} lie on one line; add targets off that line")
    if n < least:
        raise CalibrationError(
            f"{n} measured target{'s' if n > 1 else ''} cannot give the pose; measure {least} or "
            "more, or hold what is known of the camera (--hold)"
        )
    if problem.n_free < 6:
        return
    lone = _lone_target(points)
    if lone is not None:
        rest = [name for i, name in enumerate(ids) if i != lone]
        raise CalibrationError(
            f"targets {_list(rest)} lie on one line and only {ids[lone]} off it, which nothing "
            "checks; add a target off that line"
        )
    if thickness(problem.interior.normalised(problem.uv))[0] < _THIN:
        raise CalibrationError(
            "the targets appear on one line in the image: the camera lies in their plane; "
            "move the target field or the camera"
        )


def suffices(problem: Problem, used: Bools) -> bool:
    """Whether the targets of a mask still give a pose."""
    if used.sum() < max(least_number(problem), (used.size + 1) // 2):
        return False
    if problem.held[3:].all():
        return True
    points = problem.points[used]
    return bool(thickness(points)[0] >= _THIN) and (
        problem.n_free < 6 or _lone_target(points) is None
    )


def thickness(points: Floats) -> tuple[float, float]:
    """Return second and third principal extent of points, of the first."""
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    extent = np.concatenate([extent, np.zeros(3 - extent.size)]) if extent.size < 3 else extent
    return float(extent[1] / extent[0]), float(extent[2] / extent[0])


def is_coplanar(points: Floats) -> bool:
    """Whether targets lie in a plane, as far as it matters for a pose."""
    return thickness(points)[1] < _FLAT


def check_on_sensor(ids: Sequence[str], uv: Floats, sensor: tuple[int, int] | None) -> None:
    """Refuse measurements that no field of the sensor can hold, or that are hardly in pixels."""
    width, height = np.ptp(uv, axis=0)
    if len(ids) > 1 and max(width, height) < _LEAST_PIXELS:
        raise CalibrationError(
            f"the targets are measured within {width:.3g} x {height:.3g} pixels; give u and v in "
            "pixels, not in millimetres, or come nearer with the camera"
        )
    if sensor is None:
        return
    outside = ((uv < -0.5) | (uv > np.array(sensor))).any(axis=1)
    if outside.any():
        first = int(np.argmax(outside))
        u, v = uv[first]
        raise CalibrationError(
            f"target {ids[first]} is measured at u = {u:g}, v = {v:g}, outside the sensor's "
            f"{sensor[0]} columns and {sensor[1]} lines of a field; give pixels, v in field lines"
        )


def check_in_front(ids: Sequence[str], depth: Floats) -> None:
    """Refuse targets that lie behind the camera and yet are measured."""
    if (depth > 0).all():
        return
    behind = [name for name, is_behind in zip(ids, depth <= 0, strict=True) if is_behind]
    if len(behind) == len(ids):
        raise CalibrationError(
            "all targets lie behind the camera; check the sign of their Y, and position and "
            "rotation in [camera]"
        )
    raise CalibrationError(
        f"target {behind[0]} lies behind the camera that the others show; check the sign of its Y"
    )


def check_scale(points: Floats, pose: Floats, expected: Floats) -> None:
    """Refuse a pose that is as wrong as a wrong unit would make it.

    Wrong units of the targets scale all of the pose and leave no residual. Only a distance that
    is known otherwise shows them: that of the setup's own position.

    Parameters
    ----------
    points : ndarray [target, 3]
        X, Y, Z [m].
    pose : ndarray [6]
        The pose found.
    expected : ndarray [3]
        Approximate position from the setup [m].
    """
    centre = points.mean(axis=0)
    distance = float(np.linalg.norm(centre - pose[:3]))

    def misfit(factor: float) -> float:
        said = factor * float(np.linalg.norm(centre / factor - expected))
        return float(np.abs(np.log(distance / max(said, 1e-12))))

    if misfit(1.0) < np.log(_MIXED_UP):
        return
    pairs = {
        (true, taken): UNITS_MM[taken] / UNITS_MM[true]
        for true in UNITS_MM
        for taken in UNITS_MM
        if true != taken
    }
    true, taken = min(pairs, key=lambda pair: misfit(pairs[pair]))
    said = float(np.linalg.norm(centre - expected))
    if misfit(pairs[true, taken]) < _NEAR_UNIT:
        raise CalibrationError(
            f"the camera would stand {distance:.4g} m from the targets, as if "
            f"{UNIT_NAMES[true]} were taken for {UNIT_NAMES[taken]}; correct the unit of the "
            "target field"
        )
    if misfit(1.0) > np.log(_FAR_OFF):
        raise CalibrationError(
            f"the camera would stand {distance:.4g} m from the targets, position in [camera] says "
            f"{said:.4g} m; correct the unit of the target field, or position in [camera]"
        )


def check_direction(pose: Floats, expected: Floats) -> None:
    """Refuse a camera that looks the other way, and one on its side."""
    turned = angle_between(rotation_matrix(*expected), rotation_matrix(*pose[3:]))
    if turned > np.pi / 2:
        raise CalibrationError(
            f"the camera would be turned by {np.degrees(turned):.0f} deg from rotation in "
            "[camera]; check the targets' ids and the signs of their X, Y and Z, or give the "
            "approximate rotation"
        )
    if abs(pose[4]) > _SIDEWAYS:
        raise CalibrationError(
            "the camera lies on its side (phi is 90 deg), where omega and kappa are one angle; "
            "mount it upright, or turn its image by a quarter"
        )


def check_explained(rows: Sequence[ResectedTarget], *, within_noise: bool) -> None:
    """Refuse a pose that does not explain where the targets are seen."""
    if within_noise:
        return
    uv = np.array([(each.u, each.v) for each in rows])
    residual = np.array([(each.residual_u, each.residual_v) for each in rows if each.used])
    spread, rms = np.sqrt(np.mean((uv - uv.mean(axis=0)) ** 2)), np.sqrt(np.mean(residual**2))
    if rms > _UNEXPLAINED * spread:
        raise CalibrationError(
            f"no pose explains the {len(rows)} measured targets (rms residual {rms:.3g} pixels); "
            "check their ids, the unit and sign of each coordinate, and that u are columns and v "
            "lines of a field"
        )


def check_determined(pose: Floats, points: Floats, std: Floats) -> None:
    """Refuse a pose so vague that its stated uncertainty cannot hold."""
    distance = float(np.linalg.norm(points.mean(axis=0) - pose[:3]))
    limits = np.repeat([_VAGUE_PLACE * distance, _VAGUE], 3)
    vague = std > limits
    if vague.any():
        worst = int(np.argmax(std / limits))
        value = f"{std[worst]:.2g} m" if worst < 3 else f"{np.degrees(std[worst]):.2g} deg"
        raise CalibrationError(
            f"the targets do not determine {POSE[worst]} (std {value}); add targets that are "
            "further apart and at different distances, or hold what is known of the camera"
        )


def _lone_target(points: Floats) -> int | None:
    """Return the target without which the others lie on a line, or None."""
    for i in range(len(points)):
        if thickness(np.delete(points, i, axis=0))[0] < _THIN:
            return i
    return None


def _list(ids: Sequence[str]) -> str:
    names = ", ".join(ids[:5])
    return names + (f" and {len(ids) - 5} more" if len(ids) > 5 else "")
