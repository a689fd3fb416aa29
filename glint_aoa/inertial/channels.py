"""The channels that a correction needs, chosen from a record and turned into SI units."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.inertial.modes import Plane
from glint_aoa.inertial.sensor import axial_specific_force
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.units import convert

__all__ = [
    "Accelerometer",
    "PackageOutput",
    "check_same_clock",
    "companions",
    "package_output",
    "tangential",
]

_LEAST_BASELINE_M = 0.05
_AXIS_OF_PLANE: dict[Plane, str] = {"yaw": "y", "pitch": "z"}


@dataclass(frozen=True, eq=False)
class PackageOutput:
    """Output of the inertial package.

    Attributes
    ----------
    channel : Channel
        Where it comes from.
    specific_force : ndarray [sample]
        Along model +x [m/s^2].
    is_filtered : bool
        Whether the package's own low-pass has been at work.
    """

    channel: Channel
    specific_force: NDArray[np.float64]
    is_filtered: bool


@dataclass(frozen=True, eq=False)
class Accelerometer:
    """An accelerometer tangential to the package's axis.

    Attributes
    ----------
    channel : Channel
        Where it comes from.
    acceleration : ndarray [sample]
        Along the channel's axis [m/s^2].
    ahead_m : float
        Distance from the package forward to the accelerometer [m].
    """

    channel: Channel
    acceleration: NDArray[np.float64]
    ahead_m: float


def package_output(record: AcquisitionRecord) -> PackageOutput:
    """Take the package's unfiltered output, or its filtered one if that is all there is.

    Parameters
    ----------
    record : AcquisitionRecord
        The record; the first channel of the quantity is taken.

    Returns
    -------
    PackageOutput
        In SI units, whether the channel holds an acceleration or an indicated angle.

    Raises
    ------
    RecordingError
        If there is neither, or the samples are not finite, or their unit fits neither.
    """
    for quantity in ("aoa_unfiltered", "aoa_filtered"):
        for channel in record.with_quantity(quantity)[:1]:
            return PackageOutput(
                channel, _axial(record, channel), is_filtered=quantity == "aoa_filtered"
            )
    raise RecordingError(
        f"{record.name}: no channel of quantity aoa_unfiltered or aoa_filtered; record the "
        "package's output, or name it under [[inertial.channel]] in the setup"
    )


def tangential(
    record: AcquisitionRecord, plane: Plane, package: PackageOutput
) -> Accelerometer | None:
    """Take the accelerometer of a plane that is nearest to the package.

    Parameters
    ----------
    record : AcquisitionRecord
        The record.
    plane : {"yaw", "pitch"}
        Plane of the motion; its accelerometers sense +-y or +-z.
    package : PackageOutput
        The package; where its station or the accelerometer's is not stated, the accelerometer
        is taken to sit on the package's face.

    Returns
    -------
    Accelerometer or None
        None if the record has no accelerometer in that plane. Of several equally near, the
        first in record order.

    Raises
    ------
    RecordingError
        If the samples are not finite or do not measure an acceleration, or their clock is not
        the package's.
    """
    letter = _AXIS_OF_PLANE[plane]
    found = [
        channel
        for channel in record.with_quantity("acceleration")
        if channel.axis is not None and channel.axis.endswith(letter)
    ]
    if not found:
        return None
    channel = min(found, key=lambda each: abs(_ahead(each, package.channel)))
    check_same_clock(record, package.channel, channel)
    values = _finite(record, channel, channel.values("m/s^2"))
    return Accelerometer(channel, values, _ahead(channel, package.channel))


def companions(
    record: AcquisitionRecord, plane: Plane, package: PackageOutput, sensor: Accelerometer
) -> list[Accelerometer]:
    """Take the other accelerometers of a plane that can show how the model turns.

    Parameters
    ----------
    record, plane, package
        As for `tangential`.
    sensor : Accelerometer
        From `tangential`.

    Returns
    -------
    list of Accelerometer
        Those at a stated station at least 0.05 m away from `sensor`, sampled at the same times,
        finite and never clipped; their acceleration is along the axis of `sensor`.
    """
    if sensor.channel.station_m is None or package.channel.station_m is None:
        return []
    found = []
    for channel in record.with_quantity("acceleration"):
        in_plane = channel.axis is not None and channel.axis.endswith(_AXIS_OF_PLANE[plane])
        if not in_plane or channel.station_m is None:
            continue
        ahead = _ahead(channel, package.channel)
        same_clock = (channel.rate_hz, channel.start_s, len(channel)) == (
            sensor.channel.rate_hz,
            sensor.channel.start_s,
            len(sensor.channel),
        )
        if not same_clock or abs(ahead - sensor.ahead_m) < _LEAST_BASELINE_M:
            continue
        values = channel.values("m/s^2")
        if np.isfinite(values).all() and not channel.clipped.any():
            sign = 1.0 if channel.axis == sensor.channel.axis else -1.0
            found.append(Accelerometer(channel, sign * values, ahead))
    return found


def check_same_clock(record: AcquisitionRecord, first: Channel, second: Channel) -> None:
    """Refuse two channels that were not sampled at the same times.

    Raises
    ------
    RecordingError
        If rate, start or number of samples differ; the message names both channels.
    """
    for what, unit, one, other in (
        ("rate", " Hz", first.rate_hz, second.rate_hz),
        ("start", " s", first.start_s, second.start_s),
        ("length", " samples", len(first), len(second)),
    ):
        if one != other:
            raise RecordingError(
                f"{record.name}: channels {first.name} and {second.name} differ in {what} "
                f"({one:g}{unit} and {other:g}{unit}); resample them to one clock"
            )


def _ahead(channel: Channel, package: Channel) -> float:
    if channel.station_m is None or package.station_m is None:
        return 0.0
    return channel.station_m - package.station_m


def _axial(record: AcquisitionRecord, channel: Channel) -> NDArray[np.float64]:
    sign = -1.0 if channel.axis == "-x" else 1.0
    if _measures(channel, "rad"):
        values = axial_specific_force(channel.values("rad"))
    elif _measures(channel, "m/s^2"):
        values = channel.values("m/s^2")
    else:
        raise RecordingError(
            f"{record.name}: channel {channel.name} is in {channel.units or 'no unit'}, expected "
            "an acceleration (g_0, m/s^2) or an angle (deg, rad); correct units in the record or "
            "the setup"
        )
    return sign * _finite(record, channel, values)


def _measures(channel: Channel, unit: str) -> bool:
    if channel.units is None:
        return False
    try:
        convert(channel.units, unit)
    except ValueError:
        return False
    return True


def _finite(
    record: AcquisitionRecord, channel: Channel, values: NDArray[np.float64]
) -> NDArray[np.float64]:
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise RecordingError(
            f"{record.name}: channel {channel.name} has {bad.size} samples that are not finite, "
            f"the first at {channel.start_s + bad[0] / channel.rate_hz:.3f} s; cut the record to "
            "a stretch without them"
        )
    return values
