"""The buttons without a live session: a trigger for the recorder, and marks in time, as files."""

import datetime
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from glint_aoa.errors import OutputError
from glint_aoa.records._files import replacing
from glint_aoa.records.tables import append_log

__all__ = ["MARK_COLUMNS", "Controls", "FolderControls"]

MARK_COLUMNS = ("time", "unix_time_s", "mark")
"""Columns of ``marks.csv``: ISO 8601 in UTC, seconds since 1970, and what happened."""


class Controls(Protocol):
    """What the page's buttons do."""

    def trigger(self) -> str:
        """Start a point; returns what was done, in words."""

    def shaker_off(self) -> str:
        """Mark that the shaker is off; returns what was done, in words."""


class FolderControls:
    """Writes ``trigger`` and ``marks.csv`` to the folder of the points.

    Parameters
    ----------
    folder : Path
        The folder.
    now : callable, optional
        Seconds since 1970.
    """

    def __init__(self, folder: Path, *, now: Callable[[], float] = time.time) -> None:
        self._folder, self._now = folder, now

    def trigger(self) -> str:
        """Write an empty ``trigger``, which ``glint-aoa live --trigger-file`` waits for.

        Raises
        ------
        OutputError
            If the last trigger has not been taken, or the file cannot be written.
        """
        file = self._folder / "trigger"
        if file.is_symlink() or file.exists():
            raise OutputError(
                f"{file} is there already: nothing has taken the last trigger; "
                f"is glint-aoa live running with --trigger-file {file}?"
            )
        moment, _ = self._moment()
        with replacing(file, overwrite=False) as temporary:
            temporary.touch()
        return f"Trigger written at {moment[11:19]} UTC"

    def shaker_off(self) -> str:
        """Append the time to ``marks.csv``.

        Raises
        ------
        OutputError
            If it leads elsewhere, has other columns or cannot be written.
        """
        file = self._folder / "marks.csv"
        if file.is_symlink():
            raise OutputError(f"{file} is a link and is not followed; move it away")
        moment, seconds = self._moment()
        row = {"time": moment, "unix_time_s": f"{seconds:.3f}", "mark": "shaker off"}
        append_log(file, row, MARK_COLUMNS)
        return f"Shaker off marked at {moment[11:19]} UTC"

    def _moment(self) -> tuple[str, float]:
        seconds = self._now()
        moment = datetime.datetime.fromtimestamp(seconds, datetime.UTC)
        return moment.isoformat(timespec="milliseconds"), seconds
