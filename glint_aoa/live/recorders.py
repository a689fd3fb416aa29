"""The points of a session: triggered, recorded, marked, written."""

import datetime
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from glint_aoa.errors import InputError, OutputError
from glint_aoa.live.points import Point, PointRecorder, checked_name, free_name
from glint_aoa.live.readings import Reading
from glint_aoa.live.ring import FieldRing
from glint_aoa.records.recording import Recording

__all__ = ["PointLength", "Recorders"]

_MOST_WAITING_BYTES = 2 << 30  # of points that are not written yet


@dataclass(frozen=True)
class PointLength:
    """Fields of a point: the newest `pre` before the trigger, and `post` from then on."""

    pre: int
    post: int


class Recorders:
    """Records one point at a time; writing goes on behind.

    Parameters
    ----------
    ring : FieldRing
        The newest fields.
    folder : Path
        Where the files go.
    length : PointLength
        Fields of a point.
    recording, white_level, meta, tell
        As for `glint_aoa.live.points.PointRecorder`.
    ended : Event
        Set once no more fields come.
    readings : callable
        Returns the readings of the newest fields.
    """

    def __init__(
        self,
        ring: FieldRing,
        folder: Path,
        *,
        length: PointLength,
        recording: Recording,
        white_level: int,
        meta: Mapping[str, str | float | int],
        ended: threading.Event,
        readings: Callable[[], Sequence[Reading]],
        tell: Callable[[str], None],
    ) -> None:
        self._ring, self._folder, self._length = ring, folder, length
        self._recording, self._white_level, self._meta = recording, white_level, meta
        self._ended, self._readings, self._tell = ended, readings, tell
        self._hurry, self._lock = threading.Event(), threading.Lock()
        self._taken: set[str] = set()
        self._threads: list[PointRecorder] = []
        self._shaker_off = False
        self.last: Point | None = None

    @property
    def current(self) -> Point | None:
        """The point that is being recorded, if one is."""
        point = self.last
        over = point is None or self._ended.is_set() or self._ring.newest + 1 >= point.stop
        return None if over else point

    @property
    def shaker_is_off(self) -> bool:
        """Whether the shaker was said to be off in the current point, or for the next one."""
        point = self.current
        return self._shaker_off or (point is not None and point.shaker_off_s is not None)

    def point_of(self, number: int) -> str | None:
        """Name the newest point if it holds the field."""
        point = self.last
        return None if point is None or not point.first <= number < point.stop else point.name

    def note(self, reading: Reading) -> None:
        """Keep the angle of a good field of the newest point."""
        point = self.last
        if point is not None and point.first <= reading.index < point.stop and reading.is_good:
            point.angles_deg[reading.index] = reading.angle_deg

    def angle_deg(self) -> tuple[float, float, int]:
        """Mean, standard deviation and number of the newest point's good angles; NaN for none."""
        point = self.last
        angles = [] if point is None else list(point.angles_deg.values())
        mean = float(np.mean(angles)) if angles else np.nan
        std = float(np.std(angles, ddof=1)) if len(angles) > 1 else np.nan
        return mean, std, len(angles)

    def trigger(self, name: str | None = None) -> str:
        """Start a point; see `glint_aoa.live.session.Session.trigger`."""
        with self._lock:
            if self._ring.newest < 0 or self._ended.is_set():
                raise InputError("no field comes; trigger while the source runs")
            current = self.current
            if current is not None:
                raise InputError(f"point {current.name} is being recorded; trigger again after it")
            self._check_room()
            point = self._point(self._named(name))
            self.last = point
            for reading in self._readings():
                self.note(reading)
            self._start(point)
        count = point.stop - point.first
        self._tell(f"point {point.name}: triggered, {count} fields")
        return point.name

    def mark_shaker_off(self) -> None:
        """Mark the shaker as off now; from the trigger of the next point on if none is recorded.

        It is off from the first mark on: a second one in the same point changes nothing.
        """
        with self._lock:
            point = self.current
            if point is None:
                self._shaker_off = True
            elif point.shaker_off_s is None:
                since = datetime.datetime.now(datetime.UTC) - point.trigger_time
                point.shaker_off_s = round(since.total_seconds(), 3)

    def finish(self) -> list[OutputError]:
        """Wait until all points are written; return why some could not be."""
        self._hurry.set()
        with self._lock:  # a trigger that came in time has its thread; those after it are refused
            threads = list(self._threads)
        for thread in threads:
            thread.join()
        return [thread.error for thread in threads if thread.error is not None]

    def _named(self, name: str | None) -> str:
        if name is None:
            name = free_name(self._folder, self._taken)
        name = checked_name(name)
        if name in self._taken or (self._folder / f"{name}.h5").exists():
            raise InputError(f"point {name} is in {self._folder} already; give another name")
        self._taken.add(name)
        return name

    def _check_room(self) -> None:
        waiting = sum(thread.n_bytes for thread in self._threads if thread.is_alive())
        if waiting > _MOST_WAITING_BYTES:
            raise InputError(
                f"points of {waiting / 1e9:.1f} GB wait to be written to {self._folder}; "
                "make room there, then trigger again"
            )

    def _point(self, name: str) -> Point:
        newest = self._ring.newest
        now = datetime.datetime.now(datetime.UTC)
        _, arrived = self._ring.clocks(newest, newest + 1)
        since_s = max(time.perf_counter() - float(arrived[0]), 0.0)
        first = max(newest + 1 - self._length.pre, self._ring.oldest)
        return Point(
            name=name,
            first=first,
            stop=newest + 1 + self._length.post,
            start_s=(first - newest) / self._recording.rate_hz - since_s,
            trigger_time=now,
            shaker_off_s=0.0 if self._shaker_off else None,
        )

    def _start(self, point: Point) -> None:
        self._shaker_off = False
        thread = PointRecorder(
            point,
            self._ring,
            self._folder,
            recording=self._recording,
            white_level=self._white_level,
            meta=self._meta,
            ended=self._ended,
            hurry=self._hurry,
            tell=self._tell,
        )
        self._threads = [each for each in self._threads if each.is_alive() or each.error]
        self._threads.append(thread)
        thread.start()
