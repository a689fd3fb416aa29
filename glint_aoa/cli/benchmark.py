"""``glint-aoa benchmark``: optical held against inertial."""

from pathlib import Path
from typing import Any

import typer

from glint_aoa.cli._common import Json, Out, Overwrite, Points, SetupFile, bar, print_json

__all__ = ["benchmark", "run_benchmark"]


def benchmark(
    points: Points,
    out: Out,
    setup: SetupFile = Path("glint-aoa.toml"),
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Hold the optical angle against the inertial one over runs of points, as in Table 4.

    Each run must start and end with the shaker off; the mean of the two is subtracted. Writes
    the results of each point, the errors, Table 4, the repeatability and the errors' figure.

    Example: glint-aoa benchmark points/*.h5 --setup glint-aoa.toml --out results
    """
    from glint_aoa.setup import load_setup

    summary = run_benchmark(points, load_setup(setup), out, overwrite=overwrite)
    if as_json:
        print_json({key: value for key, value in summary.items() if key != "text"})
        return
    typer.echo(summary["text"])
    typer.echo("Wrote " + ", ".join(str(path) for path in summary["files"]))


def run_benchmark(
    points: list[Path], settings: Any, out: Path, *, overwrite: bool = False
) -> dict[str, Any]:
    """Process, correct and compare points; write the tables and return them."""
    from dataclasses import asdict

    from glint_aoa.benchmark import point_errors, repeatability, table4
    from glint_aoa.campaign import compare_points
    from glint_aoa.report import figures, tables

    with bar(len(points)) as advance:
        compared = compare_points(
            points,
            settings,
            out,
            overwrite=overwrite,
            progress=lambda path: advance(1, path.stem),
        )
    errors = point_errors(compared)
    rows, steadiness = table4(errors), repeatability(compared)
    tables.write_errors_csv(out / "errors.csv", errors, overwrite=overwrite)
    by_kind = table4(errors, by_kind=True)
    tables.write_table4_csv(out / "table4.csv", by_kind, overwrite=overwrite)
    tables.write_repeatability_csv(out / "repeatability.csv", steadiness, overwrite=overwrite)
    figures.save_figure(
        figures.error_figure(errors), out / "errors-against-moment.png", overwrite=overwrite
    )
    names = ("errors.csv", "table4.csv", "repeatability.csv", "errors-against-moment.png")
    return {
        "text": f"{tables.format_table4(rows)}\n{tables.format_repeatability(steadiness)}",
        "table4": [asdict(row) for row in by_kind],
        "repeatability": [asdict(row) for row in steadiness],
        "files": [out / name for name in names],
    }
