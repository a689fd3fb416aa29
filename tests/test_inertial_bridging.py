import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glint_aoa.inertial.bridging import bridge
from glint_aoa.inertial.kinematic import BRIDGE_STD

RATE_HZ = 800.0
TIME = np.arange(8000) / RATE_HZ


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def vibration(seed=0, noise=5e-3):
    """Three lightly damped resonances under force that is white up to 60 Hz [m/s^2]."""
    rng = np.random.default_rng(seed)
    frequency = np.fft.rfftfreq(TIME.size, 1 / RATE_HZ)
    signal = rng.normal(0.0, noise, TIME.size)
    for natural in (9.5, 20.0, 31.0):
        force = rng.normal(size=frequency.size) + 1j * rng.normal(size=frequency.size)
        receptance = 1 / (natural**2 - frequency**2 + 0.02j * natural * frequency)
        spectrum = np.where((frequency > 3) & (frequency < 60), force * receptance, 0.0)
        response = np.fft.irfft(frequency**2 * spectrum, n=TIME.size)
        signal += 10.0 * response / response.std()
    return signal


def clip(signal, limit):
    return np.clip(signal, -limit, limit), np.abs(signal) >= limit


@pytest.mark.parametrize("noise", [0.0, 5e-3])
def test_a_clipped_sine_is_restored(noise):
    signal = 12.0 * np.sin(2 * np.pi * 9.8 * TIME + 0.4)
    signal += np.random.default_rng(0).normal(0.0, noise, TIME.size)
    clipped, holes = clip(signal, 11.0)
    got = bridge(clipped, holes, RATE_HZ)
    assert rms((got.samples - signal)[holes]) < BRIDGE_STD * rms((clipped - signal)[holes])


def test_good_samples_stay_as_they_are():
    clipped, holes = clip(vibration(), 25.0)
    got = bridge(clipped, holes, RATE_HZ)
    np.testing.assert_allclose(got.samples[~holes], clipped[~holes], rtol=1e-12)
    assert np.all(got.draws[:, ~holes] == 0)
    assert np.all(got.draws[:, holes] != 0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_clipped_peaks_come_back_to_within_a_few_per_cent(seed):
    signal = vibration(seed)
    clipped, holes = clip(signal, 25.0)
    assert 0.01 < holes.mean() < 0.2
    got = bridge(clipped, holes, RATE_HZ)
    error = rms((got.samples - signal)[holes])
    assert error < BRIDGE_STD * rms((clipped - signal)[holes])
    assert np.all(np.abs(got.samples[holes]) >= np.abs(clipped[holes]) - 1e-12)


def test_the_draws_scatter_as_the_errors():
    signal = vibration(7, noise=0.05)
    holes = np.zeros(TIME.size, bool)
    for first in range(100, 7900, 100):
        holes[first : first + 8] = True
    got = bridge(np.where(holes, np.nan, signal), holes, RATE_HZ)
    error = rms((got.samples - signal)[holes])
    assert error < 0.02 * rms(signal)
    assert rms(got.draws[:, holes]) == pytest.approx(error, rel=0.3)


@given(st.integers(0, 999))
@settings(max_examples=10, deadline=None)
def test_the_mirrored_signal_is_bridged_alike(seed):
    signal = vibration(seed)
    clipped, holes = clip(signal, 25.0)
    one, other = bridge(clipped, holes, RATE_HZ), bridge(-clipped, holes, RATE_HZ)
    np.testing.assert_allclose(one.samples, -other.samples, atol=1e-6)


def test_what_cannot_be_bridged_is_not():
    signal = vibration()
    long = np.zeros(TIME.size, bool)
    long[4000:4040] = True  # 50 ms
    assert bridge(signal, long, RATE_HZ) is None
    assert bridge(*clip(signal, 8.0), RATE_HZ) is None  # more than it leaves
    sparse = np.ones(TIME.size, bool)
    sparse[::2] = False
    assert bridge(signal, sparse, RATE_HZ) is None
