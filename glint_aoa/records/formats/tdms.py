"""LabVIEW's TDMS: waveform channels with their increment, start and unit."""

import contextlib
import logging
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.acquisition import AcquisitionRecord, LazySamples
from glint_aoa.records.formats._channel_map import (
    EAGER_BYTES,
    Recorded,
    mapped_record,
    stated_rate_and_start,
)
from glint_aoa.records.formats._time_axis import TimeAxis, is_time_name, on_grid, time_unit_s
from glint_aoa.setup import Inertial

__all__ = ["read_tdms"]

_SINGLE_CLOCK = 1e-9  # relative; the increments of one clock differ in their last digits


def read_tdms(path: Path, inertial: Inertial | None = None) -> AcquisitionRecord:
    """Read an acquisition record in TDMS.

    Parameters
    ----------
    path : Path
        The file. Rate and start come from the waveform properties ``wf_increment``,
        ``wf_start_offset`` and ``wf_start_time``, else from a channel of times in the same group,
        else from the setup; the unit from ``unit_string`` or ``NI_UnitDescription``.
    inertial : Inertial, optional
        Section of the setup that completes the channels.

    Returns
    -------
    AcquisitionRecord
        All channels of numbers, scaled as the file says, called as in the file; with the group's
        name before it where two groups have a channel of one name. The earliest
        ``wf_start_time`` is the trigger. The samples of a long record stay in the file.

    Raises
    ------
    RecordingError
        If the file is no TDMS, is cut short, has no channels or no rate, or record and setup
        contradict each other.
    """
    size_of(path)
    source = _opened(path)
    channels = [
        channel for group in source.groups() for channel in group.channels() if len(channel)
    ]
    _check_whole(path, source, channels)
    numbers = [channel for channel in channels if channel.dtype.kind in "iuf"]
    n_bytes = sum(len(channel) * channel.dtype.itemsize for channel in numbers)
    try:
        keep = source if n_bytes > EAGER_BYTES else None
        recorded = list(_recorded(path, numbers, inertial, keep))
    except RecordingError:
        raise
    except Exception as error:
        raise _damaged(path, error) from error
    meta = {key: value for key, value in source.properties.items() if isinstance(value, str)}
    return mapped_record(path, recorded, inertial, meta)


def _opened(path: Path) -> Any:
    """Open a file and keep it open for as long as somebody may read its samples."""
    import nptdms  # noqa: PLC0415  slow to import, and only TDMS needs it
    from nptdms.log import log_manager  # noqa: PLC0415

    file = path.open("rb")
    try:
        with _quiet(log_manager.console_handler):  # it warns of cut files
            source = nptdms.TdmsFile.open(file)
    except Exception as error:
        file.close()
        raise _damaged(path, error) from error
    weakref.finalize(source, file.close)  # npTDMS leaves a file open that it did not open itself
    return source


@contextlib.contextmanager
def _quiet(handler: logging.Handler) -> Iterator[None]:
    level = handler.level
    handler.setLevel(logging.ERROR)
    try:
        yield
    finally:
        handler.setLevel(level)


def _damaged(path: Path, error: Exception) -> RecordingError:
    return RecordingError(f"{path}: not a TDMS file or damaged ({error}); record or copy it again")


def _check_whole(path: Path, source: Any, channels: list[Any]) -> None:
    if source.file_status.incomplete_final_segment:
        raise RecordingError(
            f"{path}: the last segment is cut short; copy it again, or save it again in LabVIEW "
            "without it"
        )
    if not channels:
        raise RecordingError(f"{path}: no channels with samples; check that they were recorded")


def _recorded(
    path: Path, channels: list[Any], inertial: Inertial | None, keep: Any | None
) -> Iterator[Recorded]:
    names = [channel.name for channel in channels]
    trigger = min(filter(None, map(_start_time, channels)), default=None)
    axes = {channel.group_name: channel for channel in channels if is_time_name(channel.name)}
    for channel in channels:
        if axes.get(channel.group_name) is channel:
            continue
        name = channel.name
        if names.count(name) > 1:
            name = f"{channel.group_name}/{name}"
        unit = channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription")
        samples = np.asarray(channel[:]) if keep is None else _lazy(keep, channel)
        axis = axes.get(channel.group_name)
        if channel.properties.get("wf_increment") or axis is None:
            rate_hz, start_s = _clock(path, channel, trigger, inertial)
        else:
            rate_hz, start_s, samples = _from_times(path, axis, samples)
        yield Recorded(name, samples, rate_hz, start_s, str(unit) if unit else None)


def _start_time(channel: Any) -> np.datetime64 | None:
    """When a waveform started; None for LabVIEW's zero of time."""
    start = channel.properties.get("wf_start_time")
    is_time = isinstance(start, np.datetime64) and start > np.datetime64("1904-01-02")
    return start if is_time else None


def _clock(
    path: Path, channel: Any, trigger: np.datetime64 | None, inertial: Inertial | None
) -> tuple[float, float]:
    increment = channel.properties.get("wf_increment")
    if not increment:
        return stated_rate_and_start(path, None, None, inertial)
    if not 0 < increment < float("inf"):
        raise RecordingError(
            f"{path}: channel {channel.name}: wf_increment is {increment:g}; "
            "expected seconds above zero, correct it in the record"
        )
    rate_hz = 1 / float(increment)
    if abs(round(rate_hz, 6) - rate_hz) < _SINGLE_CLOCK * rate_hz:
        rate_hz = round(rate_hz, 6)
    start_s = float(channel.properties.get("wf_start_offset", 0.0))
    started = _start_time(channel)
    if started is not None and trigger is not None:
        start_s += (started - trigger) / np.timedelta64(1, "s")
    said = start_s or None  # a zero may be no more than the default
    return stated_rate_and_start(path, rate_hz, said, inertial)


def _lazy(source: Any, channel: Any) -> LazySamples:
    """Return samples that are read as asked for; they hold on to their open file."""
    dtype = channel.dtype.newbyteorder("=")

    def read(start: int, stop: int) -> NDArray[Any]:
        found = source[channel.group_name][channel.name].read_data(start, stop - start)
        return np.asarray(found, dtype)

    return LazySamples(len(channel), dtype, read)


def _from_times(
    path: Path, times: Any, samples: NDArray[Any] | LazySamples
) -> tuple[float, float, NDArray[Any] | LazySamples]:
    where = f"{path}: channel {times.name}"
    unit = time_unit_s(where, times.name, times.properties.get("unit_string"))
    axis = TimeAxis(where)
    places = axis.add(np.asarray(times[:], np.float64) * unit)
    rate_hz, start_s, size = axis.finish()
    if len(places) != len(samples):
        raise RecordingError(
            f"{where}: {len(places)} times for {len(samples)} samples; export the record again"
        )
    if size == len(samples):
        return rate_hz, start_s, samples
    return rate_hz, start_s, on_grid(places, size, np.asarray(samples, np.float64))
