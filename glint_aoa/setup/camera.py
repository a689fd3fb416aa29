"""The setup's sections of the camera and of its recordings."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from glint_aoa.setup.section import (
    Count,
    Metres,
    Number,
    PositiveCount,
    PositiveHertz,
    PositiveMetres,
    PositiveSeconds,
    Radians,
    Section,
)

__all__ = ["Camera", "Fields"]

Parity = Literal["even", "odd"]


class Camera(Section):
    """The camera: inner orientation, distortion and pose. Lengths in metres, angles in radians."""

    focal_length: PositiveMetres | None = Field(
        None, description="principal distance of the lens [m]", examples=["35 mm"]
    )
    pixel_pitch: tuple[PositiveMetres, PositiveMetres] | None = Field(
        None,
        description="horizontal pitch, and vertical pitch per field line [m]",
        examples=[["11.7 um", "27.5 um"]],
    )
    sensor: tuple[PositiveCount, PositiveCount] | None = Field(
        None, description="columns, and lines per field [pixels]", examples=[[752, 240]]
    )
    principal_point: tuple[Number, Number] | None = Field(
        None,
        description="u, v of an even field [pixels]; the sensor's centre if not given",
        examples=[[375.5, 119.5]],
    )
    position: tuple[Metres, Metres, Metres] | None = Field(
        None,
        description="perspective centre X, Y, Z in the tunnel frame [m]",
        examples=[["0 m", "-56 in", "60 mm"]],
    )
    rotation: tuple[Radians, Radians, Radians] = Field(
        (0.0, 0.0, 0.0),
        description="omega, phi, kappa about tunnel X, Y, Z [rad]",
        examples=[["0 deg", "0 deg", "0 deg"]],
    )
    distortion: tuple[Number, Number, Number, Number, Number] = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0),
        description="k1, k2, p1, p2, k3 in OpenCV's order [1]",
        examples=[[0, 0, 0, 0, 0]],
    )

    @property
    def is_oriented(self) -> bool:
        """Whether the camera can be used in space, not on its own image plane only."""
        return self.position is not None

    @property
    def principal_point_used(self) -> tuple[float, float] | None:
        """The principal point [pixels]: the sensor's centre where it is not given."""
        if self.principal_point is None and self.sensor is not None:
            return (self.sensor[0] - 1) / 2, (self.sensor[1] - 1) / 2
        return self.principal_point

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        needed = {
            "focal_length": self.focal_length,
            "pixel_pitch": self.pixel_pitch,
            "position": self.position,
        }
        wants_space = (
            self.focal_length is not None
            or self.position is not None
            or any(self.rotation)
            or any(self.distortion)
        )
        missing = [name for name, value in needed.items() if value is None]
        if wants_space and missing:
            raise ValueError(
                f"{' and '.join(missing)} missing; give focal_length, pixel_pitch and position, "
                "or pixel_pitch alone for an angle in the image plane"
            )
        if wants_space and self.principal_point is None and self.sensor is None:
            raise ValueError("principal_point missing; give it, or sensor for its centre")
        return self


class Fields(Section):
    """What the recording is, where its file does not say so itself. Seconds and hertz."""

    rate: PositiveHertz | None = Field(None, description="fields a second [Hz]", examples=["60 Hz"])
    exposure: PositiveSeconds | None = Field(
        None, description="integration time of a field [s]", examples=["1 ms"]
    )
    first_line: Count | None = Field(
        None, description="sensor line of the window's first row [field lines]", examples=[98]
    )
    first_column: Count | None = Field(
        None, description="sensor column of the window's first column [pixels]", examples=[0]
    )
    interlaced: Annotated[bool, Field(strict=True)] | None = Field(
        None, description="false: progressive frames, parity 0 throughout", examples=[True]
    )
    first_parity: Parity | None = Field(
        None,
        description="parity of field 0; even is the field with lines 0, 2, 4 ... of the frame",
        examples=["even"],
    )
