"""What sharing points costs, and what a second process brings."""

import multiprocessing
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.scene import Scene, setup_for, table_row
from glint_aoa.batch import open_store, process_batch
from glint_aoa.batch.point import measure_into
from glint_aoa.process import process_point
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.setup import Setup
from glint_aoa.workers import Workers

_FIELDS = 60
_DISTINCT, _AT_A_TIME, _ROUNDS = 8, 8, 13
_WIDTHS = [20, 17, 17, 12]


def run() -> None:
    """Print the table; the ways take turns, so that what disturbs one disturbs the others."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        setup, paths = setup_for("auto", 20), _points(folder)
        ways: dict[str, Callable[[], None]] = {"process": lambda: _serial(folder, paths, setup)}
        with Workers(1, apart=True) as one, Workers(2) as two:
            ways["batch, 1 process"] = lambda: _batch(folder, paths, setup, one)
            ways["batch, 2 processes"] = lambda: _batch(folder, paths, setup, two)
            first = {way: _time(work) for way, work in ways.items()}
            times = np.array([[_time(work) for work in ways.values()] for _ in range(_ROUNDS)])
        _print(list(ways), first, times)
        _check(folder)


def _points(folder: Path) -> list[Path]:
    """Write points of 60 fields."""
    (folder / "points").mkdir()
    rng, paths = np.random.default_rng(0), []
    for number in range(_DISTINCT):
        paths.append(folder / "points" / f"point-{number}.h5")
        info = FieldInfo(rate_hz=60.0, exposure_s=1e-3, interlaced=False)
        write_point(paths[-1], RecordedPoint(fields=Scene().fields(rng, _FIELDS), info=info))
    return paths


def _serial(folder: Path, paths: list[Path], setup: Setup) -> None:
    for path in paths:
        process_point(path, setup, folder / "serial", overwrite=True)


def _batch(folder: Path, paths: list[Path], setup: Setup, workers: Workers) -> None:
    store = open_store(str(folder / f"batch-{id(workers)}"))
    measure = partial(measure_into, setup=setup, store=store)
    result = process_batch(paths, setup, store, workers, measure, overwrite=True)
    if result.failures:
        raise SystemExit(f"wrong: {result.failures[0][1]}")


def _time(work: Callable[[], None]) -> tuple[float, float]:
    """Return how long some work takes by the clock, and of all processors together [s]."""
    start, before = time.perf_counter(), _processor_s()
    work()
    return time.perf_counter() - start, _processor_s() - before


def _processor_s() -> float:
    """Return the processor time of this process and its workers so far [s]."""
    tick = os.sysconf("SC_CLK_TCK")
    total = time.process_time()
    for worker in multiprocessing.active_children():
        numbers = Path(f"/proc/{worker.pid}/stat").read_text().rpartition(")")[2].split()
        total += (int(numbers[11]) + int(numbers[12])) / tick
    return total


def _print(
    ways: list[str], first: dict[str, tuple[float, float]], times: NDArray[np.float64]
) -> None:
    rounds, points = len(times), len(times) * _AT_A_TIME
    print(f"\nBatch: {points} points of {_FIELDS} fields each way, in turns of {_AT_A_TIME};")
    print(f"medians of {rounds} turns, while the load of the machine is {os.getloadavg()[0]:.1f}")
    print(table_row(["", "ms by the clock", "ms of processor", "start [s]"], _WIDTHS))
    for number, way in enumerate(ways):
        clock, processor = np.median(times[:, number], axis=0) / _AT_A_TIME
        start = max(first[way][0] - _AT_A_TIME * clock, 0.0)
        row = [way, f"{1e3 * clock:.1f}", f"{1e3 * processor:.1f}", f"{start:.1f}"]
        print(table_row(row, _WIDTHS))
    for what, unit in enumerate(("by the clock", "of processor time")):
        share = times[:, 1, what] / times[:, 0, what] - 1
        print(f"sharing costs {np.median(share):+.2%} +/- {_doubt(share):.2%} {unit}")
    gain = times[:, 1, 0] / times[:, 2, 0]
    print(f"2 processes are {np.median(gain):.2f} +/- {_doubt(gain):.2f} times as fast as 1")


def _doubt(values: NDArray[np.float64]) -> float:
    """Return the standard deviation of a median."""
    return float(1.25 * values.std(ddof=1) / np.sqrt(len(values)))


def _check(folder: Path) -> None:
    serial = folder / "serial"
    for out in folder.glob("batch-*"):
        for path in serial.iterdir():
            if (out / path.name).read_bytes() != path.read_bytes():
                raise SystemExit(f"wrong: {path.name} of a batch differs from that of process")
        shutil.rmtree(out)
