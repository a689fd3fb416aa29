"""The glint's true place: where the body mirrors the lamp's centre line into the camera.

Found from the law of reflection alone, without tracing or rendering anything: on the body's tube
the view direction, mirrored at the surface's normal, must meet the lamp's centre line. For a lamp
parallel to tunnel X that is one equation in the plane of Y and Z for the angle of the normal about
the axis. On a cylinder Newton's method solves it. On a superellipse, whose flats hardly turn their
normal, it is halved in: between the directions to camera and lamp there is just one solution, since
the section is convex.
"""

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from render_sim.bodies import facing_point
from render_sim.projection import Pinhole, window_columns
from render_sim.scene import Scene

__all__ = ["glint_line", "mirror_points"]

Floats = NDArray[np.float64]
_COLUMNS_FITTED = 48
_BEYOND_RAD = 0.1  # beyond camera and lamp, which are not equally far in all columns
_HALVINGS = 60


def mirror_points(scene: Scene, poses: Floats, columns: Floats) -> Floats:
    """Return where the body mirrors the lamp's centre line, one point a column.

    Parameters
    ----------
    scene : Scene
        Camera, lamp and the body's tube, of a mesh file its radius; both are taken as endless. The
        lens's distortion plays no part: a column is the plane that an undistorted column would see.
    poses : ndarray
        Poses, model to tunnel [..., 4, 4] [m].
    columns : ndarray
        Sensor columns [column].

    Returns
    -------
    ndarray
        Tunnel X, Y, Z of the points [..., column, 3] [m].

    Raises
    ------
    InputError
        If there is no such point in some column.
    """
    camera = Pinhole.of(scene)
    slant = (columns - camera.u0) / camera.fx
    planes = np.stack([np.ones_like(slant), -slant, np.zeros_like(slant)], axis=-1)
    planes = planes @ camera.rotation.T
    solve = _newton if scene.body.is_round else _halving
    points, is_mirrored = solve(scene, poses, camera, planes)
    if not is_mirrored:
        raise InputError("the body does not mirror the lamp into every column; move lamp or camera")
    return points


def _newton(scene: Scene, poses: Floats, camera: Pinhole, planes: Floats) -> tuple[Floats, bool]:
    """Return the mirror points of a cylinder, and whether there are any."""
    frame = poses[..., None, :, :]
    guess = _first_guess(scene, poses, camera)
    angle = np.broadcast_to(guess[..., None], _shape(poses, planes))
    step = 1e-5
    for _ in range(12):
        slope = [_pass(scene, frame, camera, planes, angle + d)[0] for d in (step, -step)]
        miss, towards, points = _pass(scene, frame, camera, planes, angle)
        change = miss * 2.0 * step / (slope[0] - slope[1])
        angle = angle - change
        if np.max(np.abs(change), initial=0.0) < 1e-12 and np.all(towards > 0.0):
            return points, True
    return points, False


def _halving(scene: Scene, poses: Floats, camera: Pinhole, planes: Floats) -> tuple[Floats, bool]:
    """Return the mirror points of any convex section, and whether there are any."""
    frame = poses[..., None, :, :]
    camera_angle, lamp_angle = (
        _angle_of(poses, place) for place in (camera.centre_m, np.array(scene.lamp.centre_m))
    )
    apart = np.mod(lamp_angle - camera_angle + np.pi, 2.0 * np.pi) - np.pi
    margin = np.copysign(_BEYOND_RAD, apart)
    ends = (camera_angle - margin, camera_angle + apart + margin)
    low, high = (np.broadcast_to(end[..., None], _shape(poses, planes)) for end in ends)
    at_low, at_high = (_pass(scene, frame, camera, planes, angle)[0] for angle in (low, high))
    if np.any(at_low * at_high > 0.0):
        return frame[..., :3, 3], False
    for _ in range(_HALVINGS):
        half = 0.5 * (low + high)
        is_below = _pass(scene, frame, camera, planes, half)[0] * at_low > 0.0
        low, high = np.where(is_below, half, low), np.where(is_below, high, half)
    _, towards, points = _pass(scene, frame, camera, planes, 0.5 * (low + high))
    return points, bool(np.all(towards > 0.0))


