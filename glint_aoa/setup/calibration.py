"""The setup's sections of calibrations to apply, and of what is uncertain."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import numpy as np
import pydantic
from pydantic import Field

from glint_aoa.errors import SetupError
from glint_aoa.setup.camera import Camera
from glint_aoa.setup.section import Section, quantity, read_toml

__all__ = [
    "Calibration",
    "ReflectionUncertainty",
    "Uncertainty",
    "calibrated_camera",
    "check_pose_fits",
]

_KINDS = {
    "camera": ("camera calibration", "camera"),
    "pose": ("space resection", "resect"),
}
_SAME = 1e-6  # relative: the setup may repeat a calibrated value, rounded


_NotNegative = Field(ge=0, allow_inf_nan=False)
_MetresStd = Annotated[float, quantity("m"), _NotNegative]
_RadiansStd = Annotated[float, quantity("rad"), _NotNegative]
_NumberStd = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]


class Calibration(Section):
    """Calibrations to apply; paths are relative to the setup file."""

    camera: str | None = Field(
        None,
        description="file of glint-aoa calibrate camera; gives lens, pixels and distortion",
        examples=["camera.toml"],
    )
    pose: str | None = Field(
        None,
        description="file of glint-aoa calibrate resect; gives position and rotation",
        examples=["pose.toml"],
    )
    sweep: str | None = Field(
        None,
        description="file of glint-aoa calibrate sweep; takes out what lamp and camera leave",
        examples=["sweep.toml"],
    )


class ReflectionUncertainty(Section):
    """What is known of body and lamp, 1 sigma; metres, radians."""

    radius: _MetresStd = Field(
        0.0, description="1 sigma of the body's radius [m]", examples=["0 mm"]
    )
    axis_y: _MetresStd = Field(
        0.0, description="1 sigma of the known Y of the body's axis [m]", examples=["0 mm"]
    )
    lamp: tuple[_MetresStd, _MetresStd, _MetresStd] = Field(
        (0.0, 0.0, 0.0),
        description="1 sigma of the lamp's X, Y, Z [m]",
        examples=[["0 mm", "0 mm", "0 mm"]],
    )
    lamp_direction: tuple[_RadiansStd, _RadiansStd] = Field(
        (0.0, 0.0),
        description="1 sigma of a long lamp's heading and of its elevation [rad]",
        examples=[["0 deg", "0 deg"]],
    )


class Uncertainty(Section):
    """What is known of the geometry by tape or data sheet, 1 sigma; metres, radians, pixels."""

    focal_length: _MetresStd = Field(
        0.0, description="1 sigma of the principal distance [m]", examples=["0 mm"]
    )
    pixel_pitch: tuple[_MetresStd, _MetresStd] = Field(
        (0.0, 0.0),
        description="1 sigma of the horizontal and the vertical pixel pitch [m]",
        examples=[["0 um", "0 um"]],
    )
    principal_point: tuple[_NumberStd, _NumberStd] = Field(
        (0.0, 0.0), description="1 sigma of the principal point's u, v [pixels]", examples=[[0, 0]]
    )
    distortion: tuple[_NumberStd, _NumberStd, _NumberStd, _NumberStd, _NumberStd] = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0),
        description="1 sigma of k1, k2, p1, p2, k3 [1]",
        examples=[[0, 0, 0, 0, 0]],
    )
    position: tuple[_MetresStd, _MetresStd, _MetresStd] = Field(
        (0.0, 0.0, 0.0),
        description="1 sigma of the perspective centre X, Y, Z [m]",
        examples=[["0 mm", "0 mm", "0 mm"]],
    )
    rotation: tuple[_RadiansStd, _RadiansStd, _RadiansStd] = Field(
        (0.0, 0.0, 0.0),
        description="1 sigma of omega, phi, kappa [rad]",
        examples=[["0 deg", "0 deg", "0 deg"]],
    )
    y: _MetresStd = Field(
        0.0, description="1 sigma of the known Y of the glint [m]", examples=["0 mm"]
    )
    yaw: _RadiansStd = Field(
        0.0,
        description="1 sigma of the heading of the known vertical plane [rad]",
        examples=["0 deg"],
    )
    reflection: ReflectionUncertainty | None = Field(
        None, description="1 sigma of body and lamp, where glint.reflection describes them"
    )


def calibrated_camera(content: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Join a setup's own section of the camera with those of the calibrations that it names.

    Parameters
    ----------
    content : mapping
        The setup as TOML gives it.
    folder : Path
        Folder that the calibrations' paths are relative to.

    Returns
    -------
    dict
        The section ``[camera]``, not yet validated.

    Raises
    ------
    SetupError
        If a calibration cannot be read, is of another kind, or contradicts the setup.
    """
    camera: dict[str, Any] = content.get("camera", {})
    calibration = content.get("calibration", {})
    if not isinstance(camera, dict) or not isinstance(calibration, dict):
        return camera  # validation will refuse it
    for key, (kind, command) in _KINDS.items():
        name = calibration.get(key)
        if isinstance(name, str):
            camera = _joined(camera, _camera_of(folder / name, kind, command), folder / name)
    return camera


