"""Recordings of any format into recorded points, with an acquisition record joined to them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeGuard

from glint_aoa.errors import OutputError, RecordingError
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.formats import HDF5_SUFFIXES, open_acquisition
from glint_aoa.records.formats.hdf5 import has_acquisition, read_truth
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.records.recording import SAID_BY_BOTH
from glint_aoa.setup import Fields, Setup

__all__ = ["Converted", "convert_recording"]


@dataclass(frozen=True)
class Converted:
    """What was made of a recording.

    Attributes
    ----------
    path : Path
        The recorded point.
    stack : FieldStack
        The fields, as opened from the recording.
    channels : tuple of str
        Names of the acquisition channels in the point.
    notes : tuple of str
        What was assumed, found wrong or renamed.
    """

    path: Path
    stack: FieldStack
    channels: tuple[str, ...]
    notes: tuple[str, ...]


def convert_recording(
    stack: FieldStack,
    point: str | Path,
    *,
    channels: str | Path | None = None,
    offset_s: float = 0.0,
    setup: Setup | None = None,
    overwrite: bool = False,
    compress: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Converted:
    """Write a recording as a recorded point, block by block.

    Parameters
    ----------
    stack : FieldStack
        The recording, as from `open_fields`; a recorded point keeps its channels and truth.
    point : str or Path
        The HDF5 file to write.
    channels : str or Path, optional
        Acquisition record to join, in any format that `open_acquisition` reads.
    offset_s : float
        Time of the acquisition's trigger after that of the fields [s].
    setup : Setup, optional
        Completes what the files do not say.
    overwrite, compress, progress
        As for `write_point`.

    Returns
    -------
    Converted
        What was written.

    Raises
    ------
    OutputError
        If the point is the recording itself, is there already, or cannot be written.
    RecordingError
        If recording or acquisition cannot be read.
    """
    point, setup = Path(point), setup or Setup()
    if stack.path is not None and point.exists() and point.samefile(stack.path):
        raise OutputError(f"{point} is the recording itself; give another --out")
    record = _record(stack.path, channels, setup)
    if record is None and offset_s:
        raise RecordingError(
            f"{stack.path}: an offset is given, but no acquisition record to shift; give --channels"
        )
    renamed, notes = _joined(record, offset_s)
    written = RecordedPoint(
        fields=stack,
        info=_completed(stack.info, setup.fields),
        fields_time_s=stack.times_s,
        acquisition=renamed,
        truth=read_truth(stack.path) if _is_point(stack.path) else {},
        meta=_meta(stack, record, [*stack.notes, *notes]),
    )
    write_point(point, written, overwrite=overwrite, compress=compress, progress=progress)
    names = () if renamed is None else tuple(renamed.channels)
    return Converted(point, stack, names, (*stack.notes, *notes))


def _is_point(path: Path | None) -> TypeGuard[Path]:
    return path is not None and path.suffix.lower() in HDF5_SUFFIXES


def _record(
    recording: Path | None, channels: str | Path | None, setup: Setup
) -> AcquisitionRecord | None:
    if channels is not None:
        return open_acquisition(channels, setup.inertial)
    if _is_point(recording) and has_acquisition(recording):
        return open_acquisition(recording, setup.inertial)
    return None


def _joined(
    record: AcquisitionRecord | None, offset_s: float
) -> tuple[AcquisitionRecord | None, list[str]]:
    """Put channels on the fields' trigger, under names that a dataset can have."""
    if record is None:
        return None, []
    joined: dict[str, Channel] = {}
    notes = []
    for name, channel in record.channels.items():
        plain = name.replace("/", "_").strip(".") or "_"
        while plain in joined:
            plain += "_"
        if plain != name:
            notes.append(f"channel {name} was written as {plain}")
        joined[plain] = replace(channel, name=plain, start_s=channel.start_s + offset_s)
    return AcquisitionRecord(record.name, joined, record.meta), notes


def _completed(info: FieldInfo, fields: Fields) -> FieldInfo:
    """Add what only the setup says; where both speak and differ, processing will object."""
    silent: dict[str, Any] = {
        name: getattr(fields, key)
        for key, name in SAID_BY_BOTH.items()
        if getattr(info, name) is None
    }
    return replace(info, **silent)


def _meta(
    stack: FieldStack, record: AcquisitionRecord | None, notes: list[str]
) -> Mapping[str, str | float | int]:
    """Return what describes the point: of the acquisition, of the recording, and its origin."""
    both = {**({} if record is None else record.meta), **stack.meta}
    plain = {key: each for key, each in both.items() if isinstance(each, str | int | float)}
    path = stack.path
    said = {"source": "" if path is None else path.name, "notes": "; ".join(notes)}
    return {**plain, **{key: each for key, each in said.items() if each}}
