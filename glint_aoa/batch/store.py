"""Where the results of a batch go: a folder, or an object store named by a URL."""

import contextlib
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from glint_aoa.errors import GlintError, MissingLibraryError, OutputError
from glint_aoa.process import PointResult
from glint_aoa.records._files import make_folder
from glint_aoa.records.angles import log_result, result_files

__all__ = ["FolderStore", "Store", "UrlStore", "open_store"]

_LOG = "log.csv"
_PROBE = ".glint-aoa"
_LEAST_WAIT_S = 10.0  # between two uploads of the log,
_WAIT_OVER_UPLOAD = 20.0  # and how much longer than the upload itself

_Work = Callable[[Path], PointResult]
_Append = Callable[[Mapping[str, object]], None]


class Store(Protocol):
    """What a batch asks of the place of its results; goes to every process that measures."""

    def check(self) -> None:
        """Raise OutputError if nothing can be written there."""

    def names(self) -> set[str]:
        """Return the names of the files that are there."""

    def write(self, work: _Work) -> PointResult:
        """Let `work` write the files of a point into a folder, and keep them."""

    def log(self) -> contextlib.AbstractContextManager[tuple[Path, _Append]]:
        """Give the folder of the log as it is, and what appends a row to it."""

    def path_of(self, name: str) -> str:
        """Return where a file of this name is, in words."""


@dataclass(frozen=True)
class FolderStore:
    """A folder; on a cluster one that all machines share under the same name."""

    folder: Path

    def check(self) -> None:
        """Make the folder; OutputError if that fails."""
        make_folder(self.folder)

    def names(self) -> set[str]:
        """Return the names of the files that are there."""
        return {path.name for path in self.folder.iterdir()} if self.folder.exists() else set()

    def write(self, work: _Work) -> PointResult:
        """Let `work` write the files of a point."""
        return work(self.folder)

    @contextlib.contextmanager
    def log(self) -> Iterator[tuple[Path, _Append]]:
        """Give the folder of the log, and what appends a row to it."""
        yield self.folder, lambda row: log_result(self.folder, row)

    def path_of(self, name: str) -> str:
        """Return where a file of this name is."""
        return str(self.folder / name)


@dataclass(frozen=True)
class UrlStore:
    """A place that fsspec reaches, such as ``s3://bucket/results``.

    Files are written to a temporary folder and sent when they are whole. An object store cannot
    append: the log is sent again and again, at growing intervals, and at the end.
    """

    url: str

    @cached_property
    def _place(self) -> tuple[Any, str]:
        try:
            import fsspec  # noqa: PLC0415  an extra
        except ImportError:
            raise MissingLibraryError(
                f"{self.url}: results at a URL need fsspec; "
                'install it with: pip install "glint-aoa[cluster]"'
            ) from None
        try:
            system, path = fsspec.core.url_to_fs(self.url)
        except (ValueError, ImportError) as error:
            raise OutputError(f"{self.url}: {error}; give another --out") from error
        return system, path.rstrip("/")

    def __getstate__(self) -> dict[str, str]:
        """Leave the connection here."""
        return {"url": self.url}

    def __setstate__(self, state: dict[str, str]) -> None:
        """Connect anew."""
        self.__dict__.update(state)

    def path_of(self, name: str) -> str:
        """Return where a file of this name is."""
        return f"{self.url.rstrip('/')}/{name}"

    def check(self) -> None:
        """Write a file there, and remove it; OutputError if that fails."""
        with self._told():
            system, path = self._place
            system.makedirs(path, exist_ok=True)
            system.pipe_file(f"{path}/{_PROBE}", b"")
            system.rm_file(f"{path}/{_PROBE}")

    def names(self) -> set[str]:
        """Return the names of the files that are there."""
        with self._told():
            system, path = self._place
            system.invalidate_cache()
            if not system.exists(path):
                return set()
            return {str(each).rpartition("/")[2] for each in system.ls(path, detail=False)}

    def write(self, work: _Work) -> PointResult:
        """Let `work` write the files of a point into a temporary folder, and send them."""
        with tempfile.TemporaryDirectory(prefix="glint-aoa-") as folder:
            result = work(Path(folder))
            with self._told():
                for file in result_files(Path(folder), result.name):
                    self._send(file)
            return result

    @contextlib.contextmanager
    def log(self) -> Iterator[tuple[Path, _Append]]:
        """Give a temporary folder with the log, and what appends a row to it."""
        with tempfile.TemporaryDirectory(prefix="glint-aoa-") as folder:
            log = _SentLog(self, Path(folder))
            try:
                yield Path(folder), log.append
            finally:
                log.send()

    def _send(self, file: Path) -> None:
        system, path = self._place
        system.put_file(str(file), f"{path}/{file.name}")

    def _fetch(self, file: Path) -> None:
        system, path = self._place
        with contextlib.suppress(FileNotFoundError):
            file.write_bytes(system.cat_file(f"{path}/{file.name}"))

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        """Turn what a store may raise, each its own kind, into one sentence."""
        try:
            yield
        except GlintError:
            raise
        except Exception as error:
            raise OutputError(
                f"{self.url}: cannot be written ({' '.join(str(error).split())}); "
                "check the address, its bucket and the credentials"
            ) from error


class _SentLog:
    def __init__(self, store: UrlStore, folder: Path) -> None:
        self._store, self._folder = store, folder
        self._is_sent = True
        self._due = time.monotonic() + _LEAST_WAIT_S
        with store._told():
            store._fetch(folder / _LOG)

    def append(self, row: Mapping[str, object]) -> None:
        log_result(self._folder, row)
        self._is_sent = False
        if time.monotonic() >= self._due:
            self.send()

    def send(self) -> None:
        if self._is_sent:
            return
        start = time.monotonic()
        with self._store._told():
            self._store._send(self._folder / _LOG)
        took = time.monotonic() - start
        self._due = time.monotonic() + max(_LEAST_WAIT_S, _WAIT_OVER_UPLOAD * took)
        self._is_sent = True


def open_store(out: str) -> Store:
    """Return the place of results that a folder's name or a URL names; nothing is written yet.

    Parameters
    ----------
    out : str
        A folder, or a URL that fsspec knows, such as ``s3://bucket/results``.
    """
    return UrlStore(out) if "://" in out else FolderStore(Path(out))
