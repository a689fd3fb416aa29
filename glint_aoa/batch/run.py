"""A batch: points shared among processes or machines, their log kept in order."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from glint_aoa.batch.point import LogRow
from glint_aoa.batch.store import Store
from glint_aoa.errors import GlintError, OutputError, WorkerDiedError
from glint_aoa.process import load_sweep
from glint_aoa.records.angles import result_files
from glint_aoa.resume import finished_points
from glint_aoa.setup import Setup
from glint_aoa.workers import Outcome, Pool

__all__ = ["BatchResult", "process_batch"]


@dataclass
class BatchResult:
    """What came of a batch.

    Attributes
    ----------
    flags : list of int
        All flags of each point that was measured, in order.
    failures : list of (Path, str)
        Points that could not be measured, and why in a sentence; in order.
    without_fields : list of Path
        Acquisition records alone, which were left out.
    finished : list of Path
        Points that an earlier run had finished.
    """

    flags: list[int] = field(default_factory=list)
    failures: list[tuple[Path, str]] = field(default_factory=list)
    without_fields: list[Path] = field(default_factory=list)
    finished: list[Path] = field(default_factory=list)


def process_batch(
    paths: Sequence[Path],
    setup: Setup,
    store: Store,
    pool: Pool,
    measure: Callable[[Path], Any],
    *,
    overwrite: bool = False,
    resume: bool = False,
    told: Callable[[str, Mapping[str, Any]], None] | None = None,
    progress: Callable[[Path], None] | None = None,
) -> BatchResult:
    """Measure points and write their results, as `glint_aoa.process.process_point` would.

    Files and log are the same to the bit as if the points had been measured one after the other,
    whatever shares the work. A point that fails does not keep the others from being measured.

    Parameters
    ----------
    paths : sequence of Path
        Recorded points; no two may have the same stem.
    setup : Setup
        The setup; the sweep that it names is applied.
    store : Store
        Where the results go, as from `open_store`.
    pool : Pool
        What shares the points: `glint_aoa.workers.Workers` or `glint_aoa.batch.cluster.Cluster`.
    measure : callable
        Measures one point in whichever process, and returns its row of the log: a partial of
        `measure_into`, or on a cluster `measure_or_split`, of `glint_aoa.batch.point`.
    overwrite : bool, optional
        Whether results of the same names may be replaced.
    resume : bool, optional
        Whether points that an earlier run has finished are left as they are.
    told : callable, optional
        Called with name and row of each point that was measured, in order.
    progress : callable, optional
        Called with each path once something came of it, in whatever order.

    Returns
    -------
    BatchResult
        What came of the points.

    Raises
    ------
    InputError
        If setup, store or an old log cannot be used; what a point raises is listed instead.
    """
    load_sweep(setup)
    store.check()
    result = BatchResult()
    progress = progress or (lambda _: None)
    with store.log() as (folder, append):
        there = store.names()
        todo: Sequence[Path] = paths
        if resume:
            result.finished = _finished(paths, setup, store, folder, there)
            todo = _without(paths, result.finished, progress)
        elif not overwrite:
            todo = _new(paths, there, store, result, progress)
        for outcome in _in_order(pool.outcomes(measure, todo), progress):
            row = _row(outcome, result)
            if row is not None:
                append(row)
                result.flags.append(int(row["flags"]))
                if told is not None:
                    told(outcome.item.stem, row)
    order = {path: number for number, path in enumerate(paths)}
    result.failures.sort(key=lambda failure: order[failure[0]])
    return result


def _finished(
    paths: Sequence[Path], setup: Setup, store: Store, folder: Path, there: set[str]
) -> list[Path]:
    try:
        return finished_points(
            paths, setup, folder, has_files=lambda name: there.issuperset(_files(name))
        )
    except OutputError as error:  # which names the log here, be it a copy
        log = store.path_of("log.csv")
        raise OutputError(str(error).replace(str(folder / "log.csv"), log)) from error


def _files(name: str) -> list[str]:
    return [file.name for file in result_files(Path(), name)]


def _without(
    paths: Sequence[Path], finished: Sequence[Path], progress: Callable[[Path], None]
) -> list[Path]:
    done = set(finished)
    for path in finished:
        progress(path)
    return [path for path in paths if path not in done]


def _new(
    paths: Sequence[Path],
    there: set[str],
    store: Store,
    result: BatchResult,
    progress: Callable[[Path], None],
) -> list[Path]:
    """Return the points without results; the others have failed."""
    new = []
    for path in paths:
        old = next((name for name in _files(path.stem) if name in there), None)
        if old is None:
            new.append(path)
            continue
        sentence = "is there already; give another --out, or --overwrite to replace it"
        result.failures.append((path, f"{store.path_of(old)} {sentence}"))
        progress(path)
    return new


def _in_order(
    outcomes: Iterable[Outcome[Path, Any]], progress: Callable[[Path], None]
) -> Iterator[Outcome[Path, Any]]:
    early: dict[int, Outcome[Path, Any]] = {}
    due = 0
    for outcome in outcomes:
        progress(outcome.item)
        early[outcome.number] = outcome
        while due in early:
            yield early.pop(due)
            due += 1


def _row(outcome: Outcome[Path, LogRow | None], result: BatchResult) -> LogRow | None:
    """Return the row of a point that was measured; note what became of the others."""
    path, error = outcome.item, outcome.error
    if error is not None:
        result.failures.append((path, _sentence(path, error)))
    elif outcome.result is None:
        result.without_fields.append(path)
    return outcome.result


def _sentence(path: Path, error: Exception) -> str:
    if isinstance(error, WorkerDiedError):
        return f"{path}: {error}"
    if isinstance(error, GlintError):
        return str(error)
    return (
        f"{path}: an error of the program itself ({type(error).__name__}: {error}); "
        "measure it alone with glint-aoa --debug process and report what that prints"
    )
