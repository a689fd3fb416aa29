"""``glint-aoa process``: the main job."""

from pathlib import Path

import typer

from glint_aoa.cli._common import (
    Json,
    Out,
    Overwrite,
    Points,
    SetupFile,
    Strict,
    bar,
    print_json,
    table,
)

__all__ = ["process"]


def process(
    points: Points,
    out: Out,
    setup: SetupFile = Path("glint-aoa.toml"),
    overwrite: Overwrite = False,
    strict: Strict = False,
    as_json: Json = False,
) -> None:
    """Measure recorded points: angle and intercept of each field, and their mean.

    Writes <point>.csv and <point>.nc for each point, and a row of log.csv. Points that cannot be
    read are named at the end; the others are measured all the same.

    Example: glint-aoa process run-01/*.h5 --setup glint-aoa.toml --out results
    """
    from glint_aoa.errors import InputError
    from glint_aoa.flags import describe
    from glint_aoa.process import PointResult, process_point
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    results: list[PointResult] = []
    failures: list[InputError] = []
    with bar(None) as advance:
        for path in points:
            advance(0, path.stem)
            try:
                results.append(
                    process_point(path, settings, out, overwrite=overwrite, progress=advance)
                )
            except InputError as error:
                failures.append(error)
    if as_json:
        print_json([{"name": each.name, **each.log} for each in results])
    elif results:
        _print(results)
        typer.echo(f"\nWrote {out}/<point>.csv, <point>.nc and log.csv")
        for result in results:
            for words in describe(result.flags):
                typer.echo(f"{result.name}: {words}", err=True)
    for failure in failures:
        typer.echo(f"glint-aoa: {failure}", err=True)
    if failures:
        raise typer.Exit(2)
    if strict and any(each.flags for each in results):
        raise typer.Exit(3)


def _print(results: list) -> None:  # type: ignore[type-arg]
    header = ["point", "fields", "mean angle [deg]", "u95", "std over fields", "intercept [mm]"]
    rows = [
        [
            each.name,
            f"{each.log['n_used']}/{each.log['n_fields']}",
            f"{each.log['mean_angle_deg']:.4f}",
            f"{each.log['mean_angle_u95_deg']:.4f}",
            f"{each.log['std_angle_deg']:.4f}",
            f"{each.log['mean_intercept_mm']:.3f}",
        ]
        for each in results
    ]
    table(header, rows)
