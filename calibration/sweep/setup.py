"""What a pitch sweep was measured with: another setup gives another optical angle."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from glint_aoa.setup import Camera, Reflection, Section, Setup

__all__ = ["SweepSetup"]

_SAME = 1e-6  # relative: files round
_SAME_M = 1e-9
_SHIFTED = 0.05  # of the width of the columns measured

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Two = tuple[_Finite, _Finite]
_Three = tuple[_Finite, _Finite, _Finite]


class _CameraAsUsed(Section):
    """The camera in metres, radians and pixels; as in the setup."""

    focal_length_m: _Finite | None = None
    pixel_pitch_m: _Two | None = None
    principal_point: _Two | None = None
    position_m: _Three | None = None
    rotation_rad: _Three = (0.0, 0.0, 0.0)
    distortion: tuple[_Finite, _Finite, _Finite, _Finite, _Finite] = (0.0,) * 5

    @classmethod
    def of(cls, camera: Camera) -> "_CameraAsUsed":
        return cls(
            focal_length_m=camera.focal_length,
            pixel_pitch_m=camera.pixel_pitch,
            principal_point=camera.principal_point_used,
            position_m=camera.position,
            rotation_rad=camera.rotation,
            distortion=camera.distortion,
        )


class _ReflectionAsUsed(Section):
    """Body and lamp in metres; as in the setup."""

    radius_m: _Finite
    axis_y_m: _Finite
    lamp_m: _Three
    lamp_direction: _Three
    lamp_shape: Literal["long", "small"]

    @classmethod
    def of(cls, reflection: Reflection | None) -> "_ReflectionAsUsed | None":
        if reflection is None:
            return None
        return cls(
            radius_m=reflection.radius,
            axis_y_m=reflection.axis_y,
            lamp_m=reflection.lamp,
            lamp_direction=reflection.lamp_direction,
            lamp_shape=reflection.lamp_shape,
        )


class _GlintAsUsed(Section):
    y_m: _Finite
    yaw_rad: _Finite
    nose: Literal["left", "right"]
    estimator: str
    polarity: str
    reflection: _ReflectionAsUsed | None = None


class SweepSetup(Section):
    """What of a setup the optical angle depends on, as the sweep was measured with it.

    Attributes
    ----------
    camera, glint
        Geometry in metres, radians and pixels, and how the line was found.
    columns : tuple of float or None
        First and last sensor column measured.
    lines : int or None
        Field lines of the sensor, or of the recorded window where the setup does not say.
    """

    camera: _CameraAsUsed = _CameraAsUsed()
    glint: _GlintAsUsed
    columns: _Two | None = None
    lines: Annotated[int, Field(gt=0)] | None = None

    @classmethod
    def of(
        cls, setup: Setup, *, columns: _Two | None = None, lines: int | None = None
    ) -> "SweepSetup":
        """Take it from a setup.

        Parameters
        ----------
        setup : Setup
            The setup, with the camera and pose that its calibrations give it.
        columns : tuple of float, optional
            First and last sensor column measured.
        lines : int, optional
            Lines of the recorded window, for a setup without ``camera.sensor``.
        """
        glint, sensor = setup.glint, setup.camera.sensor
        return cls(
            camera=_CameraAsUsed.of(setup.camera),
            glint=_GlintAsUsed(
                y_m=glint.y,
                yaw_rad=glint.yaw,
                nose=glint.nose,
                estimator=glint.estimator,
                polarity=glint.polarity,
                reflection=_ReflectionAsUsed.of(glint.reflection),
            ),
            columns=columns,
            lines=lines if sensor is None else sensor[1],
        )

    def contradictions(self, used: "SweepSetup") -> list[str]:
        """Say in what the geometry of a setup differs, so that the sweep does not hold for it."""
        said = list(_differences("camera", self.camera, used.camera))
        for key in ("y_m", "nose"):
            said += _difference(f"glint.{key}", getattr(self.glint, key), getattr(used.glint, key))
        mine, theirs = self.glint.reflection, used.glint.reflection
        if mine is not None and theirs is not None:
            said += _differences("glint.reflection", mine, theirs)
        elif mine is not theirs:
            here, there = ("with", "without") if mine is None else ("without", "with")
            said.append(f"it is used {here} [glint.reflection] and was measured {there} it")
        return said

    def doubts(self, used: "SweepSetup") -> list[str]:
        """Say what else differs, that may change the angle a little."""
        said: list[str] = []
        for key in ("yaw_rad", "estimator", "polarity"):
            said += _difference(f"glint.{key}", getattr(self.glint, key), getattr(used.glint, key))
        if self.columns is not None and used.columns is not None:
            (first, last), (left, right) = self.columns, used.columns
            if max(abs(left - first), abs(right - last)) > _SHIFTED * (last - first):
                said.append(
                    f"columns {left:.0f} to {right:.0f} were measured, "
                    f"{first:.0f} to {last:.0f} in the sweep"
                )
        return said


_UNITS = ("m", "rad")


def _differences(where: str, mine: Section, theirs: Section) -> Iterator[str]:
    for key in type(mine).model_fields:
        yield from _difference(f"{where}.{key}", getattr(mine, key), getattr(theirs, key))


def _difference(key: str, mine: Any, theirs: Any) -> list[str]:
    """Say that the setup's key differs, with its unit beside its value."""
    if _are_same(mine, theirs):
        return []
    stem, _, unit = key.rpartition("_")
    name, unit = (stem, f" {unit}") if unit in _UNITS else (key, "")
    return [f"{name} is {_words(theirs, unit)} here and was {_words(mine, unit)} in the sweep"]


def _words(value: Any, unit: str) -> str:
    if value is None:
        return "not given"
    if isinstance(value, tuple):
        return f"[{', '.join(f'{each:.7g}' for each in value)}]{unit}"
    return f"{value:.7g}{unit}" if isinstance(value, float) else f'"{value}"'


def _are_same(mine: Any, theirs: Any) -> bool:
    if mine is None or theirs is None or isinstance(mine, str):
        return bool(mine == theirs)
    return bool(np.allclose(mine, theirs, rtol=_SAME, atol=_SAME_M))
