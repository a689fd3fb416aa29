"""Readers of recorded fields and channels, one file for each format.

`open_fields` picks the reader by the file's suffix. A reader only opens: it checks what the file
claims against what the file is, and hands back a stack that reads block by block.
`open_acquisition` looks at the first bytes of a file before it believes the suffix.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.formats._beside import Beside, told_beside, with_told
from glint_aoa.records.formats.cine import open_cine
from glint_aoa.records.formats.csv_text import read_csv
from glint_aoa.records.formats.hdf5 import (
    has_acquisition,
    open_hdf5,
    read_acquisition,
    read_meta,
)
from glint_aoa.records.formats.matlab import read_matlab
from glint_aoa.records.formats.numpy_files import open_npy, open_npz
from glint_aoa.records.formats.photron import open_photron
from glint_aoa.records.formats.picture_folder import open_pictures
from glint_aoa.records.formats.raw_dump import open_raw
from glint_aoa.records.formats.tdms import read_tdms
from glint_aoa.records.formats.tiff import open_tiff
from glint_aoa.records.formats.uff import read_uff
from glint_aoa.records.formats.video import VIDEO_SUFFIXES, open_video
from glint_aoa.setup import Fields, Inertial

__all__ = [
    "ACQUISITION_SUFFIXES",
    "HDF5_SUFFIXES",
    "SUFFIXES",
    "channels_beside",
    "open_acquisition",
    "open_fields",
    "said_of",
]

_Reader = Callable[[Path, Beside, Fields], FieldStack]


def _plain(reader: Callable[[Path], FieldStack]) -> _Reader:
    """Return the reader of a format that says itself what its fields are."""
    return lambda path, _told, _stated: reader(path)


def _told(reader: Callable[[Path, Beside], FieldStack]) -> _Reader:
    """Return the reader of a format that has to be told something."""
    return lambda path, told, _stated: reader(path, told)


_READERS: dict[str, _Reader] = {
    ".h5": _plain(open_hdf5),
    ".hdf5": _plain(open_hdf5),
    ".npy": _plain(open_npy),
    ".npz": _plain(open_npz),
    ".tif": _told(open_tiff),
    ".tiff": _told(open_tiff),
    ".mraw": _plain(open_photron),
    ".cih": _plain(open_photron),
    ".cihx": _plain(open_photron),
    ".cine": _plain(open_cine),
    **dict.fromkeys(VIDEO_SUFFIXES, open_video),
    ".raw": _told(open_raw),
    ".bin": _told(open_raw),
}

SUFFIXES = tuple(_READERS)
"""Suffixes of the files that `open_fields` reads."""


def open_fields(path: str | Path, stated: Fields | None = None) -> FieldStack:
    """Open a recording of fields; its suffix says the format.

    Parameters
    ----------
    path : str or Path
        HDF5 point (``.h5``), NumPy array (``.npy``, ``.npz`` with an array ``fields``), TIFF
        stack, video (``.avi``, ``.mkv``, ``.mp4``, ``.mov``), Phantom ``.cine``, Photron
        recording (``.mraw`` or its ``.cih``, ``.cihx``), raw dump (``.raw``, ``.bin``), or a
        folder of PNG or TIFF pictures. What ``<path>.toml`` beside it tells counts more than what
        the recording says.
    stated : Fields, optional
        Section of the setup. A video that does not say whether it is interlaced follows it.

    Returns
    -------
    FieldStack
        Fields [field, line, column], opened but not read.

    Raises
    ------
    RecordingError
        If the file is missing, of another format, damaged, empty, or holds no grey fields of
        uint8 or uint16.
    SetupError
        If the file beside it is wrong.
    """
    path = Path(path)
    if path.is_dir():
        told = told_beside(path)
        return with_told(open_pictures(path, told), told)
    size_of(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        found = f"suffix {path.suffix}" if path.suffix else "no suffix"
        raise RecordingError(
            f"{path}: {found}, expected one of {', '.join(SUFFIXES)}; "
            "convert the recording or correct its name"
        )
    told = told_beside(path)
    return with_told(reader(path, told, stated or Fields()), told)


_AcquisitionReader = Callable[[Path, Inertial | None], AcquisitionRecord]

_ACQUISITION_READERS: dict[str, _AcquisitionReader] = {
    ".h5": read_acquisition,
    ".hdf5": read_acquisition,
    ".tdms": read_tdms,
    ".uff": read_uff,
    ".unv": read_uff,
    ".mat": read_matlab,
    ".csv": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    ".dat": read_csv,
}

ACQUISITION_SUFFIXES = tuple(_ACQUISITION_READERS)
"""Suffixes of the files that `open_acquisition` reads."""

HDF5_SUFFIXES = {".h5", ".hdf5"}
"""Suffixes of recorded points."""

_HDF5 = b"\x89HDF\r\n\x1a\n"
_USER_BLOCK = 512  # of MATLAB's, before what is HDF5
_FIRST_DATA_SET = re.compile(rb"\A\s*-1[ ]*\r?\n[ ]*\d{1,5}b?\b")


def open_acquisition(path: str | Path, inertial: Inertial | None = None) -> AcquisitionRecord:
    """Open an acquisition record; its first bytes say the format, where they do not its suffix.

    Parameters
    ----------
    path : str or Path
        HDF5 point (``.h5``), TDMS, universal file (``.uff``, ``.unv``), MATLAB file (``.mat``) or
        text (``.csv``, ``.tsv``, ``.txt``, ``.dat``).
    inertial : Inertial, optional
        Section of the setup; its channels complete what the file does not say.

    Returns
    -------
    AcquisitionRecord
        As recorded: channels may differ in rate and start, and samples may be missing (NaN);
        `glint_aoa.records.conditioning.prepared` sees to both. Samples that take more than
        64 MiB together are read from the file as they are asked for (but not of UFF and of
        MATLAB before 7.3).

    Raises
    ------
    RecordingError
        If the file is missing, of another format, damaged or empty, or record and setup
        contradict each other.
    """
    path = Path(path)
    size_of(path)
    reader = _reader_by_content(path) or _ACQUISITION_READERS.get(path.suffix.lower())
    if reader is None:
        found = f"suffix {path.suffix}" if path.suffix else "no suffix"
        raise RecordingError(
            f"{path}: {found}, expected one of {', '.join(ACQUISITION_SUFFIXES)}; "
            "convert the record or correct its name"
        )
    return reader(path, inertial)


def channels_beside(recording: str | Path) -> Path | None:
    """Find the file with the acquisition channels of a recording of fields.

    Parameters
    ----------
    recording : str or Path
        Recording, as for `open_fields`.

    Returns
    -------
    Path or None
        The recording itself where it is HDF5 with channels; else a TDMS, UFF, MATLAB or HDF5 file
        of the same name beside it; None without one. Text is left out: results are text too.

    Raises
    ------
    RecordingError
        If an HDF5 file is damaged.
    """
    recording = Path(recording)
    others = [s for s, read in _ACQUISITION_READERS.items() if read is not read_csv]
    for path in (recording, *(recording.with_suffix(suffix) for suffix in others)):
        if path.suffix.lower() not in others or not path.is_file():
            continue
        if path.suffix.lower() not in HDF5_SUFFIXES or has_acquisition(path):
            return path
    return None


def _reader_by_content(path: Path) -> _AcquisitionReader | None:
    """Return the reader of a format that says its name in its first bytes; None for the others."""
    with path.open("rb") as file:
        head = file.read(_USER_BLOCK + len(_HDF5))
    if head.startswith(b"MATLAB"):
        return read_matlab
    if head.startswith(_HDF5):
        return read_matlab if path.suffix.lower() == ".mat" else read_acquisition
    if head.startswith(b"TDSm"):
        return read_tdms
    return read_uff if _FIRST_DATA_SET.match(head) else None


def said_of(path: Path) -> Mapping[str, object]:
    """Return what a recording says of its point: run, point, excitation and the like.

    HDF5 points need hold no fields for it.

    Raises
    ------
    RecordingError
        If the file cannot be opened.
    """
    return read_meta(path) if path.suffix.lower() in HDF5_SUFFIXES else open_fields(path).meta
