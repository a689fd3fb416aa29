"""Points: which fields a trigger asks for, and how they come to be a file."""

import datetime
import re
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa._version import __version__
from glint_aoa.errors import InputError, OutputError
from glint_aoa.live.ring import FieldRing
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.records.recording import Recording

__all__ = ["Point", "PointRecorder", "checked_name", "free_name"]

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
_AGAIN_S = 5.0  # until a file that could not be written is tried again
_LONGEST_WAIT_S = 0.05
_TOGETHER = 32  # fields taken out of the ring at a time


@dataclass
class Point:
    """A triggered point.

    Attributes
    ----------
    name : str
        Name of its file.
    first, stop : int
        Numbers of its first field, and one past its last.
    start_s : float
        Start of the exposure of field `first` after the trigger [s].
    trigger_time : datetime
        The same as time of day.
    shaker_off_s : float or None
        When the shaker was said to be off, after the trigger [s].
    angles_deg : dict of int to float
        Angles of its good readings so far, by index [deg].
    """

    name: str
    first: int
    stop: int
    start_s: float
    trigger_time: datetime.datetime
    shaker_off_s: float | None = None
    angles_deg: dict[int, float] = field(default_factory=dict)


def checked_name(name: object) -> str:
    """Return a point's name if it can be that of a file and of a run's point.

    Raises
    ------
    InputError
        If it cannot.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise InputError(
            f"point {name!r}: a name starts with a letter or digit and has up to 100 letters, "
            "digits, dots, dashes and underscores; give another"
        )
    return name


def free_name(folder: Path, taken: set[str]) -> str:
    """Return the first of ``live-0001``, ``live-0002`` ... that is free."""
    number = 1
    while (name := f"live-{number:04d}") in taken or (folder / f"{name}.h5").exists():
        number += 1
    return name


class PointRecorder(threading.Thread):
    """Takes a point's fields out of the ring as they come, and writes them once it has all.

    A field that was lost is stored as a copy of the one of its parity before it, so that parity
    and time stay in step; ``process`` flags it `REPEATED` and leaves it out of the mean.

    Parameters
    ----------
    point : Point
        The point.
    ring : FieldRing
        Where its fields are.
    folder : Path
        Where its file goes.
    recording : Recording
        Timing and window of the fields.
    white_level : int
        Grey level at which the camera's scale ends.
    meta : mapping
        What else its file says.
    ended : Event
        Set once no more fields come.
    hurry : Event
        Set once nothing is to be waited for.
    tell : callable
        Called with a sentence about what becomes of it.
    """

    def __init__(
        self,
        point: Point,
        ring: FieldRing,
        folder: Path,
        *,
        recording: Recording,
        white_level: int,
        meta: Mapping[str, str | float | int],
        ended: threading.Event,
        hurry: threading.Event,
        tell: Callable[[str], None],
    ) -> None:
        super().__init__(name=f"point {point.name}", daemon=True)
        self.point, self.written = point, False
        self.error: OutputError | None = None
        self._ring, self._path = ring, folder / f"{point.name}.h5"
        self._recording, self._white_level, self._meta = recording, white_level, meta
        self._ended, self._hurry, self._tell = ended, hurry, tell
        count = point.stop - point.first
        self._fields = np.empty((count, *ring.shape), ring.dtype)
        self._here = np.zeros(count, np.bool_)

    @property
    def n_bytes(self) -> int:
        """What its fields take in memory [bytes]."""
        return self._fields.nbytes

    def run(self) -> None:
        """Collect, then write; a file that cannot be written is tried again until it can."""
        self._collect()
        fields, here = self._joined()
        if not len(fields):
            self._tell(f"point {self.point.name}: no field came; nothing is written")
            return
        recorded = self._recorded(fields, here)
        while not self._wrote(recorded) and not self._hurry.wait(_AGAIN_S):
            pass
        if not self.written and self.error is not None:
            self._wrote(recorded)

    def _collect(self) -> None:
        point, ring, next_one = self.point, self._ring, self.point.first
        wait_s = min(_LONGEST_WAIT_S, 0.1 * ring.capacity / self._recording.rate_hz)
        while next_one < point.stop:
            over = self._ended.is_set()
            stop = min(ring.newest + 1, point.stop, next_one + _TOGETHER)
            if stop > next_one:
                some = slice(next_one - point.first, stop - point.first)
                self._here[some] = ring.copy_to(self._fields[some], next_one, stop)
                next_one = stop
            elif over:
                break
            else:
                self._ended.wait(wait_s)

    def _joined(self) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Fields of the point from the first to the last that came, the lost ones filled in."""
        came = np.flatnonzero(self._here)
        begun, last = (int(came[0]), int(came[-1]) + 1) if came.size else (0, 0)
        self.point.first += begun
        self.point.start_s += begun / self._recording.rate_hz
        fields, here = self._fields[begun:last], self._here[begun:last]
        step = 2 if self._recording.interlaced else 1
        for k in np.flatnonzero(~here):
            fields[k] = fields[max(k - step, k % step)]
        return fields, here

    def _recorded(self, fields: NDArray[Any], here: NDArray[np.bool_]) -> RecordedPoint:
        point, recording = self.point, self._recording
        parity = int(recording.parity_of(np.array([point.first]))[0])
        info = FieldInfo(
            rate_hz=recording.rate_hz,
            exposure_s=recording.exposure_s or None,
            first_line=recording.first_line,
            first_column=recording.first_column,
            first_parity="odd" if parity else "even",
            interlaced=recording.interlaced,
            start_s=point.start_s,
            trigger_time=point.trigger_time.isoformat(timespec="milliseconds"),
        )
        said: dict[str, str | float | int] = {"point": point.name, **self._meta}
        said["versions"] = f"glint-aoa {__version__}, numpy {np.__version__}"
        if point.shaker_off_s is not None:
            said["shaker_off_s"] = point.shaker_off_s
        if not here.all():
            said["fields_lost"] = ", ".join(map(str, np.flatnonzero(~here)))
        stack = FieldStack.from_array(fields, info)
        stack = stack.restated(info, times_s=None, white_level=self._white_level)
        return RecordedPoint(fields=stack, info=info, meta=said)

    def _wrote(self, recorded: RecordedPoint) -> bool:
        try:
            write_point(self._path, recorded)
        except OutputError as error:
            if self.error is None:
                self._tell(f"{error}; it is tried again")
            self.error = error
            return False
        self.error, self.written = None, True
        n_fields = 0 if recorded.fields is None else len(recorded.fields)
        self._tell(f"{self._path}: written, {n_fields} fields")
        return True
