"""A folder of recorded points as it fills: what is there, what is whole, what is to be measured."""

import os
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from glint_aoa.errors import RecordingError
from glint_aoa.records.formats import ACQUISITION_SUFFIXES, HDF5_SUFFIXES, SUFFIXES
from glint_aoa.records.formats.hdf5 import has_acquisition, has_fields

__all__ = ["FolderWatch", "PointRow", "PointStatus"]

_HEADERS = (".cih", ".cihx")  # of a Photron recording: the .mraw beside it is the point
_PICTURES = (".png", ".tif", ".tiff")
_TAKEN = ("log", "marks")  # names of tables
_RETRY_S = 2.0  # between looks at a file that could not be opened yet
_NOTHING: Mapping[str, str] = {}

_Signature = tuple[tuple[str, int, int], ...]


class PointStatus(StrEnum):
    """What has become of a recording; the value says it in words."""

    WAITING = "being written"
    QUEUED = "waits its turn"
    MEASURING = "being measured"
    MEASURED = "measured"
    BROKEN = "cannot be used"
    WITHOUT_FIELDS = "holds channels only"


@dataclass(frozen=True)
class PointRow:
    """One recording of the folder.

    Attributes
    ----------
    name : str
        Its file's name.
    status : PointStatus
        What has become of it.
    log : mapping of str to str
        Its row of ``log.csv``, as it stands there; empty until it is measured.
    sentence : str
        Why it cannot be used; empty if it can.
    """

    name: str
    status: PointStatus
    log: Mapping[str, str] = field(default_factory=dict)
    sentence: str = ""


@dataclass
class _Entry:
    path: Path
    signature: _Signature
    changed_s: float
    status: PointStatus = PointStatus.WAITING
    log: Mapping[str, str] = field(default_factory=dict)
    sentence: str = ""
    due_s: float = 0.0  # not looked at again before
    has_results: bool = False

    def row(self) -> PointRow:
        return PointRow(self.path.name, self.status, self.log, self.sentence)


class FolderWatch:
    """The points of a folder; safe to use from several threads.

    Each recording is handed out once by `take`, when it has not changed for `settle_s`; what came
    of it is told to `measured` or `failed`. One that changes later is handed out again.

    Parameters
    ----------
    folder : Path
        The folder; folders in it count only where they hold pictures.
    settle_s : float, optional
        How long a recording must not have changed before it is opened [s].
    patience_s : float, optional
        How long a recording that cannot be opened may yet become whole [s].
    clock, now : callable, optional
        Monotonic seconds, and seconds since 1970 as of the files.

    Attributes
    ----------
    folder : Path
        The folder, without links in its path.
    problem : str
        Why the folder cannot be read, in a sentence; empty if it can.

    Notes
    -----
    Whether a recording is whole is told from its size and time alone; a writer that pauses for
    longer than `settle_s` in the middle of a file that can be read so far has its point measured
    twice, the second time whole. Links that lead out of the folder are never opened.
    """

    def __init__(
        self,
        folder: Path,
        *,
        settle_s: float = 1.0,
        patience_s: float = 10.0,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], float] = time.time,
    ) -> None:
        self.folder = folder.resolve()
        self._settle_s, self._patience_s = settle_s, patience_s
        self._clock, self._now = clock, now
        self._entries: dict[str, _Entry] = {}  # in order of arrival
        self._lock = threading.RLock()
        self._version = 0
        self.problem = ""

    @property
    def version(self) -> int:
        """A number that grows with each change of the rows."""
        return self._version

    def rows(self) -> list[PointRow]:
        """Return all recordings, in order of arrival."""
        with self._lock:
            return [entry.row() for entry in self._entries.values() if _is_shown(entry)]

    def path_of(self, name: str) -> Path | None:
        """Return the path of a recording that is measured, by its file's name."""
        with self._lock:
            entry = self._entries.get(name)
            return entry.path if entry is not None and entry.has_results else None

    def scan(self) -> None:
        """Look at the folder once; points that were measured stay though their files go."""
        try:
            found = self._found()
        except OSError as error:
            self._tell(f"{self.folder}: cannot be read ({error.strerror}); is it still there?")
            return
        self._tell("")
        with self._lock:
            before = self.rows()
            for name in [name for name in self._entries if name not in found]:
                if not self._entries[name].has_results:
                    del self._entries[name]
            for name, (path, signature) in found.items():
                self._see(name, path, signature)
            if self.rows() != before:
                self._version += 1

    def take(self) -> tuple[Path, bool] | None:
        """Hand out the next recording to measure, and whether it has been measured before."""
        with self._lock:
            for entry in self._entries.values():
                if entry.status is PointStatus.QUEUED:
                    try:
                        entry.status, entry.sentence = self._judged(entry)
                    except OSError as error:  # it may have gone just now
                        entry.status = PointStatus.BROKEN
                        entry.sentence = f"cannot be read ({error.strerror}); is it still there?"
                    self._version += 1
                    if entry.status is PointStatus.MEASURING:
                        return entry.path, entry.has_results
            return None

    def measured(self, path: Path, log: Mapping[str, str]) -> None:
        """Note a recording's row of the log."""
        with self._lock:
            entry = self._entries.get(path.name)
            if entry is not None:
                entry.log, entry.sentence, entry.has_results = dict(log), "", True
                self._end(entry, PointStatus.MEASURED)

    def failed(self, path: Path, sentence: str, *, may_heal: bool = False) -> None:
        """Note why a recording could not be measured.

        Parameters
        ----------
        path : Path
            The recording.
        sentence : str
            Why.
        may_heal : bool, optional
            Whether the reason may be that it is still being written.
        """
        with self._lock:
            entry = self._entries.get(path.name)
            if entry is None:  # its file was taken away meanwhile
                return
            is_young = self._clock() - entry.changed_s < self._patience_s
            entry.sentence, entry.log = sentence, _NOTHING
            entry.due_s = self._clock() + _RETRY_S
            self._end(entry, PointStatus.WAITING if may_heal and is_young else PointStatus.BROKEN)

    def touch(self) -> None:
        """Say that something else of the points has changed, so that pages look again."""
        with self._lock:
            self._version += 1

    def _end(self, entry: _Entry, status: PointStatus) -> None:
        """End a measurement; one that was overtaken by a change of the file counts for nothing."""
        if entry.status is PointStatus.MEASURING:
            entry.status = status
        self._version += 1

    def _found(self) -> dict[str, tuple[Path, _Signature]]:
        found = {}
        for path in sorted(self.folder.iterdir(), key=_age_of):
            if _is_candidate(path):
                signature = _signature(path)
                if signature:
                    found[path.name] = (path, signature)
        return found

    def _see(self, name: str, path: Path, signature: _Signature) -> None:
        """Follow one recording from look to look."""
        clock = self._clock()
        entry = self._entries.get(name)
        if entry is None:
            newest = max(time_ns for _, _, time_ns in signature) / 1e9
            entry = _Entry(path, signature, clock - max(0.0, self._now() - newest))
            self._entries[name] = entry
        elif signature != entry.signature:
            entry = _Entry(path, signature, clock, has_results=entry.has_results)
            del self._entries[name]
            self._entries[name] = entry  # it is the newest now
        is_settled = clock - entry.changed_s >= self._settle_s and clock >= entry.due_s
        if entry.status is PointStatus.WAITING and is_settled:
            entry.status = PointStatus.QUEUED

    def _judged(self, entry: _Entry) -> tuple[PointStatus, str]:
        """Say whether a recording is to be measured, and why not."""
        path = entry.path
        outside = _outside(path, self.folder)
        if outside is not None:
            return PointStatus.BROKEN, (
                f"{outside.name} leads out of the folder and is not followed; copy it here"
            )
        if not _is_recording(path):
            return PointStatus.WITHOUT_FIELDS, ""
        if path.stem in _TAKEN:
            return PointStatus.BROKEN, f"{path.stem}.csv is a table; rename the recording"
        twin = self._earlier_twin(entry)
        if twin is not None:
            return PointStatus.BROKEN, (
                f"{twin} and {path.name} would have results of the same name; rename one"
            )
        return PointStatus.MEASURING, ""

    def _earlier_twin(self, entry: _Entry) -> str | None:
        for name, other in self._entries.items():
            if other is entry:
                return None
            is_twin = other.path.stem == entry.path.stem and _is_shown(other)
            if is_twin and not _outside(other.path, self.folder) and _is_recording(other.path):
                return name
        return None

    def _tell(self, problem: str) -> None:
        if problem != self.problem:
            self.problem = problem
            self._version += 1


