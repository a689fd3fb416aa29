"""Pages of the site that follow from the program: commands, keys of the setup, Python, notebooks.

MkDocs calls `on_config` and `on_files`; nothing of what they make is kept in the repository.
"""

import ast
import html
import json
import logging
import re
import types
import typing
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import annotated_types
import typer
from pydantic import BeforeValidator
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from glint_aoa.cli._grouped import GROUPS
from glint_aoa.cli.app import app
from glint_aoa.records.formats._beside import Beside
from glint_aoa.setup import Setup
from glint_aoa.setup.section import Section, positive

__all__ = [
    "command_pages",
    "notebook_pages",
    "on_config",
    "on_files",
    "on_post_page",
    "python_pages",
    "setup_page",
]

_LOG = logging.getLogger("mkdocs.plugins.glint-aoa")
_FETCHED = re.compile(
    r"<(?:script|img|iframe|link)\b[^>]*?(?:src|href)=[\"']?((?:https?:)?//[^\"'\s>]+)"
)
_ROOT = Path(__file__).parents[1]
_BAR = "\N{DIVIDES}"  # what parts choices; a plain bar would part the cells of the table
_COMMANDS, _PYTHON, _NOTEBOOKS = "reference/commands/", "reference/python/", "notebooks/"

Pages = dict[str, str | bytes]
"""Content of each page, or of a picture in it, by its path in the site."""


# What MkDocs calls


def on_config(config: Any) -> Any:
    """Put the pages of a folder in the navigation where only the folder is named."""
    folders = {
        folder: [name for name in make() if name.endswith(".md")]
        for folder, make in _FOLDERS.items()
    }
    config.nav = _with_folders(config.nav, folders)
    return config


def on_files(files: Any, *, config: Any) -> Any:
    """Add the pages to those that stand in docs/."""
    from mkdocs.structure.files import File  # noqa: PLC0415  the tests need no MkDocs

    pages: Pages = {"reference/setup.md": setup_page()}
    for make in _FOLDERS.values():
        pages |= make()
    for name, content in pages.items():
        files.append(File.generated(config, name, content=content))
    return files


def on_post_page(output: str, *, page: Any, config: Any) -> None:  # noqa: ARG001
    """Warn of what a page would fetch from another place: the site must work without a network."""
    for fetched in _FETCHED.findall(output):
        _LOG.warning("%s fetches %s", page.file.src_uri, fetched)


def _with_folders(nav: Any, folders: dict[str, list[str]]) -> Any:
    if isinstance(nav, list):
        return [_with_folders(each, folders) for each in nav]
    if isinstance(nav, dict):
        return {title: _with_folders(each, folders) for title, each in nav.items()}
    return folders.get(nav, nav)


# Commands


def command_pages() -> Pages:
    """Return a page for each command, with what its ``--help`` says, and one for the program."""
    program = typer.main.get_command(app)
    pages = {"index": "\n".join(_program_lines(program))}
    pages |= {
        name: "\n".join(_command_lines(program.commands[name], f"glint-aoa {name}", 1))  # type: ignore[attr-defined]
        for names in GROUPS.values()
        for name in names
    }
    return {f"{_COMMANDS}{name}.md": page for name, page in pages.items()}


def _program_lines(program: Any) -> Iterator[str]:
    yield from _command_lines(program, "glint-aoa", 1, inner=False)
    for title, names in GROUPS.items():
        yield from ["", f"| {title.lower()} | |", "|---|---|"]
        for name in names:
            short = program.commands[name].get_short_help_str(200)
            yield f"| [`{name}`]({name}.md) | {_escaped(short)} |"
    yield from [
        "",
        "Exit code 0: done. 2: bad input or usage, said in one sentence. 3: measured but",
    ]
    yield "flagged, with `--strict`. `--json` prints the result on stdout; progress goes to stderr."


def _command_lines(command: Any, name: str, level: int, *, inner: bool = True) -> Iterator[str]:
    yield from [f"{'#' * level} {name}", ""]
    yield from _description(command.help)
    context = command.context_class(
        command, info_name=name, terminal_width=100, help_option_names=["-h", "--help"]
    )
    yield from ["```text", command.get_usage(context), "```", ""]
    records = [
        (names.split(" <")[0] if each.param_type_name == "argument" else names, text)
        for each in command.get_params(context)
        for names, text in [each.get_help_record(context) or ("", "")]
        if names
    ]
    yield from ["| argument or option | meaning |", "|---|---|"]
    yield from (f"| `{names.replace('|', _BAR)}` | {_escaped(text)} |" for names, text in records)
    yield ""
    if inner:
        for inner_name, each in _inner(command).items():
            yield from _command_lines(each, f"{name} {inner_name}", level + 1)


