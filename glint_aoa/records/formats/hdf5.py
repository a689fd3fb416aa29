"""Recorded points in HDF5: fields in ``/fields``, acquisition channels in ``/das``.

Nothing outside the file is ever opened: links, external storage and virtual datasets are refused.
"""

import contextlib
import dataclasses
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.fields import MAX_FIELD_BYTES, FieldInfo, FieldStack
from glint_aoa.setup import Axis, Inertial, InertialChannel
from glint_aoa.units import convert

__all__ = ["has_acquisition", "open_hdf5", "read_acquisition", "read_truth"]

MAX_RECORD_BYTES = 1 << 30
"""What the channels of one record may take in memory together [bytes]."""

_MOST_ATTRIBUTE_BYTES = 1 << 16
_SINGLE_PRECISION = 1e-6  # relative; attributes are often stored as float32
_CHANNEL_KEYS = ("quantity", "units", "scale", "station_m", "axis", "range")


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
        )
        _check_storage(path, fields)
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
        All channels of the file, in its order.

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
        said = {channel.name: channel for channel in (inertial.channel if inertial else ())}
        _check_present(path, list(group), list(said))
        budget = _Budget(path)
        channels = {
            name: _channel(path, budget.spend(_dataset(path, group, name)), said.get(name))
            for name in group
        }
        return AcquisitionRecord(path.stem, channels, _meta(path, file))


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
    plist = dataset.id.get_create_plist()
    if plist.get_layout() == h5py.h5d.VIRTUAL or plist.get_external_count():
        raise RecordingError(
            f"{path}: {place} keeps its data in other files, which are not followed; "
            "store the data in the file itself"
        )
    return dataset


def _check_storage(path: Path, dataset: h5py.Dataset) -> None:
    """Hold a dataset's shape against what the file stores for it, before anything is allocated."""
    chunks = dataset.chunks
    n_bytes = math.prod(dataset.shape) * dataset.dtype.itemsize
    if chunks is None:
        is_whole = dataset.id.get_storage_size() >= n_bytes
    else:
        n_chunks = math.prod(
            math.ceil(n / chunk) for n, chunk in zip(dataset.shape, chunks, strict=True)
        )
        is_whole = dataset.id.get_num_chunks() >= n_chunks
        if math.prod(chunks) * dataset.dtype.itemsize > 2 * MAX_FIELD_BYTES:
            raise RecordingError(
                f"{path}: {dataset.name} is stored in chunks of {list(chunks)}, too large to read "
                "piece by piece; store it chunked by field"
            )
    if not is_whole:
        raise RecordingError(
            f"{path}: {dataset.name} promises {list(dataset.shape)} of {dataset.dtype}, but the "
            "file stores less; it is cut short, record or copy it again"
        )


@dataclasses.dataclass
class _Budget:
    """Lets datasets through until they would take more memory than any record needs."""

    path: Path
    spent: int = 0

    def spend(self, dataset: h5py.Dataset) -> h5py.Dataset:
        """Return `dataset`, checked against the file and the memory that is left."""
        if dataset.dtype.kind not in "iufb":
            raise RecordingError(
                f"{self.path}: {dataset.name} holds {dataset.dtype}, expected numbers; "
                "store the samples as recorded"
            )
        _check_storage(self.path, dataset)
        self.spent += math.prod(dataset.shape) * dataset.dtype.itemsize
        if self.spent > MAX_RECORD_BYTES:
            raise RecordingError(
                f"{self.path}: {dataset.name} and what stands before it take more than "
                f"{MAX_RECORD_BYTES >> 30} GiB; split the record"
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
    if name not in owner.attrs:
        return None
    if owner.attrs.get_id(name).get_storage_size() > _MOST_ATTRIBUTE_BYTES:
        raise ValueError(f"attribute {name} of {owner.name} is too large")
    value = owner.attrs[name]
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


def _check_present(path: Path, present: list[str], wanted: list[str]) -> None:
    missing = [name for name in wanted if name not in present]
    if missing:
        raise RecordingError(
            f"{path}: channel {missing[0]} of the setup is not in the record; "
            f"channels here: {', '.join(present) or 'none'}"
        )


def _channel(path: Path, dataset: h5py.Dataset, said: InertialChannel | None) -> Channel:
    name = dataset.name.rpartition("/")[2]
    where = f"{path}: channel {name}"
    keys = _merged(where, _channel_attributes(where, dataset), _said_by_setup(said))
    rate_hz = _positive(where, "rate_hz", _attribute(dataset, "rate_hz"))
    start_s = _number(where, "start_s", _attribute(dataset, "start_s"))
    try:
        return Channel(
            name,
            dataset[()],
            rate_hz,
            0.0 if start_s is None else start_s,
            quantity=keys["quantity"],
            units=keys["units"],
            scale=1.0 if keys["scale"] is None else keys["scale"],
            station_m=keys["station_m"],
            axis=keys["axis"],
            limits=keys["range"],
        )
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None


def _channel_attributes(where: str, dataset: h5py.Dataset) -> dict[str, Any]:
    value = {key: _stated(dataset, key) for key in _CHANNEL_KEYS}
    return {
        # A record may hold what nobody here asks for; a name that is not known is just not used.
        "quantity": None if value["quantity"] is None else str(value["quantity"]),
        "units": _unit(where, value["units"]),
        "scale": _number(where, "scale", value["scale"]),
        "station_m": _number(where, "station_m", _unless_nan(value["station_m"])),
        "axis": _choice(where, "axis", value["axis"], get_args(Axis)),
        "range": _range(where, _unless_nan(value["range"])),
    }


def _said_by_setup(said: InertialChannel | None) -> dict[str, Any]:
    if said is None:
        return dict.fromkeys(_CHANNEL_KEYS)
    return {
        "quantity": said.quantity,
        "units": said.units,
        "scale": said.scale if "scale" in said.model_fields_set else None,
        "station_m": said.station,
        "axis": said.axis,
        "range": said.limits,
    }


def _merged(where: str, recorded: Mapping[str, Any], said: Mapping[str, Any]) -> dict[str, Any]:
    for key in _CHANNEL_KEYS:
        both = recorded[key] is not None and said[key] is not None
        if both and not _agree(key, recorded[key], said[key]):
            raise RecordingError(
                f"{where}: {key} is {recorded[key]} in the record but {said[key]} in the setup; "
                "correct the setup or leave it out there"
            )
    return {key: said[key] if recorded[key] is None else recorded[key] for key in _CHANNEL_KEYS}


def _agree(key: str, recorded: Any, said: Any) -> bool:
    if key == "units":
        return _same_unit(recorded, said)
    if isinstance(recorded, str):
        return bool(recorded == said)
    return bool(np.allclose(recorded, said, rtol=_SINGLE_PRECISION, atol=0.0))


def _same_unit(recorded: str, said: str) -> bool:
    """Whether two spellings are one unit, such as ``m/s^2`` and ``m/s**2``."""
    try:
        return recorded == said or math.isclose(convert(recorded, said), 1.0, rel_tol=1e-12)
    except ValueError:
        return False


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
