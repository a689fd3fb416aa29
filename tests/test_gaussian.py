import dataclasses

import numpy as np
import pytest
from column_fits import bar_fields, fitted, noise_model, rows_of, slopes, straight_line
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr
from synthetic import line_fields

from glint_aoa.optical.bound import centre_information, pixel_variance, slope_std_bound
from glint_aoa.optical.detect import find_glint
from glint_aoa.optical.gaussian import GaussianEstimator, learn
from glint_aoa.setup import Glint

DEGREES = np.degrees(27.5 / 11.7)  # a line per column, as an angle


def expected_grey(row, n_lines=60, *, sigma, peak, black=10.0):
    edges = np.arange(n_lines + 1)[:, None] - 0.5
    share = np.diff(ndtr((edges - np.atleast_1d(row)) / sigma), axis=0)
    return black + peak * np.sqrt(2 * np.pi) * sigma * share


def bound_of_slope(rows, columns, *, sigma, peak, read_noise):
    image = expected_grey(rows, sigma=sigma, peak=peak)
    step = 1e-4
    gradient = (expected_grey(rows + step, sigma=sigma, peak=peak) - image) / step
    variance = pixel_variance(image, read_noise=read_noise, electrons_per_grey=40_000 / 255)
    return slope_std_bound(centre_information(gradient, variance), columns)


