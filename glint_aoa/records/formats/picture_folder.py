"""Folders of pictures, one field each: PNG or TIFF, in the order of the numbers in their names."""

import re
import struct
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.fields import MAX_FIELD_BYTES, FieldInfo, FieldStack, checked_shape
from glint_aoa.records.formats._beside import Beside
from glint_aoa.records.formats._colour import grey_note, grey_of
from glint_aoa.records.formats.tiff import open_tiff

__all__ = ["open_pictures"]

_PNG = b"\x89PNG\r\n\x1a\n"
_HEAD = struct.Struct(">8s4x4sIIBB")
_CHUNK = struct.Struct(">I4s")
_IHDR = (13, b"IHDR")
_NEEDED = {b"IHDR", b"IDAT", b"IEND"}
_GREY, _RGB, _RGBA = 0, 2, 6
_CHANNELS = {_GREY: 1, _RGB: 3, _RGBA: 4}
_MOST_DEFLATED = 1032
"""Deflate cannot shrink by more than this factor."""
_TIFF = (".tif", ".tiff")


def open_pictures(folder: Path, told: Beside) -> FieldStack:
    """Open a folder of pictures.

    Parameters
    ----------
    folder : Path
        The folder; all of its PNG files, or all of its TIFF files, are fields.
    told : Beside
        `rate`, which pictures never say; `channel` of colour.

    Returns
    -------
    FieldStack
        The fields, uint8 or uint16 as stored; times where numbers are missing in the names and
        the rate is told.

    Raises
    ------
    RecordingError
        If there are none, or both kinds, or a picture is damaged, of another size or kind than the
        first, or has levels of less than 8 bits.
    """
    pictures = _pictures(folder)
    reader: _PngFolder | _TiffFolder
    if pictures[0].suffix.lower() in _TIFF:
        reader = _TiffFolder(folder, pictures, told)
    else:
        reader = _PngFolder(folder, pictures, told)
    times_s, notes = _numbering(pictures, told.rate)
    shape = checked_shape(str(folder), (len(pictures), *reader.shape), reader.dtype)
    return FieldStack(
        folder,
        shape,
        reader.dtype,
        reader.read,
        FieldInfo(rate_hz=told.rate),
        times_s,
        notes=(*reader.notes, *notes),
    )


def _pictures(folder: Path) -> list[Path]:
    """Return the pictures of a folder by the numbers in their names; hidden files are left out."""
    found = [
        each
        for each in folder.iterdir()
        if each.suffix.lower() in {".png", *_TIFF} and not each.name.startswith(".")
    ]
    kinds = Counter("TIFF" if each.suffix.lower() in _TIFF else "PNG" for each in found)
    if len(kinds) != 1:
        what = " and ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())) or "none"
        raise RecordingError(
            f"{folder}: a folder, expected PNG or TIFF pictures in it, all of one kind, found "
            f"{what}; give the recording inside it, or a folder with the fields of one point"
        )
    return sorted(found, key=lambda each: (_numbers(each), each.name))


def _numbers(picture: Path) -> list[tuple[str, int]]:
    """Split a name into words and the numbers after them, so that 10 comes after 9."""
    parts = re.findall(r"(\D*)(\d{0,18})", picture.stem)
    return [(word, int(digits or -1)) for word, digits in parts]


def _numbering(
    pictures: list[Path], rate_hz: float | None
) -> tuple[NDArray[np.float64] | None, list[str]]:
    """Return times where the last numbers in the names skip some."""
    ends = [re.search(r"(\d{1,18})\D*$", picture.stem) for picture in pictures]
    number = np.array([int(end[1]) if end else -1 for end in ends])
    steps = np.diff(number)
    if not all(ends) or not (steps > 1).any() or (steps < 1).any():
        return None, []
    usual = int(np.bincount(np.minimum(steps, 1 << 20)).argmax())
    if (steps % usual).any() or (steps == usual).all():
        return None, []
    number = (number - number[0]) // usual
    missing = int(number[-1] + 1 - number.size)
    note = (
        f"{missing} numbers are missing in the names, the first before "
        f"{pictures[int(np.argmax(steps > usual)) + 1].name}"
    )
    return None if rate_hz is None else number / rate_hz, [note]


