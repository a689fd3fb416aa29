"""What ImageJ or OME wrote of a stack into its first page."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from glint_aoa.errors import RecordingError

__all__ = ["TiffWords", "words_of"]

_MOST_XML = 1 << 24
_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "msec": 1e-3, "µs": 1e-6, "us": 1e-6, "min": 60.0}


@dataclass(frozen=True)
class TiffWords:
    """What is said of a stack; None where nothing is.

    Attributes
    ----------
    n_images : int or None
        Number of images that belong together.
    rate_hz : float or None
        Images a second [Hz].
    bits : int or None
        Of a grey level, where fewer than it is stored with.
    """

    n_images: int | None = None
    rate_hz: float | None = None
    bits: int | None = None


def words_of(path: Path, tiff: Any) -> TiffWords:
    """Read the description of an open TIFF file.

    Raises
    ------
    RecordingError
        If the images follow each other along more than one of channel, depth and time.
    """
    try:
        imagej, ome = tiff.imagej_metadata, tiff.ome_metadata
    except Exception:  # what is no description is no reason to refuse the pages
        return TiffWords()
    if imagej:
        return _imagej(path, imagej)
    return _ome(path, ome) if ome else TiffWords()


def _imagej(path: Path, words: dict[str, Any]) -> TiffWords:
    sizes = {key: _count(words.get(key, 1)) for key in ("images", "channels", "slices", "frames")}
    _check_axes(path, "ImageJ", sizes["channels"], sizes["slices"], sizes["frames"])
    interval = _number(words.get("finterval")) * _SECONDS.get(str(words.get("tunit", "s")), 1.0)
    return TiffWords(sizes["images"], 1 / interval if interval > 0 else None)


def _ome(path: Path, text: str) -> TiffWords:
    if len(text) > _MOST_XML or "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise RecordingError(
            f"{path}: its OME description is not one (too long, or with entities); "
            "export the recording again"
        )
    try:
        pixels = ElementTree.fromstring(text).find(".//{*}Pixels")
    except ElementTree.ParseError:
        return TiffWords()
    if pixels is None:
        return TiffWords()
    times, depths, channels = (_count(pixels.get(f"Size{axis}", 1)) for axis in "TZC")
    _check_axes(path, "OME", channels, depths, times)
    step = _number(pixels.get("TimeIncrement"))
    step *= _SECONDS.get(pixels.get("TimeIncrementUnit", "s"), math.nan)
    bits = _count(pixels.get("SignificantBits", 0))
    return TiffWords(times * depths * channels, 1 / step if step > 0 else None, bits or None)


def _check_axes(path: Path, who: str, channels: int, depths: int, times: int) -> None:
    if sum(size > 1 for size in (channels, depths, times)) > 1:
        raise RecordingError(
            f"{path}: {who} says {channels} channels, {depths} depths and {times} times, expected "
            "one sequence; export one channel of one depth"
        )


def _count(value: object) -> int:
    number = _number(value)
    return int(number) if number.is_integer() and number >= 0 else 1


def _number(value: object) -> float:
    try:
        number = float(str(value))
    except ValueError:
        return 0.0
    return number if math.isfinite(number) else 0.0
