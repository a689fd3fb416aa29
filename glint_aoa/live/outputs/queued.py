"""A way out that never holds up the measurement: what cannot be sent in time is left out."""

import queue
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable

from glint_aoa.live.readings import Reading

__all__ = ["Output", "Sender"]

_WAITING = 1024  # readings that may wait
_LAST_WORD_S = 1.0  # to send what waits at the end


class Sender(ABC):
    """Sends readings somewhere, however long that takes."""

    name: str

    @abstractmethod
    def send(self, reading: Reading) -> None:
        """Send one.

        Raises
        ------
        OSError
            If nobody is there any more; nothing more is sent then.
        """

    def close(self) -> None:
        """Let go of what it holds."""
        return


class Output:
    """A sender with a thread of its own, fed through a bounded queue.

    Parameters
    ----------
    sender : Sender
        Does the sending.
    tell : callable
        Called with a sentence when the sender gives up.
    waiting : int, optional
        Readings that may wait; those that come beyond are dropped and counted.
    gone : callable, optional
        Called once the sender has given up.
    """

    def __init__(
        self,
        sender: Sender,
        *,
        tell: Callable[[str], None],
        waiting: int = _WAITING,
        gone: Callable[[], None] | None = None,
    ) -> None:
        self.dropped = 0
        self._sender, self._tell, self._gone = sender, tell, gone
        self._queue: queue.Queue[Reading | None] = queue.Queue(waiting)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=sender.name, daemon=True)

    @property
    def name(self) -> str:
        """Where the readings go."""
        return self._sender.name

    def offer(self, reading: Reading) -> None:
        """Take a reading if there is room; never waits. One thread may call it."""
        if self._ended.is_set():
            return
        if self._thread.ident is None:
            self._thread.start()  # with the priority of whoever measures
        try:
            self._queue.put_nowait(reading)
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Send what waits, as far as that goes within a second, and end."""
        if self._thread.ident is None:
            self._ended.set()
            self._sender.close()
            return
        try:
            self._queue.put(None, timeout=_LAST_WORD_S)
        except queue.Full:
            self.dropped += self._queue.qsize()
        self._thread.join(_LAST_WORD_S)
        self._ended.set()

    def _run(self) -> None:
        while (reading := self._queue.get()) is not None:
            try:
                self._sender.send(reading)
            except OSError as error:
                self._ended.set()
                self._tell(f"{self.name}: no more readings can be sent ({error.strerror or error})")
                if self._gone is not None:
                    self._gone()
                break
        self._sender.close()
