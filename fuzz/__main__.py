"""Read thousands of damaged files of each format; say what was neither read nor refused."""

import argparse
import os
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from fuzz.families import FAMILIES
from fuzz.run import Found, run_family

FILES, SEED = 20_000, 1
_PARTS = 8  # of a family's files, for processes to share
_SHOWN = 5


def main() -> int:
    """Print a line for each family; 1 if any file was neither read nor refused."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument("families", nargs="*", default=list(FAMILIES), metavar="FAMILY")
    parser.add_argument("--files", type=int, default=FILES, help="of each family")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--only", type=int, help="read the file of this number only")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    unknown = [name for name in options.families if name not in FAMILIES]
    if unknown:
        parser.error(f"no family {unknown[0]}; there are {', '.join(FAMILIES)}")
    failed = False
    with ThreadPoolExecutor(options.jobs) as pool:
        for name in options.families:
            began = time.monotonic()
            read = partial(run_family, FAMILIES[name], seed=options.seed)
            found = _joined(pool.map(read, _parts(options)))
            failed |= bool(found.failures)
            print(
                f"{name:10} {found.read:6} read {found.refused:6} refused "
                f"{len(found.failures):4} failed ({time.monotonic() - began:.0f} s)",
                flush=True,
            )
            for number, what in sorted(found.failures.items())[:_SHOWN]:
                print(f"  {number}: {what}")
    return int(failed)


def _parts(options: argparse.Namespace) -> list[range]:
    if options.only is not None:
        return [range(options.only, options.only + 1)]
    step = -(-options.files // _PARTS)
    return [range(k, min(k + step, options.files)) for k in range(0, options.files, step)]


def _joined(parts: Iterable[Found]) -> Found:
    whole = Found()
    for part in parts:
        whole.read += part.read
        whole.refused += part.refused
        whole.failures |= part.failures
    return whole


if __name__ == "__main__":
    sys.exit(main())
