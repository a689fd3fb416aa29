"""Ways to trigger a point: a key, a file, a signal. HTTP has a file of its own."""

import contextlib
import os
import select
import signal
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

from glint_aoa.errors import GlintError
from glint_aoa.live.session import Session

__all__ = ["FileTrigger", "KeyTrigger", "Trigger", "stop_signals", "try_trigger"]

_POLL_S = 0.02
_MOST_NAME = 200  # bytes of a trigger file that are looked at


def try_trigger(session: Session, tell: Callable[[str], None], name: str | None = None) -> None:
    """Trigger a point; what stands against it is told, and nothing else happens."""
    try:
        session.trigger(name)
    except GlintError as error:
        tell(str(error))


class Trigger(ABC):
    """Something that is watched by a thread of its own while a session runs; a context."""

    def __init__(self) -> None:
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> "Trigger":
        """Begin to watch."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self._over.set()
        self._thread.join()

    @abstractmethod
    def _watch(self) -> None:
        """Watch until `_over` is set."""


class FileTrigger(Trigger):
    """Triggers when a file appears, and takes the file away.

    Its first line names the point; a file that stays empty leaves the name to the session.
    """

    def __init__(self, session: Session, path: Path, tell: Callable[[str], None]) -> None:
        super().__init__()
        self._session, self._path, self._tell = session, path, tell

    def _watch(self) -> None:
        was_empty = False
        while not self._over.wait(_POLL_S):
            try:
                with open(self._path, "rb", opener=_never_waiting) as file:
                    head = file.read(_MOST_NAME)
                if not head and not was_empty:
                    was_empty = True  # its name may be on the way
                    continue
                was_empty = False
                self._path.unlink()
            except FileNotFoundError:
                continue
            except OSError as error:
                self._tell(f"{self._path}: cannot be read and taken away ({error.strerror})")
                return
            name = head.decode("utf-8", "replace").strip().split("\n")[0].strip()
            try_trigger(self._session, self._tell, name or None)


def _never_waiting(path: str, flags: int) -> int:
    """Open a file; a named pipe without a writer would hold the session's end up."""
    return os.open(path, flags | os.O_NONBLOCK)


class KeyTrigger(Trigger):
    """Triggers at the space bar or return; ``s`` marks the shaker as off, ``q`` ends the session.

    Without a terminal on stdin it does nothing.
    """

    def __init__(self, session: Session, tell: Callable[[str], None]) -> None:
        super().__init__()
        self._session, self._tell = session, tell

    def _watch(self) -> None:
        if not sys.stdin.isatty():
            return
        descriptor = sys.stdin.fileno()
        with _single_keys(descriptor):
            while not self._over.is_set():
                if select.select([descriptor], [], [], 0.1)[0]:
                    for key in os.read(descriptor, 16).decode("latin-1"):
                        self._pressed(key)

    def _pressed(self, key: str) -> None:
        if key in " \r\n":
            try_trigger(self._session, self._tell)
        elif key in "sS":
            self._mark_shaker_off()
        elif key in "qQ":
            self._session.stop()

    def _mark_shaker_off(self) -> None:
        try:
            self._session.mark_shaker_off()
        except GlintError as error:
            self._tell(str(error))
        else:
            self._tell("shaker off")


@contextlib.contextmanager
def _single_keys(descriptor: int) -> Iterator[None]:
    import termios  # noqa: PLC0415  not on every system
    import tty  # noqa: PLC0415

    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)
        yield
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


@contextlib.contextmanager
def stop_signals(session: Session, tell: Callable[[str], None]) -> Iterator[None]:
    """End a session on SIGINT and SIGTERM, trigger it on SIGUSR1, while the context lasts.

    A handler may interrupt whoever holds the locks that a trigger needs, so it only wakes a
    thread that triggers.
    """
    wanted, over = threading.Semaphore(0), threading.Event()

    def wait() -> None:
        while wanted.acquire() and not over.is_set():
            try_trigger(session, tell)

    def end(*_: int | FrameType | None) -> None:
        session.stop()

    def trigger(*_: int | FrameType | None) -> None:
        wanted.release()

    waiting = threading.Thread(target=wait, name="signal trigger", daemon=True)
    waiting.start()
    handlers = {signal.SIGINT: end, signal.SIGTERM: end, signal.SIGUSR1: trigger}
    before = {each: signal.signal(each, handler) for each, handler in handlers.items()}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
        over.set()
        wanted.release()
        waiting.join()
