"""Photron recordings: ``.mraw`` pixels with a ``.cih`` or ``.cihx`` header beside them.

Pixels are 8 bits, 16 bits (little endian) or 12 bits packed, two pixels in three bytes, the most
significant bits first: ``AB CD EF`` holds 0xABC and 0xDEF.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.formats._flat import flat_reader

__all__ = ["open_photron", "unpack_12_bits"]

_HEADER_SUFFIXES = (".cih", ".cihx", ".CIH", ".CIHX")
_PIXEL_SUFFIXES = (".mraw", ".MRAW", ".raw")
_MOST_HEADER_BYTES = 1 << 24

_CIHX_KEYS = {
    "Total Frame": "frameInfo/totalFrame",
    "Start Frame": "frameInfo/startFrame",
    "Save Step": "frameInfo/skipFrame",
    "Record Rate(fps)": "recordInfo/recordRate",
    "Shutter Speed(s)": "recordInfo/shutterSpeed",
    "Shutter Type2(nsec)": "recordInfo/shutterSpeedNsec",
    "Image Width": "imageDataInfo/resolution/width",
    "Image Height": "imageDataInfo/resolution/height",
    "Color Type": "imageDataInfo/colorInfo/type",
    "Color Bit": "imageDataInfo/colorInfo/bit",
    "EffectiveBit Depth": "imageDataInfo/effectiveBit/depth",
    "EffectiveBit Side": "imageDataInfo/effectiveBit/side",
    "Date": "fileInfo/date",
    "Time": "fileInfo/time",
}
"""Where a .cihx says what a .cih says."""


def open_photron(path: Path) -> FieldStack:
    """Open a Photron recording by the name of its ``.mraw``, ``.cih`` or ``.cihx``.

    The rate is the camera's record rate over the ``Save Step``: a recording saved with a step
    of 100 holds every hundredth frame. Frames are progressive.

    Parameters
    ----------
    path : Path
        Either file; the other one lies beside it under the same name.

    Returns
    -------
    FieldStack
        The frames, uint8 or uint16; 12 bits are unpacked, never scaled.

    Raises
    ------
    RecordingError
        If either file is missing, a key is missing or makes no sense, the recording is in
        colour, or the two files do not agree in size.
    """
    is_header = path.suffix.lower() in {".cih", ".cihx"}
    header_path = path if is_header else _beside(path, _HEADER_SUFFIXES, "header")
    pixel_path = _beside(path, _PIXEL_SUFFIXES, "pixels") if is_header else path
    header = _Header(header_path, _read_keys(header_path))
    layout = header.layout()
    _check_size(pixel_path, header_path, layout)
    return FieldStack(
        pixel_path,
        layout.shape,
        layout.dtype,
        _reader(pixel_path, layout),
        header.info(),
        white_level=layout.white_level,
    )


def unpack_12_bits(packed: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Unpack pixels of 12 bits, two in three bytes, most significant bits first.

    Parameters
    ----------
    packed : ndarray [byte]
        A multiple of three bytes.

    Returns
    -------
    ndarray [pixel]
        Grey levels 0 to 4095.
    """
    first, middle, last = packed.reshape(-1, 3).T.astype(np.uint16)
    pixels = np.empty((first.size, 2), np.uint16)
    pixels[:, 0] = first << 4 | middle >> 4
    pixels[:, 1] = (middle & 0x0F) << 8 | last
    return pixels.ravel()


@dataclass(frozen=True)
class _Layout:
    """How the pixels lie in the file."""

    shape: tuple[int, int, int]
    bits: int
    white_level: int

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype("u1") if self.bits == 8 else np.dtype("<u2")

    @property
    def field_bytes(self) -> int:
        return self.shape[1] * self.shape[2] * self.bits // 8


