"""From fields to angles: each field of a stack by what `prepare` learnt from a sample of it."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.flags import Flag
from glint_aoa.optical.estimator import ColumnCentres
from glint_aoa.optical.line import LineFit, fit_lines_robustly
from glint_aoa.optical.measurement import Measurement
from glint_aoa.optical.prepare import prepare
from glint_aoa.optical.reference import has_moved, mark_shift, moved_fields
from glint_aoa.optical.sequence import check_sequence
from glint_aoa.optical.summary import FieldSummary
from glint_aoa.records.fields import BLOCK_BYTES, FieldStack
from glint_aoa.records.recording import Recording
from glint_aoa.setup import Setup

__all__ = [
    "FieldAngles",
    "Measurement",
    "angles_of",
    "fit_fields",
    "joined_angles",
    "measure_fields",
    "measure_prepared",
    "measure_stack",
    "prepare",
    "summed_fields",
    "summed_part",
]

_Array = NDArray[np.float64]

_PRIOR_WEIGHT = 10  # degrees of freedom that the sample's noise counts against a field's own
_POOR = 5.0  # times the usual scatter about the line
_LEAST_COLUMNS = 3
_SHARE_FLAGGED = 0.1  # of the columns cut or clipped before the field is flagged
_TIMING_TOLERANCE = 0.2  # of a field period
_UNSURE = np.radians(0.01)  # noise of one field's angle that only a dim glint leaves
_SECOND = 0.8  # of the glint's height at which another line may be taken for it
_LIKELY = 4.0  # times noise and lasting doubt together that an angle may be off
_BLAMELESS, _SMALL = 5.0, np.radians(0.002)  # times a field's noise, and an angle, that may be off
_BENT = 5.0  # standard deviations, and
_BENT_LINES = 0.25  # field lines of sagitta, from which a line counts as curved


@dataclass(frozen=True)
class FieldAngles:
    """Angle and intercept of each field; lengths in metres, angles in radians, NaN if missing.

    Every attribute has shape (field,).
    """

    field: NDArray[np.int64]
    time_s: _Array
    parity: NDArray[np.int64]
    angle: _Array
    angle_std: _Array
    intercept: _Array
    intercept_std: _Array
    columns_used: NDArray[np.int64]
    rms_residual: _Array
    flags: NDArray[np.int64]


def measure_fields(
    block: NDArray[np.integer], number: NDArray[np.int64], measurement: Measurement
) -> FieldAngles:
    """Measure a block of fields, each on its own.

    Parameters
    ----------
    block : ndarray, shape (field, line, column)
        Grey levels.
    number : ndarray, shape (field,)
        Number of each field in its stack, which gives parity and time.
    measurement : Measurement
        From `prepare`.

    Returns
    -------
    FieldAngles
        One entry a field.
    """
    return angles_of(summed_fields(block, number, measurement), number, measurement)


def measure_stack(
    stack: FieldStack,
    setup: Setup,
    recording: Recording,
    *,
    threads: int | None = None,
    block_bytes: int = BLOCK_BYTES,
    progress: Callable[[int], None] | None = None,
) -> tuple[FieldAngles, Measurement]:
    """Learn from a stack how it is to be measured, and measure it.

    Parameters
    ----------
    stack, setup, recording
        As for `prepare`.
    threads, block_bytes, progress
        As for `measure_prepared`.

    Returns
    -------
    FieldAngles
        One entry a field, in order.
    Measurement
        What was learnt from the sample.
    """
    measurement = prepare(stack, setup, recording)
    angles = measure_prepared(
        stack, measurement, threads=threads, block_bytes=block_bytes, progress=progress
    )
    return angles, measurement


def measure_prepared(
    stack: FieldStack,
    measurement: Measurement,
    *,
    threads: int | None = None,
    block_bytes: int = BLOCK_BYTES,
    progress: Callable[[int], None] | None = None,
) -> FieldAngles:
    """Measure a whole stack, block by block, and check its fields against each other.

    Parameters
    ----------
    stack : FieldStack
        The fields.
    measurement : Measurement
        From `prepare`, of this stack or one like it.
    threads : int, optional
        Blocks that are measured at the same time; as many as there are processors if not given.
        The result does not depend on it.
    block_bytes : int, optional
        What the fields of a block take, at most [bytes]. Nor on this.
    progress : callable, optional
        Called after each block with the number of fields that it held.

    Returns
    -------
    FieldAngles
        One entry a field, in order.
    """
    blocks = stack.blocks(stack.fields_in(block_bytes))
    parts = _in_threads(blocks, measurement, threads or os.cpu_count() or 1)
    return joined_angles(stack, measurement, _told(parts, progress))


def summed_part(
    stack: FieldStack, measurement: Measurement, start: int, stop: int, *, block_bytes: int
) -> FieldSummary:
    """Measure a part of a stack; parts of one stack may be measured anywhere, in any order.

    Parameters
    ----------
    stack, measurement, block_bytes
        As for `measure_prepared`.
    start, stop : int
        First field of the part, and the one after its last.

    Returns
    -------
    FieldSummary
        One entry a field; for `joined_angles`.
    """
    blocks = stack.blocks(stack.fields_in(block_bytes), start, stop)
    return FieldSummary.joined(_in_threads(blocks, measurement, 1), stop - start)


def joined_angles(
    stack: FieldStack, measurement: Measurement, parts: Iterable[FieldSummary]
) -> FieldAngles:
    """Join the parts of a stack in order, and check its fields against each other.

    Parameters
    ----------
    stack, measurement
        As for `measure_prepared`.
    parts : iterable of FieldSummary
        All parts, in order; as from `summed_part`.

    Returns
    -------
    FieldAngles
        One entry a field, in order.
    """
    lines = FieldSummary.joined(parts, stack.n_fields)
    recording = measurement.recording
    angles = angles_of(lines, np.arange(stack.n_fields, dtype=np.int64), measurement)
    if stack.times_s is not None:
        angles = _with_timestamps(angles, stack.times_s, recording)
    moved = np.zeros(stack.n_fields, np.bool_)
    if measurement.mark is not None:
        moved = moved_fields(lines.mark_shift, measurement.mark)
    seen = check_sequence(lines, recording, times_s=stack.times_s, displaced=moved)
    seen |= np.where(moved, int(Flag.CAMERA_MOVED), 0)
    return replace(angles, flags=angles.flags | seen)


def _told(
    parts: Iterator[FieldSummary], progress: Callable[[int], None] | None
) -> Iterator[FieldSummary]:
    for part in parts:
        yield part
        if progress is not None:
            progress(part.used.size)


def _in_threads(
    blocks: Iterable[tuple[int, NDArray[Any]]], measurement: Measurement, threads: int
) -> Iterator[FieldSummary]:
    """Measure the blocks in order, while at most one more than `threads` is held in memory."""
    if threads == 1:
        for start, block in blocks:
            yield summed_fields(block, start + np.arange(len(block)), measurement)
        return
    waiting: deque[Future[FieldSummary]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        for start, block in blocks:
            number = start + np.arange(len(block))
            waiting.append(pool.submit(summed_fields, block, number, measurement))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def summed_fields(
    block: NDArray[np.integer], number: NDArray[np.int64], measurement: Measurement
) -> FieldSummary:
    """Measure a block of fields as far as the sums over their columns, the mark's place included.

    Parameters
    ----------
    block, number, measurement
        As for `measure_fields`.

    Returns
    -------
    FieldSummary
        To be given to `angles_of`.
    """
    lines = measurement.summary(block, number)
    if measurement.mark is None:
        return lines
    shift = mark_shift(block, measurement.recording.parity_of(number), measurement.mark)
    return replace(lines, mark_shift=shift)


def angles_of(
    lines: FieldSummary, number: NDArray[np.int64], measurement: Measurement
) -> FieldAngles:
    """Return the angles of fields from what their columns come to.

    Parameters
    ----------
    lines : FieldSummary
        From `summed_fields`.
    number, measurement
        As for `measure_fields`.

    Returns
    -------
    FieldAngles
        One entry a field.
    """
    enough = lines.used >= _LEAST_COLUMNS
    variance = np.where(enough, _unit_variance(lines, measurement), np.nan)
    angle, angle_std, intercept, intercept_std = _attitude(lines, variance, measurement)
    recording = measurement.recording
    return FieldAngles(
        field=number,
        time_s=recording.time_of(number) + recording.exposure_s / 2,
        parity=recording.parity_of(number),
        angle=angle,
        angle_std=angle_std,
        intercept=intercept,
        intercept_std=intercept_std,
        columns_used=lines.used,
        rms_residual=np.sqrt(np.where(enough, lines.squares, np.nan) / np.maximum(lines.used, 1)),
        flags=_flags(lines, variance, angle_std, measurement),
    )


def fit_fields(
    block: NDArray[np.integer], number: NDArray[np.int64], measurement: Measurement
) -> tuple[ColumnCentres, LineFit]:
    """Measure the columns' centres and fit lines through them.

    Parameters
    ----------
    block, number, measurement
        As for `measure_fields`.

    Returns
    -------
    ColumnCentres
        The centres.
    LineFit
        The lines on the known plane, with weights that suppose the sample's noise.
    """
    centres = measurement.centres(block)
    s, z = measurement.on_plane(centres.row, number)
    fit = fit_lines_robustly(s, z, measurement.column_std, measurement.column_offset)
    return centres, fit


def _unit_variance(lines: FieldSummary, measurement: Measurement) -> _Array:
    """Variance of unit weight: what the centres' noise is over that of the sample."""
    freedom = np.maximum(lines.used - 2, 1)
    if not measurement.knows_noise:
        return lines.own_squares / freedom
    # The offsets took some of the noise away.
    squares = lines.own_squares * (1 + 1 / measurement.sample_size)
    with np.errstate(invalid="ignore", divide="ignore"):
        expected = measurement.growth(lines.height / lines.usual_height)
    variance: _Array = (_PRIOR_WEIGHT * expected + squares) / (_PRIOR_WEIGHT + freedom)
    return variance


