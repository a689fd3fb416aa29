"""The channels that a correction needs, chosen from a record and turned into SI units."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.inertial.modes import AXIS_OF_PLANE, Plane
from glint_aoa.inertial.sensor import axial_specific_force
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.units import convert

__all__ = [
    "Accelerometer",
    "PackageOutput",
    "accelerometers",
    "check_same_clock",
    "companions",
    "finite",
    "package_output",
    "stations_missing",
    "tangential",
    "tangential_missing",
]

_LEAST_BASELINE_M = 0.05


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
    found = _of_plane(record, plane)
    if not found:
        return None
    channel = min(found, key=lambda each: abs(_ahead(each, package.channel)))
    check_same_clock(record, package.channel, channel)
    values = finite(record, channel, channel.values("m/s^2"))
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
    for channel in _of_plane(record, plane):
        if channel.station_m is None or not _same_clock(channel, sensor.channel):
            continue
        ahead = _ahead(channel, package.channel)
        if abs(ahead - sensor.ahead_m) < _LEAST_BASELINE_M:
            continue
        values = channel.values("m/s^2")
        if np.isfinite(values).all() and not channel.clipped.any():
            sign = 1.0 if channel.axis == sensor.channel.axis else -1.0
            found.append(Accelerometer(channel, sign * values, ahead))
    return found


def accelerometers(
    record: AcquisitionRecord, plane: Plane, package: PackageOutput
) -> list[Accelerometer]:
    """Take the accelerometers of a plane that show how it moves: one a station.

    Parameters
    ----------
    record, plane, package
        As for `tangential`.

    Returns
    -------
    list of Accelerometer
        Those at a stated station, sampled with the package, from the foremost back; accelerations
        are along model +y or +z and may be NaN where samples are missing. Where several sense at
        one station (the same sensor on two acquisitions, say), the one with the fewest samples
        clipped or missing is taken. Empty if the package's station is not stated.

    Raises
    ------
    RecordingError
        If a channel does not measure an acceleration.
    """
    if package.channel.station_m is None:
        return []
    at: dict[float, Accelerometer] = {}
    worst: dict[float, int] = {}
    for channel in _of_plane(record, plane):
        if channel.station_m is None or not _same_clock(channel, package.channel):
            continue
        sign = -1.0 if channel.axis == f"-{AXIS_OF_PLANE[plane]}" else 1.0
        values = sign * channel.values("m/s^2")
        useless = int(np.count_nonzero(channel.clipped | ~np.isfinite(values)))
        station = round(channel.station_m, 3)
        if station not in at or useless < worst[station]:
            at[station] = Accelerometer(channel, values, _ahead(channel, package.channel))
            worst[station] = useless
    return [at[station] for station in sorted(at, reverse=True)]


def stations_missing(record: AcquisitionRecord, plane: Plane, package: PackageOutput) -> str | None:
    """Say what a plane lacks to show velocity and angular rate, or None if it shows both.

    Returns
    -------
    str or None
        The missing channels or stations, as the end of a sentence.
    """
    found = accelerometers(record, plane, package)
    if found and found[0].ahead_m - found[-1].ahead_m >= _LEAST_BASELINE_M:
        return None
    in_plane = _of_plane(record, plane)
    along = f"along model {AXIS_OF_PLANE[plane]} ({plane})"
    if not in_plane:
        return f"two accelerometers {along} at least {_LEAST_BASELINE_M:g} m apart"
    unplaced = [
        channel.name for channel in (package.channel, *in_plane) if channel.station_m is None
    ]
    if unplaced:
        return f"the station of {' and '.join(unplaced)}"
    others = [each.name for each in in_plane if not _same_clock(each, package.channel)]
    if others:
        return f"{' and '.join(others)} on the clock of {package.channel.name}"
    return (
        f"a second accelerometer {along} at least {_LEAST_BASELINE_M:g} m from "
        f"{found[0].channel.name}"
    )


def tangential_missing(
    record: AcquisitionRecord, planes: Iterable[Plane], package: PackageOutput
) -> str | None:
    """Say in which planes `tangential` finds no accelerometer, or None if it finds all.

    Returns
    -------
    str or None
        The missing channels, as the end of a sentence.
    """
    absent = [plane for plane in planes if tangential(record, plane, package) is None]
    if not absent:
        return None
    axes = " and ".join(f"model {AXIS_OF_PLANE[plane]} ({plane})" for plane in absent)
    return f"an accelerometer at the package along {axes}"


def finite(
    record: AcquisitionRecord, channel: Channel, values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return values [sample] of a channel unless some of them are missing.

    Raises
    ------
    RecordingError
        If one is not finite; the message says how many, and where the first is.
    """
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise RecordingError(
            f"{record.name}: channel {channel.name} has {bad.size} samples that are not finite, "
            f"the first at {channel.start_s + bad[0] / channel.rate_hz:.3f} s; cut the record to "
            "a stretch without them"
        )
    return values


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


def _of_plane(record: AcquisitionRecord, plane: Plane) -> list[Channel]:
    letter = AXIS_OF_PLANE[plane]
    return [
        channel
        for channel in record.with_quantity("acceleration")
        if channel.axis is not None and channel.axis.endswith(letter)
    ]


def _same_clock(one: Channel, other: Channel) -> bool:
    return (one.rate_hz, one.start_s, len(one)) == (other.rate_hz, other.start_s, len(other))


def _ahead(channel: Channel, package: Channel) -> float:
    if channel.station_m is None or package.station_m is None:
        return 0.0
    return channel.station_m - package.station_m


def _axial(record: AcquisitionRecord, channel: Channel) -> NDArray[np.float64]:
    sign = -1.0 if channel.axis == "-x" else 1.0
    if _measures(channel.units, "rad"):
        values = axial_specific_force(channel.values("rad"))
    elif _measures(channel.units, "m/s^2"):
        values = channel.values("m/s^2")
    else:
        raise RecordingError(
            f"{record.name}: channel {channel.name} is in {channel.units or 'no unit'}, expected "
            "an acceleration (g_0, m/s^2) or an angle (deg, rad); correct units in the record or "
            "the setup"
        )
    return sign * finite(record, channel, values)


@cache  # a unit that does not fit is an exception, which holds its callers' arrays for a while
def _measures(units: str | None, unit: str) -> bool:
    if units is None:
        return False
    try:
        convert(units, unit)
    except ValueError:
        return False
    return True
