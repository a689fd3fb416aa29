"""Compiled geometry of one body seen by one camera, in the model frame; plain numbers throughout.

There the body is |y / a|^n + |z / b|^n = 1; for a = b and n = 2 a cylinder, in closed form. Packed
arguments:

inner    fx, fy, u0, v0
lens     k1, k2, p1, p2, k3, all zero for none
section  half width a, half height b, exponent n
mark     station and half its length, azimuth and half its width, 1 for an ellipse, its surface
"""

# mypy: disable-error-code="no-untyped-def"
# numba infers the types when it compiles

import math

import numpy as np
from numba import njit

from render_sim.projection import undistort

__all__ = ["edges", "hit", "in_model_frame", "is_round", "misses", "outward", "ray", "to_model"]

_undistort = njit(undistort)
_STEPS = 40


@njit(cache=True, error_model="numpy")
def is_round(section):
    """Say whether the section is a circle."""
    return section[2] == 2.0 and section[0] == section[1]


@njit(cache=True, error_model="numpy")
def outward(y, z, section):
    """Return the direction, of any length, in which the body faces at a point of it."""
    if is_round(section):
        return y, z
    power = section[2] - 1.0
    return (
        math.copysign(abs(y / section[0]) ** power / section[0], y),
        math.copysign(abs(z / section[1]) ** power / section[1], z),
    )


@njit(cache=True, error_model="numpy")
def to_model(pose, x, y, z, result):
    """Turn a tunnel direction into the model frame."""
    for i in range(3):
        result[i] = pose[0, i] * x + pose[1, i] * y + pose[2, i] * z


@njit(cache=True, error_model="numpy")
def in_model_frame(pose, centre, rotation, lamp):
    """Bring all into the model frame: camera axes, eye, lamp samples, tunnel's X."""
    axes, eye, moved = np.empty((3, 3)), np.empty(3), np.empty_like(lamp)
    for j in range(3):
        to_model(pose, rotation[0, j], rotation[1, j], rotation[2, j], axes[:, j])
    x, y, z = pose[0, 3], pose[1, 3], pose[2, 3]
    to_model(pose, centre[0] - x, centre[1] - y, centre[2] - z, eye)
    for j in range(lamp.shape[0]):
        to_model(pose, lamp[j, 0] - x, lamp[j, 1] - y, lamp[j, 2] - z, moved[j])
        to_model(pose, lamp[j, 4], lamp[j, 5], lamp[j, 6], moved[j, 4:])
        moved[j, 3], moved[j, 7] = lamp[j, 3], lamp[j, 7]
    along = np.empty(3)
    to_model(pose, 1.0, 0.0, 0.0, along)
    return axes, eye, moved, along


@njit(cache=True, error_model="numpy")
def ray(u, v, inner, lens, axes):
    x = (u - inner[2]) / inner[0]
    y = (v - inner[3]) / inner[1]
    if lens[0] != 0.0 or lens[1] != 0.0 or lens[2] != 0.0 or lens[3] != 0.0 or lens[4] != 0.0:
        x, y = _undistort(x, y, lens)
    return (
        axes[0, 0] * x + axes[0, 1] - axes[0, 2] * y,
        axes[1, 0] * x + axes[1, 1] - axes[1, 2] * y,
        axes[2, 0] * x + axes[2, 1] - axes[2, 2] * y,
    )


@njit(cache=True, error_model="numpy")
def _squarish_hit(dx, dy, dz, eye, section):
    """Meet a superellipse by Newton's method, from where the ray enters the circle round it.

    Along the ray |y / a|^n + |z / b|^n is convex, so the steps run up to the nearer root and never
    past it.
    """
    n = section[2]
    y, z, ry, rz = eye[1] / section[0], eye[2] / section[1], dy / section[0], dz / section[1]
    a = ry * ry + rz * rz
    b = ry * y + rz * z
    under = b * b - a * (y * y + z * z - 2.0 ** (1.0 - 2.0 / n))
    depth = (-b - math.sqrt(max(under, 0.0))) / a
    for _ in range(_STEPS):
        at_y, at_z = y + depth * ry, z + depth * rz
        py, pz = abs(at_y) ** (n - 1.0), abs(at_z) ** (n - 1.0)
        above = py * abs(at_y) + pz * abs(at_z) - 1.0
        fall = -n * (math.copysign(py, at_y) * ry + math.copysign(pz, at_z) * rz)
        if fall <= 0.0 or above <= 1e-15:
            break
        depth += above / fall
    return eye[0] + depth * dx, eye[1] + depth * dy, eye[2] + depth * dz


