"""Recorded points in HDF5: fields in ``/fields``, acquisition channels in ``/das``.

Nothing outside the file is ever opened: links, external storage and virtual datasets are refused.
"""

import contextlib
import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.acquisition import AcquisitionRecord, Channel, LazySamples
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.formats._channel_map import (
    CHANNEL_KEYS,
    EAGER_BYTES,
    Recorded,
    channel_map,
    check_present,
    mapped_channel,
    stated_rate_and_start,
)
from glint_aoa.records.formats._hdf5_storage import check_heaps, check_inside, check_storage
from glint_aoa.setup import Axis, Inertial
from glint_aoa.units import convert

__all__ = [
    "has_acquisition",
    "has_fields",
    "open_hdf5",
    "read_acquisition",
    "read_meta",
    "read_truth",
]

MAX_TRUTH_BYTES = 1 << 30
"""What the truth of one point may take in memory [bytes]."""

_MOST_ATTRIBUTE_BYTES = 1 << 16
_PLAIN = {h5py.h5t.INTEGER, h5py.h5t.FLOAT, h5py.h5t.STRING, h5py.h5t.ENUM}


def open_hdf5(path: Path) -> FieldStack:
    """Open the fields of a recorded point.

    Parameters
    ----------
    path : Path
        The HDF5 file.

    Returns
    -------
    FieldStack
        The fields, their attributes, timestamps where there are any, and ``/meta``.

    Raises
    ------
    RecordingError
        If the file is not HDF5 or is damaged, has no ``/fields`` of uint8 or uint16, leads
        outside itself, or an attribute is wrong.
    """

    def read(start: int, stop: int) -> NDArray[Any]:
        with _opened(path) as file:
            return np.asarray(_dataset(path, file, "fields")[start:stop])

    with _opened(path) as file:
        if not _holds(file, "fields"):
            found = ", ".join(file) or "nothing"
            raise RecordingError(
                f"{path}: no dataset /fields, found {found}; "
                "store the fields as /fields [field, line, column]"
            )
        fields = _dataset(path, file, "fields")
        stack = FieldStack(
            path,
            fields.shape,
            fields.dtype,
            read,
            _field_info(path, fields),
            _field_times(path, file),
            _meta(path, file),
            white_level=_white_level(path, fields),
        )
        check_storage(path, fields)
    return stack


def has_acquisition(path: str | Path) -> bool:
    """Return whether a recorded point holds acquisition channels.

    Raises
    ------
    RecordingError
        If the file is not HDF5 or is damaged.
    """
    with _opened(Path(path)) as file:
        return _holds(file, "das")


def has_fields(path: str | Path) -> bool:
    """Return whether a recorded point holds fields.

    Raises
    ------
    RecordingError
        If the file is not HDF5 or is damaged.
    """
    with _opened(Path(path)) as file:
        return _holds(file, "fields")


def read_acquisition(path: str | Path, inertial: Inertial | None = None) -> AcquisitionRecord:
    """Read the acquisition channels of a recorded point.

    Parameters
    ----------
    path : str or Path
        The HDF5 file.
    inertial : Inertial, optional
        Section of the setup; its channels complete what the file does not say.

    Returns
    -------
    AcquisitionRecord
        All channels of the file, in its order; the samples of a long record stay in the file.

    Raises
    ------
    RecordingError
        If the file is not HDF5 or is damaged, has no ``/das``, an attribute is wrong, file and
        setup contradict each other, or a channel of the setup is not in the record.
    """
    path = Path(path)
    with _opened(path) as file:
        if not _holds(file, "das"):
            raise RecordingError(
                f"{path}: no group /das; record the acquisition channels with the fields"
            )
        group = _group(path, file, "das")
        check_present(path, list(group), list(channel_map(inertial)))
        datasets = [_numbers(path, _dataset(path, group, name)) for name in group]
        is_long = sum(_n_bytes(dataset) for dataset in datasets) > EAGER_BYTES
        channels = {
            name: _channel(path, _samples(path, dataset, is_long=is_long), dataset, inertial)
            for name, dataset in zip(group, datasets, strict=True)
        }
        return AcquisitionRecord(path.stem, channels, _meta(path, file))


def read_meta(path: str | Path) -> dict[str, object]:
    """Read what a recorded point says of itself, whether it holds fields, channels or both.

    Parameters
    ----------
    path : str or Path
        The HDF5 file.

    Returns
    -------
    dict of str to str, bool, number or list
        The attributes of ``/meta``; empty where there is none.

    Raises
    ------
    RecordingError
        If the file is not HDF5 or is damaged.
    """
    path = Path(path)
    with _opened(path) as file:
        return _meta(path, file)


