"""Where the glint is and how wide: what the column estimators need to know beforehand."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.centroid import Centroid
from glint_aoa.optical.coarse import FAR_OUT, find_lines, patch_pitch
from glint_aoa.optical.columns import spread_columns
from glint_aoa.optical.shape import GlintShape
from glint_aoa.setup import Glint

__all__ = ["find_glint"]

_Array = NDArray[np.float64]

_HALF_BOXES = (1, 3, 8)  # lines: thin, usual and broad glints, before the width is known
_LEAST_NOISE = 0.5  # grey levels: what rounding to whole grey levels alone may hide
_LEAST_HALF_WIDTH = 2.5
_FLANK_SHARE = 0.6  # of the half width, on each side, is background
_LEAST_FLANK = 2.0
_CLEAREST = 0.9  # of the sample's fields are less clear than what the others are held against
_SHAPE_COLUMNS = 64
_SHAPE_SAMPLE = 7  # fields that show the glint's width
_COME_DOWN, _CEASED = 0.4, 0.02  # of a profile's height: fallen at least, and no more in two lines
_LEAST_ROOM = 6  # of the rows to look in hold half a box
_BAND_MARGIN = 6  # lines on either side of where the sample's lines and their flanks lie
_NOISE_SAMPLE = 2  # fields show the noise along lines


def find_glint(
    sample: NDArray[np.integer], glint: Glint, *, white_level: int | None = None
) -> GlintShape:
    """Find the glint's width and contrast in a few fields of a stack.

    The columns' profiles, shifted onto the measured centres, are averaged; the window follows
    from where the mean profile falls to a half and to a tenth.

    Parameters
    ----------
    sample : ndarray, shape (field, line, column)
        Fields that stand for the stack.
    glint : Glint
        The setup's section.
    white_level : int, optional
        Grey level at which pixels clip, where the setup does not say; the top of the data type
        if not given.

    Returns
    -------
    GlintShape
        The shape; ``found`` is False where no line stands out.
    """
    whole = sample
    shape, sample = _best_scale(whole, glint, white_level or np.iinfo(sample.dtype).max)
    columns = spread_columns(sample.shape[2], _SHAPE_COLUMNS)
    rows = find_lines(sample, shape).rows(columns, shape)
    for _ in range(2):  # the second round averages profiles that are better aligned
        profile = _mean_profile(sample, columns, rows, shape, (0, sample.shape[1]))
        if profile is None:
            return shape
        shape = _with_widths(shape, profile, glint)
        rows = find_lines(sample, shape).rows(columns, shape)
        rows = Centroid(shape).centres(sample, columns, rows).row
    looked_at = _mean_profile(sample, columns, rows, shape, (shape.first_row, shape.last_row))
    if looked_at is not None:
        shape = replace(shape, second=_second_height(looked_at, shape.half_width))
    return _with_band(shape, whole)


def _best_scale(
    sample: NDArray[np.integer], glint: Glint, white_level: int
) -> tuple[GlintShape, NDArray[np.integer]]:
    """Shape with the box of lines in which the glint stands out most, and fields that show it."""
    shapes = [_first_guess(sample, glint, white_level, half_box) for half_box in _HALF_BOXES]
    found = [find_lines(sample, shape) for shape in shapes]
    clear = np.array(
        [
            each.share * each.contrast / s.patch_threshold
            for s, each in zip(shapes, found, strict=True)
        ]
    )
    best = int(np.argmax(np.quantile(clear, _CLEAREST, axis=1)))
    shown = np.flatnonzero(clear[best] >= 0.5 * np.quantile(clear[best], _CLEAREST))
    few = shown[np.linspace(0, shown.size - 1, min(_SHAPE_SAMPLE, shown.size)).astype(int)]
    return shapes[best], sample[np.unique(few)]


def _first_guess(
    sample: NDArray[np.integer], glint: Glint, white_level: int, half_box: int
) -> GlintShape:
    first, last = glint.search_window or (0, sample.shape[1])
    looked_at = sample[:: max(1, len(sample) // _NOISE_SAMPLE), first:last]
    noise = _background_noise(looked_at)
    half_box = min(half_box, (last - first) // _LEAST_ROOM)
    half_width = glint.half_width or 2.0 * half_box + 2.0
    return GlintShape(
        first_row=first,
        last_row=last,
        band_first=first,
        band_last=last,
        half_box=half_box,
        surround=3 * half_box + 1,
        half_width=half_width,
        flank=max(_LEAST_FLANK, _FLANK_SHARE * half_width),
        sign=1 if glint.polarity == "bright" else -1,
        threshold=glint.min_contrast * _box_noise(looked_at, half_box, 1),
        patch_threshold=glint.min_contrast * _patch_noise(looked_at, half_box),
        usual_contrast=math.inf,
        saturation=white_level if glint.saturation is None else glint.saturation,
        noise=noise,
        second=0.0,
        found=False,
    )


def _background_noise(fields: NDArray[np.integer]) -> float:
    """Noise of one pixel from differences along lines: a glint hardly changes along a line."""
    if fields.shape[2] < 2:
        return _LEAST_NOISE
    return max(_LEAST_NOISE, _noise_along_lines(fields.astype(np.float64)))


def _patch_noise(fields: NDArray[np.integer], half_box: int) -> float:
    """Noise of a patch's box of lines held against two others, from differences along lines."""
    pixels = 8 // fields.dtype.itemsize
    pitch = patch_pitch(fields)
    whole = fields[:, :, : fields.shape[2] // pitch * pitch]
    patches = whole.reshape(*whole.shape[:2], -1, pitch).mean(axis=3)
    return math.sqrt(1.5) * _box_noise(patches, half_box, pixels)


def _box_noise(fields: NDArray[Any], half_box: int, pixels: int) -> float:
    """Noise of the mean of a box of lines, from differences along lines."""
    width = 2 * half_box + 1
    least = _LEAST_NOISE / math.sqrt(width * pixels)
    sums = np.cumsum(fields, axis=1, dtype=np.float64)
    boxes = (sums[:, width:] - sums[:, :-width]) / width
    if boxes.size == 0 or boxes.shape[2] < 2:
        return least
    return max(least, _noise_along_lines(boxes))


def _noise_along_lines(values: _Array) -> float:
    return 1.4826 * float(np.median(np.abs(np.diff(values, axis=2)))) / math.sqrt(2)


def _mean_profile(
    sample: NDArray[np.integer],
    columns: NDArray[np.int64],
    rows: _Array,
    shape: GlintShape,
    limits: tuple[int, int],
) -> _Array | None:
    """Mean profile about the centre, on a grid of lines as far as the limits go; NaN beyond."""
    field, column = np.nonzero(rows > FAR_OUT)
    if field.size < 3:
        return None
    middle = np.round(rows[field, column]).astype(np.int64)
    reach = sample.shape[1]
    about = middle[:, None] + np.arange(-reach, reach + 1)
    inside = (about >= limits[0]) & (about < limits[1])
    grey = sample[
        field[:, None],
        np.clip(about, 0, sample.shape[1] - 1),
        columns[column][:, None],
    ]
    count = inside.sum(axis=0)
    total = np.where(inside, shape.sign * grey.astype(np.float64), 0.0).sum(axis=0)
    return _level(np.where(count > 0.5 * field.size, total / np.maximum(count, 1), np.nan))


def _level(profile: _Array) -> _Array:
    """Take the tilt of the background off, as the middle one of the steps from line to line."""
    steps = np.diff(profile)
    known = steps[np.isfinite(steps)]
    tilt = float(np.median(known)) if known.size else 0.0
    return profile - tilt * (np.arange(profile.size) - profile.size // 2)


def _with_widths(shape: GlintShape, profile: _Array, glint: Glint) -> GlintShape:
    middle = profile.size // 2
    down, up = (_side_widths(side) for side in (profile[middle::-1], profile[middle:]))
    half = (down[0] + up[0]) / 2
    tenth = max((down[1] + up[1]) / 2, half + 0.5)
    # Least noise: 2.8 sigma (and what a line's height adds) for a Gaussian, which falls to a tenth
    # at 2.15 sigma; about twice the half width of a band with a flat top, known by its edges.
    half_width = glint.half_width or max(_LEAST_HALF_WIDTH, 1.29 * tenth + 0.55, 2.04 * half)
    rows = shape.last_row - shape.first_row
    half_box = int(np.clip(round(half - 0.5), 0, (rows - 1) // 2))
    fewer = math.sqrt((2 * shape.half_box + 1) / (2 * half_box + 1))  # lines, more noise
    return replace(
        shape,
        half_box=half_box,
        threshold=shape.threshold * fewer,
        patch_threshold=shape.patch_threshold * fewer,
        surround=math.ceil(half_width),
        half_width=half_width,
        flank=max(_LEAST_FLANK, _FLANK_SHARE * half_width),
        found=True,
    )


def _second_height(profile: _Array, half_width: float) -> float:
    """Height of the highest line beyond the window over that of the glint, both over the lowest."""
    middle, side = profile.size // 2, math.ceil(half_width)
    known = np.isfinite(profile)
    floor = np.min(profile[known])
    height = np.max(profile[middle - 1 : middle + 2]) - floor
    tallest = 0.0
    for half in (profile[: max(middle - side, 0)], profile[middle + side + 1 :]):
        inner = half[np.isfinite(half)]
        if inner.size < 3:
            continue
        peak = 1 + int(np.argmax(inner[1:-1]))
        valley = max(inner[:peak].min(), inner[peak + 1 :].min())
        tallest = max(tallest, inner[peak] - valley)
    return float(tallest / max(height, 1e-9))


def _with_band(shape: GlintShape, sample: NDArray[np.integer]) -> GlintShape:
    """Rows in which the sample's lines lie, and how clear they are there."""
    lines = find_lines(sample, shape)
    if not (lines.share > 0).any():
        return shape
    ends = lines.rows(np.array([0, sample.shape[2] // 2, sample.shape[2] - 1]), shape)
    ends = np.clip(ends[np.isfinite(ends)], shape.first_row, shape.last_row)
    margin = math.ceil(shape.half_width + shape.flank) + _BAND_MARGIN
    return replace(
        shape,
        band_first=max(math.floor(ends.min()) - margin, shape.first_row),
        band_last=min(math.ceil(ends.max()) + margin + 1, shape.last_row),
        usual_contrast=float(np.median(lines.contrast[lines.share > 0])),
    )


def _side_widths(side: _Array) -> tuple[float, float]:
    """Distances from the middle at which one side of a profile falls to a half and a tenth."""
    side = side[np.isfinite(side)]
    floor = _first_valley(side)
    top, bottom = side.max(), side[floor]
    falling = (side[: floor + 1] - bottom) / max(top - bottom, 1e-9)
    return _crossing(falling, 0.5), _crossing(falling, 0.1)


def _first_valley(side: _Array) -> int:
    """Index where a profile has come down: where it ceases to fall, or climbs again.

    Background that goes on falling slowly, or that a second line ends, is not the glint's.
    """
    height = np.ptp(side)
    for i in range(1, side.size - 2):
        down = side[i] < side.max() - _COME_DOWN * height
        if down and side[i] - min(side[i + 1], side[i + 2]) < _CEASED * height:
            return i
    return int(np.argmin(side))


def _crossing(falling: _Array, level: float) -> float:
    """Where the curve last falls through a level, linearly between its points."""
    above = np.flatnonzero(falling >= level)
    if above.size == 0 or above[-1] + 1 >= falling.size:
        return float(max(falling.size - 1, 1))
    i = int(above[-1])
    return i + float((falling[i] - level) / (falling[i] - falling[i + 1]))
