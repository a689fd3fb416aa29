"""What every reader asks of a file first, and how every writer makes one appear whole."""

import contextlib
import os
import secrets
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path

from glint_aoa.errors import OutputError, RecordingError

__all__ = ["check_new", "make_folder", "replacing", "size_of"]


def size_of(path: Path) -> int:
    """Return the size of a regular file that is not empty [bytes], or say what else it is."""
    try:
        status = path.stat()
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such file; check its name and folder") from None
    except (OSError, ValueError) as error:
        raise RecordingError(
            f"{path}: cannot be read ({error}); check its name and permissions"
        ) from None
    if stat.S_ISDIR(status.st_mode):
        raise RecordingError(f"{path}: a folder, expected a file; give the recording inside it")
    if not stat.S_ISREG(status.st_mode):
        raise RecordingError(f"{path}: not an ordinary file; copy the recording to a disk first")
    if status.st_size == 0:
        raise RecordingError(f"{path}: an empty file; check that the recording was saved")
    if not os.access(path, os.R_OK):
        raise RecordingError(f"{path}: no permission to read it; change its permissions")
    return status.st_size


def check_new(paths: Iterable[Path]) -> None:
    """Refuse to write results where one of them has been written before.

    Raises
    ------
    OutputError
        If one of `paths` is there.
    """
    there = next((path for path in paths if path.exists()), None)
    if there is not None:
        raise OutputError(
            f"{there} is there already; give another --out, or --overwrite to replace it"
        )


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, where they are not there; OutputError if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: the folder cannot be made ({error.strerror})") from error


@contextlib.contextmanager
def replacing(path: Path, *, overwrite: bool = True) -> Iterator[Path]:
    """Give a temporary name in the same folder that becomes `path` once all is written to it.

    Whoever looks, or is killed, at any moment finds the old file or the new one, never a part.

    Raises
    ------
    OutputError
        If the folder or the disk does not let it, or the file exists and `overwrite` is False;
        nothing is left behind then.
    """
    if path.exists() and not overwrite:
        raise OutputError(f"{path}: exists already; choose another name or allow overwriting")
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.part")
    try:
        yield temporary
        _sync(temporary, os.O_RDWR)
        temporary.replace(path)
        _sync(path.parent, os.O_RDONLY)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); "
            "check that the folder exists, its permissions and the free space"
        ) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _sync(path: Path, mode: int) -> None:
    descriptor = os.open(path, mode)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
