"""What a Phantom ``.cine`` says before its images: headers, times, exposures and offsets.

After "The Cine File Format" (Vision Research), little endian throughout: CINEFILEHEADER,
BITMAPINFOHEADER, SETUP, tagged blocks, image offsets.
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of

__all__ = ["CineHeader", "read_cine_header"]

_FILE_HEADER = struct.Struct("<2sHHHiIiIIIIII")
_BITMAP = struct.Struct("<IiiHHIIiiII")
_BLOCK = struct.Struct("<IHH")
_TIMES, _EXPOSURES = 1002, 1003
_MARK, _LENGTH = 140, 142
_SETUP_KEYS = {
    "flip_h": (756, "<i"),
    "flip_v": (760, "<i"),
    "frame_rate": (768, "<I"),
    "shutter_us": (772, "<I"),
    "cfa": (808, "<I"),
    "real_bits": (896, "<I"),
    "shutter_ns": (1568, "<I"),
    "white_level": (5736, "<i"),
}
"""Where SETUP keeps what is used of it; older cameras wrote a shorter one."""
_SYNC_BITS = 3  # of a time's fractions: whether it follows IRIG, not a time


@dataclass(frozen=True, eq=False)
class CineHeader:
    """What a recording says of itself.

    Attributes
    ----------
    n_images, lines, columns : int
        Size.
    bits : int
        Of a pixel on disk: 8, 16, or 10 or 12 where packed.
    packed : int
        Code of the packing; 0 for none.
    is_bottom_up : bool
        Whether the first line on disk is the lowest.
    compression : int
        Of the file: 0 grey or colour, 1 JPEG, 2 raw colour mosaic.
    first_image : int
        Number of the first image; the first one after the trigger is 0.
    trigger_s : float
        Trigger, in seconds since 1970, UTC [s].
    setup : mapping
        Keys of SETUP that the file has.
    times_s : ndarray [image] or None
        Times of the images after the trigger [s].
    exposures_s : ndarray [image] or None
        Exposures [s].
    offsets : ndarray of int64 [image]
        Where the images lie [bytes].
    """

    n_images: int
    lines: int
    columns: int
    bits: int
    packed: int
    is_bottom_up: bool
    compression: int
    first_image: int
    trigger_s: float
    setup: dict[str, int]
    times_s: NDArray[np.float64] | None
    exposures_s: NDArray[np.float64] | None
    offsets: NDArray[np.int64]


def read_cine_header(path: Path) -> CineHeader:
    """Read all that stands before the images.

    Raises
    ------
    RecordingError
        If it is no cine, or a part does not lie within the file.
    """
    parts = _Parts(path)
    mark, _, compression, _, _, _, first, n_images, *places = parts.unpack(0, _FILE_HEADER)
    if mark != b"CI":
        raise RecordingError(
            f"{path}: begins with {mark!r}, expected 'CI'; it is no Phantom recording, "
            "check its name"
        )
    at_bitmap, at_setup, at_offsets, fraction, seconds = places
    _, columns, lines, _, bits, packed, *_ = parts.unpack(at_bitmap, _BITMAP)
    offsets = parts.array(at_offsets, "<i8", n_images, "offsets of the images")
    setup, after_setup = _setup(parts, at_setup)
    trigger = seconds, fraction & ~_SYNC_BITS
    blocks = _blocks(parts, after_setup, at_offsets, n_images)
    exposures = blocks.get(_EXPOSURES)
    return CineHeader(
        n_images=n_images,
        lines=abs(lines),
        columns=columns,
        bits=bits,
        packed=packed,
        is_bottom_up=lines > 0 and not packed,
        compression=compression,
        first_image=first,
        trigger_s=trigger[0] + trigger[1] / 2**32,
        setup=setup,
        times_s=_since(blocks.get(_TIMES), trigger),
        exposures_s=None if exposures is None else exposures / 2**32,
        offsets=offsets.astype(np.int64),
    )


class _Parts:
    """Parts of a file, each held against its size before it is read."""

    def __init__(self, path: Path) -> None:
        self.path, self.size = path, size_of(path)

    def bytes(self, place: int, count: int, what: str) -> bytes:
        if place < 0 or count < 0 or place + count > self.size:
            raise RecordingError(
                f"{self.path}: the {what} should lie at bytes {place} to {place + count}, but the "
                f"file has {self.size}; it is cut short or damaged, copy it again"
            )
        with self.path.open("rb") as file:
            file.seek(place)
            return file.read(count)

    def unpack(self, place: int, layout: struct.Struct) -> tuple[Any, ...]:
        return layout.unpack(self.bytes(place, layout.size, "header"))

    def array(self, place: int, dtype: str, count: int, what: str) -> NDArray[Any]:
        itemsize = np.dtype(dtype).itemsize
        if count == 0:
            raise RecordingError(f"{self.path}: holds no images; check that it was saved")
        return np.frombuffer(self.bytes(place, count * itemsize, what), dtype)


def _setup(parts: _Parts, place: int) -> tuple[dict[str, int], int]:
    """Return what SETUP has of the keys that are used, and where it ends."""
    head = parts.bytes(place, _LENGTH + 2, "setup")
    (length,) = struct.unpack_from("<H", head, _LENGTH)
    if head[_MARK : _MARK + 2] != b"ST" or length < _LENGTH + 2:
        raise RecordingError(
            f"{parts.path}: the setup at byte {place} has no mark 'ST'; the file is damaged or "
            "older than this reader knows, save it again with the camera's software"
        )
    content = parts.bytes(place, length, "setup")
    known = {
        key: struct.unpack_from(kind, content, at)[0]
        for key, (at, kind) in _SETUP_KEYS.items()
        if at + 4 <= length
    }
    return known, place + length


def _blocks(parts: _Parts, place: int, end: int, n_images: int) -> dict[int, NDArray[Any]]:
    """Return times and exposures from the tagged blocks between setup and offsets."""
    wanted = {_TIMES: 2 * n_images, _EXPOSURES: n_images}
    found: dict[int, NDArray[Any]] = {}
    while place + _BLOCK.size <= end:
        size, tag, _ = parts.unpack(place, _BLOCK)
        if size < _BLOCK.size or place + size > end:
            break  # what is no chain of blocks says nothing
        if tag in wanted and size >= _BLOCK.size + 4 * wanted[tag]:
            found[tag] = parts.array(place + _BLOCK.size, "<u4", wanted[tag], "times")
        place += size
    return found


def _since(stamps: NDArray[Any] | None, trigger: tuple[int, int]) -> NDArray[np.float64] | None:
    """Return times after the trigger: whole seconds first, so that no digits are lost."""
    if stamps is None:
        return None
    fraction, second = (stamps.reshape(-1, 2).astype(np.int64) & ~np.array([_SYNC_BITS, 0])).T
    times: NDArray[np.float64] = (second - trigger[0]) + (fraction - trigger[1]) / 2**32
    return times
