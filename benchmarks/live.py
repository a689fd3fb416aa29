"""Latency from a field's arrival to its angle, and fields lost, of a live session in real time."""

import argparse
import contextlib
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.scene import COLUMNS, Scene, setup_for, table_row
from glint_aoa.errors import InputError
from glint_aoa.live.outputs import LineSender, Output
from glint_aoa.live.session import PointLength, Session, State
from glint_aoa.live.sources import Arrival, Source, pause_until
from glint_aoa.records.fields import FieldInfo

SHORT_S = 10.0
LONG_S = {60.0: 600.0, 1000.0: 60.0}
_OWN = 240  # fields that are repeated
_POINT_EVERY = 8.0  # s
_WIDTHS = [30, 10, 8, 8, 10, 10, 10, 10]
_ALLOWED_BIAS = 5e-4  # deg
_ALLOWED_P99 = 2.0  # ms, at 60 Hz


class Paced(Source):
    """Noisy fields from memory at an exact rate, as a camera gives them."""

    def __init__(self, scene: Scene, rate_hz: float, duration_s: float) -> None:
        self._fields = scene.fields(np.random.default_rng(0), _OWN)
        self.name, self._rate_hz = f"{rate_hz:g} Hz", rate_hz
        self._count = round(rate_hz * duration_s)
        self.shape, self.dtype = self._fields.shape[1:], self._fields.dtype
        self.white_level = 255
        self.info = FieldInfo(rate_hz=rate_hz, exposure_s=5e-4, interlaced=False)

    def arrivals(self, stop: threading.Event) -> Iterator[Arrival]:
        """Give the fields, each when it is due."""
        began = time.perf_counter()
        for number in range(self._count):
            due = began + number / self._rate_hz
            if not pause_until(due, stop):
                return
            field = self._fields[number % _OWN]
            yield Arrival(number, field, number / self._rate_hz, time.perf_counter())


def measure(rate_hz: float, duration_s: float, *, realtime: bool = False) -> bool:
    """Run a session with points triggered now and then, print a row; False if it fell short."""
    scene = Scene()
    with tempfile.TemporaryDirectory() as folder, Path(os.devnull).open("wb") as nowhere:
        session = Session(
            Paced(scene, rate_hz, duration_s),
            setup_for("auto", 20),
            Path(folder),
            length=lambda rate: PointLength(round(rate / 2), round(rate / 2)),
            outputs=[Output(LineSender(nowhere.fileno()), tell=print)],
            realtime=realtime,
            tell=lambda text: None if "point" in text or "written" in text else print(text),
        )
        triggered = [0.0]

        def tick() -> None:
            now = time.monotonic()
            if now > triggered[0] + _POINT_EVERY:
                triggered[0] = now
                with contextlib.suppress(InputError):  # no field yet
                    session.trigger()

        state = session.run(tick)
        points = len(list(Path(folder).glob("*.h5")))
    return _told(session, state, scene, points, realtime=realtime)


def _told(session: Session, state: State, scene: Scene, points: int, *, realtime: bool) -> bool:
    middle, high, most = state.latency_ms
    readings = session.readings_since(-1)
    bias = float(np.mean([each.angle_deg for each in readings])) - scene.angle_deg
    load = os.getloadavg()[0]
    what = f"{session.rate_hz:g} Hz{', real-time' if realtime else ''}"
    figures = [f"{middle:.2f}", f"{high:.2f}", f"{most:.1f}", f"{load:.1f}"]
    print(table_row([what, str(state.fields), str(state.lost), str(points), *figures], _WIDTHS))
    if not abs(bias) < _ALLOWED_BIAS:
        raise SystemExit(f"wrong: the angle is off by {bias:.5f} deg")
    return state.lost == 0 and (session.rate_hz > 100 or high <= _ALLOWED_P99)


def run(seconds: dict[float, float] | None = None, *, realtime: bool = False) -> bool:
    """Print the table; 10 s at each rate unless told otherwise."""
    print(f"\nLive: {Scene().lines} x {COLUMNS} uint8, 38 columns; latency from arrival to angle")
    head = ["", "fields", "lost", "points", "p50 [ms]", "p99 [ms]", "max [ms]", "load"]
    print(table_row(head, _WIDTHS))
    seconds = seconds or dict.fromkeys(LONG_S, SHORT_S)
    done = [measure(rate, each, realtime=realtime) for rate, each in seconds.items()]
    return all(done)


def main() -> int:
    """Run for as long as asked; 1 if a field was lost or the latency at 60 Hz is too long."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live", description=__doc__)
    parser.add_argument("--long", action="store_true", help="10 minutes at 60 Hz, 1 at 1,000 Hz")
    parser.add_argument("--seconds", type=float, default=SHORT_S, help="at each rate")
    parser.add_argument("--realtime", action="store_true", help="with real-time priority")
    options = parser.parse_args()
    seconds = LONG_S if options.long else dict.fromkeys(LONG_S, options.seconds)
    return int(not run(seconds, realtime=options.realtime))


if __name__ == "__main__":
    sys.exit(main())
