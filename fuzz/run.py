"""Reading spoilt files in a process of its own, which may crash, hang or run out of memory."""

import multiprocessing
import resource
import shutil
import signal
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from fuzz.families import Family
from fuzz.mutate import spoilt
from glint_aoa.errors import GlintError

__all__ = ["Found", "run_family"]

MOST_S = 5.0
MOST_BYTES = 1 << 30
_LOST_S = 20.0  # without a word from the process


@dataclass
class Found:
    """What came of a family's files.

    Attributes
    ----------
    read, refused : int
        How many were read all the same, and how many were refused in our own words.
    failures : dict of int to str
        By the file's number, what else happened.
    """

    read: int = 0
    refused: int = 0
    failures: dict[int, str] = field(default_factory=dict)


def run_family(family: Family, numbers: range, *, seed: int = 1, most_s: float = MOST_S) -> Found:
    """Read spoilt files of a family.

    Parameters
    ----------
    family : Family
        Its seeds and its reader.
    numbers : range
        Which files; each number gives the same file for the same seed.
    seed : int
        Seed.
    most_s : float
        How long a file may take [s].
    """
    found, left = Found(), numbers
    fresh = multiprocessing.get_context("spawn")
    while left:
        ours, theirs = fresh.Pipe()
        process = fresh.Process(
            target=_work, args=(theirs, family, left, seed, most_s), daemon=True
        )
        process.start()
        theirs.close()
        number, said = left.start - 1, None
        for number, said in _heard(ours):
            if said is None:
                continue
            found.read += said == "read"
            found.refused += said == "refused"
            if said not in {"read", "refused"}:
                found.failures[number] = said
        process.kill()
        process.join()
        if said is None and number >= left.start:  # it began with this one and did not end
            found.failures[number] = "crashed or hung"
            left = range(number + 1, numbers.stop)
        else:
            left = range(max(number + 1, left.start), numbers.stop)
    return found


def _heard(ours: Connection) -> Iterator[tuple[int, str | None]]:
    try:
        while ours.poll(_LOST_S):
            yield ours.recv()
    except EOFError:
        return


def _work(theirs: Connection, family: Family, numbers: range, seed: int, most_s: float) -> None:
    warnings.simplefilter("error")
    signal.signal(signal.SIGALRM, _ring)
    _limit_memory()
    with tempfile.TemporaryDirectory() as folder:
        whole = _seeds(family, Path(folder))
        for number in numbers:
            theirs.send((number, None))
            said = read_one(family, whole, Path(folder), seed=[seed, number], most_s=most_s)
            theirs.send((number, said))


def _limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    used = pages * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, used + MOST_BYTES))


def _ring(*_: object) -> None:
    raise TimeoutError("took too long")


def _seeds(family: Family, folder: Path) -> list[list[Path]]:
    (folder / "whole").mkdir()
    return [list(files) for files in family.seeds(folder / "whole")]


def read_one(
    family: Family, whole: list[list[Path]], folder: Path, *, seed: list[int], most_s: float
) -> str:
    """Spoil one recording and read it: "read", "refused", or what else happened."""
    rng = np.random.default_rng(seed)
    files = whole[int(rng.integers(len(whole)))]
    victim = int(rng.integers(len(files)))
    place = folder / "spoilt"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    for number, path in enumerate(files):
        content = path.read_bytes()
        (place / path.name).write_bytes(spoilt(content, rng) if number == victim else content)
    signal.setitimer(signal.ITIMER_REAL, most_s)
    try:
        family.read(place / files[-1].name)
    except GlintError as error:
        text = str(error)
        if "\n" in text or not any(each.stem in text for each in files):
            return f"not a sentence that names the file: {text!r}"
        return "refused"
    except BaseException as error:  # whatever it is, it is a failure
        return f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return "read"
