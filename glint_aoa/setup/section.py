"""A section of a file of settings: its kinds of values, and how it is read."""

import dataclasses
import difflib
import tomllib
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_type_hints

import pydantic
from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationInfo,
)
from pydantic.fields import FieldInfo

from glint_aoa.errors import InputError, SetupError
from glint_aoa.units import convert, parse_quantity

__all__ = [
    "FILL_IN",
    "IN_SI",
    "Count",
    "Metres",
    "Number",
    "PositiveCount",
    "PositiveHertz",
    "PositiveMetres",
    "PositiveSeconds",
    "Radians",
    "Section",
    "Unit",
    "check_filled",
    "finite",
    "first_problem",
    "keys_of",
    "load_section",
    "nearest",
    "positive",
    "quantity",
    "read_toml",
    "unfilled",
    "validated",
]

FILL_IN = "FILL IN"
"""Stands in a new file of settings for a value that only the user can know."""

IN_SI = {"in_si": True}
"""Context of a validation in which bare numbers are in the unit that the section holds."""


def quantity(unit: str) -> BeforeValidator:
    """Return a validator that reads a string such as ``"9.8 Hz"`` as a number in `unit`."""
    return BeforeValidator(partial(_parsed, unit=unit))


def _parsed(value: Any, info: ValidationInfo, *, unit: str) -> float:
    if info.context == IN_SI and isinstance(value, float):
        return value
    return parse_quantity(value, unit)


def finite(value: float) -> float:
    """Refuse what is not a finite number."""
    if not abs(value) < float("inf"):
        raise ValueError(f"{value} is not a finite number")
    return value


def _positive(value: float) -> float:
    if not finite(value) > 0:
        raise ValueError(f"{value:g} must be greater than zero")
    return value


positive = AfterValidator(_positive)
"""Validator: finite and greater than zero."""


def _known_unit(unit: str) -> str:
    convert(unit, unit)
    return unit


Number = Annotated[float, Field(strict=True), AfterValidator(finite)]
Metres = Annotated[float, quantity("m"), AfterValidator(finite)]
PositiveMetres = Annotated[Metres, positive]
Radians = Annotated[float, quantity("rad"), AfterValidator(finite)]
PositiveSeconds = Annotated[float, quantity("s"), positive]
PositiveHertz = Annotated[float, quantity("Hz"), positive]
Unit = Annotated[str, AfterValidator(_known_unit)]
Count = Annotated[int, Field(strict=True, ge=0)]
PositiveCount = Annotated[int, Field(strict=True, ge=1)]


class Section(pydantic.BaseModel):
    """A frozen part of a file of settings; keys that it does not know are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


_S = TypeVar("_S")


def load_section(path: Path, section: type[_S]) -> _S:
    """Read a TOML file that holds one section.

    Parameters
    ----------
    path : Path
        The file.
    section : type
        What it holds: a `Section`, or a dataclass of quantities whose keys are its fields' aliases.

    Returns
    -------
    Section
        In SI units and radians.

    Raises
    ------
    SetupError
        As for `load_setup`.
    """
    return validated(path, read_toml(path, missing="no such file"), section)


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


def unfilled(content: Any, where: str = "") -> list[str]:
    """Return the dotted keys of a setup that still say `FILL_IN`, in part or whole."""
    if isinstance(content, dict):
        below = [
            unfilled(each, f"{where}.{key}" if where else key) for key, each in content.items()
        ]
    elif isinstance(content, list):
        below = [unfilled(each, where) for each in content]
    else:
        return [where] if content == FILL_IN else []
    return list(dict.fromkeys(key for keys in below for key in keys))


def check_filled(path: Path, content: dict[str, Any]) -> None:
    """Refuse a file of settings with values that are still to be filled in; SetupError names them.

    Parameters
    ----------
    path : Path
        The file.
    content : dict
        What it holds.
    """
    keys = unfilled(content)
    if keys:
        names = f"{', '.join(keys[:-1])} and {keys[-1]}" if len(keys) > 1 else keys[0]
        raise SetupError(f'{path}: fill in {names}; put a value in place of each "{FILL_IN}"')


def validated(path: Path, content: dict[str, Any], section: type[_S]) -> _S:
    """Make a section of what a file holds; the first problem is named with file and key."""
    try:
        return TypeAdapter(section).validate_python(content)
    except pydantic.ValidationError as error:
        raise SetupError(f"{path}: {first_problem(error, section)}") from None


_UNKNOWN = {"extra_forbidden", "unexpected_keyword_argument"}


def first_problem(error: pydantic.ValidationError, section: type) -> str:
    """Say which key of a file is wrong and why; of several the first, an unknown key above all.

    Parameters
    ----------
    error : ValidationError
        What pydantic found.
    section : type
        What the file was to hold.
    """
    problems = error.errors(include_url=False)
    unknown = (each for each in problems if each["type"] in _UNKNOWN)
    problem = next(unknown, problems[0])
    where = _dotted(problem["loc"])
    if problem["type"] in _UNKNOWN:
        *parents, key = problem["loc"]
        return f"unknown key {where}; {nearest(str(key), _section_at(parents, section))}"
    missing = problem["type"] == "missing"
    message = "missing" if missing else problem["msg"].removeprefix("Value error, ")
    return f"{where}: {message}" if where else message


def _dotted(loc: tuple[int | str, ...]) -> str:
    parts = ""
    for part in loc:
        parts += f"[{part}]" if isinstance(part, int) else f".{part}" if parts else str(part)
    return parts


def _section_at(parents: list[int | str], section: type) -> type:
    for name in (part for part in parents if isinstance(part, str)):
        inner = _sections_in(keys_of(section)[name])
        section = inner[0] if inner else section
    return section


def keys_of(section: Any) -> dict[str, Any]:
    """Keys of a section in a file, and what each holds."""
    if issubclass(section, Section):
        return {name: each.annotation for name, each in section.model_fields.items()}
    hints = get_type_hints(section, include_extras=True)
    named = [(each.name, hints[each.name]) for each in dataclasses.fields(section)]
    return {_alias(hint) or name: hint for name, hint in named}


def _alias(hint: Any) -> str | None:
    told = (each.alias for each in get_args(hint) if isinstance(each, FieldInfo))
    return next(filter(None, told), None)


def _sections_in(annotation: Any) -> list[type]:
    if isinstance(annotation, type) and (
        issubclass(annotation, Section) or dataclasses.is_dataclass(annotation)
    ):
        return [annotation]
    return [each for part in get_args(annotation) for each in _sections_in(part)]


def nearest(key: str, section: type) -> str:
    """Say which known key an unknown one may have been meant for."""
    known = [name for name in keys_of(section) if name != "folder"]
    close = difflib.get_close_matches(key, known, n=1)
    return f"did you mean {close[0]}?" if close else f"known keys here: {', '.join(known)}"
