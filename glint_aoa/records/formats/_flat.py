"""Fields that lie in a file one pixel after the other, as plain bytes."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError

__all__ = ["flat_reader"]


def flat_reader(
    path: Path,
    shape: tuple[int, int, int],
    dtype: np.dtype[Any],
    *,
    offset: int = 0,
    fortran_order: bool = False,
) -> Callable[[int, int], NDArray[Any]]:
    """Return a reader of fields start to stop, the last one excluded.

    Parameters
    ----------
    path : Path
        The file.
    shape : (int, int, int)
        Numbers of fields, lines and columns.
    dtype : dtype
        Type of a pixel, byte order included.
    offset : int
        Where the first pixel lies [bytes].
    fortran_order : bool
        Whether the field's number changes fastest.

    Raises
    ------
    RecordingError
        If the file is shorter than the shape says.

    Notes
    -----
    Fields are read, not mapped, wherever they lie together: a file that shrinks while it is mapped
    would end the program, and mapped pages count as memory in use.
    """
    needed = offset + math.prod(shape) * dtype.itemsize
    size = path.stat().st_size
    if size < needed:
        raise RecordingError(
            f"{path}: its header promises fields {list(shape)} of {dtype}, {needed} bytes, but "
            f"the file has {size}; it is cut short, record or copy it again"
        )
    field_pixels = shape[1] * shape[2]

    def read(start: int, stop: int) -> NDArray[Any]:
        begin = offset + start * field_pixels * dtype.itemsize
        pixels = np.fromfile(path, dtype, (stop - start) * field_pixels, offset=begin)
        return pixels.reshape(-1, *shape[1:])

    def read_strided(start: int, stop: int) -> NDArray[Any]:
        pixels = np.memmap(path, dtype, "r", offset, shape, order="F")
        return np.array(pixels[start:stop], order="C")

    return read_strided if fortran_order else read
