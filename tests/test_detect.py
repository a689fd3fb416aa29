import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import line_fields

from glint_aoa.optical.coarse import find_lines
from glint_aoa.optical.columns import spread_columns, used_columns
from glint_aoa.optical.detect import find_glint
from glint_aoa.setup import Glint

SQUARE, OBLONG = np.tan(np.radians(12)), np.tan(np.radians(12)) * 11.7 / 27.5
"""Lines a column of a glint at 12 deg, on square pixels and on the paper camera's."""


def coarse(fields, row, slope, glint=None, *, shape=None):
    """How far the coarse line lies off, in every column that shows the whole glint."""
    shape = shape or find_glint(fields, glint or Glint())
    assert shape.found
    columns = np.arange(fields.shape[2])
    u = columns - (columns.size - 1) / 2
    truth = np.reshape(row, (-1, 1)) + np.reshape(slope, (-1, 1)) * u
    truth = np.broadcast_to(truth, (len(fields), u.size))
    margin = shape.half_width
    whole = (truth > shape.first_row + margin) & (truth < shape.last_row - 1 - margin)
    return np.abs(find_lines(fields, shape).rows(columns, shape) - truth)[whole].max(), shape


@pytest.mark.parametrize("slope", [-SQUARE, -OBLONG, -0.0007, 0.0, 0.01, OBLONG, SQUARE])
def test_lines_up_to_12_degrees_are_found(slope):
    fields = line_fields(
        np.random.default_rng(1), n_fields=3, shape=(220, 752), row=110.3, slope=slope
    )
    off, _ = coarse(fields, 110.3, slope)
    assert off < 0.05


@pytest.mark.parametrize(
    ("shape", "row", "slope"),
    [
        ((20, 752), 9.7, 0.005),  # as few lines as a window may have
        ((92, 749), 40.7, 0.05),  # columns that do not fill the last patch
        ((92, 63), 40.7, 0.1),  # too few for patches of eight
        ((60, 24), 30.2, -0.1),
    ],
)
def test_windows_of_any_size_will_do(shape, row, slope):
    fields = line_fields(np.random.default_rng(2), n_fields=4, shape=shape, row=row, slope=slope)
    off, _ = coarse(fields, row, slope)
    assert off < 0.05


@pytest.mark.parametrize("columns", [752, 750, 30])
def test_sixteen_bits_are_read_as_such(columns):
    """A patch is then of four pixels; the line and its widths stay what they are."""
    eight = line_fields(n_fields=3, shape=(60, columns), row=30.3, slope=0.02)
    sixteen = eight.astype(np.uint16) * 257
    off, shape = coarse(sixteen, 30.3, 0.02)
    assert off < 0.05
    assert shape.half_width == pytest.approx(find_glint(eight, Glint()).half_width, rel=1e-6)


@pytest.mark.parametrize("sigma", [0.7, 1.4, 2.5, 4.0])
def test_widths_follow_from_the_profile(sigma):
    """Of a Gaussian: the box is its width at half height, the window 1.4 times that at a tenth."""
    fields = line_fields(
        np.random.default_rng(3), n_fields=7, row=40.3, slope=0.004, sigma=sigma, peak=200
    )
    _, shape = coarse(fields, 40.3, 0.004)
    blurred = np.hypot(sigma, np.sqrt(1 / 12))
    half, tenth = (blurred * np.sqrt(-2 * np.log(share)) for share in (0.5, 0.1))
    assert abs(2 * shape.half_box + 1 - 2 * half) <= 1.01
    # Read off between whole lines, which spreads the profile by up to half a line.
    assert 1.29 * tenth < shape.half_width < 1.29 * (tenth + 0.5) + 0.6
    assert shape.flank == pytest.approx(max(2.0, 0.6 * shape.half_width))


def test_thresholds_are_in_the_noise_of_boxes():
    """Six times the noise of a box's mean, or of eight columns of it over two other boxes."""
    sigma = 3.0
    fields = line_fields(
        np.random.default_rng(4), n_fields=7, row=40.3, slope=0.004, read_noise=sigma, black=100
    )
    _, shape = coarse(fields, 40.3, 0.004)
    noise = np.sqrt(sigma**2 + 100 * 255 / 40_000 + 1 / 12)
    box = 2 * shape.half_box + 1
    assert shape.threshold == pytest.approx(6 * noise / np.sqrt(box), rel=0.15)
    assert shape.patch_threshold == pytest.approx(6 * noise * np.sqrt(1.5 / (8 * box)), rel=0.15)
    assert shape.noise == pytest.approx(noise, rel=0.15)


