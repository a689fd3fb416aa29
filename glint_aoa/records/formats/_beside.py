"""What a person tells of a recording in a small TOML file beside it, ``<file>.toml``."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from glint_aoa.errors import RecordingError
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.setup.camera import Fields
from glint_aoa.setup.section import Count, PositiveCount, finite, load_section, quantity

__all__ = ["Beside", "Channel", "told_beside", "with_told"]

Channel = Literal["luma", "red", "green", "blue"]

_MOST_BYTES = 1 << 20
_TOLERANCE = 1e-6  # relative


class Beside(Fields):
    """What is told of a recording; a key that is given counts more than what the file says."""

    shape: tuple[PositiveCount, PositiveCount, PositiveCount] | None = Field(
        None, description="fields, lines and columns of a raw dump"
    )
    data_type: Literal["uint8", "uint16", "uint16-be"] | None = Field(
        None, description="grey levels of a raw dump; uint16-be has the high byte first"
    )
    offset: Count = Field(0, description="bytes of a raw dump before its first pixel")
    channel: Channel | None = Field(None, description="which grey to make of colour")
    start: Annotated[float, quantity("s"), AfterValidator(finite)] | None = Field(
        None, description="start of field 0's exposure after the trigger"
    )
    trigger_time: str | None = Field(None, description="time of day of the trigger, ISO 8601")
    white_level: PositiveCount | None = Field(
        None, description="grey level at which the camera's scale ends"
    )


def told_beside(path: Path) -> Beside:
    """Read ``<file>.toml`` beside a recording; without one, nothing is told.

    Raises
    ------
    SetupError
        If the file cannot be read, is not TOML, or holds an unknown key or a wrong value.
    RecordingError
        If it is too large to be such a file.
    """
    beside = path.with_name(f"{path.name}.toml")
    if not path.name or not beside.is_file():
        return Beside()
    if beside.stat().st_size > _MOST_BYTES:
        raise RecordingError(
            f"{beside}: {beside.stat().st_size} bytes, expected a few lines about {path.name}; "
            "move it out of the way"
        )
    return load_section(beside, Beside)


def with_told(stack: FieldStack, told: Beside) -> FieldStack:
    """Return a stack with what is told of it; what the file said otherwise becomes a note.

    Raises
    ------
    RecordingError
        If what is told cannot be.
    """
    said = {
        "rate_hz": told.rate,
        "exposure_s": told.exposure,
        "first_line": told.first_line,
        "first_column": told.first_column,
        "first_parity": told.first_parity,
        "interlaced": told.interlaced,
        "start_s": told.start,
        "trigger_time": told.trigger_time,
    }
    known: dict[str, Any] = {key: value for key, value in said.items() if value is not None}
    if not known and told.white_level is None:
        return stack
    try:
        info = dataclasses.replace(stack.info, **known)
    except RecordingError as error:
        raise RecordingError(f"{stack.path}.toml: {error}") from None
    notes = [
        f"{key} is {getattr(info, key)} as told beside it, the file says {before}"
        for key in known
        if (before := getattr(stack.info, key)) is not None and _differ(before, getattr(info, key))
    ]
    times = stack.times_s
    if times is not None and known.keys() & {"rate_hz", "start_s"}:
        times = _moved(stack, info)
    return stack.restated(
        info, times_s=times, white_level=told.white_level, notes=(*stack.notes, *notes)
    )


def _moved(stack: FieldStack, info: FieldInfo) -> NDArray[np.float64] | None:
    """Stretch and shift times to a rate and a start that are told."""
    if stack.times_s is None:
        return None
    first = stack.times_s[0]
    stretch = 1.0
    if stack.info.rate_hz is not None and info.rate_hz is not None:
        stretch = stack.info.rate_hz / info.rate_hz
    start = first if info.start_s == stack.info.start_s or info.start_s is None else info.start_s
    moved: NDArray[np.float64] = start + (stack.times_s - first) * stretch
    return moved


def _differ(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) > _TOLERANCE * abs(one)
    return one != other
