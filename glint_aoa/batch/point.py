"""One point of a batch, wherever it is measured: whole, or in parts that are joined."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from glint_aoa.batch.store import Store
from glint_aoa.errors import RecordingError
from glint_aoa.optical.measure import (
    FieldAngles,
    Measurement,
    joined_angles,
    measure_stack,
    prepare,
    summed_part,
)
from glint_aoa.optical.summary import FieldSummary
from glint_aoa.process import Measure, process_point
from glint_aoa.records.fields import BLOCK_BYTES, FieldStack
from glint_aoa.records.formats import HDF5_SUFFIXES, open_fields
from glint_aoa.records.formats.hdf5 import has_fields
from glint_aoa.records.recording import Recording, resolve_recording
from glint_aoa.setup import Setup

__all__ = ["PART_BYTES", "LogRow", "Split", "measure_into", "measure_or_split"]

PART_BYTES = 256_000_000
"""What the fields of a part of a stack take, at most [bytes]."""

LogRow = dict[str, Any]


@dataclass(frozen=True)
class Split:
    """Work in parts that may be done anywhere.

    Attributes
    ----------
    first : callable
        ``first()`` comes before all parts.
    parts : sequence of callable
        ``part(what first returned)``, in any order.
    last : callable
        ``last(what first returned, what the parts returned, in order)``.
    """

    first: Callable[[], Any]
    parts: Sequence[Callable[[Any], Any]]
    last: Callable[[Any, list[Any]], Any]


def measure_into(
    path: Path,
    *,
    setup: Setup,
    store: Store,
    threads: int = 1,
    block_bytes: int = BLOCK_BYTES,
) -> LogRow | None:
    """Measure a point and write its files.

    Parameters
    ----------
    path : Path
        The recording.
    setup : Setup
        The setup.
    store : Store
        Where the files go; those that are there are replaced.
    threads, block_bytes
        As for `glint_aoa.optical.measure.measure_prepared`.

    Returns
    -------
    dict or None
        The point's row of the log; None if it is a record without fields.

    Raises
    ------
    InputError
        As `glint_aoa.process.process_point`.
    """
    how = partial(measure_stack, threads=threads, block_bytes=block_bytes)
    return None if _is_record_only(path) else _written(path, setup, store, how)


def measure_or_split(
    path: Path, *, setup: Setup, store: Store, part_bytes: int = PART_BYTES
) -> LogRow | Split | None:
    """Measure a point and write its files, or say in what parts that is to be done.

    Parameters
    ----------
    path, setup, store
        As for `measure_into`.
    part_bytes : int
        Fields that take more than this are measured in parts.

    Returns
    -------
    dict, Split or None
        As for `measure_into`, or the parts, whose last returns it.
    """
    _one_thread()
    if _is_record_only(path):
        return None
    stack = open_fields(path, setup.fields)
    if stack.n_bytes <= part_bytes:
        return measure_into(path, setup=setup, store=store)
    size = stack.fields_in(part_bytes)
    starts = range(0, stack.n_fields, size)
    return Split(
        first=partial(_learn, path, setup),
        parts=[
            partial(_measure_part, path, setup, start, min(start + size, stack.n_fields))
            for start in starts
        ],
        last=partial(_join, path, setup, store),
    )


def _is_record_only(path: Path) -> bool:
    """Whether a point is an acquisition record alone; files that are damaged have their say."""
    if path.suffix.lower() not in HDF5_SUFFIXES:
        return False
    try:
        return not has_fields(path)
    except RecordingError:
        return False


def _written(path: Path, setup: Setup, store: Store, how: Measure) -> LogRow:
    def work(folder: Path) -> Any:
        return process_point(path, setup, folder, overwrite=True, to_log=False, measure=how)

    return store.write(work).log


def _learn(path: Path, setup: Setup) -> Measurement:
    _one_thread()
    stack = open_fields(path, setup.fields)
    return prepare(stack, setup, resolve_recording(stack, setup))


def _measure_part(
    path: Path, setup: Setup, start: int, stop: int, measurement: Measurement
) -> FieldSummary:
    _one_thread()
    stack = open_fields(path, setup.fields)
    return summed_part(stack, measurement, start, stop, block_bytes=BLOCK_BYTES)


def _join(
    path: Path, setup: Setup, store: Store, measurement: Measurement, parts: list[FieldSummary]
) -> LogRow:
    def joined(
        stack: FieldStack, _setup: Setup, _recording: Recording, **_: object
    ) -> tuple[FieldAngles, Measurement]:
        return joined_angles(stack, measurement, parts), measurement

    _one_thread()
    return _written(path, setup, store, joined)


@lru_cache(maxsize=1)
def _one_thread() -> threadpool_limits:
    """Let the linear algebra of this process run in one thread from now on.

    In a process that measures several points in threads a limit for each point would be lifted by
    the first that ends.
    """
    return threadpool_limits(limits=1, user_api="blas")
