"""TIFF stacks: one field a page, read page by page."""

import logging
import math
import struct
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.fields import FieldInfo, FieldStack, checked_shape
from glint_aoa.records.formats._flat import flat_reader

__all__ = ["open_tiff"]

# Its complaints reach whoever listens, but are not printed beside our own one sentence.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

_MINISBLACK = 1
_UNCOMPRESSED = 1


def open_tiff(path: Path) -> FieldStack:
    """Open a TIFF stack.

    Parameters
    ----------
    path : Path
        The file; each page is a grey field of uint8 or uint16. Large stacks of ImageJ, which
        describe their first page only, are read as well.

    Returns
    -------
    FieldStack
        The fields; the file says nothing of rate, window and parity.

    Raises
    ------
    RecordingError
        If it is no TIFF, is cut short, in colour, or packed in a way that cannot be unpacked.
    """
    size_of(path)
    pages = _Pages(path)
    first = pages.page(0)
    shape = (len(pages.offsets), first.imagelength, first.imagewidth)
    n_hidden = pages.n_images_of_imagej() if len(pages.offsets) == 1 else 1
    if n_hidden > 1:
        shape = (n_hidden, *shape[1:])
        dtype = first.dtype.newbyteorder(pages.byte_order)
        read = flat_reader(path, shape, dtype, offset=first.dataoffsets[0])
        return FieldStack(path, shape, dtype, read, FieldInfo())
    stack = FieldStack(path, shape, first.dtype, pages.read, FieldInfo())
    stack.read(0, 1)  # says now, not in the middle, that the packing is not known here
    return stack


class _Pages:
    """The pages of an open file, found by their offsets."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._tiff = tifffile.TiffFile(path)
        except Exception as error:
            raise RecordingError(
                f"{path}: not a TIFF file or damaged ({error}); export the recording again"
            ) from None
        weakref.finalize(self, self._tiff.close)
        self.byte_order = self._tiff.byteorder
        self.offsets = self._page_offsets()

    def _page_offsets(self) -> list[int]:
        """Follow the chain of pages, which tifffile would leave without a word where it breaks."""
        layout, file = self._tiff.tiff, self._tiff.filehandle
        file.seek(4 if layout.version == 42 else 8)
        offsets: dict[int, None] = {}
        try:
            (offset,) = struct.unpack(layout.offsetformat, file.read(layout.offsetsize))
            while offset:
                if offset in offsets:
                    self._fail(len(offsets), "the chain of pages runs in a circle")
                offsets[offset] = None
                file.seek(offset)
                (n_tags,) = struct.unpack(layout.tagnoformat, file.read(layout.tagnosize))
                file.seek(offset + layout.tagnosize + n_tags * layout.tagsize)
                (offset,) = struct.unpack(layout.offsetformat, file.read(layout.offsetsize))
        except (struct.error, OSError, ValueError, OverflowError):
            self._fail(max(len(offsets) - 1, 0), "the file ends before it")
        if not offsets:
            self._fail(0, "the file has none")
        return list(offsets)

    def n_images_of_imagej(self) -> int:
        """Return how many images ImageJ says lie behind the only page, 1 if it says nothing."""
        page = self.page(0)
        try:
            n_images = int((self._tiff.imagej_metadata or {}).get("images", 1))
        except Exception:  # what is no ImageJ description is no reason to refuse the page
            return 1
        return n_images if page.is_contiguous and page.compression == _UNCOMPRESSED else 1

    def page(self, index: int) -> Any:
        """Return page `index`, checked but not read."""
        try:
            self._tiff.filehandle.seek(self.offsets[index])
            page = tifffile.TiffPage(self._tiff, index)
            self._check_kind(index, page)
            self._check_extent(index, page)
        except RecordingError:
            raise
        except Exception as error:
            self._fail(index, str(error))
        return page

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Return pages `start` to `stop`, the last one excluded, as [field, line, column]."""
        first = self._pixels(start)
        fields = np.empty((stop - start, *first.shape), first.dtype)
        fields[0] = first
        for index in range(start + 1, stop):
            fields[index - start] = self._pixels(index, first)
        return fields

    def _pixels(self, index: int, like: NDArray[Any] | None = None) -> NDArray[Any]:
        page = self.page(index)
        if like is not None and (page.shape != like.shape or page.dtype != like.dtype):
            self._fail(index, f"it is {page.dtype} {list(page.shape)}, unlike the ones before")
        try:
            return np.asarray(page.asarray(maxworkers=1))
        except Exception as error:
            raise RecordingError(
                f"{self._path}: page {index} cannot be unpacked ({error}); "
                "export the recording again without compression"
            ) from None

    def _check_kind(self, index: int, page: Any) -> None:
        if page.dtype is None or page.samplesperpixel != 1 or page.photometric != _MINISBLACK:
            photometric = getattr(page.photometric, "name", page.photometric)
            raise RecordingError(
                f"{self._path}: page {index} is {photometric} with {page.samplesperpixel} samples "
                "a pixel, expected grey (MINISBLACK); export the recording again as grey"
            )
        checked_shape(str(self._path), (1, *page.shape), page.dtype)

    def _check_extent(self, index: int, page: Any) -> None:
        """Hold what the page claims against what the file has, before anything is allocated."""
        size = self._tiff.filehandle.size
        parts = list(zip(page.dataoffsets, page.databytecounts, strict=False))
        is_whole = len(parts) >= math.prod(page.chunked) and all(
            offset > 0 and count > 0 and offset + count <= size for offset, count in parts
        )
        is_short = page.compression == _UNCOMPRESSED and (
            8 * sum(page.databytecounts) < page.imagelength * page.imagewidth * page.bitspersample
        )
        is_swollen = math.prod(page.chunks) > 2 * page.imagelength * page.imagewidth + (1 << 20)
        if not is_whole or is_short or is_swollen:
            self._fail(index, f"its pixels do not lie within the file's {size} bytes")

    def _fail(self, index: int, why: str) -> None:
        raise RecordingError(
            f"{self._path}: page {index} cannot be read: {why}; "
            "the file is damaged, record or copy it again"
        )
