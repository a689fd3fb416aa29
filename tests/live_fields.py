"""Live sources and sessions for tests: fields that come when the test says so."""

import queue
import threading
import time
from contextlib import contextmanager

import numpy as np
from synthetic import line_fields

from glint_aoa.live.session import PointLength, Session
from glint_aoa.live.sources import Arrival, Source
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.setup import Setup

SHAPE = (60, 400)
CAMERA = {
    "focal_length": "35 mm",
    "pixel_pitch": ["11.7 um", "27.5 um"],
    "sensor": [752, 240],
    "position": ["0 m", "-56 in", "60 mm"],
}
PITCH = (11.7e-6, 27.5e-6)
_TAUGHT = 24  # fields that a source says are all that there are, to learn from


def setup_of(**sections):
    return Setup.model_validate({"camera": CAMERA, **sections})


def angle_deg(slope):
    """Angle of a nose-left model whose line falls by `slope` lines a column."""
    return float(np.degrees(np.arctan(slope * PITCH[1] / PITCH[0])))


def some_fields(n=80, seed=1, **how):
    return line_fields(
        np.random.default_rng(seed),
        n_fields=n,
        **{"shape": SHAPE, "slope": 0.011, "row": 30.3, **how},
    )


def info_of(**said):
    return FieldInfo(**{"rate_hz": 60.0, "exposure_s": 1e-3, "interlaced": False, **said})


class Fed(Source):
    """Gives the fields that `feed` hands over, under the numbers that it says."""

    def __init__(self, fields, *, info=None, known=True):
        self.name, self.fields = "fed", fields
        self.info = info or info_of()
        self.shape, self.dtype = fields.shape[1:], fields.dtype
        self.white_level = int(np.iinfo(fields.dtype).max)
        self.stack = FieldStack.from_array(fields[:_TAUGHT], self.info) if known else None
        self.closed = False
        self._queue = queue.SimpleQueue()

    def feed(self, *numbers):
        for number in numbers:
            self._queue.put(number)

    def end(self, error=None):
        self._queue.put(error or StopIteration())

    def arrivals(self, stop):
        while not stop.is_set():
            try:
                number = self._queue.get(timeout=0.02)
            except queue.Empty:
                continue
            if isinstance(number, StopIteration):
                return
            if isinstance(number, Exception):
                raise number
            field = self.fields[number % len(self.fields)]
            yield Arrival(number, field, number / self.info.rate_hz, time.perf_counter())

    def close(self):
        self.closed = True


def until(true, *, patience_s=250.0):
    """Wait until something is true; where nothing has been compiled yet, that takes minutes."""
    end = time.monotonic() + patience_s
    while not true():
        assert time.monotonic() < end, "it never came true"
        time.sleep(0.005)


class Collected:
    """Stands for an output: keeps what it is offered."""

    name, dropped = "collected", 0

    def __init__(self):
        self.readings, self.closed = [], False

    def offer(self, reading):
        self.readings.append(reading)

    def close(self):
        self.closed = True


@contextmanager
def running(source, out, *, setup=None, pre=10, post=10, **how):
    """Run a session in a thread; yields it with the list of what it tells and its output."""
    told, collected = [], Collected()
    session = Session(
        source,
        setup or setup_of(),
        out,
        length=lambda rate: PointLength(pre, post),
        outputs=[collected],
        tell=told.append,
        **how,
    )
    session.told, session.collected, session.errors = told, collected, []

    def run():
        try:
            session.run()
        except Exception as error:
            session.errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    session.thread = thread
    try:
        yield session
    finally:
        session.stop()
        thread.join()
