"""``glint-aoa plan``: what a test will measure, before it is run."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glint_aoa.cli._common import (
    Json,
    Overwrite,
    bar,
    check_folder,
    check_new_files,
    print_json,
)

if TYPE_CHECKING:
    from glint_aoa.plan import TestPlan

__all__ = ["plan"]

_MAPPED = ("plan-map.csv", "plan-map.png")
_FILES = ("plan-angles.csv", "plan-glint.png")


def plan(
    setup: Annotated[Path, typer.Argument(metavar="SETUP", help="Setup file.", show_default=False)],
    no_map: Annotated[
        bool, typer.Option("--no-map", help="Predict the present setup alone; look for no better.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="Folder for plan-angles.csv, plan-map.csv, plan-map.png and plan-glint.png.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Predict what a test will measure, and suggest a better place.

    From body and lamp in [glint.reflection] and from [plan]: where the glint will fall, over what
    range of angle it is seen, and how uncertain the angle of a field and of a point will be. A map
    over camera distance, lens and place of the lamp shows where it would be least so.

    \b
    Example: glint-aoa plan glint-aoa.toml --out plan
    """
    from glint_aoa.plan import make_plan, map_size
    from glint_aoa.report.plan_tables import format_plan, plan_values
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    files = [] if out is None else [out / n for n in _FILES + (() if no_map else _MAPPED)]
    if out is not None:
        check_folder(out)
    check_new_files(files, overwrite=overwrite)
    with bar(0 if no_map else map_size(settings)) as advance:
        planned = make_plan(settings, with_map=not no_map, progress=advance)
    if out is not None:
        _write(out, planned, overwrite=overwrite)
    if as_json:
        print_json({"files": files, **plan_values(planned)})
        return
    typer.echo(format_plan(planned))
    if files:
        typer.echo(f"Wrote {', '.join(str(path) for path in files)}")


def _write(out: Path, planned: "TestPlan", *, overwrite: bool) -> None:
    from glint_aoa.records._files import make_folder
    from glint_aoa.records.tables import write_csv
    from glint_aoa.report.figures import save_figure
    from glint_aoa.report.plan_figures import glint_figure, map_figure
    from glint_aoa.report.plan_tables import angle_columns, map_columns

    make_folder(out)
    write_csv(out / "plan-angles.csv", angle_columns(planned), overwrite=overwrite)
    save_figure(glint_figure(planned), out / "plan-glint.png", overwrite=overwrite)
    if planned.layouts is not None:
        write_csv(out / "plan-map.csv", map_columns(planned.layouts), overwrite=overwrite)
        save_figure(map_figure(planned), out / "plan-map.png", overwrite=overwrite)
