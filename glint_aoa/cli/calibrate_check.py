"""``glint-aoa calibrate check``: whether a pitch sweep still holds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glint_aoa.cli._common import (
    Json,
    Overwrite,
    Points,
    SetupFile,
    Strict,
    bar,
    check_folder,
    check_names,
    check_new_files,
    number,
    print_json,
    table,
)

if TYPE_CHECKING:
    from calibration.drift.check import Change, Drift, Hypothesis
    from calibration.sweep.fit import PitchSweep
    from glint_aoa.setup import Setup

__all__ = ["check"]

_WORTH_PRINTING = 0.005
"""Least probability of a hypothesis that is listed."""


def check(
    points: Points,
    setup: SetupFile = Path("glint-aoa.toml"),
    sweep: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Pitch sweep; the setup's if not given.", show_default=False
        ),
    ] = None,
    png: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Picture to write of the points.", show_default=False),
    ] = None,
    overwrite: Overwrite = False,
    strict: Strict = False,
    as_json: Json = False,
) -> None:
    """Hold points at rest against a pitch sweep taken earlier.

    The points are taken without flow or shaker, at the start and end of a run or days later, at
    several angles if possible. Angle and intercept together say whether the camera, the lamp, the
    model or the onboard sensor has moved; with --strict the exit code is 3 if anything has.

    \b
    Example: glint-aoa calibrate check check-*.h5 --setup glint-aoa.toml --sweep sweep.toml
    """
    from glint_aoa.campaign import check_sweep
    from glint_aoa.report.figures import check_picture_name, save_figure
    from glint_aoa.report.sweep_figures import drift_figure
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    calibration = _load(sweep, settings, setup)
    check_names(points)
    if png is not None:
        check_picture_name(png)
        check_folder(png.parent)
        check_new_files((png,), overwrite=overwrite)
    with bar(len(points)) as advance:
        drift = check_sweep(
            points, calibration, settings, progress=lambda path: advance(1, path.stem)
        )
    if png is not None:
        save_figure(drift_figure(drift), png, overwrite=overwrite)
    if as_json:
        print_json(_as_json(drift))
    else:
        _print(drift)
    if strict and drift.has_drifted:
        raise typer.Exit(3)


def _load(path: Path | None, settings: "Setup", setup: Path) -> "PitchSweep":
    from calibration.sweep.fit import PitchSweep
    from glint_aoa.errors import SetupError

    path = path or settings.sweep_path
    if path is None:
        raise SetupError(
            f"{setup}: no calibration.sweep to check; name one there, or give it with --sweep"
        )
    sweep = PitchSweep.load(path)
    sweep.check_setup(settings, source=path)
    return sweep


def _print(drift: "Drift") -> None:
    header = ["point", "hours later", "onboard [deg]", "optical - onboard [deg]", "intercept [mm]"]
    rows = [
        [
            each.point.name,
            "-" if each.hours is None else f"{each.hours:.1f}",
            f"{each.point.onboard_deg:.4f}",
            _with_std(each.angle_deg, each.angle_std_deg, ".4f"),
            "-"
            if each.intercept_mm is None or each.intercept_std_mm is None
            else _with_std(each.intercept_mm, each.intercept_std_mm, ".3f"),
        ]
        for each in drift.points
    ]
    table(header, rows)
    typer.echo("\noptical: calibrated; intercept: less the sweep's; +/- is 1 sigma\n")
    table(
        ["change", "", ""],
        [
            [each.name, f"{each.value:+.5f} +/- {each.std:.5f}", each.unit]
            for each in drift.signatures
        ],
        left=3,
    )
    typer.echo("")
    likely = [each for each in drift.hypotheses if each.probability >= _WORTH_PRINTING]
    table(
        ["what may have happened", "by", "probability", "chi-square", "of"],
        [
            [
                each.name,
                "; ".join(map(str, each.changes)),
                f"{each.probability:.2f}",
                f"{each.chi_square:.1f}",
                f"{each.degrees_of_freedom}",
            ]
            for each in likely
        ],
        left=2,
    )
    typer.echo(f"\n{drift.sentence}.")


def _with_std(value: float, std: float, spec: str) -> str:
    return f"{number(value, '+' + spec)} +/- {number(std, spec)}"


def _as_json(drift: "Drift") -> dict[str, object]:
    return {
        "verdict": drift.verdict,
        "sentence": drift.sentence,
        "has_drifted": drift.has_drifted,
        "angle_holds": drift.angle_holds,
        "signatures": [_change(each) for each in drift.signatures],
        "hypotheses": [_hypothesis(each) for each in drift.hypotheses],
        "points": [
            {
                "name": each.point.name,
                "hours": each.hours,
                "onboard_deg": each.point.onboard_deg,
                "angle_deg": each.angle_deg,
                "angle_std_deg": each.angle_std_deg,
                "intercept_mm": each.intercept_mm,
                "intercept_std_mm": each.intercept_std_mm,
            }
            for each in drift.points
        ],
    }


def _change(change: "Change") -> dict[str, object]:
    return {
        "name": change.name,
        "value": change.value,
        "std": change.std,
        "unit": change.unit,
    }


def _hypothesis(hypothesis: "Hypothesis") -> dict[str, object]:
    return {
        "name": hypothesis.name,
        "cause": hypothesis.cause,
        "probability": hypothesis.probability,
        "chi_square": hypothesis.chi_square,
        "degrees_of_freedom": hypothesis.degrees_of_freedom,
        "changes": [_change(each) for each in hypothesis.changes],
    }
