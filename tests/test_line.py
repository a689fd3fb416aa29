import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.optical.line import fit_lines, fit_lines_robustly

S = np.linspace(-0.17, 0.17, 38)


def lines(slope, intercept, noise=0.0, rng=None):
    slope, intercept = np.atleast_1d(slope), np.atleast_1d(intercept)
    z = intercept[:, None] + slope[:, None] * S
    if noise:
        z = z + rng.normal(0, noise, z.shape)
    return np.broadcast_to(S, z.shape), z


def test_weighted_fit_is_numpys():
    rng = np.random.default_rng(1)
    s, z = lines([0.1], [0.02], 1e-3, rng)
    std = rng.uniform(0.7, 1.4, 38)
    fit = fit_lines(s, z, std)
    (slope, intercept), covariance = np.polyfit(S, z[0], 1, w=1 / std, cov="unscaled")
    assert fit.slope[0] == pytest.approx(slope, rel=1e-10)
    assert fit.intercept[0] == pytest.approx(intercept, rel=1e-10)
    assert fit.slope_var[0] == pytest.approx(covariance[0, 0], rel=1e-10)
    assert fit.intercept_var[0] == pytest.approx(covariance[1, 1], rel=1e-10)


@given(slope=st.floats(-0.3, 0.3), intercept=st.floats(-0.1, 0.1))
def test_an_exact_line_is_found(slope, intercept):
    s, z = lines(slope, intercept)
    fit = fit_lines_robustly(s, z, np.full(38, 1e-5), np.zeros(38))
    assert fit.slope[0] == pytest.approx(slope, abs=1e-12)
    assert fit.intercept[0] == pytest.approx(intercept, abs=1e-13)


@given(slope=st.floats(-0.3, 0.3))
def test_a_mirrored_line_has_the_negated_slope(slope):
    rng = np.random.default_rng(5)
    s, z = lines(slope, 0.01, 1e-5, rng)
    std, usual = np.full(38, 1e-5), np.zeros(38)
    ahead, back = (fit_lines_robustly(s, each, std, usual) for each in (z, z[:, ::-1]))
    assert back.slope[0] == pytest.approx(-ahead.slope[0], abs=1e-12)


def test_clean_data_lose_nothing():
    rng = np.random.default_rng(2)
    s, z = lines(np.full(2000, 0.1), 0.0, 1e-5, rng)
    plain = fit_lines(s, z, np.full(38, 1e-5))
    robust = fit_lines_robustly(s, z, np.full(38, 1e-5), np.zeros(38))
    assert robust.slope.std() < 1.005 * plain.slope.std()
    assert robust.slope.std() == pytest.approx(np.sqrt(plain.slope_var[0]), rel=0.05)


def test_a_third_of_the_columns_may_be_wrong():
    rng = np.random.default_rng(3)
    s, z = lines(np.full(200, 0.05), 0.01, 1e-5, rng)
    z[:, 20:32] += rng.uniform(2e-4, 5e-3, (200, 12))
    fit = fit_lines_robustly(s, z, np.full(38, 1e-5), np.zeros(38))
    clean = np.delete(np.arange(38), np.arange(20, 32))
    expected = fit_lines(s[:, clean], z[:, clean], np.full(26, 1e-5))
    np.testing.assert_allclose(fit.slope, expected.slope, atol=3e-5)
    assert (fit.weight[:, 20:32] == 0).all()


def test_a_columns_usual_departure_is_not_outlying():
    rng = np.random.default_rng(4)
    s, z = lines(np.full(50, 0.05), 0.01, 1e-5, rng)
    usual = np.zeros(38)
    usual[7] = 2e-3
    z += usual
    with_usual = fit_lines_robustly(s, z, np.full(38, 1e-5), usual)
    assert (with_usual.weight[:, 7] > 0).all()
    without = fit_lines_robustly(s, z, np.full(38, 1e-5), np.zeros(38))
    assert (without.weight[:, 7] == 0).all()


def test_missing_points_and_empty_rows():
    s, z = lines([0.1, 0.1], [0.0, 0.0])
    z = z.copy()
    z[0, ::2] = np.nan
    z[1] = np.nan
    fit = fit_lines_robustly(s, z, np.full(38, 1e-5), np.zeros(38))
    assert fit.slope[0] == pytest.approx(0.1, abs=1e-12)
    assert np.isnan(fit.slope[1])
    assert (fit.weight[0] > 0).sum() == 19
