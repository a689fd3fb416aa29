"""Records made ready: gaps bridged, channels of different rate and start brought to one clock."""

import re

import numpy as np
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.errors import RecordingError
from glint_aoa.records import acquisition
from glint_aoa.records.acquisition import AcquisitionRecord, Channel, LazySamples
from glint_aoa.records.conditioning import bridge_gaps, missing_stretches, on_one_clock, prepared

RATE_HZ = 800.0


def lazy(samples):
    return LazySamples(samples.size, samples.dtype, lambda start, stop: samples[start:stop].copy())


def channel(samples, name="ay", rate_hz=RATE_HZ, start_s=0.0, **options):
    options = {"quantity": "acceleration", "units": "m/s^2", **options}
    return Channel(name, samples, rate_hz, start_s, **options)


def record(*channels):
    return AcquisitionRecord("p1", {each.name: each for each in channels})


def sine(rate_hz, start_s, size, frequency_hz=9.8):
    return np.sin(2 * np.pi * frequency_hz * (start_s + np.arange(size) / rate_hz) + 0.3)


def package(size=4000, rate_hz=RATE_HZ, start_s=0.0):
    samples = sine(rate_hz, start_s, size, 0.1)
    return channel(samples, "aoa", rate_hz, start_s, quantity="aoa_unfiltered", units="g_0")


# Gaps


def test_a_clean_record_is_left_as_it_is():
    clean = record(package(), channel(sine(RATE_HZ, 0.0, 4000)))
    found = prepared(clean)
    assert all(found[name] is clean[name] for name in clean.channels)
    assert bridge_gaps(channel(np.arange(3))).gaps == ()


