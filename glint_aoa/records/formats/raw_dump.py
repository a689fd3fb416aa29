"""Raw dumps: pixels one after the other, their shape told in ``<file>.toml`` beside them."""

from pathlib import Path

import numpy as np

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.fields import FieldInfo, FieldStack, checked_shape
from glint_aoa.records.formats._beside import Beside
from glint_aoa.records.formats._flat import flat_reader

__all__ = ["open_raw"]

_TYPES = {"uint8": "u1", "uint16": "<u2", "uint16-be": ">u2"}


def open_raw(path: Path, told: Beside) -> FieldStack:
    """Open a raw dump.

    Parameters
    ----------
    path : Path
        The file.
    told : Beside
        With `shape`, `data_type` and, where a header stands before the pixels, `offset`.

    Returns
    -------
    FieldStack
        The fields.

    Raises
    ------
    RecordingError
        If shape or type are not told, or the file is not of the size that they make.
    """
    size = size_of(path)
    if told.shape is None or told.data_type is None:
        missing = "shape" if told.shape is None else "data_type"
        raise RecordingError(
            f"{path}: a raw dump does not say its shape; write {path.name}.toml beside it with "
            f'shape = [fields, lines, columns] and data_type = "uint8" or "uint16" ({missing} is '
            "missing)"
        )
    dtype = np.dtype(_TYPES[told.data_type])
    shape = checked_shape(str(path), told.shape, dtype)
    needed = told.offset + shape[0] * shape[1] * shape[2] * dtype.itemsize
    if size != needed:
        raise RecordingError(
            f"{path}: has {size} bytes, but {path.name}.toml promises {needed} (offset "
            f"{told.offset}, fields {list(shape)} of {told.data_type}); correct it"
        )
    read = flat_reader(path, shape, dtype, offset=told.offset)
    return FieldStack(path, shape, dtype, read, FieldInfo())
