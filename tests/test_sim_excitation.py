import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from render_sim.excitation import Tones, modulated_sine, peak_to_peak, random_band, sine


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
