"""What the package shows of a predicted bias, against signals made up of known parts."""

import numpy as np
import pytest

from glint_aoa.inertial.consistency import shown_by_package

RATE_HZ = 800.0
TIME = np.arange(16000) / RATE_HZ
BAND = {"low_hz": 18.0, "high_hz": 21.0}
PREDICTED = 0.02 * (1 + np.cos(2 * np.pi * 19.6 * TIME))


def shown(force):
    return shown_by_package(force, PREDICTED, RATE_HZ, **BAND)


@pytest.mark.parametrize("fraction", [1.0, 0.25, 0.0, -0.5])
def test_the_fraction_that_is_there_is_found(fraction):
    force = 0.7 - fraction * PREDICTED + 0.05 * np.cos(2 * np.pi * 9.8 * TIME)
    found, std = shown(force)
    assert found == pytest.approx(fraction, abs=1e-6)
    assert std < 1e-3


def test_what_is_out_of_step_is_told_apart():
    found, _ = shown(-PREDICTED + 0.01 * np.sin(2 * np.pi * 19.6 * TIME))
    assert found.real == pytest.approx(1.0, abs=1e-6)
    assert found.imag == pytest.approx(0.5, abs=1e-6)


def test_the_standard_deviation_is_the_scatter_under_noise():
    rng = np.random.default_rng(1)
    draws = [shown(-PREDICTED + 0.02 * rng.standard_normal(TIME.size)) for _ in range(200)]
    scatter = np.std([found.real for found, _ in draws])
    assert np.mean([std for _, std in draws]) == pytest.approx(scatter, rel=0.2)


def test_nothing_predicted_shows_nothing():
    found, std = shown_by_package(PREDICTED, np.zeros(TIME.size), RATE_HZ, **BAND)
    assert np.isnan(found)
    assert std == np.inf
