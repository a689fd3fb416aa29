"""Acquisition records of a model that swings on its sting, from rigid-body kinematics alone.

Nothing of the program is used. The sensor's position is differentiated twice and gravity is taken
in body axes; the formula of the bias sets the amplitude only.
"""

import numpy as np

GRAVITY = 9.80665
RATE_HZ = 800.0
MODE_1 = {"plane": "yaw", "hz": 9.8, "radius": 31 * 0.0254}

# Body axes: x to the nose, z up, so y is to port and the nose goes up about -y.
AXIS = {"yaw": (0.0, 0.0, 1.0), "pitch": (0.0, -1.0, 0.0)}


def turning(axis, angle, rate, acceleration):
    """Rotation about an axis, and its second derivative, as [row, column, time]."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])[:, :, None]
    square = np.einsum("ijt,jkt->ikt", cross, cross)
    sin, cos = np.sin(angle), np.cos(angle)
    rotation = np.eye(3)[:, :, None] + sin * cross + (1 - cos) * square
    by_angle = cos * cross + sin * square
    by_angle_twice = -sin * cross + cos * square
    return rotation, by_angle * acceleration + by_angle_twice * rate**2


def swinging(time, *, pitch_deg, plane, hz, radius, tip_deg=0.15, ahead=0.0):
    """Specific force in body axes [axis, sample] of a point near the package of a model.

    The model swings about its own axis, held at pitch_deg, through a point `radius` aft of the
    package; the point felt lies `ahead` of the package. The amplitude is the one whose
    centripetal acceleration would tip a level package by tip_deg on average.
    """
    circular = 2 * np.pi * hz
    swing = np.sqrt(2 * np.radians(tip_deg) * GRAVITY / abs(radius)) / circular
    phase = circular * time + 0.3
    rotation, second = turning(
        AXIS[plane],
        swing * np.sin(phase),
        swing * circular * np.cos(phase),
        -swing * circular**2 * np.sin(phase),
    )
    acceleration = np.einsum("ijt,j->it", second, [radius + ahead, 0.0, 0.0])
    pitch = np.radians(pitch_deg)
    up = np.array([np.sin(pitch), 0.0, np.cos(pitch)])  # in axes that pitch but do not swing
    return np.einsum("ijt,it->jt", rotation, acceleration + GRAVITY * up[:, None])