def test_dark_line_is_the_bright_one_turned_over():
    fields = line_fields(np.random.default_rng(5), n_fields=4, row=40.7, slope=-0.03)
    bright, dark = find_glint(fields, Glint()), find_glint(255 - fields, Glint(polarity="dark"))
    assert (bright.sign, dark.sign) == (1, -1)
    for field in dataclasses.fields(bright):
        if field.name != "sign":
            value = getattr(bright, field.name)
            assert getattr(dark, field.name) == pytest.approx(value, rel=1e-9)
    np.testing.assert_array_equal(
        find_lines(255 - fields, dark).coefficients, find_lines(fields, bright).coefficients
    )


@pytest.mark.parametrize("tilt", [-1.8, 0.6, 1.8])
def test_light_that_grows_down_the_window_does_not_count(tilt):
    """Over the window it grows to almost three times the glint's height."""
    ramp = np.floor((tilt * np.arange(92)) % 166).astype(np.uint8)[:, None]
    plain = line_fields(np.random.default_rng(6), n_fields=4, row=40.7, slope=0.01, peak=60)
    off, shape = coarse(plain + ramp, 40.7, 0.01)
    assert off < 0.3
    assert shape.half_width == pytest.approx(find_glint(plain, Glint()).half_width, rel=0.05)
    assert shape.second < 0.1


def test_of_two_parallel_lines_the_brighter_is_taken_and_the_other_told():
    rng = np.random.default_rng(7)
    fields = line_fields(rng, n_fields=5, row=40.7, slope=0.01, peak=100)
    fields += line_fields(rng, n_fields=5, row=65.2, slope=0.01, peak=60, black=0, read_noise=0)
    off, shape = coarse(fields, 40.7, 0.01)
    assert off < 0.05
    assert shape.second == pytest.approx(0.6, abs=0.05)


def test_hot_pixels_do_not_vote():
    rng = np.random.default_rng(8)
    fields = line_fields(rng, n_fields=5, row=40.7, slope=0.01, peak=100)
    fields[:, rng.random((92, 752)) < 0.003] = 255
    off, _ = coarse(fields, 40.7, 0.01)
    assert off < 0.1


def test_a_faint_line_over_texture_is_found():
    """A peak of 12 grey levels over texture of 1.5, with read noise of 1."""
    rng = np.random.default_rng(9)
    texture = rng.normal(30, 1.5, (92, 752))
    line = line_fields(
        rng, n_fields=5, row=40.3, slope=0.01, peak=12, black=20, read_noise=1, dtype=np.int16
    )
    off, _ = coarse(np.round(line + texture).astype(np.uint8), 40.3, 0.01)
    assert off < 0.2


def test_a_line_partly_out_of_the_window_is_followed_and_then_far_out():
    """The estimators reach two lines; where it has left, its row is out of the field."""
    fields = line_fields(np.random.default_rng(10), n_fields=4, shape=(40, 752), row=20, slope=0.1)
    off, shape = coarse(fields, 20.0, 0.1)
    assert off < 2.0
    columns = np.arange(752)
    truth = 20.0 + 0.1 * (columns - 375.5)
    rows = find_lines(fields, shape).rows(columns, shape)
    assert (rows[:, (truth < -3) | (truth > 42)] < -1000).all()


def test_a_line_outside_the_band_of_the_sample_is_still_found():
    sample = line_fields(np.random.default_rng(11), n_fields=5, row=20.3)
    shape = find_glint(sample, Glint())
    assert shape.band_last < 45
    away = line_fields(np.random.default_rng(12), n_fields=5, row=70.7, slope=-0.01)
    off, _ = coarse(away, 70.7, -0.01, shape=shape)
    assert off < 0.05
    both = line_fields(n_fields=2, row=np.array([20.0, 70.0]))
    off, _ = coarse(both, np.array([20.0, 70.0]), 0.0, shape=shape)
    assert off < 0.05


