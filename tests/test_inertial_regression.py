import itertools
import re
from dataclasses import replace

import closed_form
import numpy as np
import pytest
import rigid_body
from test_inertial_nlr import task_of
from test_inertial_spectral import left_and_std

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.flags import Flag
from glint_aoa.inertial import regression
from glint_aoa.inertial.filters import low_pass
from glint_aoa.inertial.lateral import lateral_signals, resonances, sensor_per_accelerometer
from glint_aoa.inertial.modes import TABLE_1, Mode
from glint_aoa.inertial.record_fit import regress
from glint_aoa.setup import InertialFilter

MODE_1 = TABLE_1[0]
RATE_HZ = 800.0


def modulated(*numbers, duration_s=30.0, seed=1, **options):
    motion = rigid_body.together(
        *(
            rigid_body.sine(number, modulation_hz=0.2 + 0.03 * number, duration_s=duration_s)
            for number in numbers
        )
    )
    return rigid_body.record(motion, rng=np.random.default_rng(seed), **options)


def in_band(rng, size, low_hz, high_hz):
    spectrum = np.fft.rfft(rng.normal(size=size))
    bins = np.fft.rfftfreq(size, 1 / RATE_HZ)
    return np.fft.irfft(np.where((bins > low_hz) & (bins < high_hz), spectrum, 0), size)


def with_stray(record, *, from_s, share, seed=3):
    """The yaw accelerometer shaken on its bracket from a time on, unfelt by the package."""
    channel = record["ay_face"]
    stray = in_band(np.random.default_rng(seed), len(channel), 9.2, 10.4)
    stray *= share * channel.samples.std() / stray.std() * (channel.time_s >= from_s)
    shaken = replace(channel, samples=channel.samples + stray)
    return replace(record, channels={**record.channels, "ay_face": shaken})


@pytest.mark.parametrize("numbers", [(1,), (2,), (1, 2), (1, 5)])
def test_modulated_sines_are_corrected_without_a_survey(numbers):
    record = modulated(*numbers)
    estimate = regression.estimate_bias(task_of(record))
    left, std = left_and_std(record, estimate)
    assert np.max(np.abs(left)) < 0.001
    assert np.mean(np.abs(left) < 2 * std + 1e-4) > 0.9
    assert len(estimate.settings["sources"]) == len(numbers)
    assert estimate.flags is None


def test_the_radius_is_found():
    estimate = regression.estimate_bias(task_of(modulated(1)))
    assert estimate.settings["radii_m"]["yaw 9.8 Hz"] == pytest.approx(MODE_1.radius_m, rel=2e-3)
    assert estimate.settings["modulation_hz"] == pytest.approx(0.23, abs=0.06)


def test_a_steady_sine_is_left_alone_and_called_unknown():
    record = rigid_body.record(rigid_body.sine(1, duration_s=16.0), rng=np.random.default_rng(1))
    estimate = regression.estimate_bias(task_of(record))
    assert not estimate.addition.any()
    left, std = left_and_std(record, estimate)
    assert (std > np.abs(left)).all()
    assert (std > 0.1).all()


def moment_record(record):
    """The same record with a yaw moment in place of its accelerometers."""
    moment = replace(
        record["ay_face"],
        name="yaw_moment",
        samples=-14.0 * record["ay_face"].samples,
        quantity="moment",
        units="N*m",
        axis="+z",
        station_m=0.0,
    )
    return replace(
        record,
        channels={"aoa_unfiltered": record["aoa_unfiltered"], "yaw_moment": moment},
    )


def test_a_moment_serves_as_well_as_an_accelerometer():
    record = moment_record(modulated(1))
    estimate = regression.estimate_bias(task_of(record))
    assert estimate.settings["sources"] == ("yaw_moment",)
    assert estimate.settings["radii_m"] == {}
    left, _ = left_and_std(record, estimate)
    assert np.max(np.abs(left)) < 0.001


def test_of_a_steady_moment_nothing_is_known_at_all():
    record = rigid_body.record(rigid_body.sine(1, duration_s=16.0), rng=np.random.default_rng(1))
    estimate = regression.estimate_bias(task_of(moment_record(record)))
    assert any(np.isinf(term).all() for term in estimate.std_terms)


def test_the_filtered_output_alone_will_do():
    record = modulated(1, duration_s=40.0)
    package = record["aoa_unfiltered"]
    passed = low_pass(package.samples, RATE_HZ, InertialFilter(), causal=True)
    filtered = replace(package, samples=passed, quantity="aoa_filtered")
    task = task_of(replace(record, channels={**record.channels, "aoa_unfiltered": filtered}))
    found = regress(task, source="acceleration", planes=("yaw",))
    assert -1 / found.fit.coefficient[0] == pytest.approx(MODE_1.radius_m, rel=5e-3)


def test_a_stretch_that_is_not_correlated_is_flagged_and_left_out_of_the_fit():
    clean = modulated(1, duration_s=60.0)
    record = with_stray(clean, from_s=40.0, share=0.4)
    task = task_of(record)
    estimate = regression.estimate_bias(task)
    time = record["ay_face"].time_s
    flagged = (estimate.flags & Flag.UNCORRELATED) != 0
    assert np.mean(flagged[(time > 42) & (time < 57)]) > 0.5
    assert not flagged[time < 34].any()
    assert "not correlated with the output" in estimate.why
    left, std = left_and_std(record, estimate)
    inner = time[1600:-1600]
    assert np.max(np.abs(left[inner < 34])) < 0.005
    assert np.max(np.abs(left[inner > 42])) > 0.01
    assert np.mean(np.abs(left) < 2 * std) > 0.9


