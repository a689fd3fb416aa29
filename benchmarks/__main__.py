"""Print how fast, precise, honest and frugal the measurement is on this machine, live as well."""

import os
import platform
import sys
import time
from collections.abc import Callable

import cv2
import numba
import numpy as np
import scipy

from benchmarks import batch, changes, field_coverage, live, memory, precision, speed
from glint_aoa import __version__

_PARTS: dict[str, Callable[[], object]] = {
    "speed": speed.run,
    "precision": precision.run,
    "changes": changes.run,
    "coverage": field_coverage.run,
    "memory": memory.run,
    "live": live.run,
    "batch": batch.run,
}


def main() -> None:
    """Run the parts named on the command line, or all of them."""
    wanted = sys.argv[1:] or list(_PARTS)
    unknown = [name for name in wanted if name not in _PARTS]
    if unknown:
        raise SystemExit(f"no part is called {unknown[0]}; choose from {', '.join(_PARTS)}")
    print(
        f"glint-aoa {__version__}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"numba {numba.__version__}, scipy {scipy.__version__}, OpenCV {cv2.__version__}, "
        f"{platform.machine()}, {os.cpu_count()} processors"
    )
    for name in wanted:
        start = time.process_time()
        _PARTS[name]()
        print(f"({name}: {time.process_time() - start:.0f} s of processor time)")


if __name__ == "__main__":
    main()
