"""Print how fast and how precise the optical measurement is on this machine."""

import os
import platform
import resource
import time
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from scipy import ndimage
from scipy.special import ndtr

from glint_aoa import __version__
from glint_aoa.optical.bound import centre_information, pixel_variance, slope_std_bound
from glint_aoa.optical.measure import measure_fields, prepare
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.recording import resolve_recording
from glint_aoa.setup import Setup

FIELDS, LINES, COLUMNS = 2000, 92, 752
SLOPE, ROW, SIGMA, PEAK, BLACK = 0.011, 40.3, 1.4, 160.0, 10.0
READ_NOISE, ELECTRONS_PER_GREY = 0.7, 40_000 / 255
PITCH = (11.7e-6, 27.5e-6)
REPEATS = 5

SETUP: dict[str, Any] = {
    "camera": {
        "focal_length": "35 mm",
        "pixel_pitch": ["11.7 um", "27.5 um"],
        "sensor": [752, 240],
        "position": ["0 m", "-56 in", "60 mm"],
    }
}


def image() -> np.ndarray:
    """Return the expected grey levels of the line, integrated over pixels [line, column]."""
    centre = ROW + SLOPE * (np.arange(COLUMNS) - (COLUMNS - 1) / 2)
    edges = np.arange(LINES + 1)[:, None] - 0.5
    share = np.diff(ndtr((edges - centre) / SIGMA), axis=0)
    return BLACK + PEAK * np.sqrt(2 * np.pi) * SIGMA * share


def noisy_fields(rng: np.random.Generator) -> np.ndarray:
    """Return fields of one static line [field, line, column]."""
    expected = image()
    noise = np.sqrt(expected / ELECTRONS_PER_GREY + READ_NOISE**2)
    fields = np.empty((FIELDS, LINES, COLUMNS), np.uint8)
    for field in fields:
        field[:] = np.clip(np.round(rng.normal(expected, noise)), 0, 255)
    return fields


def angle_bound_deg(columns: np.ndarray) -> float:
    """Return the Cramer-Rao bound of the angle from `columns` [deg]."""
    expected = image()
    step = 1e-3
    edges = np.arange(LINES + 1)[:, None] - 0.5
    centre = ROW + SLOPE * (np.arange(COLUMNS) - (COLUMNS - 1) / 2)
    moved = np.diff(ndtr((edges - centre - step) / SIGMA), axis=0)
    gradient = (BLACK + PEAK * np.sqrt(2 * np.pi) * SIGMA * moved - expected) / step
    variance = pixel_variance(
        expected, read_noise=READ_NOISE, electrons_per_grey=ELECTRONS_PER_GREY
    )
    slope = slope_std_bound(centre_information(gradient, variance)[columns], columns)
    return float(np.degrees(slope * PITCH[1] / PITCH[0]))


def best_time(work: Callable[[], Any]) -> float:
    """Return the shortest of a few times that `work` takes [s]; the first call warms up."""
    work()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def measured(fields: np.ndarray, step: int) -> tuple[Callable[[], Any], np.ndarray]:
    """Return a function that measures all fields, and the columns that it uses."""
    setup = Setup.model_validate({**SETUP, "glint": {"column_step": step}})
    stack = FieldStack.from_array(fields, FieldInfo(rate_hz=60.0))
    how = prepare(stack, setup, resolve_recording(stack, setup))
    number = np.arange(len(fields))

    def work() -> Any:
        return [
            measure_fields(fields[k : k + 200], number[k : k + 200], how)
            for k in range(0, len(fields), 200)
        ]

    return work, how.columns


def centre_of_mass(fields: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return each column's centre by scipy.ndimage, background cut off [field, column]."""
    cut = np.clip(fields[:, :, columns].astype(np.float32) - 2 * BLACK, 0, None)
    return np.array(
        [[ndimage.center_of_mass(field[:, i])[0] for i in range(columns.size)] for field in cut]
    )


def main() -> None:
    """Run the benchmark and print it."""
    print(
        f"glint-aoa {__version__}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"numba {numba.__version__}, {platform.machine()}, {os.cpu_count()} processors"
    )
    fields = noisy_fields(np.random.default_rng(0))
    truth = -np.degrees(np.arctan(-SLOPE * PITCH[1] / PITCH[0]))
    memory = len(fields) / best_time(lambda: fields.view(np.uint64).sum())
    print(f"\n{LINES} x {COLUMNS} uint8 fields from memory, one thread")
    print(f"{'':34}{'fields/s':>10}{'of reading':>12}{'std/bound':>11}{'bias [deg]':>12}")
    print(f"{'reading (sum of all bytes)':34}{memory:10.0f}{1:12.3f}")
    for step in (20, 1):
        work, columns = measured(fields, step)
        angles = np.degrees(np.concatenate([part.angle for part in work()]))
        bound, bias = angle_bound_deg(columns), angles.mean() - truth
        if abs(bias) > 5 * bound / np.sqrt(FIELDS) + 1e-4:
            raise SystemExit(f"wrong: {columns.size} columns are off by {bias:.5f} deg")
        rate = len(fields) / best_time(work)
        print(
            f"{f'glint-aoa, {columns.size} columns':34}{rate:10.0f}{rate / memory:12.3f}"
            f"{angles.std(ddof=1) / bound:11.3f}{bias:12.5f}"
        )
    _, columns = measured(fields, 20)
    few = fields[:50]
    slope = np.polyfit(columns, centre_of_mass(few, columns).T, 1)[0]
    rival = np.degrees(np.arctan(slope * PITCH[1] / PITCH[0]))
    rate = len(few) / best_time(lambda: centre_of_mass(few, columns))
    print(
        f"{f'scipy centre of mass, {columns.size} columns':34}{rate:10.0f}{rate / memory:12.4f}"
        f"{rival.std(ddof=1) / angle_bound_deg(columns):11.3f}{rival.mean() - truth:12.5f}"
    )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\nPeak memory {peak:.0f} MB, of which {fields.nbytes / 2**20:.0f} MB are the fields")


if __name__ == "__main__":
    main()
