"""``glint-aoa init``: a setup file to fill in."""

from pathlib import Path
from typing import Annotated, Any

import typer

from glint_aoa.cli._common import Json, check_folder, check_new_files, print_json

__all__ = ["init"]


def init(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="Setup file to write.")
    ] = Path("glint-aoa.toml"),
    recording: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="POINT",
            help="Recording whose rate, exposure and scan, and whose channels, to take over.",
            show_default=False,
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMNSxLINES",
            help="The sensor's size: columns and lines of a field, e.g. 752x240.",
            show_default=False,
        ),
    ] = None,
    value: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help='Any other value, e.g. glint.nose=left or camera.focal_length="35 mm"; may be '
            "repeated.",
            show_default=False,
        ),
    ] = None,
    image_plane: Annotated[
        bool,
        typer.Option(
            "--image-plane", help="Ask for no camera: enough for an angle in the image plane."
        ),
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace a file of the same name.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write a setup file with every key, its unit and its meaning.

    Values that nobody but you can know are marked "FILL IN", and a command that reads the file
    names those that are left. All others are comments that show the default or an example.

    \b
    Example: glint-aoa init --from point-01.h5 --camera 752x240 --set glint.nose=left
    """
    import tomllib

    from glint_aoa.records._files import make_folder, replacing
    from glint_aoa.setup.section import unfilled
    from glint_aoa.setup.template import NEEDED, set_value, setup_template

    check_folder(out.parent)
    check_new_files([out], overwrite=overwrite)
    values: dict[str, Any] = {}
    needed = ["glint.nose"] if image_plane else [*NEEDED]
    notes: dict[str, str] = {}
    if recording is not None:
        needed += _take_over(recording, values, notes)
    if camera is not None:
        set_value(values, "camera.sensor", _size(camera))
    for text in value or ():
        set_value(values, *_key_and_value(text))
    text = setup_template(values, needed=needed, notes=notes)
    make_folder(out.parent)
    with replacing(out, overwrite=overwrite) as path:
        path.write_text(text, encoding="utf-8")
    left = unfilled(tomllib.loads(text))
    if as_json:
        print_json({"setup": out, "fill_in": left})
        return
    typer.echo(f"Wrote {out}")
    if left:
        typer.echo("Fill in, with any editor:")
        for key in left:
            typer.echo(f"  {key}")


def _size(text: str) -> list[int]:
    from glint_aoa.errors import InputError

    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdecimal() and int(part) > 0 for part in parts):
        raise InputError(f"--camera is {text}; expected columns and lines of a field, e.g. 752x240")
    return [int(part) for part in parts]


def _key_and_value(text: str) -> tuple[str, Any]:
    from glint_aoa.errors import InputError
    from glint_aoa.setup.template import parse_value

    key, equals, value = (part.strip() for part in text.partition("="))
    if not (key and equals and value):
        raise InputError(f"--set is {text}; expected KEY=VALUE, e.g. glint.nose=left")
    return key, parse_value(value)


def _take_over(recording: Path, values: dict[str, Any], notes: dict[str, str]) -> list[str]:
    """Take over what a recording says of fields and channels; return the keys that it lacks."""
    from glint_aoa.cli.inspect import holds_channels, holds_fields
    from glint_aoa.records.formats import open_acquisition

    lacking = _fields(recording, values, notes) if holds_fields(recording) else []
    if holds_channels(recording):
        names = ", ".join(open_acquisition(recording).channels)
        notes["inertial.channel.name"] = f"channels of {recording.name}: {names}"
    return lacking


def _fields(recording: Path, values: dict[str, Any], notes: dict[str, str]) -> list[str]:
    """Take over what holds for a whole test; where a window lay may differ from point to point."""
    from glint_aoa.records.formats import open_fields
    from glint_aoa.setup.template import set_value

    stack = open_fields(recording)
    info = stack.info
    said = {
        "rate": None if info.rate_hz is None else f"{info.rate_hz!r} Hz",
        "exposure": None if info.exposure_s is None else f"{info.exposure_s!r} s",
        "interlaced": info.interlaced,
    }
    for key, value in said.items():
        if value is not None:
            set_value(values, f"fields.{key}", value)
    source = f"of {recording.name}, which says so itself"
    for key in ("first_line", "first_column", "first_parity"):
        value = getattr(info, key)
        if value is not None:
            notes[f"fields.{key}"] = f"{value}: that {source}"
    notes["camera.sensor"] = (
        f"the window of {recording.name} has {stack.n_columns} columns and {stack.n_lines} lines"
    )
    return ["fields.rate"] if info.rate_hz is None else []
