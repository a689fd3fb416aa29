import re

import numpy as np
import pytest
import scipy.signal

from glint_aoa.errors import InputError
from glint_aoa.inertial.least_squares import fit_line

RATE_HZ = 20.0


def slow_noise(rng, size):
    """White noise behind a 0.4 Hz low-pass, of unit variance."""
    sections = scipy.signal.butter(2, 0.4, fs=RATE_HZ, output="sos")
    noise = scipy.signal.sosfiltfilt(sections, rng.normal(size=size + 400))[200:-200]
    return noise / noise.std()


def test_coefficients_are_those_of_numpy():
    rng = np.random.default_rng(0)
    x1, x2, error = rng.normal(size=(3, 500))
    x2 = 1e6 * x2 + 3e6
    y = 2 + 3 * x1 - 1e-6 * x2 + 0.1 * error
    fit = fit_line(y, [x1, x2], RATE_HZ)
    design = np.stack([np.ones(500), x1, x2], axis=1)
    expected, left, *_ = np.linalg.lstsq(design, y, rcond=None)
    np.testing.assert_allclose([fit.intercept, *fit.coefficient], expected, rtol=1e-9)
    assert fit.standard_error == pytest.approx(np.sqrt(left[0] / 497), rel=1e-9)
    np.testing.assert_allclose(fit.residual, y - design @ expected, atol=1e-9)
    assert fit.explained == pytest.approx(1 - left[0] / np.sum((y - y.mean()) ** 2), rel=1e-9)


def test_standard_errors_cover_slow_errors():
    """Of slow noise on a modulated regressor, 95 % intervals hold the truth 93 to 97 % of times."""
    rng = np.random.default_rng(1)
    size = 1200
    x = np.cos(2 * np.pi * 0.05 * np.arange(size) / RATE_HZ) + slow_noise(rng, size)
    held, held_mean = [], []
    for _ in range(600):
        fit = fit_line(1.0 + 0.5 * x + 0.2 * slow_noise(rng, size), [x], RATE_HZ)
        held.append(abs(fit.coefficient[0] - 0.5) < 1.96 * fit.coefficient_std[0])
        held_mean.append(abs(fit.intercept - 1.0) < 1.96 * fit.intercept_std)
    assert 0.93 <= np.mean(held) <= 0.97
    assert 0.93 <= np.mean(held_mean) <= 0.97


def test_only_the_samples_chosen_are_fitted():
    x = np.arange(100.0)
    y = np.where(x < 50, 2 * x, 500.0)
    fit = fit_line(y, [x], RATE_HZ, use=x < 50)
    assert fit.coefficient[0] == pytest.approx(2.0, rel=1e-12)
    assert fit.residual[-1] == pytest.approx(500 - 2 * 99, rel=1e-9)


def test_a_regressor_that_stands_still_is_unknown():
    fit = fit_line(np.sin(np.arange(100)), [np.full(100, 3.0)], RATE_HZ)
    assert fit.coefficient[0] == 0.0
    assert fit.coefficient_std[0] == np.inf
    assert fit.explained == pytest.approx(0.0, abs=1e-12)


def test_without_regressors_the_mean_is_left():
    fit = fit_line([1.0, 2.0, 3.0, 6.0], [], RATE_HZ)
    assert fit.intercept == pytest.approx(3.0)
    assert fit.coefficient.size == 0


def test_too_few_samples_are_refused():
    message = "4 samples are too few to fit 1 regressors; give at least 5"
    with pytest.raises(InputError, match=re.escape(message)):
        fit_line(np.ones(4), [np.arange(4.0)], RATE_HZ)
