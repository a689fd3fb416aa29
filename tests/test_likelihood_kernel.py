"""The compiled restricted likelihood against NumPy's linear algebra and finite differences."""

import numpy as np
import pytest

from glint_aoa.optical._likelihood_kernel import restricted_likelihood

N_FIELDS = 30
LAG = np.arange(N_FIELDS)
COVARIANCE = np.exp(-0.002 * LAG**2) * np.cos(0.9 * LAG) + 1e-4 * (LAG == 0)
PLACES = {"whole": LAG, "gaps": np.delete(LAG, [4, 5, 17])}


def record(place):
    trend = np.stack([np.ones(place.size), np.linspace(-1, 1, place.size)], axis=1)
    angle = np.random.default_rng(1).normal(size=N_FIELDS)[place]
    return place, trend, angle


def compiled(covariance, place, trend, angle):
    projector, by_lag = np.empty((place.size, place.size)), np.empty(N_FIELDS)
    cost = restricted_likelihood(covariance, place, trend, angle, projector, by_lag)
    return cost, projector, by_lag


def plain(covariance, place, trend, angle):
    matrix = covariance[np.abs(place[:, None] - place)]
    half = np.linalg.solve(matrix, trend)
    normal = trend.T @ half
    projector = np.linalg.inv(matrix) - half @ np.linalg.solve(normal, half.T)
    log_det = np.linalg.slogdet(matrix)[1] + np.linalg.slogdet(normal)[1]
    return (log_det + angle @ projector @ angle) / 2, projector


@pytest.mark.parametrize("kind", PLACES)
def test_likelihood_and_projector_are_those_of_plain_linear_algebra(kind):
    given = record(PLACES[kind])
    cost, projector, _ = compiled(COVARIANCE, *given)
    wanted_cost, wanted = plain(COVARIANCE, *given)
    assert cost == pytest.approx(wanted_cost, rel=1e-9)
    np.testing.assert_allclose(projector, wanted, atol=1e-8 * np.abs(wanted).max())
    np.testing.assert_allclose(projector @ given[1], 0, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize("kind", PLACES)
def test_derivatives_are_those_of_finite_differences(kind):
    given = record(PLACES[kind])
    by_lag = compiled(COVARIANCE, *given)[2]
    step = 1e-7
    for lag in (0, 1, 7, N_FIELDS - 1):
        moved = step * (lag == LAG)
        ends = [compiled(COVARIANCE + sign * moved, *given)[0] for sign in (1, -1)]
        assert by_lag[lag] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-3, abs=1e-3)


@pytest.mark.parametrize("kind", PLACES)
def test_no_covariance_is_infinitely_unlikely(kind):
    """A correlation of 0.9 with the next field and of -0.9 with the one after cannot be."""
    covariance = np.where(LAG == 0, 1.0, 0.0)
    covariance[1:3] = 0.9, -0.9
    assert compiled(covariance, *record(PLACES[kind]))[0] == np.inf
