import dataclasses

import numpy as np
import pytest
from column_fits import bar_fields, fitted, noise_model, rows_of, slopes, straight_line
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import brentq
from scipy.special import ndtr
from skimage.feature import hessian_matrix
from synthetic import line_fields

from glint_aoa.optical.bar import AsymmetricBar, fit_bars
from glint_aoa.optical.bound import centre_information, pixel_variance, slope_std_bound
from glint_aoa.optical.detect import find_glint
from glint_aoa.optical.estimator import Sample
from glint_aoa.optical.pooling import over_fields, shrunk
from glint_aoa.optical.steger import StegerEstimator, learn, line_taps
from glint_aoa.setup import Glint

DEGREES = np.degrees(27.5 / 11.7)  # a line per column, as an angle
COLUMNS = np.arange(10, 752, 20)


@pytest.mark.parametrize(("sigma", "limit"), [(0.7, 4e-3), (1.0, 3e-4), (1.4, 1e-4), (4.0, 1e-4)])
def test_pixel_locking_is_as_small_as_stated(sigma, limit):
    row = 30 + np.linspace(-0.5, 0.5, 41)
    found, rows, _, estimator = straight_line(
        learn,
        n_fields=41,
        shape=(60, 60),
        step=20,
        row=row,
        slope=0.0,
        sigma=sigma,
        peak=40_000,
        white=65_535,
        dtype=np.uint16,
    )
    assert np.abs(found.row - rows).max() < limit
    assert estimator.bar.scale == pytest.approx(sigma, rel=0.01)


