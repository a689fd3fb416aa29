"""Measuring points beside the page: one process of low priority, and the thread that feeds it."""

import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from glint_aoa.errors import GlintError, RecordingError
from glint_aoa.monitor.details import PointDetails, point_details, point_row
from glint_aoa.monitor.watch import FolderWatch
from glint_aoa.setup import Setup

__all__ = ["PointWorker"]

_LOOK_S = 0.5  # between looks at the folder
_ASKED_S = 3.0  # pages ask again and again for what they show
_KEPT = 24  # points whose details stay in memory
_NICE = 5  # a live measurement on the same machine goes first


class PointWorker:
    """Measures what a `FolderWatch` hands out, and gathers details of the points that are shown.

    All pages of the server share one. The work is done in another process, so that neither a
    long recording nor one that brings a decoder down stops the pages.

    Parameters
    ----------
    watch : FolderWatch
        The folder.
    setup : Setup
        The setup.
    results : Path
        Folder of the results.
    """

    def __init__(self, watch: FolderWatch, setup: Setup, results: Path) -> None:
        self.watch = watch
        self._setup, self._results = setup, results
        self._details: OrderedDict[str, PointDetails | str] = OrderedDict()
        self._wanted: dict[str, float] = {}  # when a page asked for it last
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._is_over = False
        self._pool: ProcessPoolExecutor | None = None
        self._thread = threading.Thread(target=self._run, name="points", daemon=True)

    def start(self) -> None:
        """Begin to watch and measure."""
        self._thread.start()

    def stop(self) -> None:
        """End at once; a point that is being measured will be measured another time."""
        self._is_over = True
        self._wake.set()
        self._thread.join(timeout=5)
        for process in multiprocessing.active_children():
            process.terminate()
        self._close()

    def details(self, name: str) -> PointDetails | str | None:
        """Return what is drawn of a point, or why there is nothing; None while it is gathered."""
        with self._lock:
            if name in self._details:
                self._details.move_to_end(name)
                return self._details[name]
            is_new = name not in self._wanted
            self._wanted[name] = time.monotonic()
        if is_new:
            self._wake.set()
        return None

    def _run(self) -> None:
        job: tuple[Future[Any], Callable[[Future[Any]], None]] | None = None
        while not self._is_over:
            self.watch.scan()
            if job is not None and job[0].done():
                job[1](job[0])
                job = None
            job = job or self._next_detail() or self._next_point()
            self._wake.wait(_LOOK_S)
            self._wake.clear()

    def _next_detail(self) -> tuple[Future[Any], Callable[[Future[Any]], None]] | None:
        name = self._most_wanted()
        path = None if name is None else self.watch.path_of(name)
        if name is None or path is None:
            return None
        future = self._submit(point_details, path, self._setup, self._results)
        return future, partial(self._keep, name)

    def _most_wanted(self) -> str | None:
        """Return the point that a page asked for last; what no page shows any more is forgotten."""
        with self._lock:
            since = time.monotonic() - _ASKED_S
            self._wanted = {name: asked for name, asked in self._wanted.items() if asked >= since}
            return max(self._wanted, key=self._wanted.__getitem__, default=None)

    def _next_point(self) -> tuple[Future[Any], Callable[[Future[Any]], None]] | None:
        taken = self.watch.take()
        if taken is None:
            return None
        path, again = taken
        with self._lock:
            self._details.pop(path.name, None)
        future = self._submit(point_row, path, self._setup, self._results, again=again)
        return future, partial(self._note, path)

    def _submit(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> Future[Any]:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                1, mp_context=multiprocessing.get_context("spawn"), initializer=_settle_in
            )
        try:
            future = self._pool.submit(function, *arguments, **options)
        except BrokenExecutor as error:
            future = Future()
            future.set_exception(error)
        future.add_done_callback(lambda _: self._wake.set())
        return future

    def _note(self, path: Path, future: Future[Any]) -> None:
        """Tell the watch what came of a point."""
        error = future.exception()
        if error is None:
            self.watch.measured(path, future.result())
        else:
            self.watch.failed(path, self._said(error), may_heal=isinstance(error, RecordingError))

    def _keep(self, name: str, future: Future[Any]) -> None:
        error = future.exception()
        with self._lock:
            self._details[name] = future.result() if error is None else self._said(error)
            while len(self._details) > _KEPT:
                self._details.popitem(last=False)
            self._wanted.pop(name, None)
        self.watch.touch()

    def _said(self, error: BaseException) -> str:
        """Return an error as a sentence; a process that died is replaced."""
        if isinstance(error, GlintError):
            return str(error).replace(f"{self.watch.folder}{os.sep}", "")
        if isinstance(error, BrokenExecutor):
            self._close()
            return "the program that measures ended on it; look at it with glint-aoa inspect"
        return (
            f"an error of the program itself ({type(error).__name__}: {error}); "
            "run glint-aoa --debug process on it and report what that prints"
        )

    def _close(self) -> None:
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(cancel_futures=True)


def _settle_in() -> None:
    """Begin a measuring process: Ctrl-C is for the server, and when that ends, so does this."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(_NICE)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(0)
