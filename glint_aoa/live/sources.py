"""Where live fields come from: what every source gives, and a recording played at its rate."""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.recording import Recording, resolve_recording
from glint_aoa.setup import Setup

__all__ = ["Arrival", "Replay", "Source", "agreed_recording", "pause_until"]

_BLOCK_S = 0.1  # of a recording read at a time
_NAP_S = 0.1  # longest sleep before the stop is looked at


class Arrival(NamedTuple):
    """One field as it came.

    Attributes
    ----------
    number : int
        Of the field since the source began, 0-based; a number left out is a lost field.
    field : ndarray [line, column]
        Grey levels; the source may use its memory again once the next field is asked for.
    start_s : float
        Start of its exposure after that of field 0 [s].
    arrived : float
        When it was here whole, on the clock of `time.perf_counter` [s].
    """

    number: int
    field: NDArray[Any]
    start_s: float
    arrived: float


class Source(ABC):
    """Gives fields one after the other, as they come.

    Attributes
    ----------
    name : str
        What the user called it.
    shape : (int, int)
        Lines and columns of a field.
    dtype : dtype
        uint8 or uint16.
    white_level : int
        Grey level at which the camera's scale ends.
    info : FieldInfo
        What the source says of its fields.
    stack : FieldStack or None
        All of its fields, where they are known beforehand.
    meta : mapping
        What it says of itself, for the points recorded from it.
    """

    name: str
    shape: tuple[int, int]
    dtype: np.dtype[Any]
    white_level: int
    info: FieldInfo
    stack: FieldStack | None = None
    meta: Mapping[str, str | float | int] = MappingProxyType({})

    def ready(self, stop: threading.Event) -> bool:  # noqa: ARG002  others wait
        """Wait until shape and kind of the fields are known; False if `stop` was set before."""
        return True

    @abstractmethod
    def arrivals(self, stop: threading.Event) -> Iterator[Arrival]:
        """Give fields until `stop` is set or there are no more.

        Raises
        ------
        RecordingError
            If no more can come: the camera is gone, a file is damaged.
        """

    def close(self) -> None:
        """Let go of camera or process; whatever happened, and more than once."""
        return


class Replay(Source):
    """A recording, played at its own rate.

    Fields that are late because the machine was busy come as soon as they can; none is left out.

    Parameters
    ----------
    stack : FieldStack
        The recording.
    name : str
        What the user called it.
    rate_hz : float
        Fields a second where there are no timestamps [Hz].
    """

    def __init__(self, stack: FieldStack, *, name: str, rate_hz: float) -> None:
        self.name, self.stack, self._played, self._rate_hz = name, stack, stack, rate_hz
        self.shape, self.dtype = stack.shape[1:], stack.dtype
        self.white_level, self.info = stack.white_level, stack.info

    def arrivals(self, stop: threading.Event) -> Iterator[Arrival]:
        """Give the fields of the recording; see `Source`."""
        stack = self._played
        starts = np.arange(stack.n_fields) / self._rate_hz
        if stack.times_s is not None:
            starts = stack.times_s - stack.times_s[0]
        began = None
        for first, block in stack.blocks(max(1, round(_BLOCK_S * self._rate_hz))):
            began = time.perf_counter() if began is None else began
            for number, field in enumerate(block, first):
                if not pause_until(began + starts[number], stop):
                    return
                yield Arrival(number, field, float(starts[number]), time.perf_counter())


def pause_until(moment: float, stop: threading.Event) -> bool:
    """Sleep until a moment of `time.perf_counter` [s]; False as soon as `stop` is set."""
    while not stop.is_set():
        left = moment - time.perf_counter()
        if left <= 0:
            return True
        time.sleep(min(left, _NAP_S))
    return False


def agreed_recording(source: Source, setup: Setup) -> Recording:
    """Join what source and setup say of the fields.

    Raises
    ------
    SetupError
        As for `glint_aoa.records.recording.resolve_recording`.
    """
    stack = source.stack
    if stack is None:
        shape = (1, *source.shape)
        empty = np.zeros(shape, source.dtype)
        stack = FieldStack.from_array(empty, source.info)
    return resolve_recording(stack, setup)
