"""Result tables that survive a crash: CSV, the log of points, NetCDF."""

import csv
import errno
import fcntl
import io
import math
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError, OutputError
from glint_aoa.records._files import replacing

__all__ = ["append_log", "read_csv", "write_csv", "write_netcdf"]

_NOTHING: Mapping[str, Any] = {}


_ROWS_AT_A_TIME = 10_000
_NETCDF = threading.Lock()


def write_csv(
    path: str | Path,
    columns: Mapping[str, NDArray[Any] | Sequence[Any]],
    *,
    formats: Mapping[str, str] = _NOTHING,
    overwrite: bool = True,
) -> None:
    """Write a table; the file appears under its name, or replaces one, only when it is whole.

    Parameters
    ----------
    path : str or Path
        The file.
    columns : mapping of str to ndarray or list [row]
        Columns by their headings, all of one length. NaN and None become empty cells.
    formats : mapping of str to str, optional
        How a column's values are written, such as ``{"angle_deg": ".5f"}``; ten significant
        digits where not given.
    overwrite : bool, optional
        Whether a file of that name may be replaced.

    Raises
    ------
    OutputError
        If the file cannot be written, or exists and `overwrite` is False.
    """
    path = Path(path)
    rows = max((len(values) for values in columns.values()), default=0)
    with (
        replacing(path, overwrite=overwrite) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for start in range(0, rows, _ROWS_AT_A_TIME):
            cells = [
                [
                    _cell(value, formats.get(name, ""))
                    for value in _plain(values[start : start + _ROWS_AT_A_TIME])
                ]
                for name, values in columns.items()
            ]
            writer.writerows(zip(*cells, strict=True))


def read_csv(path: str | Path) -> dict[str, list[str]]:
    """Read a table with a header row.

    A row with fewer cells than the header was cut off by a crash and is left out.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    dict of str to list of str
        Cells of each column, by its heading.

    Raises
    ------
    InputError
        If the file cannot be read, has no header, or a row has more cells than the header.
    """
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except FileNotFoundError:
        raise InputError(f"{path}: no such table; check its name and folder") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a CSV table ({error}); write it again") from None
    if not rows or not any(rows[0]):
        raise InputError(f"{path}: the table has no header row; write it again")
    header, *body = rows
    for number, row in enumerate(body, start=2):
        if len(row) > len(header):
            raise InputError(
                f"{path}: row {number} has {len(row)} cells, expected {len(header)} as in the "
                "header; correct that row"
            )
    whole = [row for row in body if len(row) == len(header)]
    return {name: [row[i] for row in whole] for i, name in enumerate(header)}


def append_log(path: str | Path, row: Mapping[str, object], columns: Sequence[str]) -> None:
    """Append one row to a log, which is started with a header where it is new.

    The row goes to disk in one write under a lock, so that programs that share a log do not mix
    their lines and a crash cannot lose a row that was written. A line that a crash cut off is left
    as it is; the row starts on a line of its own.

    Parameters
    ----------
    path : str or Path
        The log, a CSV table.
    row : mapping of str to object
        Values by column. NaN, None and what is missing become empty cells.
    columns : sequence of str
        All columns, in order.

    Raises
    ------
    OutputError
        If the log has other columns, or cannot be written; it is as it was before, then.
    ValueError
        If `row` has a key that is none of `columns`.
    """
    path = Path(path)
    unknown = [key for key in row if key not in columns]
    if unknown:
        raise ValueError(f"{unknown[0]} is none of the log's columns: {', '.join(columns)}")
    header = _line(columns)
    line = _line([_cell(_scalar(row.get(name)), "") for name in columns])
    try:
        with _locked(path) as log:
            text = _opening(path, log, header) + line
            _append_whole(log, text)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); "
            "check that the folder exists, its permissions and the free space"
        ) from error


def write_netcdf(
    path: str | Path,
    columns: Mapping[str, NDArray[Any]],
    *,
    attrs: Mapping[str, Any] = _NOTHING,
    column_attrs: Mapping[str, Mapping[str, Any]] = _NOTHING,
) -> None:
    """Write a table as NetCDF 4; the file appears, or replaces one, only when it is whole.

    Parameters
    ----------
    path : str or Path
        The file.
    columns : mapping of str to ndarray [row]
        Columns by name, all of one length; the first is the rows' coordinate and names them.
    attrs : mapping of str to str, number or list of numbers, optional
        Attributes of the whole.
    column_attrs : mapping of str to mapping, optional
        Attributes of the columns, such as units.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    import netCDF4  # noqa: PLC0415  slow to import

    rows, first = next(iter(columns.items()))
    # The library is not safe in threads.
    with _NETCDF, replacing(Path(path)) as temporary:
        try:
            with netCDF4.Dataset(temporary, "w") as file:
                file.setncatts(attrs)
                file.createDimension(rows, len(first))
                for name, values in columns.items():
                    missing = np.nan if values.dtype.kind == "f" else None
                    column = file.createVariable(name, values.dtype, (rows,), fill_value=missing)
                    column.setncatts(column_attrs.get(name, {}))
                    column[:] = values
        except RuntimeError as error:  # how the library speaks of a full disk
            raise OSError(str(error)) from error


def _plain(values: NDArray[Any] | Sequence[Any]) -> list[Any]:
    return list(values.tolist() if isinstance(values, np.ndarray) else map(_scalar, values))


def _scalar(value: object) -> object:
    return value.item() if isinstance(value, np.generic) else value


def _cell(value: object, spec: str) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, float):
        return format(value, spec or ".10g")
    return format(value, spec) if spec else str(value)


def _line(cells: Sequence[str]) -> bytes:
    """Return one line of CSV; a line break inside a cell would break the log, and is a space."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(" ".join(cell.splitlines()) for cell in cells)
    return text.getvalue().encode()


@contextmanager
def _locked(path: Path) -> Iterator[int]:
    log = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o666)
    try:
        fcntl.flock(log, fcntl.LOCK_EX)
        yield log
    finally:
        os.close(log)


def _opening(path: Path, log: int, header: bytes) -> bytes:
    """Return what must stand before a new row: the header, the end of a torn line, or nothing."""
    size = os.fstat(log).st_size
    start = os.pread(log, len(header), 0)
    if start == header:
        return b"" if os.pread(log, 1, size - 1) == b"\n" else b"\n"
    if header.startswith(start) and size == len(start):  # new, or torn within its header
        os.ftruncate(log, 0)
        return header
    found = start.partition(b"\n")[0].decode("utf-8", errors="replace")
    raise OutputError(
        f"{path}: the log has other columns ({found}...); give another folder or move the old log"
    )


def _append_whole(log: int, text: bytes) -> None:
    before = os.fstat(log).st_size
    is_whole = False
    try:
        is_whole = os.write(log, text) == len(text)
        os.fsync(log)
    finally:
        if not is_whole:
            os.ftruncate(log, before)
    if not is_whole:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
