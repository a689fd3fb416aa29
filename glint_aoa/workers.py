"""Processes that share independent work, such as the points of a campaign."""

import contextlib
import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from types import TracebackType
from typing import Self, TypeVar

__all__ = ["Workers"]

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


class Workers:
    """So many processes, used as a context; with one, the work is done right here.

    Parameters
    ----------
    jobs : int
        How many.

    Notes
    -----
    Each is a fresh interpreter: forking is unsafe once threads run or OpenGL is in use. Ctrl-C
    reaches only the process that waits, which ends the others once what they are at is done.
    """

    def __init__(self, jobs: int = 1) -> None:
        fresh = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(jobs, mp_context=fresh) if jobs > 1 else None

    def __enter__(self) -> Self:
        """Return the workers."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Let each finish what it is at, and begin nothing more."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)

    def map(
        self, function: Callable[[_Item], _Result], items: Iterable[_Item]
    ) -> Iterator[_Result]:
        """Call a function with each item; yield the results in the items' order.

        Parameters
        ----------
        function : callable
            Of a module, or a `functools.partial` of one, so that processes can share it.
        items : iterable
            Its arguments.
        """
        if self._pool is None:
            return map(function, items)
        with _deaf_to_interrupts():
            return self._pool.map(function, items)


@contextlib.contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Let processes that are started here ignore Ctrl-C, which is for the one that waits."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
