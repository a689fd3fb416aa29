"""MATLAB files: up to v7 through SciPy, v7.3 through h5py."""

import contextlib
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

import h5py
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
    stated_rate_and_start,
)
from glint_aoa.records.formats._hdf5_storage import check_heaps, check_inside, check_storage
from glint_aoa.records.formats._matlab5 import check_frame
from glint_aoa.records.formats._time_axis import TimeAxis, is_time_name, on_grid, time_unit_s
from glint_aoa.setup import Axis, Inertial

__all__ = ["read_matlab"]

_RATE_NAMES = ("rate_hz", "rate", "fs", "sample_rate", "sampling_rate", "samplerate")
_STEP_NAMES = ("dt", "ts", "sample_time", "sampling_interval")
_START_NAMES = ("start_s", "start", "t0")
_SAMPLES = ("samples", "data", "values", "y")
_HDF5 = b"\x89HDF\r\n\x1a\n"
_USER_BLOCK = 512

_Value = Any  # an array of numbers, LazySamples, str, list of str, or a mapping of these


def read_matlab(path: Path, inertial: Inertial | None = None) -> AcquisitionRecord:
    """Read an acquisition record that was saved from MATLAB.

    Parameters
    ----------
    path : Path
        The file, of any version from 4 to 7.3. A channel is a variable that is a vector of
        numbers, a structure with ``samples`` (``data``, ``values``, ``y``) and what else is
        known of it (``units``, ``rate_hz``, ``quantity`` ...), or a column of a matrix ``data``
        beside a cell array ``names``. Times stand in a vector ``t`` or ``time``; else a number
        ``fs``, ``rate_hz`` or ``dt``, or the setup, says the rate.
    inertial : Inertial, optional
        Section of the setup that completes the channels.

    Returns
    -------
    AcquisitionRecord
        The channels by the names of their variables. Of a long v7.3 file, the samples stay in
        the file.

    Raises
    ------
    RecordingError
        If the file is damaged, holds no vectors of numbers, has no rate, or record and setup
        contradict each other.
    """
    size_of(path)
    variables = _variables_7_3(path) if _is_hdf5(path) else _variables_5(path)
    try:
        recorded = list(_recorded(path, variables, inertial))
    except RecordingError:
        raise
    except Exception as error:
        raise _damaged(path, error) from error
    return mapped_record(path, recorded, inertial, _texts(variables))


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(_USER_BLOCK + len(_HDF5))
    return head.startswith(_HDF5) or head[_USER_BLOCK:] == _HDF5


def _damaged(path: Path, error: Exception) -> RecordingError:
    return RecordingError(f"{path}: not a MATLAB file or damaged ({error}); save or copy it again")


def _variables_5(path: Path) -> dict[str, _Value]:
    import scipy.io  # noqa: PLC0415  slow to import, and only these files need it

    try:
        check_frame(path)
        content = scipy.io.loadmat(path, simplify_cells=True)
    except Exception as error:
        raise _damaged(path, error) from error
    return {name: _plain(value) for name, value in content.items() if not name.startswith("__")}


def _plain(value: Any) -> _Value:
    """Return what SciPy made of a variable as the few kinds that are looked at here."""
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, np.ndarray) and value.dtype.kind in "OUS":
        return [str(each) for each in value.ravel()]
    if isinstance(value, int | float | complex | np.number | np.bool_):
        return np.atleast_1d(np.asarray(value))
    return value


def _variables_7_3(path: Path) -> dict[str, _Value]:
    try:
        check_heaps(path)
        with h5py.File(path, "r") as file:
            found = {name: _stored(path, file, name) for name in _own(file)}
    except RecordingError:
        raise
    except Exception as error:
        raise _damaged(path, error) from error
    return found


def _own(group: h5py.Group) -> Iterator[str]:
    """Names in a group that are stored in the file itself; MATLAB's own stores begin with #."""
    for name in group:
        if not name.startswith("#") and isinstance(group.get(name, getlink=True), h5py.HardLink):
            yield name


