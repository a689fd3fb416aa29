"""Recorded points: fields, acquisition and, where simulated, the truth in one HDF5 file."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from glint_aoa.records._files import replacing
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.formats.hdf5 import read_truth

__all__ = ["RecordedPoint", "read_truth", "write_point"]


@dataclass(frozen=True, eq=False)
class RecordedPoint:
    """Everything that is recorded at one point of a run.

    Attributes
    ----------
    fields : ndarray [field, line, column], FieldStack or None
        uint8 or uint16 grey levels; a stack is copied block by block, its own info, times and
        meta are not looked at.
    info : FieldInfo
        Rate, exposure, window and parity of the fields.
    fields_time_s : ndarray [field] or None
        Recorded starts of the exposures after the trigger [s].
    acquisition : AcquisitionRecord or None
        The acquisition channels, on the same trigger.
    truth : mapping of str to ndarray
        Of simulated points; names and units as in the file contract.
    meta : mapping of str to str, float or int
        Run, point, excitation, nominal angle, tunnel temperature, versions.
    """

    fields: NDArray[Any] | FieldStack | None = None
    info: FieldInfo = field(default_factory=FieldInfo)
    fields_time_s: NDArray[np.float64] | None = None
    acquisition: AcquisitionRecord | None = None
    truth: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    meta: Mapping[str, str | float | int] = field(default_factory=dict)


def write_point(
    path: str | Path,
    point: RecordedPoint,
    *,
    overwrite: bool = False,
    compress: bool = False,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Write a recorded point; the file appears under its name only when it is whole.

    Parameters
    ----------
    path : str or Path
        The HDF5 file.
    point : RecordedPoint
        What to write.
    overwrite : bool
        Whether a file of that name may be replaced.
    compress : bool
        Whether the fields are packed (gzip, fastest level): about half the size, but writing and
        reading take some ten times as long.
    progress : callable, optional
        Called after each block with the number of fields that it held.

    Raises
    ------
    OutputError
        If the file exists and `overwrite` is False, or it cannot be written.
    RecordingError
        If the fields are not uint8 or uint16 [field, line, column], or their times do not match.
    """
    path = Path(path)
    stack = _checked(path, point)
    with (
        replacing(path, overwrite=overwrite) as temporary,
        h5py.File(temporary, "w-", track_order=True) as file,
    ):
        _write_fields(file, stack, compress=compress, progress=progress)
        _write_acquisition(file, point.acquisition)
        if point.truth:
            _write_arrays(file.create_group("truth", track_order=True), point.truth)
        file.create_group("meta").attrs.update(point.meta)


def _checked(path: Path, point: RecordedPoint) -> FieldStack | None:
    if isinstance(point.fields, FieldStack):
        return point.fields.restated(point.info, times_s=point.fields_time_s)
    if point.fields is None:
        return None
    return FieldStack.from_array(point.fields, point.info, times_s=point.fields_time_s, path=path)


def _write_fields(
    file: h5py.File,
    stack: FieldStack | None,
    *,
    compress: bool,
    progress: Callable[[int], None] | None,
) -> None:
    if stack is None:
        return
    packing = {"compression": "gzip", "compression_opts": 1} if compress else {}
    chunks = (1, *stack.shape[1:])
    fields = file.create_dataset("fields", stack.shape, stack.dtype, chunks=chunks, **packing)
    for start, block in stack.blocks():
        fields[start : start + len(block)] = block
        if progress is not None:
            progress(len(block))
    top = int(np.iinfo(stack.dtype).max)
    white = None if stack.white_level == top else stack.white_level
    _write_attributes(fields, {**dataclasses.asdict(stack.info), "white_level": white})
    if stack.times_s is not None:
        file.create_dataset("fields_time", data=np.asarray(stack.times_s, np.float64))


def _write_acquisition(file: h5py.File, record: AcquisitionRecord | None) -> None:
    if record is None:
        return
    group = file.create_group("das", track_order=True)
    for name, channel in record.channels.items():
        dataset = group.create_dataset(name, channel.samples.shape, channel.samples.dtype)
        for start, piece in channel.blocks():
            dataset[start : start + len(piece)] = piece.samples
        _write_attributes(dataset, _channel_attributes(channel))


def _channel_attributes(channel: Channel) -> dict[str, object]:
    return {
        "rate_hz": channel.rate_hz,
        "start_s": channel.start_s,
        "quantity": channel.quantity,
        "units": channel.units,
        "scale": channel.scale,
        "station_m": channel.station_m,
        "axis": channel.axis,
        "range": channel.limits,
    }


def _write_arrays(group: h5py.Group, arrays: Mapping[str, NDArray[Any]]) -> None:
    for name, array in arrays.items():
        group.create_dataset(name, data=array)


def _write_attributes(owner: h5py.HLObject, attributes: Mapping[str, object]) -> None:
    owner.attrs.update({key: value for key, value in attributes.items() if value is not None})
