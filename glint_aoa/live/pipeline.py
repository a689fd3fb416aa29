"""From source to readings: one thread takes fields into the ring, another measures them."""

import queue
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import GlintError, RecordingError
from glint_aoa.live.outputs import Output
from glint_aoa.live.readings import Measurer, Reading
from glint_aoa.live.recorders import Recorders
from glint_aoa.live.ring import FieldRing
from glint_aoa.live.sources import Source

__all__ = ["Pipeline"]

_TOGETHER = 32  # fields measured at a time when there is a backlog
_LATENCIES = 65536  # newest ones that the percentiles are taken of


class Pipeline:
    """Measures fields as they come; nothing that looks on can hold it up.

    Parameters
    ----------
    source : Source
        The fields.
    ring : FieldRing
        Where they are kept.
    outputs : sequence of Output
        Offered every reading.
    kept : int
        Readings to keep.

    Attributes
    ----------
    fields : int
        Fields that came.
    unseen : int
        Readings in a row that do not count in a mean.
    ended : Event
        Set once no more fields come.
    errors : list of GlintError
        What broke it off.
    recorders : Recorders or None
        Told of each reading, and asked which point a field belongs to.
    """

    def __init__(
        self,
        source: Source,
        ring: FieldRing,
        *,
        outputs: Sequence[Output],
        kept: int,
    ) -> None:
        self.ring, self.ended = ring, threading.Event()
        self.errors: list[GlintError] = []
        self.recorders: Recorders | None = None
        self.fields = self.unseen = 0
        self._missing = self._overtaken = 0  # each counted by a thread of its own
        self._source, self._outputs = source, outputs
        self._stop, self._learnt = threading.Event(), threading.Event()
        self._inbox: queue.SimpleQueue[int | None] = queue.SimpleQueue()
        self._measurer: Measurer | None = None
        self._learnt_at = -1
        self._log: deque[Reading] = deque(maxlen=kept)
        self._latency, self._timed, self._latency_max = np.zeros(_LATENCIES), 0, 0.0
        self._threads = [
            threading.Thread(target=work, name=work.__name__.strip("_"), daemon=True)
            for work in (self._measure, self._take)
        ]

    @property
    def lost(self) -> int:
        """Fields that never came, or were written over before they were measured."""
        return self._missing + self._overtaken

    @property
    def measurer(self) -> Measurer | None:
        """Measures the fields; None until the glint has been learnt."""
        return self._measurer

    def learnt(self, measurer: Measurer) -> None:
        """Begin to measure, with the fields that are in the ring already."""
        self._measurer, self._learnt_at = measurer, self.ring.newest
        self._learnt.set()

    def start(self) -> None:
        """Begin to take fields."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Take no more fields."""
        self._stop.set()

    def join(self) -> None:
        """Wait until all that came is measured; what could not be learnt in time is left."""
        self._stop.set()
        self._learnt.set()
        for thread in self._threads:
            thread.join()

    def latencies_ms(self) -> tuple[float, float, float]:
        """Median and 99th percentile of the newest fields' latencies, and the greatest of all."""
        newest = self._latency[: self._timed].copy()
        if not newest.size:
            return np.nan, np.nan, np.nan
        middle, high = np.percentile(newest, [50, 99])
        return float(middle), float(high), self._latency_max

    def readings(self) -> list[Reading]:
        """Return the readings that are kept, oldest first."""
        return list(self._log)

    def newest_reading(self) -> Reading | None:
        """Return the newest reading."""
        return self._log[-1] if self._log else None

    def _take(self) -> None:
        """Put the fields into the ring."""
        before = -1
        try:
            for arrival in self._source.arrivals(self._stop):
                self.ring.put(arrival)
                self._inbox.put(arrival.number)
                self.fields += 1
                self._missing += arrival.number - before - 1
                before = arrival.number
        except Exception as error:
            self._broke_off(error)
        finally:
            self.ended.set()
            self._inbox.put(None)

    def _measure(self) -> None:
        """Measure the fields as they come."""
        self._learnt.wait()
        if self._measurer is None:
            return
        try:
            numbers: list[int] = []
            while (number := self._inbox.get()) is not None:
                numbers.append(number)
                if not self._goes_on(numbers):
                    self._measure_these(numbers)
                    numbers = []
        except Exception as error:
            self._broke_off(error)
            self._stop.set()

    def _goes_on(self, numbers: list[int]) -> bool:
        """Whether the next field is here already, and may be measured together with these."""
        newest, after = self.ring.newest, numbers[-1] + 1
        seam = after % self.ring.capacity == 0
        follows = after <= newest and bool(self.ring.holds(after, after + 1)[0])
        return follows and not seam and len(numbers) < _TOGETHER

    def _measure_these(self, numbers: list[int]) -> None:
        first, stop = numbers[0], numbers[-1] + 1
        readings = self._readings(first, stop) if self.ring.holds(first, stop).all() else []
        whole = self.ring.holds(first, stop).tolist()
        for reading in (each for each, good in zip(readings, whole, strict=False) if good):
            self._publish(reading)
        overtaken = len(numbers) - min(len(readings), sum(whole))
        if first > self._learnt_at:
            self._overtaken += overtaken

    def _readings(self, first: int, stop: int) -> list[Reading]:
        if self._measurer is None:
            return []
        block: NDArray[Any] = self.ring.view(first, stop)
        number = np.arange(first, stop)
        name = (lambda _: None) if self.recorders is None else self.recorders.point_of
        points = [name(each) for each in range(first, stop)]
        return self._measurer.measure(block, number, *self.ring.clocks(first, stop), points=points)

    def _publish(self, reading: Reading) -> None:
        if reading.index <= self._learnt_at:
            reading = replace(reading, latency_ms=np.nan)
        else:
            self._latency[self._timed % _LATENCIES] = reading.latency_ms
            self._timed += 1
            self._latency_max = max(reading.latency_ms, self._latency_max)
        self._log.append(reading)
        self.unseen = 0 if reading.is_good else self.unseen + 1
        if self.recorders is not None:
            self.recorders.note(reading)
        for output in self._outputs:
            output.offer(reading)

    def _broke_off(self, error: Exception) -> None:
        if not isinstance(error, GlintError):
            error = RecordingError(
                f"{self._source.name}: an error broke the session off "
                f"({type(error).__name__}: {error}); start it again"
            )
        self.errors.append(error)
