"""``glint-aoa calibrate``: what turns a camera and a tunnel into a setup that can be trusted."""

import typer

from glint_aoa.cli.calibrate_camera import camera
from glint_aoa.cli.calibrate_check import check
from glint_aoa.cli.calibrate_resect import resect
from glint_aoa.cli.calibrate_sweep import sweep

__all__ = ["app"]

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.command("camera", no_args_is_help=True)(camera)
app.command("resect", no_args_is_help=True)(resect)
app.command("sweep", no_args_is_help=True)(sweep)
app.command("check", no_args_is_help=True)(check)


@app.callback()
def _calibrations() -> None:
    """Calibrate camera, place and angle; see whether they drift.

    \b
    Example: glint-aoa calibrate sweep sweep-*.h5 --setup glint-aoa.toml --out sweep.toml
    """