@pytest.mark.parametrize("sigma", [0.7, 1.4, 4.0])
def test_there_is_no_pixel_locking(sigma):
    """Without noise, 16 bits: right to 0.0001 line at every phase of the line."""
    row = 30 + np.linspace(-0.5, 0.5, 41)
    found, rows, _, _ = straight_line(
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
    assert np.abs(found.row - rows).max() < 1e-4


@pytest.mark.parametrize("sigma", [0.7, 1.4, 4.0])
def test_width_is_learnt(sigma):
    _, _, _, estimator = straight_line(
        learn, np.random.default_rng(1), sigma=sigma, shape=(60, 152), row=30.3
    )
    np.testing.assert_allclose(estimator.width, sigma, rtol=0.005)
    assert estimator.settings["gaussian_width_lines"] == pytest.approx(sigma, rel=0.005)


@pytest.mark.parametrize(
    ("sigma", "peak", "read_noise", "slope"),
    [(0.7, 170.0, 0.7, 0.0005), (1.4, 40.0, 2.0, 0.0), (1.4, 240.0, 0.5, 0.01), (4, 100, 1, 0.0)],
)
def test_noise_is_at_the_bound(sigma, peak, read_noise, slope):
    found, rows, columns, _ = straight_line(
        learn,
        np.random.default_rng(2),
        n_fields=400,
        shape=(60, 152),
        row=30.3,
        sigma=sigma,
        peak=peak,
        read_noise=read_noise,
        slope=slope,
    )
    bound = bound_of_slope(rows[0], columns, sigma=sigma, peak=peak, read_noise=read_noise)
    error = slopes(found.row, columns) - slope
    # The scatter of 400 fields is known to 3.5 %; free tilts and widths cost a few per cent.
    assert error.std(ddof=1) / bound < 1.1
    assert abs(error.mean()) < 4 * bound / np.sqrt(400)


def log_likelihood(figures, grey, noise, sigma, middle):
    """Normal density of each pixel, or the chance that a clipped one lies above the top."""
    height, centre, level, tilt = figures
    line = np.arange(grey.size)
    mean = expected_grey(centre, grey.size, sigma=sigma, peak=height, black=level)[:, 0]
    mean = mean + tilt * (line - middle)
    std = np.sqrt(noise.variance(mean))
    clipped = grey >= noise.saturation
    inside = -0.5 * ((grey - mean) / std) ** 2 - np.log(std)
    beyond = log_ndtr((mean - noise.saturation + 0.5) / std)
    return np.where(clipped, beyond, inside).sum()


@pytest.mark.parametrize("peak", [150.0, 330.0])
def test_it_is_the_maximum_of_the_likelihood(peak):
    """Found again by a general optimiser, clipped pixels included."""
    fields = line_fields(
        np.random.default_rng(3), n_fields=3, shape=(16, 60), row=7.3, slope=0.0, peak=peak
    )
    noise = dataclasses.replace(noise_model(), variance_per_grey=0.0)  # constant: no log(std) term
    columns = np.array([10, 30, 50])
    start = np.full((3, 3), 7.2)
    none = np.zeros(3)
    shape = dataclasses.replace(find_glint(fields, Glint()), half_width=4.5, flank=20.0)
    estimator = GaussianEstimator(shape, noise, columns, none + 1.4, none, none, none)
    found = estimator.centres(fields, columns, start)
    assert found.clipped.all() == (peak > 255)
    for f in range(3):
        for i, column in enumerate(columns):
            grey = fields[f, :, column].astype(float)
            best = minimize(
                lambda x, grey=grey: -log_likelihood(x, grey, noise, 1.4, 7.5),
                [peak, 7.3, 10.0, 0.0],
                method="Nelder-Mead",
                options={"xatol": 1e-6, "fatol": 1e-9, "maxfev": 4000},
            )
            assert found.row[f, i] == pytest.approx(best.x[1], abs=2e-4)
            assert found.height[f, i] == pytest.approx(best.x[0], rel=2e-3)


def test_clipped_lines_stay_unbiased():
    """Up to three clipped lines, where the flat top would otherwise pull the centre."""
    row = 15 + np.linspace(-0.5, 0.5, 400)
    found, rows, _, _ = straight_line(
        learn, np.random.default_rng(4), n_fields=400, row=row, slope=0.001, peak=420.0
    )
    assert found.clipped.all()
    error = found.row - rows
    assert abs(error.mean()) < 4 * error.std() / np.sqrt(error.size)
    # As a function of the phase: no more than the noise of 20 fields of 38 columns.
    phase = error.reshape(20, -1).mean(axis=1)
    assert np.abs(phase).max() < 4 * error.std() / np.sqrt(error.size / 20)


def test_clipped_pixels_tell_something():
    """Their height is still found, though nothing recorded says how bright they were."""
    found, *_ = straight_line(learn, np.random.default_rng(5), peak=400.0)
    assert np.median(found.height) == pytest.approx(400, rel=0.02)


def test_tilted_background_does_not_move_the_centre():
    fields = line_fields(n_fields=9, row=40.3, peak=20_000, white=65_535, dtype=np.uint16)
    fields += (np.arange(92, dtype=np.uint16) * 100)[:, None]
    columns = np.arange(10, 752, 20)
    rows = rows_of(40.3, 0.0, columns, 9)
    found, estimator = fitted(learn, fields, rows, columns=columns, noise=noise_model(white=65_535))
    np.testing.assert_allclose(found.row, rows, atol=5e-4)
    np.testing.assert_allclose(estimator.tilt, 100, atol=1.0)


def test_different_backgrounds_do_not_turn_the_line():
    """A step that reverses along the line turns a plain fit by 0.05 deg."""
    step = 30 * np.linspace(-1, 1, 752)
    fields, rows = bar_fields(
        np.random.default_rng(6), half_width=0.2, blur=1.4, height=900.0, step=step
    )
    columns = np.arange(10, 752, 20)
    rows = rows[:, columns]
    window = Glint(half_width=5.0)
    found, estimator = fitted(
        learn, fields, rows, columns=columns, noise=noise_model(), glint=window
    )
    error = slopes(found.row - rows, columns).mean() * DEGREES
    plain = slopes(found.row - rows + estimator.bias, columns).mean() * DEGREES
    assert abs(plain) > 0.05
    assert abs(error) < 0.02 * abs(plain)


def test_dark_line_is_the_bright_one_turned_over():
    fields = line_fields(np.random.default_rng(7), n_fields=9, row=40.3)
    columns = np.arange(10, 752, 20)
    rows = rows_of(40.3, 0.0, columns, 9)
    even = dataclasses.replace(noise_model(), variance_per_grey=0.0, saturation=1e9)
    bright, _ = fitted(learn, fields, rows, columns=columns, noise=even)
    dark, _ = fitted(
        learn, 255 - fields, rows, columns=columns, noise=even, glint=Glint(polarity="dark")
    )
    np.testing.assert_allclose(dark.row, bright.row, atol=1e-6)
    np.testing.assert_allclose(dark.height, bright.height, rtol=1e-6)


def test_a_start_two_lines_off_is_good_enough():
    fields = line_fields(np.random.default_rng(8), n_fields=9, row=40.3, sigma=0.7)
    columns = np.arange(10, 752, 20)
    rows = rows_of(40.3, 0.0, columns, 9)
    near, _ = fitted(learn, fields, rows, columns=columns, noise=noise_model())
    far, _ = fitted(learn, fields, rows, columns=columns, noise=noise_model(), start_error=2.0)
    np.testing.assert_allclose(far.row, near.row, atol=1e-3)


def test_a_line_near_the_edge_is_measured_and_one_beyond_it_is_cut():
    fields = line_fields(np.random.default_rng(9), n_fields=9, shape=(40, 752), slope=0.055, row=20)
    columns = np.arange(10, 752, 20)
    rows = rows_of(20, 0.055, columns, 9)
    found, estimator = fitted(learn, fields, rows, columns=columns, noise=noise_model())
    half = estimator.shape.half_width
    inside = (rows > half) & (rows < 39 - half)
    flank_lost = inside & ((rows < half + 2) | (rows > 37 - half))
    assert flank_lost.any()
    assert np.isfinite(found.row[inside]).all()
    assert np.abs(found.row - rows)[inside].max() < 0.1
    outside = (rows < half - 1) | (rows > 40 - half)
    assert found.cut[outside].all()
    assert np.isnan(found.row[outside]).all()


def test_nothing_is_made_of_nothing():
    fields = line_fields(np.random.default_rng(10), n_fields=9, row=40.3)
    columns = np.arange(10, 752, 20)
    rows = rows_of(40.3, 0.0, columns, 9)
    _, estimator = fitted(learn, fields, rows, columns=columns, noise=noise_model())
    dim = np.full_like(fields, 77)
    for extra in (0, int(0.4 * estimator.shape.threshold)):
        dim[:, 40] = 77 + extra
        assert np.isnan(estimator.centres(dim, columns, rows).row).all()
    nowhere = estimator.centres(fields, columns, np.full(rows.shape, np.nan))
    assert np.isnan(nowhere.row).all()
    assert not nowhere.cut.any()


def test_a_sample_without_the_line_still_gives_an_estimator():
    fields = line_fields(np.random.default_rng(12), n_fields=9, row=40.3)
    columns = np.arange(10, 752, 20)
    rows = np.full((9, columns.size), np.nan)
    _, estimator = fitted(learn, fields, rows, columns=columns, noise=noise_model())
    found = estimator.centres(fields, columns, np.full(rows.shape, 40.0))
    np.testing.assert_allclose(found.row, 40.3, atol=0.1)


@settings(max_examples=15, deadline=None)
@given(row=st.floats(25, 35), slope=st.floats(-0.1, 0.1), seed=st.integers(0, 2**32 - 1))
def test_turned_over_fields_give_turned_over_centres(row, slope, seed):
    fields = line_fields(
        np.random.default_rng(seed), n_fields=2, shape=(60, 61), row=row, slope=slope
    )
    columns = np.arange(0, 61, 4)
    shape = find_glint(fields, Glint())
    none = np.zeros(columns.size)
    estimator = GaussianEstimator(shape, noise_model(), columns, none + 1.4, none, none, none)
    rows = rows_of(row, slope, columns, 2, 61)
    ahead = estimator.centres(fields, columns, rows)
    down = estimator.centres(fields[:, ::-1].copy(), columns, 59 - rows)
    np.testing.assert_allclose(59 - down.row, ahead.row, atol=2e-3)
