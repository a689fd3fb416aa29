"""What is learnt of the glint before fields are measured, in a process of its own.

The learning costs as much as a thousand fields: in a thread it would hold up the measurement.
"""

import multiprocessing
import signal
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from calibration.budget.uncertainty import (
    CarriedUncertainty,
    geometry_uncertainty,
    uncertain_geometry,
)
from calibration.sweep.fit import PitchSweep
from glint_aoa.errors import GlintError
from glint_aoa.flags import Flag
from glint_aoa.optical.measure import Measurement, angles_of, measure_fields, summed_fields
from glint_aoa.optical.prepare import SAMPLE_SIZE, prepare
from glint_aoa.optical.reference import FIRST_FIELDS, Mark
from glint_aoa.optical.sequence import check_sequence
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.recording import Recording
from glint_aoa.setup import Setup
from glint_aoa.workers import deaf_to_interrupts

__all__ = ["Learner", "Learnt", "Lesson", "learn", "learn_stack", "sample_numbers", "warm_up"]

_Array = NDArray[np.float64]

_REACH_DEG = np.arange(-6.0, 6.5, 0.5)  # about the usual angle, where the geometry is looked at


@dataclass(frozen=True)
class Learnt:
    """What fields are measured with.

    Attributes
    ----------
    measurement : Measurement
        From `glint_aoa.optical.measure.prepare`.
    flags : int
        Flags that the sample puts on every field to come: `Flag.PARITY_ORDER` or none.
    found : bool
        Whether the sample showed a glint.
    angle, carried : ndarray [node], CarriedUncertainty or None
        Uncertainty that the geometry leaves at angles before a sweep [rad]; None where the setup
        states none.
    """

    measurement: Measurement
    flags: int
    found: bool
    angle: _Array
    carried: CarriedUncertainty | None

    def carried_to(self, angle: _Array) -> CarriedUncertainty | None:
        """Geometry's uncertainty at angles before a sweep [field] [rad]; beyond, the nearest."""
        if self.carried is None:
            return None
        std = np.interp(angle, self.angle, self.carried.std_deg)
        freedom = np.interp(angle, self.angle, self.carried.degrees_of_freedom)
        return CarriedUncertainty(std, freedom)


@dataclass(frozen=True)
class Lesson:
    """What there is to learn from.

    Attributes
    ----------
    fields : ndarray [field, line, column]
        The sample.
    numbers : ndarray [field]
        Numbers of its fields in the source, rising.
    white_level : int
        Grey level at which the camera's scale ends.
    setup, recording
        What is known of camera, glint and fields.
    sweep, temperature_k
        The calibration that is applied, and the tunnel's temperature [K]; None without.
    mark : Mark or None
        The reference mark as the session's first fields showed it; None to learn it.
    """

    fields: NDArray[Any]
    numbers: NDArray[np.int64]
    white_level: int
    setup: Setup
    recording: Recording
    sweep: PitchSweep | None = None
    temperature_k: float | None = None
    mark: Mark | None = None


def sample_numbers(first: int, stop: int) -> NDArray[np.int64]:
    """Return which of the fields `first` to `stop` are learnt from: as many as `prepare` takes."""
    count = stop - first
    spread = np.linspace(0, count - 1, min(SAMPLE_SIZE, count)).astype(np.int64)
    return first + np.unique(np.concatenate([np.arange(min(FIRST_FIELDS, count)), spread]))


def learn(lesson: Lesson) -> Learnt:
    """Learn from a sample of the newest fields, as `prepare` does from a recorded point.

    Parameters
    ----------
    lesson : Lesson
        The sample, and what is known beforehand.

    Returns
    -------
    Learnt
        To measure later fields with.

    Raises
    ------
    RecordingError, SetupError
        As for `prepare`.
    """
    numbers = lesson.numbers - lesson.numbers[0]
    place = {int(number): k for k, number in enumerate(numbers)}

    def read(start: int, stop: int) -> NDArray[Any]:
        known = [place[n] if n in place else _nearest(numbers, n) for n in range(start, stop)]
        return lesson.fields[known]

    parity = int(lesson.recording.parity_of(lesson.numbers[:1])[0])
    recording = replace(lesson.recording, first_parity=parity)
    shape = (int(numbers[-1]) + 1, *lesson.fields.shape[1:])
    stack = FieldStack(
        None, shape, lesson.fields.dtype, read, FieldInfo(), white_level=lesson.white_level
    )
    with threadpool_limits(limits=1, user_api="blas"):
        measurement = prepare(stack, lesson.setup, recording)
        if lesson.mark is not None:
            measurement = replace(measurement, mark=lesson.mark)
        return _examined(measurement, lesson.fields, numbers, lesson)


