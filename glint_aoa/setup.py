"""The setup file ``glint-aoa.toml``: camera, fields, glint, inertial package, calibration.

Every model is frozen and holds SI units and radians; units stand in the file's strings only.
"""

import difflib
import hashlib
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import pydantic
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator

from glint_aoa.errors import InputError, SetupError
from glint_aoa.units import convert, parse_quantity

__all__ = [
    "Calibration",
    "Camera",
    "Fields",
    "Glint",
    "Inertial",
    "InertialChannel",
    "InertialFilter",
    "InertialMode",
    "InertialSensor",
    "Quantity",
    "Reference",
    "Reflection",
    "Section",
    "Setup",
    "load_section",
    "load_setup",
    "positive",
    "quantity",
    "read_toml",
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
_LEAST_REFERENCE = 6  # pixels across the box around a mark

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
Parity = Literal["even", "odd"]


def quantity(unit: str) -> BeforeValidator:
    """Return a validator that reads a string such as ``"9.8 Hz"`` as a number in `unit`."""
    return BeforeValidator(_parser(unit))


def _parser(unit: str) -> Callable[[Any], float]:
    return lambda value: parse_quantity(value, unit)


def _finite(value: float) -> float:
    if not abs(value) < float("inf"):
        raise ValueError(f"{value} is not a finite number")
    return value


def _positive(value: float) -> float:
    if not _finite(value) > 0:
        raise ValueError(f"{value:g} must be greater than zero")
    return value


positive = AfterValidator(_positive)
"""Validator: finite and greater than zero."""


def _known_unit(unit: str) -> str:
    convert(unit, unit)
    return unit


_Number = Annotated[float, Field(strict=True), AfterValidator(_finite)]
_Metres = Annotated[float, quantity("m"), AfterValidator(_finite)]
_PositiveMetres = Annotated[_Metres, positive]
_Radians = Annotated[float, quantity("rad"), AfterValidator(_finite)]
_PositiveSeconds = Annotated[float, quantity("s"), positive]
_PositiveHertz = Annotated[float, quantity("Hz"), positive]
_Unit = Annotated[str, AfterValidator(_known_unit)]
_Count = Annotated[int, Field(strict=True, ge=0)]
_PositiveCount = Annotated[int, Field(strict=True, ge=1)]


class Section(pydantic.BaseModel):
    """A frozen part of a file of settings; keys that it does not know are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Camera(Section):
    """The camera: inner orientation, distortion and pose. Lengths in metres, angles in radians."""

    focal_length: _PositiveMetres | None = Field(None, description="principal distance of the lens")
    pixel_pitch: tuple[_PositiveMetres, _PositiveMetres] | None = Field(
        None, description="horizontal pitch, and vertical pitch per field line"
    )
    sensor: tuple[_PositiveCount, _PositiveCount] | None = Field(
        None, description="columns, and lines per field"
    )
    principal_point: tuple[_Number, _Number] | None = Field(
        None, description="u, v of an even field [pixels]; the sensor's centre where not given"
    )
    position: tuple[_Metres, _Metres, _Metres] | None = Field(
        None, description="perspective centre X, Y, Z in the tunnel frame"
    )
    rotation: tuple[_Radians, _Radians, _Radians] = Field(
        (0.0, 0.0, 0.0), description="omega, phi, kappa about tunnel X, Y, Z"
    )
    distortion: tuple[_Number, _Number, _Number, _Number, _Number] = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0), description="k1, k2, p1, p2, k3 in OpenCV's order"
    )

    @property
    def is_oriented(self) -> bool:
        """Whether the camera can be used in space, not on its own image plane only."""
        return self.position is not None

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

    rate: _PositiveHertz | None = Field(None, description="fields a second")
    exposure: _PositiveSeconds | None = Field(None, description="integration time of a field")
    first_line: _Count | None = Field(None, description="sensor line of the window's first row")
    first_column: _Count | None = Field(
        None, description="sensor column of the window's first column"
    )
    interlaced: Annotated[bool, Field(strict=True)] | None = Field(
        None, description="false: progressive frames, parity 0 throughout"
    )
    first_parity: Parity | None = Field(None, description="parity of field 0")


class Reference(Section):
    """A mark or edge that stands still in view, by which a moved camera shows. Pixels."""

    rows: tuple[_Count, _PositiveCount] = Field(
        description="rows of the recorded window around it, last one excluded"
    )
    columns: tuple[_Count, _PositiveCount] = Field(
        description="columns of the recorded window around it, last one excluded"
    )
    row: _Number | None = Field(
        None,
        description="row of the window where it should lie; from the point itself if not given",
    )
    column: _Number | None = Field(
        None, description="column of the window where it should lie, likewise"
    )
    tolerance: Annotated[float, Field(gt=0)] = Field(
        0.25, description="shift beyond which the camera counts as moved"
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

    radius: _PositiveMetres = Field(description="radius of the body where the glint is seen")
    axis_y: _Metres = Field(0.0, description="known Y of the body's axis at X = 0")
    lamp: tuple[_Metres, _Metres, _Metres] = Field(
        description="middle of the lamp, X, Y, Z in the tunnel frame"
    )
    lamp_direction: tuple[_Number, _Number, _Number] = Field(
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

    y: _Metres = Field(0.0, description="known Y of the glint")
    yaw: _Radians = Field(0.0, description="heading of the known vertical plane about tunnel Z")
    nose: Literal["left", "right"] = Field(
        "left", description="where the model's nose points in the image"
    )
    column_step: _PositiveCount = Field(20, description="every how many columns; 1 uses all")
    search_window: tuple[_Count, _PositiveCount] | None = Field(
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
    vibration: tuple[_PositiveHertz, ...] = Field(
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


class InertialFilter(Section):
    """Low-pass filter of the inertial package's filtered output. Hertz."""

    kind: Literal["butterworth", "bessel"] = Field("butterworth", description="type of filter")
    order: Annotated[int, Field(strict=True, ge=1, le=8)] = Field(2, description="its order")
    cutoff: _PositiveHertz = Field(0.4, validate_default=False, description="-3 dB frequency")


class InertialSensor(Section):
    """What the inertial package indicates at rest; m/s^2, radians and kelvins."""

    scale: Annotated[_Number, positive] = Field(
        1.0, description="indicated over true specific force"
    )
    bias: Annotated[float, quantity("m/s^2"), AfterValidator(_finite)] = Field(
        0.0, description="indicated where nothing is felt"
    )
    misalignment: _Radians = Field(0.0, description="sensitive axis above model x")
    scale_per_kelvin: Annotated[float, quantity("1/K"), AfterValidator(_finite)] = Field(
        0.0, description="change of the scale with temperature"
    )
    bias_per_kelvin: Annotated[float, quantity("m/s^2/K"), AfterValidator(_finite)] = Field(
        0.0, description="change of the bias with temperature"
    )
    temperature: Annotated[float, quantity("K"), positive] = Field(
        344.261, description="at which scale and bias hold"
    )


class InertialChannel(Section):
    """One acquisition channel; stations in metres, range in the channel's units."""

    name: str = Field(description="as in the record")
    quantity: Quantity = Field(description="what the channel measures")
    units: _Unit = Field(description="unit of recorded value times scale, as pint names it")
    scale: _Number = Field(1.0, description="recorded value times scale gives units")
    station: _Metres | None = Field(None, description="model x of the sensor")
    axis: Axis | None = Field(None, description="model axis that it senses")
    range: tuple[str, str] | None = Field(
        None, description="least and greatest value; beyond it is clipped"
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

    number: _PositiveCount = Field(description="mode number")
    plane: Literal["yaw", "pitch"] = Field(description="plane of the motion")
    frequency: _PositiveHertz = Field(description="natural frequency")
    radius: _Metres = Field(
        description="effective radius; positive with the point of rotation aft of the sensor"
    )
    radius_std: Annotated[float, quantity("m"), Field(ge=0, allow_inf_nan=False)] = Field(
        0.0, description="its standard deviation, 1 sigma, as the survey tells it"
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
    rate: _PositiveHertz | None = Field(
        None, description="samples a second, where the acquisition record does not say"
    )
    start: Annotated[float, quantity("s"), AfterValidator(_finite)] | None = Field(
        None, description="time of the first sample after the trigger, where the record is silent"
    )
    channel: tuple[InertialChannel, ...] = Field((), description="one for each channel used")
    mode: tuple[InertialMode, ...] = Field((), description="one for each vibration mode")


class Calibration(Section):
    """Calibrations to apply; paths are relative to the setup file."""

    sweep: str | None = Field(None, description="file of the pitch sweep")


class Setup(Section):
    """A whole setup file."""

    camera: Camera = Camera()
    fields: Fields = Fields()
    glint: Glint = Glint()
    inertial: Inertial = Inertial()
    calibration: Calibration = Calibration()
    folder: Path = Field(Path(), exclude=True)

    @model_validator(mode="after")
    def _reflection_is_seen_from_somewhere(self) -> Self:
        if self.glint.reflection is not None and not self.camera.is_oriented:
            raise ValueError(
                "glint.reflection needs the camera's place; give focal_length, pixel_pitch and "
                "position in [camera], or take [glint.reflection] out"
            )
        return self

    @property
    def hash(self) -> str:
        """First 12 hexadecimal digits of the SHA-256 of what the setup says."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:12]

    @property
    def sweep_path(self) -> Path | None:
        """Path of the pitch-sweep calibration, or None."""
        return None if self.calibration.sweep is None else self.folder / self.calibration.sweep


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
        If the file cannot be read, is not TOML, or holds an unknown key or a wrong value; the
        message names the file and the key.
    """
    path = Path(path)
    content = read_toml(path, missing="no such setup file; give one with --setup")
    if "folder" in content:
        raise SetupError(f"{path}: unknown key folder; {_nearest('folder', Setup)}")
    return _validated(path, {**content, "folder": path.parent}, Setup)


_S = TypeVar("_S", bound=Section)


def load_section(path: Path, section: type[_S]) -> _S:
    """Read a TOML file that holds one section.

    Parameters
    ----------
    path : Path
        The file.
    section : type
        What it holds.

    Returns
    -------
    Section
        In SI units and radians.

    Raises
    ------
    SetupError
        As for `load_setup`.
    """
    return _validated(path, read_toml(path, missing="no such file"), section)


def read_toml(path: Path, *, missing: str, error: type[InputError] = SetupError) -> dict[str, Any]:
    """Read a TOML file.

    Parameters
    ----------
    path : Path
        The file.
    missing : str
        What to say where it is not there.
    error : type, optional
        What to raise.

    Returns
    -------
    dict
        Its content.

    Raises
    ------
    InputError
        If the file is missing, cannot be read or is not TOML.
    """
    try:
        with path.open("rb") as file:
            return tomllib.load(file)
    except FileNotFoundError:
        raise error(f"{path}: {missing}") from None
    except (OSError, UnicodeDecodeError) as problem:
        raise error(f"{path}: the file cannot be read ({problem})") from None
    except tomllib.TOMLDecodeError as problem:
        raise error(f"{path}: not a TOML file: {problem}") from None


def _validated(path: Path, content: dict[str, Any], section: type[_S]) -> _S:
    try:
        return section.model_validate(content)
    except pydantic.ValidationError as error:
        raise SetupError(f"{path}: {_first_problem(error, section)}") from None


def _first_problem(error: pydantic.ValidationError, section: type[Section]) -> str:
    problems = error.errors(include_url=False)
    unknown = (each for each in problems if each["type"] == "extra_forbidden")
    problem = next(unknown, problems[0])
    where = _dotted(problem["loc"])
    if problem["type"] == "extra_forbidden":
        *parents, key = problem["loc"]
        return f"unknown key {where}; {_nearest(str(key), _section_at(parents, section))}"
    message = problem["msg"].removeprefix("Value error, ")
    return f"{where}: {message}" if where else message


def _dotted(loc: tuple[int | str, ...]) -> str:
    parts = ""
    for part in loc:
        parts += f"[{part}]" if isinstance(part, int) else f".{part}" if parts else str(part)
    return parts


def _section_at(parents: list[int | str], section: type[Section]) -> type[Section]:
    for name in (part for part in parents if isinstance(part, str)):
        inner = _sections_in(section.model_fields[name].annotation)
        section = inner[0] if inner else section
    return section


def _sections_in(annotation: Any) -> list[type[Section]]:
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return [annotation]
    return [each for part in getattr(annotation, "__args__", ()) for each in _sections_in(part)]


def _nearest(key: str, section: type[Section]) -> str:
    known = [name for name in section.model_fields if name != "folder"]
    close = difflib.get_close_matches(key, known, n=1)
    return f"did you mean {close[0]}?" if close else f"known keys here: {', '.join(known)}"
