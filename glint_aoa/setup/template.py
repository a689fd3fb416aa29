"""A setup file with every key in it, each with its unit and meaning, written from the models."""

import copy
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, Literal, get_args, get_origin

import pydantic
import tomli_w
from pydantic.fields import FieldInfo

from glint_aoa.errors import SetupError
from glint_aoa.setup.section import FILL_IN, Section, first_problem
from glint_aoa.setup.whole import CALIBRATED, Setup

__all__ = ["NEEDED", "parse_value", "set_value", "setup_template"]

NEEDED = (
    "camera.focal_length",
    "camera.pixel_pitch",
    "camera.sensor",
    "camera.position",
    "glint.nose",
)
"""Keys that an angle in the tunnel needs and that nobody but the user can know."""

_HEAD = f"""\
# Setup of glint-aoa: camera, recording, glint, inertial package, calibrations.
#
# A quantity is a string with its unit; any unit that fits the one in [brackets] will do.
# A line that begins with "#" and a key is optional; without it the value that it shows holds, or
# nothing does where it ends in "# example". What says "{FILL_IN}" only you can know: put a value
# in its place.
"""
_WIDTH = 98  # of a comment's words


def setup_template(
    values: Mapping[str, Any] | None = None,
    *,
    needed: Collection[str] = NEEDED,
    notes: Mapping[str, str] | None = None,
) -> str:
    """Write a setup file that holds every key, most of them as comments.

    Parameters
    ----------
    values : mapping, optional
        What is known, nested as TOML gives it: ``{"glint": {"nose": "left"}}``.
    needed : collection of str, optional
        Dotted keys to mark ``"FILL IN"`` where `values` do not give them. What a calibration
        named in `values` gives is not asked for.
    notes : mapping, optional
        A remark for dotted keys, such as where the value comes from.

    Returns
    -------
    str
        TOML. Read back with nothing left to fill in, it gives `values`, and the defaults beside.

    Raises
    ------
    SetupError
        If a key of `values` is unknown, a value is wrong, or two contradict each other.
    """
    given = values or {}
    calibration = given.get("calibration")
    named = calibration if isinstance(calibration, Mapping) else {}
    calibrated = {f"camera.{key}" for file in named for key in CALIBRATED.get(file, ())}
    _check(given, {*needed, *calibrated.intersection(NEEDED)})
    template = _Template(frozenset(needed) - calibrated, notes or {})
    return "\n".join((_HEAD, *template.section(Setup, given, "", live=True)))


def set_value(values: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key of a nested setup, such as ``camera.sensor``.

    Raises
    ------
    SetupError
        If a name before the last is a value there already.
    """
    *parents, last = key.split(".")
    for name in parents:
        values = values.setdefault(name, {})
        if not isinstance(values, dict):
            raise SetupError(f"{key}: {name} has a value already; give it once, or key by key")
    values[last] = value


def parse_value(text: str) -> Any:
    """Read a value as TOML has it; what is no TOML is a string: ``20``, ``[0, 92]``, ``35 mm``."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _check(values: Mapping[str, Any], asked: Collection[str]) -> None:
    """Refuse what is wrong whatever the user fills in: examples stand for what is asked for."""
    content = copy.deepcopy({**values})
    for key in asked:
        section, name = key.split(".")
        there = content.setdefault(section, {})
        if isinstance(there, dict):
            there.setdefault(name, _shown(_keys_in(section)[name]))
    try:
        Setup.model_validate(content)
    except pydantic.ValidationError as error:
        raise SetupError(first_problem(error, Setup)) from None


@dataclass(frozen=True)
class _Template:
    """How a file is written: which keys are marked, and what is remarked of which."""

    needed: frozenset[str]
    notes: Mapping[str, str]

    def section(
        self, section: type[Section], values: Mapping[str, Any], where: str, *, live: bool
    ) -> Iterator[str]:
        """Yield the lines of a section's keys, and then of the sections in it."""
        tables = []
        for key, field in _fields(section).items():
            if _inner(field)[0] is not None:
                tables.append((key, field))
            else:
                yield from self.key(key, field, values, where, live=live)
        for key, field in tables:
            yield from self.table(field, values.get(key), f"{where}{key}", live=live)

    def key(
        self, key: str, field: FieldInfo, values: Mapping[str, Any], where: str, *, live: bool
    ) -> Iterator[str]:
        """Yield a key's comment, and the key with its value, default or example."""
        name = f"{where}{key}"
        yield from _comment(_meaning(field))
        if name in self.notes:
            yield from _comment(self.notes[name])
        shown = _toml(_shown(field))
        if key in values:
            yield f"{key} = {_toml(values[key])}"
        elif live and name in self.needed:
            yield f'{key} = "{FILL_IN}"  # such as {shown}'
        else:
            has_default = not field.is_required() and field.default not in (None, ())
            yield f"#{key} = {shown}" + ("" if has_default else "  # example")
        yield ""

    def table(self, field: FieldInfo, value: Any, where: str, *, live: bool) -> Iterator[str]:
        """Yield the lines of a section, or of each of several; as comments if there is none."""
        inner, many = _inner(field)
        assert inner is not None
        header = f"[[{where}]]" if many else f"[{where}]"
        one = (value or {},) if value or field.default is not None else ()
        there: Sequence[Mapping[str, Any]] = (value or ()) if many else one
        shown = live and bool(there)
        yield from _comment(field.description or "")
        for each in there or ({},):
            yield header if shown else f"#{header}"
            yield ""
            yield from self.section(inner, each, f"{where}.", live=shown)


def _fields(section: type[Section]) -> dict[str, FieldInfo]:
    return {
        key: each
        for key, each in section.model_fields.items()
        if each.description  # a key of the file, which the folder that it lies in is not
    }


def _keys_in(name: str) -> dict[str, FieldInfo]:
    section, _ = _inner(Setup.model_fields[name])
    assert section is not None
    return _fields(section)


def _inner(field: FieldInfo) -> tuple[type[Section] | None, bool]:
    """Return the section that a key holds, if it does, and whether it holds several."""
    annotation = field.annotation
    for each in (annotation, *get_args(annotation)):
        if isinstance(each, type) and issubclass(each, Section):
            return each, get_origin(annotation) is tuple
    return None, False


def _meaning(field: FieldInfo) -> str:
    """Return a key's description, and what it may be where that is a matter of choice."""
    parts = (field.annotation, *get_args(field.annotation))
    choices = [
        _toml(each) for part in parts if get_origin(part) is Literal for each in get_args(part)
    ]
    return "; ".join(filter(None, (field.description, _words(choices))))


def _words(choices: list[str]) -> str:
    return f"{', '.join(choices[:-1])} or {choices[-1]}" if choices else ""


def _shown(field: FieldInfo) -> Any:
    """Return the value to show: how a file says the default, or an example."""
    return field.examples[0] if field.examples else field.default


def _toml(value: Any) -> str:
    """Return a value as TOML on one line."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key} = {_toml(each)}' for key, each in value.items())}}}"
    return tomli_w.dumps({"value": value}).removeprefix("value = ").strip()


def _comment(text: str) -> Iterator[str]:
    for line in wrap(text, _WIDTH):
        yield f"# {line}"
