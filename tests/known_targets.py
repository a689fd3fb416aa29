"""Targets of known place, and where an independent camera sees them."""

import tomllib
from dataclasses import replace

import numpy as np
from independent_camera import Camera, turned

from calibration.resection.target_field import ImageTargets, TargetField
from glint_aoa.setup import Setup

TRUE = Camera(
    position=(0.012, -1.40, 0.055),
    rotation=(0.8, -1.2, 0.6),
    distortion=(-0.1, 0.1, 0.001, -0.001, 0.0),
)
APPROXIMATE = replace(TRUE, position=(0.0, -1.45, 0.06), rotation=(0.0, 0.0, 0.0))
ALIGNED = Camera(position=(0.012, -1.4224, 0.055))
STD = np.array([0.05, 0.02])  # pixels; nearly equal in metres
ANGLES = ("omega", "phi", "kappa")


def in_setup(camera):
    return Setup.model_validate(tomllib.loads(camera.toml)).camera


def board(columns=4, rows=3, tilt=15.0):
    """A plane, turned about the tunnel's Z."""
    x, z = (
        each.ravel()
        for each in np.meshgrid(np.linspace(-0.1, 0.1, columns), np.linspace(0, 0.1, rows))
    )
    return np.stack([x, np.zeros(x.size), z], axis=-1) @ turned("z", tilt).T


def in_space():
    return (
        board(tilt=0.0) + np.array([0, 1, 0]) * np.resize([-0.06, 0.05, 0, 0.09, 0.02], 12)[:, None]
    )


def names(n):
    return tuple(f"T{i + 1}" for i in range(n))


def field(points, ids=None, std=0.0):
    points = np.asarray(points, float)
    return TargetField(ids or names(len(points)), points, np.full(points.shape, std))


def seen(points, *, camera=TRUE, rng=None, std=STD, stated=True, ids=None):
    uv = np.stack(camera.pixels(points), axis=-1)
    if rng is not None:
        uv = uv + rng.normal(size=uv.shape) * std
    covariance = np.broadcast_to(np.diag(np.square(std)), (len(uv), 2, 2)) if stated else None
    return ImageTargets(ids or names(len(uv)), uv, covariance)


def true_pose(camera=TRUE):
    return np.array([*camera.position, *np.radians(camera.rotation)])
