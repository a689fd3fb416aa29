"""Light of evenly bright flat marks on a sensor: integrated over pixels, with blurred edges."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

__all__ = ["paint"]

Floats = NDArray[np.float64]

_STRIPS = 64  # a row
_CELLS = 8, 4  # a row and a column; what a strip covers of a cell is exact
_REACH = 5.0  # of the blur, in its standard deviations


def paint(
    outlines: Sequence[Floats], shape: tuple[int, int], *, blur: tuple[float, float] = (0.0, 0.0)
) -> Floats:
    """Return which part of each pixel's light comes from convex marks.

    The outline cuts each of 64 strips a row where it crosses the strip's middle.

    Parameters
    ----------
    outlines : sequence of ndarray [vertex, 2]
        Columns and rows of the corners of convex polygons, in order [pixels]; pixel centres are
        whole numbers.
    shape : tuple of int
        Rows and columns of the image.
    blur : tuple of float
        Standard deviation of the Gaussian blur along columns' numbers (u) and rows' (v) [pixels].

    Returns
    -------
    ndarray [row, column]
        0 outside, 1 inside, between the two at the edge.
    """
    image = np.zeros(shape)
    margin = np.ceil(_REACH * np.array(blur)).astype(int) + 1
    for outline in outlines:
        low = np.floor(outline.min(axis=0)).astype(int) - margin
        high = np.ceil(outline.max(axis=0)).astype(int) + margin + 1
        columns, rows = (
            _response(int(size), parts, sigma)
            for size, parts, sigma in zip(high - low, _CELLS[::-1], blur, strict=True)
        )
        patch = rows @ _coverage(outline, low, high) @ columns.T
        first, last = np.clip(low, 0, shape[::-1]), np.clip(high, 0, shape[::-1])
        inner = np.s_[first[1] - low[1] : last[1] - low[1], first[0] - low[0] : last[0] - low[0]]
        image[first[1] : last[1], first[0] : last[0]] += patch[inner]
    return image


def _response(pixels: int, parts: int, sigma: float) -> Floats:
    """How much each pixel takes of the light of each of its parts, shape (pixel, part)."""
    offset = (np.arange(pixels * parts) + 0.5) / parts - 0.5 - np.arange(pixels)[:, None]
    if sigma == 0.0:
        return np.where(np.abs(offset) < 0.5, 1 / parts, 0.0)
    share: Floats = (ndtr((offset + 0.5) / sigma) - ndtr((offset - 0.5) / sigma)) / parts
    return share


def _coverage(outline: Floats, low: NDArray[np.int64], high: NDArray[np.int64]) -> Floats:
    """Covered part of each cell, 8 a row and 4 a column, from pixel `low` to `high`."""
    parts = np.array([_CELLS[1], _STRIPS])
    start = parts * (outline - low + 0.5)
    end = np.roll(start, -1, axis=0)
    columns, rows = parts * (high - low)
    middle = np.arange(rows) + 0.5
    run = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (middle[:, None] - start[:, 1]) / run[:, 1]
    crossing = start[:, 0] + np.where(np.isfinite(along), along, 0.0) * run[:, 0]
    crossed = (along >= 0) & (along < 1)
    left = np.where(crossed, crossing, np.inf).min(axis=1)[:, None]
    right = np.where(crossed, crossing, -np.inf).max(axis=1)[:, None]
    edges = np.arange(columns + 1)
    covered = np.minimum(right, edges[1:]) - np.maximum(left, edges[:-1])
    cells = np.maximum(covered, 0.0).reshape(-1, _STRIPS // _CELLS[0], columns).mean(axis=1)
    return np.asarray(cells, np.float64)
