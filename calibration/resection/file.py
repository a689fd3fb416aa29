"""The TOML file of a space resection: what it holds, and how it is read and written."""

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from calibration._result_file import ResultFile
from glint_aoa.setup import Section, quantity

PARAMETERS = ("X_m", "Y_m", "Z_m", "omega_rad", "phi_rad", "kappa_rad")
"""Names of the pose's parameters, as the file has them."""

_RESULT = ResultFile(
    "space resection",
    "resect",
    """\
# Space resection of glint-aoa: the camera's pose in the tunnel frame.
# omega, phi, kappa: R = Rz(kappa) Ry(phi) Rx(omega), zero for an optical axis along +Y.
# The textbook's angles: M = R3(kappa) R2(phi) R1(omega), tunnel to camera axes x right, y up,
# z towards the viewer; omega is 90 deg for the same camera.
# The covariance holds the noise of image and targets, and what was held; interior.values is the
# interior orientation that the pose was found with, interior.sensitivity the change of the pose
# with it. Every std is 1 sigma.
# {summary}

""",
)

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Positive = Annotated[float, Field(allow_inf_nan=False, gt=0)]
_NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0)]
_Metres = Annotated[float, quantity("m"), Field(allow_inf_nan=False)]
_Radians = Annotated[float, quantity("rad"), Field(allow_inf_nan=False)]
_Name = Literal["X", "Y", "Z", "omega", "phi", "kappa"]


class ResectionProvenance(Section):
    """Where the numbers of a resection came from.

    Attributes
    ----------
    targets, measured : str
        Files of the target field and of the image or the image measurements.
    setup_hash : str
        Hash of the setup that gave the interior orientation.
    date : str
        When the image was taken, ISO 8601; empty if unknown.
    """

    targets: str = ""
    measured: str = ""
    setup_hash: str = ""
    date: str = ""


class MirrorPose(Section):
    """The second pose that targets in a plane allow.

    Attributes
    ----------
    rotation_deg : tuple of float
        Its omega, phi, kappa [deg].
    chi_square_above : float
        By how much its chi-square lies above that of the pose taken; below zero where the setup's
        approximate rotation decided.
    ambiguous : bool
        Whether the measurements alone cannot tell the two apart.
    """

    rotation_deg: tuple[_Finite, _Finite, _Finite]
    chi_square_above: _Finite
    ambiguous: bool


class _Camera(Section):
    position: tuple[_Metres, _Metres, _Metres]
    rotation: tuple[_Radians, _Radians, _Radians]


class _Covariance(Section):
    parameters: tuple[str, ...]
    matrix: list[list[_Finite]]

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if self.parameters != PARAMETERS:
            raise ValueError(f"parameters must be {', '.join(PARAMETERS)}")
        if len(self.matrix) != 6 or any(len(row) != 6 for row in self.matrix):
            raise ValueError("matrix must be 6 x 6")
        covariance = np.array(self.matrix)
        scale = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
        scale[scale == 0] = 1.0
        correlation = covariance / np.outer(scale, scale)
        if np.abs(correlation - correlation.T).max() > 1e-9:
            raise ValueError("matrix is not symmetric")
        if np.linalg.eigvalsh(correlation).min() < -1e-9:
            raise ValueError("matrix has a negative variance")
        return self


class _Interior(Section):
    parameters: tuple[str, ...]
    sensitivity: list[list[_Finite]]
    values: list[_Finite] | None = None  # not in files of earlier versions

    @model_validator(mode="after")
    def _shapes_agree(self) -> Self:
        n = len(self.parameters)
        if len(self.sensitivity) != 6 or any(len(row) != n for row in self.sensitivity):
            raise ValueError(f"sensitivity must be 6 x {n}, as there are {n} parameters")
        if self.values is not None and len(self.values) != n:
            raise ValueError(f"values must be {n}, as there are {n} parameters")
        return self


class _Textbook(Section):
    omega_deg: _Finite
    phi_deg: _Finite
    kappa_deg: _Finite


class _Fit(Section):
    chi_square: _NotNegative
    degrees_of_freedom: Annotated[int, Field(ge=1)]
    excess: _Positive
    widening: _Positive
    noise_known: bool
    rms_u_pixels: _NotNegative
    rms_v_pixels: _NotNegative
    coplanar: bool
    held: tuple[_Name, ...] = ()
    distance_m: _Positive | None = None
    distance_std_m: _Positive | None = None
    mirror: MirrorPose | None = None


class ResectedTarget(Section):
    """A target of a resection.

    Attributes
    ----------
    id : str
        Its name.
    u, v : float
        Where it was measured [pixels].
    std_u, std_v : float
        Uncertainty there, 1 sigma, that of its own place included [pixels].
    residual_u, residual_v : float
        Measured less computed [pixels].
    used : bool
        Whether the pose was fitted to it.
    reason : str
        Why it was left out; empty where it was used.
    """

    id: str
    u: _Finite
    v: _Finite
    std_u: _Positive
    std_v: _Positive
    residual_u: _Finite
    residual_v: _Finite
    used: bool
    reason: str = ""


class PoseFile(Section):
    """The content of the file of a space resection."""

    kind: Literal["space resection"]
    camera: _Camera
    textbook: _Textbook
    covariance: _Covariance
    interior: _Interior
    fit: _Fit
    target: tuple[ResectedTarget, ...]
    provenance: ResectionProvenance = ResectionProvenance()


def write_pose_file(path: Path, content: PoseFile, summary: str, *, overwrite: bool) -> None:
    """Write the file; see `calibration.resection.SpaceResection.save`."""
    plain = content.model_dump(exclude_none=True)
    plain["camera"] = {
        "position": [f"{value!r} m" for value in content.camera.position],
        "rotation": [f"{float(np.degrees(value))!r} deg" for value in content.camera.rotation],
    }
    _RESULT.write(path, plain, summary, overwrite=overwrite)


def read_pose_file(path: Path) -> PoseFile:
    """Read the file; see `calibration.resection.SpaceResection.load`."""
    return _RESULT.validated(path, _RESULT.read(path), PoseFile)