def test_the_band_holds_the_sample_and_its_flanks():
    fields = line_fields(n_fields=5, row=np.array([40.0, 45, 50, 43, 47]), slope=0.01)
    _, shape = coarse(fields, np.array([40.0, 45, 50, 43, 47]), 0.01)
    reach = shape.half_width + shape.flank
    assert shape.band_first < 40 - 3.76 - reach
    assert shape.band_last > 50 + 3.76 + reach


def test_rows_outside_the_search_window_are_not_looked_at():
    fields = line_fields(n_fields=3, row=20.3, peak=200) + line_fields(
        n_fields=3, row=60.3, peak=50, black=0
    )
    off, shape = coarse(fields, 60.3, 0.0, Glint(search_window=(40, 80)))
    assert off < 0.05
    assert (shape.first_row, shape.last_row) == (40, 80)
    blinded = fields.copy()
    blinded[:, :40] = 255
    assert find_glint(blinded, Glint(search_window=(40, 80))).half_width == shape.half_width


def test_a_bent_line_is_followed_by_a_parabola():
    u = np.linspace(-1, 1, 752)
    truth = 40 + 3 * u + 6 * u**2
    line = np.arange(92)[:, None]
    grey = 10 + 150 * np.exp(-0.5 * ((line - truth) / 1.4) ** 2)
    fields = np.round(np.repeat(grey[None], 3, axis=0)).astype(np.uint8)
    shape = find_glint(fields, Glint())
    rows = find_lines(fields, shape).rows(np.arange(752), shape)
    assert np.abs(rows - truth).max() < 0.3


def test_nothing_is_found_where_nothing_is():
    rng = np.random.default_rng(13)
    noise = rng.integers(90, 110, (5, 60, 200), dtype=np.uint8)
    for fields in (noise, np.zeros_like(noise), np.full_like(noise, 255)):
        shape = find_glint(fields, Glint())
        assert not shape.found
        lines = find_lines(fields, shape)
        assert (lines.share == 0).all()
        assert np.isnan(lines.coefficients).all()
        assert np.isnan(lines.rows(np.arange(200), shape)).all()


def test_fields_that_are_empty_stay_so_in_a_stack_that_is_not():
    fields = line_fields(np.random.default_rng(14), n_fields=6, row=40.3)
    fields[2] = 10
    shape = find_glint(fields, Glint())
    lines = find_lines(fields, shape)
    assert np.flatnonzero(lines.share == 0).tolist() == [2]
    assert np.isnan(lines.rows(np.arange(752), shape)[2]).all()


@pytest.mark.parametrize("std", [2.0, 8.0])
def test_background_noise_is_that_of_a_pixel(std):
    rng = np.random.default_rng(15)
    grey = np.round(rng.normal(120, std, (4, 60, 200))).astype(np.uint8)
    shape = find_glint(grey, Glint())
    assert shape.noise == pytest.approx(np.sqrt(std**2 + 1 / 12), rel=0.07)


@settings(max_examples=15)
@given(
    row=st.floats(27, 33),
    slope=st.floats(-0.1, 0.1),
    width=st.integers(24, 200),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_turned_over_window_gives_the_turned_over_line(row, slope, width, seed):
    rng = np.random.default_rng(seed)
    fields = line_fields(rng, n_fields=2, shape=(60, width), row=row, slope=slope)
    columns = np.arange(width)
    ahead, down = (
        find_lines(each, shape).rows(columns, shape)
        for each in (fields, fields[:, ::-1].copy())
        for shape in [find_glint(each, Glint())]
    )
    np.testing.assert_allclose(59 - down, ahead, atol=0.02)


def test_used_columns_are_centred_in_their_steps():
    assert used_columns(752, 20).size == 38
    assert used_columns(752, 20)[[0, -1]].tolist() == [10, 750]
    assert used_columns(752, 1).size == 752
    assert used_columns(5, 20).tolist() == [2]


@given(n=st.integers(1, 1000), most=st.integers(1, 200))
def test_spread_columns_are_the_same_from_either_end(n, most):
    columns = spread_columns(n, most)
    np.testing.assert_array_equal(np.sort(n - 1 - columns), columns)
    assert columns.size <= most + 1
    assert columns[0] >= 0
    assert columns[-1] < n
