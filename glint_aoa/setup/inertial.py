"""The setup's section of the inertial package and of the channels that correct it."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from glint_aoa.setup.section import (
    Metres,
    Number,
    PositiveCount,
    PositiveHertz,
    Radians,
    Section,
    Unit,
    finite,
    positive,
    quantity,
)
from glint_aoa.units import parse_quantity

__all__ = [
    "Axis",
    "Inertial",
    "InertialChannel",
    "InertialFilter",
    "InertialMode",
    "InertialSensor",
    "Quantity",
]

Quantity = Literal[
    "aoa_unfiltered",
    "aoa_filtered",
    "acceleration",
    "moment",
    "force",
    "excitation",
    "temperature",
]
Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


class InertialFilter(Section):
    """Low-pass filter of the inertial package's filtered output. Hertz."""

    kind: Literal["butterworth", "bessel"] = Field("butterworth", description="type of filter")
    order: Annotated[int, Field(strict=True, ge=1, le=8)] = Field(
        2, description="order of the filter [1]"
    )
    cutoff: PositiveHertz = Field(
        0.4, validate_default=False, description="-3 dB frequency [Hz]", examples=["0.4 Hz"]
    )


class InertialSensor(Section):
    """What the inertial package indicates at rest; m/s^2, radians and kelvins."""

    scale: Annotated[Number, positive] = Field(
        1.0, description="indicated over true specific force [1]"
    )
    bias: Annotated[float, quantity("m/s^2"), AfterValidator(finite)] = Field(
        0.0, description="indicated where nothing is felt [m/s^2]", examples=["0 m/s^2"]
    )
    misalignment: Radians = Field(
        0.0, description="angle of the sensitive axis above model x [rad]", examples=["0 deg"]
    )
    scale_per_kelvin: Annotated[float, quantity("1/K"), AfterValidator(finite)] = Field(
        0.0, description="change of the scale with temperature [1/K]", examples=["0 1/K"]
    )
    bias_per_kelvin: Annotated[float, quantity("m/s^2/K"), AfterValidator(finite)] = Field(
        0.0, description="change of the bias with temperature [m/s^2/K]", examples=["0 m/s^2/K"]
    )
    temperature: Annotated[float, quantity("K"), positive] = Field(
        344.261,
        description="temperature of the package at which scale and bias hold [K]",
        examples=["344.261 K"],
    )


class InertialChannel(Section):
    """One acquisition channel; stations in metres, range in the channel's units."""

    name: str = Field(description="name as in the record", examples=["ay_face"])
    quantity: Quantity = Field(description="what the channel measures", examples=["acceleration"])
    units: Unit = Field(
        description="unit of recorded value times scale, as pint names it", examples=["m/s^2"]
    )
    scale: Number = Field(1.0, description="recorded value times scale gives units [1]")
    station: Metres | None = Field(
        None, description="model x of the sensor [m]", examples=["0.9 m"]
    )
    axis: Axis | None = Field(None, description="model axis that it senses", examples=["+y"])
    range: tuple[str, str] | None = Field(
        None,
        description="least and greatest value [units]; what lies beyond is clipped",
        examples=[["-100 m/s^2", "100 m/s^2"]],
    )

    @model_validator(mode="after")
    def _range_has_the_units(self) -> Self:
        if self.range is not None:
            low, high = (parse_quantity(text, self.units) for text in self.range)
            if not low < high:
                raise ValueError(f"range {list(self.range)} is empty; give least, then greatest")
        return self

    @property
    def limits(self) -> tuple[float, float] | None:
        """Least and greatest value [units], or None."""
        if self.range is None:
            return None
        low, high = (parse_quantity(text, self.units) for text in self.range)
        return low, high


class InertialMode(Section):
    """One vibration mode (a row of the paper's Table 1); hertz and metres."""

    number: PositiveCount = Field(description="number of the mode [1]", examples=[1])
    plane: Literal["yaw", "pitch"] = Field(description="plane of the motion", examples=["yaw"])
    frequency: PositiveHertz = Field(description="natural frequency [Hz]", examples=["9.8 Hz"])
    radius: Metres = Field(
        description="effective radius [m]; positive with the point of rotation aft of the sensor",
        examples=["31 in"],
    )
    radius_std: Annotated[float, quantity("m"), Field(ge=0, allow_inf_nan=False)] = Field(
        0.0,
        description="standard deviation of the radius [m], 1 sigma, as the survey tells it",
        examples=["0 in"],
    )

    @model_validator(mode="after")
    def _radius_is_not_zero(self) -> Self:
        if self.radius == 0:
            raise ValueError("radius must not be zero")
        return self


class Inertial(Section):
    """The inertial package and the channels that correct it."""

    filter: InertialFilter = Field(InertialFilter(), description="low-pass of the package")
    sensor: InertialSensor = Field(InertialSensor(), description="the package at rest")
    rate: PositiveHertz | None = Field(
        None,
        description="samples a second [Hz], where the acquisition record does not say",
        examples=["800 Hz"],
    )
    start: Annotated[float, quantity("s"), AfterValidator(finite)] | None = Field(
        None,
        description="time of the first sample after the trigger [s], where the record is silent",
        examples=["0 s"],
    )
    channel: tuple[InertialChannel, ...] = Field((), description="one for each channel used")
    mode: tuple[InertialMode, ...] = Field((), description="one for each vibration mode")
