"""Processes that share independent work, such as the points of a campaign."""

import contextlib
import multiprocessing
import os
import pickle
import resource
import signal
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from multiprocessing import connection
from multiprocessing.context import SpawnContext
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Protocol, Self, TypeVar, cast

from glint_aoa.errors import WorkerDiedError

__all__ = [
    "Outcome",
    "Pool",
    "Workers",
    "available_bytes",
    "deaf_to_interrupts",
    "processors",
]

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_SUPPOSED = 1 << 30  # bytes that a process is taken to need until one has shown it
_TRIES = 2  # how often an item is given to a process before it is given up
_RESET_PEAK = "5"  # see clear_refs in proc(5)


@dataclass(frozen=True)
class Outcome(Generic[_Item, _Result]):
    """What came of one item.

    Attributes
    ----------
    number : int
        Its place among the items, from 0.
    item
        The item.
    result
        What the function returned; None where it raised something.
    error : Exception or None
        What it raised; `WorkerDiedError` where its process died under it.
    """

    number: int
    item: _Item
    result: _Result | None = None
    error: Exception | None = None

    def get(self) -> _Result:
        """Return the result, or raise the error."""
        if self.error is not None:
            raise self.error
        return cast("_Result", self.result)


class Pool(Protocol):
    """Whatever shares work: processes here, or those of a cluster."""

    def outcomes(
        self, function: Callable[[_Item], _Result], items: Iterable[_Item]
    ) -> Iterator[Outcome[_Item, _Result]]:
        """Call a function with each item, and yield what came of them as they end."""
        ...


class Workers:
    """So many processes, used as a context; with one, the work is done right here.

    Parameters
    ----------
    jobs : int
        How many, at most.
    memory : int, optional
        What all of them and this process may take together [bytes]. There are as many at once as
        this allows by what they have been seen to take, but always one.
    apart : bool, optional
        Whether a single one is a process of its own too, so that it can die alone.

    Notes
    -----
    Each is a fresh interpreter: forking is unsafe once threads run or OpenGL is in use. Ctrl-C
    reaches only the process that waits, which ends the others once what they are at is done; if
    it is killed, they end as well. An item whose process dies is given to another one, while
    nothing else runs, and given up if that one dies too.
    """

    def __init__(self, jobs: int = 1, *, memory: int | None = None, apart: bool = False) -> None:
        self._most = jobs if jobs > 1 or apart else 0
        self._memory = memory
        self._lanes: list[_Lane] = []
        self._too_much = 0  # what one took when all took more than they may

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
        self._end(list(self._lanes))

    @property
    def count(self) -> int:
        """How many processes there are now."""
        return len(self._lanes)

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
        if not self._most:
            return map(function, items)
        return _in_order(self.outcomes(function, items))

    def outcomes(
        self, function: Callable[[_Item], _Result], items: Iterable[_Item]
    ) -> Iterator[Outcome[_Item, _Result]]:
        """Call a function with each item, and yield what came of them as they end.

        Parameters
        ----------
        function, items
            As for `map`. An item is asked for when a process is free for it.

        Yields
        ------
        Outcome
            One for each item; an error of one does not keep the others from being worked at.
        """
        if not self._most:
            yield from (_called(function, *each) for each in enumerate(items))
            return
        work = _Work(function, items)
        try:
            self._share_out(work)
            while busy := self._busy():
                ready = connection.wait([lane.pipe for lane in busy])
                ended = [work.ended(lane) for lane in busy if lane.pipe in ready]
                self._end([lane for lane in busy if lane.is_dead])
                self._share_out(work)
                yield from (each for each in ended if each is not None)
        finally:
            self._end(self._busy())

    def _busy(self) -> "list[_Lane]":
        return [lane for lane in self._lanes if lane.job is not None]

    def _share_out(self, work: "_Work") -> None:
        """Give every process that is free an item, and start those that there is room for."""
        while work.next is not None:
            busy = self._busy()
            # What killed a process may be the memory of the others: the second try is alone.
            if busy and any(job.tries for job in (work.next, *(lane.job for lane in busy)) if job):
                return
            lane = self._free_lane()
            if lane is None:
                return
            lane.give(work.function, work.take())

    def _free_lane(self) -> "_Lane | None":
        idle = [lane for lane in self._lanes if lane.job is None]
        while idle and len(self._lanes) > 1 and self._taken() > self._limit:
            self._too_much = self._expected()
            idle.sort(key=lambda lane: lane.peak or 0)
            self._end([idle.pop()])
        if idle:
            return idle[0]
        room = not self._lanes or self._taken() + self._expected() <= self._limit
        if len(self._lanes) >= self._most or not room:
            return None
        self._lanes.append(_Lane())
        return self._lanes[-1]

    @property
    def _limit(self) -> float:
        return float("inf") if self._memory is None else self._memory

    def _expected(self) -> int:
        """Return what one more process would take [bytes]."""
        seen = max((lane.peak for lane in self._lanes if lane.peak), default=_SUPPOSED)
        return max(seen, self._too_much)

    def _taken(self) -> int:
        """Return what all take together [bytes]."""
        expected = self._expected()
        return _resident_bytes() + sum(lane.peak or expected for lane in self._lanes)

    def _end(self, lanes: "list[_Lane]") -> None:
        for lane in lanes:
            lane.pipe.close()
        for lane in lanes:
            lane.process.join()
            self._lanes.remove(lane)


