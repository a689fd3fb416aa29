"""Readings as lines of JSON into a pipe or file."""

import os

from glint_aoa.live.outputs.queued import Sender
from glint_aoa.live.readings import Reading

__all__ = ["LineSender"]


class LineSender(Sender):
    """Writes each reading as one line of JSON (NDJSON).

    Parameters
    ----------
    descriptor : int
        Of the pipe or file; written to without a buffer, so that a line is out once it is told.
    name : str, optional
        What it is called.
    """

    def __init__(self, descriptor: int, *, name: str = "stdout") -> None:
        self.name, self._descriptor = name, descriptor

    def send(self, reading: Reading) -> None:
        """Write a line; waits for a slow reader, OSError without one."""
        line = reading.line()
        while line:
            line = line[os.write(self._descriptor, line) :]
