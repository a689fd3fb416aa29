"""``glint-aoa fuse``: video and inertial channels in one attitude."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._common import (
    Json,
    Out,
    Overwrite,
    Points,
    SetupFile,
    Strict,
    bar,
    check_folder,
    check_names,
    check_new_files,
    print_json,
    table,
    tell_flags,
)

if TYPE_CHECKING:
    from glint_aoa.fusion import Assumed, FusedAttitude, OpticalAngles
    from glint_aoa.setup import Setup

__all__ = ["fuse"]


def fuse(
    points: Points,
    out: Out,
    setup: SetupFile = Path("glint-aoa.toml"),
    gain_std: Annotated[
        float,
        typer.Option(metavar="PERCENT", help="Uncertainty, 1 sigma, of accelerometer gains."),
    ] = 1.0,
    misalignment_std: Annotated[
        float,
        typer.Option(
            metavar="DEG", help="Uncertainty, 1 sigma, of the directions accelerometers sense in."
        ),
    ] = 0.5,
    package_std: Annotated[
        float,
        typer.Option(
            metavar="DEG", help="Uncertainty, 1 sigma, of the onboard package's static angle."
        ),
    ] = 0.01,
    overwrite: Overwrite = False,
    strict: Strict = False,
    as_json: Json = False,
) -> None:
    """Fuse video and inertial channels: attitude at every sample.

    Each point needs the package's output and accelerometers along z, better in both planes and at
    two stations; its fields are measured as by process. A point without fields, or with fog for a
    while, is carried by the inertial channels, and the uncertainty grows. Effective radii of the
    modes come out besides.

    Writes <point>-fused.csv and .nc: time_s, pitch_deg, pitch_std_deg, yaw_deg, yaw_std_deg,
    pitch_yaw_covariance_deg2, flags.

    \b
    Example: glint-aoa fuse point-01.h5 --setup glint-aoa.toml --out fused
    """
    from glint_aoa.errors import InputError
    from glint_aoa.fusion import Assumed, fused_files
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    check_names(points)
    check_folder(out)
    for option, value in (
        ("--gain-std", gain_std),
        ("--misalignment-std", misalignment_std),
        ("--package-std", package_std),
    ):
        if not 0 < value < math.inf:
            raise InputError(f"{option} is {value:g}; give an uncertainty above zero")
    assumed = Assumed(gain_std / 100, math.radians(misalignment_std), package_std)
    check_new_files(
        (file for path in points for file in fused_files(out, path.stem)), overwrite=overwrite
    )
    fused: dict[Path, FusedAttitude] = {}
    failures: list[InputError] = []
    with bar(len(points)) as advance:
        for path in points:
            advance(0, path.stem)
            try:
                fused[path] = _fuse_one(path, settings, out, assumed, overwrite=overwrite)
            except InputError as error:
                failures.append(error)
            advance(1)
    summaries = [_summary(path, out, each) for path, each in fused.items()]
    if as_json:
        print_json(summaries)
    elif summaries:
        _print(summaries, out)
        for path, each in fused.items():
            tell_flags(path.stem, _mask(each), each.flags, "samples")
    for failure in failures:
        typer.echo(f"glint-aoa: {failure}", err=True)
    if failures:
        raise typer.Exit(2)
    if strict and any(_mask(each) for each in fused.values()):
        raise typer.Exit(3)


def _fuse_one(
    path: Path, settings: "Setup", out: Path, assumed: "Assumed", *, overwrite: bool
) -> "FusedAttitude":
    from glint_aoa.errors import RecordingError
    from glint_aoa.fusion import fuse as fuse_point
    from glint_aoa.fusion import write_fused
    from glint_aoa.records.conditioning import prepared
    from glint_aoa.records.formats import channels_beside, open_acquisition

    beside = channels_beside(path) if path.exists() else path
    if beside is None:
        raise RecordingError(
            f"{path}: no acquisition channels in it or beside it; fuse needs the onboard package's "
            "output and accelerometers on the same trigger"
        )
    record = prepared(open_acquisition(beside, settings.inertial))
    found = fuse_point(record, _optical(path, settings), settings, assumed=assumed)
    write_fused(out, path.stem, found, overwrite=overwrite)
    return found


def _optical(path: Path, settings: "Setup") -> "OpticalAngles | None":
    """Measure the fields of a point; None for an HDF5 point without any."""
    from glint_aoa.fusion import OpticalAngles
    from glint_aoa.process import load_sweep, measure_point
    from glint_aoa.records.formats import HDF5_SUFFIXES, open_fields
    from glint_aoa.records.formats.hdf5 import has_fields

    if path.suffix.lower() in HDF5_SUFFIXES and not has_fields(path):
        return None
    sweep = load_sweep(settings)
    result = measure_point(open_fields(path, settings.fields), settings, sweep=sweep)
    return OpticalAngles.of_fields(
        result.values, exposure_s=float(result.attrs["exposure_s"]), is_swept=sweep is not None
    )


def _mask(fused: "FusedAttitude") -> int:
    import numpy as np

    return int(np.bitwise_or.reduce(fused.flags))


def _summary(path: Path, out: Path, fused: "FusedAttitude") -> dict[str, Any]:
    from glint_aoa.fusion import fused_files

    return {
        "point": path.stem,
        "file": fused_files(out, path.stem)[0],
        "samples": fused.time_s.size,
        "fields_used": fused.settings["fields_used"],
        "mean_pitch_deg": fused.pitch_deg.mean(),
        "mean_pitch_std_deg": fused.pitch_std_deg.mean(),
        "largest_pitch_std_deg": fused.pitch_std_deg.max(),
        "modes": [vars(mode) for mode in fused.modes],
        "consistency": fused.consistency,
        "notes": fused.notes,
        "flags": _mask(fused),
    }


def _print(summaries: list[dict[str, Any]], out: Path) -> None:
    header = ["point", "fields", "mean pitch [deg]", "std [deg]", "largest std [deg]"]
    keys = ("mean_pitch_std_deg", "largest_pitch_std_deg")
    table(
        header,
        [
            [
                each["point"],
                str(each["fields_used"]),
                f"{each['mean_pitch_deg']:+.4f}",
                *(f"{each[key]:.4f}" for key in keys),
            ]
            for each in summaries
        ],
    )
    modes = [
        [
            each["point"],
            mode["plane"],
            "-" if mode["number"] is None else str(mode["number"]),
            f"{mode['frequency_hz']:.2f}",
            f"{1e3 * mode['radius_m']:+.1f}",
            f"{1e3 * mode['radius_std_m']:.1f}",
        ]
        for each in summaries
        for mode in each["modes"]
    ]
    if modes:
        typer.echo("")
        table(["point", "plane", "mode", "at [Hz]", "radius [mm]", "std [mm]"], modes, left=2)
    typer.echo("\nfields: used; std: of the instantaneous pitch, 1 sigma")
    typer.echo(f"Wrote {out / '<point>-fused.csv'} and .nc")
    for each in summaries:
        for note in each["notes"]:
            typer.echo(f"{each['point']}: {note}", err=True)
