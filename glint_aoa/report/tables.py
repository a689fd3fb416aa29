"""The tables of a benchmark as plain text and CSV."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from glint_aoa.benchmark import PaperRow, PointError, Table4Row
from glint_aoa.records.tables import write_csv
from glint_aoa.repeatability import RepeatabilityRow

__all__ = [
    "format_repeatability",
    "format_table4",
    "write_errors_csv",
    "write_repeatability_csv",
    "write_table4_csv",
]


def format_table4(rows: Sequence[Table4Row]) -> str:
    """Return Table 4 beside the paper's as plain text, at most 100 columns wide."""
    header = ["Excitation", "Technique", "Mean", "Std", "Max", "N", "Mean", "Std", "Max", "N"]
    cells = []
    for row in rows:
        excitation = row.excitation if row.kind == "all" else f"{row.excitation} {row.kind}"
        ours = [_signed(row.mean_deg, 4), _number(row.std_deg, 4), _signed(row.max_deg, 4)]
        paper = _paper_cells(row.paper)
        cells.append([excitation, row.technique, *ours, str(row.points), *paper])
    note = "Std: n - 1 in the denominator. Max: signed error of largest magnitude."
    title = "Table 4: error of the angle with the shaker on [deg]"
    return _text_table(title, header, cells, n_ours=4, note=note)


def format_repeatability(rows: Sequence[RepeatabilityRow]) -> str:
    """Return repeatability beside the paper's as plain text, at most 100 columns wide."""
    header = ["Quantity", "Statistic", "Value", "Unit", "mm", "N", "Value"]
    cells = [
        [
            row.quantity,
            row.statistic,
            _number(row.value, 5),
            row.units,
            _number(row.value_mm, 4),
            str(row.count),
            f"{row.paper:.4f}",
        ]
        for row in rows
    ]
    title = "Repeatability with the shaker off, 1 sigma"
    return _text_table(title, header, cells, n_ours=4)


def write_errors_csv(
    path: str | Path, errors: Sequence[PointError], *, overwrite: bool = False
) -> None:
    """Write the error of each point as CSV; what was not measured is an empty cell.

    Raises
    ------
    OutputError
        If the file exists and `overwrite` is False, or it cannot be written.
    """
    header = (
        "run,point,excitation,kind,plane,moment_in_lb_pp,video_error_deg,inertial_error_deg,"
        "corrected_error_deg,optical_deg,optical_std_deg,inertial_deg,corrected_deg,"
        "intercept_mm,intercept_std_mm,flags"
    )
    rows = [
        (
            *(p.run, p.point, p.excitation, p.kind, p.plane, p.moment_in_lb_pp),
            *(error.video_deg, error.inertial_deg, error.corrected_deg),
            *(p.optical_deg, p.optical_std_deg, p.inertial_deg, p.corrected_deg),
            *(p.intercept_mm, p.intercept_std_mm, p.flags),
        )
        for error in errors
        for p in (error.point,)
    ]
    _write_csv(path, header, rows, overwrite=overwrite)


def write_table4_csv(
    path: str | Path, rows: Sequence[Table4Row], *, overwrite: bool = False
) -> None:
    """Write Table 4 beside the paper's as CSV.

    Raises
    ------
    OutputError
        If the file exists and `overwrite` is False, or it cannot be written.
    """
    header = (
        "technique,excitation,kind,mean_deg,std_deg,max_deg,points,"
        "paper_mean_deg,paper_std_deg,paper_max_deg,paper_points"
    )
    cells = []
    for row in rows:
        p = row.paper
        paper = (p.mean_deg, p.std_deg, p.max_deg, p.points) if p else (None,) * 4
        ours = (row.mean_deg, row.std_deg, row.max_deg, row.points)
        cells.append((row.technique, row.excitation, row.kind, *ours, *paper))
    _write_csv(path, header, cells, overwrite=overwrite)


def write_repeatability_csv(
    path: str | Path, rows: Sequence[RepeatabilityRow], *, overwrite: bool = False
) -> None:
    """Write repeatability beside the paper's as CSV.

    Raises
    ------
    OutputError
        If the file exists and `overwrite` is False, or it cannot be written.
    """
    header = "quantity,statistic,value,units,value_mm,count,paper"
    cells = [
        (row.quantity, row.statistic, row.value, row.units, row.value_mm, row.count, row.paper)
        for row in rows
    ]
    _write_csv(path, header, cells, overwrite=overwrite)


def _signed(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:+.{decimals}f}"


def _number(value: float | None, decimals: int) -> str:
    return "" if value is None else f"{value:.{decimals}f}"


def _paper_cells(paper: PaperRow | None) -> list[str]:
    if paper is None:
        return [""] * 4
    return [
        f"{paper.mean_deg:+.3f}",
        f"{paper.std_deg:.3f}",
        f"{paper.max_deg:+.3f}",
        str(paper.points),
    ]


def _text_table(
    title: str,
    header: Sequence[str],
    cells: Sequence[Sequence[str]],
    *,
    n_ours: int,
    note: str = "",
) -> str:
    """Align two columns of names left, then figures right, ours and the paper's side by side."""
    n_left = 2
    widths = [max(len(cell) for cell in column) for column in zip(header, *cells, strict=True)]
    split = n_left + n_ours

    def line(row: Sequence[str]) -> str:
        aligned = [
            cell.ljust(width) if place < n_left else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        names, ours, paper = aligned[:n_left], aligned[n_left:split], aligned[split:]
        return "   ".join("  ".join(group) for group in (names, ours, paper)).rstrip()

    def width_of(group: Sequence[int]) -> int:
        return sum(group) + 2 * (len(group) - 1)

    names_width, ours_width = width_of(widths[:n_left]), width_of(widths[n_left:split])
    paper_width = max(width_of(widths[split:]), len(" paper "))
    over = "   ".join(
        (" " * names_width, " here ".center(ours_width, "-"), " paper ".center(paper_width, "-"))
    )
    rule = "-" * (names_width + ours_width + paper_width + 6)
    body = [line(row) for row in cells]
    return "\n".join([title, "", over, line(header), rule, *body, *([rule, note] if note else [])])


def _write_csv(
    path: str | Path, header: str, rows: Iterable[Sequence[object]], *, overwrite: bool
) -> None:
    cells = [[_cell(value) for value in row] for row in rows]
    columns = {name: [row[i] for row in cells] for i, name in enumerate(header.split(","))}
    write_csv(path, columns, overwrite=overwrite)


def _cell(value: object) -> object:
    if isinstance(value, float):
        return f"{round(value, 7) + 0.0:.9g}" if math.isfinite(value) else ""
    return value
