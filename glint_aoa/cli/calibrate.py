"""``glint-aoa calibrate``: what turns a camera and a tunnel into a setup that can be trusted."""

import os
from pathlib import Path
from typing import Annotated

import typer

from glint_aoa.cli._common import (
    Json,
    Overwrite,
    Points,
    SetupFile,
    bar,
    check_folder,
    check_names,
    check_new_files,
    print_json,
    table,
)

__all__ = ["app"]

_SUSPICIOUS = 3.0  # reduced chi-square at which the user should look at the residuals

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.callback()
def _calibrations() -> None:
    """Calibrate the optical angle.

    \b
    Example: glint-aoa calibrate sweep sweep-*.h5 --setup glint-aoa.toml --out sweep.toml
    """


@app.command("sweep", no_args_is_help=True)
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
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Fit the onboard angle to the optical one over a pitch sweep.

    The sweep is taken without flow, the model at rest at 3 angles or more. Name the written file
    in the setup to apply it: [calibration] sweep = "sweep.toml". A picture of the residuals is
    written beside it.

    \b
    Example: glint-aoa calibrate sweep sweep-*.h5 --setup glint-aoa.toml --out sweep.toml
    """
    from glint_aoa.campaign import calibrate_sweep
    from glint_aoa.records._files import make_folder
    from glint_aoa.report.figures import save_figure, sweep_figure
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    check_names(points)
    picture = out.with_suffix(".png")
    _check_out(out, setup)
    check_new_files((out, picture), overwrite=overwrite)
    with bar(len(points)) as advance:
        fitted = calibrate_sweep(
            points,
            settings,
            degree=degree,
            onboard_accuracy_deg=accuracy,
            progress=lambda path: advance(1, path.stem),
        )
    make_folder(out.parent)
    fitted.save(out, overwrite=overwrite)
    save_figure(sweep_figure(fitted), picture, overwrite=overwrite)
    if as_json:
        print_json(
            {
                "file": out,
                "picture": picture,
                "degree": fitted.degree,
                "range_deg": fitted.range_deg,
                "residuals_deg": fitted.residuals_deg.tolist(),
                "reduced_chi_square": fitted.reduced_chi_square,
            }
        )
        return
    rows = [
        [path.stem, f"{optical:.4f}", f"{onboard:.4f}", f"{residual:+.4f}"]
        for path, optical, onboard, residual in zip(
            points, fitted.optical_deg, fitted.onboard_deg, fitted.residuals_deg, strict=True
        )
    ]
    table(["point", "optical [deg]", "onboard [deg]", "residual [deg]"], rows)
    ratio = fitted.reduced_chi_square
    typer.echo(f"\nDegree {fitted.degree}, wrote {out} and {picture}")
    if settings.calibration.sweep is None:
        from_setup = os.path.relpath(out, setup.parent)
        typer.echo(f'To apply it, add to {setup}:\n\n[calibration]\nsweep = "{from_setup}"')
    if ratio is not None and ratio > _SUSPICIOUS:
        typer.echo(
            f"The residuals are {ratio**0.5:.1f} times what the points' noise explains; "
            f"look at {picture}",
            err=True,
        )


def _check_out(out: Path, setup: Path) -> None:
    """Refuse a name that the calibration cannot have, before the points are measured."""
    from glint_aoa.errors import OutputError

    if out.suffix.lower() != ".toml":
        raise OutputError(f"{out}: a calibration is a TOML file; end its name with .toml")
    if out.resolve() == setup.resolve():
        raise OutputError(f"{out} is the setup itself; give the calibration another name")
    check_folder(out.parent)
