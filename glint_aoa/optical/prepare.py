"""What a sample of a stack teaches before its fields are measured."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.geometry import PixelToPlane
from glint_aoa.geometry.reflection import GlintReflection
from glint_aoa.optical import centroid, gaussian, profile, steger
from glint_aoa.optical.centroid import Centroid
from glint_aoa.optical.columns import used_columns
from glint_aoa.optical.detect import find_glint
from glint_aoa.optical.estimator import ColumnCentres, Estimator, Sample
from glint_aoa.optical.line import LineFit, fit_lines_robustly, row_medians
from glint_aoa.optical.locking import pixel_locking
from glint_aoa.optical.measurement import Measurement
from glint_aoa.optical.noise import NoiseModel, sample_noise
from glint_aoa.optical.reference import FIRST_FIELDS, Mark, learn_mark
from glint_aoa.optical.shape import GlintShape
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.recording import Recording
from glint_aoa.setup import Setup

__all__ = ["SAMPLE_SIZE", "prepare"]

_Array = NDArray[np.float64]

_LEARN: Mapping[str, Callable[[Sample, GlintShape, NoiseModel], Estimator]] = {
    "centroid": centroid.learn,
    "profile": profile.learn,
    "gaussian": gaussian.learn,
    "steger": steger.learn,
}

SAMPLE_SIZE = 64
"""Fields of a stack that it is learnt from."""

_LEAST_NOISE = 1e-4  # lines: what no estimate of a centre's noise goes below
_PRIOR_WEIGHTS = (10.0, 1000.0)  # fields that the usual noise of a column counts against its own
_LEAST_COLUMNS = 3
_OUTLYING = 4.0  # standard deviations at which a centre does not count for its column's noise
_ALIKE = 2.0  # times the noise that one profile may leave of all columns' pixels
_STEP_DOUBT = 0.25  # of the correction for a step that the glint hides
_ALIKE_LIT = 0.15  # of the brightness that fields which teach the profile may differ by
_STRETCHES = 8  # of columns whose lasting departures count as independent


def prepare(stack: FieldStack, setup: Setup, recording: Recording) -> Measurement:
    """Learn from a sample of the stack how its fields are to be measured.

    The sample gives the glint's width, the camera's noise, the line's profile, each column's
    noise, and each column's usual departure from the line (texture, paint, a bad pixel). Columns
    that usually lie far off get no weight: held for the whole stack, this does not make the angle
    jump as single columns come and go.

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
        To be given to `glint_aoa.optical.measure.measure_fields`.

    Raises
    ------
    RecordingError
        If there are fewer than three columns to measure.
    SetupError
        If a reflection is asked for that the camera cannot see.
    """
    size = min(SAMPLE_SIZE, stack.n_fields)
    number = np.unique(np.linspace(0, stack.n_fields - 1, size).astype(int))
    sample = np.concatenate([stack.read(int(k), int(k) + 1) for k in number])
    plain = _plain(stack, setup, recording, sample)
    rough, _, centres = _with_columns(plain, sample, number)
    if not rough.shape.found:
        return rough
    lit = _alike_lit(rough, centres)
    rows = _expected_rows(rough, centres, number)
    known = Sample(sample[lit], rough.columns, rows[lit])
    noise = sample_noise(known, rough.shape, setup.glint)
    estimator, drawn = _learnt(known, rough.shape, noise, setup.glint.estimator)
    learnt, fit, centres = _with_columns(
        replace(rough, estimator=estimator, noise=noise), sample, number
    )
    rows = _expected_rows(learnt, centres, number)
    locking = pixel_locking(centres.row, rows, learnt.columns, learnt.column_std**-2.0)
    learnt = replace(_with_lasting_departures(learnt, fit, drawn), locking=locking)
    return _with_reflection(learnt, stack.n_lines)


def _learnt(
    sample: Sample, shape: GlintShape, noise: NoiseModel, name: str
) -> tuple[Estimator, _Array]:
    """Learn the estimator of the setup; left to us, the best that suits the sample.

    Returns as well by what steps of the background that the glint hides may draw each column's
    centre [lines]: a part of the profile's correction for them, all of it where none is made.
    """
    if name not in {"auto", "profile"}:
        return _LEARN[name](sample, shape, noise), np.zeros(sample.columns.size)
    matched = profile.learn(sample, shape, noise)
    # Columns whose profiles differ are drawn to phases of the line by a profile that they share.
    if name == "profile" or matched.profile.misfit <= _ALIKE:
        return matched, _STEP_DOUBT * matched.step_correction
    return Centroid(shape), matched.step_correction


def _plain(
    stack: FieldStack, setup: Setup, recording: Recording, sample: NDArray[np.integer]
) -> Measurement:
    """Measurement by centroids with equal columns."""
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
    shape = find_glint(sample, setup.glint, white_level=stack.white_level)
    to_plane = PixelToPlane.of_camera(
        setup.camera, y=setup.glint.y, yaw=setup.glint.yaw, window=window
    )
    u = recording.first_column + columns.astype(np.float64)
    lines = (recording.first_line - 1.0, recording.first_line + stack.n_lines + 0.5)
    return Measurement(
        setup=setup,
        recording=recording,
        shape=shape,
        columns=columns,
        to_plane=to_plane,
        columns_to_plane=to_plane.of_columns(u, lines),
        estimator=Centroid(shape),
        noise=NoiseModel(shape.noise**2, 0.0, 0.0, shape.saturation, "background"),
        column_std=np.ones(columns.size),
        column_offset=np.zeros(columns.size),
        column_height=np.ones(columns.size),
        slope_doubt=0.0,
        sagitta=0.0,
        sagitta_std=np.inf,
        locking=None,
        sample_size=len(sample),
        mark=_mark(stack, setup, recording),
        reflection=None,
    )


def _mark(stack: FieldStack, setup: Setup, recording: Recording) -> Mark | None:
    if setup.glint.reference is None:
        return None
    first = stack.read(0, FIRST_FIELDS)
    return learn_mark(first, recording.parity_of(np.arange(len(first))), setup.glint.reference)


def _with_columns(
    plain: Measurement, sample: NDArray[np.integer], number: NDArray[np.int64]
) -> tuple[Measurement, LineFit, ColumnCentres]:
    """Add each column's noise, usual departure and height; returns the sample's lines as well."""
    centres = plain.centres(sample)
    s, z = plain.on_plane(centres.row, number)
    offset = plain.column_offset
    least = _LEAST_NOISE * plain.line_height
    scale = _robust_scale(_about_coarse_line(s, z, plain), least)
    fit = fit_lines_robustly(s, z, np.full(plain.columns.size, scale), offset)
    height = _column_heights(centres)
    flat = replace(plain, column_std=np.full(plain.columns.size, scale), column_height=height)
    if not np.isfinite(z).any() or not plain.knows_noise:
        return flat, fit, centres
    dimming = np.sqrt(flat.growth(flat.brightness(centres.height, np.isfinite(z))))
    offset, noise, count = _column_statistics(fit.residual, dimming[:, None])
    # A column's own noise is shrunk towards what its brightness lets expect.
    expected = np.sqrt(flat.growth(height / _median(height)))
    usual_noise = max(_median(noise / expected), least) * expected
    prior = _prior_weight(noise / usual_noise, count)
    variance = (count * noise**2 + prior * usual_noise**2) / (count + prior)
    trust = _trust(offset, _median(noise)) * (count >= 0.5 * number.size)
    with np.errstate(divide="ignore"):
        std = np.sqrt(np.maximum(variance, least**2) / trust)
    if np.isfinite(std).sum() < _LEAST_COLUMNS:
        return flat, fit, centres
    offset = np.where(count > 0, offset, 0.0)
    full = replace(flat, column_std=std, column_offset=offset)
    return full, fit_lines_robustly(s, z, std, offset), centres


def _prior_weight(ratio: _Array, count: NDArray[np.int64]) -> float:
    """Fields' worth of the usual noise: the more, the less the columns differ beyond chance."""
    known = np.isfinite(ratio) & (count > 1)
    if known.sum() < _LEAST_COLUMNS:
        return _PRIOR_WEIGHTS[0]
    chance = float(np.mean(2 / (count[known] - 1)))
    beyond = max(float(np.var(ratio[known] ** 2)) - chance, 0.0)
    return float(np.clip(2 / max(beyond, 1e-9), *_PRIOR_WEIGHTS))


