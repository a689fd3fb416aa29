import re

import numpy as np
import pytest
import scipy.signal

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial.coherence import cross_spectra

RATE_HZ = 20.0


def signals(seed=0, size=4000):
    rng = np.random.default_rng(seed)
    common = rng.normal(size=size)
    return common + rng.normal(size=size), 2 * np.roll(common, 3) + rng.normal(size=size)


def test_spectra_and_coherence_are_those_of_scipy():
    q, y = signals()
    found = cross_spectra(q, y, RATE_HZ, segment_s=10.0)
    options = {"fs": RATE_HZ, "nperseg": 200}
    bins, coherence = scipy.signal.coherence(q, y, **options)
    np.testing.assert_allclose(found.frequency_hz, bins, rtol=1e-14)
    np.testing.assert_allclose(found.coherence, coherence, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found.first_power, scipy.signal.welch(q, **options)[1], rtol=1e-12)
    np.testing.assert_allclose(found.second_power, scipy.signal.welch(y, **options)[1], rtol=1e-12)
    np.testing.assert_allclose(found.cross, scipy.signal.csd(q, y, **options)[1], rtol=1e-12)


def test_power_integrates_to_the_variance():
    q, y = signals()
    found = cross_spectra(q, y, RATE_HZ, segment_s=10.0)
    assert np.sum(found.second_power) * found.frequency_hz[1] == pytest.approx(y.var(), rel=0.03)


def test_a_signal_is_coherent_with_itself_and_not_with_silence():
    q, _ = signals()
    assert cross_spectra(q, -3 * q, RATE_HZ, segment_s=10.0).coherence == pytest.approx(1.0)
    assert not cross_spectra(q, 0 * q, RATE_HZ, segment_s=10.0).coherence.any()


def test_independent_signals_exceed_the_level_of_chance_as_often_as_said():
    rng = np.random.default_rng(4)
    over = []
    for _ in range(60):
        found = cross_spectra(*rng.normal(size=(2, 2000)), RATE_HZ, segment_s=10.0)
        over.append(np.mean(found.coherence[2:-2] > found.by_chance(0.05)))
    assert found.averages == pytest.approx(19 / (1 + 2 * 18 / 36 / 19))
    assert np.mean(over) == pytest.approx(0.05, abs=0.01)


def test_one_segment_proves_nothing():
    q, y = signals(size=200)
    found = cross_spectra(q, y, RATE_HZ, segment_s=10.0)
    assert found.coherence[1:] == pytest.approx(1.0)
    assert found.by_chance() == 1.0


def test_the_part_that_is_not_shared_is_measured():
    rng = np.random.default_rng(5)
    common, own = rng.normal(size=(2, 40_000))
    found = cross_spectra(common, 3 * common + 0.5 * own, RATE_HZ, segment_s=10.0)
    assert found.uncorrelated_rms(0.0, RATE_HZ / 2) == pytest.approx(0.5, rel=0.02)
    assert found.uncorrelated_rms(0.0, RATE_HZ / 8) == pytest.approx(0.25, rel=0.05)


def test_signals_of_two_lengths_are_refused():
    message = "signals of shape [100] and [99] have no cross spectrum; give two of the same length"
    with pytest.raises(InputError, match=re.escape(message)):
        cross_spectra(np.ones(100), np.ones(99), RATE_HZ, segment_s=1.0)


def test_segments_must_fit():
    with pytest.raises(InputError, match=re.escape("segment_s is 0.1, 2 samples; give at least 8")):
        cross_spectra(np.ones(100), np.ones(100), RATE_HZ, segment_s=0.1)
    message = (
        "the record lasts 5 s, less than one segment of 6 s; record longer or shorten segment_s"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        cross_spectra(np.ones(100), np.ones(100), RATE_HZ, segment_s=6.0)
