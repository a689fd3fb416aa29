"""Acquisition channels and the records that hold them."""

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.units import conversion

__all__ = ["AcquisitionRecord", "Channel", "LazySamples", "PackageClock", "Stretches"]

BLOCK = 1 << 20
"""Samples that are read at a time where a whole channel is looked through."""

_COARSEST_STEP = 2**-8
"""Of a converter, over its range; whole numbers further apart are no converter's codes."""


Stretches = tuple[tuple[int, int], ...]
"""Stretches of samples: of each the first, and one past the last."""


@dataclass(frozen=True, eq=False)
class LazySamples:
    """Samples that stay in their file until a stretch of them is asked for.

    Attributes
    ----------
    size : int
        Number of samples.
    dtype : dtype
        Of the stretches.
    read : callable
        Returns samples `start` to `stop` (last one excluded), as [sample].
    """

    size: int
    dtype: np.dtype[Any]
    read: Callable[[int, int], NDArray[Any]]
    ndim: ClassVar[int] = 1

    @property
    def shape(self) -> tuple[int]:
        """The number of samples, as for an array."""
        return (self.size,)

    def __len__(self) -> int:
        """Return the number of samples."""
        return self.size

    def __getitem__(self, key: slice) -> NDArray[Any]:
        """Read a stretch; of slices, the step is not followed but refused."""
        start, stop, step = key.indices(self.size)
        if step != 1:
            raise IndexError(f"a step of {step}; read every sample and thin them out afterwards")
        return self.read(start, max(start, stop))

    def __array__(
        self, dtype: np.dtype[Any] | None = None, copy: bool | None = None
    ) -> NDArray[Any]:
        """Read all samples."""
        if copy is False:
            raise ValueError("samples in a file cannot be had without a copy")
        samples = self.read(0, self.size)
        return samples if dtype is None else samples.astype(dtype)