class _Header:
    """The keys of a header, asked for by name."""

    def __init__(self, path: Path, keys: Mapping[str, str]) -> None:
        self.path = path
        self._keys = keys

    def layout(self) -> _Layout:
        """Return how the pixels lie in the file."""
        names = ("Total Frame", "Image Height", "Image Width", "Color Bit")
        n_fields, n_lines, n_columns, bits = (self._count(name) for name in names)
        colour = self._keys.get("Color Type") or "Mono"
        if bits not in (8, 12, 16) or colour.lower() not in {"mono", "monochrome", "0"}:
            raise RecordingError(
                f"{self.path}: pixels are {colour}, {bits} bits, expected Mono of 8, 12 or 16; "
                "export the recording again as monochrome MRAW"
            )
        if bits == 12 and n_lines * n_columns % 2:
            raise RecordingError(
                f"{self.path}: frames of {n_columns} x {n_lines} pixels cannot be packed in pairs "
                "of 12 bits; export the recording again with 16 bits"
            )
        return _Layout((n_fields, n_lines, n_columns), bits, self._white_level(bits))

    def info(self) -> FieldInfo:
        """Return what the header says of rate, exposure and trigger."""
        record_rate = self._number("Record Rate(fps)")
        step = self._count("Save Step", missing=1)
        start = self._number("Start Frame", signed=True)
        rate_hz = None if record_rate is None else float(record_rate / step)
        start_s = None if not record_rate or start is None else float(start / record_rate)
        exposure_s, trigger_time = self._exposure(), self._trigger_time()
        try:
            return FieldInfo(
                rate_hz=rate_hz,
                exposure_s=exposure_s,
                interlaced=False,
                start_s=start_s,
                trigger_time=trigger_time,
            )
        except RecordingError as error:
            raise RecordingError(f"{self.path}: {error}; correct the header") from None

    def _exposure(self) -> float | None:
        shutter = self._number("Shutter Speed(s)")
        if shutter is not None:
            return float(shutter)
        nanoseconds = self._number("Shutter Type2(nsec)")
        return None if nanoseconds is None else float(nanoseconds / 10**9)

    def _white_level(self, bits: int) -> int:
        """Greatest grey level: the sensor's bits may fill only the lower or upper end of 16."""
        depth = self._count("EffectiveBit Depth", missing=bits)
        if bits != 16 or depth >= bits:
            return (1 << bits) - 1
        is_lower = (self._keys.get("EffectiveBit Side") or "lower").lower() == "lower"
        return ((1 << depth) - 1) << (0 if is_lower else bits - depth)

    def _trigger_time(self) -> str | None:
        date = re.fullmatch(r"(\d{4})/(\d{1,2})/(\d{1,2})", self._keys.get("Date", ""))
        time = re.fullmatch(r"(\d{1,2}):(\d{2})(?::(\d{2}))?", self._keys.get("Time", ""))
        if not date or not time:
            return None
        year, month, day = date.groups()
        hour, *rest = (part for part in time.groups() if part)
        return f"{year}-{month:>02}-{day:>02}T{':'.join([hour.zfill(2), *rest])}"

    def _count(self, name: str, *, missing: int | None = None) -> int:
        number = self._number(name)
        if number is None and missing is not None:
            return missing
        if number is None or number.denominator != 1:
            found = "missing" if number is None else self._keys[name]
            raise RecordingError(
                f"{self.path}: {name} is {found}, expected a whole number from 1; "
                "restore the header from the camera's software"
            )
        return int(number)

    def _number(self, name: str, *, signed: bool = False) -> Fraction | None:
        text = self._keys.get(name, "").strip()
        if not text:
            return None
        number = _fraction(text)
        if number is None or (number <= 0 and not signed):
            expected = "a number" if signed else "a number greater than zero"
            raise RecordingError(
                f"{self.path}: {name} is {text[:40]}, expected {expected}; "
                "restore the header from the camera's software"
            )
        return number


def _fraction(text: str) -> Fraction | None:
    """Read ``15000``, ``59.94`` or ``1/15371``; None for anything else or far too long."""
    if not re.fullmatch(r"[+-]?\d{1,18}(\.\d{0,18})?(/\d{1,18})?", text):
        return None
    above, _, below = text.partition("/")
    if below and not int(below):
        return None
    return Fraction(above.rstrip(".")) / int(below or 1)


def _beside(path: Path, suffixes: tuple[str, ...], what: str) -> Path:
    for suffix in suffixes:
        candidate = path.with_suffix(suffix)
        if candidate.exists():
            return candidate
    raise RecordingError(
        f"{path}: no {what} beside it, expected {path.with_suffix(suffixes[0]).name}; "
        "copy both files of the recording into one folder"
    )


def _read_keys(path: Path) -> dict[str, str]:
    size_of(path)
    with path.open("rb") as file:
        content = file.read(_MOST_HEADER_BYTES)
    is_xml = path.suffix.lower() == ".cihx"
    keys = _read_cihx(path, content) if is_xml else _read_cih(content)
    if not keys:
        raise RecordingError(
            f"{path}: no keys found, expected a Photron header; "
            "restore it from the camera's software"
        )
    return keys


def _read_cih(content: bytes) -> dict[str, str]:
    """Read the first block of ``Key : value`` lines; those after END are the software's own."""
    keys: dict[str, str] = {}
    for line in content.decode("utf-8", errors="replace").splitlines():
        if line.strip() == "END":
            break
        name, colon, value = line.partition(" :")
        if colon:
            keys.setdefault(name.strip(), value.strip())
    return keys


def _read_cihx(path: Path, content: bytes) -> dict[str, str]:
    """Read the XML that stands in the file, among bytes that are no XML."""
    start, end = content.find(b"<cih>"), content.rfind(b"</cih>")
    xml = content[start : end + len(b"</cih>")]
    if start < 0 or end < start or b"<!" in xml:
        return {}
    try:
        root = ElementTree.fromstring(xml.decode("utf-8", errors="replace"))
    except ElementTree.ParseError as error:
        raise RecordingError(
            f"{path}: its XML cannot be read ({error}); restore it from the camera's software"
        ) from None
    found = {name: root.findtext(place) for name, place in _CIHX_KEYS.items()}
    return {name: text.strip() for name, text in found.items() if text}


def _check_size(path: Path, header_path: Path, layout: _Layout) -> None:
    size, expected = size_of(path), layout.shape[0] * layout.field_bytes
    if size != expected:
        n_fields, n_lines, n_columns = layout.shape
        raise RecordingError(
            f"{path}: has {size} bytes, but {header_path.name} promises {expected} "
            f"({n_fields} frames of {n_columns} x {n_lines}, {layout.bits} bits); "
            "the two do not belong together or one is damaged, copy both again"
        )


def _reader(path: Path, layout: _Layout) -> Callable[[int, int], NDArray[Any]]:
    if layout.bits != 12:
        return flat_reader(path, layout.shape, layout.dtype)

    def read(start: int, stop: int) -> NDArray[Any]:
        count, offset = (stop - start) * layout.field_bytes, start * layout.field_bytes
        packed = np.fromfile(path, np.uint8, count, offset=offset)
        return unpack_12_bits(packed).reshape(-1, *layout.shape[1:])

    return read
