"""Video in AVI, Matroska and MP4, decoded by FFmpeg's libraries through PyAV.

Interlaced frames are split into their two fields, in the order in which they were taken.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.fields import FieldInfo, FieldStack, checked_shape
from glint_aoa.records.formats._beside import Beside
from glint_aoa.records.formats._field_order import FieldOrder, Scan, find_field_order, thinned
from glint_aoa.records.formats._frame_times import FrameTimes, frame_times
from glint_aoa.records.formats._video_frames import (
    DEMUXERS,
    Index,
    VideoFrames,
    opened_video,
    read_index,
)
from glint_aoa.records.formats._video_pixels import Pixels, pixels_of
from glint_aoa.setup import Fields

__all__ = ["VIDEO_SUFFIXES", "open_video"]

VIDEO_SUFFIXES = tuple(DEMUXERS)
"""Suffixes of the files that `open_video` reads."""

_SCANS: dict[int, Scan] = {
    1: "progressive",
    2: "even first",
    3: "odd first",
    4: "odd first",
    5: "even first",
}
"""Of libavcodec's AVFieldOrder, by the order of display; 0 is silent."""
_WORDS: dict[Scan, str] = {
    "progressive": "progressive",
    "even first": "interlaced, even field first",
    "odd first": "interlaced, odd field first",
}
_FIRST: dict[str, Scan] = {"even": "even first", "odd": "odd first"}
_ROWS = {"progressive": (0,), "even first": (0, 1), "odd first": (1, 0)}
_MISSING = 1.5  # periods at the end, from which something is missing
_LOOKED_AT = 24  # frames in each of three stretches
_BROADCAST = {(720, 480), (704, 480), (720, 486), (720, 576), (704, 576)}  # seldom progressive


def open_video(path: Path, told: Beside, stated: Fields) -> FieldStack:
    """Open a video.

    Whether it is interlaced, and which field comes first, is what `told` says, else the stream,
    else the setup, else what moves in the picture (`find_field_order`). Where nothing moves
    enough, frames of broadcast size count as interlaced, all others as progressive, and even
    lines as first: that is stated as a note.

    Parameters
    ----------
    path : Path
        The file.
    told : Beside
        What is told beside it: `interlaced`, `first_parity`, `channel`.
    stated : Fields
        What the setup says.

    Returns
    -------
    FieldStack
        Fields, or frames, uint8 or uint16 as stored; times where frames are missing or uneven.
        Time 0 is the first frame: a video does not know of a trigger.

    Raises
    ------
    RecordingError
        If it is no such video, is damaged, or its pixels are of a kind that is not known.
    """
    size_of(path)
    head = _head(path, told)
    index = read_index(path)
    frames = VideoFrames(path, index)
    timing = frame_times(index.ticks, index.tick_s, head.rate_hz)
    scan, how = _scan(head, told, stated, frames, len(index.ticks))
    reader = _Fields(frames, head, scan)
    info, times_s = _timing(timing, scan)
    n_fields = len(index.ticks) * reader.per_frame
    return FieldStack(
        path,
        checked_shape(str(path), (n_fields, *reader.shape), head.dtype),
        head.dtype,
        reader.read,
        info,
        times_s,
        white_level=head.pixels.white_level,
        notes=(*head.notes, how, *timing.notes, *_cut(head, index, timing)),
    )


@dataclass(frozen=True, eq=False)
class _Head:
    """What the stream says of itself before a frame is decoded."""

    path: Path
    lines: int
    columns: int
    pixels: Pixels
    rate_hz: Fraction | None
    scan: Scan | None
    lasts_s: float
    notes: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.pixels.dtype


def _head(path: Path, told: Beside) -> _Head:
    with opened_video(path) as (container, stream):
        codec = stream.codec_context
        if codec.format is None or not codec.width or not codec.height:
            raise RecordingError(
                f"{path}: its codec {codec.name} cannot be decoded here; "
                "convert the video to FFV1 in Matroska (ffmpeg -i old -c:v ffv1 new.mkv)"
            )
        pixels = pixels_of(codec.format, int(codec.color_range), told.channel)
        if pixels is None:
            wanted = told.channel or "luma"
            raise RecordingError(
                f"{path}: its pixels are {codec.format.name}, of which {wanted} cannot be taken as "
                "it is stored; convert the video to grey (ffmpeg -i old -pix_fmt gray16le -c:v "
                "ffv1 new.mkv), or choose another channel"
            )
        checked_shape(str(path), (1, codec.height, codec.width), pixels.dtype)
        return _Head(
            path,
            codec.height,
            codec.width,
            pixels,
            stream.guessed_rate or stream.average_rate,
            _SCANS.get(int(codec.field_order)),
            _lasts(container, stream),
            (*_asides(container, stream), *pixels.notes),
        )


def _lasts(container: Any, stream: Any) -> float:
    """Return how long the file says it lasts [s]; 0 where it does not say."""
    frames = stream.frames / float(stream.average_rate) if stream.average_rate else 0.0
    return max((container.duration or 0) / 1e6, frames)


def _cut(head: _Head, index: Index, timing: FrameTimes) -> list[str]:
    """Say if the frames end before the file says it does."""
    if timing.rate_hz is None:
        return []
    end = float((index.ticks[-1] - index.ticks[0]) * index.tick_s) + 1 / timing.rate_hz
    if head.lasts_s - end < _MISSING / timing.rate_hz + 2 * float(index.tick_s):
        return []
    return [
        f"the file says it lasts {head.lasts_s:.6g} s, its frames end after {end:.6g} s: it may "
        "have been cut short"
    ]