def read_truth(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read the truth of a simulated point.

    Parameters
    ----------
    path : str or Path
        The HDF5 file.

    Returns
    -------
    dict of str to ndarray
        By the names of the file contract; empty for a point that was not simulated.

    Raises
    ------
    RecordingError
        If the file is not HDF5 or is damaged.
    """
    path = Path(path)
    with _opened(path) as file:
        if not _holds(file, "truth"):
            return {}
        group = _group(path, file, "truth")
        budget = _Budget(path)
        return {name: budget.spend(_dataset(path, group, name))[()] for name in group}


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """Open a file to read; whatever HDF5 makes of its content is one of our own errors."""
    size_of(path)
    try:
        check_heaps(path)
        with h5py.File(path, "r") as file:
            yield file
    except RecordingError:
        raise
    except Exception as error:
        raise RecordingError(
            f"{path}: not an HDF5 file or damaged ({error}); record or copy it again"
        ) from error


def _holds(group: h5py.Group, name: str) -> bool:
    """Whether there is such a name; unlike ``in``, without following where it leads."""
    return bool(group.id.links.exists(name.encode()))


def _member(path: Path, group: h5py.Group, name: str) -> Any:
    if not isinstance(group.get(name, getlink=True), h5py.HardLink):
        raise RecordingError(
            f"{path}: {_place(group, name)} is a link, and links are not followed; "
            "store the data in the file itself"
        )
    return group[name]


def _place(group: h5py.Group, name: str) -> str:
    return f"{group.name.rstrip('/')}/{name}"


def _group(path: Path, parent: h5py.Group, name: str) -> h5py.Group:
    group = _member(path, parent, name)
    if not isinstance(group, h5py.Group):
        raise RecordingError(
            f"{path}: {_place(parent, name)} is no group; store each channel as a dataset in it"
        )
    return group


def _dataset(path: Path, parent: h5py.Group, name: str) -> h5py.Dataset:
    dataset = _member(path, parent, name)
    place = _place(parent, name)
    if not isinstance(dataset, h5py.Dataset) or dataset.shape is None:
        raise RecordingError(f"{path}: {place} is no array; store it as a dataset")
    check_inside(path, dataset)
    return dataset


def _n_bytes(dataset: h5py.Dataset) -> int:
    return int(math.prod(dataset.shape) * dataset.dtype.itemsize)


def _numbers(path: Path, dataset: h5py.Dataset) -> h5py.Dataset:
    """Return a dataset that holds numbers, all of them stored."""
    if dataset.dtype.kind not in "iufb":
        raise RecordingError(
            f"{path}: {dataset.name} holds {dataset.dtype}, expected numbers; "
            "store the samples as recorded"
        )
    check_storage(path, dataset)
    return dataset


def _samples(path: Path, dataset: h5py.Dataset, *, is_long: bool) -> NDArray[Any] | LazySamples:
    if not is_long or dataset.ndim != 1:
        return np.asarray(dataset[()])
    group, _, name = dataset.name.rpartition("/")

    def read(start: int, stop: int) -> NDArray[Any]:
        with _opened(path) as file:
            return np.asarray(_dataset(path, file[group], name)[start:stop])

    return LazySamples(dataset.size, dataset.dtype, read)


@dataclasses.dataclass
class _Budget:
    """Lets datasets through until they would take more memory than any record needs."""

    path: Path
    spent: int = 0

    def spend(self, dataset: h5py.Dataset) -> h5py.Dataset:
        """Return `dataset`, checked against the file and the memory that is left."""
        self.spent += _n_bytes(_numbers(self.path, dataset))
        if self.spent > MAX_TRUTH_BYTES:
            raise RecordingError(
                f"{self.path}: {dataset.name} and what stands before it take more than "
                f"{MAX_TRUTH_BYTES >> 30} GiB; split the record"
            )
        return dataset


def _field_info(path: Path, fields: h5py.Dataset) -> FieldInfo:
    said = {field.name: _stated(fields, field.name) for field in dataclasses.fields(FieldInfo)}
    try:
        return FieldInfo(**said)
    except RecordingError as error:
        raise RecordingError(
            f"{path}: /fields attribute {error}; correct it or leave it out"
        ) from None


def _white_level(path: Path, fields: h5py.Dataset) -> int | None:
    level = _stated(fields, "white_level")
    if level is None:
        return None
    if isinstance(level, bool) or not isinstance(level, int | float) or level < 1 or level % 1:
        raise RecordingError(
            f"{path}: /fields attribute white_level is {level!r}; expected a whole number from 1; "
            "correct it or leave it out"
        )
    return int(level)


def _field_times(path: Path, file: h5py.File) -> NDArray[np.float64] | None:
    if not _holds(file, "fields_time"):
        return None
    times = _Budget(path).spend(_dataset(path, file, "fields_time"))
    return np.asarray(times[()], np.float64)


def _meta(path: Path, file: h5py.File) -> dict[str, object]:
    if not _holds(file, "meta"):
        return {}
    meta = _member(path, file, "meta")
    return {name: _attribute(meta, name) for name in meta.attrs}


def _attribute(owner: h5py.HLObject, name: str) -> Any:
    """Return an attribute as plain Python: str, bool, number or list; None where it is missing."""
    attributes = owner.attrs
    if name not in attributes:
        return None
    stored = attributes.get_id(name)
    if stored.get_type().get_class() not in _PLAIN:
        raise ValueError(f"attribute {name} of {owner.name} is neither numbers nor text")
    if stored.get_storage_size() > _MOST_ATTRIBUTE_BYTES:
        raise ValueError(f"attribute {name} of {owner.name} is too large")
    value = attributes[name]
    if isinstance(value, np.ndarray):
        value = value.item() if value.size == 1 else [_text(each) for each in value.ravel()]
    return _text(value)


def _stated(owner: h5py.HLObject, name: str) -> Any:
    """Return an attribute, or None where it is missing or an empty text."""
    value = _attribute(owner, name)
    return None if isinstance(value, str) and not value else value


def _unless_nan(value: Any) -> Any:
    """Return None for NaN: what writers that fill in every attribute give a moment's station."""
    numbers = value if isinstance(value, list) else [value]
    is_nan = all(isinstance(each, float) and math.isnan(each) for each in numbers)
    return None if is_nan else value


def _text(value: object) -> object:
    plain = value.item() if isinstance(value, np.generic) else value
    return plain.decode("utf-8", errors="replace") if isinstance(plain, bytes) else plain


def _channel(
    path: Path,
    samples: NDArray[Any] | LazySamples,
    dataset: h5py.Dataset,
    inertial: Inertial | None,
) -> Channel:
    name = dataset.name.rpartition("/")[2]
    where = f"{path}: channel {name}"
    rate = _attribute(dataset, "rate_hz")
    if rate is not None or inertial is None or inertial.rate is None:
        rate = _positive(where, "rate_hz", rate)
    start_s = _number(where, "start_s", _attribute(dataset, "start_s"))
    clock = stated_rate_and_start(path, rate, start_s, inertial)
    recorded = Recorded(name, samples, *clock, keys=_channel_attributes(where, dataset))
    return mapped_channel(path, recorded, channel_map(inertial).get(name))


def _channel_attributes(where: str, dataset: h5py.Dataset) -> dict[str, Any]:
    value = {key: _stated(dataset, key) for key in CHANNEL_KEYS}
    return {
        # A record may hold what nobody here asks for; a name that is not known is just not used.
        "quantity": None if value["quantity"] is None else str(value["quantity"]),
        "units": _unit(where, value["units"]),
        "scale": _number(where, "scale", value["scale"]),
        "station_m": _number(where, "station_m", _unless_nan(value["station_m"])),
        "axis": _choice(where, "axis", value["axis"], get_args(Axis)),
        "range": _range(where, _unless_nan(value["range"])),
    }


def _wrong(where: str, key: str, value: object, expected: str) -> RecordingError:
    return RecordingError(
        f"{where}: attribute {key} is {value!r}, expected {expected}; correct it in the record"
    )


def _number(where: str, key: str, value: object) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _wrong(where, key, value, "a finite number")
    return float(value)


def _positive(where: str, key: str, value: object) -> float:
    number = None if value is None else _number(where, key, value)
    if number is None or number <= 0:
        raise _wrong(where, key, value, "a number greater than zero")
    return number


def _choice(where: str, key: str, value: object, choices: tuple[str, ...]) -> str | None:
    if value is not None and value not in choices:
        raise _wrong(where, key, value, f"one of {', '.join(choices)}")
    return None if value is None else str(value)


def _unit(where: str, value: object) -> str | None:
    if value is None:
        return None
    try:
        convert(str(value), str(value))
    except ValueError:
        raise _wrong(where, "units", value, "a unit as pint names it") from None
    return str(value)


def _range(where: str, value: object) -> tuple[float, float] | None:
    if value is None:
        return None
    numbers = [_number(where, "range", each) for each in value] if isinstance(value, list) else []
    match numbers:
        case [float(low), float(high)] if low < high:
            return low, high
    raise _wrong(where, "range", value, "least and greatest value")
