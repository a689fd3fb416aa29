"""Records made ready for what takes regular samples: gaps bridged, all channels on one clock."""

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
import scipy.interpolate
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records.acquisition import (
    AcquisitionRecord,
    Channel,
    LazySamples,
    PackageClock,
    Stretches,
)

__all__ = ["bridge_gaps", "missing_stretches", "on_one_clock", "prepared"]

LONGEST_GAP_S = 0.01
"""Missing samples are bridged over this much time at most [s]: a tenth of a 10 Hz cycle."""

LEAST_RATE_HZ = 150.0
"""Channels below are not brought to a faster clock [Hz]: they cannot show vibration to 60 Hz."""

LEAST_SHARE = 0.9
"""Of the package's record, that every channel brought to its clock must cover."""

_VIBRATION = (
    "aoa_unfiltered", "aoa_filtered", "acceleration", "moment", "force", "excitation",
)  # fmt: skip
_NEIGHBOURS = 4  # samples on either side that a bridge is laid through
_ZEROS = 32  # of the interpolation kernel, on either side
_KAISER_BETA = 9.0
_CUTOFF = 0.91  # of half the slower rate; flat to 0.82 of it, nothing above it
_PHASES = 1e-9  # positions between samples that differ by less share a kernel
_SAME_TIME = 1e-3  # of a sample; closer clocks are one


def prepared(record: AcquisitionRecord) -> AcquisitionRecord:
    """Bridge short gaps and bring all vibration channels to the clock of the package's output.

    Parameters
    ----------
    record : AcquisitionRecord
        As recorded.

    Returns
    -------
    AcquisitionRecord
        Channels that measure something known here, but no temperature, share rate, start and
        length and have no missing samples; the others are as recorded. A clean record is
        returned with its own channels. The samples of long records stay in their file and are
        bridged and resampled stretch by stretch as they are read.

    Raises
    ------
    RecordingError
        As for `bridge_gaps` and `on_one_clock`.
    """
    channels = {
        name: bridge_gaps(channel, record=record.name) if _is_vibration(channel) else channel
        for name, channel in record.channels.items()
    }
    return on_one_clock(dataclasses.replace(record, channels=channels))


def bridge_gaps(channel: Channel, *, record: str = "record") -> Channel:
    """Fill in short stretches of missing samples (NaN or infinite).

    A cubic spline through the four samples on either side is laid over each gap; at the ends of
    the record the nearest sample is held.

    Parameters
    ----------
    channel : Channel
        As recorded.
    record : str
        Name of the record, for messages.

    Returns
    -------
    Channel
        Without missing samples; `gaps` says where they were. The same channel if there are none.

    Raises
    ------
    RecordingError
        If samples are missing for longer than 0.01 s (always one sample), or all are.

    Notes
    -----
    Over 0.01 s at 800 samples a second, and without noise, the spline is off by at most 0.1 % of
    the amplitude of a 9.8 Hz vibration, 1 % at 20 Hz and 11 % at 35 Hz.
    """
    gaps = tuple(missing_stretches(channel))
    if not gaps:
        return channel
    most = max(1, round(LONGEST_GAP_S * channel.rate_hz))
    for first, end in gaps:
        if end - first > most:
            raise RecordingError(
                f"{record}: channel {channel.name} has no samples from "
                f"{channel.start_s + first / channel.rate_hz:.3f} s to "
                f"{channel.start_s + end / channel.rate_hz:.3f} s; gaps are bridged up to "
                f"{most / channel.rate_hz:g} s, cut the record to a stretch without it"
            )
    return dataclasses.replace(
        channel, samples=_bridged_samples(channel, most), gaps=(*channel.gaps, *gaps)
    )


def missing_stretches(channel: Channel) -> Iterator[tuple[int, int]]:
    """Yield the stretches of samples that are missing (NaN or infinite).

    Parameters
    ----------
    channel : Channel
        As recorded; it is read block by block.

    Yields
    ------
    first, end : int
        First sample of a stretch, and one past its last.
    """
    if channel.samples.dtype.kind != "f":
        return
    yield from _stretches(
        (start, ~np.isfinite(np.asarray(block.samples))) for start, block in channel.blocks()
    )


def _stretches(masks: Iterator[tuple[int, NDArray[np.bool_]]]) -> Iterator[tuple[int, int]]:
    """Yield the true stretches of a mask that comes in blocks."""
    opened: int | None = None
    reached = 0
    for start, mask in masks:
        edges = np.flatnonzero(np.diff(mask, prepend=opened is not None))
        for edge in (edges + start).tolist():
            if opened is None:
                opened = edge
            else:
                yield opened, edge
                opened = None
        reached = start + mask.size
    if opened is not None:
        yield opened, reached


