"""Peak memory, and that it does not grow with the stack."""

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.scene import Scene, setup_for
from glint_aoa.optical.measure import measure_stack
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.recording import resolve_recording

_ALLOWED = 256 * 2**20  # bytes beyond what the program takes before the stack
_TIMES = 10
_OWN = 64  # fields that are repeated


def run() -> None:
    """Print peak memory, and measure a stack of ten times the memory that is allowed for it."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\nMemory: peak {peak:.0f} MB in this run")
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.memory"],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[1],
    )
    print(done.stdout.strip() or done.stderr.strip().splitlines()[-1])
    if done.returncode != 0:
        raise SystemExit("wrong: a large stack did not fit the memory that was allowed for it")


def _repeated(own: NDArray[np.uint8], n_fields: int) -> FieldStack:
    """Stack that makes its fields as they are read."""

    def read(start: int, stop: int) -> NDArray[np.uint8]:
        return own[np.arange(start, min(stop, n_fields)) % len(own)]

    shape = (n_fields, *own.shape[1:])
    return FieldStack(None, shape, own.dtype, read, FieldInfo(rate_hz=60.0), None, {})


def _measure_within_limit() -> None:
    setup = setup_for("profile", 20)
    own = Scene().fields(np.random.default_rng(3), _OWN)
    small = _repeated(own, 1000)
    recording = resolve_recording(small, setup)
    measure_stack(small, setup, recording)  # compiles, and fills what is kept
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    resource.setrlimit(resource.RLIMIT_AS, (taken + _ALLOWED, taken + _ALLOWED))
    n_fields = _TIMES * _ALLOWED // own[0].nbytes
    angles, _ = measure_stack(_repeated(own, n_fields), setup, recording)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    if not np.isfinite(angles.angle).all():
        raise SystemExit("wrong: some fields were not measured")
    print(
        f"{n_fields} fields ({n_fields * own[0].nbytes / 2**20:.0f} MB) measured with "
        f"{_ALLOWED / 2**20:.0f} MB allowed; peak grew by {grown:.0f} MB"
    )


if __name__ == "__main__":
    _measure_within_limit()
