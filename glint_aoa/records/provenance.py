"""Which files a result was made from: their SHA-256, so that another can be told from them."""

import hashlib
from pathlib import Path

from glint_aoa.errors import RecordingError
from glint_aoa.setup import Setup

__all__ = ["file_hash", "input_hashes"]


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file, or of a folder's files one after the other, by name.

    Parameters
    ----------
    path : Path
        A file, or a folder of pictures; folders within it are not looked at.

    Returns
    -------
    str
        64 hexadecimal digits.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """
    try:
        if not path.is_dir():
            return _digest(path)
        files = sorted(each for each in path.iterdir() if each.is_file())
        lines = "".join(f"{_digest(each)}  {each.name}\n" for each in files)
    except OSError as error:
        raise RecordingError(
            f"{path}: cannot be read ({error.strerror or error}); check its name and permissions"
        ) from None
    return hashlib.sha256(lines.encode()).hexdigest()


def input_hashes(recording: Path | None, setup: Setup) -> dict[str, str]:
    """Return attributes that tell the files behind a point's results.

    Parameters
    ----------
    recording : Path or None
        The point's recording; of one that is several files, the one that was opened.
    setup : Setup
        The setup, which names the calibrations.

    Returns
    -------
    dict of str to str
        ``setup_folder``, ``recording_sha256``, and of the calibrations that are used
        ``calibration_sha256``, and path and hash as ``camera_calibration`` and ``pose_calibration``
        with ``_sha256``.

    Raises
    ------
    RecordingError
        If one of them cannot be read.
    """
    poses = {"camera_calibration": setup.camera_path, "pose_calibration": setup.pose_path}
    files = {"recording": recording, "calibration": setup.sweep_path, **poses}
    hashes = {f"{name}_sha256": file_hash(path) for name, path in files.items() if path is not None}
    named = {name: str(path) for name, path in poses.items() if path is not None}
    return {"setup_folder": str(setup.folder.resolve()), **named, **hashes}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
