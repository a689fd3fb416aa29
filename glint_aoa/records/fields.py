"""Stacks of recorded fields, read block by block so that memory stays constant."""

import datetime
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Self, cast

import numpy as np
from numpy.typing import DTypeLike, NDArray

from glint_aoa.errors import RecordingError

__all__ = ["FieldInfo", "FieldStack", "checked_shape"]

BLOCK_BYTES = 8_000_000
"""How much one block of fields takes, at most, unless a single field is larger [bytes]."""

MAX_FIELD_BYTES = 1 << 27
"""A field larger than this is a header that lies, not a recording [bytes]."""

_NOTHING: Mapping[str, object] = MappingProxyType({})


@dataclass(frozen=True)
class FieldInfo:
    """What a file of fields says about itself; None where it is silent.

    Attributes
    ----------
    rate_hz : float or None
        Fields a second [Hz].
    exposure_s : float or None
        Integration time of a field [s].
    first_line, first_column : int or None
        Sensor line and column of the window's first pixel [pixels].
    first_parity : {"even", "odd"} or None
        Parity of field 0; even is the field with lines 0, 2, 4 ... of the frame.
    interlaced : bool or None
        False for progressive frames, which have parity 0 throughout.
    start_s : float or None
        Start of field 0's exposure after the trigger [s].
    trigger_time : str or None
        Time of day of the trigger, ISO 8601.

    Raises
    ------
    RecordingError
        If a value is of the wrong kind or cannot be.
    """

    rate_hz: float | None = None
    exposure_s: float | None = None
    first_line: int | None = None
    first_column: int | None = None
    first_parity: Literal["even", "odd"] | None = None
    interlaced: bool | None = None
    start_s: float | None = None
    trigger_time: str | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be; whole numbers and NumPy scalars become plain ones."""
        for name, (check, _) in _RULES.items():
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _checked(name, value, check))


def _checked(name: str, value: object, check: Callable[[Any], Any]) -> object:
    plain = value.item() if isinstance(value, np.generic) else value
    try:
        return check(plain)
    except (TypeError, ValueError):
        raise RecordingError(f"{name} is {plain!r}; expected {_RULES[name][1]}") from None


def _finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError
    return float(value)


def _positive(value: object) -> float:
    number = _finite(value)
    if number <= 0:
        raise ValueError
    return number


def _count(value: object) -> int:
    number = _finite(value)
    if number < 0 or not number.is_integer():
        raise ValueError
    return int(number)


def _truth(value: object) -> bool:
    if not isinstance(value, bool) and not (isinstance(value, int | float) and value in {0, 1}):
        raise ValueError
    return bool(value)


def _parity(value: object) -> str:
    if value not in {"even", "odd"}:
        raise ValueError
    return str(value)


def _iso_time(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError
    datetime.datetime.fromisoformat(value)
    return value


_RULES: dict[str, tuple[Callable[[Any], Any], str]] = {
    "rate_hz": (_positive, "a number greater than zero [Hz]"),
    "exposure_s": (_positive, "a number greater than zero [s]"),
    "first_line": (_count, "a whole number from 0"),
    "first_column": (_count, "a whole number from 0"),
    "first_parity": (_parity, '"even" or "odd"'),
    "interlaced": (_truth, "true or false"),
    "start_s": (_finite, "a finite number [s]"),
    "trigger_time": (_iso_time, "a time in ISO 8601, e.g. 2024-05-31T14:02:11"),
}


class FieldStack:
    """Recorded fields, opened but not yet read.

    Parameters
    ----------
    path : Path or None
        The file; None for a stack in memory.
    shape : (int, int, int)
        Numbers of fields, lines and columns.
    dtype : dtype
        uint8 or uint16.
    read : callable
        ``read(start, stop)`` returns fields start to stop, the last one excluded, as
        [field, line, column].
    info : FieldInfo
        What the file says about itself.
    times_s : ndarray [field] or None
        Recorded starts of the exposures after the trigger [s].
    meta : mapping
        What else the file says of its point: run, point, excitation and the like.
    white_level : int or None
        Grey level at which the camera's own scale ends, such as 4095 for 12 bits in uint16;
        None for the top of `dtype`.
    notes : sequence of str
        What its reader had to assume, or found wrong, in words.

    Raises
    ------
    RecordingError
        If the stack is empty, or is not uint8 or uint16, or a timestamp is missing.
    """

    def __init__(
        self,
        path: Path | None,
        shape: tuple[int, int, int],
        dtype: DTypeLike,
        read: Callable[[int, int], NDArray[Any]],
        info: FieldInfo,
        times_s: NDArray[np.float64] | None = None,
        meta: Mapping[str, object] = _NOTHING,
        *,
        white_level: int | None = None,
        notes: Sequence[str] = (),
    ) -> None:
        self.path = path
        self.dtype = np.dtype(dtype).newbyteorder("=")
        self.info = info
        self.times_s = times_s
        self.meta = MappingProxyType(dict(meta))
        self.notes = tuple(notes)
        self._read = read
        self._shape = checked_shape(self._label, shape, self.dtype)
        self.white_level = int(np.iinfo(self.dtype).max) if white_level is None else white_level
        self._check_times()

    @classmethod
    def from_array(
        cls,
        fields: NDArray[Any],
        info: FieldInfo | None = None,
        *,
        times_s: NDArray[np.float64] | None = None,
        meta: Mapping[str, object] = _NOTHING,
        path: Path | None = None,
    ) -> Self:
        """Make a stack of an array in memory, or mapped into it.

        Parameters
        ----------
        fields : ndarray [field, line, column]
            uint8 or uint16 grey levels.
        info, times_s, meta, path
            As for the class.
        """
        shape = cast("tuple[int, int, int]", fields.shape)

        def read(start: int, stop: int) -> NDArray[Any]:
            return np.asarray(fields[start:stop])

        return cls(path, shape, fields.dtype, read, info or FieldInfo(), times_s, meta)

    def restated(
        self,
        info: FieldInfo,
        *,
        times_s: NDArray[np.float64] | None,
        white_level: int | None = None,
        notes: Sequence[str] = (),
    ) -> "FieldStack":
        """Return the same fields with other words about them.

        Parameters
        ----------
        info, times_s, notes
            As for the class.
        white_level : int, optional
            As for the class; this stack's own if not given.
        """
        return FieldStack(
            self.path,
            self._shape,
            self.dtype,
            self._read,
            info,
            times_s,
            self.meta,
            white_level=self.white_level if white_level is None else white_level,
            notes=notes,
        )

    @property
    def name(self) -> str:
        """Name of the point: the file's name without its suffix."""
        return "fields" if self.path is None else self.path.stem

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of fields, lines and columns."""
        return self._shape

    @property
    def n_fields(self) -> int:
        """Number of fields."""
        return self._shape[0]

    @property
    def n_lines(self) -> int:
        """Number of lines of a field."""
        return self._shape[1]

    @property
    def n_columns(self) -> int:
        """Number of columns of a field."""
        return self._shape[2]

    @property
    def block_size(self) -> int:
        """Number of fields in a block of `blocks`, unless asked otherwise."""
        return self.fields_in(BLOCK_BYTES)

    @property
    def n_bytes(self) -> int:
        """What all fields take in memory [bytes]."""
        return self.n_fields * self.n_lines * self.n_columns * self.dtype.itemsize

    def fields_in(self, n_bytes: int) -> int:
        """Return how many fields fit so much memory [bytes], but at least one."""
        return max(1, n_bytes // (self.n_bytes // self.n_fields))

    def __len__(self) -> int:
        """Return the number of fields."""
        return self.n_fields

    def __repr__(self) -> str:
        """Say what the stack is, without reading it."""
        n, lines, columns = self._shape
        return f"<FieldStack {self._label}: {n} fields of {columns} x {lines}, {self.dtype}>"

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Read fields `start` to `stop`, the last one excluded.

        Returns
        -------
        ndarray [field, line, column]
            uint8 or uint16 grey levels; fewer fields where `stop` is beyond the end.

        Raises
        ------
        RecordingError
            If the file has changed or cannot be read there.
        """
        start, stop = max(start, 0), min(stop, self.n_fields)
        if start >= stop:
            return np.empty((0, *self._shape[1:]), self.dtype)
        try:
            fields = self._read(start, stop)
        except RecordingError:
            raise
        except Exception as error:
            raise RecordingError(
                f"{self._label}: fields {start} to {stop - 1} cannot be read ({error}); "
                "the file is damaged or has changed, record or copy it again"
            ) from error
        if fields.dtype.newbyteorder("=") == self.dtype:
            fields = fields.astype(self.dtype, copy=False)
        expected = (stop - start, *self._shape[1:])
        if fields.shape != expected or fields.dtype != self.dtype:
            raise RecordingError(
                f"{self._label}: fields {start} to {stop - 1} came as {fields.dtype} "
                f"{list(fields.shape)}, expected {self.dtype} {list(expected)}; "
                "the file is damaged or has changed, record or copy it again"
            )
        return fields

    def blocks(
        self, size: int | None = None, start: int = 0, stop: int | None = None
    ) -> Iterator[tuple[int, NDArray[Any]]]:
        """Read the stack from first to last, block by block.

        Parameters
        ----------
        size : int, optional
            Fields in a block; by default as many as fit 8 MB.
        start, stop : int, optional
            First field, and the one after the last; all by default.

        Yields
        ------
        (int, ndarray [field, line, column])
            Number of the block's first field, and the block.
        """
        step = self.block_size if size is None else size
        end = self.n_fields if stop is None else min(stop, self.n_fields)
        for first in range(start, end, step):
            yield first, self.read(first, min(first + step, end))

    @property
    def _label(self) -> str:
        return "stack of fields in memory" if self.path is None else str(self.path)

    def _check_times(self) -> None:
        times = self.times_s
        if times is None:
            return
        if times.shape != (self.n_fields,):
            raise RecordingError(
                f"{self._label}: fields_time has shape {list(times.shape)}, expected one time for "
                f"each of the {self.n_fields} fields; correct or leave out fields_time"
            )
        if not np.isfinite(times).all():
            raise RecordingError(
                f"{self._label}: fields_time is not finite at field "
                f"{int(np.argmin(np.isfinite(times)))}; correct or leave out fields_time"
            )


def checked_shape(label: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> tuple[int, int, int]:
    """Return `shape` if it is that of a stack of grey fields; `label` names the file in errors."""
    if len(shape) != 3:
        raise RecordingError(
            f"{label}: the array has shape {list(shape)}, expected grey fields "
            "[field, line, column]; convert colour to grey and stack the fields"
        )
    if dtype.newbyteorder("=") not in (np.dtype(np.uint8), np.dtype(np.uint16)):
        raise RecordingError(
            f"{label}: grey levels are {dtype}, expected uint8 or uint16; "
            "store them as recorded, without scaling"
        )
    if min(shape) <= 0:
        raise RecordingError(
            f"{label}: the stack is empty (shape {list(shape)}), expected at least one field; "
            "check that the recording was saved"
        )
    n_fields, n_lines, n_columns = (int(n) for n in shape)
    if n_lines * n_columns * dtype.itemsize > MAX_FIELD_BYTES:
        raise RecordingError(
            f"{label}: a field of {n_columns} x {n_lines} pixels is larger than any camera's; "
            "the file is damaged, record or copy it again"
        )
    return n_fields, n_lines, n_columns
