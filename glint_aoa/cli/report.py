"""``glint-aoa report``: results as one HTML file."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from glint_aoa.cli._common import Jobs, Json, Overwrite, bar, check_folder, print_json

__all__ = ["report"]


class _Format(StrEnum):
    png = "png"
    svg = "svg"
    pdf = "pdf"


def report(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder of results.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="The HTML file; FOLDER/report.html if not given.",
            show_default=False,
        ),
    ] = None,
    points: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder of the recordings, where they are no longer where they were measured.",
            show_default=False,
        ),
    ] = None,
    figures: Annotated[
        _Format | None,
        typer.Option(
            help="Also write each figure as a file of this kind, to a folder beside the report.",
            show_default=False,
        ),
    ] = None,
    jobs: Jobs = 1,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Show results as one HTML file, to read, print and send.

    It holds what process, benchmark, correct and calibrate wrote to FOLDER and the folders in it,
    and says what is not there. Fields and onboard sensor are drawn from the recordings, which are
    found by the path and the hash in the results.

    \b
    Example: glint-aoa report results --jobs 4
    """
    from glint_aoa.errors import OutputError
    from glint_aoa.report.html_report import write_report

    file = folder / "report.html" if out is None else out
    if file.suffix.lower() not in {".html", ".htm"}:
        raise OutputError(f"{file}: a report is an HTML file; end its name with .html")
    check_folder(file.parent)
    with bar(None) as advance:
        made = write_report(
            folder,
            file,
            points=points,
            figures=None if figures is None else figures.value,
            overwrite=overwrite,
            jobs=jobs,
            progress=advance,
        )
    if as_json:
        print_json(
            {
                "file": made.file,
                "figures": made.figures,
                "points": len(made.pages),
                "not_shown": [*made.lacks, *(f"{p.key}: {s}" for p in made.pages for s in p.lacks)],
            }
        )
        return
    beside = "" if made.figures is None else f" and its figures to {made.figures}"
    typer.echo(f"Wrote {made.file}{beside}: {len(made.pages)} points")
    for sentence in made.lacks:
        typer.echo(sentence, err=True)
    _tell_of_points([page.lacks for page in made.pages])


def _tell_of_points(lacks: list[list[str]]) -> None:
    """Say what single points lack, each sentence's point being on its page."""
    count = sum(bool(each) for each in lacks)
    if count:
        typer.echo(f"{count} of {len(lacks)} points lack something; their pages say what", err=True)
