"""Acquisition channels and the records that hold them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.units import convert

__all__ = ["AcquisitionRecord", "Channel"]

_COARSEST_STEP = 2**-8
"""Of a converter, over its range; whole numbers further apart are no converter's codes."""


@dataclass(frozen=True, eq=False)
class Channel:
    """One acquisition channel, sampled at regular intervals.

    Attributes
    ----------
    name : str
        As in the record.
    samples : ndarray [sample]
        As recorded; times `scale` in `units`.
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

    Raises
    ------
    RecordingError
        If there are no samples, they are no numbers, or the rate is not greater than zero.
    """

    name: str
    samples: NDArray[Any]
    rate_hz: float
    start_s: float = 0.0
    quantity: str | None = None
    units: str | None = None
    scale: float = 1.0
    station_m: float | None = None
    axis: str | None = None
    limits: tuple[float, float] | None = None

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
            Samples times scale [`units`].

        Raises
        ------
        RecordingError
            If the channel has no units, or they measure something else.
        """
        return np.asarray(self.samples, np.float64) * (self.scale * self._factor(units))

    @property
    def clipped(self) -> NDArray[np.bool_]:
        """Whether each sample lies at or beyond the channel's limits, as [sample].

        The highest code of a converter lies one step below the end of its range, so samples
        within one step count: of 16 bits over the range, or of the recorded whole numbers.
        """
        if self.limits is None:
            return np.zeros(len(self), bool)
        low, high = self.limits
        step = (high - low) / 2**16
        if self.samples.dtype.kind in "iu" and abs(self.scale) < _COARSEST_STEP * (high - low):
            step = max(step, abs(self.scale))
        step *= 1 + 1e-3  # a step computed elsewhere differs in its last digits
        values = np.asarray(self.samples, np.float64) * self.scale
        return (values <= low + step) | (values >= high - step)

    def _factor(self, units: str) -> float:
        if self.units is None:
            raise RecordingError(
                f"channel {self.name}: the record gives no units; "
                "give them under [[inertial.channel]] in the setup"
            )
        try:
            return convert(self.units, units)
        except ValueError as error:
            raise RecordingError(
                f"channel {self.name}: {error}; correct units in the record or the setup"
            ) from None


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