def _alike_lit(measurement: Measurement, centres: ColumnCentres) -> NDArray[np.bool_]:
    """Fields of the sample in which the glint is about as bright: they show one profile."""
    height = measurement.brightness(centres.height, np.isfinite(centres.row))
    known = height[np.isfinite(height)]
    if not known.size:
        return np.ones(height.size, np.bool_)
    lit: NDArray[np.bool_] = (
        np.abs(height / np.quantile(known, 0.75, method="lower") - 1) < _ALIKE_LIT
    )
    return lit


def _expected_rows(
    measurement: Measurement, centres: ColumnCentres, number: NDArray[np.int64]
) -> _Array:
    """Where the line is in the sample: each field's line and the columns' usual departures."""
    s, z = measurement.on_plane(centres.row, number)
    fit = fit_lines_robustly(s, z, measurement.column_std, measurement.column_offset)
    off = (fit.residual - measurement.column_offset) / measurement.line_height
    off[~(fit.weight > 0)] = np.nan
    rows: _Array = centres.row + off  # heights grow upwards, rows downwards
    return rows


def _with_lasting_departures(measurement: Measurement, fit: LineFit, drawn: _Array) -> Measurement:
    """Add what the columns' usual departures tell of the line's bend and of the slope's doubt.

    `drawn` is by what hidden steps of the background may draw each column [lines].
    """
    weight = np.where(np.isfinite(measurement.column_std), measurement.column_std, np.inf) ** -2.0
    if (weight > 0).sum() <= _LEAST_COLUMNS or not measurement.knows_noise:
        return measurement
    x = np.linspace(-1.0, 1.0, measurement.columns.size)
    count = np.maximum(np.isfinite(fit.residual).sum(axis=0), 1)
    departure = np.where(weight > 0, measurement.column_offset, 0.0)
    basis = _orthogonal(np.stack([np.ones_like(x), x, x**2]), weight)
    norms = (weight * basis**2).sum(axis=1)
    bend = float((weight * basis[2] * departure).sum() / norms[2])
    left = departure - bend * basis[2]
    noise = _median_variance(weight, count)
    pull = weight * basis[1] / norms[1]
    hidden = float((pull * drawn).sum()) * measurement.line_height
    doubt = np.hypot(_doubt(pull, left, noise), hidden)
    return replace(
        measurement,
        slope_doubt=float(doubt) / (0.5 * measurement.span),
        sagitta=-bend,
        sagitta_std=_doubt(weight * basis[2] / norms[2], left, noise),
    )


