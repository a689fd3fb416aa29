"""``glint-aoa inspect SURVEY.uff``: a table like the paper's Table 1, and the modes as TOML."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from glint_aoa.cli._common import number, print_json, table
from glint_aoa.errors import InputError

if TYPE_CHECKING:
    from glint_aoa.inertial.modes import RotationPoint
    from glint_aoa.setup import Inertial

__all__ = ["inspect_survey"]

_INCH = 0.0254
_HEADER = [
    "mode",
    "plane",
    "frequency Hz",
    "damping",
    "radius in",
    "+-",
    "turns",
    "residual",
    "rigid",
]


def inspect_survey(survey: Path, inertial: "Inertial", *, as_json: bool = False) -> None:
    """Print effective radii of a modal survey, as a table and for the setup.

    The inertial sensor's station is that of the setup's package channel.
    """
    from glint_aoa.inertial.modes import modes_toml, rotation_point
    from glint_aoa.inertial.survey import read_survey

    station = _package_station(survey, inertial)
    points = [rotation_point(shape, station) for shape in read_survey(survey)]
    if as_json:
        print_json({"file": survey, "modes": [_figures(point) for point in points]})
        return
    table(_HEADER, [_cells(point) for point in points], left=2)
    typer.echo(f"\n{modes_toml(point.mode for point in points)}", nl=False)
    for point in points:
        if point.is_rigid is False:
            typer.echo(
                f"mode {point.mode.number}: the fuselage bends, so its radius is that of the best "
                "straight line only",
                err=True,
            )


def _package_station(survey: Path, inertial: "Inertial") -> float:
    for channel in inertial.channel:
        if channel.quantity in ("aoa_unfiltered", "aoa_filtered") and channel.station is not None:
            return channel.station
    raise InputError(
        f"{survey}: effective radii start at the inertial package; give --setup with its station "
        "under [[inertial.channel]]"
    )


def _figures(point: "RotationPoint") -> dict[str, Any]:
    return {
        "number": point.mode.number,
        "plane": point.mode.plane,
        "frequency_hz": point.mode.frequency_hz,
        "frequency_std_hz": point.shape.frequency_std_hz,
        "damping": point.shape.damping,
        "radius_m": point.mode.radius_m,
        "radius_std_m": point.radius_std_m,
        "rotation_point_m": point.station_m,
        "residual": point.residual,
        "is_rigid": point.is_rigid,
        "collinearity": point.shape.collinearity,
    }


def _cells(point: "RotationPoint") -> list[str]:
    mode = point.mode
    return [
        str(mode.number),
        mode.plane,
        number(mode.frequency_hz, ".2f"),
        number(point.shape.damping, ".4f"),
        number(mode.radius_m / _INCH, ".2f"),
        number(point.radius_std_m / _INCH, ".2f"),
        "aft" if mode.radius_m > 0 else "ahead",
        number(point.residual, ".1%"),
        {None: "-", True: "yes", False: "no"}[point.is_rigid],
    ]
