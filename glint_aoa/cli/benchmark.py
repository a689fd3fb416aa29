"""``glint-aoa benchmark``: optical held against inertial."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._benchmark_command import studies_like
from glint_aoa.cli._common import (
    Jobs,
    Json,
    Out,
    Overwrite,
    SetupFile,
    Strict,
    bar,
    check_folder,
    check_names,
    check_new_files,
    print_json,
)

if TYPE_CHECKING:
    from glint_aoa.benchmark import BenchmarkPoint

__all__ = ["benchmark", "check_benchmark", "run_benchmark", "tell_flagged"]

_TABLES = ("errors.csv", "table4.csv", "repeatability.csv")
_PICTURE = "errors-against-moment.png"


def benchmark(
    points: Annotated[
        list[Path],
        typer.Argument(
            metavar="POINT",
            help="Files of recorded points.",
            show_default=False,
            autocompletion=studies_like,
        ),
    ],
    out: Out,
    setup: SetupFile = Path("glint-aoa.toml"),
    jobs: Jobs = 1,
    overwrite: Overwrite = False,
    strict: Strict = False,
    as_json: Json = False,
) -> None:
    """Hold the optical angle against the inertial one.

    Each run must start and end with the shaker off; the mean of the two is subtracted from its
    other points, which is their error. Give the points of a run in the order in which they were
    taken. Points of a pitch sweep and single records are left out.

    Writes the results of each point as process does, errors.csv, table4.csv, repeatability.csv
    and a picture of the errors against the balance moment.

    ``benchmark inertial`` holds the inertial corrections against the paper, on simulated records;
    ``benchmark figures`` makes the paper's figures.

    \b
    Example: glint-aoa benchmark points/*.h5 --setup glint-aoa.toml --out results
    """
    from glint_aoa.setup import load_setup

    summary = run_benchmark(points, load_setup(setup), out, jobs=jobs, overwrite=overwrite)
    compared = summary["compared"]
    if as_json:
        print_json({key: summary[key] for key in ("table4", "repeatability", "files")})
    else:
        typer.echo(summary["text"])
        typer.echo("\nWrote " + ", ".join(str(path) for path in summary["files"]))
        tell_flagged(compared)
        if len(compared) < len(points):
            typer.echo(
                f"left out: {len(points) - len(compared)} points of a pitch sweep or of no run",
                err=True,
            )
    if strict and any(point.flags for point in compared):
        raise typer.Exit(3)


def check_benchmark(out: Path, *, overwrite: bool) -> None:
    """Refuse a folder that cannot be written to, or that holds a comparison already."""
    check_folder(out)
    check_new_files((out / name for name in (*_TABLES, _PICTURE)), overwrite=overwrite)


def run_benchmark(
    points: list[Path], settings: Any, out: Path, *, jobs: int = 1, overwrite: bool = False
) -> dict[str, Any]:
    """Process, correct and compare points; write the tables and return them."""
    from dataclasses import asdict

    from glint_aoa.benchmark import point_errors, table4
    from glint_aoa.campaign import compare_points
    from glint_aoa.repeatability import repeatability
    from glint_aoa.report import figures, tables

    check_names(points, taken=["log", *(Path(name).stem for name in _TABLES)])
    check_benchmark(out, overwrite=overwrite)
    with bar(len(points)) as advance:
        compared = compare_points(
            points,
            settings,
            out,
            jobs=jobs,
            overwrite=overwrite,
            progress=lambda path: advance(1, path.stem),
        )
    errors = point_errors(compared)
    by_kind, steadiness = table4(errors, by_kind=True), repeatability(compared)
    tables.write_errors_csv(out / "errors.csv", errors, overwrite=overwrite)
    tables.write_table4_csv(out / "table4.csv", by_kind, overwrite=overwrite)
    tables.write_repeatability_csv(out / "repeatability.csv", steadiness, overwrite=overwrite)
    figures.save_figure(figures.error_figure(errors), out / _PICTURE, overwrite=overwrite)
    text = tables.format_table4(table4(errors)), tables.format_repeatability(steadiness)
    return {
        "text": "\n\n".join(text),
        "table4": [asdict(row) for row in by_kind],
        "repeatability": [asdict(row) for row in steadiness],
        "files": [out / name for name in (*_TABLES, _PICTURE)],
        "compared": compared,
    }


def tell_flagged(points: "Iterable[BenchmarkPoint]") -> None:
    """Say on stderr which points are flagged, and why."""
    from glint_aoa.flags import describe

    for point in points:
        for words in describe(point.flags):
            typer.echo(f"{point.point}: {words}", err=True)
