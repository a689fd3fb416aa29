import numpy as np
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st

from render_sim.excitation import (
    Sum,
    Tones,
    modulated_sine,
    peak_to_peak,
    period_beyond,
    random_band,
    sine,
    sine_sweep,
)
from render_sim.modes import modal_angles, paper_model_system


@pytest.fixture
def rng():
    return np.random.default_rng(20)


def test_sine_has_unit_amplitude_and_the_phase_drawn(rng):
    tone = sine(9.8, rng=rng)
    phase = np.angle(tone.amplitude[0])
    time = np.linspace(0, 1, 50)
    np.testing.assert_allclose(tone.at(time), np.cos(2 * np.pi * 9.8 * time + phase), atol=1e-12)
    assert peak_to_peak(tone, duration_s=8.0) == pytest.approx(2.0, abs=1e-4)


def test_modulated_sine_follows_its_law(rng):
    signal = modulated_sine(9.2, modulation_hz=0.25, depth=0.6, rng=rng)
    carrier = np.angle(signal.amplitude[1])
    envelope = np.angle(signal.amplitude[2]) - carrier
    time = np.linspace(-3, 9, 777)
    expected = (1 + 0.6 * np.cos(2 * np.pi * 0.25 * time + envelope)) * np.cos(
        2 * np.pi * 9.2 * time + carrier
    )
    np.testing.assert_allclose(signal.at(time), expected, atol=1e-12)