@dataclass(frozen=True, eq=False)
class Channel:
    """One acquisition channel, sampled at regular intervals.

    Attributes
    ----------
    name : str
        As in the record.
    samples : ndarray [sample] or LazySamples
        As recorded; times `scale` in `units`. NaN where a sample is missing. Of a long record
        they stay in the file: work on `cut` stretches then.
    rate_hz : float
        Samples a second [Hz].
    start_s : float
        Time of sample 0 after the trigger [s].
    quantity : str or None
        What is measured, one of `glint_aoa.setup.Quantity`.
    units : str or None
        Unit of the recorded value times `scale`, as pint names it.
    scale : float
        Recorded value times scale gives `units`.
    station_m : float or None
        Model x of the sensor [m].
    axis : str or None
        Model axis that it senses, one of +x, -x, +y, -y, +z, -z.
    limits : (float, float) or None
        Least and greatest value that is not clipped [`units`].
    gaps : tuple of (int, int)
        Stretches of samples that were missing and have been bridged: first, and one past the last.
    clipped_at : tuple of (int, int)
        Stretches that are known to be clipped although `samples` no longer show it.

    Raises
    ------
    RecordingError
        If there are no samples, they are no numbers, or the rate is not greater than zero.
    """

    name: str
    samples: NDArray[Any] | LazySamples
    rate_hz: float
    start_s: float = 0.0
    quantity: str | None = None
    units: str | None = None
    scale: float = 1.0
    station_m: float | None = None
    axis: str | None = None
    limits: tuple[float, float] | None = None
    gaps: Stretches = ()
    clipped_at: Stretches = ()

    def __post_init__(self) -> None:
        """Refuse what is no sampled signal."""
        samples = self.samples
        if samples.ndim != 1 or samples.dtype.kind not in "iuf":
            raise RecordingError(
                f"channel {self.name}: samples are {samples.dtype} of shape "
                f"{list(samples.shape)}, expected numbers in one dimension"
            )
        if samples.size == 0:
            raise RecordingError(f"channel {self.name}: no samples; check that it was recorded")
        if not 0 < self.rate_hz < float("inf"):
            raise RecordingError(
                f"channel {self.name}: rate_hz is {self.rate_hz}; "
                "expected a number greater than zero [Hz]"
            )

    def __len__(self) -> int:
        """Return the number of samples."""
        return int(self.samples.size)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Times of the samples after the trigger [s], as [sample]."""
        return self.start_s + np.arange(len(self)) / self.rate_hz

    def values(self, units: str) -> NDArray[np.float64]:
        """Return the samples in a unit of choice.

        Parameters
        ----------
        units : str
            As pint names it, such as ``"m/s^2"``.

        Returns
        -------
        ndarray [sample]
            Samples times scale [`units`]; temperatures with the zero of their scale.

        Raises
        ------
        RecordingError
            If the channel has no units, or they measure something else.
        """
        factor, offset = self._conversion(units)
        values = np.asarray(self.samples, np.float64) * (self.scale * factor)
        return values + offset if offset else values

    @property
    def clipped(self) -> NDArray[np.bool_]:
        """Whether each sample lies at or beyond the channel's limits, as [sample].

        The highest code of a converter lies one step below the end of its range, so samples
        within one step count: of 16 bits over the range, or of the recorded whole numbers.
        """
        known = _mask(self.clipped_at, len(self))
        if self.limits is None:
            return known
        low, high = self.limits
        step = (high - low) / 2**16
        if self.samples.dtype.kind in "iu" and abs(self.scale) < _COARSEST_STEP * (high - low):
            step = max(step, abs(self.scale))
        step *= 1 + 1e-3  # a step computed elsewhere differs in its last digits
        values = np.asarray(self.samples, np.float64) * self.scale
        return known | (values <= low + step) | (values >= high - step)

    @property
    def bridged(self) -> NDArray[np.bool_]:
        """Whether each sample was missing and has been bridged, as [sample]."""
        return _mask(self.gaps, len(self))

    def cut(self, start: int, stop: int) -> "Channel":
        """Return samples `start` to `stop` (last one excluded) as a channel of their own.

        The samples are in memory then; start, gaps and clipped stretches go with them.
        """
        start, stop, _ = slice(start, stop).indices(len(self))
        return dataclasses.replace(
            self,
            samples=np.asarray(self.samples[start:stop]),
            start_s=self.start_s + start / self.rate_hz,
            gaps=_within(self.gaps, start, stop),
            clipped_at=_within(self.clipped_at, start, stop),
        )

    def blocks(self) -> Iterator[tuple[int, "Channel"]]:
        """Yield the channel piece by piece, each with the number of its first sample."""
        for start in range(0, len(self), BLOCK):
            yield start, self.cut(start, min(start + BLOCK, len(self)))

    def _conversion(self, units: str) -> tuple[float, float]:
        if self.units is None:
            raise RecordingError(
                f"channel {self.name}: the record gives no units; "
                "give them under [[inertial.channel]] in the setup"
            )
        try:
            return conversion(self.units, units)
        except ValueError as error:
            raise RecordingError(
                f"channel {self.name}: {error}; correct units in the record or the setup"
            ) from None


def _mask(stretches: Stretches, size: int) -> NDArray[np.bool_]:
    mask = np.zeros(size, bool)
    for first, end in stretches:
        mask[first:end] = True
    return mask


def _within(stretches: Stretches, start: int, stop: int) -> Stretches:
    """Those parts of `stretches` that lie between `start` and `stop`, counted from `start`."""
    return tuple(
        (max(first, start) - start, min(end, stop) - start)
        for first, end in stretches
        if first < stop and end > start
    )


@dataclass(frozen=True)
class PackageClock:
    """When the output of the inertial package was sampled.

    Attributes
    ----------
    rate_hz : float
        Samples a second [Hz].
    start_s : float
        Time of sample 0 after the trigger [s].
    size : int
        Number of samples.
    """

    rate_hz: float
    start_s: float
    size: int


@dataclass(frozen=True, eq=False)
class AcquisitionRecord:
    """Channels of one acquisition, in the order in which they were recorded.

    Attributes
    ----------
    name : str
        Name of the point.
    channels : mapping of str to Channel
        Channels by name, in record order.
    meta : mapping
        What else the file says of its point: run, point, excitation and the like.
    """

    name: str
    channels: Mapping[str, Channel]
    meta: Mapping[str, object] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Channel:
        """Return the channel called `name`.

        Raises
        ------
        RecordingError
            If there is none; the message names those there are.
        """
        try:
            return self.channels[name]
        except KeyError:
            raise RecordingError(
                f"{self.name}: no channel {name}; channels here: {', '.join(self.channels)}"
            ) from None

    def with_quantity(self, quantity: str, axis: str | None = None) -> list[Channel]:
        """Return the channels that measure `quantity`, and along `axis` if given; record order."""
        return [
            channel
            for channel in self.channels.values()
            if channel.quantity == quantity and axis in (None, channel.axis)
        ]

    def package_clock(self) -> PackageClock:
        """Return the clock of the package's output: of the unfiltered one where there is one.

        A record without either gives the clock of its first channel that shows vibration.

        Raises
        ------
        RecordingError
            If the record holds no channels.
        """
        outputs = [*self.with_quantity("aoa_unfiltered"), *self.with_quantity("aoa_filtered")]
        channels = self.channels.values()
        others = [each for each in channels if each.quantity not in (None, "temperature")]
        first = next(iter([*outputs, *others, *channels]), None)
        if first is None:
            raise RecordingError(f"{self.name}: no channels; check that they were recorded")
        return PackageClock(first.rate_hz, first.start_s, len(first))

    def segment(self, start: int, stop: int) -> "AcquisitionRecord":
        """Return a stretch of the record, in memory.

        Parameters
        ----------
        start, stop : int
            First sample of the package's output, and one past the last.

        Returns
        -------
        AcquisitionRecord
            Channels on the package's clock, cut alike, and what the others hold of the same time;
            a channel that holds nothing of it is left out.
        """
        clock = self.package_clock()
        start, stop, _ = slice(start, stop).indices(clock.size)
        channels = {}
        for name, channel in self.channels.items():
            if PackageClock(channel.rate_hz, channel.start_s, len(channel)) == clock:
                first, end = start, stop
            else:
                first, end = (_sample_at(channel, clock, sample) for sample in (start, stop))
            if end > first:
                channels[name] = channel.cut(first, end)
        return AcquisitionRecord(self.name, channels, self.meta)


def _sample_at(channel: Channel, clock: PackageClock, sample: int) -> int:
    """Return the number of the first sample of `channel` not before a sample of the clock."""
    time_s = clock.start_s + sample / clock.rate_hz
    number = math.ceil((time_s - channel.start_s) * channel.rate_hz - 1e-6)
    return min(max(number, 0), len(channel))
