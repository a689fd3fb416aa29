"""``glint-aoa demo``: the whole product on a simulated test."""

import os
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import typer

from glint_aoa.cli._common import bar, check_folder, check_new_files
from glint_aoa.cli.simulate import RendererChoice, RendererOption

__all__ = ["demo"]


def demo(
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="FOLDER", help="Folder for all that it writes."),
    ] = Path("glint-aoa-demo"),
    renderer: RendererOption = RendererChoice.AUTO,
    seed: Annotated[
        int, typer.Option(min=0, metavar="N", help="The same seed gives the same test.")
    ] = 0,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Processes that share the points; one a processor if not given.",
            show_default=False,
        ),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace what an earlier demo wrote.")
    ] = False,
) -> None:
    """Show the whole product on a simulated test, in two minutes.

    A wind-off vibration test is simulated and recorded, the optical angle calibrated with a pitch
    sweep, each point processed, the inertial angle corrected, and both compared as in Table 4.

    \b
    Example: glint-aoa demo --out glint-aoa-demo
    """
    from glint_aoa.campaign import calibrate_sweep
    from glint_aoa.cli.benchmark import check_benchmark, run_benchmark, tell_flagged
    from glint_aoa.report.figures import save_figure
    from glint_aoa.report.sweep_figures import sweep_figure
    from glint_aoa.setup import load_setup

    points, setup_file = out / "points", out / "glint-aoa.toml"
    check_folder(out)
    files_beside = ("sweep.toml", "sweep.png", "field.png")
    check_new_files((setup_file, *(out / name for name in files_beside)), overwrite=overwrite)
    check_benchmark(out / "results", overwrite=overwrite)
    jobs = jobs or os.cpu_count() or 1
    paths = _simulate(points, renderer, seed, jobs, overwrite)
    sweep = [path for path in paths if path.stem.startswith("sweep")]
    runs = [path for path in paths if path not in sweep]

    typer.echo("2. Calibrating with the no-flow pitch sweep against the onboard sensor")
    setup_file.write_bytes((files("glint_aoa") / "data" / "paper-test.toml").read_bytes())
    setup = load_setup(setup_file)
    with bar(len(sweep)) as advance:
        fitted = calibrate_sweep(
            sweep, setup, jobs=jobs, progress=lambda path: advance(1, path.stem)
        )
    fitted.save(out / "sweep.toml", overwrite=overwrite)
    save_figure(sweep_figure(fitted), out / "sweep.png", overwrite=overwrite)

    typer.echo(f"3. Processing, correcting and comparing {len(runs)} points\n")
    summary = run_benchmark(runs, setup, out / "results", jobs=jobs, overwrite=overwrite)
    typer.echo(summary["text"])
    tell_flagged(summary["compared"])
    picture = _picture(runs, setup, out / "field.png", overwrite)
    written = {
        "recorded points (HDF5)": points,
        "setup": setup_file,
        "calibration": f"{out / 'sweep.toml'}, {out / 'sweep.png'}",
        "results of each point": f"{out / 'results'}/<point>.csv, <point>.nc, log.csv",
        "Table 4": out / "results" / "table4.csv",
        "errors against moment": out / "results" / "errors-against-moment.png",
        "a field with its line": picture,
    }
    typer.echo("\nWrote")
    for what, where in written.items():
        typer.echo(f"  {what + ':':25}{where}")


def _simulate(
    points: Path, renderer: RendererChoice, seed: int, jobs: int, overwrite: bool
) -> list[Path]:
    from render_sim.campaign import load_campaign, simulate_campaign
    from render_sim.renderer import opengl_missing

    campaign = load_campaign("demo")
    check_new_files((points / f"{each.name}.h5" for each in campaign.points), overwrite=overwrite)
    typer.echo(
        f"1. Simulating {len(campaign.points)} points of {campaign.n_fields} fields each, "
        "with the acquisition's channels"
    )
    lacks = opengl_missing()
    if lacks is not None:
        typer.echo(f"   With the built-in renderer: {lacks}.")
    with bar(len(campaign.points)) as advance:
        paths = []
        for path in simulate_campaign(
            campaign, points, renderer=renderer.value, seed=seed, jobs=jobs, overwrite=overwrite
        ):
            paths.append(path)
            advance(1, path.stem)
    return paths


def _picture(runs: list[Path], settings: Any, target: Path, overwrite: bool) -> Path:
    """Draw a field of the point that shook most at the steepest angle."""
    from glint_aoa.process import load_sweep, measure_point
    from glint_aoa.records.formats import open_fields
    from glint_aoa.report.figures import measured_field, save_figure

    def angle_and_moment(path: Path) -> tuple[float, ...]:
        meta = open_fields(path).meta
        return tuple(float(str(meta[f"nominal_{key}"])) for key in ("angle_deg", "moment_in_lb"))

    stack = open_fields(max(runs, key=angle_and_moment))
    result = measure_point(stack, settings, sweep=load_sweep(settings))
    save_figure(measured_field(stack, result, 0), target, overwrite=overwrite)
    return target
