"""Universal files (UFF, UNV): time records in data sets 58 and 58b."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.formats._channel_map import Recorded, mapped_record
from glint_aoa.records.formats._time_axis import TimeAxis, on_grid
from glint_aoa.setup import Inertial

__all__ = ["read_uff"]

MAX_BYTES = 1 << 28
"""A larger file is refused: it is held in memory as a whole, and text takes four times its size."""

_TIME_RESPONSE = 1
_AXES = {1: "x", 2: "y", 3: "z", 4: "rx", 5: "ry", 6: "rz"}


def read_uff(path: Path, inertial: Inertial | None = None) -> AcquisitionRecord:
    """Read the time records of a universal file.

    Parameters
    ----------
    path : Path
        The file; of its data sets, those of type 58 or 58b and function type 1 (time response)
        are read, evenly or unevenly spaced.
    inertial : Inertial, optional
        Section of the setup that completes the channels.

    Returns
    -------
    AcquisitionRecord
        One channel a data set, called by its response entity, else by its first identification
        line, else by node and direction, whichever tells all of them apart first; in the unit of
        its ordinate. The start is the least abscissa. The direction of a response is that of the
        survey's coordinates, so the model axis is left to the setup.

    Raises
    ------
    RecordingError
        If the file is damaged or cut short, holds no time records, times are irregular, or
        record and setup contradict each other.

    Notes
    -----
    An evenly spaced set states its step in six digits: a rate of 65 536 Hz comes back as
    65 535.95 Hz.
    """
    size = size_of(path)
    if size > MAX_BYTES:
        raise RecordingError(
            f"{path}: {size / 2**20:.0f} MiB, more than {MAX_BYTES / 2**20:.0f} MiB; "
            "export the record as TDMS or HDF5"
        )
    sets = _time_records(path)
    names = _names(sets)
    recorded = [_recorded(path, each, name) for each, name in zip(sets, names, strict=True)]
    return mapped_record(path, recorded, inertial)


def _time_records(path: Path) -> list[Mapping[str, Any]]:
    import pyuff  # noqa: PLC0415  only universal files need it

    with path.open("rb") as file:
        file.seek(-min(200, path.stat().st_size), 2)
        is_whole = file.read().rstrip().endswith(b"-1")
    if not is_whole:
        raise RecordingError(
            f"{path}: the last data set has no end; it is cut short, export or copy it again"
        )
    try:
        universal = pyuff.UFF(str(path))
        kinds = universal.get_set_types()
        numbers = [k for k, kind in enumerate(kinds) if kind == 58]
        found = [universal.read_sets(k) for k in numbers]
    except Exception as error:
        raise RecordingError(
            f"{path}: not a universal file or damaged ({error}); export or copy it again"
        ) from error
    records = [each for each in found if each["func_type"] == _TIME_RESPONSE]
    if not records:
        kinds_found = ", ".join(sorted({str(kind) for kind in kinds})) or "none"
        raise RecordingError(
            f"{path}: no time records (data set 58, function type 1) among its data sets "
            f"({kinds_found}); export the measured time histories"
        )
    return records


def _names(sets: list[Mapping[str, Any]]) -> list[str]:
    """Return a name for each data set, by the first of three sources that tells them apart."""
    places = [f"{each['rsp_node']}{_direction(each['rsp_dir'])}" for each in sets]
    for names in (_texts(sets, "rsp_ent_name"), _texts(sets, "id1"), places):
        if all(names) and len(set(names)) == len(names):
            return names
    return [f"{place} {number}" for number, place in enumerate(places, start=1)]


def _texts(sets: list[Mapping[str, Any]], key: str) -> list[str]:
    texts = [str(each.get(key, "")).strip() for each in sets]
    return ["" if text.upper() == "NONE" else text for text in texts]


def _direction(number: int) -> str:
    return ("-" if number < 0 else "+") + _AXES.get(abs(number), "")


def _recorded(path: Path, found: Mapping[str, Any], name: str) -> Recorded:
    where = f"{path}: channel {name}"
    samples = np.asarray(found["data"])
    expected = int(found["num_pts"])
    if samples.size < expected:
        raise RecordingError(
            f"{where}: {samples.size} of {expected} samples; it is cut short, export it again"
        )
    if np.iscomplexobj(samples):
        raise RecordingError(
            f"{where}: complex samples, expected a time record; export the measured time history"
        )
    samples = samples[:expected]
    unit = _texts([found], "ordinate_axis_units_lab")[0] or None
    if found["abscissa_spacing"] == 0:
        return _uneven(where, name, np.asarray(found["x"][:expected], np.float64), samples, unit)
    step = float(found["abscissa_inc"])
    if not 0 < step < float("inf"):
        raise RecordingError(
            f"{where}: abscissa increment is {step:g}; expected seconds above zero, correct it "
            "in the record"
        )
    return Recorded(name, samples, float(f"{1 / step:.9g}"), float(found["abscissa_min"]), unit)


def _uneven(
    where: str, name: str, times_s: NDArray[np.float64], samples: NDArray[Any], unit: str | None
) -> Recorded:
    axis = TimeAxis(where)
    places = axis.add(times_s)
    rate_hz, start_s, size = axis.finish()
    return Recorded(name, on_grid(places, size, samples), rate_hz, start_s, unit)
