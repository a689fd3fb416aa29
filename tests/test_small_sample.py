"""The variance of a mean whose covariance was learnt from the same record."""

import numpy as np
import pytest
from scipy import linalg, optimize

from glint_aoa.coverage import ONE_SIGMA, coverage_factor
from glint_aoa.optical._small_sample import LearntVariance
from glint_aoa.optical.vibration import Vibration, fit_vibration

LAGS = np.arange(30)
TREND = np.stack([np.ones(30), np.linspace(-1, 1, 30)], axis=1)
THETA = np.array([-0.3, 0.4, 0.1])


def covariance(theta):
    """White noise and a line [lag]; parameters: log variances, and cycles over 4.2 a record."""
    noise = np.exp(theta[0]) * (LAGS == 0)
    line = np.exp(theta[1] - 0.002 * LAGS**2)
    return noise + line * np.cos(2 * np.pi * (4.2 + theta[2]) / 30 * LAGS)


def weights(theta):
    inverse = np.linalg.inv(linalg.toeplitz(covariance(theta)))
    return np.linalg.solve(TREND.T @ inverse @ TREND, TREND.T @ inverse)[0]


def learnt(uncertainty, angle=None):
    angle = np.zeros(30) if angle is None else angle
    changes = optimize.approx_fprime(THETA, covariance, 1e-7).T
    vibration = Vibration((), covariance(THETA), TREND, changes, uncertainty)
    return LearntVariance.of_vibration(vibration, LAGS, angle)


def test_students_t_is_that_of_the_tables():
    assert coverage_factor(np.inf, ONE_SIGMA) == pytest.approx(1.0, abs=1e-12)
    assert coverage_factor(1, ONE_SIGMA) == pytest.approx(1.8373, abs=1e-4)
    assert coverage_factor(10, ONE_SIGMA) == pytest.approx(1.0526, abs=1e-4)
    assert coverage_factor(10) == pytest.approx(2.2281, abs=1e-4)
    assert coverage_factor(0.2) == coverage_factor(1)  # nothing is known worse than from two values


def test_white_noise_has_the_textbooks_variance_and_degrees_of_freedom():
    angle = np.random.default_rng(0).normal(size=40)
    vibration = fit_vibration(angle)
    assert not vibration.lines
    own, gls = LearntVariance.of_vibration(vibration, np.arange(40), angle)
    line = np.polyfit(np.arange(40), angle, 1)
    residual = angle - np.polyval(line, np.arange(40))
    variance, dof = own.of(gls, learnt=True)
    assert variance == pytest.approx(residual @ residual / 38 / 40, rel=1e-4)
    assert dof == pytest.approx(38, rel=0.01)


def test_weights_are_those_of_generalised_least_squares():
    _, gls = learnt(np.eye(3))
    np.testing.assert_allclose(gls, weights(THETA), atol=1e-12)


def test_what_uncertain_weights_add_is_twice_the_variance_of_their_changes():
    """Their changes by finite differences, and Kenward and Roger's factor of two."""
    uncertainty = np.array([[0.05, 0.01, 0.0], [0.01, 0.3, 0.02], [0.0, 0.02, 0.01]])
    own, gls = learnt(uncertainty)
    slope = optimize.approx_fprime(THETA, weights, 1e-7)
    spread = slope.T @ linalg.toeplitz(covariance(THETA)) @ slope
    added = own.of(gls, learnt=True)[0] - own.of(gls, learnt=False)[0]
    assert added == pytest.approx(2 * np.sum(uncertainty * spread), rel=1e-3)


def test_degrees_of_freedom_are_satterthwaites():
    uncertainty = np.diag([0.05, 0.3, 0.01])
    own, _ = learnt(uncertainty)
    plain = np.full(30, 1 / 30)

    def variance(theta):
        return plain @ linalg.toeplitz(covariance(theta)) @ plain

    slope = optimize.approx_fprime(THETA, variance, 1e-7)
    got, dof = own.of(plain, learnt=False)
    assert got == pytest.approx(variance(THETA), rel=1e-9)
    assert dof == pytest.approx(2 * got**2 / (slope @ uncertainty @ slope), rel=1e-4)


def test_a_drift_that_weights_do_not_balance_counts_as_an_error():
    own, _ = learnt(np.zeros((3, 3)), angle=0.5 * TREND[:, 1])
    early = np.where(LAGS < 10, 0.1, 0.0)
    kept = early @ (0.5 * TREND[:, 1])
    still, _ = learnt(np.zeros((3, 3)))
    variance, dof = own.of(early, learnt=False)
    assert variance == pytest.approx(still.of(early, learnt=False)[0] + kept**2, rel=1e-6)
    assert np.isinf(dof)