def test_random_fills_its_band_evenly_with_unit_variance(rng):
    signal = random_band(5.0, 60.0, rng=rng)
    assert (signal.frequency_hz[0], signal.frequency_hz[-1]) == (5.0, 60.0)
    power = np.abs(signal.amplitude) ** 2 / 2
    assert power.sum() == pytest.approx(1.0, abs=5 / np.sqrt(power.size))
    halves = power[: power.size // 2].sum(), power[power.size // 2 :].sum()
    assert halves[0] == pytest.approx(halves[1], abs=5 / np.sqrt(power.size))


def test_random_repeats_only_after_more_than_record_and_lead_in(rng):
    signal = random_band(rng=rng)
    np.testing.assert_allclose(signal.at(np.array([64.3])), signal.at(np.array([0.3])), atol=1e-9)
    assert abs(signal.at(np.array([32.3])) - signal.at(np.array([0.3])))[0] > 1e-3


@pytest.mark.parametrize("start", [0.0, -8.123456])
def test_fast_sum_on_regular_times_equals_the_direct_sum(rng, start):
    signal = random_band(rng=rng)
    time = start + np.arange(20_000) / 6400
    fast = signal.at(time)
    some = np.arange(0, time.size, 617)
    np.testing.assert_allclose(fast[some], signal.at(time[some]), rtol=0, atol=1e-11)


def test_fast_sum_goes_on_beyond_one_period(rng):
    signal = random_band(5.0, 20.0, rng=rng)
    time = -1 + np.arange(67 * 100) / 100
    some = np.array([0, 3000, 6399, 6400, 6699])
    np.testing.assert_allclose(signal.at(time)[some], signal.at(time[some]), rtol=0, atol=1e-10)


def test_slow_regular_times_are_summed_directly(rng):
    signal = random_band(rng=rng)
    time = np.arange(3600) / 60  # too slow for the band
    some = np.array([0, 17, 3599])
    np.testing.assert_allclose(signal.at(time)[some], signal.at(time[some]), rtol=0, atol=1e-11)


def test_irregular_times_keep_their_shape(rng):
    signal = random_band(rng=rng)
    time = np.sort(rng.random((7, 5)), axis=None).reshape(7, 5)
    value = signal.at(time)
    assert value.shape == (7, 5)
    np.testing.assert_allclose(value[3, 2], signal.at(time[3, 2])[()], atol=1e-12)


def test_second_derivative_agrees_with_differences():
    signal = Tones(np.array([9.2, 30.0]), np.array([1 + 2j, -0.3j]))
    step, time = 1e-4, np.linspace(0, 1, 200)
    difference = (signal.at(time + step) - 2 * signal.at(time) + signal.at(time - step)) / step**2
    scale = (2 * np.pi * 30) ** 2
    np.testing.assert_allclose(signal.derivative(2).at(time), difference, atol=1e-3 * scale)


@given(
    frequency=st.floats(0.1, 60),
    shift=st.floats(-5, 5),
    factor=st.floats(-100, 100, allow_nan=False),
)
def test_scaling_and_shifting_the_clock(frequency, shift, factor):
    signal = Tones(np.array([frequency]), np.array([1.0 + 0.5j]))
    later = Tones(
        signal.frequency_hz, signal.amplitude * np.exp(2j * np.pi * frequency * shift)
    ).scaled(factor)
    time = np.linspace(0, 1, 11)
    np.testing.assert_allclose(later.at(time), factor * signal.at(time + shift), atol=1e-9)


def test_seeds_reproduce():
    first, again, other = (random_band(rng=np.random.default_rng(s)) for s in (1, 1, 2))
    assert np.array_equal(first.amplitude, again.amplitude)
    assert not np.array_equal(first.amplitude, other.amplitude)


@pytest.mark.parametrize(("duration", "period"), [(16.0, 64.0), (64.0, 128.0), (98.0, 128.0)])
def test_a_period_is_longer_than_what_it_is_for(duration, period):
    assert period_beyond(duration) == period


def test_random_of_a_long_period_keeps_band_and_variance(rng):
    signal = random_band(5.0, 60.0, period_s=128.0, rng=rng)
    assert signal.frequency_hz.size == 55 * 128 + 1
    time = np.array([0.3, 64.3, 128.3])
    value = signal.at(time)
    assert abs(value[1] - value[0]) > 1e-3
    assert value[2] == pytest.approx(value[0], abs=1e-9)
    assert (np.abs(signal.amplitude) ** 2).sum() / 2 == pytest.approx(1.0, abs=0.06)


SWEEPS = [(5.0, 60.0, "linear"), (5.0, 60.0, "logarithmic"), (40.0, 8.0, "logarithmic")]


@pytest.mark.parametrize(("first", "last", "law"), SWEEPS)
def test_sweep_goes_from_end_to_end_by_its_law(first, last, law):
    swept = sine_sweep(
        first, last, law=law, time_s=12.0, period_s=64.0, rng=np.random.default_rng(2)
    )
    time = np.arange(12 * 6400) / 6400
    analytic = scipy.signal.hilbert(swept.at(time))
    turning = np.gradient(np.unwrap(np.angle(analytic)), time) / (2 * np.pi)
    inner = (time > 1) & (time < 11)
    share = time / 12
    law_hz = {
        "linear": first + (last - first) * share,
        "logarithmic": first * (last / first) ** share,
    }[law]
    np.testing.assert_allclose(turning[inner], law_hz[inner], rtol=0.01)
    np.testing.assert_allclose(np.abs(analytic)[inner], 1.0, atol=0.01)


def test_sweep_is_still_before_and_after():
    swept = sine_sweep(time_s=12.0, period_s=64.0, rng=np.random.default_rng(2))
    assert np.abs(swept.at(np.linspace(-10, -0.1, 500))).max() < 1e-3
    assert np.abs(swept.at(np.linspace(12.1, 50, 500))).max() < 1e-3


def test_modes_answer_a_sweep_as_an_oscillator_at_rest_before():
    """Independent route: the oscillator's equation, integrated from rest."""
    system = paper_model_system()
    swept = sine_sweep(5.0, 40.0, time_s=8.0, period_s=64.0, rng=np.random.default_rng(2))
    rate = 12800.0
    time = np.arange(round(9 * rate)) / rate
    force = swept.at(time)
    for mode, angle in modal_angles(system, swept, "yaw"):
        omega = 2 * np.pi * mode.frequency
        lever = system.shaker_station - system.fixed_point(mode)
        oscillator = (
            [lever / system.modal_inertia(mode)],
            [1.0, 2 * mode.damping * omega, omega**2],
        )
        _, expected, _ = scipy.signal.lsim(oscillator, force, time)
        np.testing.assert_allclose(angle.at(time), expected, atol=2e-4 * np.abs(expected).max())


def test_a_sum_has_the_values_and_derivatives_of_its_parts():
    one, other = Tones(np.array([9.2]), np.array([1 + 2j])), Tones(np.array([30.0]), np.array([1j]))
    time = np.linspace(0, 1, 7)
    joint = Tones(np.array([9.2, 30.0]), np.array([1 + 2j, 1j]))
    np.testing.assert_allclose(Sum((one, other)).at(time), joint.at(time), atol=1e-13)
    np.testing.assert_allclose(
        Sum((one, other)).derivative(2).at(time), joint.derivative(2).at(time), rtol=1e-12
    )
