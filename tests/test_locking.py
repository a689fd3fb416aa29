import numpy as np
import pytest
from scenes import measured, scene
from synthetic import line_fields

from glint_aoa.optical.locking import PixelLocking, pixel_locking
from glint_aoa.optical.measure import fit_fields

COLUMNS = np.arange(10, 752, 20)
ONES = np.ones(COLUMNS.size)


def lines(rng, *, n_fields=64, slope=0.003, spread=1.0):
    """Rows of straight lines that lie here and there [field, column]."""
    row = 40 + spread * rng.uniform(-1, 1, n_fields)
    return row[:, None] + slope * (COLUMNS - 375.5)


def test_a_known_pattern_is_found_as_it_is():
    """Without noise, the amplitude is that of the sum of both harmonics at its highest."""
    truth = lines(np.random.default_rng(1))
    angle = 2 * np.pi * truth
    drawn = truth + 0.03 * np.sin(angle) + 0.01 * np.cos(2 * angle)
    found = pixel_locking(drawn, truth, COLUMNS, ONES)
    phase = 2 * np.pi * np.arange(64) / 64
    expected = np.abs(0.03 * np.sin(phase) + 0.01 * np.cos(2 * phase)).max()
    assert found.amplitude == pytest.approx(expected, rel=1e-9)
    assert found.amplitude_std < 1e-9
    added = np.polyfit(COLUMNS, (drawn - truth).T, 1)[0]
    assert found.slope == pytest.approx(np.sqrt(np.mean(added**2)), rel=1e-9)


def test_the_stated_error_is_the_real_one():
    rng = np.random.default_rng(2)
    found = []
    for _ in range(60):
        truth = lines(rng)
        drawn = truth + 0.02 * np.sin(2 * np.pi * truth) + rng.normal(0, 0.02, truth.shape)
        found.append(pixel_locking(drawn, truth, COLUMNS, ONES))
    amplitude = np.array([each.amplitude for each in found])
    stated = np.mean([each.amplitude_std for each in found])
    # The highest of a noisy curve is a little too high.
    assert 0 < amplitude.mean() - 0.02 < 1.5 * stated
    assert amplitude.std() == pytest.approx(stated, rel=0.35)


@pytest.mark.parametrize("slope", [0.003, 0.01])
def test_texture_and_bends_are_no_locking(slope):
    """Departures that last, and are larger than noise, whether the line moves or not."""
    rng = np.random.default_rng(3)
    for spread in (0.0, 1.0):
        for _ in range(20):
            truth = lines(rng, slope=slope, spread=spread)
            bend = rng.normal() * ((COLUMNS - 375.5) / 375) ** 2
            texture = rng.normal(0, 0.05, COLUMNS.size)
            row = truth + bend + texture + rng.normal(0, 0.01, truth.shape)
            assert not pixel_locking(row, truth + bend + texture, COLUMNS, ONES).matters(2.35)


def test_a_few_wild_columns_and_gaps_do_not_count():
    rng = np.random.default_rng(4)
    truth = lines(rng)
    row = truth + 0.05 * np.sin(2 * np.pi * truth) + rng.normal(0, 0.01, truth.shape)
    clean = pixel_locking(row, truth, COLUMNS, ONES)
    row[rng.random(row.shape) < 0.02] += 3.0
    row[:, 5] = np.nan
    row[7] = np.nan
    row[:, 30] += 9.0
    weight = ONES.copy()
    weight[30] = 0.0
    spoilt = pixel_locking(row, truth, COLUMNS, weight)
    assert spoilt.amplitude == pytest.approx(clean.amplitude, abs=4 * clean.amplitude_std)
    assert spoilt.matters(2.35)


def test_where_the_phases_do_not_tell_nothing_is_said():
    rng = np.random.default_rng(5)
    level = lines(rng, slope=0.0, spread=0.0)
    noisy = level + rng.normal(0, 0.01, level.shape)
    few = slice(0, 9)
    nothing = np.full(level.shape, np.nan)
    for found in (
        pixel_locking(noisy, level, COLUMNS, ONES),
        pixel_locking(noisy[:, few], level[:, few], COLUMNS[few], ONES[few]),
        pixel_locking(nothing, level, COLUMNS, ONES),
        pixel_locking(noisy, level, COLUMNS, 0 * ONES),
    ):
        assert np.isnan(found.amplitude)
        assert not found.matters(2.35)


def test_it_matters_where_it_is_sure_and_large():
    """0.01 line, or 0.0003 deg in the slope; five standard deviations of either."""
    per_column = 2.0
    slope = np.radians(0.0003) / per_column
    for amplitude, std, added, expected in (
        (0.011, 0.002, 0.0, True),
        (0.009, 0.001, 0.9 * slope, False),
        (0.009, 0.001, 1.1 * slope, True),
        (0.02, 0.005, 1.1 * slope, False),
        (np.nan, np.inf, np.nan, False),
    ):
        assert PixelLocking(amplitude, std, added).matters(per_column) == expected


def looked_at(fields):
    """Locking of the paper's centroid in a stack, from its fitted lines."""
    _, _, how = measured(fields, estimator="centroid")
    centres, fit = fit_fields(fields, np.arange(len(fields)), how)
    # Heights grow upwards, rows downwards; the columns' usual departures belong to the line.
    expected = centres.row + (fit.residual - how.column_offset) / how.line_height
    return pixel_locking(centres.row, expected, how.columns, how.column_std**-2.0)


@pytest.mark.parametrize("slope", [0.003, 0.01])
@pytest.mark.parametrize(("sigma", "locks"), [(0.3, True), (1.4, False)])
def test_a_line_thinner_than_a_pixel_locks_and_a_broad_one_does_not(sigma, locks, slope):
    rng = np.random.default_rng(6)
    standing = scene(slope=slope, sigma=sigma).fields(rng, 40)
    found = looked_at(standing)
    assert found.matters(27.5 / 11.7) == locks
    assert found.amplitude > 0.05 if locks else found.amplitude < 0.005


def test_a_moving_level_line_shows_it_too():
    rng = np.random.default_rng(7)
    for sigma, locks in ((0.3, True), (1.4, False)):
        fields = line_fields(
            rng,
            n_fields=40,
            shape=(40, 752),
            row=20 + rng.uniform(-1, 1, 40),
            slope=0.0007,
            sigma=sigma,
        )
        assert looked_at(fields).matters(27.5 / 11.7) == locks