@given(mask=st.lists(st.booleans(), min_size=1, max_size=60), block=st.integers(1, 9))
def test_missing_stretches_do_not_depend_on_the_blocks(mask, block):
    missing = np.array(mask)
    samples = np.where(missing, np.nan, 1.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(acquisition, "BLOCK", block)
        found = list(missing_stretches(channel(samples)))
    rebuilt = np.zeros(missing.size, bool)
    for first, end in found:
        assert end > first
        rebuilt[first:end] = True
    np.testing.assert_array_equal(rebuilt, missing)
    edges = np.flatnonzero(np.diff(missing.astype(int), prepend=0) == 1)
    assert len(found) == edges.size


@pytest.mark.parametrize("frequency_hz", [1.0, 9.8])
def test_a_gap_is_bridged_and_said(frequency_hz):
    truth = sine(RATE_HZ, 0.0, 4000, frequency_hz)
    samples = truth.copy()
    samples[[100, 101, 102, 103, 104, 105, 106, 107, 900, 2000]] = np.nan
    samples[901] = np.inf
    found = bridge_gaps(channel(samples))
    assert found.gaps == ((100, 108), (900, 902), (2000, 2001))
    np.testing.assert_array_equal(found.bridged, ~np.isfinite(samples))
    # Through the nearest two on either side a cubic misses by at most w^4 a b c d / 24.
    span = 2 * np.pi * frequency_hz / RATE_HZ
    limit = span**4 * (4.5**2 * 5.5**2) / 24
    assert np.abs(found.samples - truth).max() <= limit
    np.testing.assert_array_equal(found.samples[~found.bridged], truth[~found.bridged])


def test_a_cubic_is_bridged_exactly():
    time = np.arange(40) / 40
    truth = 1 + time - 2 * time**2 + 3 * time**3
    samples = truth.copy()
    samples[20:25] = np.nan
    np.testing.assert_allclose(bridge_gaps(channel(samples)).samples, truth, rtol=1e-12)


def test_gaps_at_the_ends_hold_the_nearest_sample():
    samples = np.array([np.nan, np.nan, 3.0, 4.0, 5.0, np.nan])
    np.testing.assert_array_equal(bridge_gaps(channel(samples)).samples, [3, 3, 3, 4, 5, 5])


@pytest.mark.parametrize(
    ("size", "missing", "rate_hz", "message"),
    [
        (4000, slice(1600, 1609), 800.0,
         "channel ay has no samples from 2.000 s to 2.011 s; gaps are bridged up to 0.01 s"),
        (20, slice(4, 6), 1.0, "channel ay has no samples from 4.000 s to 6.000 s; gaps are "
         "bridged up to 1 s"),
        (4000, slice(None), 800.0, "channel ay has no samples from 0.000 s to 5.000 s; gaps are"),
    ],
)  # fmt: skip
def test_a_long_gap_is_refused_with_its_time(size, missing, rate_hz, message):
    samples = np.ones(size)
    samples[missing] = np.nan
    with pytest.raises(RecordingError, match="^" + re.escape(f"p1: {message}")):
        prepared(record(package(), channel(samples, rate_hz=rate_hz)))


def test_gaps_of_channels_that_nobody_takes_are_left():
    samples = np.full(4000, np.nan)
    unused = channel(samples, "spare", quantity=None)
    warm = channel(samples, "warm", quantity="temperature", units="K")
    found = prepared(record(package(), unused, warm))
    assert found["spare"] is unused
    assert found["warm"] is warm


# One clock


@pytest.mark.parametrize(
    ("rate_hz", "start_s", "size"),
    [
        (800.0, 0.4e-3, 4000),
        (800.0, -0.0123, 4100),
        (1000.0, 0.0, 5000),
        (1600.0, -0.01, 8100),
        (400.0, 0.0, 2000),
        (51200.0 / 27, 0.0, 9481),
        (800.04, 0.0, 4001),
    ],
)
def test_a_sine_is_the_same_sine_on_the_other_clock(rate_hz, start_s, size):
    other = channel(sine(rate_hz, start_s, size), rate_hz=rate_hz, start_s=start_s)
    found = on_one_clock(record(package(), other))
    moved, kept = found["ay"], found["aoa"]
    assert (moved.rate_hz, moved.start_s, len(moved)) == (kept.rate_hz, kept.start_s, len(kept))
    truth = np.sin(2 * np.pi * 9.8 * moved.time_s + 0.3)
    inner = slice(100, -100)
    assert np.abs(moved.samples[inner] - truth[inner]).max() < 3e-5
    assert np.abs(moved.samples - truth).max() < 0.1  # point-symmetric beyond the ends
    np.testing.assert_allclose(kept.samples, sine(RATE_HZ, kept.start_s, len(kept), 0.1), atol=1e-9)


def test_a_constant_stays_exactly_what_it_is():
    other = channel(np.full(5000, 1.25), rate_hz=1000.0, start_s=3.3e-4)
    np.testing.assert_allclose(
        on_one_clock(record(package(), other))["ay"].samples, 1.25, rtol=1e-14
    )


def test_resampling_agrees_with_scipy_on_noise():
    """Band-limited noise, from 1000 to 800 samples a second."""
    rng = np.random.default_rng(8)
    low = scipy.signal.firwin(401, 200, fs=1000)
    noise = scipy.signal.lfilter(low, 1, rng.normal(size=10_000))
    found = on_one_clock(record(package(8000), channel(noise, rate_hz=1000.0)))["ay"].samples
    expected = scipy.signal.resample_poly(noise, 4, 5, window=("kaiser", 9.0))
    inner = slice(200, -200)
    scatter = np.std(found[inner] - expected[inner]) / np.std(expected)
    assert scatter < 2e-3  # SciPy's default kernel has ten zeros on either side, this one 32


def test_what_the_package_cannot_show_does_not_fold_into_its_band():
    other = channel(sine(2000.0, 0.0, 10_000, 730.0), rate_hz=2000.0)  # would fold to 70 Hz
    found = on_one_clock(record(package(), other))["ay"].samples[100:-100]
    assert np.abs(found).max() < 1e-4


@pytest.mark.parametrize(("rate_hz", "start_s"), [(1000.0, -0.1), (800.0, 0.0004), (800.0, -0.05)])
def test_stretches_read_from_a_file_are_those_of_the_whole(rate_hz, start_s):
    rng = np.random.default_rng(3)
    samples = rng.normal(size=6000)
    samples[2500:2503] = np.nan
    samples[1000] = 50.0
    options = {"rate_hz": rate_hz, "start_s": start_s, "limits": (-40.0, 40.0)}
    whole = prepared(record(package(), channel(samples, **options)))["ay"]
    piecewise = prepared(record(package(), channel(lazy(samples), **options)))["ay"]
    assert isinstance(piecewise.samples, LazySamples)
    assert (piecewise.gaps, len(piecewise)) == (whole.gaps, len(whole))
    for start, stop in ((0, 10), (0, 4000), (790, 1300), (1995, 2105), (3950, 4000), (7, 7)):
        part = piecewise.cut(start, stop) if stop > start else piecewise
        if stop > start:
            np.testing.assert_allclose(part.samples, whole.samples[start:stop], atol=1e-12)
            np.testing.assert_array_equal(part.clipped, whole.clipped[start:stop])
            np.testing.assert_array_equal(part.bridged, whole.bridged[start:stop])


def test_clipped_and_bridged_samples_are_known_on_the_other_clock():
    samples = sine(1000.0, 0.0, 5000)
    samples[2000:2010] = 5.0
    samples[3000] = np.nan
    limited = channel(samples, rate_hz=1000.0, limits=(-5.0, 5.0))
    found = prepared(record(package(), limited))["ay"]
    at = np.flatnonzero(found.clipped) / RATE_HZ
    assert at.min() == pytest.approx(2.0, abs=2 / RATE_HZ)
    assert at.max() == pytest.approx(2.009, abs=2 / RATE_HZ)
    assert np.flatnonzero(found.bridged).tolist() == [2400]


def test_channels_are_cut_to_the_time_they_share():
    early = channel(sine(RATE_HZ, -0.1, 4000), start_s=-0.1)
    found = on_one_clock(record(package(), early))
    assert (len(found["aoa"]), found["aoa"].start_s) == (3920, 0.0)
    np.testing.assert_array_equal(found["ay"].samples, early.samples[80:])
    late = channel(sine(RATE_HZ, 0.05, 4000), start_s=0.05)
    found = on_one_clock(record(package(), late))
    assert (len(found["aoa"]), found["aoa"].start_s) == (3960, 0.05)
    np.testing.assert_array_equal(found["ay"].samples, late.samples[:3960])


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (channel(np.zeros(500), rate_hz=100.0),
         "channel ay has 100 samples a second where the package's output has 800; that is too "
         "slow to show vibration, record it with 150 or more or leave out its quantity"),
        (channel(np.zeros(2000)),
         "channel ay lasts from 0.000 s to 2.500 s, too little of the package's 0.000 s to "
         "5.000 s; cut the record to the time that all channels cover"),
        (channel(np.zeros(4000), start_s=100.0),
         "channel ay lasts from 100.000 s to 105.000 s, too little of the package's"),
    ],
)  # fmt: skip
def test_what_cannot_be_brought_together_honestly_is_refused(other, message):
    with pytest.raises(RecordingError, match="^" + re.escape(f"p1: {message}")):
        on_one_clock(record(package(), other))


def test_a_slow_temperature_is_left_on_its_own_clock():
    warm = channel(np.full(5, 300.0), "warm", 1.0, quantity="temperature", units="K")
    found = prepared(record(package(), warm))
    assert found["warm"] is warm
    part = found.segment(800, 2400)
    assert (len(part["aoa"]), part["aoa"].start_s) == (1600, 1.0)
    assert (len(part["warm"]), part["warm"].start_s) == (2, 1.0)
