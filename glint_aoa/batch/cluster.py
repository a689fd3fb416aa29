"""The workers of a Dask cluster, as a pool that shares the points of a batch."""

import asyncio
import logging
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self, TypeVar

from glint_aoa._version import __version__
from glint_aoa.batch.point import Split
from glint_aoa.errors import InputError, MissingLibraryError, WorkerDiedError
from glint_aoa.workers import Outcome

__all__ = ["Cluster"]

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_LOGGERS = ("distributed.client", "distributed.utils", "distributed.core", "tornado.application")
_ANSWER_S = 5.0  # within which a scheduler answers,
_WORKERS_S = 60.0  # and has a worker
_AHEAD = 3  # tasks given to the scheduler for each thread of its workers
_COUNT_S = 5.0  # how long a count of the threads is believed


class Cluster:
    """The workers of a running Dask scheduler, used as a context.

    A worker that is lost costs time only: the scheduler gives what it had to others. A point that
    takes several workers with it is given up, as the scheduler's ``allowed-failures`` says.

    Parameters
    ----------
    scheduler : str
        Its address, such as ``tcp://10.0.0.5:8786``.

    Raises
    ------
    MissingLibraryError
        If ``distributed`` is not installed.
    InputError
        If no scheduler answers, it has no worker, or one runs another version of glint-aoa: its
        results might differ.
    """

    def __init__(self, scheduler: str) -> None:
        self._scheduler = scheduler
        self._dask = _library()
        try:
            # A client that finds nobody leaves half of itself behind.
            asyncio.run(self._knock())
            self._client = self._dask.Client(scheduler, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(
                f"{scheduler}: no Dask scheduler answers there; start one with dask scheduler, or "
                "write its address like tcp://10.0.0.5:8786"
            ) from error
        self._threads = 0
        self._counted_s = float("-inf")

    async def _knock(self) -> None:
        found = await self._dask.comm.connect(self._scheduler, timeout=_ANSWER_S)
        await found.close()

    def __enter__(self) -> Self:
        """Return the cluster once its workers have been looked at."""
        try:
            self._check_workers()
        except BaseException:
            self._client.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Take back what has not been begun; the scheduler and its workers go on."""
        self._client.close()

    def _check_workers(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=_WORKERS_S)
        except TimeoutError as error:
            raise InputError(
                f"{self._scheduler}: the scheduler has no workers; start some with "
                f"dask worker {self._scheduler}"
            ) from error
        for worker, version in self._client.run(_version, on_error="return").items():
            if isinstance(version, BaseException):
                raise InputError(
                    f"{worker}: cannot load glint-aoa ({version}); install glint-aoa "
                    f"{__version__} there"
                ) from version
            if version != __version__:
                raise InputError(
                    f"{worker}: has glint-aoa {version}, and {__version__} is here; install the "
                    "same on all machines"
                )

    def outcomes(
        self, function: Callable[[_Item], _Result], items: Iterable[_Item]
    ) -> Iterator[Outcome[_Item, _Result]]:
        """Call a function with each item, and yield what came of them as they end.

        Parameters
        ----------
        function, items
            As for `glint_aoa.workers.Workers.outcomes`. Where the function returns a `Split`, its
            parts are shared among the workers, and the result is what its last returns.

        Yields
        ------
        Outcome
            One for each item.

        Raises
        ------
        InputError
            If the scheduler is lost.
        """
        ended = self._dask.as_completed([], loop=self._client.loop)
        fresh = enumerate(items)
        jobs: dict[Any, _Job] = {}
        self._submit(function, fresh, jobs, ended)
        while jobs:
            future = next(ended)
            job = jobs.pop(future.key)
            outcome = self._outcome(future, job)
            if isinstance(outcome.result, Split):
                last = self._submit_split(outcome.result)
                jobs[last.key] = job.held_by(last)
                ended.add(last)
                continue
            self._submit(function, fresh, jobs, ended)
            yield outcome

    def _submit(
        self,
        function: Callable[[Any], Any],
        fresh: Iterator[tuple[int, Any]],
        jobs: "dict[Any, _Job]",
        ended: Any,
    ) -> None:
        """Give the scheduler as much as keeps its workers busy."""
        room = max(1, _AHEAD * self._count()) - len(jobs)
        for _ in range(room):
            number, item = next(fresh, (-1, None))
            if number < 0:
                return
            future = self._client.submit(function, item, pure=False)
            jobs[future.key] = _Job(number, item, future)
            ended.add(future)

    def _submit_split(self, split: Split) -> Any:
        submit = self._client.submit
        first = submit(split.first, pure=False)
        parts = [submit(part, first, pure=False) for part in split.parts]
        return submit(split.last, first, parts, pure=False)

    def _count(self) -> int:
        """Return the threads of all workers; they may come and go."""
        if time.monotonic() - self._counted_s > _COUNT_S:
            self._threads = sum(self._client.nthreads().values())
            self._counted_s = time.monotonic()
        return self._threads

    def _outcome(self, future: Any, job: "_Job") -> Outcome[Any, Any]:
        if future.status in {"cancelled", "lost"}:
            raise self._lost()
        error = future.exception()
        if isinstance(error, self._dask.scheduler.KilledWorker):
            error = WorkerDiedError(
                f"{error.allowed_failures + 1} workers died while they worked at it; "
                "if memory ran out, try it where there is more"
            )
        if error is not None:
            return Outcome(job.number, job.item, error=error)
        return Outcome(job.number, job.item, future.result())

    def _lost(self) -> InputError:
        return InputError(
            f"{self._scheduler}: the scheduler was lost; start it again, and go on with --resume"
        )


@dataclass(frozen=True)
class _Job:
    """An item at work; its future is held, or the scheduler would forget it."""

    number: int
    item: Any
    future: Any

    def held_by(self, future: Any) -> "_Job":
        """Return the same item, held by another future."""
        return _Job(self.number, self.item, future)


def _library() -> Any:
    try:
        import distributed  # noqa: PLC0415  an extra
    except ImportError:
        raise MissingLibraryError(
            "--scheduler needs distributed, which is not installed; "
            'install it with: pip install "glint-aoa[cluster]"'
        ) from None
    for name in _LOGGERS:  # what they print beside our own sentence are tracebacks
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return distributed


def _version() -> str:
    """Return the version of glint-aoa where this runs."""
    return __version__
