"""A folder in which pictures or files of fields appear while it is watched."""

import re
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import GlintError, RecordingError
from glint_aoa.live.sources import Arrival, Source
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.formats import SUFFIXES, open_fields
from glint_aoa.records.formats._colour import grey_of
from glint_aoa.setup import Fields

__all__ = ["Folder"]

_POLL_S = 0.02
_YOUNG_S = 1.0  # a file that cannot be read and changed so lately may yet become whole
_PICTURES = {".png"}


class Folder(Source):
    """Fields of the files that appear in a folder: pictures of one field, or whole recordings.

    A file is taken once its size has stayed the same from one look to the next, in the order of
    the numbers in their names; one that cannot be read is tried again for a second. Fields
    have no clock: they are taken to follow each other at the setup's rate. What was there before
    is left out.

    Parameters
    ----------
    folder : Path
        The folder.
    stated : Fields
        The setup's section, with the rate.
    tell : callable
        Called with one sentence about each file that cannot be used.

    Raises
    ------
    RecordingError
        If the setup does not say the rate.
    """

    def __init__(self, folder: Path, *, stated: Fields, tell: Callable[[str], None]) -> None:
        if stated.rate is None:
            raise RecordingError(
                f"{folder}: pictures do not say their rate; give fields.rate in the setup"
            )
        self.name, self._folder, self._stated, self._tell = str(folder), folder, stated, tell
        self._rate_hz = stated.rate
        self._seen = {path.name for path in folder.iterdir()}
        self._sizes: dict[str, int] = {}
        self._waiting: list[Path] = []  # whole, and still to be read
        self._first: list[NDArray[Any]] = []
        self.info = FieldInfo(rate_hz=stated.rate)

    def ready(self, stop: threading.Event) -> bool:
        """Wait for the first file."""
        for fields, white_level in self._files(stop):
            self._first = [fields]
            self.shape, self.dtype = fields.shape[1:], fields.dtype
            self.white_level = white_level
            return True
        return False

    def arrivals(self, stop: threading.Event) -> Iterator[Arrival]:
        """Give the fields of file after file; see `Source`."""
        number = 0
        for fields in self._first:
            yield from self._numbered(fields, number)
            number += len(fields)
        for fields, _ in self._files(stop):
            yield from self._numbered(fields, number)
            number += len(fields)

    def _numbered(self, fields: NDArray[Any], first: int) -> Iterator[Arrival]:
        arrived = time.perf_counter()
        for number, field in enumerate(fields, first):
            yield Arrival(number, field, number / self._rate_hz, arrived)

    def _files(self, stop: threading.Event) -> Iterator[tuple[NDArray[Any], int]]:
        while not stop.is_set() and (self._waiting or not stop.wait(_POLL_S)):
            self._waiting = self._waiting or self._whole_files()
            while self._waiting and not stop.is_set():
                path = self._waiting.pop(0)
                try:
                    read = _read(path, self._stated)
                    self._check(path, read[0])
                except GlintError as error:
                    if _is_young(path):
                        self._seen.discard(path.name)
                    else:
                        self._tell(str(error))
                    continue
                yield read

    def _whole_files(self) -> list[Path]:
        """Return new files whose size was the same at the last look, by their numbers."""
        whole, sizes = [], {}
        for path in self._folder.iterdir():
            if path.name in self._seen or path.name.startswith("."):
                continue
            if path.suffix.lower() not in _PICTURES.union(SUFFIXES):
                continue
            size = _size(path)
            sizes[path.name] = size
            if size > 0 and self._sizes.get(path.name) == size:
                whole.append(path)
                self._seen.add(path.name)
        self._sizes = sizes
        return sorted(whole, key=_by_number)

    def _check(self, path: Path, fields: NDArray[Any]) -> None:
        if not self._first:
            return
        if fields.shape[1:] != self.shape or fields.dtype != self.dtype:
            raise RecordingError(
                f"{path}: {fields.dtype} {list(fields.shape[1:])}, expected "
                f"{self.dtype} {list(self.shape)} like the first; it is left out"
            )


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _is_young(path: Path) -> bool:
    try:
        return abs(time.time() - path.stat().st_mtime) < _YOUNG_S
    except OSError:
        return False


def _by_number(path: Path) -> list[tuple[str, int]]:
    parts = re.findall(r"(\D*)(\d{0,18})", path.stem)
    return [(word, int(digits or -1)) for word, digits in parts]


def _read(path: Path, stated: Fields) -> tuple[NDArray[Any], int]:
    """Return the fields of a file [field, line, column] and the top of their scale."""
    if path.suffix.lower() not in _PICTURES:
        stack = open_fields(path, stated)
        return stack.read(0, stack.n_fields), stack.white_level
    import cv2  # noqa: PLC0415  half a second

    pixels = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise RecordingError(f"{path}: its pixels cannot be unpacked; it is left out")
    grey = pixels if pixels.ndim == 2 else grey_of(pixels[..., 2::-1], None)
    return grey[None], int(np.iinfo(grey.dtype).max)