def _bridged_samples(channel: Channel, most: int) -> NDArray[Any] | LazySamples:
    samples = channel.samples
    margin = most + _NEIGHBOURS

    def read(start: int, stop: int) -> NDArray[Any]:
        first, end = max(start - margin, 0), min(stop + margin, len(samples))
        block = np.array(samples[first:end])
        _fill(block)
        return block[start - first : stop - first]

    if isinstance(samples, LazySamples):
        return LazySamples(len(samples), samples.dtype, read)
    return read(0, len(samples))


def _fill(block: NDArray[Any]) -> None:
    """Lay a bridge over each stretch of missing samples, in place."""
    is_missing = ~np.isfinite(block)
    if is_missing.all():
        return
    for first, end in _stretches(iter([(0, is_missing)])):
        good = np.flatnonzero(~is_missing[:first])[-_NEIGHBOURS:]
        later = end + np.flatnonzero(~is_missing[end : end + 4 * _NEIGHBOURS])[:_NEIGHBOURS]
        if good.size == 0 or later.size == 0:
            block[first:end] = block[later[0] if good.size == 0 else good[-1]]
            continue
        known = np.concatenate([good, later])
        bridge = scipy.interpolate.make_interp_spline(known, block[known], k=min(3, known.size - 1))
        block[first:end] = bridge(np.arange(first, end))


def on_one_clock(record: AcquisitionRecord) -> AcquisitionRecord:
    """Bring all vibration channels to the clock of the package's output.

    Channels of another rate or start are interpolated with a windowed sinc (Kaiser, 32 zero
    crossings on either side), flat to 0.82 of half the slower of both rates and free of
    what lies above that half. All are cut to the time that they have in common.

    Parameters
    ----------
    record : AcquisitionRecord
        Without missing samples.

    Returns
    -------
    AcquisitionRecord
        Channels that measure something known here, but no temperature, share rate, start and
        length; the others are as recorded.

    Raises
    ------
    RecordingError
        If a channel that is slower than the package's output has fewer than 150 samples a
        second, or a channel lasts for less than nine tenths of the package's record.

    Notes
    -----
    The true sampling rates must be the stated ones: two acquisition systems whose clocks drift
    apart are brought together as far as their rates say so. Within 32 samples of the ends the
    channel is continued point-symmetrically, which is no measurement.
    """
    moving = [channel for channel in record.channels.values() if _is_vibration(channel)]
    if not moving:
        return record
    package = record.package_clock()
    if all(_clock(channel) == package for channel in moving):
        return record
    common = _common_clock(record, package, moving)
    channels = {
        name: _on_clock(channel, common) if _is_vibration(channel) else channel
        for name, channel in record.channels.items()
    }
    return dataclasses.replace(record, channels=channels)


def _is_vibration(channel: Channel) -> bool:
    return channel.quantity in _VIBRATION


def _clock(channel: Channel) -> PackageClock:
    return PackageClock(channel.rate_hz, channel.start_s, len(channel))


def _common_clock(
    record: AcquisitionRecord, package: PackageClock, channels: list[Channel]
) -> PackageClock:
    """Find the samples of the package's output that every channel covers."""
    first, end = 0, package.size
    for channel in channels:
        _check_can_follow(record, channel, package)
        start = (channel.start_s - package.start_s) * package.rate_hz
        stop = start + (len(channel) - 1) / channel.rate_hz * package.rate_hz
        first = max(first, math.ceil(start - _SAME_TIME))
        # A slower channel's last sample stands for its whole interval.
        rest = max(package.rate_hz / channel.rate_hz, 1.0)
        end = min(end, math.ceil(stop + rest - _SAME_TIME))
        if min(end, package.size) - max(first, 0) < LEAST_SHARE * package.size:
            raise RecordingError(
                f"{record.name}: channel {channel.name} lasts from {channel.start_s:.3f} s to "
                f"{channel.start_s + len(channel) / channel.rate_hz:.3f} s, too little of the "
                f"package's {package.start_s:.3f} s to "
                f"{package.start_s + package.size / package.rate_hz:.3f} s; "
                "cut the record to the time that all channels cover"
            )
    start_s = package.start_s + first / package.rate_hz
    return PackageClock(package.rate_hz, start_s, end - first)


def _check_can_follow(record: AcquisitionRecord, channel: Channel, package: PackageClock) -> None:
    if channel.rate_hz < min(package.rate_hz, LEAST_RATE_HZ):
        raise RecordingError(
            f"{record.name}: channel {channel.name} has {channel.rate_hz:g} samples a second "
            f"where the package's output has {package.rate_hz:g}; that is too slow to show "
            f"vibration, record it with {LEAST_RATE_HZ:g} or more or leave out its quantity"
        )