def _attitude(
    lines: FieldSummary, variance: _Array, measurement: Measurement
) -> tuple[_Array, _Array, _Array, _Array]:
    """Angle and intercept, each with its noise: of the glint's line, or of the body's axis.

    `variance` is that of unit weight [field], NaN for fields without a line.
    """
    there = np.isfinite(variance)
    slope, intercept = (np.where(there, each, np.nan) for each in (lines.slope, lines.intercept))
    slope_var, intercept_var = variance * lines.slope_var, variance * lines.intercept_var
    sign = measurement.setup.glint.nose_sign
    if measurement.reflection is None:
        angle_std = np.sqrt(slope_var) / (1 + slope**2)
        return sign * np.arctan(slope), angle_std, intercept, np.sqrt(intercept_var)
    axis = measurement.reflection.axis_line(slope, intercept)
    pitch_std, _, glint_std = axis.stds(slope_var, intercept_var, variance * lines.covariance)
    return sign * axis.pitch, pitch_std, axis.glint_intercept, glint_std


def _flags(
    lines: FieldSummary, variance: _Array, angle_std: _Array, measurement: Measurement
) -> NDArray[np.int64]:
    """Collect the flags that each field shows on its own, and those of the whole stack."""
    columns = measurement.columns.size
    there = lines.used >= _LEAST_COLUMNS
    dim = lines.dim > 0.5 * np.maximum(lines.used, 1)
    conditions = {
        Flag.NO_GLINT: ~there,
        Flag.LOW_CONTRAST: there & (dim | (angle_std > _UNSURE)),
        Flag.TRUNCATED: lines.cut > _SHARE_FLAGGED * columns,
        Flag.SATURATED: lines.clipped > _SHARE_FLAGGED * columns,
        Flag.FEW_COLUMNS: lines.used < 0.5 * columns,
        Flag.POOR_LINE: there & (variance > _POOR**2),
        Flag.UNEVEN: there & _is_uneven(angle_std, measurement),
    }
    flags = np.where(there, int(_stack_flags(measurement)), 0)
    if not measurement.is_calibrated:
        flags |= int(Flag.UNCALIBRATED)
    if measurement.mark is not None:
        conditions[Flag.CAMERA_MOVED] = has_moved(lines.mark_shift, measurement.mark)
    for flag, where in conditions.items():
        flags[where] |= int(flag)
    return flags


