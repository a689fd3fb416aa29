"""The covariances that the files of calibrations state."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.budget._parameters import CAMERA
from calibration.camera.file import read_camera_file
from calibration.resection.file import read_pose_file
from glint_aoa.errors import CalibrationError

__all__ = [
    "PoseCovariance",
    "StatedCovariance",
    "read_camera_covariance",
    "read_pose_covariance",
]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StatedCovariance:
    """What a calibration's file says of its uncertainty.

    Attributes
    ----------
    parameters : tuple of str
        Names of what was estimated.
    matrix : ndarray [parameter, parameter]
        Their covariance, SI units and radians.
    degrees_of_freedom : float
        Infinite where the noise behind it was stated and not estimated.
    """

    parameters: tuple[str, ...]
    matrix: Floats
    degrees_of_freedom: float


@dataclass(frozen=True, eq=False)
class PoseCovariance(StatedCovariance):
    """The same of a pose, and how it follows the interior orientation that it was found with.

    Attributes
    ----------
    interior : tuple of str
        Names of the interior's parameters.
    sensitivity : ndarray [6, interior]
        Change of the pose with each.
    """

    interior: tuple[str, ...]
    sensitivity: Floats


def read_camera_covariance(path: Path) -> StatedCovariance:
    """Read what a camera calibration is uncertain of.

    Raises
    ------
    CalibrationError
        If the file cannot be used, or its covariance is none.
    """
    file = read_camera_file(path)
    return StatedCovariance(
        parameters=tuple(file.covariance.parameters),
        matrix=np.array(file.covariance.matrix),
        degrees_of_freedom=file.fit.degrees_of_freedom or math.inf,
    )


def read_pose_covariance(path: Path) -> PoseCovariance:
    """Read what a space resection is uncertain of.

    Raises
    ------
    CalibrationError
        If the file cannot be used, or its covariance is none.
    """
    file = read_pose_file(path)
    unknown = [name for name in file.interior.parameters if name not in CAMERA]
    if unknown:
        raise CalibrationError(
            f"{path}: interior.parameters: {unknown[0]} is unknown; repeat glint-aoa calibrate "
            "resect"
        )
    known = file.fit.noise_known and file.fit.excess == 1
    return PoseCovariance(
        parameters=file.covariance.parameters,
        matrix=np.array(file.covariance.matrix),
        degrees_of_freedom=math.inf if known else file.fit.degrees_of_freedom,
        interior=file.interior.parameters,
        sensitivity=np.array(file.interior.sensitivity),
    )
