"""Acquisition records in text: one row a sample, one column a channel, names above.

Commas, semicolons, tabs or blanks may stand between the columns; a decimal comma is understood
wherever it cannot be mistaken for one of them.
"""

import csv
import io
import re
import tempfile
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO, NoReturn

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.acquisition import AcquisitionRecord, LazySamples
from glint_aoa.records.formats._channel_map import (
    EAGER_BYTES,
    Recorded,
    known_unit,
    mapped_record,
    split_unit,
    stated_rate_and_start,
)
from glint_aoa.records.formats._time_axis import TimeAxis, is_time_name, on_grid, time_unit_s
from glint_aoa.setup import Inertial
from glint_aoa.units import convert, parse_quantity

__all__ = ["read_csv"]

_HEAD_BYTES = 1 << 16
_BLOCK_BYTES = 1 << 22
_STORE_ROWS = 1 << 16
_WRITTEN = tuple(  # what parts the columns (None: blanks), and the decimal sign
    (delimiter, decimal)
    for delimiter in ("\t", ";", ",", None)
    for decimal in ".,"
    if decimal != delimiter
)
_COMMENT = ("#", "%", "//")
_MISSING = ("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "inf", "-inf", "+inf")
_RATE_KEYS = {"rate", "rate_hz", "fs", "sample_rate", "sampling_rate", "sample_frequency",
              "sampling_frequency", "sample_rate_hz", "sampling_rate_hz"}  # fmt: skip
_START_KEYS = {"start", "start_s", "start_time_s"}
_SAID = re.compile(r"^\W*([A-Za-z][A-Za-z _]*?)\s*(?:[\[(](\w+)[\])])?\s*[:=,;\t]\s*(.+?)[\s,;]*$")


def read_csv(path: Path, inertial: Inertial | None = None) -> AcquisitionRecord:
    """Read an acquisition record in text.

    Parameters
    ----------
    path : Path
        The file. Names stand in the last line above the numbers, with units in brackets
        (``ay_face [m/s^2]``) or in a line of their own below; lines that begin with ``#``, ``%``
        or ``//`` are comments. Times stand in a column ``time`` or ``t``; without one, a line
        above such as ``rate_hz: 800`` or the setup says the rate.
    inertial : Inertial, optional
        Section of the setup that completes the channels.

    Returns
    -------
    AcquisitionRecord
        All columns but the time. Rows that are missing by their times, and empty cells, are NaN.
        A long file is unpacked into a temporary one that goes with the record.

    Raises
    ------
    RecordingError
        If the file is no such text, a row is short, a cell is no number, times are irregular, or
        record and setup contradict each other; the message names file, line and column.
    """
    size = size_of(path)
    layout = _layout(path)
    source = _Source(path, layout, is_long=size > EAGER_BYTES)
    time = next((k for k, name in enumerate(layout.names) if is_time_name(name)), None)
    rate_hz, start_s = source.load(time, inertial)
    recorded = [
        Recorded(name, source.column(k), rate_hz, start_s, layout.units[k])
        for k, name in enumerate(layout.names)
        if k != time and name
    ]
    return mapped_record(path, recorded, inertial)


@dataclass(frozen=True)
class _Layout:
    """How the rows of a file are written."""

    delimiter: str | None
    decimal: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    offset: int  # of the first row of numbers [bytes]
    line: int  # number of that row, from 1
    rate_hz: float | None
    start_s: float | None


def _layout(path: Path) -> _Layout:
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if head[:2] in {b"\xff\xfe", b"\xfe\xff"} or b"\0" in head:
        raise RecordingError(
            f"{path}: no text of single bytes; save it as CSV in UTF-8, or correct its suffix"
        )
    raw = head.splitlines(keepends=True)
    if len(head) == _HEAD_BYTES and len(raw) > 1:
        raw.pop()
    lines = [_decoded(line).lstrip("\ufeff").rstrip("\r\n") for line in raw]
    first, delimiter, decimal = _first_row(path, lines)
    above = [_bare(line) for line in lines[:first]]
    width = len(_split(lines[first], delimiter))
    names, units = _headings(path, above, delimiter, decimal, width)
    rate_hz, start_s = _said_above(path, above)
    offset = sum(len(line) for line in raw[:first])
    return _Layout(delimiter, decimal, names, units, offset, first + 1, rate_hz, start_s)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENT)


def _bare(line: str) -> str:
    """Return a line without what marks it as a comment."""
    return line.strip().lstrip("#%/").strip() if _is_comment(line) else line.strip()