def _stored(path: Path, group: h5py.Group, name: str) -> _Value:
    item = group[name]
    if isinstance(item, h5py.Group):
        return {key: _stored(path, item, key) for key in _own(item)}
    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if kind == "char":
        return _characters(item)
    if item.dtype == h5py.ref_dtype:
        cells = [item.file[reference] for reference in np.asarray(item[()]).ravel()]
        return [_characters(cell) for cell in cells if isinstance(cell, h5py.Dataset)]
    if item.dtype.kind not in "iufb" or "MATLAB_empty" in item.attrs:
        return None
    return _numbers(path, item)


def _characters(item: h5py.Dataset) -> str:
    codes = np.asarray(item[()]).ravel()
    return "" if codes.dtype.kind not in "ui" else "".join(map(chr, codes.tolist()))


def _numbers(path: Path, item: h5py.Dataset) -> NDArray[Any] | LazySamples:
    """Return an array as MATLAB showed it, or a long vector as samples that stay in the file."""
    check_inside(path, item)
    check_storage(path, item)
    is_vector = sum(length > 1 for length in item.shape) == 1
    if not is_vector or item.size * item.dtype.itemsize <= EAGER_BYTES:
        return np.asarray(item[()]).T
    name, along = item.name, int(np.argmax(item.shape))
    n_axes = item.ndim

    def read(start: int, stop: int) -> NDArray[Any]:
        place = tuple(slice(start, stop) if k == along else 0 for k in range(n_axes))
        with _reopened(path) as file:
            return np.asarray(file[name][place])

    return LazySamples(item.size, item.dtype, read)


@contextlib.contextmanager
def _reopened(path: Path) -> Iterator[h5py.File]:
    try:
        with h5py.File(path, "r") as file:
            yield file
    except Exception as error:
        raise _damaged(path, error) from error


def _recorded(
    path: Path, variables: Mapping[str, _Value], inertial: Inertial | None
) -> Iterator[Recorded]:
    variables = _unwrapped(variables)
    clock = _Clock(path, variables, inertial)
    found = False
    for name, value in variables.items():
        if isinstance(value, Mapping):
            samples = _vector(next((value[key] for key in _SAMPLES if key in value), None))
            if samples is not None:
                found = True
                yield _of_structure(path, name, samples, value, clock, inertial)
        elif not is_time_name(name):
            for title, samples in _columns(path, name, value, variables):
                found = True
                yield Recorded(title, *clock.applied(title, samples))
    if not found:
        raise RecordingError(
            f"{path}: no vectors of numbers among its variables "
            f"({', '.join(variables) or 'none'}); save each channel as a vector of its own"
        )


def _unwrapped(variables: Mapping[str, _Value]) -> Mapping[str, _Value]:
    """Return what is inside where the whole record is one structure."""
    if len(variables) == 1:
        (inner,) = variables.values()
        if isinstance(inner, Mapping) and not any(key in inner for key in ("samples", "values")):
            return inner
    return variables


def _columns(
    path: Path, name: str, value: _Value, variables: Mapping[str, _Value]
) -> Iterator[tuple[str, NDArray[Any] | LazySamples]]:
    samples = _vector(value)
    if samples is not None:
        yield name, samples
        return
    names = variables.get("names", variables.get("channel_names"))
    if not isinstance(value, np.ndarray) or value.ndim != 2 or min(value.shape) < 2:
        return
    if not isinstance(names, list) or len(names) not in value.shape:
        raise RecordingError(
            f"{path}: {name} is a matrix of {list(value.shape)}, and no cell array names says "
            "what its columns are; save it with one name for each channel"
        )
    columns = value.T if value.shape[1] == len(names) else value
    yield from zip(names, columns, strict=True)


def _vector(value: _Value) -> NDArray[Any] | LazySamples | None:
    """Return a vector of more than one number as [sample], else None."""
    if isinstance(value, LazySamples):
        return value
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf":
        return None
    is_vector = value.size > 1 and max(value.shape) == value.size
    return value.ravel() if is_vector else None


def _number(variables: Mapping[str, _Value], names: tuple[str, ...]) -> float | None:
    for name, value in variables.items():
        is_number = isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "iuf"
        if name.casefold() in names and is_number:
            return float(value.item())
    return None


