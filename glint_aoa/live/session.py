"""A live session: fields are taken, measured, recorded and told, from start to clean end."""

import gc
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from calibration.sweep.fit import PitchSweep
from glint_aoa.errors import GlintError, InputError
from glint_aoa.live.outputs import Output
from glint_aoa.live.pipeline import Pipeline
from glint_aoa.live.readings import Reading
from glint_aoa.live.recorders import PointLength, Recorders
from glint_aoa.live.ring import FieldRing
from glint_aoa.live.schooling import Schooling
from glint_aoa.live.sources import Source, agreed_recording
from glint_aoa.records.fields import FieldStack
from glint_aoa.setup import Setup

__all__ = ["PointLength", "Session", "State"]

_SLACK_S, _LEAST_SLACK = 4.0, 128  # that measurement and recording may fall behind
_MOST_BYTES = 2 << 30  # of a ring, or of a point
_KEPT = 1024  # readings
_TICK_S = 0.05
_PRIORITY = 10  # of 1 to 99, above all that is not real-time


@dataclass(frozen=True)
class State:
    """How a session stands; NaN where unknown.

    Attributes
    ----------
    fields, lost : int
        Fields that came; and that never came, or were written over before they were measured.
    learning : bool
        Whether no field can be measured yet, since the glint is still to be learnt.
    armed : bool
        Whether a trigger would start a point.
    point : str or None
        Point that is being recorded.
    shaker_off : bool
        Whether the shaker was said to be off in it, or for the next one.
    latency_ms : (float, float, float)
        From a field's arrival to its angle [ms]: median and 99th percentile of the newest 65536,
        and the greatest of all.
    reading : Reading or None
        The newest.
    angle_deg : (float, float, int)
        Mean, standard deviation and number of the good readings of the current or last point.
    """

    fields: int = 0
    lost: int = 0
    learning: bool = True
    armed: bool = False
    point: str | None = None
    shaker_off: bool = False
    latency_ms: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    reading: Reading | None = None
    angle_deg: tuple[float, float, int] = (np.nan, np.nan, 0)