def learn_stack(
    stack: FieldStack,
    setup: Setup,
    recording: Recording,
    *,
    live: Recording | None = None,
    sweep: PitchSweep | None = None,
    temperature_k: float | None = None,
) -> Learnt:
    """Learn from a whole recording exactly what ``process`` learns from it.

    Parameters
    ----------
    stack, setup, recording
        As for `prepare`.
    live : Recording, optional
        Timing and window of the fields to measure, where they are others.
    sweep, temperature_k
        As for `Lesson`.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        measurement = prepare(stack, setup, recording)
        numbers = np.arange(min(SAMPLE_SIZE, stack.n_fields))
        fields = stack.read(0, numbers.size)
        said = setup, live or recording, sweep, temperature_k
        return _examined(
            measurement, fields, numbers, Lesson(fields, numbers, stack.white_level, *said)
        )


def _nearest(numbers: NDArray[np.int64], number: int) -> int:
    """Place of the field of the same parity that stands for one not in the sample."""
    same = np.flatnonzero((numbers - number) % 2 == 0)
    among = same if same.size else np.arange(numbers.size)
    return int(among[np.abs(numbers[among] - number).argmin()])


def _examined(
    measurement: Measurement, fields: NDArray[Any], numbers: NDArray[np.int64], lesson: Lesson
) -> Learnt:
    """Measure the sample with what it taught: the order of its fields, the geometry's doubt."""
    lines = summed_fields(fields, numbers, measurement)
    angles = angles_of(lines, numbers, measurement)
    flags = 0
    if numbers.size and (np.diff(numbers) == 1).all():
        seen = check_sequence(lines, measurement.recording) & int(Flag.PARITY_ORDER)
        flags = int(Flag.PARITY_ORDER) if (seen > 0).mean() > 0.5 else 0
    angle, carried = _geometry(measurement, angles.angle, angles.intercept, lesson)
    return Learnt(
        measurement=replace(measurement, recording=lesson.recording),
        flags=flags,
        found=bool(measurement.shape.found and np.isfinite(angles.angle).any()),
        angle=angle,
        carried=carried,
    )


def _geometry(
    measurement: Measurement, angle: _Array, intercept: _Array, lesson: Lesson
) -> tuple[_Array, CarriedUncertainty | None]:
    """Tabulate what the geometry leaves uncertain about the usual angle."""
    covariance = uncertain_geometry(lesson.setup)
    known = np.isfinite(angle)
    if covariance is None or not known.any():
        return np.zeros(1), None
    nodes = float(np.median(angle[known])) + np.radians(_REACH_DEG)
    carried = geometry_uncertainty(
        lesson.setup,
        covariance,
        nodes,
        np.full(nodes.size, np.median(intercept[known])),
        u=measurement.recording.first_column + measurement.columns.astype(np.float64),
        std=measurement.column_std,
        sweep=lesson.sweep,
        temperature_k=lesson.temperature_k,
    )
    return nodes, carried


def warm_up(lesson: Lesson) -> bool:
    """Learn from fields made up for it and measure one, so that all is compiled and loaded.

    What the made-up fields cannot be used for is left to the first true ones. Returns whether it
    went through.
    """
    try:
        measurement = learn(_made_up(lesson)).measurement
        measure_fields(lesson.fields[:1], lesson.numbers[:1], measurement)
    except GlintError:
        return False
    return True


def _made_up(lesson: Lesson) -> Lesson:
    """Put a glint of usual width across the middle of a sample's fields."""
    n_lines, n_columns = lesson.fields.shape[1:]
    rng = np.random.default_rng(0)
    first, last = lesson.setup.glint.search_window or (0, n_lines)
    row = (first + last) / 2 + 0.01 * (np.arange(n_columns) - n_columns / 2)
    height = 0.6 * lesson.white_level
    line = np.arange(n_lines)[:, None]
    grey = 0.05 * lesson.white_level + height * np.exp(-0.5 * ((line - row) / 1.4) ** 2)
    if lesson.setup.glint.polarity == "dark":
        grey = 0.7 * lesson.white_level - grey
    noise = rng.normal(0.0, 0.004 * lesson.white_level, lesson.fields.shape)
    fields = np.clip(np.rint(grey + noise), 0, lesson.white_level).astype(lesson.fields.dtype)
    return replace(lesson, fields=fields)


class Learner:
    """A process that learns while this one measures.

    It is deaf to Ctrl-C, which is for the one that waits for it.
    """

    def __init__(self) -> None:
        fresh = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(1, mp_context=fresh, initializer=_ignore_signals)

    def close(self) -> None:
        """Let it finish what it is at, and end it."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def warm_up(self, lesson: Lesson) -> "Future[bool]":
        """Have everything compiled and loaded over there; see `warm_up`."""
        with deaf_to_interrupts():  # the process begins here, long before its initializer runs
            return self._pool.submit(warm_up, lesson)

    def learn(self, lesson: Lesson) -> "Future[Learnt]":
        """Learn over there; see `learn`."""
        return self._pool.submit(learn, lesson)


def _ignore_signals() -> None:
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, signal.SIG_IGN)
