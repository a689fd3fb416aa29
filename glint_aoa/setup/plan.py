"""The setup's section of a test that is still to be run: what a plan needs beside the rest."""

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from glint_aoa.setup.section import (
    Metres,
    Number,
    PositiveCount,
    PositiveHertz,
    PositiveMetres,
    Radians,
    Section,
    positive,
    quantity,
)

__all__ = ["Plan", "PlanVibration"]

_PositiveNumber = Annotated[Number, positive]
_NotNegative = Annotated[Number, Field(ge=0)]
_NotNegativeRadians = Annotated[Radians, Field(ge=0)]
_Steps = Annotated[int, Field(strict=True, ge=1, le=200)]
_Lengths = Annotated[tuple[PositiveMetres, ...], Field(min_length=1, max_length=200)]
_SIX_DEGREES = math.radians(6.0)
_STEEPEST = math.radians(20.0)


class PlanVibration(Section):
    """A pitch vibration that is expected: one sine. Radians, hertz, metres."""

    amplitude: Annotated[float, quantity("rad"), positive] = Field(
        description="half the swing of the pitch [rad]", examples=["0.28 deg"]
    )
    frequency: PositiveHertz = Field(description="its frequency [Hz]", examples=["9.2 Hz"])
    centre: Metres = Field(
        0.0,
        description="X, along the body, of the point that it turns about [m]",
        examples=["0 m"],
    )


class Plan(Section):
    """A test before it is run. Metres, radians, lines, grey levels."""

    angles: tuple[Radians, Radians] = Field(
        (-_SIX_DEGREES, _SIX_DEGREES),
        description="pitch from, to, that must be seen [rad]",
        examples=[["-6 deg", "6 deg"]],
    )
    pivot: tuple[Metres, Metres] = Field(
        (0.0, 0.0),
        description="X, Z of the point of the axis that the support keeps in place [m]",
        examples=[["0 m", "0 m"]],
    )
    body: tuple[Metres, Metres] | None = Field(
        None,
        description="X from, to, of the tube at zero pitch [m]; what the present camera sees if "
        "not given",
        examples=[["-0.3 m", "0.3 m"]],
    )
    fields: PositiveCount = Field(60, description="fields averaged for a point [1]")
    lines: PositiveCount | None = Field(
        None,
        description="lines of the recorded window [1]; to the sensor's last if not given",
        examples=[92],
    )
    roughness: _PositiveNumber = Field(
        0.04, description="of the surface: root mean square slope times sqrt 2 [1]"
    )
    lamp_length: PositiveMetres | None = Field(
        None,
        description="of the lamp [m]; endless if long, as its width if small, where not given",
        examples=["1.2 m"],
    )
    lamp_width: PositiveMetres = Field(
        0.06, description="across the lamp, as seen from the body [m]", examples=["60 mm"]
    )
    peak_level: _PositiveNumber = Field(
        170.0,
        description="what the exposure gives the glint's top, black included [grey levels]",
    )
    black_level: _NotNegative = Field(10.0, description="level without light [grey levels]")
    background: _NotNegative = Field(
        15.0,
        description="of the body beside the glint in the present place, above black [grey levels]",
    )
    top_level: _PositiveNumber = Field(255.0, description="highest level [grey levels]")
    full_well: _PositiveNumber = Field(
        40_000.0, description="charge at the highest level [electrons]"
    )
    read_noise: _NotNegative = Field(
        0.7, description="of the camera [grey levels]; glint.read_noise where that is given"
    )
    blur: _NotNegative = Field(
        0.5, description="of the lens across the lines, standard deviation [lines]"
    )
    f_number: _PositiveNumber | None = Field(
        None,
        description="of the lens [1]: limits the depth of field; none is looked at if not given",
        examples=[5.6],
    )
    circle: PositiveMetres | None = Field(
        None,
        description="largest disc out of focus on the sensor [m]; a pixel's width if not given",
        examples=["12 um"],
    )
    least_columns: Annotated[Number, Field(gt=0, le=1)] = Field(
        0.9, description="share of the columns on the body that must see the glint [1]"
    )
    sweep_std: _NotNegativeRadians | None = Field(
        None,
        description="what a planned pitch sweep will leave, 1 sigma [rad]; [uncertainty] if not "
        "given",
        examples=["0.002 deg"],
    )
    vibration: PlanVibration | None = Field(None, description="expected vibration in pitch")
    distances: tuple[PositiveMetres, PositiveMetres] | None = Field(
        None,
        description="of the map: camera to known plane, from, to [m]; half to twice the present "
        "one if not given",
        examples=[["1 m", "2 m"]],
    )
    focal_lengths: _Lengths | None = Field(
        None,
        description="of the map: the lenses there are [m]; usual ones if not given",
        examples=[["25 mm", "35 mm", "50 mm"]],
    )
    lamp_y: tuple[Metres, Metres] | None = Field(
        None,
        description="of the map: the lamp's Y from, to [m]; 0.6 m either way if not given",
        examples=[["-1.2 m", "0 m"]],
    )
    lamp_z: tuple[Metres, Metres] | None = Field(
        None,
        description="of the map: the lamp's Z from, to [m]; a quarter less and more if not given",
        examples=[["1.2 m", "1.8 m"]],
    )
    steps: tuple[_Steps, _Steps, _Steps] = Field(
        (20, 5, 3), description="of the map: distances, lamp's Y, lamp's Z [1]"
    )

    @model_validator(mode="after")
    def _ranges_rise(self) -> Self:
        for name in ("angles", "body", "distances", "lamp_y", "lamp_z"):
            span = getattr(self, name)
            if span is not None and not (span[0] < span[1] or _may_stand(name, span)):
                raise ValueError(f"{name} must rise; give the lower end first")
        if max(map(abs, self.angles)) > _STEEPEST:
            raise ValueError("angles reach beyond 20 deg, where no line is looked for; narrow them")
        if not self.black_level + self.background < self.peak_level <= self.top_level:
            raise ValueError(
                f"peak_level {self.peak_level:g} must lie above black_level plus background "
                f"({self.black_level + self.background:g}) and not above top_level "
                f"({self.top_level:g})"
            )
        return self


def _may_stand(name: str, span: tuple[float, float]) -> bool:
    """Whether both ends may be one: a map need not go over everything."""
    return name in {"distances", "lamp_y", "lamp_z"} and span[0] == span[1]
