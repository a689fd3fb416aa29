"""What is asked of every HDF5 dataset first: that its data are in the file, and all of them.

Serves recorded points and MATLAB files of version 7.3.
"""

import math
import mmap
import struct
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import h5py

from glint_aoa.errors import RecordingError
from glint_aoa.records.fields import MAX_FIELD_BYTES

__all__ = ["check_heaps", "check_inside", "check_storage"]


def check_inside(path: Path, dataset: h5py.Dataset) -> None:
    """Refuse a dataset that keeps its data in other files."""
    plist = dataset.id.get_create_plist()
    if plist.get_layout() == h5py.h5d.VIRTUAL or plist.get_external_count():
        raise RecordingError(
            f"{path}: {dataset.name} keeps its data in other files, which are not followed; "
            "store the data in the file itself"
        )


def check_storage(path: Path, dataset: h5py.Dataset) -> None:
    """Hold a dataset's shape against what the file stores for it, before anything is allocated."""
    chunks = dataset.chunks
    n_bytes = math.prod(dataset.shape) * dataset.dtype.itemsize
    if chunks is None:
        is_whole = dataset.id.get_storage_size() >= n_bytes
    else:
        n_chunks = math.prod(
            math.ceil(n / chunk) for n, chunk in zip(dataset.shape, chunks, strict=True)
        )
        is_whole = dataset.id.get_num_chunks() >= n_chunks
        if math.prod(chunks) * dataset.dtype.itemsize > 2 * MAX_FIELD_BYTES:
            raise RecordingError(
                f"{path}: {dataset.name} is stored in chunks of {list(chunks)}, too large to read "
                "piece by piece; store it chunked by field"
            )
    if not is_whole:
        raise RecordingError(
            f"{path}: {dataset.name} promises {list(dataset.shape)} of {dataset.dtype}, but the "
            "file stores less; it is cut short, record or copy it again"
        )


_HEAP, _HEAP_HEAD, _OBJECT_HEAD = b"GCOL\x01\0\0\0", 16, 16
_SEARCHED = 64 << 20  # bytes at either end of a file


def check_heaps(path: Path) -> None:
    """Walk, once for each state of the file, the heaps in which HDF5 keeps texts.

    The library follows the sizes in them without end if one is wrong. Of a long file only both ends
    are searched for heaps.

    Raises
    ------
    RecordingError
        If a heap does not add up.
    """
    status = path.stat()
    wrong = _wrong_heap(path, status.st_size, status.st_mtime_ns)
    if wrong is not None:
        raise RecordingError(
            f"{path}: not an HDF5 file or damaged (the heap at byte {wrong} does not add up); "
            "record or copy it again"
        )


@lru_cache(maxsize=4096)
def _wrong_heap(path: Path, size: int, _changed_ns: int) -> int | None:
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for start in {0, max(_SEARCHED, size - _SEARCHED)}:
            for place in _heaps(content, start):
                if not _adds_up(content, place):
                    return place
    return None


def _heaps(content: mmap.mmap, start: int) -> Iterator[int]:
    place = content.find(_HEAP, start, start + _SEARCHED)
    while place >= 0:
        yield place
        place = content.find(_HEAP, place + 1, start + _SEARCHED)


def _adds_up(content: mmap.mmap, place: int) -> bool:
    """Whether a heap's objects, each with a head of number and size, fill it."""
    if place + _HEAP_HEAD > len(content):
        return False
    size: int = struct.unpack_from("<Q", content, place + 8)[0]
    end, at = place + size, place + _HEAP_HEAD
    if size < _HEAP_HEAD or end > len(content):
        return False
    taken: int
    while at + _OBJECT_HEAD <= end:
        number, taken = struct.unpack_from("<H6xQ", content, at)
        if number == 0:  # what is free, its head included
            return taken == end - at
        at += _OBJECT_HEAD + taken + -taken % 8
    return at <= end
