"""Where the glint is and how wide: what the column estimators need to know beforehand."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.centroid import centroid_columns
from glint_aoa.optical.shape import GlintShape
from glint_aoa.setup import Glint

__all__ = ["find_glint", "used_columns"]

_FIRST_BOX = 1  # half a box of three lines, before the glint's width is known
_LEAST_NOISE = 0.5  # grey levels: what rounding to whole grey levels alone may hide
_LEAST_HALF_WIDTH = 2.5
_FLANK_SHARE = 0.6  # of the half width, on each side, is background
_LEAST_FLANK = 2.0


def used_columns(n_columns: int, step: int) -> NDArray[np.int64]:
    """Columns at which centres are measured: every `step`, from the middle of the first step."""
    first = min(step // 2, (n_columns - 1) // 2)
    return np.arange(first, n_columns, step, dtype=np.int64)


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
    shape = _first_guess(sample, glint, white_level or np.iinfo(sample.dtype).max)
    columns = used_columns(sample.shape[2], max(1, sample.shape[2] // 64))
    for _ in range(2):  # the second round averages profiles that are better aligned
        profile = _mean_profile(sample, columns, shape)
        if profile is None:
            return shape
        shape = _with_widths(shape, profile, glint)
    return shape


def _first_guess(sample: NDArray[np.integer], glint: Glint, white_level: int) -> GlintShape:
    first, last = glint.search_window or (0, sample.shape[1])
    looked_at = sample[:, first:last].astype(np.float64)
    noise = _background_noise(looked_at)
    half_width = glint.half_width or 5.0
    return GlintShape(
        first_row=first,
        last_row=last,
        half_box=min(_FIRST_BOX, (last - first - 1) // 2),
        half_width=half_width,
        flank=max(_LEAST_FLANK, _FLANK_SHARE * half_width),
        sign=1 if glint.polarity == "bright" else -1,
        threshold=glint.min_contrast * noise,
        saturation=white_level if glint.saturation is None else glint.saturation,
        noise=noise,
        found=False,
    )


def _background_noise(fields: NDArray[np.float64]) -> float:
    """Noise of one pixel from differences along lines: a glint hardly changes along a line."""
    if fields.shape[2] < 2:
        return _LEAST_NOISE
    differences = np.abs(np.diff(fields, axis=2))
    return max(_LEAST_NOISE, 1.4826 * float(np.median(differences)) / math.sqrt(2))


def _mean_profile(
    sample: NDArray[np.integer], columns: NDArray[np.int64], shape: GlintShape
) -> NDArray[np.float64] | None:
    """Mean profile about the centre, on a grid of lines as far as the rows go; NaN beyond."""
    centres = centroid_columns(sample, columns, shape)
    field, column = np.nonzero(np.isfinite(centres.row))
    if field.size < 3:
        return None
    middle = np.round(centres.row[field, column]).astype(np.int64)
    reach = sample.shape[1]
    rows = middle[:, None] + np.arange(-reach, reach + 1)
    inside = (rows >= 0) & (rows < sample.shape[1])
    grey = sample[
        field[:, None],
        np.clip(rows, 0, sample.shape[1] - 1),
        columns[column][:, None],
    ]
    count = inside.sum(axis=0)
    total = np.where(inside, shape.sign * grey.astype(np.float64), 0.0).sum(axis=0)
    return np.where(count > 0.5 * field.size, total / np.maximum(count, 1), np.nan)


def _with_widths(shape: GlintShape, profile: NDArray[np.float64], glint: Glint) -> GlintShape:
    middle = profile.size // 2
    down, up = (_side_widths(side) for side in (profile[middle::-1], profile[middle:]))
    half = (down[0] + up[0]) / 2
    tenth = max((down[1] + up[1]) / 2, half + 0.5)
    # Least noise: 3 sigma (and what a line's height adds) for a Gaussian, which falls to a tenth
    # at 2.15 sigma; about twice the half width of a band with a flat top, known by its edges.
    half_width = glint.half_width or max(_LEAST_HALF_WIDTH, 1.4 * tenth + 0.6, 2.04 * half)
    rows = shape.last_row - shape.first_row
    return replace(
        shape,
        half_box=int(np.clip(round(half - 0.5), 0, (rows - 1) // 2)),
        half_width=half_width,
        flank=max(_LEAST_FLANK, _FLANK_SHARE * half_width),
        found=True,
    )


def _side_widths(side: NDArray[np.float64]) -> tuple[float, float]:
    """Distances from the middle at which one side of a profile falls to a half and a tenth."""
    side = side[np.isfinite(side)]
    floor = _first_valley(side)
    top, bottom = side.max(), side[floor]
    falling = (side[: floor + 1] - bottom) / max(top - bottom, 1e-9)
    return _crossing(falling, 0.5), _crossing(falling, 0.1)


def _first_valley(side: NDArray[np.float64]) -> int:
    """Index of the first minimum beyond which the profile climbs by a tenth of its height."""
    lowest = 0
    height = np.ptp(side)
    for i, value in enumerate(side):
        if value < side[lowest]:
            lowest = i
        elif value > side[lowest] + 0.1 * height and side[lowest] < side.max() - 0.5 * height:
            break
    return lowest


def _crossing(falling: NDArray[np.float64], level: float) -> float:
    """Where the curve last falls through a level, linearly between its points."""
    above = np.flatnonzero(falling >= level)
    if above.size == 0 or above[-1] + 1 >= falling.size:
        return float(max(falling.size - 1, 1))
    i = int(above[-1])
    return i + float((falling[i] - level) / (falling[i] - falling[i + 1]))
