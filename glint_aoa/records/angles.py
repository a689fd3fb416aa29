"""The results of a point: one row a field as CSV and NetCDF, one row a point in the log."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from glint_aoa.records._files import check_new, make_folder
from glint_aoa.records.tables import append_log, write_csv, write_netcdf

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "FIELD_COLUMNS",
    "LOG_COLUMNS",
    "angle_record",
    "check_new_results",
    "log_result",
    "result_files",
    "write_results",
]

_UNITS_AND_MEANING = {
    "field": ("1", "number of the field in its recording"),
    "time_s": ("s", "middle of the exposure after the trigger"),
    "parity": ("1", "0 even field, 1 odd field"),
    "angle_deg": ("deg", "pitch, nose up positive, after calibration where one is applied"),
    "angle_std_deg": ("deg", "the field's own noise, 1 sigma"),
    "intercept_mm": ("mm", "the line's Z at X = 0"),
    "intercept_std_mm": ("mm", "the field's own noise, 1 sigma"),
    "columns_used": ("1", "columns that entered the line"),
    "rms_residual_mm": ("mm", "rms departure of the centres from the line"),
    "flags": ("1", "bit mask, 0 for good"),
    "angle_raw_deg": ("deg", "pitch before calibration"),
    "angle_systematic_std_deg": ("deg", "uncertainty of the calibration, 1 sigma"),
}

FIELD_COLUMNS = (
    "field",
    "time_s",
    "parity",
    "angle_deg",
    "angle_std_deg",
    "intercept_mm",
    "intercept_std_mm",
    "columns_used",
    "rms_residual_mm",
    "flags",
)
"""Columns of ``<point>.csv``, in order."""

LOG_COLUMNS = (
    "run",
    "point",
    "trigger_time",
    "n_fields",
    "n_used",
    "mean_angle_deg",
    "std_angle_deg",
    "mean_angle_std_deg",
    "mean_angle_u95_deg",
    "mean_method",
    "mean_intercept_mm",
    "std_intercept_mm",
    "flags",
    "setup_hash",
)
"""Columns of ``log.csv``, in order."""

_FORMATS = {
    "time_s": ".6f",
    "angle_deg": ".6f",
    "angle_std_deg": ".6f",
    "intercept_mm": ".6f",
    "intercept_std_mm": ".6f",
    "rms_residual_mm": ".6f",
}


def angle_record(values: Mapping[str, NDArray[Any]], attrs: Mapping[str, Any]) -> "xr.Dataset":
    """Make the record of a point's fields.

    Parameters
    ----------
    values : mapping of str to ndarray, shape (field,)
        The columns of `FIELD_COLUMNS`, ``angle_raw_deg`` and ``angle_systematic_std_deg``.
    attrs : mapping
        Settings and provenance.

    Returns
    -------
    Dataset
        Over ``field``, each variable with ``units`` and ``long_name``.
    """
    import xarray as xr  # noqa: PLC0415  slow to import

    described = {
        name: ("field", values[name], {"units": unit, "long_name": meaning})
        for name, (unit, meaning) in _UNITS_AND_MEANING.items()
    }
    number = described.pop("field")
    return xr.Dataset(described, coords={"field": number}, attrs=dict(attrs))


def result_files(folder: Path, name: str) -> tuple[Path, Path]:
    """Return the files of a point's results: table and NetCDF."""
    return folder / f"{name}.csv", folder / f"{name}.nc"


def check_new_results(folder: Path, name: str) -> None:
    """Refuse to write where a point of that name has been written before.

    Raises
    ------
    OutputError
        If `folder` holds results of `name`.
    """
    check_new(result_files(folder, name))


def write_results(
    folder: Path, name: str, values: Mapping[str, NDArray[Any]], attrs: Mapping[str, Any]
) -> None:
    """Write ``<name>.csv`` and ``<name>.nc``.

    Parameters
    ----------
    folder : Path
        Where; made if it is not there.
    name : str
        Name of the point's files.
    values, attrs : mapping
        As for `angle_record`.

    Raises
    ------
    OutputError
        If the folder cannot be made or written to.
    """
    make_folder(folder)
    table, netcdf = result_files(folder, name)
    write_csv(table, {column: values[column] for column in FIELD_COLUMNS}, formats=_FORMATS)
    described = {
        column: {"units": unit, "long_name": meaning}
        for column, (unit, meaning) in _UNITS_AND_MEANING.items()
    }
    columns = {column: values[column] for column in described}
    write_netcdf(netcdf, columns, attrs=attrs, column_attrs=described)


def log_result(folder: Path, row: Mapping[str, object]) -> None:
    """Append a point to ``log.csv``; last of all, so that a point in the log has its files.

    Raises
    ------
    OutputError
        If the log has other columns, or cannot be written.
    """
    append_log(folder / "log.csv", row, LOG_COLUMNS)
