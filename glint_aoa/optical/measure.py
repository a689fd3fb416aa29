"""From fields to angles: what is learnt from a sample of a stack, then each field."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.flags import Flag
from glint_aoa.geometry import PixelToPlane
from glint_aoa.optical.centroid import ColumnCentres, centroid_columns
from glint_aoa.optical.detect import find_glint, used_columns
from glint_aoa.optical.line import LineFit, fit_lines_robustly
from glint_aoa.optical.shape import GlintShape
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.recording import Recording
from glint_aoa.setup import Setup

__all__ = ["FieldAngles", "Measurement", "measure_fields", "measure_stack", "prepare"]

_Array = NDArray[np.float64]

_SAMPLE = 64  # fields that stand for a stack
_SHAPE_SAMPLE = 7  # of them, odd and even among them, show the glint's width
_LEAST_SAMPLE = 8  # fields below which a column's own offset cannot be told from its noise
_LEAST_NOISE = 1e-4  # lines: what no estimate of a centre's noise goes below
_PRIOR_WEIGHT = 10  # degrees of freedom that the sample's noise counts against a field's own
_POOR = 5.0  # times the usual scatter about the line
_LEAST_COLUMNS = 3
_SHARE_FLAGGED = 0.1  # of the columns cut or clipped before the field is flagged
_TIMING_TOLERANCE = 0.2  # of a field period


@dataclass(frozen=True)
class Measurement:
    """How the fields of one stack are measured; made by `prepare`.

    Attributes
    ----------
    setup, recording
        What is known of camera, glint and recording.
    shape : GlintShape
        What the sample showed of the glint.
    columns : ndarray, shape (column,)
        Columns measured, 0-based in the recorded window.
    to_plane : PixelToPlane
        From sensor pixels to the known plane.
    column_std, column_offset : ndarray, shape (column,)
        Noise of a column's centre, 1 sigma, and its usual departure from the line; both as
        height on the plane [m, or pixels without a pixel pitch].
    sample_size : int
        Fields in the sample; the noise is unknown below 8.
    """

    setup: Setup
    recording: Recording
    shape: GlintShape
    columns: NDArray[np.int64]
    to_plane: PixelToPlane
    column_std: _Array
    column_offset: _Array
    sample_size: int

    @property
    def is_calibrated(self) -> bool:
        """Whether angles are in the tunnel frame rather than in the image plane."""
        return self.to_plane.position is not None

    @property
    def knows_noise(self) -> bool:
        """Whether the sample was large enough to tell noise from departure."""
        return self.sample_size >= _LEAST_SAMPLE


@dataclass(frozen=True)
class FieldAngles:
    """Angle and intercept of each field; lengths in metres, angles in radians, NaN if missing.

    Every attribute has shape (field,) except `centre_row`, shape (field, column): the centres in
    rows of the recorded window.
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
    centre_row: _Array

    @classmethod
    def joined(cls, parts: list[Self]) -> Self:
        """Join the results of consecutive blocks."""
        return cls(
            **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)}
        )


