"""``glint-aoa uncertainty``: what a setup leaves uncertain of the angle, and why."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glint_aoa.cli._common import Json, Overwrite, bar, check_folder, check_new_files, print_json

if TYPE_CHECKING:
    from calibration.budget.uncertainty import UncertaintyBudget

__all__ = ["uncertainty"]

_NAME = "uncertainty"
_SUFFIXES = (".json", ".csv", ".png", ".pdf", ".svg")


def uncertainty(
    setup: Annotated[Path, typer.Argument(metavar="SETUP", help="Setup file.", show_default=False)],
    angles: Annotated[
        str, typer.Option(metavar="DEG,DEG...", help="Angles after calibration.")
    ] = "-6,0,6",
    intercepts: Annotated[
        str | None,
        typer.Option(
            metavar="MM,MM...",
            help="Z of the glint at X = 0; at 1/4, 1/2 and 3/4 of the picture if not given.",
            show_default=False,
        ),
    ] = None,
    noise: Annotated[
        float,
        typer.Option(
            min=0.0, metavar="LINES", help="Noise of one column's centre in one field, 1 sigma."
        ),
    ] = 0.01,
    fields: Annotated[int, typer.Option(min=1, metavar="N", help="Fields averaged.")] = 60,
    temperature: Annotated[
        float | None,
        typer.Option(
            metavar="KELVIN", help="Tunnel temperature, for a sweep at several.", show_default=False
        ),
    ] = None,
    draws: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Draws of the Monte Carlo; 10000 if not given, 4000 with a reflection.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Seed of the draws.")] = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER|FILE",
            help="Folder for uncertainty.json, .csv and .png, or one file of such a name.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Tell how uncertain the angle is, and from what.

    What is uncertain is read from the setup: from the calibrations of camera and pose that it
    names, from its pitch sweep, and from [uncertainty] for what was taped. To first order (GUM)
    and by Monte Carlo (its Supplement 1) side by side. What a sweep takes out is not counted.

    \b
    Example: glint-aoa uncertainty glint-aoa.toml --angles -6,0,6 --out budget
    """
    from calibration.budget.uncertainty import uncertainty_budget
    from glint_aoa.process import load_sweep
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    asked = _numbers(angles, "--angles")
    places = None if intercepts is None else [z / 1e3 for z in _numbers(intercepts, "--intercepts")]
    files = _files(out)
    check_new_files(files, overwrite=overwrite)
    with bar(draws) as advance:
        budget = uncertainty_budget(
            settings,
            asked,
            intercepts_m=places,
            sweep=load_sweep(settings),
            temperature_k=temperature,
            centroid_std_lines=noise,
            fields=fields,
            draws=draws,
            seed=seed,
            progress=advance,
        )
    for path in files:
        _write(path, budget, overwrite=overwrite)
    if as_json:
        from glint_aoa.report.budget_tables import budget_values

        print_json({"files": files, **budget_values(budget)})
        return
    _print(budget, setup, files)


def _numbers(text: str, option: str) -> list[float]:
    from glint_aoa.errors import InputError

    try:
        return [float(each) for each in text.split(",")]
    except ValueError:
        raise InputError(
            f"{option} is {text!r}; give numbers with commas between, such as {option}=-6,0,6"
        ) from None


def _files(out: Path | None) -> list[Path]:
    from glint_aoa.errors import OutputError

    if out is None:
        return []
    suffix = out.suffix.lower()
    if suffix in _SUFFIXES and not out.is_dir():
        check_folder(out.parent)
        return [out]
    if suffix in {".toml", ".txt", ".xlsx", ".h5", ".nc"}:
        raise OutputError(
            f"{out}: not a kind of budget; end its name with {', '.join(_SUFFIXES)}, "
            "or name a folder"
        )
    check_folder(out)
    return [out / f"{_NAME}{each}" for each in (".json", ".csv", ".png")]


def _write(path: Path, budget: "UncertaintyBudget", *, overwrite: bool) -> None:
    from glint_aoa.records._files import make_folder
    from glint_aoa.report.budget_tables import write_budget_csv, write_budget_json

    make_folder(path.parent)
    if path.suffix.lower() == ".json":
        write_budget_json(path, budget, overwrite=overwrite)
    elif path.suffix.lower() == ".csv":
        write_budget_csv(path, budget, overwrite=overwrite)
    else:
        from glint_aoa.report.budget_figures import budget_figure
        from glint_aoa.report.figures import save_figure

        save_figure(budget_figure(budget), path, overwrite=overwrite)


def _print(budget: "UncertaintyBudget", setup: Path, files: list[Path]) -> None:
    from glint_aoa.report.budget_tables import format_budget, format_exact, format_summary

    for each in budget.worst:
        typer.echo(format_budget(each, swept=budget.sweep_degree is not None) + "\n")
    typer.echo(format_summary(budget))
    if said := format_exact(budget):
        typer.echo(said)
    if not budget.is_stated:
        typer.echo(
            f"{setup} says nothing of how uncertain the camera is; add [uncertainty], or "
            "calibrations of camera and pose",
            err=True,
        )
    if files:
        typer.echo(f"Wrote {', '.join(str(path) for path in files)}")
