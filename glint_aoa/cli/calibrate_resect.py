"""``glint-aoa calibrate resect``: the camera's pose from known targets."""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._common import (
    Json,
    Overwrite,
    Polarity,
    Scan,
    SetupFile,
    check_calibration_file,
    check_new_files,
    print_json,
    table,
)
from glint_aoa.errors import InputError, OutputError

if TYPE_CHECKING:
    from calibration.resection.resect import SpaceResection
    from calibration.resection.target_field import ImageTargets, TargetField
    from glint_aoa.setup import Setup

__all__ = ["resect"]

_SUSPICIOUS = 3.0  # reduced chi-square at which the user should look at the residuals
_CONTRADICTS = 3.3  # standard deviations
_ROUGH = 1.2  # factor of the variances where chi-square is no parabola
_VAGUE = math.radians(0.5)  # of a plane: from here on the intervals' coverage sinks
_ADVICE = "add targets off their plane, or tilt it"
_NAMES = ("X", "Y", "Z", "omega", "phi", "kappa")


def resect(
    targets: Annotated[
        Path,
        typer.Argument(
            metavar="TARGETS",
            help="Known targets, CSV: id, X, Y, Z with units in the header, e.g. X [mm].",
            show_default=False,
        ),
    ],
    measured: Annotated[
        Path | None,
        typer.Option(
            "--measured",
            "-m",
            metavar="FILE",
            help="Where they are seen, CSV: id, u, v [pixels], optional std_u, std_v, parity.",
            show_default=False,
        ),
    ] = None,
    image: Annotated[
        Path | None,
        typer.Option(
            "--image",
            "-i",
            metavar="FILE",
            help="Picture or recording of circular targets to measure instead.",
            show_default=False,
        ),
    ] = None,
    setup: SetupFile = Path("glint-aoa.toml"),
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="FILE", help="Calibration file to write (TOML)."),
    ] = Path("pose.toml"),
    units: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT",
            help="Unit of the targets' coordinates, if their header has none.",
            show_default=False,
        ),
    ] = None,
    polarity: Annotated[
        Polarity, typer.Option(help="Circles brighter or darker than what is around them.")
    ] = Polarity.bright,
    scan: Annotated[
        Scan, typer.Option(help="How a picture of --image was scanned.")
    ] = Scan.progressive,
    hold: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME...",
            help="Leave these of X, Y, Z, omega, phi, kappa at the setup's values.",
            show_default=False,
        ),
    ] = None,
    prior_distance: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help='Taped distance from the camera to Y = 0, e.g. "56 in".',
            show_default=False,
        ),
    ] = None,
    prior_std: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH", help='Its uncertainty, 1 sigma, e.g. "5 mm".', show_default=False
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Find position and pointing from targets of known place.

    The setup gives the interior orientation and an approximate position and rotation; what
    [uncertainty] says of a value that is held is carried to the pose. A picture of the residuals
    is written beside the calibration. Name the file in the setup to apply it: [calibration]
    pose = "pose.toml".

    \b
    Example: glint-aoa calibrate resect targets.csv --measured image.csv --setup glint-aoa.toml
    """
    from calibration.resection.resect import ResectionProvenance
    from calibration.resection.resect import resect as resection_of
    from calibration.resection.target_field import read_target_field
    from glint_aoa.records._files import make_folder
    from glint_aoa.report.figures import save_figure
    from glint_aoa.report.resection_figures import resection_figure
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    picture = out.with_suffix(".png")
    source = _one_source(measured, image)
    _check_out(out, picture, setup, (targets, source))
    check_new_files((out, picture), overwrite=overwrite)
    field = read_target_field(targets, units=units)
    seen, notes = _seen(measured, image, field, settings, polarity=polarity, scan=scan)
    held = [name.strip() for name in hold.split(",")] if hold else []
    found = resection_of(
        field,
        seen,
        settings.camera,
        hold=held,
        hold_std=_stds_of_held(held, settings),
        distance_m=_length("--prior-distance", prior_distance),
        distance_std_m=_length("--prior-std", prior_std),
        provenance=ResectionProvenance(
            targets=targets.name, measured=source.name, setup_hash=settings.hash
        ),
    )
    make_folder(out.parent)
    found.save(out, overwrite=overwrite)
    assert settings.camera.pixel_pitch is not None
    figure = resection_figure(
        found, pixel_pitch=settings.camera.pixel_pitch, sensor=settings.camera.sensor
    )
    save_figure(figure, picture, overwrite=overwrite)
    for note in (*notes, *_doubts(found, picture)):
        typer.echo(note, err=True)
    if as_json:
        print_json(_as_json(found, out, picture))
        return
    _print(found)
    typer.echo(f"\nWrote {out} and {picture}")
    if settings.calibration.pose is None:
        taped = any((*settings.uncertainty.position, *settings.uncertainty.rotation))
        typer.echo(
            f"To apply it, take position and rotation out of [camera]"
            f"{' and [uncertainty]' if taped else ''} in {setup} and add:\n\n"
            f'[calibration]\npose = "{os.path.relpath(out, setup.parent)}"'
        )


def _check_out(out: Path, picture: Path, setup: Path, inputs: Sequence[Path]) -> None:
    """Refuse a name that the calibration cannot have, before the targets are measured."""
    check_calibration_file(out, setup)
    if picture.resolve() in [each.resolve() for each in inputs]:
        raise OutputError(
            f"{picture} is an input, and the picture of the residuals would replace it; give "
            "another --out"
        )


def _one_source(measured: Path | None, image: Path | None) -> Path:
    if measured is not None and image is None:
        return measured
    if image is not None and measured is None:
        return image
    raise InputError(
        "where the targets are seen comes from --measured FILE.csv or from --image FILE; give one "
        "of the two"
    )


def _seen(
    measured: Path | None,
    image: Path | None,
    field: "TargetField",
    settings: "Setup",
    *,
    polarity: Polarity,
    scan: Scan,
) -> tuple["ImageTargets", list[str]]:
    """Return the image measurements, and what is to be said of them."""
    from calibration.photographs import photographs
    from calibration.resection.target_field import read_image_targets
    from calibration.resection.target_image import measure_target_field

    if measured is not None:
        return read_image_targets(measured), []
    assert image is not None
    pictures = photographs(
        [image], scan=scan.value, fields=settings.fields, sensor=settings.camera.sensor
    )
    found = measure_target_field(pictures, field, settings.camera, polarity=polarity.value)
    notes = []
    if found.missing:
        notes.append(f"{image}: not found in the picture: {', '.join(found.missing)}")
    if len(found.spurious):
        places = ", ".join(f"({u:.0f}, {v:.0f})" for u, v in found.spurious)
        notes.append(f"{image}: circles that are no target of the field, at (u, v): {places}")
    return found.measured, notes


def _stds_of_held(held: Sequence[str], settings: "Setup") -> dict[str, float]:
    stds = dict(
        zip(
            _NAMES,
            (*settings.uncertainty.position, *settings.uncertainty.rotation),
            strict=True,
        )
    )
    return {name: stds[name] for name in held if stds.get(name)}


def _length(option: str, text: str | None) -> float | None:
    from glint_aoa.units import parse_quantity

    if text is None:
        return None
    try:
        return parse_quantity(text, "m")
    except ValueError as error:
        raise InputError(f'{option}: {error}; give a length such as "56 in"') from None


def _doubts(found: "SpaceResection", picture: Path) -> list[str]:
    """Return what the user should look at."""
    doubts = [f"{each.id} left out: {each.reason}" for each in found.targets if not each.used]
    if found.excess > _SUSPICIOUS:
        doubts.append(
            f"The residuals are {found.excess**0.5:.1f} times what the stated noise explains; "
            f"look at {picture}" + (", and at what is held" if found.held else "")
        )
    if found.distance_m is not None and found.distance_std_m is not None:
        off = found.distance_m + found.position_m[1]
        if abs(off) > _CONTRADICTS * found.distance_std_m:
            doubts.append(
                f"The taped distance lies {1e3 * off:+.1f} mm from what the targets say, "
                f"{abs(off) / found.distance_std_m:.0f} times its uncertainty; tape it again"
            )
    if found.mirror is not None and found.mirror.ambiguous:
        other = ", ".join(f"{angle:.3f}" for angle in found.mirror.rotation_deg)
        doubts.append(
            f"These targets allow another pose as well (omega, phi, kappa {other} deg); the one "
            f"nearer to rotation in [camera] was taken; {_ADVICE}"
        )
    vaguest = float(found.std[3:].max())
    if found.widening > _ROUGH or (found.coplanar and vaguest > _VAGUE):
        doubts.append(
            "These targets hardly show which way they are tilted, and the uncertainty is rough: "
            f"the rotation is known to {math.degrees(vaguest):.2g} deg only, and a 95 % interval "
            f"may hold the truth in 90 % only; {_ADVICE}"
        )
    return doubts


def _as_json(found: "SpaceResection", out: Path, picture: Path) -> dict[str, Any]:
    import numpy as np

    return {
        "file": out,
        "picture": picture,
        "position_m": found.position_m.tolist(),
        "rotation_deg": np.degrees(found.rotation_rad).tolist(),
        "position_std_m": found.std[:3].tolist(),
        "rotation_std_deg": np.degrees(found.std[3:]).tolist(),
        "position_u95_m": found.u95[:3].tolist(),
        "rotation_u95_deg": np.degrees(found.u95[3:]).tolist(),
        "textbook_rotation_deg": found.textbook_deg.tolist(),
        "held": found.held,
        "rms_pixels": found.rms_pixels,
        "chi_square": found.chi_square,
        "degrees_of_freedom": found.degrees_of_freedom,
        "excess": found.excess,
        "coplanar": found.coplanar,
        "mirror": None if found.mirror is None else found.mirror.model_dump(),
        "targets": [each.model_dump() for each in found.targets],
    }


def _print(found: "SpaceResection") -> None:
    import numpy as np

    rows = [
        [each.id, f"{each.residual_u:+.3f}", f"{each.residual_v:+.3f}", each.reason]
        for each in found.targets
    ]
    table(["target", "residual u [px]", "residual v [px]", ""], rows)
    typer.echo()
    scale = [1e3] * 3 + [float(np.degrees(1.0))] * 3
    values = zip(_NAMES, scale, found.pose, found.std, found.u95, strict=True)
    table(
        ["pose", "value", "1 sigma", "95 %"],
        [
            [
                f"{name} [{'mm' if name in 'XYZ' else 'deg'}]",
                f"{factor * value:.4f}",
                "held" if name in found.held and not std else f"{factor * std:.4f}",
                "" if name in found.held and not std else f"{factor * u95:.4f}",
            ]
            for name, factor, value, std, u95 in values
        ],
    )
    omega, phi, kappa = found.textbook_deg
    typer.echo(
        "\nAngles: R = Rz(kappa) Ry(phi) Rx(omega), camera to tunnel, as in the setup."
        f"\nTextbook: omega {omega:.4f}, phi {phi:.4f}, kappa {kappa:.4f} deg of "
        "M = R3(kappa) R2(phi) R1(omega),"
        "\ntunnel to camera axes x right, y up, z towards the viewer."
    )
