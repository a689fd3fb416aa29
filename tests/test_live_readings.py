"""Readings of single fields: the same to the bit as in a block, flags, intervals, JSON."""

import json
import math
import os
import signal

import numpy as np
import pytest
from live_fields import angle_deg, info_of, setup_of, some_fields

from calibration.sweep.fit import fit_sweep
from glint_aoa.flags import Flag
from glint_aoa.live.learning import Learner, Lesson, learn, learn_stack, sample_numbers
from glint_aoa.live.readings import Measurer, Reading
from glint_aoa.process import measure_point
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.recording import resolve_recording

NORMAL = 1.959963984540054


def taught(fields, *, setup=None, info=None, **how):
    setup = setup or setup_of()
    stack = FieldStack.from_array(fields, info or info_of())
    recording = resolve_recording(stack, setup)
    return learn_stack(stack, setup, recording, **how), stack, setup


def one_by_one(measurer, fields, numbers=None, rate=60.0):
    numbers = range(len(fields)) if numbers is None else numbers
    found = []
    for field, number in zip(fields, numbers, strict=True):
        start = np.array([number / rate])
        found += measurer.measure(field[None], np.array([number]), start, start + 100.0)
    return found


@pytest.fixture(scope="module")
def fields():
    return some_fields(40)


def test_one_field_at_a_time_is_as_good_as_all_together(fields):
    learnt, stack, setup = taught(fields)
    single = one_by_one(Measurer(learnt), fields)
    number = np.arange(40)
    block = Measurer(learnt).measure(fields, number, number / 60, number / 60 + 100.0)
    result = measure_point(stack, setup)
    for name in ("angle_deg", "intercept_mm", "flags"):
        expected = result.values[name]
        np.testing.assert_array_equal([getattr(r, name) for r in single], expected)
        np.testing.assert_array_equal([getattr(r, name) for r in block], expected)


def test_an_interrupt_leaves_the_process_that_learns_alone(fields):
    setup = setup_of()
    recording = resolve_recording(FieldStack.from_array(fields, info_of()), setup)
    learner = Learner()
    going = learner.warm_up(Lesson(fields[:2, :2, :2], np.arange(2), 255, setup, recording))
    (process,) = learner._pool._processes
    os.kill(process, signal.SIGINT)
    assert going.result(timeout=250) is False  # it cannot be learnt from, but has been tried
    learner.close()


def test_the_interval_is_that_of_noise_and_what_fields_share(fields):
    learnt, stack, setup = taught(fields)
    values = measure_point(stack, setup).values
    total = np.hypot(values["angle_std_deg"], values["angle_systematic_std_deg"])
    found = [reading.u95_deg for reading in one_by_one(Measurer(learnt), fields)]
    np.testing.assert_allclose(found, NORMAL * total, rtol=1e-12)


def test_the_geometry_s_uncertainty_is_carried(fields):
    setup = setup_of(
        uncertainty={"rotation": ["0 deg", "0.01 deg", "0 deg"], "focal_length": "0.2 mm"}
    )
    learnt, stack, _ = taught(fields, setup=setup)
    values = measure_point(stack, setup).values
    total = np.hypot(values["angle_std_deg"], values["angle_systematic_std_deg"])
    assert (total > 0.0099).all()
    found = [reading.u95_deg for reading in one_by_one(Measurer(learnt), fields)]
    np.testing.assert_allclose(found, NORMAL * total, rtol=1e-3)


def test_a_sweep_is_applied_as_process_applies_it(fields):
    learnt, stack, setup = taught(fields)
    optical = np.linspace(-5, 5, 9)
    onboard = 0.02 + 1.01 * optical + 1e-3 * np.random.default_rng(2).standard_normal(9)
    sweep = fit_sweep(optical, np.full(9, 1e-3), onboard, np.full(9, 1e-3))
    expected = measure_point(stack, setup, sweep=sweep).values
    found = one_by_one(Measurer(learnt, sweep=sweep), fields)
    np.testing.assert_array_equal([r.angle_deg for r in found], expected["angle_deg"])
    np.testing.assert_array_equal([r.flags for r in found], expected["flags"])
    noise = expected["angle_std_deg"]
    assert ([r.u95_deg for r in found] > NORMAL * noise).all()
    total = np.hypot(noise, expected["angle_systematic_std_deg"])
    np.testing.assert_allclose([r.u95_deg for r in found], NORMAL * total, rtol=0.2)


