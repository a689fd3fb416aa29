"""A folder of results as the commands wrote it: what is there, told by content and not by name."""

import contextlib
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from glint_aoa.records.angles import FIELD_COLUMNS, LOG_COLUMNS
from glint_aoa.records.tables import read_csv

__all__ = ["MeasuredPoint", "ResultsFolder", "Row", "read_correction", "read_results_folder"]

Row = Mapping[str, str]
_Columns = Mapping[str, NDArray[Any]]

_CALIBRATIONS = ("pitch sweep", "camera calibration", "space resection")
_PICTURES = (".png", ".svg")
_TABLES = {
    "table4": ("technique", "excitation", "kind", "mean_deg"),
    "errors": ("run", "point", "excitation", "kind", "plane"),
    "repeatability": ("quantity", "statistic", "value"),
    "figures": ("figure", "what", "here", "paper"),
}
_CORRECTION = ("time_s", "angle_deg", "angle_std_deg", "raw_angle_deg", "bias_deg", "flags")


@dataclass(frozen=True, eq=False)
class MeasuredPoint:
    """Results of one point.

    Attributes
    ----------
    key : str
        Name of its files, with their folder's in front where two points have the same.
    values : mapping of str to ndarray [field]
        Columns of ``<point>.nc``, or of ``<point>.csv`` where there is no other.
    attrs : mapping
        Attributes of ``<point>.nc``; empty without it.
    log, error : mapping of str to str
        Its last row of ``log.csv``, and its row of ``errors.csv``; empty where there is none.
    correction : Path or None
        What ``correct`` wrote of a record of the same name.
    """

    key: str
    values: _Columns
    attrs: Mapping[str, Any]
    log: Row = field(default_factory=dict)
    error: Row = field(default_factory=dict)
    correction: Path | None = None

    @property
    def name(self) -> str:
        """Name of the point's files."""
        return self.key.rpartition("/")[2]


@dataclass(frozen=True, eq=False)
class ResultsFolder:
    """What is found in a folder of results and in the folders directly inside it.

    Attributes
    ----------
    path : Path
        The folder.
    points : sequence of MeasuredPoint
        By time of day of the trigger where all say it, else by name.
    tables : mapping of str to sequence of Row
        Rows of ``table4``, ``errors``, ``repeatability`` and ``figures``; those that are there.
    studies : mapping of str to sequence of Row
        Rows of the tables of ``benchmark inertial``, by the name of the file.
    calibrations : sequence of (Path, str)
        Files of calibrations, and their kind.
    pictures : sequence of Path
        Pictures of the paper's figures, as ``benchmark figures`` wrote them.
    problems : sequence of str
        Files that cannot be used, and why.
    """

    path: Path
    points: Sequence[MeasuredPoint]
    tables: Mapping[str, Sequence[Row]]
    studies: Mapping[str, Sequence[Row]]
    calibrations: Sequence[tuple[Path, str]]
    pictures: Sequence[Path]
    problems: Sequence[str]


@dataclass
class _Found:
    netcdf: dict[str, Path] = field(default_factory=dict)
    fields: dict[str, Path] = field(default_factory=dict)
    corrections: dict[str, Path] = field(default_factory=dict)
    log: list[Row] = field(default_factory=list)
    tables: dict[str, list[Row]] = field(default_factory=dict)
    studies: dict[str, list[Row]] = field(default_factory=dict)
    calibrations: list[tuple[Path, str]] = field(default_factory=list)
    pictures: list[Path] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def read_results_folder(path: str | Path) -> ResultsFolder:
    """Look through a folder of results, and the folders directly inside it.

    Parameters
    ----------
    path : str or Path
        What ``process``, ``benchmark``, ``correct`` and ``calibrate`` wrote, in any mixture.

    Returns
    -------
    ResultsFolder
        What is there; what cannot be read is named among its problems.

    Raises
    ------
    InputError
        If there is no such folder, or no results in it.
    """
    path = Path(path)
    if not path.is_dir():
        what = "a file" if path.exists() else "no such folder"
        raise InputError(f"{path}: {what}; give the folder that process or benchmark wrote")
    found = _Found()
    for file in _files(path):
        try:
            _sort(file, file.relative_to(path).with_suffix("").as_posix(), found)
        except InputError as error:
            found.problems.append(str(error))
    points = _points(found)
    if not (points or found.tables or found.calibrations or found.studies):
        raise InputError(
            f"{path}: no results of process, benchmark or calibrate in it; "
            "give the folder named with their --out"
        )
    return ResultsFolder(
        path,
        points,
        found.tables,
        found.studies,
        found.calibrations,
        found.pictures,
        found.problems,
    )


