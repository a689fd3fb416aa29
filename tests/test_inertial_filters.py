import re

import numpy as np
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial.filters import (
    band_pass,
    band_settling_s,
    integrate_band,
    low_pass,
    low_pass_sos,
    noise_bandwidth_hz,
    settling_s,
)
from glint_aoa.setup import InertialFilter

RATE = 800.0


def a_filter(kind="butterworth", order=2, cutoff="0.4 Hz"):
    return InertialFilter.model_validate({"kind": kind, "order": order, "cutoff": cutoff})


@pytest.mark.parametrize("kind", ["butterworth", "bessel"])
@pytest.mark.parametrize("order", [1, 2, 3, 4, 8])
def test_response_at_the_cutoff_is_minus_3_db(kind, order):
    sections = low_pass_sos(a_filter(kind, order), RATE)
    response = scipy.signal.sosfreqz(sections, worN=[0.0, 0.4], fs=RATE)[1]
    assert abs(response[0]) == pytest.approx(1.0, abs=1e-6)
    assert abs(response[1]) == pytest.approx(np.sqrt(0.5), rel=1e-4)


def test_causal_low_pass_is_scipys_from_the_steady_state_of_the_first_sample():
    signal = np.random.default_rng(1).normal(size=4000) + 5
    sections = scipy.signal.butter(2, 0.4, output="sos", fs=RATE)
    state = scipy.signal.sosfilt_zi(sections) * signal[0]
    expected, _ = scipy.signal.sosfilt(sections, signal, zi=state)
    np.testing.assert_allclose(low_pass(signal, RATE, a_filter(), causal=True), expected)


def test_forward_backward_low_pass_is_scipys_inside():
    signal = np.random.default_rng(2).normal(size=24000)
    sections = scipy.signal.butter(2, 0.4, output="sos", fs=RATE)
    expected = scipy.signal.sosfiltfilt(sections, signal)
    inside = slice(8000, 16000)
    np.testing.assert_allclose(
        low_pass(signal, RATE, a_filter())[inside], expected[inside], atol=1e-6
    )


def test_forward_backward_squares_the_magnitude_and_has_no_delay():
    time = np.arange(40 * 800) / RATE
    signal = np.cos(2 * np.pi * 0.4 * (time - 20))
    inside = slice(8 * 800, 32 * 800)
    result = low_pass(signal, RATE, a_filter())[inside]
    np.testing.assert_allclose(result, 0.5 * signal[inside], atol=1e-3)


@given(st.floats(-100, 100), st.booleans())
def test_a_constant_passes_unchanged(level, causal):
    result = low_pass(np.full(2400, level), RATE, a_filter(), causal=causal)
    np.testing.assert_allclose(result, level, atol=1e-8)


@pytest.mark.parametrize("kind", ["butterworth", "bessel"])
def test_settling_time_is_that_of_the_step_response(kind):
    filter_ = a_filter(kind, 2)
    step = np.ones(12 * 800)
    step[0] = 0.0
    result = low_pass(step, RATE, filter_, causal=True)
    late = round(settling_s(filter_) * RATE)
    assert np.max(np.abs(result[late + 10 :] - 1)) < 0.0101
    assert np.max(np.abs(result[late - 50 : late] - 1)) > 0.0098


@pytest.mark.parametrize("causal", [True, False])
def test_noise_bandwidth_agrees_with_the_response(causal):
    frequency, response = scipy.signal.sosfreqz(
        low_pass_sos(a_filter(), 100.0), worN=2**16, fs=100.0
    )
    power = np.abs(response) ** (2 if causal else 4)
    expected = np.trapezoid(power, frequency)
    assert noise_bandwidth_hz(a_filter(), causal=causal) == pytest.approx(expected, rel=1e-3)


def test_too_short_a_record_is_refused():
    message = (
        "the record lasts 1 s, but the 0.4 Hz low-pass needs 2.62 s to settle; "
        "record longer or raise the cutoff"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        low_pass(np.zeros(800), RATE, a_filter())


def test_a_cutoff_beyond_half_the_rate_is_refused():
    message = (
        "inertial.filter: a cutoff of 500 Hz cannot be had at 800 samples a second; "
        "it must lie below half of them"
    )
    with pytest.raises(InputError, match=re.escape(message)):
        low_pass_sos(a_filter(cutoff="500 Hz"), RATE)


def test_band_pass_is_scipys_forward_and_backward():
    signal = np.random.default_rng(3).normal(size=16000)
    sections = scipy.signal.butter(4, (8.0, 12.0), btype="bandpass", output="sos", fs=RATE)
    expected = scipy.signal.sosfiltfilt(sections, signal)
    inside = slice(4000, 12000)
    np.testing.assert_allclose(
        band_pass(signal, RATE, 8.0, 12.0)[inside], expected[inside], atol=1e-6
    )


def test_band_pass_passes_a_mode_and_stops_its_neighbour():
    time = np.arange(8000) / RATE
    mode, neighbour = np.sin(61.6 * time), np.sin(122.5 * time)
    result = band_pass(mode + neighbour, RATE, 7.0, 13.0)
    inside = slice(2000, 6000)
    np.testing.assert_allclose(result[inside], mode[inside], atol=2e-3)


@pytest.mark.parametrize("frequency", [9.2, 9.8, 10.37])
def test_integration_in_a_band_has_no_error_of_phase_or_amplitude(frequency):
    time = np.arange(8000) / RATE
    circular = 2 * np.pi * frequency
    acceleration = 3.0 + 12 * np.cos(circular * time + 0.3)
    velocity = integrate_band(acceleration, RATE, low_hz=5.0, high_hz=60.0)
    expected = 12 / circular * np.sin(circular * time + 0.3)
    settled = round(4 * band_settling_s(5.0, 60.0) * RATE)
    inside = slice(1600, -1600)
    np.testing.assert_allclose(velocity[inside], expected[inside], atol=2e-4 * 12 / circular)
    near = slice(settled, -settled)
    np.testing.assert_allclose(velocity[near], expected[near], atol=0.05 * 12 / circular)


def test_integration_does_not_drift():
    acceleration = 0.5 + 1e-3 * np.arange(24000) / RATE
    velocity = integrate_band(acceleration, RATE, low_hz=5.0, high_hz=60.0)
    assert np.max(np.abs(velocity[4000:-4000])) < 1e-6


@pytest.mark.parametrize("function", [band_pass, integrate_band])
def test_bands_that_cannot_be_had_are_refused(function):
    def run(samples, low, high):
        if function is band_pass:
            return band_pass(samples, RATE, low, high)
        return integrate_band(samples, RATE, low_hz=low, high_hz=high)

    message = (
        "the band from 5 to 500 Hz cannot be had at 800 samples a second; "
        "it must rise from above zero to below half of them"
    )
    with pytest.raises(InputError, match=re.escape(message)):
        run(np.zeros(8000), 5.0, 500.0)
    message = (
        "the record lasts 0.125 s, but the band from 9 to 10 Hz needs 2 s to settle; "
        "record longer or widen the band"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        run(np.zeros(100), 9.0, 10.0)
