import numpy as np
import pytest

from glint_aoa.inertial.channels import Accelerometer, companions, package_output, tangential
from glint_aoa.inertial.turning import turning_per_acceleration
from glint_aoa.records.acquisition import AcquisitionRecord, Channel

RATE_HZ = 800.0
TIME = np.arange(6400) / RATE_HZ


def accelerometer(station_m, acceleration, *, axis="+z", name="a", **more):
    channel = Channel(
        name=name,
        samples=acceleration,
        rate_hz=RATE_HZ,
        quantity="acceleration",
        units="m/s^2",
        station_m=station_m,
        axis=axis,
        **more,
    )
    return Accelerometer(channel, acceleration, station_m - 0.9)


@pytest.mark.parametrize("radius_m", [0.7874, 0.0046, -0.181, 30.0])
def test_a_rigid_turn_shows_its_radius(radius_m):
    turning = 3.0 * np.sin(2 * np.pi * 20.3 * TIME + 0.3)
    at = {station: turning * (station - (0.9 - radius_m)) for station in (0.9, 0.55, 0.1)}
    first, *others = (accelerometer(station, values) for station, values in at.items())
    got = turning_per_acceleration(first, others, 20.3)
    assert got == pytest.approx(1 / radius_m, rel=1e-9)


def test_a_model_that_does_not_turn_has_no_radius():
    shake = np.sin(2 * np.pi * 20.3 * TIME)
    first, other = accelerometer(0.9, shake), accelerometer(0.3, shake)
    assert turning_per_acceleration(first, [other], 20.3) == pytest.approx(0, abs=1e-12)


def test_only_the_part_in_phase_and_in_the_band_counts():
    def motion(station):
        return (
            np.sin(2 * np.pi * 20.0 * TIME)
            + (station - 0.9) * 1.5 * np.sin(2 * np.pi * 20.0 * TIME)
            + (station - 0.9) * 4.0 * np.cos(2 * np.pi * 20.0 * TIME)
            + (station - 0.9) * 9.0 * np.sin(2 * np.pi * 9.5 * TIME)
        )

    first, other = accelerometer(0.9, motion(0.9)), accelerometer(0.2, motion(0.2))
    assert turning_per_acceleration(first, [other], 20.0) == pytest.approx(1.5, rel=1e-6)


def test_companions_are_of_the_plane_elsewhere_and_whole():
    good = np.sin(2 * np.pi * 9 * TIME)
    package = Channel(
        name="aoa",
        samples=np.zeros(TIME.size),
        rate_hz=RATE_HZ,
        quantity="aoa_unfiltered",
        units="g_0",
        station_m=0.9,
    )
    channels = [
        accelerometer(0.9, good, name="face"),
        accelerometer(0.9, good, name="face again"),
        accelerometer(0.5, good, name="mid", axis="-z"),
        accelerometer(0.5, good, name="other plane", axis="+y"),
        accelerometer(0.3, good[:-1], name="other clock"),
        accelerometer(0.2, np.where(TIME > 7, np.nan, good), name="gap"),
        accelerometer(0.1, good, name="clipped", limits=(-0.9, 0.9)),
    ]
    record = AcquisitionRecord(
        "record", {"aoa": package, **{each.channel.name: each.channel for each in channels}}
    )
    output = package_output(record)
    sensor = tangential(record, "pitch", output)
    (found,) = companions(record, "pitch", output, sensor)
    assert found.channel.name == "mid"
    np.testing.assert_array_equal(found.acceleration, -good)