def test_the_line_in_pixels_is_the_line_of_the_picture(fields):
    learnt, _, _ = taught(fields)
    for reading in one_by_one(Measurer(learnt), fields[:5]):
        assert reading.slope_px == pytest.approx(0.011, abs=2e-4)
        middle = reading.intercept_px + reading.slope_px * (fields.shape[2] - 1) / 2
        assert middle == pytest.approx(30.3, abs=0.02)


def test_flags_of_one_field_by_itself_and_by_those_before(fields):
    learnt, _, _ = taught(fields)
    shown = [*fields[:12], fields[11], fields[12], fields[12], *fields[13:20]]
    dark = np.full_like(fields[0], 10)
    dim = (10 + (fields[20].astype(float) - 10) * 0.4).astype(np.uint8)
    found = one_by_one(Measurer(learnt), [*shown, dark, dim])
    names = [reading.flag_names for reading in found]
    assert names[12] == ["REPEATED"]
    assert names[14] == ["REPEATED"]
    assert names[22] == ["NO_GLINT", "FEW_COLUMNS"]
    assert "FADING" in names[23]
    assert [k for k, each in enumerate(names) if each] == [12, 14, 22, 23]
    assert not found[22].is_good
    assert math.isnan(found[22].angle_deg)


def test_a_gap_is_flagged_where_it_ends(fields):
    learnt, _, _ = taught(fields)
    numbers = [0, 1, 2, 5, 6]
    found = one_by_one(Measurer(learnt), fields[:5], numbers)
    assert [r.flag_names for r in found] == [[], [], [], ["TIMING", "DROPPED"], []]


def test_fields_said_to_be_in_the_wrong_order_are_flagged():
    fields = some_fields(64, interlaced=True)
    setup = setup_of()
    flags = []
    for said in ("even", "odd"):
        stack = FieldStack.from_array(fields, info_of(interlaced=True, first_parity=said))
        recording = resolve_recording(stack, setup)
        flags.append(learn_stack(stack, setup, recording).flags)
    assert flags == [0, int(Flag.PARITY_ORDER)]


def test_the_sample_of_the_newest_fields_is_the_one_that_process_would_take():
    assert sample_numbers(100, 160).tolist() == list(range(100, 160))
    many = sample_numbers(0, 1000)
    spread = np.unique(np.linspace(0, 999, 64).astype(int))
    assert set(spread) <= set(many.tolist())
    assert set(range(6)) <= set(many.tolist())


@pytest.mark.parametrize("first", [100, 101])
def test_learning_from_the_newest_fields_is_learning_from_a_point_of_them(first):
    every = some_fields(60, interlaced=True)
    setup = setup_of()
    info = info_of(interlaced=True, first_parity="even")
    recording = resolve_recording(FieldStack.from_array(every, info), setup)
    numbers = np.arange(first, first + 59)
    lesson = Lesson(every[first % 2 :][:59], numbers, 255, setup, recording)
    live = one_by_one(Measurer(learn(lesson)), lesson.fields, numbers)
    info = info_of(interlaced=True, first_parity=["even", "odd"][first % 2])
    expected = measure_point(FieldStack.from_array(lesson.fields, info), setup)
    np.testing.assert_array_equal([r.angle_deg for r in live], expected.values["angle_deg"])
    assert np.mean([r.angle_deg for r in live]) == pytest.approx(angle_deg(0.011), abs=1e-3)


def test_a_reading_is_plain_json():
    reading = Reading(
        index=7,
        time_s=0.5,
        unix_time_s=1e9,
        angle_deg=math.nan,
        u95_deg=0.1234567891234,
        intercept_mm=1.0,
        slope=0.1,
        slope_px=0.2,
        intercept_px=3.0,
        n_columns=38,
        flags=int(Flag.NO_GLINT | Flag.FADING),
        point=None,
        latency_ms=math.nan,
    )
    line = reading.line()
    assert line.endswith(b"\n")
    assert line.count(b"\n") == 1
    assert json.loads(line) == {
        "index": 7,
        "time_s": 0.5,
        "unix_time_s": 1e9,
        "angle_deg": None,
        "u95_deg": 0.123456789,
        "intercept_mm": 1.0,
        "slope": 0.1,
        "slope_px": 0.2,
        "intercept_px": 3.0,
        "n_columns": 38,
        "flags": ["NO_GLINT", "FADING"],
        "point": None,
        "latency_ms": None,
    }