def test_a_slow_change_of_the_angle_is_not_taken_for_bias():
    record = modulated(1, duration_s=60.0)
    package = record["aoa_unfiltered"]
    drift = 9.80665 * np.radians(0.05) * np.sin(2 * np.pi * package.time_s / 60.0)
    record = replace(
        record,
        channels={
            **record.channels,
            "aoa_unfiltered": replace(package, samples=package.samples + drift),
        },
    )
    found = regress(task_of(record))
    assert found.is_correlated
    assert -1 / found.fit.coefficient[0] == pytest.approx(MODE_1.radius_m, rel=0.1)
    std = found.fit.coefficient_std[0]
    assert abs(found.fit.coefficient[0] + 1 / MODE_1.radius_m) < 3 * std


def test_figures_of_a_stretch_are_those_of_the_papers_tables():
    found = regress(task_of(modulated(1)), between_s=(8.0, 22.0))
    figures = found.figures()
    used = (found.time_s >= 8.0) & (found.time_s <= 22.0)
    angle = np.degrees(np.arcsin(found.response[used] / 9.80665))
    assert figures["mean_deg"] == pytest.approx(angle.mean(), abs=1e-6)
    assert figures["std_deg"] == pytest.approx(angle.std(ddof=1), rel=1e-4)
    assert figures["corrected_deg"] == pytest.approx(0.0, abs=5e-4)
    assert figures["bias_deg"] == pytest.approx(angle.mean(), abs=5e-4)
    assert figures["reduction"] > 0.99
    assert figures["standard_error_deg"] < 0.01 * figures["std_deg"]


def test_random_excitation_is_improved():
    motion = rigid_body.random({1: 0.18}, rng=np.random.default_rng(2), duration_s=40.0)
    record = rigid_body.record(motion, rng=np.random.default_rng(3))
    left, std = left_and_std(record, regression.estimate_bias(task_of(record)))
    assert np.sqrt(np.mean(left**2)) < 0.01
    assert np.mean(np.abs(left) < 2 * std) > 0.9


def test_what_it_lacks_is_said():
    task, _ = closed_form.task(MODE_1, duration_s=8.0)
    assert regression.missing(task) == "a record of 10 s (this one lasts 8 s)"
    task, _ = closed_form.task(MODE_1, duration_s=12.0)
    assert regression.missing(task) is None
    only = {k: v for k, v in task.record.channels.items() if k == "aoa"}
    bare = replace(task, record=replace(task.record, channels=only))
    assert regression.missing(bare) == (
        "a signal of lateral motion with its axis, sampled with the package: an accelerometer "
        "along model y or z, a yaw or pitch moment, a side or normal force"
    )


def test_a_short_stretch_is_refused():
    message = (
        "rigid-body: 2 s of settled record are too short for the regression; record 10 s or more"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        regress(task_of(modulated(1)), between_s=(8.0, 9.96))


def test_a_source_that_is_not_recorded_is_named():
    message = "rigid-body: no moment shows the motion in yaw; choose another source"
    with pytest.raises(InputError, match=re.escape(message)):
        regress(task_of(modulated(1)), source="moment", planes=("yaw",))


def test_signals_need_an_axis_a_unit_and_the_packages_clock():
    record = modulated(1, duration_s=4.0)
    channel = record["ay_face"]
    useless = {
        "no axis": replace(channel, axis=None),
        "no unit": replace(channel, units=None),
        "volts": replace(channel, units="V"),
        "late": replace(channel, start_s=0.5),
        "gaps": replace(channel, samples=np.where(channel.time_s > 1, channel.samples, np.nan)),
    }
    package = {"aoa_unfiltered": record["aoa_unfiltered"]}
    for name, each in useless.items():
        task = task_of(replace(record, channels={**package, name: each}))
        assert lateral_signals(task, "yaw") == []
    (found,) = lateral_signals(task_of(replace(record, channels={**package, "ay": channel})), "yaw")
    assert found.kind == "acceleration"
    assert found.samples.mean() == pytest.approx(0.0, abs=1e-12)


def test_resonances_of_random_motion_and_none_of_noise():
    motion = rigid_body.random({1: 0.2, 5: 0.2}, rng=np.random.default_rng(5), common_force=False)
    record = rigid_body.record(motion, rng=np.random.default_rng(5))
    found = resonances(record["ay_face"].samples, RATE_HZ)
    assert [each.frequency_hz for each in found] == pytest.approx([9.8, 29.8], rel=0.01)
    assert all(low.high_hz <= high.low_hz for low, high in itertools.pairwise(found))
    assert resonances(np.random.default_rng(6).normal(size=16_000), RATE_HZ) == []
    assert resonances(np.zeros(16_000), RATE_HZ) == []


def test_an_accelerometer_on_the_point_of_rotation_is_refused():
    mode = Mode(9, "yaw", 9.8, 0.8)
    assert sensor_per_accelerometer(mode, 9.8, ahead_m=0.2, force=0.0) == pytest.approx(0.8)
    message = (
        "inertial.mode 9: its point of rotation lies within 1 mm of the accelerometer, which "
        "cannot see it; use another station or leave the mode out"
    )
    with pytest.raises(InputError, match=re.escape(message)):
        sensor_per_accelerometer(mode, 9.8, ahead_m=-0.8, force=0.0)
