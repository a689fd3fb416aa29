"""Phantom recordings, ``.cine``: grey images of 8 or 16 bits, or packed in 10 or 12.

FFmpeg's reader was weighed instead: it knows no times, exposures or trigger, and leaves packed
images of 10 bits in their gamma. It serves the tests as a second opinion.
"""

import datetime
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.fields import FieldInfo, FieldStack, checked_shape
from glint_aoa.records.formats._cine_header import CineHeader, read_cine_header
from glint_aoa.records.formats.photron import unpack_12_bits

__all__ = ["linear_of_10_bits", "open_cine", "unpack_10_bits"]

_PACKED_10, _PACKED_12 = 256, 1024
_BLACK = 64  # of both scales
_LAST_CODE = 1014  # of 10 bits; those beyond are clipped
_LINEAR_TOP = 4095
_CODE_SPAN, _LINEAR_SPAN = 958.39, 4072.61
_IMPOSSIBLE = 1000  # periods away from where an image belongs
_UNEQUAL = 0.01  # of the exposure


def open_cine(path: Path) -> FieldStack:
    """Open a Phantom recording.

    Packed images of 10 bits hold the camera's companded codes, which are put back on a linear
    scale of 12 bits (`linear_of_10_bits`); all other levels stay as stored. Images are as the
    sensor saw them, whatever flip the camera's software was told to show them with.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    FieldStack
        Progressive frames, uint8 or uint16, with the camera's own times; time 0 is the trigger.

    Raises
    ------
    RecordingError
        If it is no cine, is cut short, in colour, or compressed.

    Notes
    -----
    The camera's time stamp is taken as the start of the exposure. A camera that stamps the end
    makes times late by one exposure.
    """
    header = read_cine_header(path)
    reader = _Reader(path, header)
    rate_hz, times_s, notes = _timing(header)
    exposure_s, uneven = _exposure(header)
    try:
        info = FieldInfo(
            rate_hz=rate_hz,
            exposure_s=exposure_s,
            interlaced=False,
            start_s=_start(header, rate_hz, times_s),
            trigger_time=_iso(header.trigger_s),
        )
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}; correct it in the camera's software") from None
    return FieldStack(
        path,
        checked_shape(str(path), (header.n_images, header.lines, header.columns), reader.dtype),
        reader.dtype,
        reader.read,
        info,
        times_s,
        white_level=reader.white_level,
        notes=(*reader.notes, *notes, *uneven),
    )


