"""Which points a folder holds."""

import os
from pathlib import Path

from glint_aoa.errors import RecordingError
from glint_aoa.records.formats import SUFFIXES

__all__ = ["points_in"]

_PICTURES = (".png", ".tif", ".tiff")
_HEADERS = (".cih", ".cihx")
_VIDEO_OF_HEADER = ".mraw"


def points_in(folder: str | Path) -> list[Path]:
    """Find the recordings in a folder and in the folders inside it.

    A folder inside it that holds nothing but pictures is one recording. Hidden files and folders
    are left out, and so are results, setups and headers of recordings that are found themselves.

    Parameters
    ----------
    folder : str or Path
        The folder.

    Returns
    -------
    list of Path
        In the order of their names, as a shell lists them.

    Raises
    ------
    RecordingError
        If it is no folder, cannot be read, or holds no recording.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise RecordingError(f"{folder}: no such folder; give the folder that holds the points")
    found: list[Path] = []
    for here, inner, names in os.walk(folder, onerror=_refuse):
        seen = [name for name in names if not name.startswith(".")]
        inner[:] = [name for name in inner if not name.startswith(".")]
        if here != str(folder) and seen and all(_suffix(name) in _PICTURES for name in seen):
            found.append(Path(here))
            inner.clear()
        else:
            found += (Path(here, name) for name in _recordings(seen))
    if not found:
        raise RecordingError(
            f"{folder}: no recording in it, expected files of {', '.join(SUFFIXES)}; "
            "give the folder that holds the points"
        )
    return sorted(found)


def _recordings(names: list[str]) -> list[str]:
    films = {Path(name).stem for name in names if _suffix(name) == _VIDEO_OF_HEADER}
    return [
        name
        for name in names
        if _suffix(name) in SUFFIXES
        and not (_suffix(name) in _HEADERS and Path(name).stem in films)
    ]


def _suffix(name: str) -> str:
    return Path(name).suffix.lower()


def _refuse(error: OSError) -> None:
    raise RecordingError(
        f"{error.filename}: cannot be read ({error.strerror}); change its permissions"
    ) from error