def _on_clock(channel: Channel, clock: PackageClock) -> Channel:
    step = channel.rate_hz / clock.rate_hz  # samples of the channel for one of the clock
    offset = (clock.start_s - channel.start_s) * channel.rate_hz
    if abs(step - 1) * clock.size < _SAME_TIME and abs(offset - round(offset)) < _SAME_TIME:
        cut = _shifted(channel, round(offset), clock.size)
        return dataclasses.replace(cut, rate_hz=clock.rate_hz, start_s=clock.start_s)
    resampled = _Resampled(channel.samples, step, offset)
    samples: NDArray[Any] | LazySamples = LazySamples(
        clock.size, np.dtype(np.float64), resampled.read
    )
    if not isinstance(channel.samples, LazySamples):
        samples = resampled.read(0, clock.size)
    clipped = _stretches((start, block.clipped) for start, block in channel.blocks())
    return dataclasses.replace(
        channel,
        samples=samples,
        rate_hz=clock.rate_hz,
        start_s=clock.start_s,
        gaps=_moved(channel.gaps, step, offset, clock.size),
        clipped_at=_moved(tuple(clipped), step, offset, clock.size),
    )


def _shifted(channel: Channel, first: int, size: int) -> Channel:
    """Return `size` samples from sample `first`, without reading a long channel."""
    if not isinstance(channel.samples, LazySamples):
        return channel.cut(first, first + size)
    whole = channel.samples
    part = LazySamples(size, whole.dtype, lambda a, b: whole[first + a : first + b])
    return dataclasses.replace(
        channel,
        samples=part,
        gaps=_moved(channel.gaps, 1.0, first, size),
        clipped_at=_moved(channel.clipped_at, 1.0, first, size),
    )


def _moved(stretches: Stretches, step: float, offset: float, size: int) -> Stretches:
    """Turn stretches of a channel's samples into those of the clock that they touch."""
    reach = 0.0 if step == 1 and offset == round(offset) else 1.0
    found = (
        (
            max(math.ceil((first - reach - offset) / step), 0),
            min(math.floor((end - 1 + reach - offset) / step) + 1, size),
        )
        for first, end in stretches
    )
    return tuple((first, end) for first, end in found if end > first)


@dataclasses.dataclass(frozen=True, eq=False)
class _Resampled:
    """Samples at positions offset + step * n between the samples of a channel."""

    samples: NDArray[Any] | LazySamples
    step: float
    offset: float

    _block: ClassVar[int] = 1 << 13

    def read(self, start: int, stop: int) -> NDArray[np.float64]:
        """Return values `start` to `stop` (last one excluded)."""
        found = np.empty(stop - start)
        block = math.ceil(self._block / max(self.step, 1.0))
        for first in range(start, stop, block):
            end = min(first + block, stop)
            found[first - start : end - start] = self._values(first, end)
        return found

    def _values(self, start: int, stop: int) -> NDArray[np.float64]:
        position = self.offset + self.step * np.arange(start, stop)
        whole = np.floor(position + _PHASES).astype(np.int64)
        phase = np.round((position - whole) / _PHASES).astype(np.int64)
        kinds, which = np.unique(phase, return_inverse=True)
        reach = math.ceil(_ZEROS * max(self.step, 1.0))
        kernels = self._kernels(kinds * _PHASES, np.arange(1 - reach, reach + 1))
        stretch = self._stretch(int(whole[0]) + 1 - reach, int(whole[-1]) + reach + 1)
        windows = np.lib.stride_tricks.sliding_window_view(stretch, 2 * reach)[whole - whole[0]]
        if kinds.size == 1:
            return np.asarray(windows @ kernels[0])
        return np.asarray(np.einsum("nk,nk->n", windows, kernels[which]))

    def _kernels(self, phases: NDArray[np.float64], taps: NDArray[np.int64]) -> NDArray[np.float64]:
        """Weights [phase, tap]; each row adds up to one, so that a constant stays what it is."""
        away = (taps - phases[:, None]) / max(self.step, 1.0)
        inside = np.clip(1 - (away / _ZEROS) ** 2, 0, None)
        weights = np.sinc(_CUTOFF * away) * np.i0(_KAISER_BETA * np.sqrt(inside)) * (inside > 0)
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))

    def _stretch(self, start: int, stop: int) -> NDArray[np.float64]:
        """Return samples `start` to `stop`, continued point-symmetrically beyond the ends."""
        size = len(self.samples)
        first, end = max(start, 0), min(stop, size)
        inner = np.asarray(self.samples[first:end], np.float64)
        before, after = first - start, stop - end
        if before:
            ahead = np.asarray(self.samples[1 : before + 1], np.float64)[::-1]
            held = np.full(before - ahead.size, ahead[0] if ahead.size else inner[0])
            inner = np.concatenate([2 * inner[0] - np.concatenate([held, ahead]), inner])
        if after:
            behind = np.asarray(self.samples[max(size - 1 - after, 0) : size - 1], np.float64)[::-1]
            held = np.full(after - behind.size, behind[-1] if behind.size else inner[-1])
            inner = np.concatenate([inner, 2 * inner[-1] - np.concatenate([behind, held])])
        return inner
