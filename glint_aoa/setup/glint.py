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
        description="rows of the recorded window around it, last one excluded"
    )
    columns: tuple[Count, PositiveCount] = Field(
        description="columns of the recorded window around it, last one excluded"
    )
    row: Number | None = Field(
        None,
        description="row of the window where it should lie; from the point itself if not given",
    )
    column: Number | None = Field(
        None, description="column of the window where it should lie, likewise"
    )
    tolerance: Annotated[float, Field(gt=0)] | None = Field(
        None,
        description="shift beyond which the camera counts as moved; from the mark's own noise if "
        "not given",
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

    radius: PositiveMetres = Field(description="radius of the body where the glint is seen")
    axis_y: Metres = Field(0.0, description="known Y of the body's axis at X = 0")
    lamp: tuple[Metres, Metres, Metres] = Field(
        description="middle of the lamp, X, Y, Z in the tunnel frame"
    )
    lamp_direction: tuple[Number, Number, Number] = Field(
        (1.0, 0.0, 0.0), description="direction that a long lamp runs in"
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

    y: Metres = Field(0.0, description="known Y of the glint")
    yaw: Radians = Field(0.0, description="heading of the known vertical plane about tunnel Z")
    nose: Literal["left", "right"] = Field(
        "left", description="where the model's nose points in the image"
    )
    column_step: PositiveCount = Field(20, description="every how many columns; 1 uses all")
    search_window: tuple[Count, PositiveCount] | None = Field(
        None, description="rows of the recorded window to look in, last one excluded"
    )
    estimator: Literal["auto", "profile", "centroid", "gaussian", "steger"] = Field(
        "auto", description="how the glint's centre in a column is measured"
    )
    polarity: Literal["bright", "dark"] = Field(
        "bright", description="bright glint on a dark body, or dark on bright"
    )
    half_width: Annotated[float, Field(gt=0, le=1000)] | None = Field(
        None, description="half the centroid's window [lines]; from the line's width if not given"
    )
    saturation: Annotated[float, Field(gt=0)] | None = Field(
        None, description="grey level at which pixels clip; the top of the scale if not given"
    )
    read_noise: Annotated[float, Field(ge=0)] | None = Field(
        None, description="read noise of the camera [grey levels]; from the stack if not given"
    )
    electrons_per_grey: Annotated[float, Field(gt=0)] | None = Field(
        None, description="electrons behind one grey level, likewise"
    )
    min_contrast: Annotated[float, Field(gt=0)] = Field(
        6.0, description="least height of the glint above background, in background noise"
    )
    mean: Literal["auto", "plain", "lines", "tapered", "process"] = Field(
        "auto", description="how the angles of a point are averaged"
    )
    vibration: tuple[PositiveHertz, ...] = Field(
        (), description="known frequencies of vibration, fitted with the mean"
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
