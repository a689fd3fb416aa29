"""``glint-aoa convert``: recordings of any format into recorded points."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._common import (
    Json,
    Out,
    Overwrite,
    bar,
    check_folder,
    check_names,
    check_new_files,
    print_json,
)
from glint_aoa.errors import InputError

if TYPE_CHECKING:
    from glint_aoa.records.conversion import Converted

__all__ = ["convert"]


def convert(
    recordings: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="Recordings of fields.", show_default=False),
    ],
    out: Out,
    channels: Annotated[
        Path | None,
        typer.Option(metavar="RECORD", help="Acquisition record to join to the one recording."),
    ] = None,
    offset: Annotated[
        str,
        typer.Option(
            metavar="TIME", help="Trigger of the acquisition after that of the video, with unit."
        ),
    ] = "0 s",
    setup: Annotated[
        Path | None,
        typer.Option(
            "--setup", "-s", metavar="FILE", help="Setup file, for what the files do not say."
        ),
    ] = None,
    compress: Annotated[
        bool, typer.Option("--compress", help="Pack the fields: half the size, ten times slower.")
    ] = False,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write recordings as HDF5 points that carry all they need.

    Reads what inspect and process read: video, Phantom, Photron, TIFF, pictures, arrays, raw
    dumps. Grey levels are copied as they are. Each FILE becomes <out>/<name>.h5; it appears when
    it is whole, and process makes the same angles of it to the last bit.

    \b
    Example: glint-aoa convert clip.avi --channels clip.tdms --offset "12.5 ms" --out points
    """
    from glint_aoa.records._files import make_folder
    from glint_aoa.records.conversion import convert_recording
    from glint_aoa.records.formats import open_fields
    from glint_aoa.setup import Setup, load_setup

    settings = Setup() if setup is None else load_setup(setup)
    offset_s = _seconds(offset)
    check_names(recordings)
    if channels is not None and len(recordings) > 1:
        raise InputError(
            f"{channels}: one record for {len(recordings)} recordings; convert them singly"
        )
    check_folder(out)
    targets = {each: out / f"{each.stem}.h5" for each in recordings}
    check_new_files(targets.values(), overwrite=overwrite)
    done: list[Converted] = []
    failures: list[InputError] = []
    for recording, target in targets.items():
        try:
            stack = open_fields(recording, settings.fields)
            make_folder(out)
            with bar(stack.n_fields) as advance:
                done.append(
                    convert_recording(
                        stack,
                        target,
                        channels=channels,
                        offset_s=offset_s,
                        setup=settings,
                        overwrite=overwrite,
                        compress=compress,
                        progress=advance,
                    )
                )
        except InputError as error:
            failures.append(error)
    _tell(done, as_json=as_json)
    for failure in failures:
        typer.echo(f"glint-aoa: {failure}", err=True)
    if failures:
        raise typer.Exit(2)


def _seconds(offset: str) -> float:
    from glint_aoa.units import parse_quantity

    try:
        return parse_quantity(offset, "s")
    except ValueError as error:
        raise InputError(f'--offset: {error}; give a time with its unit, e.g. "12.5 ms"') from None


def _tell(done: "list[Converted]", *, as_json: bool) -> None:
    if as_json:
        print_json([_figures(each) for each in done])
    for each in done:
        if not as_json:
            typer.echo(_line(each))
        for note in each.notes:
            typer.echo(f"{each.path.stem}: {note}", err=True)


def _figures(each: "Converted") -> dict[str, Any]:
    stack = each.stack
    return {
        "file": stack.path,
        "point": each.path,
        "fields": stack.n_fields,
        "lines": stack.n_lines,
        "columns": stack.n_columns,
        "data_type": str(stack.dtype),
        "channels": list(each.channels),
        "notes": list(each.notes),
    }


def _line(each: "Converted") -> str:
    stack = each.stack
    fields = f"{stack.n_fields} fields of {stack.n_columns} x {stack.n_lines}, {stack.dtype}"
    channels = f", {len(each.channels)} channels" if each.channels else ""
    return f"Wrote {each.path}: {fields}{channels}"