def read_correction(path: Path) -> _Columns:
    """Read what ``correct`` wrote, as numbers [row]; empty cells are NaN."""
    return _numbers(path, read_csv(path))


def _files(folder: Path) -> Iterator[Path]:
    there = sorted(folder.iterdir())
    yield from (each for each in there if each.is_file())
    for inner in (each for each in there if each.is_dir()):
        with contextlib.suppress(OSError):  # a folder that may not be looked into is not ours
            yield from sorted(each for each in inner.iterdir() if each.is_file())


def _sort(file: Path, key: str, found: _Found) -> None:
    if file.suffix == ".nc":
        found.netcdf[key] = file
    elif file.suffix == ".csv":
        _sort_table(file, key, found)
    elif file.suffix == ".toml":
        kind = _kind(file)
        if kind in _CALIBRATIONS:
            found.calibrations.append((file, kind))
    elif file.suffix in _PICTURES and file.stem.startswith("figure-"):
        found.pictures.append(file)


def _sort_table(file: Path, key: str, found: _Found) -> None:
    header = _header(file)
    if header == _CORRECTION:
        found.corrections[file.stem] = file
    elif header == FIELD_COLUMNS:
        found.fields[key] = file
    elif header == LOG_COLUMNS:
        found.log += _rows(file)
    elif file.stem.startswith("inertial-"):
        found.studies[file.stem] = _rows(file)
    for name, start in _TABLES.items():
        if header[: len(start)] == start:
            found.tables.setdefault(name, []).extend(_rows(file))


def _header(file: Path) -> tuple[str, ...]:
    with contextlib.suppress(OSError), file.open("rb") as opened:
        line = opened.readline(4096).decode("utf-8-sig", errors="replace")
        return tuple(line.strip().split(","))
    return ()


def _rows(file: Path) -> list[Row]:
    columns = read_csv(file)
    return [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]


def _kind(file: Path) -> str:
    try:
        return str(tomllib.loads(file.read_text(encoding="utf-8")).get("kind", ""))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{file}: not a TOML file ({error}); write it again") from None


def _points(found: _Found) -> list[MeasuredPoint]:
    logged = {(row["run"], row["point"], row["trigger_time"]): row for row in found.log}
    errors = {(row["run"], row["point"]): row for row in found.tables.get("errors", ())}
    points = []
    keys = sorted(found.netcdf.keys() | found.fields.keys())
    names = Counter(key.rpartition("/")[2] for key in keys)
    for key in keys:
        try:
            values, attrs = _results(key, found)
        except InputError as error:
            found.problems.append(str(error))
            continue
        if "angle_deg" not in values:
            continue  # another program's file
        name = key.rpartition("/")[2]
        row = logged.get(_identity(attrs), {}) if attrs else _named(name, found.log)
        error_row = errors.get((row.get("run", ""), row.get("point", "")), {})
        correction = found.corrections.get(name)
        shown = name if names[name] == 1 else key
        points.append(MeasuredPoint(shown, values, attrs, row, error_row, correction))
    if all(point.attrs.get("trigger_time") for point in points):
        points.sort(key=lambda point: str(point.attrs["trigger_time"]))
    return points


def _identity(attrs: Mapping[str, Any]) -> tuple[str, str, str]:
    """Return what the log calls a point; it has no line breaks in it."""
    run, point = (" ".join(str(attrs.get(key, "")).splitlines()) for key in ("run", "point"))
    return run, point, str(attrs.get("trigger_time", ""))


def _named(name: str, log: Sequence[Row]) -> Row:
    return next((row for row in reversed(log) if row["point"] == name), {})


def _results(key: str, found: _Found) -> tuple[_Columns, Mapping[str, Any]]:
    if key not in found.netcdf:
        path = found.fields[key]
        return _numbers(path, read_csv(path)), {}
    return _netcdf(found.netcdf[key])


def _netcdf(path: Path) -> tuple[_Columns, Mapping[str, Any]]:
    import netCDF4  # noqa: PLC0415  slow to import

    try:
        with netCDF4.Dataset(path) as file:
            file.set_auto_mask(False)
            attrs = {name: file.getncattr(name) for name in file.ncattrs()}
            return {name: each[:] for name, each in file.variables.items()}, attrs
    except (OSError, RuntimeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); process the point again") from None


def _numbers(path: Path, columns: Mapping[str, Sequence[str]]) -> _Columns:
    try:
        return {
            name: np.array([float(cell or "nan") for cell in cells])
            for name, cells in columns.items()
        }
    except ValueError as error:
        raise InputError(f"{path}: not a table of numbers ({error}); write it again") from None
