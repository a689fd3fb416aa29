"""The whole setup file."""

import hashlib
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from glint_aoa.errors import SetupError
from glint_aoa.setup.calibration import (
    Calibration,
    Uncertainty,
    calibrated_camera,
    check_pose_fits,
)
from glint_aoa.setup.camera import Camera, Fields
from glint_aoa.setup.glint import Glint
from glint_aoa.setup.inertial import Inertial
from glint_aoa.setup.plan import Plan
from glint_aoa.setup.section import (
    IN_SI,
    Section,
    check_filled,
    first_problem,
    nearest,
    read_toml,
    validated,
)

__all__ = ["CALIBRATED", "Setup", "load_setup"]

CALIBRATED = {
    "camera": ("focal_length", "pixel_pitch", "principal_point", "distortion"),
    "pose": ("position", "rotation"),
}
"""Keys of ``[camera]`` that each calibration gives."""


class Setup(Section):
    """A whole setup file."""

    camera: Camera = Field(Camera(), description="the camera")
    fields: Fields = Field(Fields(), description="what a recording does not say itself")
    glint: Glint = Field(Glint(), description="the glint, and how it is measured")
    inertial: Inertial = Field(Inertial(), description="the inertial package and its channels")
    calibration: Calibration = Field(
        Calibration(), description="calibrations to apply; files relative to this one"
    )
    uncertainty: Uncertainty = Field(
        Uncertainty(), description="how well the geometry is known, 1 sigma, where it was taped"
    )
    plan: Plan = Field(
        Plan(), exclude=True, description="what a plan assumes; no part of how a point is measured"
    )
    folder: Path = Field(Path(), exclude=True)

    @model_validator(mode="after")
    def _reflection_is_seen_from_somewhere(self) -> Self:
        if self.glint.reflection is not None and not self.camera.is_oriented:
            raise ValueError(
                "glint.reflection needs the camera's place; give focal_length, pixel_pitch and "
                "position in [camera], or take [glint.reflection] out"
            )
        if self.glint.reflection is None and self.uncertainty.reflection is not None:
            raise ValueError(
                "uncertainty.reflection is given without glint.reflection; describe body and lamp "
                "there, or take [uncertainty.reflection] out"
            )
        return self

    @model_validator(mode="after")
    def _is_calibrated_or_taped(self) -> Self:
        for file, keys in CALIBRATED.items():
            if getattr(self.calibration, file) is None:
                continue
            for key in keys:
                if np.any(getattr(self.uncertainty, key)):
                    raise ValueError(
                        f"uncertainty.{key} is given and calibration.{file} states it too; "
                        "keep one of them"
                    )
        return self

    @classmethod
    def of_results(cls, text: str, folder: Path) -> Self:
        """Read what the attribute ``setup`` of a point's results says, numbers in SI units.

        Parameters
        ----------
        text : str
            JSON, as ``model_dump_json`` wrote it.
        folder : Path
            Folder of the setup file, from which its calibrations are named.

        Raises
        ------
        SetupError
            If it is no such text, or of another version of the setup.
        """
        try:
            setup = cls.model_validate_json(text, context=IN_SI)
        except ValidationError as error:
            raise SetupError(
                f"the results' attribute setup cannot be read ({first_problem(error, cls)}); "
                "process the point again"
            ) from None
        return setup.model_copy(update={"folder": folder})

    @property
    def hash(self) -> str:
        """First 12 hexadecimal digits of the SHA-256 of what the setup says."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:12]

    @property
    def sweep_path(self) -> Path | None:
        """Path of the pitch-sweep calibration, or None."""
        return self._path(self.calibration.sweep)

    @property
    def camera_path(self) -> Path | None:
        """Path of the camera calibration, or None."""
        return self._path(self.calibration.camera)

    @property
    def pose_path(self) -> Path | None:
        """Path of the space resection, or None."""
        return self._path(self.calibration.pose)

    def _path(self, name: str | None) -> Path | None:
        return None if name is None else self.folder / name


def load_setup(path: str | Path) -> Setup:
    """Read a setup file.

    Parameters
    ----------
    path : str or Path
        The TOML file.

    Returns
    -------
    Setup
        The setup, in SI units and radians.

    Raises
    ------
    SetupError
        If the file cannot be read, is not TOML, holds an unknown key or a wrong value, or keys that
        are still to be filled in; the message names the file and the keys.
    """
    path = Path(path)
    content = read_toml(path, missing="no such setup file; give one with --setup")
    if "folder" in content:
        raise SetupError(f"{path}: unknown key folder; {nearest('folder', Setup)}")
    content["camera"] = calibrated_camera(content, path.parent)
    check_filled(path, content)
    setup = validated(path, {**content, "folder": path.parent}, Setup)
    if setup.pose_path is not None:
        check_pose_fits(setup.camera, setup.pose_path)
    return setup
