"""Write a fused attitude: one row a sample, as CSV and NetCDF."""

from pathlib import Path
from typing import Any

import numpy as np

from glint_aoa.fusion.result import FusedAttitude
from glint_aoa.records._files import check_new, make_folder
from glint_aoa.records.tables import write_csv, write_netcdf

__all__ = ["fused_files", "write_fused"]

_UNITS_AND_MEANING = {
    "time_s": ("s", "time after the trigger"),
    "pitch_deg": ("deg", "instantaneous pitch, nose up positive"),
    "pitch_std_deg": ("deg", "its standard deviation, 1 sigma"),
    "yaw_deg": ("deg", "heading, right-handed about tunnel +Z"),
    "yaw_std_deg": ("deg", "standard deviation of its fast part, 1 sigma"),
    "pitch_yaw_covariance_deg2": ("deg^2", "covariance of pitch and yaw"),
    "flags": ("1", "bit mask, 0 for good"),
}

_FORMATS = {
    "time_s": ".6f",
    "pitch_deg": ".6f",
    "pitch_std_deg": ".6f",
    "yaw_deg": ".6f",
    "yaw_std_deg": ".6f",
    "pitch_yaw_covariance_deg2": ".4e",
    "flags": "d",
}


def fused_files(folder: str | Path, name: str) -> tuple[Path, Path]:
    """Return the files of a point's fused attitude: table and NetCDF."""
    return Path(folder) / f"{name}-fused.csv", Path(folder) / f"{name}-fused.nc"


def write_fused(
    folder: str | Path, name: str, fused: FusedAttitude, *, overwrite: bool = False
) -> tuple[Path, Path]:
    """Write ``<name>-fused.csv`` and ``<name>-fused.nc``.

    Parameters
    ----------
    folder : str or Path
        Where to; it is made if it is not there.
    name : str
        Name of the point.
    fused : FusedAttitude
        What to write; modes, unknowns and consistency go into the attributes of the NetCDF.
    overwrite : bool
        Whether files of these names may be replaced.

    Returns
    -------
    tuple of Path
        The files written.

    Raises
    ------
    OutputError
        If a file exists and `overwrite` is False, or it cannot be written.
    """
    table, netcdf = fused_files(folder, name)
    if not overwrite:
        check_new([table, netcdf])
    make_folder(table.parent)
    columns = {column: getattr(fused, column) for column in _UNITS_AND_MEANING}
    write_csv(table, columns, formats=_FORMATS)
    described = {
        column: {"units": unit, "long_name": meaning}
        for column, (unit, meaning) in _UNITS_AND_MEANING.items()
    }
    write_netcdf(netcdf, columns, attrs=_attributes(name, fused), column_attrs=described)
    return table, netcdf


def _attributes(name: str, fused: FusedAttitude) -> dict[str, Any]:
    """Everything beside the columns; lists by mode, by unknown and by source."""
    modes, unknowns = fused.modes, fused.unknowns
    return {
        "title": f"glint-aoa fused attitude of {name}",
        "notes": "; ".join(fused.notes),
        "mode_plane": ", ".join(mode.plane for mode in modes),
        "mode_number": [mode.number or 0 for mode in modes],
        "mode_frequency_hz": [mode.frequency_hz for mode in modes],
        "mode_radius_m": [mode.radius_m for mode in modes],
        "mode_radius_std_m": [mode.radius_std_m for mode in modes],
        "unknown_name": ", ".join(unknowns),
        "unknown_value": [value for value, _ in unknowns.values()],
        "unknown_std": [std for _, std in unknowns.values()],
        "consistency_source": ", ".join(fused.consistency),
        "consistency": list(fused.consistency.values()),
        **{key: _plain(value) for key, value in fused.settings.items()},
    }


def _plain(value: object) -> object:
    return value.item() if isinstance(value, np.generic) else value
