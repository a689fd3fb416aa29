"""Tables of targets: CSV with units in the header, read strictly."""

import csv
import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import CalibrationError
from glint_aoa.units import convert

Floats = NDArray[np.float64]

_HEADING = re.compile(r"(?P<name>[A-Za-z][A-Za-z_]*?)\s*(?:[\[(]\s*(?P<unit>[^\])]*?)\s*[\])])?")


@dataclass(frozen=True, eq=False)
class TargetTable:
    """Columns of a table, by name.

    Attributes
    ----------
    path : Path
        The file.
    units : dict of str to str
        Unit of each column as its heading says; empty where it says none.
    cells : dict of str to list of str
        Cells of each column.
    rows : list of int
        Line of the file that each row stands on.
    """

    path: Path
    units: dict[str, str]
    cells: dict[str, list[str]]
    rows: list[int]

    @classmethod
    def read(
        cls, path: str | Path, known: Collection[str], needed: Collection[str]
    ) -> "TargetTable":
        """Read a table.

        Parameters
        ----------
        path : str or Path
            CSV file; lines that begin with ``#`` are comments.
        known : collection of str
            Names that columns may have; in the file upper and lower case are the same.
        needed : collection of str
            Those that must be there.

        Raises
        ------
        CalibrationError
            If the file cannot be read, a column is missing, unknown or given twice, or a row
            has more or fewer cells than the header.
        """
        path = Path(path)
        lines = _lines(path)
        if not lines:
            raise CalibrationError(f"{path}: the table is empty; give a header and its rows")
        (_, header), *body = lines
        headings = [_heading(path, each, known) for each in header]
        names = [name for name, _ in headings]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise CalibrationError(f"{path}: column {twice} is there twice; take one out")
        missing = [name for name in needed if name not in names]
        if missing:
            raise CalibrationError(
                f"{path}: no column {missing[0]}; the header is {', '.join(header)}, expected "
                f"{', '.join(needed)}"
            )
        for line, cells in body:
            if len(cells) != len(header):
                raise CalibrationError(
                    f"{path}: line {line} has {len(cells)} cells, expected {len(header)} as in "
                    "the header; correct that line"
                )
        if not body:
            raise CalibrationError(f"{path}: the table has no rows; give one for each target")
        columns = {name: [cells[i] for _, cells in body] for i, name in enumerate(names)}
        return cls(path, dict(headings), columns, [line for line, _ in body])

    def __contains__(self, name: str) -> bool:
        """Whether there is a column of that name."""
        return name in self.cells

    def ids(self) -> tuple[str, ...]:
        """Return the column ``id``; refuse what is empty or there twice."""
        first: dict[str, int] = {}
        for line, name in zip(self.rows, self.cells["id"], strict=True):
            if not name:
                raise CalibrationError(f"{self.path}: line {line} has no id; give it one")
            if name in first:
                raise CalibrationError(
                    f"{self.path}: target {name} is there twice, in lines {first[name]} and "
                    f"{line}; give each target one line"
                )
            first[name] = line
        return tuple(first)

    def numbers(self, name: str) -> Floats:
        """Return a column of finite numbers."""
        values = []
        for line, cell in zip(self.rows, self.cells[name], strict=True):
            try:
                value = float(cell)
            except ValueError:
                value = np.nan
            if not np.isfinite(value):
                raise CalibrationError(
                    f"{self.path}: line {line}: {name} is {cell!r}; give a number"
                )
            values.append(value)
        return np.array(values)

    def lengths(self, name: str, unit: str | None) -> Floats:
        """Return a column of lengths [m].

        Parameters
        ----------
        name : str
            The column.
        unit : str or None
            Its unit, where the heading does not say it.
        """
        said = self.units[name]
        if said and unit is not None and said != unit:
            raise CalibrationError(
                f"{self.path}: column {name} says {said}, --units says {unit}; "
                "leave --units out or correct the header"
            )
        used = said or unit
        if not used:
            raise CalibrationError(
                f"{self.path}: column {name} has no unit; write it into the header, e.g. "
                f"{name} [mm], or give --units"
            )
        try:
            factor = convert(used, "m")
        except ValueError as error:
            raise CalibrationError(
                f"{self.path}: column {name}: {error}; give a unit of length, e.g. mm"
            ) from None
        return self.numbers(name) * factor


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Return line numbers and cells, without comments and empty lines."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, skipinitialspace=True)
            found = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except FileNotFoundError:
        raise CalibrationError(f"{path}: no such table; check its name and folder") from None
    except IsADirectoryError:
        raise CalibrationError(f"{path}: a folder, expected a table; give the file in it") from None
    except UnicodeDecodeError:
        raise CalibrationError(
            f"{path}: not a CSV table in UTF-8; export it again as such"
        ) from None
    except (OSError, csv.Error) as error:
        raise CalibrationError(f"{path}: not a CSV table ({error}); write it again") from None
    return [(line, cells) for line, cells in found if any(cells) and not cells[0].startswith("#")]


def _heading(path: Path, text: str, known: Collection[str]) -> tuple[str, str]:
    """Split ``X [mm]``, ``X (mm)`` or ``X_mm`` into name and unit."""
    whole = _HEADING.fullmatch(text)
    if whole is not None:
        name, unit = whole["name"], whole["unit"] or ""
        stem, _, ending = name.rpartition("_")
        names = {each.lower(): each for each in known}
        for candidate, its_unit in ((name, unit), (stem, unit or ending)):
            if candidate.lower() in names:
                return names[candidate.lower()], its_unit
    raise CalibrationError(
        f"{path}: column {text!r} is not known; the columns are {', '.join(known)}, and commas "
        "stand between them"
    )