def _inner(command: Any) -> dict[str, Any]:
    if hasattr(command, "commands"):
        return dict(command.commands)
    return command.studies() if hasattr(command, "studies") else {}


def _description(text: str) -> Iterator[str]:
    for paragraph in re.split(r"\n\s*\n", text.strip()):
        lines = paragraph.strip("\n")
        if "\b" not in lines:
            yield from [_escaped(lines), ""]
            continue
        shown = lines.replace("\b", "").strip("\n")
        if shown.startswith("Example: "):
            shown = shown.removeprefix("Example: ")
            yield from ["Example:", ""]
        yield from ["```", shown, "```", ""]


def _escaped(text: str) -> str:
    """Return plain text as Markdown; what stands in backticks stays as it is."""
    parts = re.split(r"(`[^`]*`)", re.sub(r"\s+", " ", text.replace("\b", " ")).strip())
    return "".join(
        part if part.startswith("`") else re.sub(r"([*_|\[\]])", r"\\\1", html.escape(part, False))
        for part in parts
    )


# Keys of the setup


def setup_page() -> str:
    """Return the page of all keys of the setup, and of what may be told beside a recording."""
    lines = [
        "# Keys of the setup",
        "",
        "Every key of `glint-aoa.toml`. [Files](../files.md#setup) shows them in one commented",
        "file. A quantity is a string with its unit: any unit of that kind which",
        '[pint](https://pint.readthedocs.io) knows: `"56 in"` will do where the table says m.',
        "A dash stands for a key that is not set unless it is given.",
        "",
    ]
    for where, section, repeated in _tables(Setup):
        name = f"[[{where}]]" if repeated else f"[{where}]"
        lines += [f"## `{name}`", "", (section.__doc__ or "").split("\n")[0], ""]
        lines += _key_table(section)
    lines += [
        "## Beside a recording",
        "",
        "Keys of `<file>.toml` beside a recording, for",
        "[what a recording does not say](../files.md#what-a-recording-does-not-say).",
        "",
    ]
    return "\n".join([*lines, *_key_table(Beside)])


def _tables(section: Any, where: str = "") -> Iterator[tuple[str, Any, bool]]:
    hints = get_type_hints(section, include_extras=True)
    for key in section.model_fields:
        inner, repeated = _section_of(hints[key])
        if inner is not None:
            yield f"{where}{key}", inner, repeated
            yield from _tables(inner, f"{where}{key}.")


def _section_of(hint: Any) -> tuple[Any, bool]:
    """Return the section that a key holds, and whether it holds several."""
    for each in _choices(_bare(hint)[0]):
        if isinstance(each, type) and issubclass(each, Section):
            return each, False
        if get_origin(each) is tuple and Ellipsis in get_args(each):
            return _section_of(get_args(each)[0])[0], True
    return None, False


def _key_table(section: Any) -> list[str]:
    hints = get_type_hints(section, include_extras=True)
    rows = ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
    for key, field in section.model_fields.items():
        if key == "folder" or _section_of(hints[key])[0] is not None:
            continue
        kind, unit = _kind(hints[key])
        cells = [f"`{key}`", kind, unit, _default(field, unit), _escaped(field.description or "")]
        rows.append(f"| {' | '.join(cells)} |")
    return [*rows, ""] if len(rows) > 2 else []


def _kind(hint: Any) -> tuple[str, str]:
    """Return in words what a key holds, and the unit that quantities are turned into."""
    hint, extras = _bare(hint)
    (hint,) = _choices(hint)
    inner, more = _bare(hint)
    extras += more
    bound = _bound(extras)
    for each in extras:
        if isinstance(each, BeforeValidator) and isinstance(each.func, partial):
            return f"quantity{bound}", each.func.keywords["unit"]
    if get_origin(inner) is Literal:
        return ", ".join(f'`"{value}"`' for value in get_args(inner)), ""
    if get_origin(inner) is tuple:
        parts = get_args(inner)
        kind, unit = _kind(parts[0])
        return f"list{'' if Ellipsis in parts else f' of {len(parts)}'}: {kind}", unit
    words = {float: "number", int: "whole number", bool: "true or false", str: "text"}
    return f"{words[inner]}{bound}", ""