@pytest.mark.parametrize("step", [1, 20])
def test_noise_is_near_the_bound(step):
    """In read noise the filter is the best one; along the line it takes in further columns."""
    n, sigma, peak, read_noise = 300, 1.4, 40.0, 3.0
    columns = np.arange(step // 2, 200, step)
    fields = line_fields(
        np.random.default_rng(1), n_fields=n, shape=(40, 200), row=20.3, slope=0.004, sigma=sigma,
        peak=peak, read_noise=read_noise,
    )  # fmt: skip
    rows = rows_of(20.3, 0.004, columns, n, 200)
    noise = noise_model(read_noise=read_noise)
    found, _ = fitted(learn, fields, rows, columns=columns, noise=noise)
    away = np.arange(40)[:, None] - rows[0]
    image = 10 + peak * np.exp(-0.5 * (away / sigma) ** 2)
    variance = pixel_variance(image, read_noise=read_noise, electrons_per_grey=40_000 / 255)
    information = centre_information((image - 10) * away / sigma**2, variance)
    ratio = slopes(found.row, columns).std(ddof=1) / slope_std_bound(information, columns)
    if step == 1:
        assert 0.9 < ratio < 1.1
    else:  # the filter takes as much as 2 sqrt(pi) sigma columns hold
        assert 0.85 < ratio * np.sqrt(2 * np.sqrt(np.pi) * sigma) < 1.2


def test_columns_stay_independent():
    n = 400
    columns = np.arange(4, 200, 4)
    fields = line_fields(
        np.random.default_rng(2), n_fields=n, shape=(40, 200), row=20.3, slope=0.0, sigma=2.0
    )
    rows = rows_of(20.3, 0.0, columns, n, 200)
    found, _ = fitted(learn, fields, rows, columns=columns, noise=noise_model())
    error = found.row - found.row.mean(axis=0)
    neighbours = np.mean(error[:, 1:] * error[:, :-1]) / np.mean(error**2)
    assert abs(neighbours) < 4 / np.sqrt(error[:, 1:].size)


def test_points_agree_with_filters_of_scipy_and_scikit_image():
    """Zero of the derivative across the line, from their derivatives, on a line at 20 degrees."""
    scale, slope = 2.0, 0.36
    u, v = np.arange(81) - 40.0, np.arange(81)[:, None]
    away = (v - 40.3 - slope * u) / np.hypot(1, slope)
    field = np.round(20_000 * np.exp(-0.5 * (away / 2.0) ** 2)).astype(np.uint16)
    columns = np.array([40])
    shape = dataclasses.replace(find_glint(field[None], Glint()), half_width=6.0)
    none = np.zeros(1)
    estimator = StegerEstimator(
        shape, noise_model(white=65_535), AsymmetricBar(1.0, 1.9), scale, columns, none
    )
    found = estimator.centres(field[None], columns, np.array([[40.0]]))

    grey = field.astype(float)
    h_yy, h_xy, h_xx = (
        h[:, 40]
        for h in hessian_matrix(grey, sigma=scale, order="rc", use_gaussian_derivatives=True)
    )
    smooth = gaussian_filter1d(grey, scale, axis=1)
    g_y = gaussian_filter1d(smooth, scale, axis=0, order=1)[:, 40]
    g_x = gaussian_filter1d(
        gaussian_filter1d(grey, scale, axis=1, order=1), scale, axis=0
    )[:, 40]  # fmt: skip
    row = np.arange(81)
    middle = int(np.argmax(smooth[:, 40]))
    _, vectors = np.linalg.eigh(
        np.array([[h_xx[middle], h_xy[middle]], [h_xy[middle], h_yy[middle]]])
    )
    across = vectors[:, 0]  # of the most negative curvature
    expected = brentq(
        lambda y: np.interp(y, row, g_x * across[0] + g_y * across[1]), middle - 1, middle + 1
    )
    assert found.row[0, 0] == pytest.approx(expected, abs=0.01)
    assert found.row[0, 0] == pytest.approx(40.3, abs=0.01)
    assert np.arctan(-across[0] / across[1]) == pytest.approx(np.arctan(slope), abs=0.01)


def test_taps_return_slope_and_curvature():
    taps = line_taps(1.4)
    reach = taps.shape[0] - 1
    u = np.arange(-reach, reach + 1)
    for order, series in enumerate(([7, 0, 0], [0, 3, 0], [0, 0, 5])):
        line = series[0] + series[1] * u + series[2] * u**2 / 2
        told = taps[-1] @ line
        assert told[order] == pytest.approx(series[order])
        if order < 2:
            assert told[2] == pytest.approx(0, abs=1e-12)
    np.testing.assert_array_equal(taps[0, 0], u == 0)
    assert not taps[0, 1:].any()


@pytest.mark.parametrize("asymmetry", [-0.4, -0.1, 0.2, 0.6])
@pytest.mark.parametrize("half_width", [0.5, 2.0])
def test_bias_of_a_bar_is_that_of_the_paper(half_width, asymmetry):
    """-(S^2 / 2w) ln(1 - a), and where the filtered bar itself is highest."""
    bar = AsymmetricBar(half_width, 0.8)
    total = np.sqrt(0.8**2 + 1.5**2 + 2 / 12)
    found = bar.bias(np.array([100.0]), np.array([100 * asymmetry]), np.zeros(1), filter_scale=1.5)
    assert found[0] == pytest.approx(-(total**2) / (2 * half_width) * np.log1p(-asymmetry))
    y = np.linspace(-4, 4, 80_001)
    response = ndtr((y + half_width) / total) + (asymmetry - 1) * ndtr((y - half_width) / total)
    assert found[0] == pytest.approx(y[np.argmax(response)], abs=1e-3)


@pytest.mark.parametrize(("half_width", "blur", "height"), [(1.5, 1.0, 120), (2.5, 0.8, 120)])
def test_different_backgrounds_do_not_turn_the_line(half_width, blur, height):
    """A step that reverses along the line turns Steger's points by 0.06 deg and more."""
    step = 30 * np.linspace(-1, 1, 752)
    fields, rows = bar_fields(
        np.random.default_rng(3), half_width=half_width, blur=blur, height=height, step=step
    )
    rows = rows[:, COLUMNS]
    found, estimator = fitted(
        learn, fields, rows, columns=COLUMNS, noise=noise_model(), glint=Glint(half_width=5.5)
    )
    error = slopes(found.row - rows, COLUMNS).mean() * DEGREES
    plain = slopes(found.row - rows + estimator.bias, COLUMNS).mean() * DEGREES
    assert plain > 0.06
    assert abs(error) < 0.015 * plain
    assert estimator.bar.half_width == pytest.approx(half_width, rel=0.02)
    assert estimator.bar.blur == pytest.approx(blur, rel=0.03)


def test_bars_are_fitted_with_their_uncertainty():
    step = np.full(752, 20.0)
    fields, rows = bar_fields(
        np.random.default_rng(4), half_width=1.5, blur=1.0, height=120, step=step, slope=0.011
    )
    shape = find_glint(fields[:7], Glint(half_width=5.5))
    bars = fit_bars(Sample(fields, COLUMNS, rows[:, COLUMNS]), shape)
    error = bars.step - 20
    std = np.sqrt(bars.covariance[:, 0, 0])
    assert abs(error.mean()) < 0.5
    assert np.mean((error / std) ** 2) == pytest.approx(1, abs=0.9)
    shift, variance = bars.bias(1.4)
    assert shift.std() < 2 * np.sqrt(variance.mean())


def test_dark_line_is_the_bright_one_turned_over():
    fields = line_fields(np.random.default_rng(5), n_fields=9, row=40.3)
    rows = rows_of(40.3, 0.0, COLUMNS, 9)
    bright, _ = fitted(learn, fields, rows, columns=COLUMNS, noise=noise_model())
    dark, _ = fitted(
        learn,
        255 - fields,
        rows,
        columns=COLUMNS,
        noise=noise_model(),
        glint=Glint(polarity="dark"),
    )
    np.testing.assert_allclose(dark.row, bright.row, atol=1e-4)
    np.testing.assert_allclose(dark.height, bright.height, rtol=1e-3)


def test_height_is_that_of_the_line():
    found, *_ = straight_line(learn, np.random.default_rng(6), peak=170.0, slope=0.0)
    assert found.height.mean() == pytest.approx(170, rel=0.01)
    assert not found.clipped.any()


def test_clipped_columns_are_named():
    found, *_ = straight_line(learn, np.random.default_rng(7), peak=400.0)
    assert found.clipped.all()


def test_a_line_near_the_edge_is_measured_and_one_beyond_it_is_cut():
    fields = line_fields(np.random.default_rng(8), n_fields=9, shape=(40, 752), slope=0.055, row=20)
    rows = rows_of(20, 0.055, COLUMNS, 9)
    found, estimator = fitted(learn, fields, rows, columns=COLUMNS, noise=noise_model())
    half = estimator.shape.half_width
    inside = (rows > half) & (rows < 39 - half)
    assert ((rows < 4 * estimator.scale + 1) & inside).any()
    assert np.isfinite(found.row[inside]).all()
    assert np.abs(found.row - rows)[inside].max() < 0.1
    outside = (rows < half - 1) | (rows > 40 - half)
    assert found.cut[outside].all()
    assert np.isnan(found.row[outside]).all()


def test_nothing_is_made_of_nothing():
    fields = line_fields(np.random.default_rng(9), n_fields=9, row=40.3)
    rows = rows_of(40.3, 0.0, COLUMNS, 9)
    _, estimator = fitted(learn, fields, rows, columns=COLUMNS, noise=noise_model())
    assert np.isnan(estimator.centres(np.full_like(fields, 77), COLUMNS, rows).row).all()
    nowhere = estimator.centres(fields, COLUMNS, np.full(rows.shape, np.nan))
    assert np.isnan(nowhere.row).all()
    assert not nowhere.cut.any()
    blind = learn(Sample(fields, COLUMNS, np.full(rows.shape, np.nan)), estimator.shape, None)
    assert blind.bias.tolist() == [0.0] * COLUMNS.size


def test_columns_that_differ_by_noise_only_get_one_figure():
    rng = np.random.default_rng(10)
    variance = np.full(60, 0.04)
    value, common = shrunk(3 + rng.normal(0, 0.2, 60), variance)
    np.testing.assert_allclose(value, common)
    assert common == pytest.approx(3, abs=0.15)
    truth = rng.normal(3, 2.0, 60)
    value, _ = shrunk(truth + rng.normal(0, 0.2, 60), variance)
    np.testing.assert_allclose(value, truth, atol=0.8)


def test_spread_between_fields_is_what_noise_leaves():
    rng = np.random.default_rng(11)
    variance = rng.uniform(0.5, 2.0, (64, 40))
    own = rng.normal(0, 5, 40)
    value = own + rng.normal(0, 1.5, (64, 40)) + rng.normal(0, np.sqrt(variance))
    pooled = over_fields(value, variance)
    assert pooled.spread == pytest.approx(1.5**2, rel=0.1)
    np.testing.assert_allclose(pooled.value, own, atol=1.2)
    value[:, 0] = np.nan
    assert np.isnan(over_fields(value, variance).value[0])
    assert np.isinf(over_fields(value[:1], variance[:1]).spread)
