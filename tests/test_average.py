import numpy as np
import pytest

from glint_aoa.optical.average import mean_angle

TIME = np.arange(60) / 60


def test_a_constant_angle_is_its_own_mean():
    for method in ("auto", "plain", "tapered"):
        got = mean_angle(np.full(60, 1.25), method=method)
        assert got.mean == pytest.approx(1.25, abs=1e-14)
        assert got.std == pytest.approx(0, abs=1e-14)


def test_plain_is_the_arithmetic_mean_without_the_missing():
    angle = np.random.default_rng(1).normal(size=60)
    angle[[3, 30]] = np.nan
    got = mean_angle(angle, method="plain")
    assert got.mean == pytest.approx(np.nanmean(angle), abs=1e-14)


def test_noise_alone_keeps_the_plain_mean_and_its_standard_error():
    rng = np.random.default_rng(2)
    drawn = [mean_angle(rng.normal(0, 0.001, 60)) for _ in range(300)]
    assert {each.method for each in drawn} == {"plain"}
    true_std = 0.001 / np.sqrt(60)
    assert np.sqrt(np.mean([each.std**2 for each in drawn])) == pytest.approx(true_std, rel=0.1)


@pytest.mark.parametrize("frequency", [7.3, 9.2, 9.8, 12.35, 20.3, 24.7])
def test_a_vibration_that_does_not_close_is_tapered_away(frequency):
    """0.28 deg leaks up to 0.006 deg into a plain mean; the taper leaves the noise."""
    rng = np.random.default_rng(3)
    drawn = []
    for phase in np.linspace(0, 2 * np.pi, 60, endpoint=False):
        noise = rng.normal(0, 0.0008, 60)
        drawn.append(mean_angle(0.28 * np.sin(2 * np.pi * frequency * TIME + phase) + noise))
    assert {each.method for each in drawn} == {"tapered"}
    error = np.array([each.mean for each in drawn])
    assert error.std() < 0.0003
    stated = np.array([each.std for each in drawn])
    assert 0.7 < np.sqrt(np.mean(stated**2)) / error.std() < 2.5


def test_the_leak_of_the_plain_mean_is_predicted():
    frequency, amplitude = 9.2, 0.28
    phases = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    drawn = [
        mean_angle(amplitude * np.sin(2 * np.pi * frequency * TIME + phase), method="plain")
        for phase in phases
    ]
    leak = amplitude * abs(np.sin(np.pi * frequency) / (60 * np.sin(np.pi * frequency / 60)))
    assert np.std([each.mean for each in drawn]) == pytest.approx(leak / np.sqrt(2), rel=1e-6)
    assert np.mean([each.std for each in drawn]) == pytest.approx(leak / np.sqrt(2), rel=0.3)


def test_few_fields_and_none():
    got = mean_angle([1.0, 2.0, 3.0])
    assert (got.mean, got.method) == (2.0, "plain")
    assert got.std == pytest.approx(1 / np.sqrt(3))
    assert np.isnan(mean_angle([np.nan] * 5).mean)
    assert np.isnan(mean_angle([1.0]).std)


def test_expanded_uncertainty_adds_the_systematic_part():
    got = mean_angle([1.0, 2.0, 3.0])
    assert got.expanded(2.0) == pytest.approx(1.96 * np.hypot(got.std, 2.0))