def _bound(extras: list[Any]) -> str:
    signs = {
        annotated_types.Gt: ("gt", "&gt;"),
        annotated_types.Ge: ("ge", "≥"),
        annotated_types.Le: ("le", "≤"),
    }
    flat = [
        part
        for each in extras
        for part in (each.metadata if isinstance(each, FieldInfo) else [each])
    ]
    bounds = [
        f" {sign} {getattr(each, name):g}"
        for each in flat
        for kind, (name, sign) in signs.items()
        if isinstance(each, kind)
    ]
    return "".join(bounds) or (" &gt; 0" if positive in extras else "")


def _bare(hint: Any) -> tuple[Any, list[Any]]:
    if get_origin(hint) is Annotated:
        inner, *extras = get_args(hint)
        return inner, extras
    return hint, []


def _choices(hint: Any) -> tuple[Any, ...]:
    """Return what a key may hold, but for nothing at all."""
    if get_origin(hint) in (typing.Union, types.UnionType):
        return tuple(each for each in get_args(hint) if each is not type(None))
    return (hint,)


def _default(field: FieldInfo, unit: str) -> str:
    value = field.default
    if value is PydanticUndefined:
        return "required"
    if value is None or value == ():
        return "-"
    return f"`{json.dumps(field.examples[0]) if field.examples else _toml(value, unit)}`"


def _toml(value: Any, unit: str) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(each, unit) for each in value)}]"
    if unit:
        return f'"{value:g} {unit}"'
    return json.dumps(value)


# Python


_PACKAGES = {
    "glint_aoa": "The package",
    "glint_aoa.setup": "Setup",
    "glint_aoa.records": "Recordings and records",
    "glint_aoa.geometry": "Geometry",
    "glint_aoa.optical": "Optical angle",
    "glint_aoa.inertial": "Inertial angle",
    "glint_aoa.report": "Figures and tables",
    "calibration": "Calibration",
    "render_sim": "Simulated tests",
}


def python_pages() -> Pages:
    """Return a page for each package, with its public modules; their docstrings fill them."""
    pages = {}
    for package, title in _PACKAGES.items():
        lines = [f"# {title}: `{package}`", ""]
        for module in sorted(_public_modules(package)):
            lines += [f"::: {module}", ""]
            if _ROOT.joinpath(
                *module.split(".")
            ).is_dir():  # what it gathers follows, module by module
                lines[-1:] = ["    options:", "      members: false", ""]
        pages[f"{_PYTHON}{package}.md"] = "\n".join(lines)
    return pages


def _public_modules(package: str) -> Iterator[str]:
    """Yield the modules that list what is public in them; those of a page of its own apart."""
    folder = _ROOT.joinpath(*package.split("."))
    for path in folder.rglob("*.py"):
        parts = path.relative_to(_ROOT).with_suffix("").parts
        parts = parts[:-1] if parts[-1] == "__init__" else parts
        module = ".".join(parts)
        others = (each for each in _PACKAGES if each.startswith(f"{package}."))
        if any(module == other or module.startswith(f"{other}.") for other in others):
            continue
        hidden = any(part.startswith("_") or part in {"cli", "paper_figures"} for part in parts)
        if not hidden and _lists_names(path):
            yield module


def _lists_names(path: Path) -> bool:
    """Whether a module states `__all__`, and defines something that it names."""
    body = ast.parse(path.read_text()).body
    stated = any(
        isinstance(each, ast.Assign) and ast.unparse(each.targets[0]) == "__all__" for each in body
    )
    defines = any(isinstance(each, ast.FunctionDef | ast.ClassDef) for each in body)
    return stated and (defines or path.name == "__init__.py")


# Notebooks


def notebook_pages() -> Pages:
    """Return the notebooks as they are stored, pictures included, linked to the site's pages."""
    from nbconvert import MarkdownExporter  # noqa: PLC0415  slow to load, and not for the tests

    pages: Pages = {}
    for path in sorted((_ROOT / "notebooks").glob("*.ipynb")):
        page, resources = MarkdownExporter().from_filename(
            path, resources={"output_files_dir": path.stem}
        )
        linked = page.replace(".ipynb)", ".md)").replace("](../docs/", "](../")
        pages[f"{_NOTEBOOKS}{path.stem}.md"] = linked
        pages |= {f"{_NOTEBOOKS}{name}": data for name, data in resources["outputs"].items()}
    return pages


_FOLDERS = {_COMMANDS: command_pages, _PYTHON: python_pages, _NOTEBOOKS: notebook_pages}
