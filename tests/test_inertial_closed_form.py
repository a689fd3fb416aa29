"""The methods against the closed form of one mode, to 0.1 %."""

import closed_form
import numpy as np
import pytest

from glint_aoa.inertial import harmonic, nlr, regression, spectral
from glint_aoa.inertial.modes import TABLE_1

SETTLED = slice(1600, -1600)  # 2 s: what the low-pass and the bands remember of the ends


def mean(values):
    return float(np.mean(values[SETTLED]))


@pytest.mark.parametrize("angle", [0.0, 0.1])
@pytest.mark.parametrize("mode", TABLE_1, ids=lambda mode: f"mode {mode.number}")
@pytest.mark.parametrize("method", [nlr, spectral, harmonic])
def test_a_sine(method, mode, angle):
    task, bias = closed_form.task(mode, angle=angle)
    assert method.missing(task) is None
    estimate = method.estimate_bias(task)
    assert mean(estimate.addition) == pytest.approx(mean(bias), rel=1e-3)


@pytest.mark.parametrize("mode", TABLE_1, ids=lambda mode: f"mode {mode.number}")
@pytest.mark.parametrize("method", [nlr, harmonic, regression])
def test_a_modulated_sine(method, mode):
    task, bias = closed_form.task(mode, depth=0.6)
    assert method.missing(task) is None
    estimate = method.estimate_bias(task)
    assert mean(estimate.addition) == pytest.approx(mean(bias), rel=1e-3)


def test_the_spectrum_gives_the_mean_of_a_modulated_sine():
    task, bias = closed_form.task(TABLE_1[0], depth=0.6)
    estimate = spectral.estimate_bias(task)
    assert estimate.addition[0] == pytest.approx(bias.mean(), rel=1e-3)
    assert np.ptp(estimate.addition) == 0