def _stack_flags(measurement: Measurement) -> Flag:
    """Return the flags that the sample puts on every field with a line."""
    flags = Flag(0)
    if measurement.shape.second > _SECOND:
        flags |= Flag.SECOND_GLINT
    if _is_bent(measurement):
        flags |= Flag.CURVED_LINE
    if measurement.locks:
        flags |= Flag.PIXEL_LOCKING
    return flags


def _is_bent(measurement: Measurement) -> bool:
    sagitta = abs(measurement.sagitta)
    enough = sagitta > _BENT_LINES * measurement.line_height
    return bool(enough and sagitta > _BENT * measurement.sagitta_std)


def _is_uneven(angle_std: _Array, measurement: Measurement) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        whole = np.hypot(angle_std, measurement.slope_doubt)
        uneven: NDArray[np.bool_] = _LIKELY * whole > np.maximum(_BLAMELESS * angle_std, _SMALL)
    return uneven


def _with_timestamps(angles: FieldAngles, times_s: _Array, recording: Recording) -> FieldAngles:
    period = 1 / recording.rate_hz
    step = np.diff(times_s, prepend=times_s[0] - period)
    irregular = np.abs(step - period) > _TIMING_TOLERANCE * period
    return replace(
        angles,
        time_s=times_s + recording.exposure_s / 2,
        flags=angles.flags | np.where(irregular, int(Flag.TIMING), 0),
    )