class _PngFolder:
    """Reads PNG pictures by number."""

    def __init__(self, folder: Path, pictures: list[Path], told: Beside) -> None:
        self._folder, self._pictures, self._channel = folder, pictures, told.channel
        self._kind = self._head(pictures[0])
        columns, lines, bits, colour = self._kind
        if bits not in (8, 16) or colour not in _CHANNELS:
            raise RecordingError(
                f"{pictures[0]}: PNG of {bits} bits, colour type {colour}, expected grey or RGB of "
                "8 or 16 bits; save the pictures as grey levels, without a palette"
            )
        self.shape = (lines, columns)
        self.dtype = np.dtype(np.uint8 if bits == 8 else np.uint16)
        self.notes = () if colour == _GREY else (grey_note(told.channel),)

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Return pictures `start` to `stop`, the last one excluded, as [field, line, column]."""
        fields = np.empty((stop - start, *self.shape), self.dtype)
        for place, picture in enumerate(self._pictures[start:stop]):
            fields[place] = self._grey(picture)
        return fields

    def _grey(self, picture: Path) -> NDArray[Any]:
        kind = self._head(picture)
        if kind != self._kind:
            raise RecordingError(
                f"{picture}: {kind[0]} x {kind[1]} of {kind[2]} bits, colour type {kind[3]}, "
                f"unlike the first picture of {self._folder}; keep the pictures of one point apart"
            )
        import cv2  # noqa: PLC0415  half a second that other formats need not wait for

        pixels = cv2.imdecode(_bare_png(picture), cv2.IMREAD_UNCHANGED)
        if pixels is None or pixels.shape[:2] != self.shape or pixels.dtype != self.dtype:
            raise RecordingError(f"{picture}: its pixels cannot be unpacked; copy or save it again")
        if pixels.ndim == 2:
            return np.asarray(pixels)
        return grey_of(pixels[..., 2::-1], self._channel)

    def _head(self, picture: Path) -> tuple[int, int, int, int]:
        """Return columns, lines, bits and colour type; what they promise must fit the file."""
        size = size_of(picture)
        with picture.open("rb") as file:
            head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise RecordingError(f"{picture}: ends after {size} bytes; copy or save it again")
        mark, chunk, columns, lines, bits, colour = _HEAD.unpack(head)
        if mark != _PNG or chunk != b"IHDR":
            raise RecordingError(f"{picture}: no PNG file; copy or save it again")
        n_bytes = columns * lines * bits * _CHANNELS.get(colour, 1) // 8
        if size > 2 * MAX_FIELD_BYTES:
            raise RecordingError(
                f"{picture}: {size} bytes, more than any field takes; copy or save it again"
            )
        if n_bytes > _MOST_DEFLATED * size:
            raise RecordingError(
                f"{picture}: promises {columns} x {lines} pixels in {size} bytes, more than can "
                "be packed in it; copy or save it again"
            )
        checked_shape(str(picture), (1, lines, columns), np.dtype(np.uint8 if bits <= 8 else "u2"))
        return columns, lines, bits, colour


def _bare_png(picture: Path) -> NDArray[np.uint8]:
    """Return a PNG of header and pixels only, whose parts are known to lie within the file.

    What else a file may hold, such as a gamma, transparency, or an animation, has no say in grey
    levels, and nothing is allocated for it.
    """
    content = picture.read_bytes()
    parts, place = [_PNG], len(_PNG)
    while place < len(content):
        length, name = _CHUNK.unpack_from(content.ljust(place + _CHUNK.size, b"\0"), place)
        end = place + _CHUNK.size + length + 4
        is_header = (length, name) == _IHDR
        if end > len(content) or (place == len(_PNG)) != is_header:
            raise RecordingError(
                f"{picture}: its part at byte {place} does not end within the file's "
                f"{len(content)} bytes or is out of order; copy or save it again"
            )
        if name in _NEEDED:
            parts.append(content[place:end])
        place = len(content) if name == b"IEND" else end
    return np.frombuffer(b"".join(parts), np.uint8)


class _TiffFolder:
    """Reads TIFF pictures of one page by number."""

    def __init__(self, folder: Path, pictures: list[Path], told: Beside) -> None:
        self._folder, self._pictures, self._told = folder, pictures, told
        first = open_tiff(pictures[0], told)
        self.shape, self.dtype, self.notes = first.shape[1:], first.dtype, first.notes

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Return pictures `start` to `stop`, the last one excluded, as [field, line, column]."""
        return np.concatenate([self._page(each) for each in self._pictures[start:stop]])

    def _page(self, picture: Path) -> NDArray[Any]:
        stack = open_tiff(picture, self._told)
        if stack.shape != (1, *self.shape) or stack.dtype != self.dtype:
            raise RecordingError(
                f"{picture}: {stack.dtype} {list(stack.shape)}, expected one page like the first "
                f"picture of {self._folder}, {self.dtype} {list(self.shape)}; keep the pictures of "
                "one point apart"
            )
        return stack.read(0, 1)
