"""Frames of a video by number, decoded in order or from the key frame before."""

import contextlib
import itertools
import threading
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records.fields import MAX_FIELD_BYTES

if TYPE_CHECKING:
    import av

__all__ = ["DEMUXERS", "Index", "VideoFrames", "opened_video", "read_index"]

DEMUXERS = {".avi": "avi", ".mkv": "matroska", ".mp4": "mov", ".mov": "mov"}
"""Suffixes, and libavformat's readers for them; no other reader is ever asked."""

_THREADS = 4  # each holds frames of its own
_STEP_BACK = 8  # frames, doubled each time


@contextlib.contextmanager
def opened_video(path: Path) -> "Iterator[tuple[av.container.InputContainer, av.VideoStream]]":
    """Open a video and its first picture stream; whatever goes wrong is one of our own errors."""
    container, stream = _open(path)
    with container:
        yield container, stream


def _open(path: Path) -> "tuple[av.container.InputContainer, av.VideoStream]":
    import av  # noqa: PLC0415  FFmpeg is loaded when a video is opened

    options = {
        "protocol_whitelist": "file",  # a file that names other files or addresses is not followed
        "max_pixels": str(MAX_FIELD_BYTES),
    }
    try:
        container = av.open(
            f"file:{path.absolute()}", "r", format=DEMUXERS[path.suffix.lower()], options=options
        )
    except Exception as error:
        raise _damaged(path, error) from None
    streams = container.streams.video
    if not streams:
        container.close()
        raise RecordingError(f"{path}: holds no pictures; give the file with the video")
    stream = streams[0]
    if stream.codec_context is None:
        container.close()
        raise RecordingError(
            f"{path}: its codec is not known here; convert the video to FFV1 in Matroska "
            "(ffmpeg -i old -c:v ffv1 new.mkv)"
        )
    stream.codec_context.thread_count = _THREADS
    stream.codec_context.options = {"max_pixels": str(MAX_FIELD_BYTES)}
    return container, stream


@dataclass(frozen=True, eq=False)
class Index:
    """Where the frames of a stream are in time.

    Attributes
    ----------
    ticks : ndarray of int64 [frame]
        Times of presentation, in order [ticks].
    tick_s : Fraction
        Length of a tick [s].
    """

    ticks: NDArray[np.int64]
    tick_s: Fraction


def read_index(path: Path) -> Index:
    """Read the times of all frames: the file is read through once, nothing is decoded.

    Raises
    ------
    RecordingError
        If there are none, or packets do not say when they are to be shown.
    """
    with opened_video(path) as (container, stream):
        try:
            ticks = [
                _tick(path, packet, reorders=stream.codec_context.has_b_frames)
                for packet in container.demux(stream)
                if packet.size > 0 and not packet.is_discard
            ]
        except RecordingError:
            raise
        except Exception as error:
            raise _damaged(path, error) from None
        if not ticks or stream.time_base is None:
            raise RecordingError(f"{path}: holds no frames; check that the recording was saved")
        return Index(np.sort(np.array(ticks, np.int64)), Fraction(stream.time_base))


def _tick(path: Path, packet: Any, *, reorders: bool) -> int:
    """Return when a packet's frame is shown; where frames keep their order, when it is decoded."""
    tick = packet.dts if packet.pts is None and not reorders else packet.pts
    if tick is None:
        raise RecordingError(
            f"{path}: the packet at byte {packet.pos} does not say when its frame is shown; copy "
            "the video into a new container (ffmpeg -fflags +genpts -i old -c copy new.mkv)"
        )
    return int(tick)


class VideoFrames:
    """Frames by number, out of a video that stays open.

    Going on from the last frame costs one decoding; going elsewhere costs as many as lie between
    the key frame before and the frame: one where every frame is a key frame, up to some hundred
    in the files of consumer cameras.
    """

    def __init__(self, path: Path, index: Index) -> None:
        self._path = path
        self._ticks = index.ticks
        self._lock = threading.Lock()
        self._next = 0
        self._container: Any = None
        self._stream: Any = None
        self._decoded: Iterator[Any] = iter(())
        self._closer: Any = None

    def read(self, start: int, stop: int) -> "Iterator[av.VideoFrame]":
        """Yield frames `start` to `stop`, the last one excluded."""
        with self._lock:
            if self._container is None or start != self._next:
                self._seek(start)
            while self._next < stop:
                wanted = self._ticks[self._next]
                frame = self._decode()
                if frame.pts is None or frame.pts < wanted:
                    continue
                if frame.pts > wanted:
                    self._fail(self._next, "it cannot be decoded")
                self._next += 1
                yield frame

    def _decode(self) -> Any:
        number = self._next
        try:
            frame = next(self._decoded, None)
        except Exception as error:
            self._fail(number, _reason(error))
        if frame is None:
            self._fail(number, "the video ends before it")
        elif frame.is_corrupt:
            self._fail(number, "it is damaged")
        return frame

    def _seek(self, number: int) -> None:
        """Go to the key frame before, or to one before that where the file's index misleads."""
        back = 0
        while self._container is not None and back < number:
            first = self._first_from(number - back)
            # What follows a key frame in the file may be shown before it, and then lacks its base.
            if first is not None and first.key_frame and first.pts <= self._ticks[number]:
                self._decoded = itertools.chain([first], self._decoded)
                self._next = number
                return
            back = 2 * back + _STEP_BACK
        self._reopen()
        self._decoded = self._container.decode(self._stream)
        self._next = number

    def _first_from(self, number: int) -> Any:
        """Seek, and return the first frame from there; None where that fails."""
        try:
            self._container.seek(int(self._ticks[number]), stream=self._stream, backward=True)
            self._decoded = self._container.decode(self._stream)
            return next((each for each in self._decoded if each.pts is not None), None)
        except Exception:  # a file without an index is decoded from its begin
            return None

    def _reopen(self) -> None:
        if self._closer is not None:
            self._closer()
        self._container, self._stream = _open(self._path)
        self._closer = weakref.finalize(self, self._container.close)

    def _fail(self, number: int, why: str) -> None:
        self._container = None
        raise RecordingError(
            f"{self._path}: frame {number} of {len(self._ticks)} cannot be read: {why}; "
            "the file is damaged, copy it again or cut it before that frame"
        )


def _damaged(path: Path, error: Exception) -> RecordingError:
    kind = DEMUXERS[path.suffix.lower()]
    return RecordingError(
        f"{path}: not a video of this kind ({kind}) or damaged ({_reason(error)}); "
        "record or copy it again"
    )


def _reason(error: Exception) -> str:
    """Return FFmpeg's own words, without number and file."""
    return getattr(error, "strerror", None) or str(error)
