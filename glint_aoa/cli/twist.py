"""``glint-aoa twist``: how far each station of a wing turned between no flow and flow."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glint_aoa.cli._common import (
    Json,
    Out,
    Overwrite,
    Polarity,
    Scan,
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
    import numpy as np
    from numpy.typing import NDArray

    from calibration.twist.measure import StationTwist, WingTwist
    from calibration.twist.sighting import Sightings
    from calibration.twist.wing_targets import WingTargets
    from glint_aoa.setup import Setup

__all__ = ["twist"]

_FLAGGED = 3
_FORMATS = {"scale": ".6f", "y_mm": ".6g"}


def twist(
    no_flow: Annotated[
        Path,
        typer.Argument(
            metavar="NOFLOW", help="Image or recording without flow.", show_default=False
        ),
    ],
    flow: Annotated[
        list[Path],
        typer.Argument(metavar="FLOW", help="Images or recordings with flow.", show_default=False),
    ],
    targets: Annotated[
        Path,
        typer.Option(
            "--targets",
            "-t",
            metavar="FILE",
            help="Targets, CSV: id, y with unit, and u, v [pixels] or x, z without flow; "
            "optional station, radius.",
            show_default=False,
        ),
    ],
    setup: SetupFile = Path("glint-aoa.toml"),
    out: Out = Path("twist"),
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="STATION",
            help="Station on the body, whose rotation is taken from the others'.",
            show_default=False,
        ),
    ] = None,
    polarity: Annotated[
        Polarity, typer.Option(help="Targets brighter or darker than the wing.")
    ] = Polarity.bright,
    scan: Annotated[
        Scan, typer.Option(help="How images were scanned; a recording says it itself.")
    ] = Scan.progressive,
    min_diameter: Annotated[
        float, typer.Option(metavar="PIXELS", help="Least diameter of a target's image.")
    ] = 4.0,
    max_diameter: Annotated[
        float, typer.Option(metavar="PIXELS", help="Greatest diameter of a target's image.")
    ] = 60.0,
    free_scale: Annotated[
        bool, typer.Option("--free-scale", help="Fit the scale too; a wing keeps its size.")
    ] = False,
    allow_missing: Annotated[
        bool, typer.Option("--allow-missing", help="Go on without targets that are not found.")
    ] = False,
    strict: Strict = False,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Measure wing twist from targets in planes of known Y.

    The targets are circular. One picture or recording without flow is held against each one with
    flow; the fields of a recording are measured one by one and averaged. Writes twist.csv,
    twist-targets.csv and twist.png. Leading edge up is positive; 95 % intervals.

    \b
    Example: glint-aoa twist wind-off.h5 wind-on.h5 --targets targets.csv --reference body
    """
    from calibration.twist.measure import measure_twist
    from calibration.twist.wing_targets import read_wing_targets
    from glint_aoa.records._files import make_folder
    from glint_aoa.records.tables import write_csv
    from glint_aoa.report.figures import save_figure
    from glint_aoa.report.twist_figures import twist_figure
    from glint_aoa.report.twist_tables import station_columns, target_columns, twist_values
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    check_names(flow)
    files = [out / "twist.csv", out / "twist-targets.csv", out / "twist.png"]
    check_folder(out)
    check_new_files(files, overwrite=overwrite)
    wing = read_wing_targets(targets, settings)
    if reference is not None:
        wing.at(reference)
    diameters = min_diameter, max_diameter
    with bar(1 + len(flow)) as advance:

        def sighted(path: Path, start: "NDArray[np.float64] | None" = None) -> "Sightings":
            return _sighted(path, wing, settings, start, polarity, scan, diameters, advance)

        still = sighted(no_flow)
        results = [
            measure_twist(
                wing,
                still,
                sighted(path, still.mean()[0]),
                settings,
                reference=reference,
                free_scale=free_scale,
                allow_missing=allow_missing,
            )
            for path in flow
        ]
    make_folder(out)
    write_csv(files[0], station_columns(results), formats=_FORMATS, overwrite=overwrite)
    write_csv(files[1], target_columns(results), overwrite=overwrite)
    save_figure(twist_figure(results), files[2], overwrite=overwrite)
    doubts = [doubt for result in results for doubt in _doubts(result)]
    for doubt in doubts:
        typer.echo(doubt, err=True)
    if as_json:
        print_json({"files": files, "results": twist_values(results)})
    else:
        _print(results, reference)
        typer.echo(f"\nWrote {', '.join(map(str, files))}")
    if strict and doubts:
        raise typer.Exit(_FLAGGED)


def _sighted(
    path: Path,
    wing: "WingTargets",
    settings: "Setup",
    start: "NDArray[np.float64] | None",
    polarity: Polarity,
    scan: Scan,
    diameters: tuple[float, float],
    advance: Callable[..., None],
) -> "Sightings":
    """Measure the targets of one file, each field of a recording by itself."""
    from calibration.photographs import photographs
    from calibration.twist.sighting import sight_targets

    pictures = photographs(
        [path],
        scan=scan.value,
        every=1,
        fields=settings.fields,
        sensor=settings.camera.sensor,
    )
    found = sight_targets(
        pictures,
        wing,
        settings.camera,
        name=path.stem,
        start=start,
        polarity=polarity.value,
        diameters=diameters,
        progress=lambda name: advance(0, name),
    )
    advance(1)
    return found


def _print(results: "list[WingTwist]", reference: str | None) -> None:
    held = [] if reference is None else [f"less {reference}'s", "95 %"]
    header = ["flow", "station", "y [mm]", "twist [deg]", "95 %", *held, "Z [mm]", "targets"]
    table(
        header,
        [_row(result.name, one) for result in results for one in result.stations],
        left=2,
    )


def _row(name: str, one: "StationTwist") -> list[str]:
    relative = []
    if one.relative_deg is not None and one.relative_u95_deg is not None:
        relative = [f"{one.relative_deg:+.4f}", f"{one.relative_u95_deg:.4f}"]
    return [
        name,
        one.station,
        number(1e3 * one.y_m, ".1f"),
        f"{one.twist_deg:+.4f}",
        f"{one.twist_u95_deg:.4f}",
        *relative,
        f"{1e3 * one.shift_z_m:+.3f}",
        str(len(one.used)),
    ]


def _doubts(result: "WingTwist") -> list[str]:
    """Return what the user should look at."""
    doubts = []
    if result.clipped:
        doubts.append(
            f"{result.name}: pixels of {', '.join(result.clipped)} clip; less light or a shorter "
            "exposure gives a better centroid"
        )
    for one in result.stations:
        if one.missing:
            doubts.append(
                f"{result.name}: station {one.station}: {', '.join(one.missing)} not found"
            )
        if one.outlying:
            doubts.append(
                f"{result.name}: station {one.station}: {', '.join(one.outlying)} did not move "
                "with the others and was left out"
            )
        if one.excess > 1:
            doubts.append(
                f"{result.name}: station {one.station}: the residuals are {one.excess**0.5:.1f} "
                "times what the noise of the centroids explains, and so is the interval; see "
                "twist-targets.csv"
            )
    return doubts
