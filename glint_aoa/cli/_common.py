"""What several commands share: options, progress on stderr, JSON on stdout."""

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = [
    "Json",
    "Out",
    "Overwrite",
    "Points",
    "SetupFile",
    "Strict",
    "bar",
    "print_json",
    "table",
]

Points = Annotated[list[Path], typer.Argument(help="Recorded points.", show_default=False)]
SetupFile = Annotated[Path, typer.Option("--setup", "-s", help="Setup file.")]
Out = Annotated[
    Path, typer.Option("--out", "-o", help="Folder for the results; made if it is not there.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace results of the same name.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
Strict = Annotated[bool, typer.Option("--strict", help="Exit with 3 if anything is flagged.")]


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
        disable=not console.is_terminal,
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
