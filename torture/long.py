"""Measure a recording that is far longer than memory, and say how much memory that took."""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

__all__ = ["main", "measure_long", "write_long"]

GIGABYTES = 20.0
MOST_MB = 350.0
_SHAPE = (92, 752)
_OWN = 256  # fields that are repeated
_SETUP = """
[camera]
pixel_pitch = ["11.7 um", "27.5 um"]
[fields]
rate = "60 Hz"
interlaced = false
[glint]
nose = "left"
"""


def write_long(folder: Path, *, n_fields: int, seed: int = 1) -> Path:
    """Write a recording of a glint that rolls a little, and a setup beside it.

    Parameters
    ----------
    folder : Path
        Where; it needs 69 kB a field.
    n_fields : int
        How many fields.
    seed : int
        Of the noise.
    """
    rng = np.random.default_rng(seed)
    line, column = np.mgrid[: _SHAPE[0], : _SHAPE[1]]
    own = np.empty((_OWN, *_SHAPE), np.uint8)
    for number, field in enumerate(own):
        slope = 0.01 * np.sin(2 * np.pi * number / _OWN)
        row = 46.3 + 0.5 * np.sin(8 * np.pi * number / _OWN) + slope * (column - _SHAPE[1] / 2)
        light = 10 + 160 * np.exp(-0.5 * ((line - row) / 1.4) ** 2)
        field[:] = np.clip(np.rint(rng.normal(light, 1.0)), 0, 255)
    (folder / "glint-aoa.toml").write_text(_SETUP)
    path = folder / "long.npy"
    with path.open("wb") as file:
        shape = {"descr": "|u1", "fortran_order": False, "shape": (n_fields, *_SHAPE)}
        np.lib.format.write_array_header_1_0(file, shape)
        for first in range(0, n_fields, _OWN):
            own[: n_fields - first].tofile(file)
    return path


def measure_long(path: Path) -> tuple[float, float]:
    """Process a recording as a user would; return the peak of memory [MB] and the time [s]."""
    what = [
        "process",
        path,
        "--setup",
        path.parent / "glint-aoa.toml",
        "--out",
        path.parent / "out",
    ]
    began = time.monotonic()
    subprocess.run(
        [sys.executable, "-c", "from glint_aoa.cli import main; main()", *map(str, what)],
        stdout=subprocess.DEVNULL,
        check=True,
    )
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    return peak, time.monotonic() - began


def main() -> int:
    """Print how much memory it took; 1 if that is too much."""
    parser = argparse.ArgumentParser(prog="python -m torture.long", description=__doc__)
    parser.add_argument("--gigabytes", type=float, default=GIGABYTES)
    parser.add_argument("--folder", type=Path, help="where there is room for it")
    options = parser.parse_args()
    n_fields = int(options.gigabytes * 1e9 / np.prod(_SHAPE))
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        path = write_long(Path(folder), n_fields=n_fields)
        peak, seconds = measure_long(path)
        size = path.stat().st_size / 1e9
    print(f"{n_fields} fields, {size:.1f} GB, measured in {seconds:.0f} s; peak {peak:.0f} MB")
    return int(peak > MOST_MB)


if __name__ == "__main__":
    sys.exit(main())
