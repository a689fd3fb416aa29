"""NumPy arrays: ``.npy``, and ``.npz`` with an array called ``fields``. Pickles are refused."""

import math
import struct
import warnings
import weakref
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.fields import FieldInfo, FieldStack, checked_shape
from glint_aoa.records.formats._flat import flat_reader

__all__ = ["open_npy", "open_npz"]

_MEMBER = "fields.npy"
_LOCAL_HEADER = struct.Struct("<4s22xHH")
_MOST_DEFLATED = 1032
"""Deflate cannot shrink by more than this factor."""
_LARGE = 1 << 30
_SUSPICIOUS_RATIO = 100


def open_npy(path: Path) -> FieldStack:
    """Open a ``.npy`` file.

    Parameters
    ----------
    path : Path
        The file, an array of uint8 or uint16 [field, line, column].

    Returns
    -------
    FieldStack
        The fields; the file says nothing of rate, window and parity.

    Raises
    ------
    RecordingError
        If it is no such array, or is cut short.
    """
    size_of(path)
    with path.open("rb") as file:
        header = _Header(path, file)
    return _stack(path, header, offset=header.size)


def open_npz(path: Path) -> FieldStack:
    """Open the array ``fields`` of a ``.npz`` file.

    An array that `numpy.savez` stored is read where it lies. One that `numpy.savez_compressed`
    stored is unpacked from the front as it is read, so going back costs time but no memory.

    Parameters
    ----------
    path : Path
        The file, with an array ``fields`` of uint8 or uint16 [field, line, column].

    Returns
    -------
    FieldStack
        The fields; the file says nothing of rate, window and parity.

    Raises
    ------
    RecordingError
        If it holds no such array, is damaged, or unpacks to far more than it can hold.
    """
    size = size_of(path)
    try:
        archive = zipfile.ZipFile(path)
    except Exception as error:
        raise RecordingError(
            f"{path}: not a .npz file ({error}); save the fields with numpy.savez"
        ) from None
    with archive:
        member = _member(path, archive, size)
        header = _member_header(path, archive, member)
    if member.file_size != header.size + header.n_bytes:
        raise RecordingError(
            f"{path}: array fields promises {header.size + header.n_bytes} bytes but the archive "
            f"gives {member.file_size}; the file is damaged, save it again"
        )
    if member.compress_type == zipfile.ZIP_STORED:
        return _stack(path, header, offset=_data_offset(path, member) + header.size)
    if header.fortran_order:
        raise RecordingError(
            f"{path}: array fields is compressed in Fortran order, expected C order; "
            "save numpy.ascontiguousarray(fields)"
        )
    return FieldStack(path, header.shape, header.dtype, _Unpacker(path, header).read, FieldInfo())


class _Header:
    """Shape, type and order of a ``.npy`` file, whose first byte `file` stands at."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # old or odd spellings of a header are no concern
                version = npy_format.read_magic(file)
                read = {
                    (1, 0): npy_format.read_array_header_1_0,
                    (2, 0): npy_format.read_array_header_2_0,
                }[version]
                stated, self.fortran_order, self.dtype = read(file)
        except Exception as error:
            raise RecordingError(
                f"{path}: not a NumPy array ({type(error).__name__}: {error}); "
                "save the fields with numpy.save"
            ) from None
        self.size = file.tell()
        self.shape = checked_shape(str(path), stated, self.dtype)
        self.n_bytes = math.prod(self.shape) * self.dtype.itemsize


def _stack(path: Path, header: _Header, *, offset: int) -> FieldStack:
    read = flat_reader(
        path, header.shape, header.dtype, offset=offset, fortran_order=header.fortran_order
    )
    return FieldStack(path, header.shape, header.dtype, read, FieldInfo())


def _member(path: Path, archive: zipfile.ZipFile, size: int) -> zipfile.ZipInfo:
    try:
        member = archive.getinfo(_MEMBER)
    except KeyError:
        found = ", ".join(name.removesuffix(".npy") for name in archive.namelist()[:10])
        raise RecordingError(
            f"{path}: no array fields, found {found or 'nothing'}; "
            "save with numpy.savez(file, fields=...)"
        ) from None
    if member.flag_bits & 1 or member.compress_type not in (
        zipfile.ZIP_STORED,
        zipfile.ZIP_DEFLATED,
    ):
        raise RecordingError(
            f"{path}: array fields is encrypted or packed in a way that NumPy does not use; "
            "save it with numpy.savez"
        )
    packed, unpacked = member.compress_size, member.file_size
    is_bomb = unpacked > _LARGE and unpacked > _SUSPICIOUS_RATIO * packed
    if packed > size or unpacked > _MOST_DEFLATED * packed + 1024 or is_bomb:
        raise RecordingError(
            f"{path}: array fields claims to unpack from {packed} to {unpacked} bytes; "
            "refused as damaged or hostile, save it with numpy.savez"
        )
    return member


def _member_header(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> _Header:
    try:
        with archive.open(member) as file:
            return _Header(path, file)
    except RecordingError:
        raise
    except Exception as error:
        raise RecordingError(
            f"{path}: array fields cannot be read ({error}); the file is damaged, save it again"
        ) from None


def _data_offset(path: Path, member: zipfile.ZipInfo) -> int:
    with path.open("rb") as file:
        file.seek(member.header_offset)
        local = file.read(_LOCAL_HEADER.size)
    _, n_name, n_extra = _LOCAL_HEADER.unpack(local)
    return int(member.header_offset + _LOCAL_HEADER.size + n_name + n_extra)


class _Unpacker:
    """Reads fields of a deflated array, keeping its place between blocks."""

    def __init__(self, path: Path, header: _Header) -> None:
        self._header = header
        archive = zipfile.ZipFile(path)
        self._file = archive.open(_MEMBER)
        weakref.finalize(self, _close, self._file, archive)

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Return fields `start` to `stop`, the last one excluded, as [field, line, column]."""
        header = self._header
        field_bytes = header.n_bytes // header.shape[0]
        self._file.seek(header.size + start * field_bytes)
        pixels = np.frombuffer(self._file.read((stop - start) * field_bytes), header.dtype)
        return pixels.reshape(-1, *header.shape[1:])


def _close(*files: Any) -> None:
    for file in files:
        file.close()