class Session:
    """Takes fields from a source, measures each, records points and offers readings.

    Parameters
    ----------
    source : Source
        The fields; closed at the end.
    setup : Setup
        The setup.
    out : Path
        Folder of the points.
    length : callable
        Gives the fields of a point from the field rate [Hz].
    sweep, temperature_k : optional
        Calibration to apply, and the tunnel's temperature [K].
    teacher : FieldStack, optional
        Recording to learn the glint from before the start; it is not learnt again then.
    relearn_s : float, optional
        Seconds after which the glint is learnt anew from the newest fields, though never while a
        point is recorded; 0 for never.
    realtime : bool, optional
        Whether the calling thread and those that take and measure fields ask for real-time
        priority; it stays with the calling thread.
    outputs : sequence of Output, optional
        Where the readings go; closed at the end.
    meta : mapping, optional
        What the files of points say besides.
    tell : callable, optional
        Called with a sentence about what happens, from any thread.
    """

    def __init__(
        self,
        source: Source,
        setup: Setup,
        out: Path,
        *,
        length: Callable[[float], PointLength],
        sweep: PitchSweep | None = None,
        temperature_k: float | None = None,
        teacher: FieldStack | None = None,
        relearn_s: float = 5.0,
        realtime: bool = False,
        outputs: Sequence[Output] = (),
        meta: Mapping[str, str | float | int] = MappingProxyType({}),
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.source, self.outputs = source, outputs
        self.rate_hz = np.nan
        self._setup, self._out, self._length = setup, out, length
        self._sweep, self._temperature_k, self._teacher = sweep, temperature_k, teacher
        self._relearn_s, self._meta, self._tell = relearn_s, meta, tell
        self._realtime, self._stop = realtime, threading.Event()
        self._pipeline: Pipeline | None = None
        self._recorders: Recorders | None = None

    def stop(self) -> None:
        """End the session: no more fields are taken, triggered points are written."""
        self._stop.set()

    def trigger(self, name: str | None = None) -> str:
        """Start a point with the fields before, and return its name.

        Parameters
        ----------
        name : str, optional
            Its name; ``live-0001`` and so on if not given.

        Raises
        ------
        InputError
            If no field comes, a point is being recorded, or the name cannot be used.
        """
        if self._recorders is None:
            raise InputError("no field comes yet; trigger while the source runs")
        return self._recorders.trigger(name)

    def mark_shaker_off(self) -> None:
        """Mark the shaker as off: now in the point that is recorded, else all through the next.

        Raises
        ------
        InputError
            If no field has been waited for yet, so that no point is next.
        """
        if self._recorders is None:
            raise InputError("no field comes yet; mark the shaker off while the source runs")
        self._recorders.mark_shaker_off()

    def state(self) -> State:
        """Return how the session stands."""
        pipeline, recorders = self._pipeline, self._recorders
        if pipeline is None or recorders is None:
            return State()
        point = recorders.current
        return State(
            fields=pipeline.fields,
            lost=pipeline.lost,
            learning=pipeline.measurer is None,
            armed=pipeline.fields > 0 and point is None and not pipeline.ended.is_set(),
            point=None if point is None else point.name,
            shaker_off=recorders.shaker_is_off,
            latency_ms=pipeline.latencies_ms(),
            reading=pipeline.newest_reading(),
            angle_deg=recorders.angle_deg(),
        )

    def readings_since(self, index: int) -> list[Reading]:
        """Return the readings after `index` that are kept still, oldest first."""
        pipeline = self._pipeline
        return [] if pipeline is None else [r for r in pipeline.readings() if r.index > index]

    def newest_field(self) -> tuple[int, NDArray[Any]] | None:
        """Return the newest field and its number; None before the first."""
        pipeline = self._pipeline
        if pipeline is None or pipeline.ring.newest < 0:
            return None
        number = pipeline.ring.newest
        return number, pipeline.ring.copy(np.array([number]))[0][0]

    def run(self, tick: Callable[[], None] = lambda: None) -> State:
        """Run until the source ends or `stop` is called; return how it stood then.

        Parameters
        ----------
        tick : callable, optional
            Called some twenty times a second.

        Raises
        ------
        InputError
            If source and setup do not fit, the source broke off, or a point could not be written;
            all that could be saved is on disk then.
        """
        try:
            with threadpool_limits(limits=1, user_api="blas"):
                errors = self._run(tick) if self.source.ready(self._stop) else []
        finally:
            self.source.close()
            for output in self.outputs:
                output.close()
        if errors:
            raise errors[0]
        return self.state()

    def _run(self, tick: Callable[[], None]) -> list[GlintError]:
        schooling, pipeline, recorders = self._begun()
        errors: list[GlintError] = []
        try:
            if self._realtime:
                self._hasten()
            pipeline.start()
            while not self._stop.is_set() and not pipeline.ended.wait(_TICK_S):
                schooling.attend(pipeline, busy=recorders.current is not None)
                tick()
            pipeline.stop()
            if not self._stop.is_set():
                schooling.finish(pipeline)
        except GlintError as error:
            errors.append(error)
        finally:
            pipeline.join()
            schooling.close()
            errors += [*pipeline.errors, *recorders.finish()]
            gc.unfreeze()
            tick()
        return errors

    def _hasten(self) -> None:
        """Give this thread, and those that it starts, real-time priority, where that is allowed."""
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        except (OSError, AttributeError) as error:
            self._tell(
                f"--realtime: the system does not allow it ({error}); allow it with an rtprio "
                "limit or cap_sys_nice, or go without"
            )

    def _begun(self) -> tuple[Schooling, Pipeline, Recorders]:
        source = self.source
        recording = agreed_recording(source, self._setup)
        self.rate_hz = recording.rate_hz
        length = self._length(recording.rate_hz)
        schooling = Schooling(
            source,
            self._setup,
            recording,
            teacher=self._teacher,
            relearn_s=self._relearn_s,
            sweep=self._sweep,
            temperature_k=self._temperature_k,
            tell=self._tell,
        )
        self._check_memory("--post: a point", length.pre + length.post)
        ring = self._ring(max(length.pre, schooling.span))
        pipeline = Pipeline(
            source,
            ring,
            outputs=self.outputs,
            kept=max(ring.capacity, _KEPT),
        )
        recorders = Recorders(
            ring,
            self._out,
            length=length,
            recording=recording,
            white_level=source.white_level,
            meta={**source.meta, **self._meta},
            ended=pipeline.ended,
            readings=pipeline.readings,
            tell=self._tell,
        )
        measurer = schooling.begin()
        if measurer is not None:
            pipeline.learnt(measurer)
        self._pipeline, self._recorders = pipeline, recorders
        pipeline.recorders = recorders
        gc.collect()
        gc.freeze()  # what is here now stays: the collector need not walk through it again
        return schooling, pipeline, recorders

    def _ring(self, behind: int) -> FieldRing:
        """Ring of so many fields and those that may come while others are busy."""
        capacity = behind + max(_LEAST_SLACK, round(_SLACK_S * self.rate_hz))
        self._check_memory("--pre: a ring", capacity)
        return FieldRing(capacity, self.source.shape, self.source.dtype)

    def _check_memory(self, what: str, n_fields: int) -> None:
        n_bytes = n_fields * int(np.prod(self.source.shape)) * self.source.dtype.itemsize
        if n_bytes > _MOST_BYTES:
            raise InputError(
                f"{what} of {n_fields} fields takes {n_bytes / 1e9:.1f} GB of memory; "
                "give fewer fields"
            )
