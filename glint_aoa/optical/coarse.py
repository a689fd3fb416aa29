"""The coarse line of each field: where the column estimators start."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.shape import GlintShape

__all__ = ["FAR_OUT", "CoarseLines", "find_lines", "patch_pitch", "search_settings"]

_Array = NDArray[np.float64]

FAR_OUT = -1e6
"""Row of a line where it has left the rows to look in."""

_LEAST_PATCHES = 8
_SHORT_HALF_BOX = 3  # lines: four boxes of 7 x 8 pixels of 8 bits, and
_SHORT_ROWS = 2**15 - 1  # the number of a row, fit 16 bits


@dataclass(frozen=True)
class CoarseLines:
    """The line of each field, good to a part of a line where it is straight.

    Attributes
    ----------
    coefficients : ndarray, shape (field, 3)
        Row against column, in rising powers; NaN where no line was found.
    share : ndarray, shape (field,)
        Share of the bright patches of a field that lie on its line.
    contrast : ndarray, shape (field,)
        Their mean height over what surrounds them [grey levels].
    """

    coefficients: _Array
    share: _Array
    contrast: _Array

    def rows(self, columns: NDArray[np.int64], shape: GlintShape) -> _Array:
        """Row of the lines at columns [field, column]: NaN where none, far out beyond the rows."""
        u = columns.astype(np.float64)
        c = self.coefficients
        rows = (c[:, 2:3] * u + c[:, 1:2]) * u + c[:, 0:1]
        outside = (rows < shape.first_row - 0.5) | (rows > shape.last_row - 0.5)
        rows[outside] = FAR_OUT
        return rows


def find_lines(fields: NDArray[np.integer], shape: GlintShape) -> CoarseLines:
    """Find the line in each field.

    Patches of eight pixels along the lines (four of 16 bits) are summed; in each, the box of lines
    that stands out most votes for a straight line, and the line on which most agree is fitted to
    the peaks of its voters; as a parabola where it is bent.

    Parameters
    ----------
    fields : ndarray, shape (field, line, column)
        Grey levels, uint8 or uint16.
    shape : GlintShape
        What is known of the glint.

    Returns
    -------
    CoarseLines
        The lines.
    """
    from glint_aoa.optical import _locate_kernel as kernel  # noqa: PLC0415  compiles

    n = len(fields)
    line, share, contrast = np.empty((n, 3)), np.empty(n), np.empty(n)
    kernel.coarse_lines(
        np.ascontiguousarray(fields), search_settings(fields, shape), line, share, contrast
    )
    return CoarseLines(line, share, contrast)


def search_settings(fields: NDArray[np.integer], shape: GlintShape) -> tuple[Any, ...]:
    """Return what the compiled search takes besides the fields."""
    small = fields.dtype.itemsize == 1 and shape.half_box <= _SHORT_HALF_BOX
    short = small and fields.shape[1] <= _SHORT_ROWS
    return (
        patch_pitch(fields),
        (shape.band_first, shape.band_last),
        (shape.first_row, shape.last_row),
        shape.half_box,
        shape.surround,
        shape.sign,
        shape.patch_threshold,
        shape.usual_contrast,
        FAR_OUT,
        np.empty(0, np.int16 if short else np.int32),  # the shorter type is the faster one
    )


def patch_pitch(fields: NDArray[np.integer]) -> int:
    """Columns from one patch to the next: as many as it has pixels, or one in a narrow window."""
    pixels = 8 // fields.dtype.itemsize
    return pixels if fields.shape[2] >= _LEAST_PATCHES * pixels else 1