@njit(cache=True, error_model="numpy")
def hit(dx, dy, dz, eye, section):
    """Return the nearer point on the body; a ray that just misses grazes it instead."""
    if not is_round(section):
        return _squarish_hit(dx, dy, dz, eye, section)
    radius = section[0]
    a = dy * dy + dz * dz
    b = eye[1] * dy + eye[2] * dz
    under = b * b - a * (eye[1] * eye[1] + eye[2] * eye[2] - radius * radius)
    depth = (-b - math.sqrt(max(under, 0.0))) / a
    return eye[0] + depth * dx, eye[1] + depth * dy, eye[2] + depth * dz


@njit(cache=True, error_model="numpy")
def misses(dx, dy, dz, eye, section):
    """Say whether a ray passes the body by."""
    if is_round(section):
        b = eye[1] * dy + eye[2] * dz
        reach = eye[1] * eye[1] + eye[2] * eye[2] - section[0] * section[0]
        return b * b < (dy * dy + dz * dz) * reach
    _, y, z = hit(dx, dy, dz, eye, section)
    return abs(y / section[0]) ** section[2] + abs(z / section[1]) ** section[2] > 1.0 + 1e-9


@njit(cache=True, error_model="numpy")
def _touching(eye, sign, section):
    """Return the normal of the plane through the eye that touches the body on one side."""
    if is_round(section):
        radius, distance2 = section[0], eye[1] * eye[1] + eye[2] * eye[2]
        along = radius / distance2
        across = math.sqrt(distance2 - radius * radius) / distance2
        return (
            along * eye[1] - sign * across * eye[2],
            along * eye[2] + sign * across * eye[1],
        )
    # the plane of normal angle t is as far from the axis as the support function of the section
    dual = section[2] / (section[2] - 1.0)
    low = math.atan2(eye[1], eye[2])
    high = low - sign * math.pi
    for _ in range(60):
        half = 0.5 * (low + high)
        ny, nz = math.sin(half), math.cos(half)
        support = (abs(section[0] * ny) ** dual + abs(section[1] * nz) ** dual) ** (1.0 / dual)
        if eye[1] * ny + eye[2] * nz > support:
            low = half
        else:
            high = half
    return math.sin(low), math.cos(low)


@njit(cache=True, error_model="numpy")
def edges(u, v0, v1, inner, lens, axes, eye, section):
    """Return the lines between which column u sees the body, upper one first.

    The two planes through the eye that touch the body; for a lens without distortion the secant
    step is exact.
    """
    found = np.empty(2)
    for side in range(2):
        ny, nz = _touching(eye, 1.0 if side == 0 else -1.0, section)
        low, high = v0, v1
        _, dy, dz = ray(u, low, inner, lens, axes)
        at_low = ny * dy + nz * dz
        for _ in range(6):
            _, dy, dz = ray(u, high, inner, lens, axes)
            at_high = ny * dy + nz * dz
            if abs(at_high - at_low) < 1e-15:
                break
            step = at_high * (high - low) / (at_high - at_low)
            low, at_low = high, at_high
            high -= step
        found[side] = high
    return min(found[0], found[1]), max(found[0], found[1])


@njit(cache=True, error_model="numpy")
def _overlap(low, high, half):
    """Return which part of an interval lies within `half` of zero."""
    if high - low < 1e-12:
        return 1.0 if abs(low) <= half else 0.0
    return max(min(high, half) - max(low, -half), 0.0) / (high - low)


@njit(cache=True, error_model="numpy")
def turned(angle):
    """Return the same direction as an angle between -pi and pi."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@njit(cache=True, error_model="numpy")
def covered(mark, station, wide, azimuth, high):
    """Return the share of a cell that a marking covers; `wide` and `high` are its extents."""
    x, turn = station - mark[0], turned(azimuth - mark[2])
    if mark[4] == 0.0:
        along = _overlap(x - 0.5 * wide, x + 0.5 * wide, mark[1])
        return along * _overlap(turn - 0.5 * high, turn + 0.5 * high, mark[3])
    x, turn = x / mark[1], turn / mark[3]
    away = math.sqrt(x * x + turn * turn)
    if away < 1e-9:
        return 1.0
    edge = (abs(x) * wide / mark[1] + abs(turn) * high / mark[3]) / away
    return min(max(0.5 + (1.0 - away) / edge, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def is_on(mark, x, azimuth):
    """Say whether a point is on a marking."""
    x, turn = x - mark[0], turned(azimuth - mark[2])
    if mark[4] == 0.0:
        return abs(x) <= mark[1] and abs(turn) <= mark[3]
    return (x / mark[1]) ** 2 + (turn / mark[3]) ** 2 <= 1.0
