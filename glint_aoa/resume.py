"""Going on where an interrupted run stopped: which points have their results already."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from glint_aoa.errors import InputError, OutputError
from glint_aoa.process import point_identity
from glint_aoa.records.angles import result_files
from glint_aoa.records.formats import open_fields
from glint_aoa.records.tables import read_csv
from glint_aoa.setup import Setup

__all__ = ["finished_points"]

_IDENTITY = ("run", "point", "trigger_time")
_Identity = tuple[str, ...]


def finished_points(
    paths: Sequence[Path],
    setup: Setup,
    out: Path,
    *,
    has_files: Callable[[str], bool] | None = None,
) -> list[Path]:
    """Find the points that an earlier run with the same setup has finished.

    A point is finished if its files are there and its row is in the log, which is written last.

    Parameters
    ----------
    paths : sequence of Path
        Recorded points, in the order in which they are measured.
    setup : Setup
        The setup.
    out : Path
        Folder of the results, or of the log alone.
    has_files : callable, optional
        Whether the files of a point's name are there, if they are not in `out`.

    Returns
    -------
    list of Path
        Those that need not be measured again, in order.

    Raises
    ------
    OutputError
        If the log says that a point was measured with another setup.
    InputError
        If the log cannot be read.
    """
    rows, others = _logged(out / "log.csv", setup)
    finished = []
    for path in paths:
        there = has_files(path.stem) if has_files else _has_files(out, path.stem)
        identity = _identity(path) if there else None
        if identity is None:
            continue
        if rows[identity]:
            rows[identity] -= 1
            finished.append(path)
        elif others[identity]:
            raise OutputError(
                f"{out / 'log.csv'}: {path.stem} was measured with another setup; give another "
                "--out, or --overwrite to measure it again"
            )
    return finished


def _has_files(out: Path, name: str) -> bool:
    return all(each.exists() for each in result_files(out, name))


def _logged(log: Path, setup: Setup) -> tuple[Counter[_Identity], Counter[_Identity]]:
    """Count the log's rows by point: those with this setup, and those with others."""
    same, other = Counter[_Identity](), Counter[_Identity]()
    if not log.exists() or log.stat().st_size == 0:
        return same, other
    columns = read_csv(log)
    if missing := {*_IDENTITY, "setup_hash"} - columns.keys():
        raise OutputError(
            f"{log}: no log of results, {sorted(missing)[0]} is missing; give another --out"
        )
    names = zip(*(columns[name] for name in _IDENTITY), strict=True)
    for identity, its_hash in zip(names, columns["setup_hash"], strict=True):
        if its_hash == setup.hash:
            same[identity] += 1
        elif not setup.hash.startswith(its_hash):  # else torn off within it
            other[identity] += 1
    return same, other


def _identity(path: Path) -> _Identity | None:
    """Return what the log says of a point; None if it cannot be opened, as measuring will tell."""
    try:
        said = point_identity(open_fields(path))
    except InputError:
        return None
    return tuple(" ".join(str(said[name]).splitlines()) for name in _IDENTITY)