def _asides(container: Any, stream: Any) -> Iterator[str]:
    aspect = stream.sample_aspect_ratio
    if aspect not in (None, 0, 1):
        yield f"its pixels are said to be {aspect} times as wide as high; give camera.pixel_pitch"
    if len(container.streams.video) > 1:
        yield f"it holds {len(container.streams.video)} videos; the first was taken"


def _scan(
    head: _Head, told: Beside, stated: Fields, frames: VideoFrames, n_frames: int
) -> tuple[Scan, str]:
    """Say how the frames were scanned, and how that is known."""
    interlaced, parity, who = _interlaced(told), told.first_parity, "as told beside it"
    if interlaced is None and head.scan is not None:
        return head.scan, f"{_WORDS[head.scan]}, by the stream"
    if interlaced is None:
        interlaced, parity, who = _interlaced(stated), stated.first_parity, "as the setup says"
    if interlaced is None:
        (first,) = frames.read(0, 1)
        interlaced, who = first.interlaced_frame or None, "by its frames"
    if interlaced is False:
        return "progressive", f"progressive, {who}"
    if parity is not None:
        return _FIRST[parity], f"{_WORDS[_FIRST[parity]]}, {who}"
    if interlaced and head.scan is not None and head.scan != "progressive":
        return head.scan, f"interlaced, {who}; {head.scan} by the stream"
    stretches = _stretches(frames, head.pixels, n_frames)
    return _found(find_field_order(stretches), (head.columns, head.lines), interlaced=interlaced)


def _interlaced(says: Fields) -> bool | None:
    """Return whether fields are said to be interlaced; who gives their parity says so."""
    if says.interlaced is None and says.first_parity is not None:
        return True
    return says.interlaced


def _found(
    order: FieldOrder, size: tuple[int, int], *, interlaced: bool | None
) -> tuple[Scan, str]:
    sure = f"found from what moves, {order.sigmas:.0f} standard deviations"
    if order.scan is not None and not (interlaced and order.scan == "progressive"):
        return order.scan, f"{_WORDS[order.scan]}, {sure}"
    still = "the file does not say, and too little moves to tell"
    if interlaced or size in _BROADCAST:
        return "even first", f"{_WORDS['even first']}, assumed: {still}"
    return "progressive", f"progressive, assumed: {still}"


def _stretches(frames: VideoFrames, pixels: Pixels, n_frames: int) -> Iterator[NDArray[Any]]:
    """Give successive frames from the begin, the middle and the end, or all of a few."""
    last = max(n_frames - _LOOKED_AT, 0)
    for start in sorted({0, last // 2, last}) if last > 2 * _LOOKED_AT else [0]:
        stop = min(start + _LOOKED_AT, n_frames) if last > 2 * _LOOKED_AT else n_frames
        yield np.stack([thinned(pixels.grey(frame)) for frame in frames.read(start, stop)])


class _Fields:
    """Reads fields of interlaced frames, or frames, by number."""

    def __init__(self, frames: VideoFrames, head: _Head, scan: Scan) -> None:
        self._frames, self._grey, self._head = frames, head.pixels.grey, head
        self._rows = _ROWS[scan]
        self._last: tuple[int, NDArray[Any]] | None = None
        self.per_frame = len(self._rows)
        self.shape = (head.lines // self.per_frame, head.columns)

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Return fields `start` to `stop`, the last one excluded, as [field, line, column]."""
        fields = np.empty((stop - start, *self.shape), self._head.dtype)
        each = self.per_frame
        for number, grey in self._greys(start // each, -(-stop // each)):
            for part, row in enumerate(self._rows):
                place = number * each + part - start
                if 0 <= place < len(fields):
                    fields[place] = grey[row::each][: self.shape[0]]
        return fields

    def _greys(self, start: int, stop: int) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield frames; the last one of a block may be the first of the next."""
        if self._last is not None and self._last[0] == start:
            yield self._last
            start += 1
        if start == stop:
            return
        for number, frame in enumerate(self._frames.read(start, stop), start):
            grey = self._grey(frame)
            if grey.shape != (self._head.lines, self._head.columns):
                raise RecordingError(
                    f"{self._head.path}: frame {number} is {grey.shape[1]} x {grey.shape[0]}, the "
                    f"stream {self._head.columns} x {self._head.lines}; cut the video where its "
                    "size changes"
                )
            self._last = (number, grey)
            yield number, grey


def _timing(timing: FrameTimes, scan: Scan) -> tuple[FieldInfo, NDArray[np.float64] | None]:
    """Return what is known of the fields, and when they were taken if that is not regular."""
    if scan == "progressive":
        return FieldInfo(rate_hz=timing.rate_hz, interlaced=False), timing.times_s
    rate_hz, times = timing.rate_hz, timing.times_s
    info = FieldInfo(
        rate_hz=None if rate_hz is None else 2 * rate_hz,
        interlaced=True,
        first_parity="even" if scan == "even first" else "odd",
    )
    if times is None or rate_hz is None:
        return info, None
    return info, (times[:, None] + np.array([0.0, 0.5 / rate_hz])).ravel()
