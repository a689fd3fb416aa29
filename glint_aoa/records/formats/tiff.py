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
from glint_aoa.records.formats._beside import Beside, Channel
from glint_aoa.records.formats._colour import grey_note, grey_of
from glint_aoa.records.formats._flat import flat_reader
from glint_aoa.records.formats._tiff_words import TiffWords, words_of

__all__ = ["open_tiff"]

# Its complaints reach whoever listens, but are not printed beside our own one sentence.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

_MINISBLACK, _RGB = 1, 2
_SIDE_BY_SIDE = 1
_UNCOMPRESSED = 1


def open_tiff(path: Path, told: Beside) -> FieldStack:
    """Open a TIFF stack.

    Parameters
    ----------
    path : Path
        The file; each page is a field of uint8 or uint16, grey or RGB. Large stacks of ImageJ,
        which describe their first page only, are read as well.
    told : Beside
        `channel` of colour.

    Returns
    -------
    FieldStack
        The fields, and the rate where ImageJ or OME state one; nothing of window and parity.

    Raises
    ------
    RecordingError
        If it is no TIFF, is cut short, a sequence in more than one of channel, depth and time, or
        packed in a way that cannot be unpacked.
    """
    size_of(path)
    pages = _Pages(path, told.channel)
    first = pages.page(0)
    shape = (len(pages.offsets), first.imagelength, first.imagewidth)
    words = pages.words()
    info = FieldInfo(rate_hz=words.rate_hz)
    if shape[0] == 1 and (words.n_images or 1) > 1 and pages.is_plain(first):
        shape = (words.n_images or 1, *shape[1:])
        dtype = first.dtype.newbyteorder(pages.byte_order)
        read = flat_reader(path, shape, dtype, offset=first.dataoffsets[0])
        return FieldStack(path, shape, dtype, read, info)
    _check_whole(path, words, shape[0])
    notes = () if first.photometric == _MINISBLACK else (grey_note(told.channel),)
    white = None if words.bits is None or words.bits >= 16 else (1 << words.bits) - 1
    stack = FieldStack(path, shape, first.dtype, pages.read, info, white_level=white, notes=notes)
    stack.read(0, 1)  # says now, not in the middle, that the packing is not known here
    return stack


def _check_whole(path: Path, words: TiffWords, n_pages: int) -> None:
    if words.n_images is not None and words.n_images > n_pages:
        raise RecordingError(
            f"{path}: its description speaks of {words.n_images} images, the file has {n_pages}; "
            "others may lie in other files, which are not followed: export them into one"
        )


class _Pages:
    """The pages of an open file, found by their offsets."""

    def __init__(self, path: Path, channel: Channel | None) -> None:
        self._path, self._channel = path, channel
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

    def words(self) -> TiffWords:
        """Return what ImageJ or OME say of the stack."""
        return words_of(self._path, self._tiff)

    @staticmethod
    def is_plain(page: Any) -> bool:
        """Whether the pixels of a page lie in the file one after the other, as grey levels."""
        is_grey = page.photometric == _MINISBLACK
        return bool(is_grey and page.is_contiguous and page.compression == _UNCOMPRESSED)

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
        if like is not None and (page.shape[:2] != like.shape or page.dtype != like.dtype):
            self._fail(index, f"it is {page.dtype} {list(page.shape)}, unlike the ones before")
        try:
            pixels = np.asarray(page.asarray(maxworkers=1))
        except Exception as error:
            raise RecordingError(
                f"{self._path}: page {index} cannot be unpacked ({error}); "
                "export the recording again without compression, with 8 or 16 bits"
            ) from None
        return pixels if pixels.ndim == 2 else grey_of(pixels, self._channel)

    def _check_kind(self, index: int, page: Any) -> None:
        is_grey = page.samplesperpixel == 1 and page.photometric == _MINISBLACK
        is_rgb = (
            page.samplesperpixel in (3, 4)
            and page.photometric == _RGB
            and page.planarconfig == _SIDE_BY_SIDE
        )
        if page.dtype is None or not (is_grey or is_rgb):
            photometric = getattr(page.photometric, "name", page.photometric)
            raise RecordingError(
                f"{self._path}: page {index} is {photometric} with {page.samplesperpixel} samples "
                "a pixel, expected grey (MINISBLACK) or RGB; export the recording again as grey"
            )
        checked_shape(str(self._path), (1, *page.shape[:2]), page.dtype)

    def _check_extent(self, index: int, page: Any) -> None:
        """Hold what the page claims against what the file has, before anything is allocated."""
        size = self._tiff.filehandle.size
        parts = list(zip(page.dataoffsets, page.databytecounts, strict=False))
        is_whole = len(parts) >= math.prod(page.chunked) and all(
            offset > 0 and count > 0 and offset + count <= size for offset, count in parts
        )
        n_samples = page.imagelength * page.imagewidth * page.samplesperpixel
        is_short = page.compression == _UNCOMPRESSED and (
            8 * sum(page.databytecounts) < n_samples * page.bitspersample
        )
        is_swollen = math.prod(page.chunks) > 2 * n_samples + (1 << 20)
        if not is_whole or is_short or is_swollen:
            self._fail(index, f"its pixels do not lie within the file's {size} bytes")

    def _fail(self, index: int, why: str) -> None:
        raise RecordingError(
            f"{self._path}: page {index} cannot be read: {why}; "
            "the file is damaged, record or copy it again"
        )
