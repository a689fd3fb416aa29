"""Simulation files in TOML: sections with units in strings, and errors that name the key."""

import difflib
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import pydantic
from pydantic import AfterValidator, BeforeValidator, ConfigDict

from glint_aoa.errors import SetupError
from glint_aoa.units import parse_quantity

__all__ = ["Section", "load_section", "positive", "quantity"]


def quantity(unit: str) -> BeforeValidator:
    """Return a validator that reads a string such as ``"9.8 Hz"`` as a number in `unit`."""
    return BeforeValidator(_parser(unit))


def _parser(unit: str) -> Callable[[Any], float]:
    return lambda value: parse_quantity(value, unit)


def _is_positive(value: float) -> float:
    if not 0 < value < float("inf"):
        raise ValueError(f"{value:g} must be finite and greater than zero")
    return value


positive = AfterValidator(_is_positive)
"""Validator: finite and greater than zero."""


class Section(pydantic.BaseModel):
    """A frozen part of a simulation file; keys it does not know are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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
        If the file cannot be read, is not TOML, or holds an unknown key or a wrong value; the
        message names the file and the key.
    """
    try:
        with path.open("rb") as file:
            content = tomllib.load(file)
    except FileNotFoundError:
        raise SetupError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise SetupError(f"{path}: the file cannot be read ({error})") from None
    except tomllib.TOMLDecodeError as error:
        raise SetupError(f"{path}: not a TOML file: {error}") from None
    try:
        return section.model_validate(content)
    except pydantic.ValidationError as error:
        raise SetupError(f"{path}: {_first_problem(error, section)}") from None


def _first_problem(error: pydantic.ValidationError, section: type[Section]) -> str:
    problems = error.errors(include_url=False)
    unknown = (each for each in problems if each["type"] == "extra_forbidden")
    problem = next(unknown, problems[0])
    *parents, key = problem["loc"] or ("",)
    where = _dotted(problem["loc"])
    if problem["type"] == "extra_forbidden":
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
    known = list(section.model_fields)
    close = difflib.get_close_matches(key, known, n=1)
    return f"did you mean {close[0]}?" if close else f"known keys here: {', '.join(known)}"
