"""How much memory and how many processors a batch takes of one machine."""

from dataclasses import dataclass
from typing import Self

from glint_aoa.errors import InputError
from glint_aoa.records.fields import BLOCK_BYTES
from glint_aoa.units import parse_quantity
from glint_aoa.workers import available_bytes, processors

__all__ = ["Sizing", "memory_bytes"]

_SHARE_OF_BLOCKS = 1 / 16  # of a process's memory that its blocks of fields may take
_SHARE_OF_AVAILABLE = 0.8


def memory_bytes(words: str) -> int:
    """Read an amount of memory, such as ``"4GB"`` or ``"512 MiB"`` [bytes].

    Raises
    ------
    InputError
        If it is none, or not more than nothing.
    """
    try:
        amount = parse_quantity(words, "byte")
    except ValueError:
        amount = 0.0
    if not 1 <= amount < float("inf"):
        raise InputError(f"--memory {words}: no amount of memory; write it like 4GB or 512MiB")
    return int(amount)


@dataclass(frozen=True)
class Sizing:
    """What a batch may take; made by `of_machine`.

    Attributes
    ----------
    jobs : int
        Processes at once, at most.
    memory : int
        What all processes may take together [bytes].
    threads : int
        Blocks of fields that each process measures at the same time.
    block_bytes : int
        What the fields of a block take, at most [bytes].
    """

    jobs: int
    memory: int
    threads: int
    block_bytes: int

    @classmethod
    def of_machine(
        cls, n_points: int, *, jobs: int | None = None, memory: int | None = None
    ) -> Self:
        """Divide the machine among the points.

        Parameters
        ----------
        n_points : int
            How many there are to measure.
        jobs : int, optional
            Processes at once, at most; one for each processor if not given.
        memory : int, optional
            What all processes may take together [bytes]; four fifths of what is available if not
            given.
        """
        available = int(_SHARE_OF_AVAILABLE * available_bytes())
        memory = available if memory is None else memory
        jobs = max(1, min(jobs or processors(), n_points))
        threads = max(1, processors() // jobs)
        # Threads hold one more block than there are of them.
        block = int(_SHARE_OF_BLOCKS * memory / jobs / (threads + 1))
        return cls(jobs, memory, threads, min(block, BLOCK_BYTES))
