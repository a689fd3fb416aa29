"""A camera, by OpenCV: V4L2 device or network address."""

import math
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.live.sources import Arrival, Source
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.formats._colour import grey_of
from glint_aoa.setup import Fields

__all__ = ["Camera", "split_frame"]

_STALE = 8  # frames that a device may have kept since it was opened
_GAP = 1.5  # frame periods between two frames, from which one is missing


class Camera(Source):
    """Fields of a camera; frames are split into them where the setup says interlaced.

    A device numbers its frames by the driver's timestamps: a gap of more than one and a half
    periods counts as lost frames. A network camera has no clock that could be believed; what it
    leaves out is not seen.

    Parameters
    ----------
    address : int or str
        Number of a V4L2 device, or what else OpenCV opens.
    stated : Fields
        The setup's section; `rate` counts more than what the camera says.

    Raises
    ------
    RecordingError
        If there is no such camera, it gives no picture, or nobody says its rate.
    """

    def __init__(self, address: int | str, *, stated: Fields) -> None:
        import cv2  # noqa: PLC0415  half a second

        self.name = f"camera {address}"
        self._is_device = isinstance(address, int)
        _check_there(address)
        cv2.utils.logging.setLogLevel(0)  # what is wrong is said once, by us
        self._capture = cv2.VideoCapture(address)
        self._clock = cv2.CAP_PROP_POS_MSEC
        frame = self._read()
        if frame is None:
            self._capture.release()
            raise RecordingError(
                f"{self.name}: gives no picture; check its number or address, its cable, and that "
                "no other program uses it"
            )
        self._first: NDArray[Any] | None = frame
        interlaced = stated.interlaced or (
            stated.interlaced is None and stated.first_parity is not None
        )
        self._odd_first = stated.first_parity == "odd"
        self._per_frame = 2 if interlaced else 1
        rate = stated.rate or self._frame_rate(self._capture.get(cv2.CAP_PROP_FPS))
        self._period = 1 / rate
        n_lines, n_columns = frame.shape
        self.shape, self.dtype = (n_lines // self._per_frame, n_columns), frame.dtype
        self.white_level = int(np.iinfo(frame.dtype).max)
        self.info = FieldInfo(rate_hz=rate, interlaced=interlaced)

    def _frame_rate(self, fps: float) -> float:
        if not (math.isfinite(fps) and fps > 0):
            self._capture.release()
            raise RecordingError(
                f"{self.name}: does not say its rate; give fields.rate in the setup"
            )
        return fps * self._per_frame

    def arrivals(self, stop: threading.Event) -> Iterator[Arrival]:
        """Give fields until the camera ends; see `Source`."""
        number, began, before = 0, None, 0.0
        frame, self._first = self._first, None
        if self._is_device:
            for _ in range(_STALE):
                self._capture.grab()
            frame = self._read()
        while not stop.is_set() and frame is not None:
            arrived, clock = time.perf_counter(), self._driver_clock()
            if clock is not None:
                began = clock if began is None else began
                missed = round((clock - before) / self._period / self._per_frame) - 1
                if number and (clock - before) > _GAP * self._period * self._per_frame:
                    number += missed * self._per_frame
                before = clock
            start = number * self._period if clock is None else clock - (began or 0.0)
            for k, field in enumerate(self._fields(frame)):
                yield Arrival(number, field, start + k * self._period, arrived)
                number += 1
            frame = self._read()
        if frame is None and not stop.is_set() and self._is_device:
            raise RecordingError(f"{self.name}: gives no more pictures; check its cable and power")

    def close(self) -> None:
        """Let go of the camera."""
        self._capture.release()

    def _fields(self, frame: NDArray[Any]) -> list[NDArray[Any]]:
        return split_frame(frame, odd_first=self._odd_first) if self._per_frame == 2 else [frame]

    def _read(self) -> NDArray[Any] | None:
        there, picture = self._capture.read()
        if not there or picture is None:
            return None
        return picture if picture.ndim == 2 else grey_of(picture[..., 2::-1], None)

    def _driver_clock(self) -> float | None:
        """Time of the frame by the driver [s]; None where there is none to be believed."""
        if not self._is_device:
            return None
        clock = self._capture.get(self._clock) / 1e3
        return clock if clock > 0 else None


def _check_there(address: int | str) -> None:
    if isinstance(address, int) and not Path(f"/dev/video{address}").exists():
        raise RecordingError(
            f"camera {address}: there is no /dev/video{address}; list the cameras with "
            "ls /dev/video*, or check the cable"
        )


def split_frame(frame: NDArray[Any], *, odd_first: bool) -> list[NDArray[Any]]:
    """Split an interlaced frame into its fields, in the order in which they were exposed.

    Parameters
    ----------
    frame : ndarray [line, column]
        Lines 0, 2, 4 ... are those of the even field; a last line without its pair is left out.
    odd_first : bool
        Whether the odd field was exposed first.
    """
    whole = frame[: frame.shape[0] // 2 * 2]
    fields = [whole[0::2], whole[1::2]]
    return fields[::-1] if odd_first else fields
