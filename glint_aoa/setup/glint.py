"""The setup's section of the glint and of how it is measured."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from glint_aoa.setup.section import (
    Count,
    Metres,
    Number,
    PositiveCount,
    PositiveHertz,
    PositiveMetres,
    Radians,
    Section,
)

__all__ = ["Glint", "Reference", "Reflection"]

_LEAST_REFERENCE = 6  # pixels across the box around a mark


class Reference(Section):
    """A mark or edge that stands still in view, by which a moved camera shows. Pixels."""

    rows: tuple[Count, PositiveCount] = Field(
        description="rows of the recorded window around it, last one excluded [pixels]",
        examples=[[80, 92]],
    )
    columns: tuple[Count, PositiveCount] = Field(
        description="columns of the recorded window around it, last one excluded [pixels]",
        examples=[[10, 60]],
    )
    row: Number | None = Field(
        None,
        description="row of the window where it should lie [pixels]; from the point itself if not "
        "given",
        examples=[85.3],
    )
    column: Number | None = Field(
        None,
        description="column of the window where it should lie [pixels], likewise",
        examples=[35.0],
    )
    tolerance: Annotated[float, Field(gt=0)] | None = Field(
        None,
        description="shift beyond which the camera counts as moved [pixels]; from the mark's own "
        "noise if not given",
        examples=[0.25],
    )

    @model_validator(mode="after")
    def _box_has_room(self) -> Self:
        for name, (first, last) in (("rows", self.rows), ("columns", self.columns)):
            if last - first < _LEAST_REFERENCE:
                raise ValueError(
                    f"{name} [{first}, {last}] holds fewer than {_LEAST_REFERENCE} pixels; "
                    "leave room around the mark"
                )
        return self


class Reflection(Section):
    """What the glint is the reflection of, and of what body. Lengths in metres."""

    radius: PositiveMetres = Field(
        description="radius of the body where the glint is seen [m]", examples=["60 mm"]
    )
    axis_y: Metres = Field(
        0.0, description="known Y of the body's axis at X = 0 [m]", examples=["0 mm"]
    )
    lamp: tuple[Metres, Metres, Metres] = Field(
        description="middle of the lamp, X, Y, Z in the tunnel frame [m]",
        examples=[["0 m", "-0.6 m", "1.5 m"]],
    )
    lamp_direction: tuple[Number, Number, Number] = Field(
        (1.0, 0.0, 0.0),
        description="direction X, Y, Z that a long lamp runs in, of any length [1]",
        examples=[[1, 0, 0]],
    )
    lamp_shape: Literal["long", "small"] = Field(
        "long", description="a line that reaches beyond all that the body mirrors, or a point"
    )

    @model_validator(mode="after")
    def _lamp_has_a_direction(self) -> Self:
        if not any(self.lamp_direction):
            raise ValueError("lamp_direction has no length; [1, 0, 0] is a lamp along the tunnel")
        return self


class Glint(Section):
    """The glint and how it is measured."""

    y: Metres = Field(0.0, description="known Y of the glint [m]", examples=["0 mm"])
    yaw: Radians = Field(
        0.0,
        description="heading of the known vertical plane about tunnel Z [rad]",
        examples=["0 deg"],
    )
    nose: Literal["left", "right"] = Field(
        "left", description="where the model's nose points in the image"
    )
    column_step: PositiveCount = Field(20, description="every how many columns; 1 uses all")
    search_window: tuple[Count, PositiveCount] | None = Field(
        None,
        description="rows of the recorded window to look in, last one excluded [pixels]",
        examples=[[0, 92]],
    )
    estimator: Literal["auto", "profile", "centroid", "gaussian", "steger"] = Field(
        "auto", description="how the glint's centre in a column is measured"
    )
    polarity: Literal["bright", "dark"] = Field(
        "bright", description="bright glint on a dark body, or dark on bright"
    )
    half_width: Annotated[float, Field(gt=0, le=1000)] | None = Field(
        None,
        description="half the centroid's window [field lines]; from the line's width if not given",
        examples=[5.0],
    )
    saturation: Annotated[float, Field(gt=0)] | None = Field(
        None,
        description="level at which pixels clip [grey levels]; the top of the scale if not given",
        examples=[255],
    )
    read_noise: Annotated[float, Field(ge=0)] | None = Field(
        None,
        description="read noise of the camera [grey levels]; from the stack if not given",
        examples=[0.7],
    )
    electrons_per_grey: Annotated[float, Field(gt=0)] | None = Field(
        None,
        description="electrons behind one grey level [electrons]; from the stack if not given",
        examples=[157.0],
    )
    min_contrast: Annotated[float, Field(gt=0)] = Field(
        6.0,
        description="least height of the glint above background [standard deviations of its noise]",
    )
    mean: Literal["auto", "plain", "lines", "tapered", "process"] = Field(
        "auto", description="how the angles of a point are averaged"
    )
    vibration: tuple[PositiveHertz, ...] = Field(
        (),
        description="known frequencies of vibration, fitted with the mean [Hz]; others are found",
        examples=[["9.8 Hz"]],
    )
    reference: Reference | None = Field(
        None, description="box around a static mark that shows whether the camera moved"
    )
    reflection: Reflection | None = Field(
        None, description="body and lamp, from which the axis's own angle follows"
    )

    @property
    def nose_sign(self) -> int:
        """Sign of the pitch where the glint rises to the right: +1 for a nose that points right."""
        return 1 if self.nose == "right" else -1

    @model_validator(mode="after")
    def _window_is_not_empty(self) -> Self:
        if self.search_window is not None and self.search_window[0] >= self.search_window[1]:
            raise ValueError(
                f"search_window {list(self.search_window)} is empty; "
                "give the first row and one past the last"
            )
        return self
