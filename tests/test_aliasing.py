"""Motion beyond half the field rate, from accelerometers: closed forms of a turning rod."""

import numpy as np
import pytest

from glint_aoa.aliasing import aliased_motion
from glint_aoa.records.acquisition import AcquisitionRecord, Channel

RATE_HZ = 800.0
FIXED_M = -0.2
VIDEO = {"rate_hz": 60.0, "n_fields": 60}


def accelerometer(station, frequency, amplitude_deg=0.01, *, axis="+z", seconds=4.0, start_s=-1.0):
    """Of a rod that turns by A sin(2 pi f t) about `FIXED_M`, nose up positive."""
    time = start_s + np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    turn = 2 * np.pi * frequency
    turning = -np.radians(amplitude_deg) * turn**2 * np.sin(turn * time)
    sign = 1 if axis == "+z" else -1
    return Channel(
        f"az{station}{axis}",
        sign * (station - FIXED_M) * turning,
        RATE_HZ,
        start_s,
        quantity="acceleration",
        units="m/s^2",
        station_m=station,
        axis=axis,
    )


def record(*channels):
    return AcquisitionRecord("p", {each.name: each for each in channels})


@pytest.mark.parametrize(
    ("frequency", "seen"), [(34.2, 25.8), (47.0, 13.0), (61.0, 1.0), (130.0, 10.0)]
)
@pytest.mark.parametrize("axes", [("+z", "+z"), ("-z", "+z")])
def test_two_stations_show_the_angle(frequency, seen, axes):
    channels = [
        accelerometer(station, frequency, axis=axis)
        for station, axis in zip((0.9, 0.1), axes, strict=True)
    ]
    got = aliased_motion(record(*channels), **VIDEO)
    assert got.rms_deg == pytest.approx(0.01 / np.sqrt(2), rel=0.02)
    assert got.frequency_hz == pytest.approx(frequency, abs=0.51)
    assert got.seen_at_hz == pytest.approx(seen, abs=0.51)


def test_only_what_is_seen_near_zero_falls_on_the_mean():
    near, far = (
        aliased_motion(record(*(accelerometer(x, f) for x in (0.9, 0.1))), **VIDEO)
        for f in (60.2, 34.2)
    )
    assert near.on_mean_deg == pytest.approx(0.01 / np.sqrt(2), rel=0.05)
    assert far.on_mean_deg < 0.01 * 0.01


def test_slower_motion_is_not_aliased():
    channels = [accelerometer(station, 9.2, 0.3) for station in (0.9, 0.1)]
    assert aliased_motion(record(*channels), **VIDEO).rms_deg < 1e-4


def test_the_exposure_averages_what_is_fast():
    channels = [accelerometer(station, 130.0) for station in (0.9, 0.1)]
    got = aliased_motion(record(*channels), exposure_s=0.004, **VIDEO)
    assert got.rms_deg == pytest.approx(0.01 / np.sqrt(2) * np.sinc(130 * 0.004), rel=0.02)


def test_the_field_rate_counts():
    channels = [accelerometer(station, 34.2) for station in (0.9, 0.1)]
    got = aliased_motion(record(*channels), rate_hz=200.0, n_fields=200)
    assert got.rms_deg < 1e-4


def test_one_station_needs_the_arm():
    one = accelerometer(0.9, 34.2)
    package = Channel("aoa", np.zeros(9), RATE_HZ, quantity="aoa_unfiltered", station_m=0.7)
    known = aliased_motion(record(one, package), radii_m={34.0: 0.9}, **VIDEO)
    assert known.rms_deg == pytest.approx(0.01 / np.sqrt(2), rel=0.02)  # 0.9 m + 0.2 m is the arm
    least = aliased_motion(record(one), radii_m={9.2: 0.8}, **VIDEO)
    assert least.rms_deg == pytest.approx(0.01 / np.sqrt(2) * 1.1 / 2, rel=0.02)


def test_one_channel_along_z_without_a_package_takes_the_radius_for_its_arm():
    got = aliased_motion(record(accelerometer(0.9, 34.2)), radii_m={34.2: -1.1}, **VIDEO)
    assert got.rms_deg == pytest.approx(0.01 / np.sqrt(2), rel=0.02)


@pytest.mark.parametrize(
    "channels",
    [
        [],
        [accelerometer(0.9, 34.2, start_s=0.5)],
        [accelerometer(0.9, 34.2, seconds=1.5)],
    ],
    ids=["none", "begins late", "ends early"],
)
def test_channels_that_do_not_cover_the_fields_say_nothing(channels):
    assert aliased_motion(record(*channels), **VIDEO) is None


def test_a_channel_with_missing_samples_is_left_out():
    broken, whole = accelerometer(0.1, 34.2), accelerometer(0.9, 34.2)
    broken.samples[1000] = np.nan
    got = aliased_motion(record(broken, whole), radii_m={34.2: 1.1}, **VIDEO)
    assert got.rms_deg == pytest.approx(0.01 / np.sqrt(2), rel=0.02)
