"""``glint-aoa calibrate sweep``: the onboard angle as a polynomial of the optical one."""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glint_aoa.cli._common import (
    Jobs,
    Json,
    Overwrite,
    Points,
    SetupFile,
    bar,
    check_calibration_file,
    check_names,
    check_new_files,
    number,
    print_json,
    table,
)

if TYPE_CHECKING:
    from calibration.sweep.fit import Hysteresis, PitchSweep, SweepCurve

__all__ = ["sweep"]

_SUSPICIOUS = 3.0  # reduced chi-square at which the user should look at the residuals


def sweep(
    points: Points,
    setup: SetupFile = Path("glint-aoa.toml"),
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="FILE", help="Calibration file to write (TOML)."),
    ] = Path("sweep.toml"),
    degree: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Degree of the polynomial; chosen from the points if not given.",
            show_default=False,
        ),
    ] = None,
    accuracy: Annotated[
        float,
        typer.Option(
            min=0.0,
            metavar="DEG",
            help="Static accuracy of the onboard sensor, an error that all points share, 1 sigma.",
        ),
    ] = 0.0,
    jobs: Jobs = 1,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Fit the onboard angle to the optical one over a pitch sweep.

    The sweep is taken without flow, the model at rest at 3 angles or more, up and down if there is
    time; once for each tunnel temperature, all given together. Name the written file in the setup
    to apply it: [calibration] sweep = "sweep.toml". A picture of the residuals is written beside
    it.

    \b
    Example: glint-aoa calibrate sweep sweep-*.h5 --setup glint-aoa.toml --out sweep.toml
    """
    from glint_aoa.campaign import calibrate_sweep
    from glint_aoa.records._files import make_folder
    from glint_aoa.report.figures import save_figure
    from glint_aoa.report.sweep_figures import sweep_figure
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    check_names(points)
    picture = out.with_suffix(".png")
    check_calibration_file(out, setup)
    check_new_files((out, picture), overwrite=overwrite)
    with bar(len(points)) as advance:
        fitted = calibrate_sweep(
            points,
            settings,
            degree=degree,
            onboard_accuracy_deg=accuracy,
            jobs=jobs,
            progress=lambda path: advance(1, path.stem),
        )
    make_folder(out.parent)
    fitted.save(out, overwrite=overwrite)
    save_figure(sweep_figure(fitted), picture, overwrite=overwrite)
    _tell_doubts(fitted, picture)
    if as_json:
        print_json(_as_json(fitted, out, picture))
        return
    _print(fitted)
    typer.echo(f"\nDegree {fitted.degree}, wrote {out} and {picture}")
    if settings.calibration.sweep is None:
        from_setup = os.path.relpath(out, setup.parent)
        typer.echo(f'To apply it, add to {setup}:\n\n[calibration]\nsweep = "{from_setup}"')


def _as_json(fitted: "PitchSweep", out: Path, picture: Path) -> dict[str, object]:
    return {
        "file": out,
        "picture": picture,
        "degree": fitted.degree,
        "temperatures_K": fitted.temperatures_k.tolist(),
        "range_deg": fitted.range_deg,
        "residuals_deg": fitted.residuals_deg.tolist(),
        "calibration_u95_deg": [fitted.expanded_deg(point)[0] for point in fitted.points],
        "prediction_u95_deg": [fitted.expanded_deg(point)[1] for point in fitted.points],
        "reduced_chi_square": fitted.reduced_chi_square,
        "left_out": {point.name: why for point, why in fitted.left_out.items()},
        "hysteresis": [
            None
            if loop is None
            else {
                "width_deg": loop.width_deg,
                "std_deg": loop.std_deg,
                "u95_deg": loop.u95_deg,
                "is_significant": loop.is_significant,
            }
            for loop in (curve.hysteresis for curve in fitted.curves)
        ],
    }


def _print(fitted: "PitchSweep") -> None:
    points = [*fitted.points, *fitted.left_out]
    warm = any(point.temperature_k is not None for point in points)
    header = ["point", *(["tunnel [K]"] if warm else [])]
    header += ["optical [deg]", "onboard [deg]", "residual [deg]", ""]
    rows = [
        [
            point.name,
            *([number(point.temperature_k or math.nan, ".1f")] if warm else []),
            f"{point.optical_deg:.4f}",
            f"{point.onboard_deg:.4f}",
            f"{fitted.residual_deg(point):+.4f}",
            "left out" if point in fitted.left_out else "",
        ]
        for point in points
    ]
    table(header, rows)
    own, another = map(_span, zip(*map(fitted.expanded_deg, fitted.points), strict=True))
    typer.echo(
        f"\n95 % over the sweep's angles: calibration within {own} deg, another point like these "
        f"within {another}"
    )
    for curve in fitted.curves:
        if curve.hysteresis is not None:
            typer.echo(f"Hysteresis{_at(curve)}: down less up {_width(curve.hysteresis)}")


def _span(values: Sequence[float]) -> str:
    low, high = f"{min(values):.4f}", f"{max(values):.4f}"
    return low if low == high else f"{low} to {high}"


def _tell_doubts(fitted: "PitchSweep", picture: Path) -> None:
    """Say on stderr what of the sweep needs looking at."""
    for point, reason in fitted.left_out.items():
        typer.echo(f"{point.name} left out: {reason}", err=True)
    for point in (*fitted.points, *fitted.left_out):
        if point.onboard_note:
            typer.echo(f"{point.name}: {point.onboard_note}", err=True)
    for curve in fitted.curves:
        loop = curve.hysteresis
        if loop is not None and loop.is_significant:
            typer.echo(
                f"Significant hysteresis{_at(curve)}: down less up {_width(loop)}; half of it is "
                "in the calibration's uncertainty",
                err=True,
            )
    ratio = fitted.reduced_chi_square
    if ratio is not None and ratio > _SUSPICIOUS:
        typer.echo(
            f"The residuals are {ratio**0.5:.1f} times what the points' noise explains; "
            f"look at {picture}",
            err=True,
        )


def _at(curve: "SweepCurve") -> str:
    return "" if curve.temperature_k is None else f" at {curve.temperature_k:.1f} K"


def _width(loop: "Hysteresis") -> str:
    return f"{loop.width_deg:+.4f} deg, 95 % within {loop.u95_deg:.4f}"
