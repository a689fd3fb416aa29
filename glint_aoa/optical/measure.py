"""From fields to angles: each field of a stack by what `prepare` learnt from a sample of it."""

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from glint_aoa.flags import Flag
from glint_aoa.optical.estimator import ColumnCentres
from glint_aoa.optical.line import LineFit, fit_lines_robustly
from glint_aoa.optical.prepare import Measurement, prepare
from glint_aoa.optical.reference import has_moved, mark_shift, moved_fields
from glint_aoa.optical.sequence import FieldLines, check_sequence
from glint_aoa.optical.shape import GlintShape
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.recording import Recording
from glint_aoa.setup import Setup

__all__ = [
    "FieldAngles",
    "Measurement",
    "fit_fields",
    "measure_fields",
    "measure_stack",
    "prepare",
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

    @classmethod
    def joined(cls, parts: list[Self]) -> Self:
        """Join the results of consecutive blocks."""
        return cls(
            **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)}
        )


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
    return _measured(block, number, measurement)[0]


def measure_stack(
    stack: FieldStack,
    setup: Setup,
    recording: Recording,
    *,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> tuple[FieldAngles, Measurement]:
    """Measure a whole stack, block by block, and check its fields against each other.

    Parameters
    ----------
    stack, setup, recording
        As for `prepare`.
    threads : int, optional
        Blocks that are measured at the same time; as many as there are processors if not given.
        The result does not depend on it.
    progress : callable, optional
        Called after each block with the number of fields that it held.

    Returns
    -------
    FieldAngles
        One entry a field, in order.
    Measurement
        What was learnt from the sample.
    """
    measurement = prepare(stack, setup, recording)
    parts = []
    for part in _in_threads(stack, measurement, threads or os.cpu_count() or 1):
        parts.append(part)
        if progress is not None:
            progress(part[0].field.size)
    angles = FieldAngles.joined([angles for angles, _ in parts])
    lines = FieldLines.joined([lines for _, lines in parts])
    if stack.times_s is not None:
        angles = _with_timestamps(angles, stack.times_s, recording)
    seen = check_sequence(lines, recording, times_s=stack.times_s)
    if measurement.mark is not None:
        moved = moved_fields(lines.mark_shift, measurement.mark)
        seen |= np.where(moved, int(Flag.CAMERA_MOVED), 0)
    return replace(angles, flags=angles.flags | seen), measurement


def _in_threads(
    stack: FieldStack, measurement: Measurement, threads: int
) -> Iterator[tuple[FieldAngles, FieldLines]]:
    """Measure the blocks in order, while at most one more than `threads` is held in memory."""
    if threads == 1:
        for start, block in stack.blocks():
            yield _measured(block, start + np.arange(len(block)), measurement)
        return
    waiting: deque[Future[tuple[FieldAngles, FieldLines]]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        for start, block in stack.blocks():
            number = start + np.arange(len(block))
            waiting.append(pool.submit(_measured, block, number, measurement))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _measured(
    block: NDArray[np.integer], number: NDArray[np.int64], measurement: Measurement
) -> tuple[FieldAngles, FieldLines]:
    centres, fit = fit_fields(block, number, measurement)
    used = fit.weight > 0
    count = used.sum(axis=1)
    enough = count >= _LEAST_COLUMNS
    variance, rms = _scatter(fit, used, measurement.dimming(centres.height, used), measurement)
    fit = _scaled(fit, np.where(enough, variance, np.nan))
    angle, angle_std, intercept, intercept_std = _attitude(fit, measurement)
    recording, shift = measurement.recording, _mark_shift(block, number, measurement)
    angles = FieldAngles(
        field=number,
        time_s=recording.time_of(number) + recording.exposure_s / 2,
        parity=recording.parity_of(number),
        angle=angle,
        angle_std=angle_std,
        intercept=intercept,
        intercept_std=intercept_std,
        columns_used=count,
        rms_residual=np.where(enough, rms, np.nan),
        flags=_flags(centres, used, variance, measurement, angle_std)
        | _mark_flags(shift, measurement),
    )
    lines = FieldLines.of_block(
        centres.row, centres.height, measurement.columns, used, mark_shift=shift
    )
    return angles, lines


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


def _scaled(fit: LineFit, variance: _Array) -> LineFit:
    """Give the line's variances their scale; NaN for fields without a line."""
    there = np.isfinite(variance)
    return replace(
        fit,
        slope=np.where(there, fit.slope, np.nan),
        intercept=np.where(there, fit.intercept, np.nan),
        slope_var=variance * fit.slope_var,
        intercept_var=variance * fit.intercept_var,
        covariance=variance * fit.covariance,
    )


def _attitude(fit: LineFit, measurement: Measurement) -> tuple[_Array, _Array, _Array, _Array]:
    """Angle and intercept, each with its noise: of the glint's line, or of the body's axis."""
    sign = measurement.setup.glint.nose_sign
    if measurement.reflection is None:
        angle = sign * np.arctan(fit.slope)
        angle_std = np.sqrt(fit.slope_var) / (1 + fit.slope**2)
        return angle, angle_std, fit.intercept, np.sqrt(fit.intercept_var)
    axis = measurement.reflection.axis_line(fit.slope, fit.intercept)
    pitch_std, _, glint_std = axis.stds(fit.slope_var, fit.intercept_var, fit.covariance)
    return sign * axis.pitch, pitch_std, axis.glint_intercept, glint_std


def _scatter(
    fit: LineFit, used: NDArray[np.bool_], dimming: _Array, measurement: Measurement
) -> tuple[_Array, _Array]:
    """Variance of unit weight, and rms departure from the line, of each field."""
    residual = np.where(used, fit.residual, 0.0)
    count = used.sum(axis=1)
    rms = np.sqrt((residual**2).sum(axis=1) / np.maximum(count, 1))
    own = np.where(used, fit.residual - measurement.column_offset, 0.0)
    freedom = np.maximum(count - 2, 1)
    sum_of_squares = (fit.weight * own**2).sum(axis=1)
    if not measurement.knows_noise:
        return sum_of_squares / freedom, rms
    sum_of_squares *= 1 + 1 / measurement.sample_size  # the offsets took some of the noise away
    return (_PRIOR_WEIGHT * dimming + sum_of_squares) / (_PRIOR_WEIGHT + freedom), rms


def _flags(
    centres: ColumnCentres,
    used: NDArray[np.bool_],
    variance: _Array,
    measurement: Measurement,
    angle_std: _Array,
) -> NDArray[np.int64]:
    """Collect the flags that each field shows on its own."""
    count, columns = used.sum(axis=1), used.shape[1]
    there = count >= _LEAST_COLUMNS
    height = np.where(used, centres.height, np.nan)
    unsure = angle_std > _UNSURE
    conditions = {
        Flag.NO_GLINT: ~there,
        Flag.LOW_CONTRAST: there & (_dim(height, measurement.shape) | unsure),
        Flag.TRUNCATED: centres.cut.sum(axis=1) > _SHARE_FLAGGED * columns,
        Flag.SATURATED: (centres.clipped & used).sum(axis=1) > _SHARE_FLAGGED * columns,
        Flag.FEW_COLUMNS: count < 0.5 * columns,
        Flag.POOR_LINE: there & (variance > _POOR**2),
        Flag.UNCALIBRATED: np.full(len(count), not measurement.is_calibrated),
        Flag.SECOND_GLINT: there & (measurement.shape.second > _SECOND),
        Flag.CURVED_LINE: there & _is_bent(measurement),
        Flag.PIXEL_LOCKING: there & measurement.locks,
        Flag.UNEVEN: there & _is_uneven(angle_std, measurement),
    }
    flags = np.zeros(len(count), np.int64)
    for flag, where in conditions.items():
        flags |= np.where(where, int(flag), 0)
    return flags


def _mark_shift(
    block: NDArray[np.integer], number: NDArray[np.int64], measurement: Measurement
) -> _Array:
    if measurement.mark is None:
        return np.full((len(block), 2), np.nan)
    return mark_shift(block, measurement.recording.parity_of(number), measurement.mark)


def _mark_flags(shift: _Array, measurement: Measurement) -> NDArray[np.int64]:
    mark = measurement.mark
    moved = np.zeros(len(shift), np.bool_) if mark is None else has_moved(shift, mark)
    return np.where(moved, int(Flag.CAMERA_MOVED), 0)


def _dim(height: _Array, shape: GlintShape) -> NDArray[np.bool_]:
    low = np.where(np.isfinite(height), height < shape.threshold, False).sum(axis=1)
    dim: NDArray[np.bool_] = low > 0.5 * np.maximum(np.isfinite(height).sum(axis=1), 1)
    return dim


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
