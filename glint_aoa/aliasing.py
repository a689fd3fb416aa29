"""Motion too fast for the fields, as the acquisition record of the same point shows it.

Fields taken at a rate R show a motion of frequency f as one of |f - k R|, below R / 2. The fields
alone cannot tell; accelerometers can, which are sampled many times faster.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.records.acquisition import AcquisitionRecord, Channel

__all__ = ["AliasedMotion", "aliased_motion"]

_Array = NDArray[np.float64]

_LEAST_S = 1.0  # of record, for a spectrum
_HIGHEST_HZ = 400.0
_LONGEST_ARM_M = 2.0  # from an accelerometer to a point that a model on a sting turns about
_MODE_BAND = 0.1  # how far from a mode's frequency its radius still holds, relative
_LEAST_BASE_M = 0.05  # between stations that are two
_ON_MEAN = 1.5  # cycles a record: slower motion cannot be told from the mean


@dataclass(frozen=True)
class AliasedMotion:
    """Pitching above half the field rate, as fields of that exposure see it.

    Attributes
    ----------
    rms_deg : float
        Root mean square of all of it [deg].
    on_mean_deg : float
        Root mean square of what is seen as slower than 1.5 cycles a record [deg]: it falls on the
        mean.
    frequency_hz, seen_at_hz : float
        Where it is strongest, and where the fields show that [Hz].
    """

    rms_deg: float
    on_mean_deg: float
    frequency_hz: float
    seen_at_hz: float


def aliased_motion(
    record: AcquisitionRecord,
    *,
    rate_hz: float,
    exposure_s: float = 0.0,
    start_s: float = 0.0,
    n_fields: int,
    radii_m: Mapping[float, float] | None = None,
) -> AliasedMotion | None:
    """Find how much the model pitches faster than half the field rate.

    The angle follows from the accelerometers along model z at two or more stations, as the slope
    of their acceleration over the station divided by (2 pi f)^2. Of one station alone the arm to
    the point of rotation must be known; near a mode of `radii_m` it is that, elsewhere 2 m, which
    makes the angle a lower bound for any model that is shorter.

    Parameters
    ----------
    record : AcquisitionRecord
        Channels with quantity, axis, units and station.
    rate_hz, exposure_s, start_s : float
        Field rate [Hz], integration time [s] and start of the first field [s].
    n_fields : int
        Number of fields.
    radii_m : mapping of float to float, optional
        Effective radius of the pitch modes [m], by their frequency [Hz].

    Returns
    -------
    AliasedMotion or None
        None where no accelerometer along z with a station and a unit covers the time of the
        fields, sampled fast enough.

    Notes
    -----
    Yawing is left out: a glint shows a few per cent of it. The fuselage counts as rigid; where it
    bends, the angle is that of the line through the accelerometers.
    """
    span = n_fields / rate_hz
    covering = [_stretch(each, start_s, max(span, _LEAST_S)) for each in _along_z(record, rate_hz)]
    channels = _alike([each for each in covering if each is not None])
    if not channels:
        return None
    frequency, spectra = _spectra(channels)
    fast = (frequency > rate_hz / 2) & (frequency < min(_HIGHEST_HZ, 0.45 * channels[0].rate_hz))
    if not fast.any():
        return None
    arms = _arms(record, channels, radii_m or {})
    angle = _turning(spectra, channels, frequency, arms)
    power = np.where(fast, np.abs(angle * np.sinc(frequency * exposure_s)) ** 2, 0.0)
    seen = np.abs(frequency - rate_hz * np.round(frequency / rate_hz))
    strongest = int(power.argmax())
    return AliasedMotion(
        rms_deg=float(np.degrees(np.sqrt(power.sum()))),
        on_mean_deg=float(np.degrees(np.sqrt(power[seen < _ON_MEAN / span].sum()))),
        frequency_hz=float(frequency[strongest]),
        seen_at_hz=float(seen[strongest]),
    )


def _along_z(record: AcquisitionRecord, rate_hz: float) -> list[Channel]:
    return [
        channel
        for axis in ("+z", "-z")
        for channel in record.with_quantity("acceleration", axis)
        if None not in (channel.station_m, channel.units) and channel.rate_hz > rate_hz
    ]


def _stretch(channel: Channel, start_s: float, duration_s: float) -> Channel | None:
    """Cut out the time of the fields, and what follows where that is too short for a spectrum."""
    first = round((start_s - channel.start_s) * channel.rate_hz)
    last = first + round(duration_s * channel.rate_hz)
    if first < 0 or last > len(channel):
        return None
    stretch = channel.cut(first, last)
    return stretch if np.isfinite(np.asarray(stretch.samples, np.float64)).all() else None


def _alike(channels: list[Channel]) -> list[Channel]:
    """Those channels that are sampled at the times of the first."""
    return [
        each
        for each in channels
        if (each.rate_hz, len(each)) == (channels[0].rate_hz, len(channels[0]))
    ]


def _spectra(channels: list[Channel]) -> tuple[_Array, NDArray[np.complex128]]:
    """Frequencies [Hz], and accelerations along +z [channel, frequency].

    The squares of their absolute values add up to the mean square [m^2/s^4].
    """
    from scipy import signal  # noqa: PLC0415  slow to import

    upward = np.array([1.0 if channel.axis == "+z" else -1.0 for channel in channels])
    values = upward[:, None] * np.array([channel.values("m/s^2") for channel in channels])
    window = signal.windows.hann(values.shape[1], sym=False)
    spectra = np.fft.rfft(signal.detrend(values) * window)
    spectra *= np.sqrt(2 / values.shape[1] / (window**2).sum())
    frequency = np.fft.rfftfreq(values.shape[1], 1 / channels[0].rate_hz)
    return np.asarray(frequency, np.float64), spectra


def _arms(
    record: AcquisitionRecord, channels: list[Channel], radii_m: Mapping[float, float]
) -> dict[float, float]:
    """Distance of the first accelerometer from the modes' points of rotation [m].

    Effective radii end at the inertial package.
    """
    package = [
        each.station_m
        for quantity in ("aoa_unfiltered", "aoa_filtered")
        for each in record.with_quantity(quantity)
        if each.station_m is not None
    ]
    beyond = float(channels[0].station_m or 0.0) - package[0] if package else 0.0
    return {frequency: radius + beyond for frequency, radius in radii_m.items()}


def _turning(
    spectra: NDArray[np.complex128],
    channels: list[Channel],
    frequency: _Array,
    arms_m: Mapping[float, float],
) -> NDArray[np.complex128]:
    """Angle [frequency], rad."""
    station = np.array([float(channel.station_m or 0.0) for channel in channels])
    if np.ptp(station) >= _LEAST_BASE_M:
        away = station - station.mean()
        turning = away @ spectra / (away @ away)
    else:
        turning = spectra.mean(axis=0) / _arm(frequency, arms_m)
    angle: NDArray[np.complex128] = turning / (2 * np.pi * np.maximum(frequency, 1.0)) ** 2
    return angle


def _arm(frequency: _Array, arms_m: Mapping[float, float]) -> _Array:
    """Distance from accelerometer to point of rotation [frequency], m."""
    arm = np.full(frequency.size, _LONGEST_ARM_M)
    for mode_hz, mode_arm in arms_m.items():
        near = np.abs(frequency - mode_hz) < _MODE_BAND * mode_hz
        arm[near] = max(abs(mode_arm), 1e-3)
    return arm
