"""What several commands share: options, checks before work starts, progress, tables, JSON."""

import json
import math
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from glint_aoa.errors import InputError, OutputError

__all__ = [
    "Jobs",
    "Json",
    "Out",
    "Overwrite",
    "Points",
    "Polarity",
    "Resume",
    "Scan",
    "SetupFile",
    "Strict",
    "bar",
    "check_calibration_file",
    "check_folder",
    "check_names",
    "check_new_files",
    "number",
    "print_json",
    "table",
    "tell_flags",
]

Points = Annotated[
    list[Path],
    typer.Argument(metavar="POINT", help="Files of recorded points.", show_default=False),
]
SetupFile = Annotated[Path, typer.Option("--setup", "-s", metavar="FILE", help="Setup file.")]
Out = Annotated[
    Path,
    typer.Option(
        "--out", "-o", metavar="FOLDER", help="Folder for the results; made if it is not there."
    ),
]
Jobs = Annotated[
    int, typer.Option("--jobs", min=1, metavar="N", help="Processes that share the points.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace results of the same name.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on where an interrupted run stopped.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
Strict = Annotated[bool, typer.Option("--strict", help="Exit with code 3 if anything is flagged.")]


class Polarity(StrEnum):
    """Whether circles are brighter or darker than what is around them."""

    bright = "bright"
    dark = "dark"


class Scan(StrEnum):
    """How a picture was scanned: all lines together, or fields of even and odd ones."""

    progressive = "progressive"
    interlaced = "interlaced"
    even = "even"
    odd = "odd"


def check_calibration_file(out: Path, setup: Path | None) -> None:
    """Refuse a name that a calibration cannot have, before anything is measured.

    Raises
    ------
    OutputError
        If it is no TOML file, is the setup itself, or its folder cannot be written to.
    """
    if out.suffix.lower() != ".toml":
        raise OutputError(f"{out}: a calibration is a TOML file; end its name with .toml")
    if setup is not None and out.resolve() == setup.resolve():
        raise OutputError(f"{out} is the setup itself; give the calibration another name")
    check_folder(out.parent)


def check_names(paths: Sequence[Path], *, taken: Sequence[str] = ()) -> None:
    """Refuse files whose results would replace each other's, or a table of the same folder.

    Raises
    ------
    InputError
        If two of `paths` have one stem, or the stem is one of `taken`.
    """
    first: dict[str, Path] = {}
    for path in paths:
        other = first.setdefault(path.stem, path)
        if path.stem in taken:
            raise InputError(
                f"{path}: its results would take the name of {path.stem}.csv, a table of all "
                "points; rename the file"
            )
        if other is not path and other == path:
            raise InputError(f"{path} is given twice; give each file once")
        if other is not path:
            raise InputError(
                f"{other} and {path} are both called {path.stem}, and so would be their results; "
                "give one of them, or each another --out"
            )


def check_folder(folder: Path) -> None:
    """Refuse a folder for results that cannot be made or written to, before any work is done.

    Raises
    ------
    OutputError
        If `folder`, or where it would be made, is no folder or may not be written to.
    """
    there = next(each for each in (folder, *folder.absolute().parents) if os.path.lexists(each))
    if not there.is_dir():
        raise OutputError(f"{there}: a file, expected a folder for results; give another --out")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OutputError(
            f"{there}: no permission to write there; give another --out or change its permissions"
        )


def check_new_files(files: Iterable[Path], *, overwrite: bool) -> None:
    """Refuse to write where something has been written before, before any work is done.

    Raises
    ------
    OutputError
        If one of `files` is there already and `overwrite` is False.
    """
    from glint_aoa.records._files import check_new

    if not overwrite:
        check_new(files)


@contextmanager
def bar(total: int | None) -> Iterator[Any]:
    """Progress bar on stderr, with time left; nothing is shown in a pipe.

    Yields
    ------
    function
        Call it with how many steps are done, and optionally what is being done.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    progress = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    with progress:
        task = progress.add_task("", total=total)

        def advance(steps: int = 1, what: str | None = None) -> None:
            progress.update(task, advance=steps, description=what)

        yield advance


def print_json(value: Any) -> None:
    """Print JSON on stdout; what is not a number becomes null."""
    typer.echo(json.dumps(_plain(value), indent=2, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def table(header: list[str], rows: list[list[str]], *, left: int = 1) -> None:
    """Print a plain table on stdout, the first `left` columns left-aligned."""
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
    for row in [header, *rows]:
        cells = [
            cell.ljust(width) if i < left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        typer.echo("  ".join(cells).rstrip())


def number(value: float, spec: str) -> str:
    """Format a number for a table; a dash stands for what was not measured."""
    return format(value, spec) if math.isfinite(value) else "-"


def tell_flags(name: str, mask: int, each: Iterable[int], what: str) -> None:
    """Say on stderr what is flagged, and at how many fields or rows.

    Parameters
    ----------
    name : str
        Name of the point or record.
    mask : int
        All of its flags.
    each : iterable of int
        Flags of its fields or rows.
    what : str
        What these are, such as "fields".
    """
    from glint_aoa.flags import Flag, describe

    masks = [int(one) for one in each]
    for words in describe(mask):
        flag, _, meaning = words.partition(": ")
        count = sum(bool(one & Flag[flag]) for one in masks)
        where = f" ({count} of {len(masks)} {what})" if count else ""
        typer.echo(f"{name}: {flag}{where}: {meaning}", err=True)
