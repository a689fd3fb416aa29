"""``glint-aoa benchmark figures``: the paper's data figures from recorded points."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._common import (
    Jobs,
    Json,
    Out,
    Overwrite,
    Points,
    SetupFile,
    bar,
    check_folder,
    check_names,
    check_new_files,
    print_json,
    table,
)

if TYPE_CHECKING:
    from glint_aoa.paper_figures import FigureData

__all__ = ["benchmark_figures"]

_SUMMARY = "figures.csv"


class _Format(StrEnum):
    PNG = "png"
    PDF = "pdf"
    SVG = "svg"


def benchmark_figures(
    points: Points,
    out: Out,
    setup: SetupFile = Path("glint-aoa.toml"),
    figure: Annotated[
        list[int] | None,
        typer.Option(
            "--figure",
            "-f",
            metavar="N",
            help="Number of a figure; give it again for more. All if not given.",
            show_default=False,
        ),
    ] = None,
    picture: Annotated[_Format, typer.Option("--format", help="Kind of pictures.")] = _Format.PNG,
    jobs: Jobs = 1,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Make the paper's data figures, 11 to 37, from recorded points.

    Which point feeds which figure follows from what the points say of their excitation, run and
    angle. Give the points of a run in the order in which they were taken. A figure that cannot be
    made from them is left out, and why is said.

    Writes figure-NN.png and the numbers in it as figure-NN.csv for each, and figures.csv: what each
    comes down to, here and in the paper.

    \b
    Example: glint-aoa benchmark figures points/*.h5 --setup glint-aoa.toml --out figures
    """
    from glint_aoa.paper_figures import FIGURES, check_number
    from glint_aoa.setup import load_setup

    numbers = sorted(set(figure or FIGURES))
    for number in numbers:
        check_number(number)
    suffix = f".{picture.value}"
    names = [f"figure-{number}{ending}" for number in numbers for ending in (suffix, ".csv")]
    check_names(points)
    check_folder(out)
    check_new_files((out / name for name in (_SUMMARY, *names)), overwrite=overwrite)
    task = _Task(numbers, out, suffix, jobs, overwrite)
    made = _write_all(task, points, load_setup(setup))
    rows = [row for data in made for row in _rows(data)]
    _write_summary(out / _SUMMARY, rows, overwrite)
    if as_json:
        print_json({"figures": [_described(data, out, suffix) for data in made]})
    else:
        _tell(made)
        typer.echo(f"\nWrote {len(made)} figures and {_SUMMARY} to {out}")


@dataclass(frozen=True)
class _Task:
    """What is to be written where."""

    numbers: list[int]
    out: Path
    suffix: str
    jobs: int
    overwrite: bool


def _write_all(task: _Task, paths: list[Path], settings: Any) -> "list[FigureData]":
    from glint_aoa.errors import InputError
    from glint_aoa.paper_figures import FigureSource, make_figure, read_points

    made = []
    with bar(len(task.numbers)) as advance:
        source = FigureSource(
            read_points(paths, settings),
            jobs=task.jobs,
            progress=lambda point: advance(0, point.name),
        )
        for number in task.numbers:
            advance(0, f"Figure {number}")
            try:
                data = make_figure(number, source)
            except InputError as lacking:
                typer.echo(f"figure {number} is left out: {lacking}", err=True)
            else:
                _write(data, task)
                made.append(data)
            advance(1)
    if not made:
        raise InputError(
            "none of the figures asked for can be made from these points; see what each lacks above"
        )
    return made


def _write(data: "FigureData", task: _Task) -> None:
    from glint_aoa.records._files import make_folder
    from glint_aoa.records.tables import write_csv
    from glint_aoa.report.figures import save_figure
    from glint_aoa.report.paper_figures import paper_figure

    make_folder(task.out)
    name = task.out / f"figure-{data.number}"
    picture, numbers = name.with_suffix(task.suffix), name.with_suffix(".csv")
    save_figure(paper_figure(data), picture, overwrite=task.overwrite)
    write_csv(numbers, data.columns(), overwrite=task.overwrite)


def _rows(data: "FigureData") -> list[dict[str, Any]]:
    points = " ".join(data.points)
    return [
        {
            "figure": data.number,
            "what": fact.what,
            "here": fact.value,
            "paper": fact.paper,
            "unit": fact.unit,
            "points": points,
        }
        for fact in data.facts
    ]


def _write_summary(path: Path, rows: list[dict[str, Any]], overwrite: bool) -> None:
    from glint_aoa.records.tables import write_csv

    write_csv(path, {key: [row[key] for row in rows] for key in rows[0]}, overwrite=overwrite)


def _described(data: "FigureData", out: Path, suffix: str) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "figure": data.number,
        "title": data.title,
        "facts": [asdict(fact) for fact in data.facts],
        "points": data.points,
        "files": [out / f"figure-{data.number}{ending}" for ending in (suffix, ".csv")],
    }


def _tell(made: "list[FigureData]") -> None:
    from glint_aoa.report.paper_figures import said_of

    rows = [[f"{data.number}", fact.what, *said_of(fact)] for data in made for fact in data.facts]
    if rows:
        table(["figure", "what", "here", "paper"], rows, left=2)