def _stated_rate(path: Path, variables: Mapping[str, _Value]) -> float | None:
    rate_hz, step_s = _number(variables, _RATE_NAMES), _number(variables, _STEP_NAMES)
    found = 1 / step_s if rate_hz is None and step_s else rate_hz
    if found is not None and not 0 < found < math.inf:
        raise RecordingError(
            f"{path}: the sampling rate is {found:g} Hz; expected more than 0, correct it in the "
            "record"
        )
    return found


class _Clock:
    """Rate, start and places of the samples, from a vector of times or stated numbers."""

    def __init__(
        self, path: Path, variables: Mapping[str, _Value], inertial: Inertial | None
    ) -> None:
        self.path = path
        self.inertial = inertial
        self.rate_hz = _stated_rate(path, variables)
        self.start_s = _number(variables, _START_NAMES)
        self.places: NDArray[np.int64] | None = None
        self.size = 0
        times = {name: _vector(value) for name, value in variables.items() if is_time_name(name)}
        for name, vector in times.items():
            if vector is not None:
                axis = TimeAxis(f"{path}: variable {name}")
                unit = time_unit_s(str(path), name, None)
                self.places = axis.add(np.asarray(vector, np.float64) * unit)
                self.rate_hz, self.start_s, self.size = axis.finish()
                break

    def applied(
        self, name: str, samples: NDArray[Any] | LazySamples
    ) -> tuple[NDArray[Any] | LazySamples, float, float]:
        """Return samples in their places, rate [Hz] and start [s]."""
        said = stated_rate_and_start(self.path, self.rate_hz, self.start_s, self.inertial)
        if self.places is None:
            return samples, *said
        if len(samples) != len(self.places):
            raise RecordingError(
                f"{self.path}: channel {name} has {len(samples)} samples for "
                f"{len(self.places)} times; save it with times of its own, as a structure"
            )
        if self.size > len(samples):
            samples = on_grid(self.places, self.size, np.asarray(samples, np.float64))
        return samples, *said


def _of_structure(
    path: Path,
    name: str,
    samples: NDArray[Any] | LazySamples,
    value: Mapping[str, _Value],
    clock: _Clock,
    inertial: Inertial | None,
) -> Recorded:
    own = _Clock(path, value, inertial)
    if own.rate_hz is None:
        own.rate_hz, own.places, own.size = clock.rate_hz, clock.places, clock.size
    if own.start_s is None:
        own.start_s = clock.start_s
    placed, rate_hz, start_s = own.applied(name, samples)
    units = _text(value, "units") or _text(value, "unit")
    keys = _keys(path, name, value)
    if keys["scale"] is not None and units is not None:  # then the unit is what the scale gives
        keys["units"], units = known_unit(units), None
    return Recorded(name, placed, rate_hz, start_s, units, keys)


def _keys(path: Path, name: str, value: Mapping[str, _Value]) -> dict[str, Any]:
    """Read what a structure says of its channel, under the names of the HDF5 contract."""
    keys: dict[str, Any] = {"quantity": _text(value, "quantity"), "axis": _text(value, "axis")}
    if keys["axis"] is not None and keys["axis"] not in get_args(Axis):
        raise RecordingError(
            f"{path}: channel {name}: axis is {keys['axis']!r}, expected one of "
            f"{', '.join(get_args(Axis))}; correct it in the record"
        )
    keys["scale"] = _number(value, ("scale",))
    keys["station_m"] = _number(value, ("station_m",))
    limits = value.get("range")
    if isinstance(limits, np.ndarray) and limits.size == 2:
        low, high = (float(each) for each in limits.ravel())
        keys["range"] = (low, high) if low < high else None
    return keys


def _text(value: Mapping[str, _Value], key: str) -> str | None:
    text = value.get(key)
    return text if isinstance(text, str) and text else None


def _texts(variables: Mapping[str, _Value]) -> dict[str, object]:
    return {name: value for name, value in variables.items() if isinstance(value, str)}
