"""``glint-aoa process``: the main job."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from glint_aoa.cli._common import (
    Json,
    Out,
    Overwrite,
    Points,
    Resume,
    SetupFile,
    Strict,
    bar,
    check_folder,
    check_names,
    number,
    print_json,
    table,
    tell_flags,
)

if TYPE_CHECKING:
    from glint_aoa.process import PointResult
    from glint_aoa.setup import Setup

__all__ = ["process"]


def process(
    points: Points,
    out: Out,
    setup: SetupFile = Path("glint-aoa.toml"),
    overwrite: Overwrite = False,
    resume: Resume = False,
    strict: Strict = False,
    as_json: Json = False,
) -> None:
    """Measure angle and intercept of each field, and their mean.

    Writes <point>.csv and <point>.nc for each point, and a row of log.csv. Points that cannot be
    read are named at the end; the others are measured all the same. What was not measured is an
    empty cell, and flagged.

    \b
    Example: glint-aoa process run-01/*.h5 --setup glint-aoa.toml --out results
    """
    from glint_aoa.errors import InputError
    from glint_aoa.process import load_sweep, process_point
    from glint_aoa.resume import finished_points
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    load_sweep(settings)
    check_names(points, taken=["log"])
    check_folder(out)
    finished = finished_points(points, settings, out) if resume else []
    left = [path for path in points if path not in finished]
    results: list[PointResult] = []
    failures: list[InputError] = []
    with bar(_n_fields(left, settings)) as advance:
        for path in left:
            advance(0, path.stem)
            try:
                result = process_point(
                    path, settings, out, overwrite=overwrite or resume, progress=advance
                )
                results.append(result)
            except InputError as error:
                failures.append(error)
    if as_json:
        print_json([{"name": each.name, **each.log} for each in results])
    elif results:
        _print(results, out)
    if finished:
        typer.echo(f"{len(finished)} of {len(points)} points were finished before", err=True)
    for failure in failures:
        typer.echo(f"glint-aoa: {failure}", err=True)
    if failures:
        raise typer.Exit(2)
    if strict and any(each.flags for each in results):
        raise typer.Exit(3)


def _n_fields(points: list[Path], settings: "Setup") -> int:
    """Count the fields to measure; points that cannot be opened have their say later."""
    from glint_aoa.errors import InputError
    from glint_aoa.records.formats import open_fields

    count = 0
    for path in points:
        try:
            count += open_fields(path, settings.fields).n_fields
        except InputError:
            continue
    return count


def _print(results: "list[PointResult]", out: Path) -> None:
    header = ["point", "fields", "mean angle [deg]", "u95 [deg]", "std [deg]", "intercept [mm]"]
    rows = [
        [
            each.name,
            f"{each.log['n_used']}/{each.log['n_fields']}",
            number(each.log["mean_angle_deg"], ".4f"),
            number(each.log["mean_angle_u95_deg"], ".4f"),
            number(each.log["std_angle_deg"], ".4f"),
            number(each.log["mean_intercept_mm"], ".3f"),
        ]
        for each in results
    ]
    table(header, rows)
    typer.echo("\nfields: used of recorded; u95: of the mean; std: over the fields")
    typer.echo(f"Wrote {out / '<point>.csv'}, <point>.nc and log.csv")
    for each in results:
        tell_flags(each.name, each.flags, each.values["flags"], "fields")
        for key in ("recording_notes", "calibration_doubts"):
            for note in filter(None, each.attrs.get(key, "").split("; ")):
                typer.echo(f"{each.name}: {note}", err=True)