@dataclass(frozen=True)
class _Job:
    number: int
    item: Any
    tries: int = 0


class _Lane:
    """One process, and our end of the pipe to it; `peak` is what its last job took [bytes]."""

    def __init__(self) -> None:
        context: SpawnContext = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self.job: _Job | None = None
        self.peak: int | None = None
        self.is_dead = False
        self._function: Callable[[Any], Any] | None = None
        with deaf_to_interrupts():
            self.process.start()
        theirs.close()

    def give(self, function: Callable[[Any], Any], job: _Job) -> None:
        """Let the process, which is idle, work at a job."""
        self.job = job
        with contextlib.suppress(OSError):  # it has died; its end of the pipe will tell
            self.pipe.send((None if function is self._function else function, job.item))
        self._function = function

    def take(self) -> tuple[Any, Exception | None]:
        """Return result and error of its job; WorkerDiedError if there will be none."""
        try:
            result, error, self.peak = self.pipe.recv()
        except (EOFError, OSError):
            self.is_dead = True
            self.process.join()
            return None, WorkerDiedError(_death(self.process.exitcode))
        finally:
            self.job = None
        return result, error


class _Work:
    """Items that wait for a process; those that come back are first."""

    def __init__(self, function: Callable[[Any], Any], items: Iterable[Any]) -> None:
        self.function = function
        self._fresh = (_Job(*each) for each in enumerate(items))
        self._again: deque[_Job] = deque()
        self.next: _Job | None = next(self._fresh, None)

    def take(self) -> _Job:
        """Take the next one."""
        job = self.next
        assert job is not None
        self.next = self._again.popleft() if self._again else next(self._fresh, None)
        return job

    def ended(self, lane: _Lane) -> Outcome[Any, Any] | None:
        """Return what came of a process's job; None if it is to be tried once more."""
        job = lane.job
        assert job is not None
        result, error = lane.take()
        if isinstance(error, WorkerDiedError) and lane.is_dead and job.tries + 1 < _TRIES:
            if self.next is not None:
                self._again.append(self.next)
            self.next = replace(job, tries=job.tries + 1)
            return None
        return Outcome(job.number, job.item, result, error)


def _in_order(outcomes: Iterable[Outcome[_Item, _Result]]) -> Iterator[_Result]:
    early: dict[int, Outcome[_Item, _Result]] = {}
    due = 0
    for outcome in outcomes:
        early[outcome.number] = outcome
        while due in early:
            yield early.pop(due).get()
            due += 1


def _called(
    function: Callable[[_Item], _Result], number: int, item: _Item
) -> Outcome[_Item, _Result]:
    try:
        return Outcome(number, item, function(item))
    except Exception as error:
        return Outcome(number, item, error=error)


def _serve(pipe: "connection.Connection[Any, Any]") -> None:
    """Work at what comes through the pipe, in a process of its own, until its other end is gone."""
    function: Callable[[Any], Any] | None = None
    with contextlib.suppress(EOFError, OSError):
        while True:
            new, item = pipe.recv()
            function = new or function
            assert function is not None
            _reset_peak()
            outcome = _called(function, 0, item)
            error = outcome.error and _portable(outcome.error)
            try:
                pipe.send((outcome.result, error, _peak_bytes()))
            except (pickle.PicklingError, AttributeError, TypeError) as cannot:
                pipe.send((None, _portable(cannot), _peak_bytes()))


def _portable(error: Exception) -> Exception:
    """Return an error that survives the way through a pipe, and takes its traceback along."""
    trace = "".join(traceback.format_exception(error))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(trace)
    return error


def _death(code: int | None) -> str:
    by = signal.Signals(-code).name if code and code < 0 else f"exit code {code}"
    return (
        f"two processes died while they worked at it, the second by {by}; "
        "if memory ran out, try it where there is more"
    )


def _resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def _reset_peak() -> None:
    with contextlib.suppress(OSError):  # the peak then is that of all jobs
        Path("/proc/self/clear_refs").write_text(_RESET_PEAK)


def _peak_bytes() -> int:
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) * 1024


def available_bytes() -> int:
    """Return the memory that programs started now may take without others being swapped out.

    Returns
    -------
    int
        What the system calls available, or the limit of its control group if that is less [bytes].
    """
    told = Path("/proc/meminfo").read_text()
    available = int(told.partition("MemAvailable:")[2].split()[0]) * 1024
    limit = Path("/sys/fs/cgroup/memory.max")
    with contextlib.suppress(OSError, ValueError):  # no such group, or "max"
        available = min(available, int(limit.read_text()))
    return available


def processors() -> int:
    """Return the number of processors that this program may use."""
    return len(os.sched_getaffinity(0))


@contextlib.contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Let processes that are started here ignore Ctrl-C, which is for the one that waits."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
