import numpy as np
import pytest
import rigid_body
from test_inertial_nlr import task_of

from glint_aoa.inertial import spectral
from glint_aoa.inertial.filters import low_pass
from glint_aoa.inertial.modes import TABLE_1
from glint_aoa.inertial.sensor import bias_from_acceleration
from glint_aoa.setup import InertialFilter

RATE_HZ = 800.0


def left_and_std(record, estimate):
    """Corrected angle and its uncertainty after the low-pass [deg], ends cut off."""
    signals = [record["aoa_unfiltered"].samples + estimate.addition, *estimate.std_terms]
    passed = [low_pass(each, RATE_HZ, InertialFilter())[1600:-1600] for each in signals]
    per_degree = np.radians(9.80665)
    std = np.sqrt(np.sum([each**2 for each in passed[1:]], axis=0))
    return passed[0] / per_degree, std / per_degree


@pytest.mark.parametrize("frequency_hz", [9.0, 9.13, 9.2377])
def test_peak_and_frequency_of_a_sine_between_bins(frequency_hz):
    time = np.arange(9600) / RATE_HZ
    noise = 5e-3 * np.random.default_rng(0).normal(size=time.size)
    signal = 3.7 * np.sin(2 * np.pi * frequency_hz * time + 1) + noise
    peak = spectral.spectral_peak(signal, RATE_HZ, low_hz=7.8, high_hz=10.6)
    assert peak.acceleration == pytest.approx(3.7, rel=2e-4)
    assert peak.frequency_hz == pytest.approx(frequency_hz, abs=1e-3)
    assert peak.background < 1e-5


def test_noise_has_no_peak():
    noise = np.random.default_rng(0).normal(size=9600)
    assert spectral.spectral_peak(noise, RATE_HZ, low_hz=7.8, high_hz=10.6) is None


def test_silence_has_no_peak():
    assert spectral.spectral_peak(np.zeros(9600), RATE_HZ, low_hz=7.8, high_hz=10.6) is None


def test_the_bias_is_equation_9_of_the_peaks():
    motion = rigid_body.together(
        rigid_body.sine(1, duration_s=12.0), rigid_body.sine(5, duration_s=12.0, bias_deg=0.05)
    )
    record = rigid_body.record(motion, rng=np.random.default_rng(2))
    estimate = spectral.estimate_bias(task_of(record, TABLE_1))
    frequency = estimate.settings["mode_frequencies_hz"]
    peaks = estimate.settings["peak_accelerations_m_s2"]
    assert sorted(peaks) == [1, 5]
    radii = [rigid_body.TABLE[number][2] for number in (1, 5)]
    expected = bias_from_acceleration([peaks[1], peaks[5]], [frequency[1], frequency[5]], radii)
    assert estimate.addition[0] == pytest.approx(-expected, rel=1e-4)
    left, std = left_and_std(record, estimate)
    assert np.max(np.abs(left)) < 0.0005
    assert np.max(np.abs(left)) < np.min(std)


def test_rows_of_a_changing_vibration_are_uncertain_by_as_much():
    motion = rigid_body.sine(1, modulation_hz=0.25, duration_s=24.0)
    record = rigid_body.record(motion, rng=np.random.default_rng(2))
    left, std = left_and_std(record, spectral.estimate_bias(task_of(record, TABLE_1)))
    assert np.mean(left) == pytest.approx(0.0, abs=0.005)
    assert np.max(np.abs(left)) > 0.05
    np.testing.assert_allclose(np.abs(left), std, atol=0.002)


def test_a_turning_that_no_sting_allows_corrects_nothing():
    """Mode 1's shape driven at mode 3's 19.5 Hz: by mode 3's radius a turning of several deg."""
    motion = rigid_body.sine(1, frequency_hz=19.5, bias_deg=0.0125)
    record = rigid_body.record(motion, rng=np.random.default_rng(1))
    estimate = spectral.estimate_bias(task_of(record, TABLE_1))
    assert not estimate.addition.any()
    assert "no mode stands out" in estimate.why
    left, std = left_and_std(record, estimate)
    assert (np.abs(left) < std).all()


def test_a_radius_that_the_second_harmonic_denies_is_doubted():
    """Mode 1's shape driven at mode 5's 29.8 Hz: the survey's radius has the wrong sign there."""
    record = rigid_body.record(rigid_body.sine(1, frequency_hz=29.8, bias_deg=0.02))
    left, std = left_and_std(record, spectral.estimate_bias(task_of(record, TABLE_1)))
    assert (np.abs(left) > 0.05).all()
    assert (np.abs(left) < 1.5 * std).all()


def test_what_it_lacks_is_said():
    record = rigid_body.record(rigid_body.sine(1, duration_s=8.0))
    assert spectral.missing(task_of(record)).startswith("the mode of each plane")
    assert spectral.missing(task_of(record, TABLE_1)) is None


def test_a_resonance_that_the_survey_does_not_list_is_named_and_counts(monkeypatch):
    monkeypatch.setitem(rigid_body.TABLE, 7, ("yaw", 14.5, 0.3))
    motion = rigid_body.together(
        rigid_body.sine(1, duration_s=12.0), rigid_body.sine(7, duration_s=12.0, bias_deg=0.05)
    )
    record = rigid_body.record(motion, rng=np.random.default_rng(4))
    estimate = spectral.estimate_bias(task_of(record, TABLE_1))
    left, std = left_and_std(record, estimate)
    assert np.abs(left.mean()) > 0.04
    assert np.max(np.abs(left) / std) < 1.96
    assert estimate.why.endswith("; no mode lists 14.5 Hz")
