"""When the glint is learnt, and learnt anew."""

import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future

import numpy as np

from calibration.sweep.fit import PitchSweep
from glint_aoa.errors import GlintError, RecordingError
from glint_aoa.live.learning import Learner, Learnt, Lesson, learn_stack, sample_numbers, warm_up
from glint_aoa.live.pipeline import Pipeline
from glint_aoa.live.readings import Measurer
from glint_aoa.live.sources import Source
from glint_aoa.optical.measure import measure_fields
from glint_aoa.optical.reference import Mark
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.recording import Recording, resolve_recording
from glint_aoa.setup import Setup

__all__ = ["Schooling"]

_LEARN_S, _LEAST_LEARN = 1.0, 64  # of the newest fields that are learnt from
_WARM_FIELDS = 16
_OUT_OF_SIGHT = 30  # readings in a row that do not count, after which the glint is looked for anew
_SOON_S = 1.0  # between two lessons at least


class Schooling:
    """Learns the glint, first of a recording or of the first second of fields, then ever anew.

    Parameters
    ----------
    source : Source
        The fields.
    setup, recording
        What is known of camera, glint and fields.
    teacher : FieldStack or None
        Recording to learn from before the start, after which nothing is learnt any more; the
        source's own where all of its fields are known beforehand.
    relearn_s : float
        Seconds between lessons from the newest fields; 0 for one lesson only.
    sweep, temperature_k
        As for `glint_aoa.live.learning.Lesson`.
    tell : callable
        Called with a sentence about what goes wrong.
    """

    def __init__(
        self,
        source: Source,
        setup: Setup,
        recording: Recording,
        *,
        teacher: FieldStack | None,
        relearn_s: float,
        sweep: PitchSweep | None,
        temperature_k: float | None,
        tell: Callable[[str], None],
    ) -> None:
        self._source, self._setup, self._recording = source, setup, recording
        self._relearn_s, self._tell = relearn_s, tell
        self._sweep, self._temperature_k = sweep, temperature_k
        self._teacher = teacher if teacher is not None else source.stack
        self._mark: Mark | None = None
        self._learner: Learner | None = None
        self._lesson: Future[Learnt] | None = None
        self._last = 0.0

    @property
    def span(self) -> int:
        """Newest fields that a lesson is taken from."""
        return max(_LEAST_LEARN, round(_LEARN_S * self._recording.rate_hz))

    def begin(self) -> Measurer | None:
        """Have all compiled and loaded, and learn from the teacher where there is one."""
        sample = np.zeros((_WARM_FIELDS, *self._source.shape), self._source.dtype)
        lesson = self._lesson_of(sample, np.arange(_WARM_FIELDS))
        warm_up(lesson)
        if self._teacher is not None:
            return self._measurer(self._taught(self._teacher))
        self._learner = Learner()
        self._learner.warm_up(lesson).result()
        return None

    def attend(self, pipeline: Pipeline, *, busy: bool) -> None:
        """Look whether a lesson is over or due; never waits.

        Parameters
        ----------
        pipeline : Pipeline
            What learns.
        busy : bool
            Whether a point is being recorded: its fields are all measured alike, so that a lesson
            waits for its end.

        Raises
        ------
        GlintError
            If the first lesson shows that nothing can be measured.
        """
        if self._lesson is not None:
            is_kept = busy and pipeline.measurer is not None
            if self._lesson.done() and not is_kept:
                self._take_in(pipeline, self._lesson)
                self._lesson = None
        elif self._learner is not None and self._is_due(pipeline, busy=busy):
            self._last = time.monotonic()
            self._lesson = self._learner.learn(self._newest(pipeline))

    def finish(self, pipeline: Pipeline) -> None:
        """Learn of however few fields came, if they are to be measured at all."""
        if pipeline.measurer is not None or self._learner is None or not pipeline.fields:
            return
        if self._lesson is None:
            self._lesson = self._learner.learn(self._newest(pipeline))
        self._take_in(pipeline, self._lesson)

    def close(self) -> None:
        """End the process that learns."""
        if self._learner is not None:
            self._learner.close()

    def _is_due(self, pipeline: Pipeline, *, busy: bool) -> bool:
        since = time.monotonic() - self._last
        if pipeline.measurer is None:
            return pipeline.fields >= self.span and since > _SOON_S
        if busy or self._relearn_s <= 0:
            return False
        lost_sight = pipeline.unseen > _OUT_OF_SIGHT and since > _SOON_S
        return since > self._relearn_s or lost_sight

    def _newest(self, pipeline: Pipeline) -> Lesson:
        stop = pipeline.ring.newest + 1
        numbers = sample_numbers(max(stop - self.span, 0), stop)
        fields, here = pipeline.ring.copy(numbers)
        return self._lesson_of(fields[here], numbers[here])

    def _lesson_of(self, fields: np.ndarray, numbers: np.ndarray) -> Lesson:
        return Lesson(
            fields,
            numbers,
            self._source.white_level,
            self._setup,
            self._recording,
            self._sweep,
            self._temperature_k,
            self._mark,
        )

    def _take_in(self, pipeline: Pipeline, lesson: "Future[Learnt]") -> None:
        measurer = pipeline.measurer
        try:
            learnt = lesson.result()
        except (GlintError, BrokenExecutor) as error:
            if measurer is None:
                raise RecordingError(f"the glint could not be learnt: {error}") from error
            self._tell(f"{error}; the glint is measured as it was learnt before")
            return
        if measurer is not None and not learnt.found:
            return
        newest, _ = pipeline.ring.copy(np.array([pipeline.ring.newest]))
        measure_fields(newest, np.zeros(1, np.int64), learnt.measurement)  # loads what it needs
        self._mark = learnt.measurement.mark
        if measurer is None:
            pipeline.learnt(self._measurer(learnt))
        else:
            measurer.learnt = learnt

    def _taught(self, teacher: FieldStack) -> Learnt:
        if teacher.shape[1:] != self._source.shape or teacher.dtype != self._source.dtype:
            raise RecordingError(
                f"{teacher.name}: fields of {teacher.dtype} {list(teacher.shape[1:])}, expected "
                f"{self._source.dtype} {list(self._source.shape)} like those of "
                f"{self._source.name}; learn from a recording of the same window"
            )
        return learn_stack(
            teacher,
            self._setup,
            resolve_recording(teacher, self._setup),
            live=self._recording,
            sweep=self._sweep,
            temperature_k=self._temperature_k,
        )

    def _measurer(self, learnt: Learnt) -> Measurer:
        return Measurer(learnt, sweep=self._sweep, temperature_k=self._temperature_k)
