"""Throughput from memory, against other ways and against reading alone, in one run."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.rivals import RIVALS
from benchmarks.scene import COLUMNS, ESTIMATORS, PITCH, Scene, prepared, table_row
from glint_aoa.optical.measure import Measurement, measure_prepared
from glint_aoa.records.fields import FieldInfo, FieldStack

_FIELDS = 2000
_FIELDS_SLOW = 400
_REPEATS = 3
_WIDTHS = [38, 9, 11, 12, 12, 12]
_ALLOWED_BIAS = {  # deg; every other one less than 0.0005
    "ridge-detection, 24 lines": 0.02,
    "cv2.threshold and cv2.fitLine": 0.02,
}
_USUAL_BIAS = 5e-4


def best_time(work: Callable[[], Any], *, clock: Callable[[], float] = time.process_time) -> float:
    """Return the shortest of a few times that `work` takes [s]; the first call warms up.

    The processor's time by default, which other programs disturb less than the clock's.
    """
    work()
    times = []
    for _ in range(_REPEATS):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)


def measured_deg(
    fields: NDArray[np.uint8], how: Measurement, threads: int = 1
) -> NDArray[np.float64]:
    """Return the angle of each field [deg], blocks of fields measured in threads."""
    stack = FieldStack.from_array(fields, FieldInfo(rate_hz=60.0))
    return np.degrees(measure_prepared(stack, how, threads=threads).angle)


def rival_deg(
    rows: NDArray[np.float64], columns: NDArray[np.int64]
) -> tuple[NDArray[np.float64], float]:
    """Return the angles of ordinary lines through centres [deg]."""
    slope = np.polyfit(columns, rows.T, 1)[0]
    return np.degrees(np.arctan(slope * PITCH[1] / PITCH[0])), float(slope.size)


def run() -> None:
    """Print the table."""
    scene = Scene()
    fields = scene.fields(np.random.default_rng(0), _FIELDS)
    memory = len(fields) / best_time(lambda: fields.view(np.uint64).sum())
    print(f"\nSpeed: {scene.lines} x {COLUMNS} uint8 fields from memory;")
    print("fields/s of processor time for 1 thread, of the clock for 2")
    print(table_row(["", "columns", "1 thread", "of reading", "2 threads", "bias [deg]"], _WIDTHS))
    print(table_row(["reading: view(uint64).sum()", "", f"{memory:.0f}", "1", "", ""], _WIDTHS))
    for step in (20, 1):
        for estimator in ESTIMATORS:
            _ours(fields, scene, estimator, step, memory)
    how = prepared(fields[:100], "centroid", 20)
    for name, (measure, n) in RIVALS.items():
        few = fields[:n]
        start = time.process_time()
        angles, _ = rival_deg(measure(few, how.columns), how.columns)
        rate = n / (time.process_time() - start)
        _print(name, how.columns.size, rate, memory, None, angles.mean() - scene.angle_deg)


def _ours(
    fields: NDArray[np.uint8], scene: Scene, estimator: str, step: int, memory: float
) -> None:
    how = prepared(fields, estimator, step)
    some = fields if step > 1 or estimator == "centroid" else fields[:_FIELDS_SLOW]
    one = len(some) / best_time(lambda: measured_deg(some, how))
    two = len(some) / best_time(lambda: measured_deg(some, how, threads=2), clock=time.perf_counter)
    bias = measured_deg(some, how).mean() - scene.angle_deg
    _print(f"glint-aoa {estimator}", how.columns.size, one, memory, two, bias)


def _print(
    name: str, columns: int, one: float, memory: float, two: float | None, bias: float
) -> None:
    both = "" if two is None else f"{two:.0f}"
    share = f"{one / memory:.4f}"
    print(table_row([name, str(columns), f"{one:.1f}", share, both, f"{bias:.5f}"], _WIDTHS))
    if not abs(bias) < _ALLOWED_BIAS.get(name, _USUAL_BIAS):
        raise SystemExit(f"wrong: {name} is off by {bias:.5f} deg")