def _first_row(path: Path, lines: list[str]) -> tuple[int, str | None, str]:
    """Find the first of the rows of numbers, what parts their columns, and the decimal sign."""
    rows = [k for k, line in enumerate(lines) if line.strip() and not _is_comment(line)]
    for delimiter, decimal in _WRITTEN:
        split = {k: _split(lines[k], delimiter) for k in rows}
        for k, after in zip(rows, [*rows[1:], rows[-1]], strict=True):
            is_parted = delimiter is None or len(split[k]) > 1
            is_row = is_parted and len(split[k]) == len(split[after])
            if is_row and all(_are_numbers(split[each], decimal) for each in (k, after)):
                return k, delimiter, decimal
    raise RecordingError(
        f"{path}: no rows of numbers found; expected one row a sample, times in seconds, "
        "with the names of the columns in the line above the first"
    )


def _split(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]


def _are_numbers(cells: list[str], decimal: str) -> bool:
    found = [cell for cell in cells if cell.casefold() not in _MISSING]
    return bool(found) and all(_is_number(cell, decimal) for cell in found)


def _is_number(cell: str, decimal: str) -> bool:
    if decimal == "," and "." in cell:
        return False
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return False
    return True


def _headings(
    path: Path, above: list[str], delimiter: str | None, decimal: str, width: int
) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    """Names and units from the lines above the numbers; the names may stand in a comment."""
    filled = [line for line in above if line]
    cells = [_headings_of(line, delimiter) for line in filled]
    if delimiter == "," and cells and 2 * len(cells[-1]) == width:
        raise RecordingError(
            f"{path}: {len(cells[-1])} names stand over {width} columns, so the comma seems to "
            "be the decimal sign too; export with a decimal point or with semicolons"
        )
    if cells and len(cells[-1]) == width - 1 and delimiter is not None:
        cells[-1].append("")  # the rows end with a delimiter
    if not cells or len(cells[-1]) != width:
        found = f"{len(cells[-1])} names" if cells else "no names"
        raise RecordingError(
            f"{path}: {found} stand over {width} columns of numbers; write one name for each "
            "column in the line above, such as time_s,ay_face [m/s^2]"
        )
    units: list[str | None] = [None] * width
    if len(cells) > 1 and len(cells[-2]) == width and _are_units(cells[-1]):
        units = [known_unit(cell) for cell in cells.pop()]
    parted = [split_unit(cell) for cell in cells[-1]]
    names = tuple(name for name, _ in parted)
    if any(_is_number(name, decimal) for name in names):
        raise RecordingError(
            f"{path}: the line above the first whole row of numbers reads {filled[-1][:60]!r}, "
            "expected the names of the columns; correct it or write them there"
        )
    return names, tuple(own or unit for (_, own), unit in zip(parted, units, strict=True))


