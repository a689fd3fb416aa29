from dataclasses import replace

import closed_form
import numpy as np
import pytest
import rigid_body
import scipy.signal
from test_inertial_nlr import task_of
from test_inertial_spectral import left_and_std

from glint_aoa.inertial import harmonic
from glint_aoa.inertial.modes import TABLE_1


def servoed(record, bandwidth_hz=harmonic.BANDWIDTH_HZ):
    """The record with a second-order servo on its package, band-limited before the sampling."""
    channel = record["aoa_unfiltered"]
    spectrum = np.fft.rfft(channel.samples)
    s = 1j * np.fft.rfftfreq(channel.samples.size, 1 / 800.0) / bandwidth_hz
    samples = np.fft.irfft(spectrum / (1 + np.sqrt(2) * s + s**2), channel.samples.size)
    channels = {**record.channels, "aoa_unfiltered": replace(channel, samples=samples)}
    return replace(record, channels=channels)


def test_the_lag_is_that_of_a_second_order_servo():
    b, a = scipy.signal.butter(2, 2 * np.pi * 300, analog=True)
    for frequency in (18.4, 59.6, 350.0):
        _, response = scipy.signal.freqs(b, a, [2 * np.pi * frequency])
        assert harmonic.servo_lag(frequency) == pytest.approx(-np.angle(response[0]), rel=1e-12)


@pytest.mark.parametrize("number", [1, 2, 5, 6])
def test_a_sine_is_corrected_without_a_radius(number):
    motion = rigid_body.sine(number, bias_deg=0.15, duration_s=16.0)
    record = servoed(rigid_body.record(motion, rng=np.random.default_rng(1)))
    task = task_of(record)
    (line,) = (each for each in harmonic.harmonic_lines(task) if each.is_seen)
    plane, _, radius = rigid_body.TABLE[number]
    assert line.plane == plane
    assert abs(line.inverse_radius - 1 / radius) < 3 * line.std
    assert line.std < 0.05 * abs(line.inverse_radius)
    left, std = left_and_std(record, harmonic.estimate_bias(task))
    assert np.max(np.abs(left)) < 0.001
    assert np.mean(np.abs(left) < 2 * std + 1e-4) > 0.9


def test_gains_of_the_accelerometers_do_not_matter():
    record = rigid_body.record(rigid_body.sine(1, duration_s=12.0), rng=np.random.default_rng(1))
    weak = replace(record["ay_face"], samples=0.8 * record["ay_face"].samples)
    other = replace(record, channels={**record.channels, "ay_face": weak})
    one, two = (harmonic.estimate_bias(task_of(each)).addition for each in (record, other))
    np.testing.assert_allclose(one, two, rtol=1e-6, atol=1e-9)


def test_modes_of_both_planes_with_overlapping_harmonics():
    motion = rigid_body.together(
        rigid_body.sine(1, modulation_hz=0.25, duration_s=20.0),
        rigid_body.sine(2, modulation_hz=0.17, duration_s=20.0, bias_deg=0.1),
    )
    record = servoed(rigid_body.record(motion, rng=np.random.default_rng(1)))
    estimate = harmonic.estimate_bias(task_of(record))
    assert estimate.why == "second harmonics in aoa_unfiltered: 19.6 Hz, 18.4 Hz"
    left, _ = left_and_std(record, estimate)
    assert np.max(np.abs(left)) < 0.001


def test_noise_has_no_harmonics():
    motion = rigid_body.sine(1, bias_deg=0.0, duration_s=12.0)
    record = rigid_body.record(motion, rng=np.random.default_rng(1))
    estimate = harmonic.estimate_bias(task_of(record))
    assert not estimate.addition.any()
    assert estimate.why == "second harmonics in aoa_unfiltered: none stands out"


def test_two_shapes_in_quadrature_are_doubted_where_the_survey_is_known():
    motion = rigid_body.together(
        rigid_body.sine(1, frequency_hz=29.8, bias_deg=0.006, duration_s=12.0),
        rigid_body.sine(5, bias_deg=0.003, phase=0.4 + np.pi / 2, duration_s=12.0),
    )
    record = rigid_body.record(motion, rng=np.random.default_rng(1))
    left, std = left_and_std(record, harmonic.estimate_bias(task_of(record, TABLE_1)))
    assert (np.abs(left) > 0.01).all()
    assert (np.abs(left) < std).all()


def test_a_line_out_of_phase_is_not_the_second_harmonic():
    """A longitudinal vibration at twice the frequency, a quarter of a period off."""
    task, bias = closed_form.task(TABLE_1[0])
    time = np.arange(bias.size) / closed_form.RATE_HZ
    moved = np.sin(4 * np.pi * 9.8 * time + 0.6) * bias.max()
    samples = task.package.specific_force + moved
    task = replace(task, package=replace(task.package, specific_force=samples))
    (line,) = harmonic.harmonic_lines(task)
    assert not line.is_seen
    assert not harmonic.estimate_bias(task).addition.any()


def test_what_it_lacks_is_said():
    task, _ = closed_form.task(TABLE_1[0], duration_s=2.0)
    filtered = replace(task, package=replace(task.package, is_filtered=True))
    assert harmonic.missing(filtered) == (
        "the package's unfiltered output, which alone shows second harmonics"
    )
    only = {k: v for k, v in task.record.channels.items() if k == "aoa"}
    bare = replace(task, record=replace(task.record, channels=only))
    assert harmonic.missing(bare) == "an accelerometer at the package along model y or z"


@pytest.mark.parametrize("share", [0.08, 1.0])
def test_a_mode_that_turns_in_both_planes_is_one_line(share):
    """A sine in both planes, in phase; the points of rotation lie within an inch."""
    yaw = rigid_body.sine(1, bias_deg=0.15, duration_s=16.0)
    nodding = rigid_body.Motion(yaw.time_s, {2: share * yaw.angles[1]})
    record = rigid_body.record(rigid_body.together(yaw, nodding), rng=np.random.default_rng(1))
    record = servoed(record)
    (line,) = (each for each in harmonic.harmonic_lines(task_of(record)) if each.is_seen)
    radius = rigid_body.TABLE[1][2]
    assert line.inverse_radius == pytest.approx(1 / radius, rel=0.02)
    left, _ = left_and_std(record, harmonic.estimate_bias(task_of(record)))
    assert np.max(np.abs(left)) < 0.001
