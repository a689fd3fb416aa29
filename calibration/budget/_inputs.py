"""What is uncertain of a setup's geometry, from its calibrations and from what was taped."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.budget._covariance_files import (
    StatedCovariance,
    read_camera_covariance,
    read_pose_covariance,
)
from calibration.budget._parameters import CAMERA, PARAMETERS, POSE
from glint_aoa.errors import CalibrationError, SetupError
from glint_aoa.setup import ReflectionUncertainty, Setup

__all__ = ["GeometryCovariance", "InputBlock", "geometry_covariance"]

Floats = NDArray[np.float64]

_INDEX = {each.name: number for number, each in enumerate(PARAMETERS)}


@dataclass(frozen=True, eq=False)
class InputBlock:
    """Inputs whose errors hang together, and are independent of those of all other blocks.

    Attributes
    ----------
    name : str
        Where they come from.
    parameters : tuple of str
        Names of the inputs.
    covariance : ndarray [input, input]
        In SI units and radians, 1 sigma squared.
    response : ndarray [parameter, input]
        How the geometry follows the inputs: a pose found with a wrong principal distance is
        wrong with it.
    degrees_of_freedom : float
        Of the covariance as a whole; infinite where it was stated and not estimated.
    """

    name: str
    parameters: tuple[str, ...]
    covariance: Floats
    response: Floats
    degrees_of_freedom: float = math.inf

    @property
    def std(self) -> Floats:
        """Standard deviations [input], SI units and radians."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def factor(self) -> Floats:
        """A matrix [input, input] that turns independent normal deviates into errors."""
        values, vectors = np.linalg.eigh(_correlation(self.covariance))
        return np.asarray(self.std[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True, eq=False)
class GeometryCovariance:
    """Uncertainty of the geometry.

    Attributes
    ----------
    blocks : tuple of InputBlock
        Independent blocks of inputs.
    """

    blocks: tuple[InputBlock, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the geometry's parameters, in the order of `matrix`."""
        return tuple(_INDEX)

    @property
    def matrix(self) -> Floats:
        """Joint covariance [parameter, parameter] of the geometry, SI units and radians."""
        parts = [b.response @ b.covariance @ b.response.T for b in self.blocks]
        return np.asarray(np.sum(parts, axis=0))

    @property
    def is_stated(self) -> bool:
        """Whether anything is said to be uncertain."""
        return any(block.std.any() for block in self.blocks)

    def uncertain(self) -> "GeometryCovariance":
        """Return the same without inputs that are taken as exact."""
        blocks = []
        for block in self.blocks:
            kept = np.flatnonzero(block.std)
            if kept.size:
                blocks.append(
                    InputBlock(
                        block.name,
                        tuple(block.parameters[k] for k in kept),
                        block.covariance[np.ix_(kept, kept)],
                        block.response[:, kept],
                        block.degrees_of_freedom,
                    )
                )
        return GeometryCovariance(tuple(blocks))


def geometry_covariance(setup: Setup) -> GeometryCovariance:
    """Join what the setup's calibrations and its section ``[uncertainty]`` say.

    Parameters
    ----------
    setup : Setup
        A setup whose camera is oriented.

    Returns
    -------
    GeometryCovariance
        One block for each calibration that the setup names, and one for all else, whose inputs
        are independent. A resection's pose follows the interior orientation that it was computed
        with, by the sensitivity in its file, so that errors of both calibrations correlate as
        they do.

    Raises
    ------
    SetupError
        If the setup has no camera in space.
    CalibrationError
        If a calibration cannot be read, its covariance is none, or it does not fit the other.
    """
    if not setup.camera.is_oriented:
        raise SetupError(
            "the setup has no camera in space, so nothing can be carried to the angle; give "
            "focal_length, pixel_pitch and position in [camera], or calibrate them"
        )
    camera = None if setup.camera_path is None else read_camera_covariance(setup.camera_path)
    pose = None if setup.pose_path is None else read_pose_covariance(setup.pose_path)
    follows = np.eye(len(_INDEX))
    if pose is not None:
        rows, columns = _numbers_of(POSE), _numbers_of(pose.interior)
        follows[np.ix_(rows, columns)] = pose.sensitivity
    blocks = []
    if camera is not None:
        blocks.append(_block("camera calibration", camera, follows))
    if pose is not None:
        blocks.append(_block("space resection", pose, follows))
    calibrated = {name for block in blocks for name in block.parameters}
    stds = {name: std for name, std in _taped(setup).items() if name not in calibrated}
    columns = _numbers_of(stds)
    blocks.append(
        InputBlock("taped", tuple(stds), np.diag([*stds.values()]) ** 2, follows[:, columns])
    )
    if pose is not None:
        _check_pose_follows(setup.pose_path, blocks, pose.interior)
    return GeometryCovariance(tuple(blocks))


def _correlation(covariance: Floats) -> Floats:
    std = np.sqrt(np.diag(covariance))
    scale = np.where(std > 0, std, 1.0)
    return np.asarray(covariance / scale[:, None] / scale)


def _block(name: str, stated: StatedCovariance, follows: Floats) -> InputBlock:
    response = follows[:, _numbers_of(stated.parameters)]
    return InputBlock(name, stated.parameters, stated.matrix, response, stated.degrees_of_freedom)


def _numbers_of(names: Iterable[str]) -> list[int]:
    return [_INDEX[name] for name in names]


def _taped(setup: Setup) -> dict[str, float]:
    said = setup.uncertainty
    stds = [
        *(said.focal_length, *said.pixel_pitch, *said.principal_point, *said.distortion),
        *(*said.position, *said.rotation, said.y, said.yaw),
    ]
    if setup.glint.reflection is not None:
        body = said.reflection or ReflectionUncertainty()
        stds += [body.radius, body.axis_y, *body.lamp, *body.lamp_direction]
    return dict(zip(_INDEX, stds, strict=False))


def _check_pose_follows(
    path: Path | None, blocks: Sequence[InputBlock], interior: tuple[str, ...]
) -> None:
    """Refuse a pose of which nobody knows how an interior that is uncertain changes it."""
    for block in blocks:
        for name, std in zip(block.parameters, block.std, strict=True):
            if name in CAMERA and std > 0 and name not in interior:
                raise CalibrationError(
                    f"{path}: interior does not say how the pose follows {name}, which is "
                    "uncertain; repeat glint-aoa calibrate resect with the present camera"
                )
