"""Grey levels out of a decoded frame, as the codec gave them: nothing is scaled or converted."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.records.formats._beside import Channel
from glint_aoa.records.formats._colour import grey_note, grey_of

if TYPE_CHECKING:
    import av

__all__ = ["Pixels", "pixels_of"]

_LIMITED, _FULL = 1, 2  # of libavutil's AVColorRange
_RGB_BYTES = {
    "rgb24",
    "bgr24",
    "rgba",
    "bgra",
    "argb",
    "abgr",
    "rgb0",
    "bgr0",
    "0rgb",
    "0bgr",
    "pal8",
    "gbrp",
    "gbrap",
}
"""Eight bits a channel, which libswscale moves about without changing one."""


@dataclass(frozen=True)
class Pixels:
    """How the frames of a video become grey fields.

    Attributes
    ----------
    bits : int
        Of a pixel.
    white_level : int
        Grey level at which the scale ends.
    grey : callable
        Makes [line, column] of a frame.
    notes : tuple of str
        What was taken, where there was a choice.
    """

    bits: int
    white_level: int
    grey: "Callable[[av.VideoFrame], NDArray[Any]]"
    notes: tuple[str, ...] = ()

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of a grey level."""
        return np.dtype(np.uint8 if self.bits <= 8 else np.uint16)


def pixels_of(
    layout: "av.VideoFormat", colour_range: int, channel: Channel | None
) -> Pixels | None:
    """Return how to take grey out of frames of one format; None for formats that are not known.

    Parameters
    ----------
    layout : VideoFormat
        Of the decoded frames.
    colour_range : int
        As the stream states it: 1 limited, 2 full, 0 silent.
    channel : {"luma", "red", "green", "blue"} or None
        Of colour; luma if None.

    Notes
    -----
    Luma of limited range ends at 235 of 8 bits, where a camera that keeps to it clips; a video
    in YUV that is silent about its range is limited by convention. The levels stay as stored.
    """
    name, bits = layout.name, layout.components[0].bits
    if name in _RGB_BYTES or (name.startswith("gbrp") and name.endswith("le") and bits <= 16):
        read = _rgb_bytes if name in _RGB_BYTES else _rgb_planes
        return Pixels(
            8 if name in _RGB_BYTES else bits,
            255 if name in _RGB_BYTES else (1 << bits) - 1,
            lambda frame: grey_of(read(frame), channel),
            (grey_note(channel),),
        )
    take = _luma(name, bits)
    if take is None or channel not in (None, "luma"):
        return None
    white, notes = _white(name, bits, colour_range)
    return Pixels(bits, white, take, notes)


def _luma(name: str, bits: int) -> "Callable[[av.VideoFrame], NDArray[Any]] | None":
    """Return how to take the luma, or grey, that is stored as such."""
    if name in _PACKED_LUMA:
        return _PACKED_LUMA[name]
    has_plane = name.startswith(("gray", "yuv", "nv12", "nv16", "nv24")) and "f" not in name
    return _first_plane if has_plane and bits <= 16 else None


def _white(name: str, bits: int, colour_range: int) -> tuple[int, tuple[str, ...]]:
    full = (1 << bits) - 1
    if name.startswith("gray") and colour_range != _LIMITED:
        return full, ()
    if name.startswith("yuvj") or colour_range == _FULL:
        return full, ("luma was taken, of full range",)
    said = "limited range" if colour_range == _LIMITED else "limited range by convention"
    white = 235 << (bits - 8)
    return white, (f"luma was taken, of {said}: white is {white} of {full}",)


def _rgb_bytes(frame: "av.VideoFrame") -> NDArray[Any]:
    return np.asarray(frame.to_ndarray(format="rgb24"))


def _first_plane(frame: "av.VideoFrame") -> NDArray[Any]:
    return _plane(frame, 0)


def _rgb_planes(frame: "av.VideoFrame") -> NDArray[Any]:
    green, blue, red = (_plane(frame, index) for index in range(3))
    return np.stack([red, green, blue], axis=-1)


def _plane(frame: "av.VideoFrame", index: int) -> NDArray[Any]:
    layout, plane = frame.format, frame.planes[index]
    wide = layout.components[0].bits > 8
    dtype = np.dtype((">u2" if layout.is_big_endian else "<u2") if wide else "u1")
    lines = np.frombuffer(plane, dtype).reshape(-1, plane.line_size // dtype.itemsize)
    return lines[: frame.height, : frame.width].astype(dtype.newbyteorder("="))


def _every_second(frame: "av.VideoFrame", first: int) -> NDArray[Any]:
    plane = frame.planes[0]
    lines = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)
    return lines[: frame.height, first : 2 * frame.width : 2].copy()


_PACKED_LUMA: "dict[str, Callable[[av.VideoFrame], NDArray[Any]]]" = {
    "yuyv422": partial(_every_second, first=0),
    "yvyu422": partial(_every_second, first=0),
    "uyvy422": partial(_every_second, first=1),
}
