import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import scene
from scipy.optimize import brentq
from synthetic import line_fields

from glint_aoa.optical.centroid import Centroid
from glint_aoa.optical.coarse import find_lines
from glint_aoa.optical.columns import used_columns
from glint_aoa.optical.detect import find_glint
from glint_aoa.setup import Glint


def measured(fields, glint=None, columns=None):
    glint = glint or Glint()
    shape = find_glint(fields, glint)
    columns = used_columns(fields.shape[2], glint.column_step) if columns is None else columns
    start = find_lines(fields, shape).rows(columns, shape)
    return Centroid(shape).centres(fields, columns, start), columns, shape


def slow_centroid(column, start, half_width, flank):
    """The same definition, its root found by SciPy."""
    half = half_width
    apart = 1.065 * half
    row = np.arange(column.size)
    fine = (np.arange(column.size * 2000) + 0.5) / 2000 - 0.5

    def moment(centre):
        away = fine - centre
        aside = (np.abs(away) > apart) & (np.abs(away) <= apart + flank)
        grey = np.repeat(column.astype(float), 2000)
        above, below = (grey[aside & side].mean() for side in (away < 0, away > 0))
        tilt = (below - above) / (2 * apart + flank)
        t = row - centre
        weight = np.clip(1 - (t / half) ** 2, 0, None) ** 2
        return (weight * t * (column - (above + below) / 2 - tilt * t)).sum()

    return brentq(moment, start - 1, start + 1, xtol=1e-9)


def test_used_columns_are_centred_in_their_steps():
    assert used_columns(752, 20).size == 38
    assert used_columns(752, 20)[[0, -1]].tolist() == [10, 750]
    assert used_columns(752, 1).size == 752
    assert used_columns(5, 20).tolist() == [2]


def test_kernel_agrees_with_a_plain_implementation():
    fields = line_fields(np.random.default_rng(1), n_fields=4, shape=(60, 80), row=30.3, slope=0.04)
    found, columns, shape = measured(fields, Glint(column_step=10))
    for k in range(4):
        for i, c in enumerate(columns):
            expected = slow_centroid(
                fields[k, :, c], round(found.row[k, i]), shape.half_width, shape.flank
            )
            assert found.row[k, i] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ("sigma", "limit"), [(0.7, 1e-3), (1.0, 1e-4), (1.4, 1e-4), (2.5, 2e-4), (4.0, 2e-4)]
)
def test_pixel_locking_is_as_small_as_stated(sigma, limit):
    """Noise-free, 16 bits: the centre is right at every phase of the line."""
    row = 40 + np.linspace(-0.5, 0.5, 41)
    fields = line_fields(
        n_fields=41,
        shape=(92, 60),
        row=row,
        sigma=sigma,
        peak=40_000,
        white=65_535,
        dtype=np.uint16,
    )
    found, _, _ = measured(fields, Glint(column_step=20))
    assert np.abs(found.row - row[:, None]).max() < limit


def test_a_tilted_background_does_not_move_the_centre():
    fields = line_fields(
        n_fields=3, shape=(92, 60), row=40.3, peak=20_000, white=65_535, dtype=np.uint16
    )
    fields += (np.arange(92, dtype=np.uint16) * 100)[:, None]
    found, _, _ = measured(fields)
    np.testing.assert_allclose(found.row, 40.3, atol=5e-4)


def test_noise_is_near_the_bound():
    """Held against an efficient slope from the same fields, so 300 of them tell to 2 %."""
    line = scene(row=20.27, slope=0.003, sigma=1.4, peak=160.0)
    fields = line.fields(np.random.default_rng(2), 300)
    found, columns, _ = measured(fields)
    slopes = np.polyfit(columns, found.row.T, 1)[0]
    efficient = line.efficient(fields, columns)
    shared = np.corrcoef(slopes, efficient)[0, 1]
    assert np.sqrt((1 - shared**2) / 300) < 0.02
    assert 0.95 < slopes.std() / efficient.std() < 1.1


def test_dark_glint_is_the_bright_one_turned_over():
    fields = line_fields(np.random.default_rng(3), n_fields=5, shape=(60, 200), row=30.4)
    bright, _, _ = measured(fields)
    dark, _, _ = measured(255 - fields, Glint(polarity="dark"))
    np.testing.assert_allclose(dark.row, bright.row, atol=1e-9)


def test_search_window_picks_the_line():
    fields = line_fields(n_fields=3, shape=(60, 200), row=15.25) + line_fields(
        n_fields=3, shape=(60, 200), row=44.75, peak=60, black=0
    )
    for window, row in (((5, 30), 15.25), ((30, 58), 44.75)):
        found, _, _ = measured(fields, Glint(search_window=window))
        np.testing.assert_allclose(found.row, row, atol=0.02)


def test_nothing_is_found_where_nothing_is():
    rng = np.random.default_rng(4)
    noise = rng.integers(90, 110, (5, 60, 200), dtype=np.uint8)
    flat = np.full((5, 60, 200), 77, np.uint8)
    for fields in (noise, flat, np.zeros_like(flat), np.full_like(flat, 255)):
        found, _, shape = measured(fields)
        assert not shape.found
        assert np.isnan(found.row).all()
        assert not found.cut.any()


def test_line_that_leaves_the_window_is_cut_and_not_guessed():
    fields = line_fields(n_fields=3, shape=(40, 400), row=20.0, slope=0.15)
    found, columns, _ = measured(fields)
    truth = 20.0 + 0.15 * (columns - 199.5)
    inside = (truth > 6) & (truth < 33)
    assert np.isfinite(found.row[:, inside]).all()
    assert found.cut[:, (truth < 0) | (truth > 39)].all()
    np.testing.assert_allclose(found.row[0, inside], truth[inside], atol=0.02)


def test_clipped_columns_are_named():
    fields = line_fields(n_fields=3, shape=(60, 200), row=30.3, peak=400)
    found, _, _ = measured(fields)
    assert found.clipped.all()
    assert np.isfinite(found.row).all()


@settings(max_examples=20, deadline=None)
@given(
    row=st.floats(25, 35),
    slope=st.floats(-0.1, 0.1),
    seed=st.integers(0, 2**32 - 1),
)
def test_turned_over_fields_give_turned_over_centres(row, slope, seed):
    fields = line_fields(
        np.random.default_rng(seed), n_fields=2, shape=(60, 61), row=row, slope=slope
    )
    columns = np.arange(61)
    ahead, _, _ = measured(fields, columns=columns)
    down, _, _ = measured(fields[:, ::-1].copy(), columns=columns)
    right, _, _ = measured(fields[:, :, ::-1].copy(), columns=columns)
    np.testing.assert_allclose(59 - down.row, ahead.row, atol=1e-4)
    np.testing.assert_allclose(right.row[:, ::-1], ahead.row, atol=1e-4)