def _is_shown(entry: _Entry) -> bool:
    return entry.status is not PointStatus.WITHOUT_FIELDS


def _is_candidate(path: Path) -> bool:
    if path.name.startswith("."):
        return False
    suffix = path.suffix.lower()
    if path.is_dir():
        return _holds_pictures(path)
    return suffix in SUFFIXES and suffix not in _HEADERS


def _holds_pictures(folder: Path) -> bool:
    try:
        with os.scandir(folder) as inside:
            return any(each.name.lower().endswith(_PICTURES) for each in inside)
    except OSError:
        return False


def _is_recording(path: Path) -> bool:
    """Whether a file holds fields; a file that cannot be opened says so when it is measured."""
    if path.suffix.lower() not in HDF5_SUFFIXES:
        return True
    try:
        return has_fields(path) or not has_acquisition(path)
    except RecordingError:
        return True


def _members(path: Path) -> list[Path]:
    """Return the files that a recording may consist of, itself first."""
    if path.is_dir():
        return [path, *sorted(path.iterdir()), path.with_name(f"{path.name}.toml")]
    beside = [path.with_suffix(suffix) for suffix in (*_HEADERS, *ACQUISITION_SUFFIXES)]
    return [path, path.with_name(f"{path.name}.toml"), *(each for each in beside if each != path)]


def _signature(path: Path) -> _Signature:
    """Return names, sizes and times of what a recording consists of; empty if it has gone."""
    members = []
    try:
        for each in _members(path):
            if os.path.lexists(each):
                status = each.lstat()
                members.append((each.name, status.st_size, status.st_mtime_ns))
    except OSError:
        return ()
    return tuple(members)


def _outside(path: Path, folder: Path) -> Path | None:
    """Return the first of a recording's files that leads out of the folder."""
    for each in _members(path):
        # Unlike Path.resolve, realpath does not mind links that lead round in a circle.
        if os.path.lexists(each) and not Path(os.path.realpath(each)).is_relative_to(folder):
            return each
    return None


def _age_of(path: Path) -> tuple[int, str]:
    try:
        return path.lstat().st_mtime_ns, path.name
    except OSError:
        return 0, path.name
