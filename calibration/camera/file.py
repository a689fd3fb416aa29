"""The TOML file of a camera calibration: what it holds, and how it is read and written."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from calibration._result_file import ResultFile
from glint_aoa.setup import Section
from glint_aoa.setup.section import Number, PositiveCount, PositiveMetres

_RESULT = ResultFile(
    "camera calibration",
    "camera",
    """\
# Camera calibration of glint-aoa. [camera] can be pasted into a setup, or the setup names this
# file: [calibration] camera = "...". The horizontal pixel pitch is held as given.
# [covariance] is that of the parameters it lists, in metres and pixels; [bootstrap] is the same
# by resampling the images. Every std is 1 sigma.
# {summary}

""",
)

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0)]
_Positive = Annotated[float, Field(allow_inf_nan=False, gt=0)]
_Count = Annotated[int, Field(ge=0)]
_Matrix = list[list[_Finite]]
ParameterName = Literal[
    "focal_length_m",
    "pixel_pitch_v_m",
    "principal_point_u",
    "principal_point_v",
    "k1",
    "k2",
    "p1",
    "p2",
    "k3",
]
PARAMETERS: tuple[str, ...] = get_args(ParameterName)
"""Names of the parameters that may be estimated; metres and pixels."""


class Provenance(Section):
    """Where the numbers of a calibration came from.

    Attributes
    ----------
    files : tuple of str
        Pictures and recordings of the board.
    date : str
        When the camera was calibrated, ISO 8601; empty if unknown.
    """

    files: tuple[str, ...] = ()
    date: str = ""


class _Camera(Section):
    focal_length: PositiveMetres
    pixel_pitch: tuple[PositiveMetres, PositiveMetres]
    sensor: tuple[PositiveCount, PositiveCount]
    principal_point: tuple[Number, Number]
    distortion: tuple[Number, Number, Number, Number, Number]


class _Covariance(Section):
    parameters: Annotated[list[ParameterName], Field(min_length=1)]
    matrix: _Matrix


class _Bootstrap(Section):
    draws: PositiveCount
    seed: _Count
    matrix: _Matrix


class _Board(Section):
    description: str
    std_m: _NotNegative
    departure_m: _NotNegative
    departure_std_m: _NotNegative


class _Fit(Section):
    rms: _NotNegative
    noise: tuple[_Positive, _Positive]
    degrees_of_freedom: _NotNegative
    hold: list[Literal["pixel_pitch_v", "principal_point"]] = Field(default_factory=list)
    criterion: dict[str, _NotNegative] = Field(default_factory=dict)


class ImageEntry(Section):
    """One picture of the board, as the file lists it."""

    name: str
    used: bool
    reason: str = ""
    corners: _Count = 0
    rms: _NotNegative | None = None
    tilt_deg: _Finite | None = None
    distance_m: _Finite | None = None


class CameraFile(Section):
    """The content of the file of a camera calibration."""

    kind: Literal["camera calibration"]
    camera: _Camera
    covariance: _Covariance
    bootstrap: _Bootstrap | None = None
    fit: _Fit
    board: _Board
    image: list[ImageEntry] = Field(default_factory=list)
    provenance: Provenance = Provenance()

    @model_validator(mode="after")
    def _covariances_are_such(self) -> Self:
        size = len(self.covariance.parameters)
        if len(set(self.covariance.parameters)) < size:
            raise ValueError("covariance.parameters names one twice")
        _check_covariance("covariance.matrix", self.covariance.matrix, size)
        if self.bootstrap is not None:
            _check_covariance("bootstrap.matrix", self.bootstrap.matrix, size)
        return self


def _check_covariance(where: str, rows: _Matrix, size: int) -> None:
    if len(rows) != size or any(len(row) != size for row in rows):
        raise ValueError(f"{where} must be {size} x {size}, as the parameters are")
    covariance = np.array(rows)
    if (np.diag(covariance) <= 0).any():
        raise ValueError(f"{where} has a variance that is not greater than zero")
    scale = 1 / np.sqrt(np.diag(covariance))
    correlation = covariance * np.outer(scale, scale)
    if np.abs(correlation - correlation.T).max() > 1e-9:
        raise ValueError(f"{where} is not symmetric")
    if np.linalg.eigvalsh(correlation).min() < -1e-9:
        raise ValueError(f"{where} has a negative variance")


def lengths(values: ArrayLike, unit: str, scale: float) -> list[str]:
    """Write lengths [m] with their unit, to the last digit that counts."""
    return [f"{scale * value:.15g} {unit}" for value in np.atleast_1d(values).tolist()]


def write_camera_file(
    path: Path, content: dict[str, Any], summary: str, *, overwrite: bool
) -> None:
    """Write the file; see `calibration.camera.CameraCalibration.save`."""
    CameraFile.model_validate(content)
    _RESULT.write(path, content, summary, overwrite=overwrite)


def read_camera_file(path: Path) -> CameraFile:
    """Read the file; see `calibration.camera.CameraCalibration.load`."""
    return _RESULT.validated(path, _RESULT.read(path), CameraFile)
