"""Readers of recorded fields and channels, one file for each format.

`open_fields` picks the reader by the file's suffix. A reader only opens: it checks what the file
claims against what the file is, and hands back a stack that reads block by block.
"""

from collections.abc import Callable
from pathlib import Path

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.formats.hdf5 import open_hdf5
from glint_aoa.records.formats.numpy_files import open_npy, open_npz
from glint_aoa.records.formats.photron import open_photron
from glint_aoa.records.formats.tiff import open_tiff

__all__ = ["SUFFIXES", "open_fields"]

_READERS: dict[str, Callable[[Path], FieldStack]] = {
    ".h5": open_hdf5,
    ".hdf5": open_hdf5,
    ".npy": open_npy,
    ".npz": open_npz,
    ".tif": open_tiff,
    ".tiff": open_tiff,
    ".mraw": open_photron,
    ".cih": open_photron,
    ".cihx": open_photron,
}

SUFFIXES = tuple(_READERS)
"""Suffixes of the files that `open_fields` reads."""


def open_fields(path: str | Path) -> FieldStack:
    """Open a recording of fields; its suffix says the format.

    Parameters
    ----------
    path : str or Path
        HDF5 point (``.h5``), NumPy array (``.npy``, ``.npz`` with an array ``fields``), TIFF
        stack, or Photron recording (``.mraw`` or its ``.cih``, ``.cihx``).

    Returns
    -------
    FieldStack
        Fields [field, line, column], opened but not read.

    Raises
    ------
    RecordingError
        If the file is missing, of another format, damaged, empty, or holds no grey fields of
        uint8 or uint16.
    """
    path = Path(path)
    size_of(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        found = f"suffix {path.suffix}" if path.suffix else "no suffix"
        raise RecordingError(
            f"{path}: {found}, expected one of {', '.join(SUFFIXES)}; "
            "convert the recording or correct its name"
        )
    return reader(path)