def _headings_of(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None and "[" in line:  # a blank before a unit parts nothing
        line = re.sub(r"\s+([\[(])", r"\1", line)
    return _split(line, delimiter)


def _are_units(cells: list[str]) -> bool:
    spelled = [known_unit(cell) for cell in cells]
    return any(spelled) and all(unit is None or _is_unit(unit) for unit in spelled)


def _is_unit(unit: str) -> bool:
    try:
        convert(unit, unit)
    except ValueError:
        return False
    return True


def _said_above(path: Path, above: list[str]) -> tuple[float | None, float | None]:
    """Rate [Hz] and start [s] from lines such as ``rate_hz: 800`` above the names."""
    said = {}
    for found in filter(None, map(_SAID.match, above)):
        key = re.sub(r"[ _]+", "_", found[1].strip().casefold())
        said[key] = f"{found[3]} {found[2] or ''}".strip().strip('"')
    values: list[float | None] = []
    for keys, unit in ((_RATE_KEYS, "Hz"), (_START_KEYS, "s")):
        key, text = next(((key, said[key]) for key in said if key in keys), ("", ""))
        if not text:
            values.append(None)
            continue
        if not re.search(r"[A-Za-z]+$", text):
            text = f"{text} {unit}"
        try:
            values.append(parse_quantity(text, unit))
        except ValueError as error:
            raise RecordingError(f"{path}: {key} above the names: {error}") from None
    rate_hz, start_s = values
    if rate_hz is not None and not 0 < rate_hz < float("inf"):
        raise RecordingError(f"{path}: rate above the names is {rate_hz:g}; expected more than 0")
    return rate_hz, start_s


@dataclass(eq=False)
class _Source:
    """The rows of a file, in memory or, of a long one, in a temporary file."""

    path: Path
    layout: _Layout
    is_long: bool
    _size: int = 0
    _kept: list[NDArray[np.float64]] = field(default_factory=list)
    _store: IO[bytes] | None = None

    def load(self, time: int | None, inertial: Inertial | None) -> tuple[float, float]:
        """Go through the whole file once; return rate [Hz] and start [s]."""
        axis = TimeAxis(str(self.path))
        unit = 1.0
        if time is not None:
            where, name = str(self.path), self.layout.names[time]
            unit = time_unit_s(where, name, self.layout.units[time])
        for line, text in self._texts():
            rows = self._parsed(text, line)
            if not len(rows):
                continue
            places = np.arange(len(rows))
            if time is not None:
                places = axis.add(rows[:, time] * unit) - self._size
            self._keep(on_grid(places, int(places[-1]) + 1, rows))
        rate_hz, start_s = self.layout.rate_hz, self.layout.start_s
        if time is not None:
            rate_hz, start_s, _ = axis.finish()
        return stated_rate_and_start(self.path, rate_hz, start_s, inertial)

    def column(self, number: int) -> NDArray[np.float64] | LazySamples:
        """Return one column as samples on the grid."""
        if self._store is None:
            return np.concatenate([rows[:, number] for rows in self._kept])
        read = partial(self._read, self._store, number)
        return LazySamples(self._size, np.dtype(np.float64), read)

    def _keep(self, rows: NDArray[np.float64]) -> None:
        self._size += len(rows)
        if not self.is_long:
            self._kept.append(rows)
            return
        try:
            if self._store is None:
                self._store = tempfile.TemporaryFile()  # noqa: SIM115  open while it may be read
                weakref.finalize(self, self._store.close)
            self._store.write(rows.tobytes())
            self._store.flush()
        except OSError as error:
            raise RecordingError(
                f"{self.path}: no room to unpack it in {tempfile.gettempdir()} "
                f"({error.strerror}); make room there or set TMPDIR to another folder"
            ) from error

    def _read(self, store: IO[bytes], number: int, start: int, stop: int) -> NDArray[np.float64]:
        """Read a stretch of one column; whole rows pass through memory, a few at a time."""
        width = len(self.layout.names)
        found = np.empty(stop - start)
        for first in range(start, stop, _STORE_ROWS):
            end = min(first + _STORE_ROWS, stop)
            store.seek(first * width * found.itemsize)
            rows = np.frombuffer(store.read((end - first) * width * found.itemsize))
            found[first - start : end - start] = rows[number::width]
        return found

    def _texts(self) -> Iterator[tuple[int, bytes]]:
        """Yield whole lines of the file with the number of the first."""
        line, rest = self.layout.line, b""
        with self.path.open("rb") as file:
            file.seek(self.layout.offset)
            while block := file.read(_BLOCK_BYTES):
                text, mark, rest = (rest + block).rpartition(b"\n")
                if mark:
                    yield line, text + mark
                    line += text.count(b"\n") + 1
        if rest:
            yield line, rest

    def _parsed(self, text: bytes, line: int) -> NDArray[np.float64]:
        """Return the rows of a text as [row, column]."""
        import pandas as pd  # noqa: PLC0415  slow to import, and only text needs it

        if any(mark.encode() in text for mark in _COMMENT):
            lines = text.splitlines()
            text = b"\n".join(b"" if _is_comment(_decoded(each)) else each for each in lines)
        if not text.strip():
            return np.zeros((0, len(self.layout.names)))
        try:
            table = pd.read_csv(
                io.BytesIO(text),
                sep=self.layout.delimiter or r"\s+",
                decimal=self.layout.decimal,
                header=None,
                names=range(len(self.layout.names)),
                index_col=False,
                dtype=np.float64,
                na_values=list(_MISSING),
                skipinitialspace=True,
            )
        except Exception as error:
            self._refuse_row(text, line, str(error))
        rows = np.asarray(table.to_numpy(np.float64))
        if self._is_ragged(text, rows):
            self._refuse_row(text, line, "rows differ in length")
        return rows

    def _is_ragged(self, text: bytes, rows: NDArray[np.float64]) -> bool:
        """Whether a row may be short: pandas leaves the last columns of such a row empty."""
        named = [k for k, name in enumerate(self.layout.names) if name]
        if not np.isnan(rows[:, named[-1]]).any():
            return False
        return any(len(cells) != rows.shape[1] for _, cells in self._cells(text))

    def _cells(self, text: bytes) -> Iterator[tuple[int, list[str]]]:
        for k, line in enumerate(_decoded(text).splitlines()):
            if line.strip() and not _is_comment(line):
                yield k, _split(line, self.layout.delimiter)

    def _refuse_row(self, text: bytes, line: int, otherwise: str) -> NoReturn:
        """Raise for the first row that cannot be read."""
        names = self.layout.names
        for k, cells in self._cells(text):
            if len(cells) != len(names):
                raise RecordingError(
                    f"{self.path}: line {line + k} has {len(cells)} values where {len(names)} "
                    "columns have names; it is cut short or damaged, correct or delete it"
                )
            for name, cell in zip(names, cells, strict=True):
                if cell.casefold() not in _MISSING and not _is_number(cell, self.layout.decimal):
                    raise RecordingError(
                        f"{self.path}: line {line + k}, column {name or 'without a name'}: "
                        f"{cell!r} is no number; correct it or leave the cell empty"
                    )
        raise RecordingError(f"{self.path}: from line {line}: {otherwise}; export it again")


def _decoded(text: bytes) -> str:
    return text.decode("utf-8", errors="replace")
