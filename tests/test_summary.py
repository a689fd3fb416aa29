import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from summed import summed

from glint_aoa.optical.line import fit_lines_robustly
from glint_aoa.optical.summary import FieldSummary

COLUMNS = np.arange(10, 752, 20)
NOISE = 0.08  # of a column's centre [lines]


def centres(row, slope=0.01, *, seed=0, noise=NOISE):
    """Centres [field, column] of lines through `row` in the middle."""
    row, slope = np.atleast_1d(row), np.broadcast_to(slope, np.shape(np.atleast_1d(row)))
    error = noise * np.random.default_rng(seed).standard_normal((row.size, COLUMNS.size))
    return row[:, None] + slope[:, None] * (COLUMNS - COLUMNS.mean()) + error


def test_the_line_is_that_of_the_robust_fit():
    made = centres(np.linspace(20, 60, 30))
    made[3, 5] = 60.0  # off
    made[4] = np.nan
    made[5, ::2] = np.nan
    made[6, :12] += 9.0  # a third
    std = np.random.default_rng(1).uniform(0.5, 1.5, COLUMNS.size) * NOISE
    usual = 0.2 * np.sin(COLUMNS)
    std[7] = np.inf
    found = summed(made - usual, COLUMNS, std=std, usual=usual)
    s = np.broadcast_to(COLUMNS.astype(float), made.shape)
    fit = fit_lines_robustly(s, -(made - usual), std, usual)
    for name in ("slope", "intercept", "slope_var", "intercept_var", "covariance"):
        np.testing.assert_allclose(getattr(found, name), getattr(fit, name), rtol=1e-9)
    used = fit.weight > 0
    np.testing.assert_array_equal(found.used, used.sum(axis=1))
    assert found.used[[3, 4, 5, 6]].tolist() == [36, 0, 18, 26]
    squares = np.where(used, fit.residual, 0) ** 2
    there = found.used > 0
    np.testing.assert_allclose(found.squares[there], squares.sum(axis=1)[there], rtol=1e-8)
    own = np.nansum(fit.weight * (fit.residual - usual) ** 2, axis=1)
    np.testing.assert_allclose(found.own_squares[there], own[there], rtol=1e-8)


def test_the_glints_own_departure_from_a_line_is_taken_off():
    made = centres([40.0], noise=0.0)
    departure = 0.3 * np.cos(COLUMNS / 100)
    bent = summed(made - departure, COLUMNS, departure=departure)
    straight = summed(made, COLUMNS)
    np.testing.assert_allclose(bent.slope, straight.slope, atol=1e-12)
    np.testing.assert_allclose(bent.squares, 0.0, atol=1e-20)


def test_columns_are_counted():
    made = centres(np.full(4, 40.0))
    height = np.full(made.shape, 80.0)
    height[0, :7] = 9.0
    height[1] = np.nan  # of columns that are not used
    made[1] = np.nan
    cut, clipped = np.zeros(made.shape, bool), np.zeros(made.shape, bool)
    cut[1], clipped[2, 5:9] = True, True
    made[2, 5] = np.nan
    made[3, 3] = 300.0
    found = summed(made, COLUMNS, height=height, cut=cut, clipped=clipped, threshold=10.0)
    assert found.used.tolist() == [38, 0, 37, 37]
    assert found.dim.tolist() == [7, 0, 0, 0]
    assert found.cut.tolist() == [0, 38, 0, 0]
    assert found.clipped.tolist() == [0, 0, 3, 0]
    np.testing.assert_allclose(found.height, [31 * 80 + 7 * 9, 0, 37 * 80, 37 * 80])
    np.testing.assert_allclose(found.usual_height, 80.0 * found.used)


def test_rows_in_the_window_are_those_that_made_them():
    row, reach = np.linspace(20, 60, 30), np.linspace(-5, 5, 30)
    made = centres(row, reach / (COLUMNS[-1] - COLUMNS.mean()))
    made[3, 5] = 500.0
    made[4] = np.nan
    lines = summed(made, COLUMNS)
    there = np.arange(30) != 4
    assert np.isnan(lines.row[4])
    assert np.isnan(lines.mean_height[4])
    assert (lines.mean_height[there] == 80.0).all()
    expected = NOISE / np.sqrt(COLUMNS.size)
    np.testing.assert_allclose(lines.row_std[there], expected, rtol=0.5)
    assert np.std((lines.row - row)[there]) == pytest.approx(expected, rel=0.3)
    assert np.abs(lines.reach - reach)[there].max() < 5 * expected * np.sqrt(3)


def test_blocks_join_to_what_the_whole_stack_gives():
    made = centres(np.linspace(30, 50, 60))
    made[::7, 3] = 90.0
    whole = summed(made, COLUMNS)
    parts = (summed(made[k : k + 7], COLUMNS) for k in range(0, 60, 7))
    joined = FieldSummary.joined(parts, 60)
    for field in dataclasses.fields(FieldSummary):
        np.testing.assert_array_equal(getattr(joined, field.name), getattr(whole, field.name))


@given(field=st.integers(0, 5), column=st.integers(0, 37))
def test_fingerprints_tell_a_single_bit(field, column):
    made = centres(np.full(6, 40.0), noise=0.0)
    assert np.unique(summed(made, COLUMNS).fingerprint).size == 1
    made[field, column] = np.nextafter(made[field, column], np.inf)
    found = summed(made, COLUMNS).fingerprint
    assert np.flatnonzero(found != found[(field + 1) % 6]).tolist() == [field]
