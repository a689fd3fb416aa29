"""The package's output on its way through the low-pass: angle, uncertainty and flags of rows."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.flags import Flag
from glint_aoa.inertial.bridging import bridge
from glint_aoa.inertial.channels import PackageOutput
from glint_aoa.inertial.estimate import BiasEstimate
from glint_aoa.inertial.filters import low_pass, noise_bandwidth_hz, settling_s
from glint_aoa.inertial.sensor import indicated_angle
from glint_aoa.setup import InertialFilter
from glint_aoa.units import STANDARD_GRAVITY

__all__ = ["FilteredOutput"]

_Floats = NDArray[np.float64]
_Mask = NDArray[np.bool_]

_NOISE_BAND = (1.5, 10.0)  # times the cutoff: beyond the angle's changes, below the modes
_SEGMENT_S = 8.0
_REMEMBERED = 0.01  # of the low-pass's weight: unknown samples count from there on


@dataclass(frozen=True, eq=False)
class FilteredOutput:
    """Output of the package after the low-pass, corrected or not.

    Attributes
    ----------
    package : PackageOutput
        The output; if it is the filtered one, it is not filtered again.
    filter : InertialFilter
        The low-pass.
    causal : bool
        Whether it runs forward only.
    """

    package: PackageOutput
    filter: InertialFilter
    causal: bool

    @property
    def rate_hz(self) -> float:
        """Samples a second [Hz]."""
        return self.package.channel.rate_hz

    @cached_property
    def time_s(self) -> _Floats:
        """Times after the first sample [s], as [sample]."""
        return np.asarray(np.arange(self.package.specific_force.size) / self.rate_hz)

    def low_pass(self, samples: _Floats) -> _Floats:
        """Run a signal [sample] through the low-pass as the output runs."""
        return low_pass(samples, self.rate_hz, self.filter, causal=self.causal)

    @cached_property
    def uncorrected(self) -> _Floats:
        """Specific force after the low-pass [sample, m/s^2]."""
        if self.package.is_filtered:
            return self.package.specific_force
        return self.low_pass(self.package.specific_force)

    def angle_deg(self, rows_s: _Floats, filtered: _Floats) -> _Floats:
        """Turn a low-passed specific force [sample, m/s^2] into angles at row times [deg]."""
        return np.degrees(indicated_angle(self._at(rows_s, filtered)))

    def angle_std_deg(self, rows_s: _Floats, corrected: _Floats, std: _Floats) -> _Floats:
        """Turn standard uncertainties [sample, m/s^2] into those of the angle at rows [deg]."""
        slope = _slope(self._at(rows_s, corrected))
        return np.degrees(self._at(rows_s, std) / slope)

    def typical_std_deg(self, corrected: _Floats, std: _Floats) -> float:
        """Return the mean uncertainty of the angle [deg]; infinite where it is not known."""
        mean = float(np.degrees(np.mean(std / _slope(corrected))))
        return mean if np.isfinite(mean) else np.inf

    def std(self, estimate: BiasEstimate, corrected: _Floats) -> _Floats:
        """Return the standard uncertainty of the corrected output [sample, m/s^2].

        NaN where a term of the estimate is infinite, which says that it is not known.
        """
        variance = np.full(corrected.size, self._noise(estimate, corrected))
        unknown = np.zeros(corrected.size, bool)
        for term in estimate.std_terms:
            finite = np.isfinite(term)
            variance += self.low_pass(np.where(finite, term, 0.0)) ** 2
            if not finite.all():
                unknown |= np.abs(self.low_pass(np.where(finite, 0.0, 1.0))) > _REMEMBERED
        clipped = _any_of(channel.clipped for channel in estimate.channels)
        if np.any(clipped):
            share = np.clip(self.low_pass(clipped.astype(float)), 0.0, 0.9)
            variance += (share / (1 - share) * self.low_pass(estimate.addition)) ** 2
        variance += self._clipping
        return np.where(unknown | ~np.isfinite(variance), np.nan, np.sqrt(variance))

    def flags(self, rows_s: _Floats, estimate: BiasEstimate) -> NDArray[np.int64]:
        """Return the bit masks of rows [row]: settling, clipping, gaps and the method's own."""
        settling = settling_s(self.filter)
        channels = (self.package.channel, *estimate.channels)
        mask = np.zeros(rows_s.size, np.int64)
        at_end = estimate.settling_s if self.causal else settling
        mask[(rows_s < settling) | (rows_s > self.time_s[-1] - at_end)] |= Flag.FILTER_SETTLING
        marked = {
            int(Flag.CLIPPED_CHANNEL): _any_of(each.clipped for each in channels),
            int(Flag.GAP): _any_of(each.bridged for each in channels),
        }
        mask |= self._remembered(rows_s, marked)
        if estimate.flags is not None:
            bits = [
                1 << bit for bit in range(int(np.bitwise_or.reduce(estimate.flags)).bit_length())
            ]
            own = {bit: (estimate.flags & bit) != 0 for bit in bits}
            mask |= self._remembered(rows_s, own)
        return mask

    def _remembered(self, rows_s: _Floats, marked: dict[int, _Mask]) -> NDArray[np.int64]:
        """Bits of the marked samples that the low-pass of each row remembers."""
        settling = settling_s(self.filter)
        ahead = 0.0 if self.causal else settling
        first = np.searchsorted(self.time_s, rows_s - settling)
        last = np.searchsorted(self.time_s, rows_s + ahead, side="right")
        mask = np.zeros(rows_s.size, np.int64)
        for bit, samples in marked.items():
            if samples.any():
                count = np.concatenate([[0], np.cumsum(samples)])
                mask[count[last] > count[first]] |= bit
        return mask

    @cached_property
    def _clipping(self) -> _Floats | float:
        """Variance of what the output lost at the end of its range, after the low-pass [sample].

        What bridging would put back counts as 1 sigma; infinite where the low-pass remembers
        samples that cannot be bridged.
        """
        clipped = self.package.channel.clipped
        if not clipped.any():
            return 0.0
        force = self.package.specific_force
        bridged = None if self.package.is_filtered else bridge(force, clipped, self.rate_hz)
        if bridged is None:
            around = np.abs(self.low_pass(clipped.astype(float))) > _REMEMBERED
            return np.asarray(np.where(around | clipped, np.inf, 0.0))
        lost = self.low_pass(bridged.samples - force) ** 2
        draws = np.mean([self.low_pass(draw) ** 2 for draw in bridged.draws], axis=0)
        return np.asarray(lost + draws)

    def _at(self, rows_s: _Floats, samples: _Floats) -> _Floats:
        return np.interp(rows_s, self.time_s, samples)

    def _noise(self, estimate: BiasEstimate, corrected: _Floats) -> float:
        """Variance of the noise after the low-pass, from its density above the cutoff."""
        if self.package.is_filtered:
            return float(np.var(np.diff(corrected)) / 2)
        signal = self.package.specific_force + estimate.addition
        segment = min(signal.size, round(_SEGMENT_S * self.rate_hz))
        bins, density = scipy.signal.welch(signal, self.rate_hz, nperseg=segment)
        low, high = (edge * self.filter.cutoff for edge in _NOISE_BAND)
        level = float(np.median(density[(bins >= low) & (bins <= high)]))
        return level * noise_bandwidth_hz(self.filter, causal=self.causal)


def _any_of(masks: Iterable[_Mask]) -> _Mask:
    return np.asarray(np.logical_or.reduce(list(masks)), bool)


def _slope(specific_force: _Floats) -> _Floats:
    """Change of the specific force with the angle, g cos(alpha) [m/s^2 per rad]."""
    ratio = np.clip(specific_force / STANDARD_GRAVITY, -0.999, 0.999)
    return np.asarray(STANDARD_GRAVITY * np.sqrt(1 - ratio**2))
