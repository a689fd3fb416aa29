"""Tables of a page: what is printed in a cell, and the number behind it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

__all__ = ["Cell", "Table", "printed", "table_of"]


@dataclass(frozen=True)
class Cell:
    """A cell: its text, the number as the results have it, and where it links to."""

    text: str
    exact: str = ""
    link: str = ""


@dataclass(frozen=True)
class Table:
    """A table of a page; `note` stands below it."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    note: str = ""

    @property
    def are_numbers(self) -> list[bool]:
        """Whether each column holds numbers, which are aligned to the right."""
        return [any(row[i].exact for row in self.rows) for i in range(len(self.header))]


def printed(cell: str | None, spec: str) -> str:
    """Return a number of a table of results as it is printed; empty where nothing was measured.

    Parameters
    ----------
    cell : str or None
        As in the results.
    spec : str
        Format, such as ``"+.4f"``; zero is never negative.
    """
    try:
        value = float(cell or "nan")
    except ValueError:
        return cell or ""
    if not math.isfinite(value):
        return ""
    text = f"{value:{spec}}"
    return text if float(text) else f"{0.0:{spec}}"


def _as_it_is(cell: str) -> Cell:
    return Cell(cell, cell if cell.isdecimal() else "")


def table_of(
    caption: str,
    rows: Sequence[Mapping[str, str]],
    columns: Mapping[str, tuple[str, str]],
    *,
    note: str = "",
) -> Table:
    """Make a table of rows of a CSV file.

    Parameters
    ----------
    caption : str
        What stands above it.
    rows : sequence of mapping
        As read.
    columns : mapping of str to (str, str)
        Heading and format of each column; an empty format prints the cell as it is. Columns that
        the rows do not have are left out.
    note : str
        What stands below it.
    """
    there = {name: how for name, how in columns.items() if rows and name in rows[0]}
    cells = [
        [
            Cell(printed(row[name], spec), row[name]) if spec else _as_it_is(row[name])
            for name, (_, spec) in there.items()
        ]
        for row in rows
    ]
    return Table(caption, [heading for heading, _ in there.values()], cells, note)
