"""Measure the torture set and say where the measurement fails."""

import argparse
import os
import sys
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import reduce
from itertools import repeat

from torture.check import Outcome, add, run
from torture.kinds import KINDS

WORST_DEG = 0.05
LEAST_MEASURED = 0.95
STACKS, SEED = 2080, 1


def main() -> int:
    """Measure, print the table and return 1 where a limit fails."""
    options = _options()
    numbers = [options.only] if options.only is not None else _numbers(options)
    by_kind: dict[str, Outcome] = {}
    failing: dict[str, list[int]] = {}
    for number, (kind, outcome) in zip(numbers, _outcomes(options, numbers), strict=True):
        by_kind[kind] = add(by_kind[kind], outcome) if kind in by_kind else outcome
        if _fails(outcome):
            failing.setdefault(kind, []).append(number)
    _print_table(by_kind, failing)
    whole = reduce(add, by_kind.values())
    return 1 if failing or whole.measured < LEAST_MEASURED * whole.measurable else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m torture", description=__doc__)
    parser.add_argument("--stacks", type=int, default=STACKS, help="recordings to measure")
    parser.add_argument("--seed", type=int, default=SEED, help="of the set")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--kind", choices=list(KINDS), help="measure this kind only")
    parser.add_argument("--only", type=int, help="measure the recording of this number only")
    return parser.parse_args()


def _numbers(options: argparse.Namespace) -> list[int]:
    kinds = list(KINDS)
    wanted = range(options.stacks)
    return [n for n in wanted if options.kind in (None, kinds[n % len(kinds)])]


def _outcomes(options: argparse.Namespace, numbers: list[int]) -> Iterator[tuple[str, Outcome]]:
    warnings.simplefilter("error")
    if options.jobs == 1 or len(numbers) < 8:
        yield from map(run, repeat(options.seed), numbers)
        return
    with ProcessPoolExecutor(options.jobs) as pool:
        yield from pool.map(run, repeat(options.seed), numbers, chunksize=4)


def _fails(outcome: Outcome) -> bool:
    return (
        outcome.wrong > 0
        or outcome.worst_deg > WORST_DEG
        or outcome.paid < outcome.owed
        or outcome.alarms > 0
    )


def _print_table(by_kind: dict[str, Outcome], failing: dict[str, list[int]]) -> None:
    print(
        f"{'kind':14} {'stacks':>6} {'fields':>7} {'unflagged':>9} {'wrong':>6} {'worst deg':>9} "
        f"{'measured':>9} {'owed':>6} {'flagged':>8} {'alarms':>6}  failing numbers"
    )
    for kind, outcome in by_kind.items():
        print(_row(kind, outcome), *failing.get(kind, [])[:8])
    print(_row("all", reduce(add, by_kind.values())))


def _row(kind: str, o: Outcome) -> str:
    return (
        f"{kind:14} {o.stacks:6d} {o.fields:7d} {o.unflagged:9d} {o.wrong:6d} {o.worst_deg:9.4f} "
        f"{_percent(o.measured, o.measurable)} {o.owed:6d} {_percent(o.paid, o.owed)} "
        f"{o.alarms:6d} "
    )


def _percent(part: int, whole: int) -> str:
    return f"{100 * part / whole:8.2f}%" if whole else f"{'-':>9}"


if __name__ == "__main__":
    sys.exit(main())
