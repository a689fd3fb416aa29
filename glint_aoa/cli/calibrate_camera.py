"""``glint-aoa calibrate camera``: the camera's own parameters from pictures of a board."""

import math
import os
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._common import (
    Json,
    Overwrite,
    Scan,
    bar,
    check_calibration_file,
    check_new_files,
    number,
    print_json,
    table,
)
from glint_aoa.errors import InputError, OutputError

if TYPE_CHECKING:
    from calibration.camera.calibrate import CameraCalibration
    from glint_aoa.setup import Setup

__all__ = ["camera"]

_SUSPICIOUS = 2.0  # bootstrap over analytic uncertainty
_ENOUGH_SOURCES = 8  # files, for the bootstrap to mean anything
_ENOUGH_REACH = 0.7  # of the sensor


class _Distortion(StrEnum):
    auto = "auto"
    none = "0"
    k1 = "1"
    k2 = "2"
    p = "4"
    k3 = "5"


class _Hold(StrEnum):
    pixel_pitch_v = "pixel_pitch_v"
    principal_point = "principal_point"


def camera(
    images: Annotated[
        list[Path],
        typer.Argument(
            metavar="IMAGE",
            help="Pictures of the board, or recordings of it at rest.",
            show_default=False,
        ),
    ],
    board: Annotated[
        str,
        typer.Option(
            "--board",
            "-b",
            metavar="BOARD",
            help="Kind:columns x rows:spacing, as chessboard:9x6:30mm (inner corners), "
            "circles:7x6:36mm, asymmetric-circles:4x11:20mm (distance of rows), "
            "charuco:11x8:30mm:22mm:5x5_250 (squares, marker, dictionary).",
            show_default=False,
        ),
    ],
    setup: Annotated[
        Path | None,
        typer.Option(
            "--setup",
            "-s",
            metavar="FILE",
            help="Setup to take pixel pitch, sensor and window from.",
            show_default=False,
        ),
    ] = None,
    pixel_pitch: Annotated[
        tuple[str, str] | None,
        typer.Option(
            "--pixel-pitch",
            metavar="H V",
            help="Pixel pitch instead: horizontal, and vertical per line of a picture or field.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="FILE", help="Calibration file to write (TOML)."),
    ] = Path("camera.toml"),
    scan: Annotated[
        Scan,
        typer.Option("--scan", help="Pictures are frames, frames of two fields, or single fields."),
    ] = Scan.progressive,
    every: Annotated[
        int | None,
        typer.Option(
            "--every",
            min=1,
            metavar="N",
            help="Take every N-th field of a recording of a moving board; else they are averaged.",
            show_default=False,
        ),
    ] = None,
    distortion: Annotated[
        _Distortion,
        typer.Option(
            "--distortion",
            help="Number of coefficients, in the order k1, k2, p1, p2, k3; auto averages 4 and 5.",
        ),
    ] = _Distortion.auto,
    hold: Annotated[
        list[_Hold] | None,
        typer.Option("--hold", help="Hold as given; may be repeated.", show_default=False),
    ] = None,
    board_std: Annotated[
        str | None,
        typer.Option(
            "--board-std",
            metavar="LENGTH",
            help='How well the corners\' places on the board are known, 1 sigma; "0 mm" takes it '
            "as exact. A hundredth of the spacing if not given.",
            show_default=False,
        ),
    ] = None,
    draws: Annotated[
        int, typer.Option("--draws", min=0, metavar="N", help="Resamplings of the bootstrap.")
    ] = 200,
    seed: Annotated[
        int, typer.Option("--seed", min=0, metavar="N", help="Seed of the bootstrap.")
    ] = 0,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Calibrate lens and pixels from pictures of a board.

    Photograph the board 12 times or more: tilted by 20 to 40 degrees to all sides, turned in its
    plane by quarters, at the distance of the model and with the focus of the test, reaching into
    every corner of the picture. Name the written file in the setup to apply it: [calibration]
    camera = "camera.toml". A picture of the residuals is written beside it.

    \b
    Example: glint-aoa calibrate camera board-*.png --board chessboard:9x6:30mm -s glint-aoa.toml
    """
    from calibration.camera.boards import Board, BoardImage, find_board
    from calibration.camera.calibrate import Provenance, calibrate_camera
    from calibration.photographs import photographs
    from glint_aoa.records._files import make_folder
    from glint_aoa.report.camera_figures import camera_figure
    from glint_aoa.report.figures import save_figure
    from glint_aoa.setup import load_setup

    settings = None if setup is None else load_setup(setup)
    pitch = _pixel_pitch(pixel_pitch, settings, setup)
    printed = Board.parse(board)
    picture = out.with_suffix(".png")
    _check_out(out, picture, images, setup)
    check_new_files((out, picture), overwrite=overwrite)
    sensor = settings.camera.sensor if settings else None
    fields = settings.fields if settings else None
    found: list[BoardImage] = []
    with bar(None) as advance:
        for each in photographs(images, scan=scan.value, every=every, fields=fields, sensor=sensor):
            lines, columns = each.grey.shape
            sensor = sensor or (each.first_column + columns, each.first_line + lines)
            found.append(find_board(each, printed, aspect=pitch[1] / pitch[0]))
            advance(1, each.name)
    fitted = calibrate_camera(
        found,
        printed,
        sensor=sensor or (0, 0),
        pixel_pitch=pitch,
        distortion=None if distortion is _Distortion.auto else int(distortion.value),
        hold=[each.value for each in hold or ()],
        board_std=None if board_std is None else _length(board_std, "--board-std"),
        draws=draws,
        seed=seed,
        provenance=Provenance(
            files=tuple(str(path) for path in images),
            date=datetime.now(UTC).isoformat(timespec="seconds"),
        ),
    )
    make_folder(out.parent)
    fitted.save(out, overwrite=overwrite)
    save_figure(camera_figure(fitted), picture, overwrite=overwrite)
    if as_json:
        print_json(_as_json(fitted, out, picture))
    else:
        _tell(fitted)
        typer.echo(f"\nWrote {out} and {picture}")
        _advise_setup(settings, setup, out)
    _warn(fitted, picture)


def _pixel_pitch(
    given: tuple[str, str] | None, settings: "Setup | None", setup: Path | None
) -> tuple[float, float]:
    if given is not None:
        across, down = (_length(each, "--pixel-pitch") for each in given)
        return across, down
    if settings is None:
        raise InputError(
            "the pixel pitch is not known; give --pixel-pitch H V, or --setup with "
            "camera.pixel_pitch"
        )
    if settings.camera.pixel_pitch is None:
        raise InputError(f"{setup}: camera.pixel_pitch is missing; give it, or --pixel-pitch H V")
    return settings.camera.pixel_pitch


def _length(text: str, option: str) -> float:
    from glint_aoa.units import parse_quantity

    try:
        return parse_quantity(text, "m")
    except ValueError as error:
        raise InputError(f'{option}: {error}; give a length such as "11.7 um"') from None


def _check_out(out: Path, picture: Path, images: list[Path], setup: Path | None) -> None:
    """Refuse a name that the calibration cannot have, before the pictures are searched."""
    check_calibration_file(out, setup)
    if picture.resolve() in {path.resolve() for path in images}:
        raise OutputError(
            f"{picture}, the picture of the residuals, would replace a picture of the board; give "
            "another --out"
        )


_ROWS = {
    "focal_length_m": ("focal length", 1e3, "mm"),
    "pixel_pitch_v_m": ("vertical pixel pitch", 1e6, "um"),
    "principal_point_u": ("principal point u", 1.0, "columns"),
    "principal_point_v": ("principal point v", 1.0, "lines"),
}


def _tell(fitted: "CameraCalibration") -> None:
    """Print the parameters, the pictures left out, and how well the others fit."""
    bootstrap = fitted.bootstrap_std
    rows = []
    for k, name in enumerate(fitted.parameters):
        label, scale, unit = _ROWS.get(name, (name, 1.0, ""))
        numbers = [scale * fitted.values[k], scale * fitted.std[k]]
        numbers += [] if bootstrap is None else [scale * bootstrap[k]]
        decimals = max(0, 1 - math.floor(math.log10(numbers[1])))  # two figures of its std
        rows.append([label, unit, *[f"{each:.{decimals}f}" for each in numbers]])
    header = ["parameter", "", "value", "1 sigma"]
    table(header + ([] if bootstrap is None else ["bootstrap"]), rows, left=2)
    if fitted.hold:
        typer.echo(f"Held as given: {', '.join(fitted.hold)}")
    used = [image for image in fitted.images if image.used]
    typer.echo(
        f"\n{len(used)} of {len(fitted.images)} pictures used, rms {fitted.rms_pixels:.3f} pixels "
        f"(noise {fitted.noise_pixels[0]:.3f} columns, {fitted.noise_pixels[1]:.3f} lines); "
        f"corners reach over {100 * fitted.reach[0]:.0f} % of the columns and "
        f"{100 * fitted.reach[1]:.0f} % of the lines"
    )
    if fitted.board_std_m > 0:
        typer.echo(
            "The board departs from its description by "
            f"{1e3 * fitted.board_departure_m:.3f} mm rms "
            f"(known to {1e3 * fitted.board_departure_std_m:.3f} mm)"
        )
    for image in fitted.images:
        if not image.used:
            typer.echo(f"Left out: {image.name}: {image.reason}")
        elif image.reason:
            typer.echo(f"{image.name}: {image.reason}")


def _as_json(fitted: "CameraCalibration", out: Path, picture: Path) -> dict[str, Any]:
    bootstrap = fitted.bootstrap_std
    return {
        "file": out,
        "picture": picture,
        "camera": fitted.camera_section(),
        "parameters": {
            name: {
                "value": fitted.values[k],
                "std": fitted.std[k],
                "bootstrap_std": None if bootstrap is None else bootstrap[k],
            }
            for k, name in enumerate(fitted.parameters)
        },
        "hold": list(fitted.hold),
        "rms_pixels": fitted.rms_pixels,
        "noise_pixels": list(fitted.noise_pixels),
        "degrees_of_freedom": fitted.degrees_of_freedom,
        "board_departure_m": fitted.board_departure_m,
        "board_departure_std_m": fitted.board_departure_std_m,
        "images": [
            {
                "name": image.name,
                "used": image.used,
                "reason": image.reason,
                "corners": image.corners,
                "rms_pixels": image.rms,
                "tilt_deg": image.tilt_deg,
                "distance_m": image.distance_m,
            }
            for image in fitted.images
        ],
    }


def _advise_setup(settings: "Setup | None", setup: Path | None, out: Path) -> None:
    if settings is not None and settings.calibration.camera is not None:
        return
    beside = out.name if setup is None else os.path.relpath(out, setup.parent)
    where = "a setup" if setup is None else str(setup)
    typer.echo(f'To apply it, add to {where}:\n\n[calibration]\ncamera = "{beside}"')


def _warn(fitted: "CameraCalibration", picture: Path) -> None:
    """Say on stderr what makes the calibration worse than its numbers look."""
    bootstrap = fitted.bootstrap_std
    n_sources = len({image.source for image in fitted.images if image.used})
    if bootstrap is not None and n_sources >= _ENOUGH_SOURCES:
        ratio = float((bootstrap / fitted.std).max())
        if ratio > _SUSPICIOUS:
            typer.echo(
                f"Resampling the pictures gives {number(ratio, '.1f')} times the uncertainty: they "
                f"disagree more than their noise explains; look at {picture}",
                err=True,
            )
    if min(fitted.reach) < _ENOUGH_REACH:
        typer.echo(
            "The corners leave out much of the sensor, where the distortion is only extrapolated; "
            "photograph the board near the edges of the picture too",
            err=True,
        )