def check_pose_fits(camera: Camera, path: Path) -> None:
    """Refuse a pose that was found with another interior orientation than the camera now has.

    Position and rotation make up for the interior orientation that they were found with; beside
    another one they are wrong.

    Parameters
    ----------
    camera : Camera
        The camera, with what its calibrations give it.
    path : Path
        File of the space resection; one of an earlier version does not say, and is taken.

    Raises
    ------
    SetupError
        Naming what differs, and both values.
    """
    interior = read_toml(path, missing="no such space resection").get("interior")
    if not isinstance(interior, dict) or "values" not in interior:
        return
    try:
        then = dict(zip(interior["parameters"], map(float, interior["values"]), strict=True))
    except (KeyError, TypeError, ValueError):
        raise SetupError(
            f"{path}: interior.values is not one number for each of interior.parameters; "
            "repeat glint-aoa calibrate resect"
        ) from None
    now = _interior(camera)
    said = [
        f"{name} was {value:.8g} and is {now[name]:.8g}"
        for name, value in then.items()
        if name in now and not _same((now[name],), (value,))
    ]
    if said:
        raise SetupError(
            f"{path} was found with another camera ({'; '.join(said)}); take calibration.pose out "
            "of the setup and repeat glint-aoa calibrate resect with the present camera"
        )


def _interior(camera: Camera) -> dict[str, float]:
    """Return the interior orientation by the names that files of calibrations use [m, pixels]."""
    groups = {
        ("focal_length_m",): (camera.focal_length,),
        ("pixel_pitch_h_m", "pixel_pitch_v_m"): camera.pixel_pitch,
        ("principal_point_u", "principal_point_v"): camera.principal_point_used,
        ("k1", "k2", "p1", "p2", "k3"): camera.distortion,
    }
    return {
        name: value
        for names, values in groups.items()
        for name, value in zip(names, values or (), strict=False)
        if value is not None
    }


def _camera_of(path: Path, kind: str, command: str) -> dict[str, Any]:
    missing = f"no such {kind}; make one with glint-aoa calibrate {command}"
    content = read_toml(path, missing=missing)
    section = content.get("camera")
    if content.get("kind") != kind or not isinstance(section, dict):
        raise SetupError(f"{path}: not a {kind}; make one with glint-aoa calibrate {command}")
    unknown = [key for key in section if key not in Camera.model_fields]
    if unknown:
        raise SetupError(f"{path}: unknown key camera.{unknown[0]}; make the file again")
    return section


def _joined(own: dict[str, Any], calibrated: dict[str, Any], path: Path) -> dict[str, Any]:
    for key in own.keys() & calibrated.keys():
        mine, theirs = (_numbers(key, each[key]) for each in (own, calibrated))
        if mine is not None and not _same(mine, theirs):
            raise SetupError(
                f"camera.{key} is {own[key]} in the setup and {calibrated[key]} in {path}; "
                "take it out of the setup, or the calibration"
            )
    return own | calibrated


def _numbers(key: str, value: Any) -> tuple[float, ...] | None:
    """Return the numbers in SI units; None for a value that validation will refuse."""
    field = pydantic.TypeAdapter[Any](get_type_hints(Camera, include_extras=True)[key])
    try:
        return tuple(np.atleast_1d(np.array(field.validate_python(value), np.float64)))
    except pydantic.ValidationError:
        return None


def _same(mine: tuple[float, ...], theirs: tuple[float, ...] | None) -> bool:
    return theirs is None or all(
        math.isclose(a, b, rel_tol=_SAME, abs_tol=1e-12) for a, b in zip(mine, theirs, strict=True)
    )
