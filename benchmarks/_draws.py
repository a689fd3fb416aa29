"""What the studies of coverage share: the band asked for, and their command lines."""

import argparse
from collections.abc import Iterable, Sequence

from glint_aoa.coverage import coverage_factor

__all__ = ["BAND", "WITHIN", "chosen"]

BAND = (0.93, 0.97)
"""Shares of draws that a 95 % interval may hold."""

WITHIN = coverage_factor()
"""Standard deviations that hold 95 % of a normal distribution."""


def chosen(
    doc: str | None, known: Iterable[str], arguments: Sequence[str] | None = None
) -> argparse.Namespace:
    """Read which studies to draw, how often, and the seed; refuse a study that is not known."""
    known = list(known)
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("studies", nargs="*", default=known, metavar="STUDY")
    parser.add_argument("--draws", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    unknown = [name for name in given.studies if name not in known]
    if unknown:
        parser.error(f"no study {unknown[0]}; there are {'; '.join(known)}")
    return given