def unpack_10_bits(packed: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Unpack pixels of 10 bits, four in five bytes, most significant bits first.

    Parameters
    ----------
    packed : ndarray [byte]
        As many bytes as five divides.

    Returns
    -------
    ndarray [pixel]
        Codes 0 to 1023.
    """
    byte = packed.reshape(-1, 5).astype(np.uint16)
    codes = np.empty((len(byte), 4), np.uint16)
    for pixel in range(4):
        low = 6 - 2 * pixel  # bits of the second byte that belong to the next pixel
        codes[:, pixel] = (byte[:, pixel] << (8 - low)) & 0x3FF | byte[:, pixel + 1] >> low
    return codes.ravel()


def linear_of_10_bits() -> NDArray[np.uint16]:
    """Return the linear level, of 12 bits, of each code of packed 10 bits.

    Returns
    -------
    ndarray [1024]
        Levels 0 to 4095; black is 64 in both.

    Notes
    -----
    The camera's table is the curve of ITU-R BT.709, L = V / 4.5 below V = 0.081 and
    ((V + 0.099) / 1.099)^(1 / 0.45) above, with V = (code - 64) / 958.39 and level
    64 + 4072.61 L, and clips codes above 1014. Programs that carry the maker's table agree; held
    against every sixteenth entry of it, and its two ends, this curve is within one level but for
    code 0, where the table has 2.
    """
    code = np.arange(1024.0)
    v = (code - _BLACK) / _CODE_SPAN
    light = np.where(v < 0.081, v / 4.5, ((np.maximum(v, 0) + 0.099) / 1.099) ** (1 / 0.45))
    level = np.rint(_BLACK + _LINEAR_SPAN * light)
    level[code > _LAST_CODE] = _LINEAR_TOP
    return np.clip(level, 0, _LINEAR_TOP).astype(np.uint16)


class _Reader:
    """Reads images by number."""

    def __init__(self, path: Path, header: CineHeader) -> None:
        self._path, self._header = path, header
        self._size = size_of(path)
        bits = {_PACKED_10: 10, _PACKED_12: 12}.get(header.packed, header.bits)
        self._check_kind(bits)
        self.dtype = np.dtype(np.uint8 if bits == 8 else np.uint16)
        self._linear = linear_of_10_bits() if bits == 10 else None
        self.white_level = self._white(bits)
        self.notes = tuple(self._asides())
        self._row = header.columns * bits // 8
        for number in (0, header.n_images - 1):
            self._place(number)

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Return images `start` to `stop`, the last one excluded, as [field, line, column]."""
        header = self._header
        fields = np.empty((stop - start, header.lines, header.columns), self.dtype)
        with self._path.open("rb") as file:
            for number in range(start, stop):
                place, stride = self._place(number)
                file.seek(place)
                content = np.frombuffer(file.read(stride * header.lines), np.uint8)
                lines = content.reshape(header.lines, stride)[:, : self._row]
                fields[number - start] = self._levels(lines)
        return fields[:, ::-1] if header.is_bottom_up else fields

    def _levels(self, lines: NDArray[np.uint8]) -> NDArray[Any]:
        packed, shape = self._header.packed, (self._header.lines, self._header.columns)
        if packed == _PACKED_12:
            return unpack_12_bits(lines.ravel()).reshape(shape)
        if self._linear is not None:
            return self._linear[unpack_10_bits(lines.ravel())].reshape(shape)
        return np.ascontiguousarray(lines).view(self.dtype.newbyteorder("<"))

    def _place(self, number: int) -> tuple[int, int]:
        """Return where the pixels of an image begin and how long a line is [bytes]."""
        offset = int(self._header.offsets[number])
        notes_size, n_bytes = 0, 0
        if 0 <= offset <= self._size - 8:
            with self._path.open("rb") as file:
                file.seek(offset)
                (notes_size,) = struct.unpack("<I", file.read(4))
                file.seek(offset + max(notes_size, 8) - 4)
                (n_bytes,) = struct.unpack("<I", file.read(4).ljust(4, b"\0"))
        place = offset + notes_size
        for stride in (self._row, -(-self._row // 4) * 4):
            if n_bytes == stride * self._header.lines:
                break
        else:
            self._fail(number, f"it has {n_bytes} bytes, expected {self._row * self._header.lines}")
        if notes_size < 8 or place + n_bytes > self._size:
            self._fail(number, f"it does not lie within the file's {self._size} bytes")
        return place, stride

    def _fail(self, number: int, why: str) -> None:
        raise RecordingError(
            f"{self._path}: image {number} at byte {int(self._header.offsets[number])} cannot be "
            f"read: {why}; the file is cut short or damaged, copy it again"
        )

    def _check_kind(self, bits: int) -> None:
        header = self._header
        is_packed = header.packed in (_PACKED_10, _PACKED_12)
        if header.compression != 0 or header.setup.get("cfa", 0) or bits not in (8, 10, 12, 16):
            kind = {1: "JPEG", 2: "a colour mosaic"}.get(header.compression, "colour")
            raise RecordingError(
                f"{self._path}: its images are {kind} of {header.bits} bits, expected grey of 8 or "
                "16, or packed in 10 or 12; save it again with the camera's software, as grey"
            )
        if (header.packed and not is_packed) or (is_packed and header.columns * bits % 8):
            raise RecordingError(
                f"{self._path}: {header.columns} columns in packing {header.packed} are not known "
                "here; save it again unpacked, with 16 bits"
            )

    def _white(self, bits: int) -> int:
        """Return the level at which pixels clip, by the setup where it says so."""
        setup, top = self._header.setup, (1 << bits) - 1
        real = setup.get("real_bits", 0)
        if bits == 16 and 8 < real < 16:
            top = (1 << real) - 1
        white = setup.get("white_level", 0)
        white = white if top // 2 < white <= top else top
        return white if self._linear is None else int(self._linear[white])

    def _asides(self) -> list[str]:
        notes = []
        if self._linear is not None:
            notes.append("companded codes of 10 bits were put on the camera's linear 12-bit scale")
        setup = self._header.setup
        if setup.get("flip_h") or setup.get("flip_v"):
            notes.append("the camera's software shows it flipped; here it is as the sensor saw it")
        return notes


def _timing(header: CineHeader) -> tuple[float | None, NDArray[np.float64] | None, list[str]]:
    """Return the rate, and the camera's times without those that cannot be."""
    rate_hz = float(header.setup.get("frame_rate", 0)) or None
    times = header.times_s
    if times is None:
        return rate_hz, None, []
    if rate_hz is None and times.size > 1 and np.median(np.diff(times)) > 0:
        rate_hz = 1 / float(np.median(np.diff(times)))
    if rate_hz is None:
        return None, times, []
    number = np.arange(times.size) / rate_hz
    off = times - number
    bad = np.abs(off - np.median(off)) > max(_IMPOSSIBLE / rate_hz, number[-1])
    if not bad.any():
        return rate_hz, times, []
    mended = np.where(bad, number + np.interp(number, number[~bad], off[~bad]), times)
    note = (
        f"{int(bad.sum())} images have times that cannot be, the first {int(np.argmax(bad))} at "
        f"{times[bad][0]:.6g} s; they were counted from their neighbours"
    )
    return rate_hz, mended, [note]


def _exposure(header: CineHeader) -> tuple[float | None, list[str]]:
    """Return the exposure, and a note where it was not always the same."""
    setup, each = header.setup, header.exposures_s
    stated = setup.get("shutter_ns", 0) / 1e9 or setup.get("shutter_us", 0) / 1e6
    if each is None or not (each > 0).any():
        return stated or None, []
    usual = float(np.median(each))
    differs = np.abs(each - usual) > _UNEQUAL * usual
    if not differs.any():
        return stated or usual, []
    note = (
        f"{int(differs.sum())} images have another exposure than {usual:.6g} s, the first "
        f"{int(np.argmax(differs))} with {each[differs][0]:.6g} s"
    )
    return stated or usual, [note]


def _start(
    header: CineHeader, rate_hz: float | None, times_s: NDArray[np.float64] | None
) -> float | None:
    if times_s is not None:
        return float(times_s[0])
    return None if rate_hz is None else header.first_image / rate_hz


def _iso(seconds: float) -> str | None:
    if seconds <= 0:
        return None
    return datetime.datetime.fromtimestamp(round(seconds, 6), datetime.UTC).isoformat()