def _doubt(pull: _Array, left: _Array, noise: _Array) -> float:
    """Say how much lasting departures, their noise taken off, leave in doubt of a line's figure.

    Where neighbouring columns depart together, whole stretches of them count as one draw; but few
    stretches may cancel by chance, so it is at least what columns leave that depart each alone.
    """
    pulled = pull * left
    stretches = np.array([part.sum() for part in np.array_split(pulled, _STRETCHES)])
    # Level, slope and bend took up three of the draws.
    variance = max(
        float((drawn**2).sum()) * drawn.size / (drawn.size - 3)
        for drawn in (stretches, pulled[pull != 0])
        if drawn.size > 3
    )
    return float(np.sqrt(max(variance - (pull**2 * noise).sum(), 0.0)))


def _median_variance(weight: _Array, count: NDArray[np.int64]) -> _Array:
    """Variance of the median departure of each column over its fields."""
    with np.errstate(divide="ignore"):
        return np.where(weight > 0, np.pi / 2 / (weight * count), 0.0)


def _orthogonal(rows: _Array, weight: _Array) -> _Array:
    """Make functions of the columns orthogonal under the weights, one after the other."""
    done: list[_Array] = []
    for row in rows:
        left = row.copy()
        for earlier in done:
            left -= (weight * earlier * row).sum() / (weight * earlier**2).sum() * earlier
        done.append(left)
    return np.stack(done)


def _with_reflection(measurement: Measurement, n_lines: int) -> Measurement:
    reflection = measurement.setup.glint.reflection
    if reflection is None:
        return measurement
    recording = measurement.recording
    model = GlintReflection.of_window(
        reflection,
        measurement.to_plane,
        recording.first_column + measurement.columns.astype(np.float64),
        (recording.first_line - 0.5, recording.first_line + n_lines),
        weight=1 / measurement.column_std**2,
    )
    return replace(measurement, reflection=model)


def _about_coarse_line(s: _Array, z: _Array, plain: Measurement) -> _Array:
    wide = np.full(plain.columns.size, _robust_scale(z - _row_mean(z), plain.line_height))
    return fit_lines_robustly(s, z, wide, plain.column_offset).residual


def _row_mean(z: _Array) -> _Array:
    there = np.isfinite(z)
    mean: _Array = np.where(there, z, 0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
    return mean[:, None]


def _column_heights(centres: ColumnCentres) -> _Array:
    """Usual height of each column; the usual column's where it was never measured."""
    height = np.where(np.isfinite(centres.row), centres.height, np.nan)
    each = row_medians(height.T)
    usual = _median(each)
    heights: _Array = np.where(np.isfinite(each) & (each > 0), each, usual if usual > 0 else 1.0)
    return heights


def _column_statistics(
    residual: _Array, dimming: _Array
) -> tuple[_Array, _Array, NDArray[np.int64]]:
    """Median, noise about it in a usual field and number of fields, for each column."""
    there = np.isfinite(residual)
    count = there.sum(axis=0)
    offset = row_medians(residual.T)
    departure = np.abs(residual - offset) / dimming
    with np.errstate(invalid="ignore"):
        kept = departure <= _OUTLYING * 1.4826 * row_medians(departure.T)
    freedom = np.maximum(kept.sum(axis=0) - 1, 1)
    noise = np.sqrt(np.where(kept, departure**2, 0.0).sum(axis=0) / freedom)
    noise *= np.sqrt(max(count.size, 3) / max(count.size - 2, 1))  # what the line took up
    noise[count < 2] = np.nan
    offset = np.where(np.isfinite(offset), offset, 0.0)
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