def _angle_of(poses: Floats, place_m: Floats) -> Floats:
    """Return the angle about the body's axis, from its top towards its +y, of a place."""
    away = place_m - poses[..., :3, 3]
    side, up = (np.sum(poses[..., :3, k] * away, axis=-1) for k in (1, 2))
    return np.asarray(np.arctan2(side, up))


def _shape(poses: Floats, planes: Floats) -> tuple[int, ...]:
    return (*poses.shape[:-2], len(planes))


def _first_guess(scene: Scene, poses: Floats, camera: Pinhole) -> Floats:
    """Return the angle round the axis of the bisector of camera and lamp, both from the origin."""
    directions = [camera.centre_m, np.array(scene.lamp.centre_m)]
    bisector = sum(d / np.linalg.norm(d) for d in directions)
    side, up = poses[..., :3, 1] @ bisector, poses[..., :3, 2] @ bisector
    return np.asarray(np.arctan2(side, up))


def _pass(
    scene: Scene, frame: Floats, camera: Pinhole, planes: Floats, angle: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return how the mirrored rays pass the lamp, across and towards it, and their points [m]."""
    axis, side, up = frame[..., :3, 0], frame[..., :3, 1], frame[..., :3, 2]
    normal = np.sin(angle)[..., None] * side + np.cos(angle)[..., None] * up
    if scene.body.is_round:
        foot = frame[..., :3, 3] + scene.body.radius_m * normal
    else:
        y, z = facing_point(scene.body, angle)
        foot = frame[..., :3, 3] + y[..., None] * side + z[..., None] * up
    station = np.sum((camera.centre_m - foot) * planes, -1) / np.sum(axis * planes, -1)
    points = foot + station[..., None] * axis
    view = camera.centre_m - points
    view = view / np.linalg.norm(view, axis=-1, keepdims=True)
    mirrored = 2.0 * np.sum(normal * view, -1, keepdims=True) * normal - view
    to_lamp = np.array(scene.lamp.centre_m) - points
    miss = to_lamp[..., 1] * mirrored[..., 2] - to_lamp[..., 2] * mirrored[..., 1]
    towards = to_lamp[..., 1] * mirrored[..., 1] + to_lamp[..., 2] * mirrored[..., 2]
    return miss, towards, points


def glint_line(scene: Scene, poses: Floats) -> tuple[Floats, Floats]:
    """Return the straight line that an ideal camera at the scene's true place would measure.

    The mirror points of the window's columns are seen on the plane Y = `scene.glint_y_m` and a
    straight line is fitted to them, every column with the same weight.

    Parameters
    ----------
    scene : Scene
        The scene.
    poses : ndarray
        Poses, model to tunnel [..., 4, 4] [m].

    Returns
    -------
    angle_rad : ndarray
        Angle of the line, positive for nose up [...] [rad].
    intercept_m : ndarray
        Its Z at X = 0 [...] [m].
    """
    recorded = window_columns(scene)
    columns = np.linspace(recorded[0], recorded[-1], _COLUMNS_FITTED)
    centre = Pinhole.of(scene).centre_m
    rays = mirror_points(scene, poses, columns) - centre
    seen = centre + rays * ((scene.glint_y_m - centre[1]) / rays[..., 1])[..., None]
    x, z = seen[..., 0], seen[..., 2]
    x_mean, z_mean = x.mean(axis=-1), z.mean(axis=-1)
    spread = x - x_mean[..., None]
    slope = np.sum(spread * z, axis=-1) / np.sum(spread**2, axis=-1)
    sign = -1.0 if scene.nose == "left" else 1.0
    return sign * np.arctan(slope), z_mean - slope * x_mean
