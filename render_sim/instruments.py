"""The sensors of the test, the channels that record them, and what may be wrong with them.

Signs: forces and moments are those the model puts on the balance. Normal force along model +z, side
force along +y (to port), axial force along -x (aft); yaw moment about +z (nose to port), pitch
moment about -y (nose up), roll moment about +x (starboard side down), all about the balance moment
centre.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from glint_aoa.setup import Section
from glint_aoa.units import STANDARD_GRAVITY, parse_quantity
from render_sim.modes import ModelSystem, Plane

__all__ = [
    "ANALYSER",
    "DAS",
    "FULL_COUNT",
    "TEMPERATURE",
    "Input",
    "Sensor",
    "SensorErrors",
    "accelerometer_stations",
    "sensors",
]

Floats = NDArray[np.float64]

FULL_COUNT = 32767
"""Greatest count of a channel, and less its sign the least."""

AFT_STATION_M = 0.1
MID_STATION_M = 0.55
"""Stations of the fuselage accelerometers [m], one a plane at each."""


@dataclass(frozen=True)
class Sensor:
    """One sensor: what it measures, where, its noise in the record's band, and its errors.

    Attributes
    ----------
    quantity, axis : str or None
        As a channel states them.
    units : str
        Unit of its values, noise and offset.
    noise : float
        Standard deviation [units].
    place : str or None
        Where it is: package, balance, shaker, mid or aft.
    scale_error, offset : float
        It indicates (1 + scale_error) value + offset.
    station_m : float or None
        Model x of that place [m].
    range_limit : float or None
        Greatest value that is recorded, and less its sign the least; the channel's if None.
    """

    quantity: str | None
    units: str
    noise: float
    place: str | None = None
    axis: str | None = None
    scale_error: float = 0.0
    offset: float = 0.0
    station_m: float | None = None
    range_limit: float | None = None

    def indicated(self, value: Floats) -> Floats:
        """Return what it indicates, without noise, of true values [units]."""
        if self.scale_error == 0 and self.offset == 0:
            return value
        return np.asarray((1 + self.scale_error) * value + self.offset)


@dataclass(frozen=True)
class Input:
    """One channel of an acquisition: the sensor on it and the range [sensor's units]."""

    name: str
    sensor: str
    full_scale: float


_MILLI_G = STANDARD_GRAVITY * 1e-3
_FACE_RANGE = 100.0
_FUSELAGE_RANGE = 20 * STANDARD_GRAVITY

_BALANCE_INPUTS = (
    ("normal_force", 10_000.0),
    ("axial_force", 2_000.0),
    ("pitch_moment", 1_500.0),
    ("roll_moment", 500.0),
    ("yaw_moment", 1_500.0),
    ("side_force", 5_000.0),
)
_PACKAGE_INPUTS = (
    ("aoa_unfiltered", 1.0),
    ("aoa_filtered", 0.35),
    ("ay_face", _FACE_RANGE),
    ("az_face", _FACE_RANGE),
)
_FUSELAGE_INPUTS = tuple(
    (name, _FUSELAGE_RANGE) for name in ("ay_aft", "az_aft", "ay_mid", "az_mid")
)

DAS = tuple(
    Input(name, name, full)
    for name, full in (*_PACKAGE_INPUTS, *_BALANCE_INPUTS, ("shaker", 10.0), ("aux_aoa", 20.0))
)
"""The 12-channel acquisition."""

ANALYSER = tuple(
    Input(f"analyser_{name}", name, full)
    for name, full in (
        ("force_y", 500.0),
        ("force_z", 500.0),
        *_BALANCE_INPUTS,
        *_PACKAGE_INPUTS,
        *_FUSELAGE_INPUTS,
    )
)
"""The 16-channel analyser."""

TEMPERATURE = Input("package_temperature", "package_temperature", 500.0)
"""A 13th channel, where the package's temperature is stated."""


_SENSORS = {
    "aoa_unfiltered": Sensor("aoa_unfiltered", "g_0", 50e-6, "package", "+x"),
    "aoa_filtered": Sensor("aoa_filtered", "g_0", 5e-6, "package", "+x"),
    "normal_force": Sensor("force", "N", 0.3, "balance", "+z"),
    "axial_force": Sensor("force", "N", 0.1, "balance", "-x"),
    "pitch_moment": Sensor("moment", "N*m", 0.05, "balance", "-y"),
    "roll_moment": Sensor("moment", "N*m", 0.02, "balance", "+x"),
    "yaw_moment": Sensor("moment", "N*m", 0.05, "balance", "+z"),
    "side_force": Sensor("force", "N", 0.3, "balance", "+y"),
    "shaker": Sensor("excitation", "V", 1e-3, "shaker"),
    "aux_aoa": Sensor(None, "deg", 0.01),
    "force_y": Sensor("excitation", "N", 0.02, "shaker", "+y"),
    "force_z": Sensor("excitation", "N", 0.02, "shaker", "+z"),
    **{
        f"a{axis}_{name}": Sensor("acceleration", "m/s^2", 0.5 * _MILLI_G, place, f"+{axis}")
        for name, place in (("face", "package"), ("aft", "aft"), ("mid", "mid"))
        for axis in "yz"
    },
    TEMPERATURE.sensor: Sensor("temperature", "K", 0.02, "package"),
}


def sensors(system: ModelSystem, plane: Plane | None) -> dict[str, Sensor]:
    """Return the test's sensors by name.

    Parameters
    ----------
    system : ModelSystem
        Gives their stations.
    plane : "yaw", "pitch" or None
        Plane that the shaker's channel stands for.
    """
    stations = {
        "package": system.sensor_station,
        "balance": 0.0,
        "shaker": system.shaker_station,
        "mid": MID_STATION_M,
        "aft": AFT_STATION_M,
        None: None,
    }
    found = {
        name: replace(sensor, station_m=stations[sensor.place]) for name, sensor in _SENSORS.items()
    }
    drive_axis = {"yaw": "+y", "pitch": "+z", None: None}[plane]
    return found | {"shaker": replace(found["shaker"], axis=drive_axis)}


def accelerometer_stations(system: ModelSystem) -> Iterator[tuple[str, float]]:
    """Give the last word of the accelerometers' names and their stations [m]."""
    yield "face", system.sensor_station
    yield "aft", AFT_STATION_M
    yield "mid", MID_STATION_M


class SensorErrors(Section):
    """What is wrong with one sensor; quantities in its own unit."""

    name: str = Field(description="of the sensor, such as az_face or yaw_moment")
    scale_error: Annotated[float, Field(strict=True, gt=-1.0, lt=1.0)] = Field(
        0.0, description="indicated over true value, less 1"
    )
    offset: str | None = Field(None, description="indicated where there is nothing")
    noise: str | None = Field(None, description="standard deviation; the usual if not given")
    range: str | None = Field(
        None, description="greatest value, and less its sign the least; the usual if not given"
    )

    @model_validator(mode="after")
    def _is_known_and_has_its_unit(self) -> Self:
        if self.name not in _SENSORS:
            raise ValueError(
                f"no sensor is called {self.name}; choose one of {', '.join(_SENSORS)}"
            )
        for key in ("noise", "range"):
            value = self._value(key)
            if value is not None and not 0 < value < float("inf"):
                raise ValueError(f"{key} of {getattr(self, key)} must be greater than zero")
        if not abs(self._value("offset") or 0.0) < float("inf"):
            raise ValueError(f"offset of {self.offset} is not a finite value")
        return self

    def _value(self, key: Literal["offset", "noise", "range"]) -> float | None:
        text = getattr(self, key)
        return None if text is None else parse_quantity(text, _SENSORS[self.name].units)

    def applied(self, sensor: Sensor) -> Sensor:
        """Return the sensor with these errors."""
        noise = self._value("noise")
        return replace(
            sensor,
            scale_error=self.scale_error,
            offset=self._value("offset") or 0.0,
            noise=sensor.noise if noise is None else noise,
            range_limit=self._value("range"),
        )