def prepare(stack: FieldStack, setup: Setup, recording: Recording) -> Measurement:
    """Learn from a sample of the stack how its fields are to be measured.

    The sample gives the glint's width, each column's noise, and each column's usual departure
    from the line (texture, paint, a bad pixel). Columns that usually lie far off get no weight:
    held for the whole stack, this does not make the angle jump as single columns come and go.

    Parameters
    ----------
    stack : FieldStack
        The fields.
    setup : Setup
        The setup.
    recording : Recording
        Timing and window, from `glint_aoa.records.recording.resolve_recording`.

    Returns
    -------
    Measurement
        To be given to `measure_fields`.

    Raises
    ------
    RecordingError
        If there are fewer than three columns to measure.
    """
    number = np.unique(np.linspace(0, stack.n_fields - 1, min(_SAMPLE, stack.n_fields)).astype(int))
    sample = np.concatenate([stack.read(int(k), int(k) + 1) for k in number])
    columns = used_columns(stack.n_columns, setup.glint.column_step)
    if columns.size < _LEAST_COLUMNS:
        raise RecordingError(
            f"{stack.name}: {stack.n_columns} columns at a step of {setup.glint.column_step} leave "
            f"{columns.size} to measure; a line needs three, so lower glint.column_step"
        )
    window = (
        recording.first_column + (stack.n_columns - 1) / 2,
        recording.first_line + (stack.n_lines - 1) / 2,
    )
    plain = Measurement(
        setup=setup,
        recording=recording,
        shape=find_glint(
            sample[:: max(1, number.size // _SHAPE_SAMPLE)],
            setup.glint,
            white_level=stack.white_level,
        ),
        columns=columns,
        to_plane=PixelToPlane.of_camera(
            setup.camera, y=setup.glint.y, yaw=setup.glint.yaw, window=window
        ),
        column_std=np.ones(columns.size),
        column_offset=np.zeros(columns.size),
        sample_size=number.size,
    )
    return _with_column_noise(plain, sample, number)


def measure_fields(
    block: NDArray[np.integer], number: NDArray[np.int64], measurement: Measurement
) -> FieldAngles:
    """Measure a block of fields.

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
    centres = centroid_columns(block, measurement.columns, measurement.shape)
    s, z = _on_plane(centres, number, measurement)
    fit = fit_lines_robustly(s, z, measurement.column_std, measurement.column_offset)
    used = fit.weight > 0
    count = used.sum(axis=1)
    enough = count >= _LEAST_COLUMNS
    variance, rms = _scatter(fit, used, measurement)
    scale = np.where(enough, np.sqrt(variance), np.nan)
    recording = measurement.recording
    return FieldAngles(
        field=number,
        time_s=recording.time_of(number) + recording.exposure_s / 2,
        parity=recording.parity_of(number),
        angle=np.where(enough, measurement.setup.glint.nose_sign * np.arctan(fit.slope), np.nan),
        angle_std=scale * np.sqrt(fit.slope_var) / (1 + fit.slope**2),
        intercept=np.where(enough, fit.intercept, np.nan),
        intercept_std=scale * np.sqrt(fit.intercept_var),
        columns_used=count,
        rms_residual=np.where(enough, rms, np.nan),
        flags=_flags(centres, used, variance, measurement),
        centre_row=centres.row,
    )


def measure_stack(
    stack: FieldStack,
    setup: Setup,
    recording: Recording,
    *,
    progress: Callable[[int], None] | None = None,
) -> tuple[FieldAngles, Measurement]:
    """Measure a whole stack, block by block.

    Parameters
    ----------
    stack, setup, recording
        As for `prepare`.
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
    for start, block in stack.blocks():
        number = np.arange(start, start + len(block), dtype=np.int64)
        parts.append(measure_fields(block, number, measurement))
        if progress is not None:
            progress(len(block))
    angles = FieldAngles.joined(parts)
    if stack.times_s is not None:
        angles = _with_timestamps(angles, stack.times_s, recording)
    return angles, measurement


def _on_plane(
    centres: ColumnCentres, number: NDArray[np.int64], measurement: Measurement
) -> tuple[_Array, _Array]:
    recording = measurement.recording
    u = recording.first_column + measurement.columns.astype(np.float64)
    return measurement.to_plane(u, recording.line_of(centres.row, number))


def _with_column_noise(
    plain: Measurement, sample: NDArray[np.integer], number: NDArray[np.int64]
) -> Measurement:
    centres = centroid_columns(sample, plain.columns, plain.shape)
    s, z = _on_plane(centres, number, plain)
    if not np.isfinite(z).any():
        return plain
    least = _LEAST_NOISE * _line_height(plain)
    flat = np.full(plain.columns.size, _robust_scale(_about_coarse_line(s, z, plain), least))
    residual = fit_lines_robustly(s, z, flat, plain.column_offset).residual
    if not plain.knows_noise:
        return replace(plain, column_std=flat)
    offset, noise, count = _column_statistics(residual)
    usual_noise = _median(noise)
    # A column's own noise is shrunk towards the usual one by what the sample cannot know.
    variance = (count * noise**2 + _PRIOR_WEIGHT * usual_noise**2) / (count + _PRIOR_WEIGHT)
    trust = _trust(offset, usual_noise) * (count >= 0.5 * number.size)
    with np.errstate(divide="ignore"):
        std = np.sqrt(np.maximum(variance, least**2) / trust)
    if np.isfinite(std).sum() < _LEAST_COLUMNS:
        return replace(plain, column_std=flat)
    return replace(plain, column_std=std, column_offset=np.where(count > 0, offset, 0.0))


def _line_height(measurement: Measurement) -> float:
    """Height of a field line on the plane, at the window's middle."""
    recording, middle = measurement.recording, measurement.columns[measurement.columns.size // 2]
    row = (measurement.shape.first_row + measurement.shape.last_row) / 2
    v = recording.first_line + row + np.array([0.0, 1.0])
    _, z = measurement.to_plane(np.full(2, recording.first_column + middle), v)
    return float(abs(z[1] - z[0]))


def _about_coarse_line(s: _Array, z: _Array, plain: Measurement) -> _Array:
    wide = np.full(plain.columns.size, _robust_scale(z - _row_mean(z), _line_height(plain)))
    return fit_lines_robustly(s, z, wide, plain.column_offset).residual


def _row_mean(z: _Array) -> _Array:
    there = np.isfinite(z)
    mean: _Array = np.where(there, z, 0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
    return mean[:, None]


def _column_statistics(residual: _Array) -> tuple[_Array, _Array, NDArray[np.int64]]:
    """Median, noise about it and number of fields, for each column."""
    there = np.isfinite(residual)
    count = there.sum(axis=0)
    offset, noise = np.zeros(len(count)), np.full(len(count), np.nan)
    for c in np.flatnonzero(count):
        values = residual[there[:, c], c]
        offset[c] = np.median(values)
        noise[c] = 1.4826 * np.median(np.abs(values - offset[c]))
    return offset, np.where(np.isfinite(noise), noise, _median(noise)), count


def _trust(offset: _Array, noise: float) -> _Array:
    """Bisquare weight of a column from how far it usually lies off the line."""
    scale = _robust_scale(offset, noise)
    weight: _Array = np.clip(1 - (offset / (6.0 * scale)) ** 2, 0.0, 1.0) ** 2
    return weight


def _robust_scale(values: _Array, least: float) -> float:
    return max(1.4826 * _median(np.abs(values)), least, float(np.finfo(np.float32).tiny))


def _median(values: _Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else 0.0


def _scatter(
    fit: LineFit, used: NDArray[np.bool_], measurement: Measurement
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
    return (_PRIOR_WEIGHT + sum_of_squares) / (_PRIOR_WEIGHT + freedom), rms


def _flags(
    centres: ColumnCentres,
    used: NDArray[np.bool_],
    variance: _Array,
    measurement: Measurement,
) -> NDArray[np.int64]:
    """Collect the flags of each field."""
    count, columns = used.sum(axis=1), used.shape[1]
    there = count >= _LEAST_COLUMNS
    height = np.where(used, centres.height, np.nan)
    cut = centres.cut.sum(axis=1)
    conditions = {
        Flag.NO_GLINT: ~there,
        Flag.LOW_CONTRAST: there & _dim(height, measurement.shape),
        Flag.TRUNCATED: cut > _SHARE_FLAGGED * columns,
        Flag.SATURATED: (centres.clipped & used).sum(axis=1) > _SHARE_FLAGGED * columns,
        Flag.FEW_COLUMNS: count < 0.5 * columns,
        Flag.POOR_LINE: there & (variance > _POOR**2),
        Flag.UNCALIBRATED: np.full(len(count), not measurement.is_calibrated),
    }
    flags = np.zeros(len(count), np.int64)
    for flag, where in conditions.items():
        flags |= np.where(where, int(flag), 0)
    return flags


def _dim(height: _Array, shape: GlintShape) -> NDArray[np.bool_]:
    low = np.where(np.isfinite(height), height < shape.threshold, False).sum(axis=1)
    dim: NDArray[np.bool_] = low > 0.5 * np.maximum(np.isfinite(height).sum(axis=1), 1)
    return dim


def _with_timestamps(angles: FieldAngles, times_s: _Array, recording: Recording) -> FieldAngles:
    period = 1 / recording.rate_hz
    step = np.diff(times_s, prepend=times_s[0] - period)
    irregular = np.abs(step - period) > _TIMING_TOLERANCE * period
    return replace(
        angles,
        time_s=times_s + recording.exposure_s / 2,
        flags=angles.flags | np.where(irregular, int(Flag.TIMING), 0),
    )
