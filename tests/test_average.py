"""The mean of a vibrating angle: closed forms, then simulated records."""

import numpy as np
import pytest
from scipy import linalg, stats

from benchmarks import mean_coverage
from glint_aoa.optical.average import MeanAngle, mean_angle
from glint_aoa.optical.segments import segment_weights, segmented_covariance, variance_of
from glint_aoa.optical.vibration import fit_vibration, folded
from render_sim.excitation import modulated_sine, random_band
from render_sim.modes import modal_angles, paper_model_system

RATE_HZ = 60.0
NOISE_DEG = 0.0008
LIMIT_DEG = 0.0005
TWO_DOF = 1.3213  # Student's t of two degrees of freedom, 68.27 %
METHODS = ("plain", "lines", "tapered", "process")


def times(n_fields=60):
    return np.arange(n_fields) / RATE_HZ


def noise(rng, n_fields=60):
    return rng.normal(0, NOISE_DEG, n_fields)


def sine(frequency, phase=0.0, amplitude=0.3, n_fields=60):
    return amplitude * np.sin(2 * np.pi * frequency * times(n_fields) + phase)


def average(angle, **options):
    return mean_angle(angle, rate_hz=RATE_HZ, noise=NOISE_DEG, **options)


def random_pitch(rng, rms_deg=0.09):
    """Pitch of the paper's model under a force from 5 to 60 Hz, at a random time."""
    modes = modal_angles(paper_model_system(), random_band(rng=rng), "pitch")
    time = rng.uniform(0, 40) + times()
    power = sum(np.abs(tones.amplitude) ** 2 / 2 for _, tones in modes).sum()
    return rms_deg / np.sqrt(power) * sum(tones.at(time) for _, tones in modes)


@pytest.mark.parametrize("method", ["auto", *METHODS])
def test_a_constant_angle_is_its_own_mean(method):
    got = mean_angle(np.full(60, 1.25), method=method)
    assert got.mean == pytest.approx(1.25, abs=1e-14)
    assert got.std == pytest.approx(0, abs=1e-14)


def test_plain_is_the_arithmetic_mean_without_the_missing():
    angle = np.random.default_rng(1).normal(size=60)
    angle[[3, 30]] = np.nan
    got = mean_angle(angle, method="plain")
    assert got.method == "plain"
    assert got.mean == pytest.approx(np.nanmean(angle), abs=1e-14)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("n_fields", [60, 400])
def test_every_method_is_a_set_of_weights(method, n_fields):
    rng = np.random.default_rng(2)
    angle = 2 + sine(9.2, n_fields=n_fields) + noise(rng, n_fields)
    angle[[3, 17, 40]] = np.nan
    got = average(angle, method=method)
    there = np.isfinite(angle)
    assert got.weights.sum() == pytest.approx(1, abs=1e-12)
    assert not got.weights[~there].any()
    assert got.mean == pytest.approx(got.weights[there] @ angle[there], abs=1e-12)
    assert got.of(3 * angle + 1) == pytest.approx(3 * got.mean + 1, abs=1e-12)


def test_noise_alone_keeps_the_plain_mean_and_its_standard_error():
    rng = np.random.default_rng(3)
    drawn = [average(noise(rng)) for _ in range(100)]
    assert sum(each.method == "plain" for each in drawn) >= 98
    true_std = NOISE_DEG / np.sqrt(60)
    assert np.mean([each.std for each in drawn]) == pytest.approx(true_std, rel=0.03)


@pytest.mark.parametrize("frequency", [5.0, 7.3, 9.2, 12.35, 15.0, 20.3, 25.0])
def test_a_vibration_that_does_not_close_is_fitted_with_the_mean(frequency):
    """0.3 deg leaks up to 0.006 deg into the plain mean; here the noise is all that is left."""
    rng = np.random.default_rng(4)
    phases = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    drawn = [average(sine(frequency, phase) + noise(rng)) for phase in phases]
    assert max(abs(each.mean) for each in drawn) < LIMIT_DEG
    for each in drawn:
        (line,) = each.lines
        assert line.frequency == pytest.approx(frequency, abs=0.01)
        assert line.amplitude == pytest.approx(0.3, rel=0.02)
        assert each.std == pytest.approx(NOISE_DEG / np.sqrt(60), rel=0.25)


@pytest.mark.parametrize("method", ["plain", "tapered"])
def test_what_a_fixed_method_keeps_of_a_vibration_is_predicted(method):
    """Over all phases, A / sqrt(2) times the response of the weights (closed form)."""
    frequency, phases = 9.2, np.linspace(0, 2 * np.pi, 8, endpoint=False)
    rng = np.random.default_rng(5)
    drawn = [average(sine(frequency, phase) + noise(rng), method=method) for phase in phases]
    for each in drawn:
        response = abs(each.weights @ np.exp(2j * np.pi * frequency * times()))
        own = NOISE_DEG * np.sqrt(each.weights @ each.weights)
        deviation = each.std / stats.t.ppf(stats.norm.cdf(1), each.dof)
        assert deviation == pytest.approx(np.hypot(0.3 * response / np.sqrt(2), own), rel=0.3)


def test_two_vibrations_are_told_apart():
    rng = np.random.default_rng(6)
    got = average(sine(9.2) + sine(21.3, 1.0, 0.02) + noise(rng))
    assert [line.frequency for line in got.lines] == pytest.approx([9.2, 21.3], abs=0.05)
    assert [line.amplitude for line in got.lines] == pytest.approx([0.3, 0.02], rel=0.05)
    assert abs(got.mean) < LIMIT_DEG


def test_an_amplitude_that_changes_within_the_record():
    """0.25 Hz modulation: a record is a quarter of it."""
    error, stated = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        tones = modulated_sine(rng.uniform(5, 25), rng=rng).scaled(0.15)
        got = average(tones.at(times()) + noise(rng))
        error.append(got.mean)
        stated.append(got.std)
    assert np.sqrt(np.mean(np.square(error))) < LIMIT_DEG
    assert np.mean(stated) == pytest.approx(NOISE_DEG / np.sqrt(60), rel=0.1)


def test_random_vibration_of_resonant_modes():
    """The covariance that the excitation has leaves 0.00013 deg, whoever knows it."""
    error, stated = [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        got = average(random_pitch(rng) + noise(rng))
        assert got.method == "process"
        assert got.dof < 60
        error.append(got.mean)
        stated.append(got.std)
    assert np.sqrt(np.mean(np.square(error))) < 0.00025
    assert 0.0001 < np.mean(stated) < 0.00025


def test_the_stated_deviation_covers():
    """Pull of 30 records, half of them vibrating: its square is chi-square, 30 degrees."""
    rng = np.random.default_rng(7)
    frequencies = [None, 7.9] * 15
    drawn = [average(noise(rng) + (sine(f, rng.uniform(0, 6)) if f else 0)) for f in frequencies]
    pull = sum((each.mean / each.std) ** 2 for each in drawn)
    low, high = stats.chi2.ppf([0.005, 0.995], 30)
    assert low < pull < high


def test_a_slow_drift_is_no_vibration():
    rng = np.random.default_rng(8)
    for drift in (0.02 * times(), 0.01 * np.cos(2 * np.pi * 0.4 * times())):
        got = average(drift + noise(rng))
        assert (got.method, got.lines) == ("plain", ())
        assert got.mean == pytest.approx(drift.mean(), abs=LIMIT_DEG)
        assert got.std == pytest.approx(NOISE_DEG / np.sqrt(60), rel=0.3)


def test_fields_left_out_do_not_let_the_vibration_in():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        angle = sine(rng.uniform(5, 25), rng.uniform(0, 6)) + noise(rng)
        angle[rng.random(60) < 0.15] = np.nan
        angle[20:26] = np.nan
        got = average(angle)
        assert abs(got.mean) < LIMIT_DEG
        assert got.std == pytest.approx(NOISE_DEG / np.sqrt(np.isfinite(angle).sum()), rel=0.4)


@pytest.mark.parametrize("n_fields", [20, 200])
def test_short_and_longer_records(n_fields):
    rng = np.random.default_rng(9)
    got = average(sine(9.2, 1.0, n_fields=n_fields) + noise(rng, n_fields))
    assert abs(got.mean) < 4 * NOISE_DEG / np.sqrt(n_fields)
    assert got.std == pytest.approx(NOISE_DEG / np.sqrt(n_fields), rel=0.6)


def test_given_frequencies_are_kept():
    rng = np.random.default_rng(10)
    angle = sine(9.8) + noise(rng)
    got = average(angle, vibration_hz=[9.8, 50.2])  # seen as 9.8 Hz too, and folded so
    assert {round(line.frequency, 9) for line in got.lines} == {9.8}
    assert abs(got.mean) < LIMIT_DEG


def test_a_candidate_near_a_peak_is_a_start_not_an_order():
    rng = np.random.default_rng(11)
    (line,) = average(sine(9.2) + noise(rng), candidates_hz=[9.8]).lines
    assert line.frequency == pytest.approx(9.2, abs=0.01)


@pytest.mark.parametrize(("frequency", "seen"), [(0.2, 0.2), (0.57, 0.43), (1.0, 0.0), (1.9, 0.1)])
def test_frequencies_fold_about_half_the_field_rate(frequency, seen):
    assert folded(frequency) == pytest.approx(seen)
    field = np.arange(40)
    np.testing.assert_allclose(
        np.cos(2 * np.pi * frequency * field), np.cos(2 * np.pi * seen * field), atol=1e-9
    )


def test_white_noise_has_no_lines_and_its_variance_as_covariance():
    rng = np.random.default_rng(12)
    drawn = [fit_vibration(rng.normal(0, 1, 60)) for _ in range(40)]
    white = [each for each in drawn if not each.lines]
    assert len(white) >= 38  # one in a hundred is expected to show a line
    for each in white:
        assert not each.covariance[1:].any()
        assert 2 / each.uncertainty[0, 0] == pytest.approx(58, abs=0.1)  # mean and trend taken off
    assert np.mean([each.covariance[0] for each in white]) == pytest.approx(1, rel=0.1)


@pytest.mark.parametrize("gaps", [0, 30])
def test_a_long_record_of_a_vibration(gaps):
    rng = np.random.default_rng(13)
    angle = sine(9.31, n_fields=3000) + noise(rng, 3000)
    angle[rng.choice(3000, gaps, replace=False)] = np.nan
    got = average(angle)
    assert got.method == "process"
    assert got.std == pytest.approx(NOISE_DEG / np.sqrt(3000), rel=0.2)
    assert abs(got.mean) < 4 * got.std


def test_a_long_record_without_vibration_keeps_the_plain_mean():
    rng = np.random.default_rng(14)
    got = average(noise(rng, 2000))
    assert got.method == "plain"
    assert got.std == pytest.approx(NOISE_DEG / np.sqrt(2000), rel=0.2)


def test_a_long_record_with_gaps_everywhere_is_learnt_from_its_fullest_part():
    rng = np.random.default_rng(15)
    angle = sine(9.31, n_fields=600) + noise(rng, 600)
    angle[::20] = np.nan
    got = average(angle)
    assert abs(got.mean) < 4 * NOISE_DEG / np.sqrt(570)
    assert got.std == pytest.approx(NOISE_DEG / np.sqrt(570), rel=0.6)


def test_the_variance_of_a_weighted_mean_is_its_quadratic_form():
    rng = np.random.default_rng(16)
    weights = rng.random(300)
    covariance, _ = segmented_covariance(sine(9.2, n_fields=300) + noise(rng, 300))
    matrix = linalg.toeplitz(np.pad(covariance, (0, 300 - covariance.size)))
    assert variance_of(weights, covariance) == pytest.approx(weights @ matrix @ weights, rel=1e-9)


def test_segment_weights_of_white_noise_are_flat_away_from_the_ends():
    white = np.zeros(128)
    white[0] = 1.0
    weights = segment_weights(np.ones(640, bool), white)
    np.testing.assert_allclose(weights[128:-128], 4.0, rtol=1e-12)


def test_few_fields_and_none():
    got = mean_angle([1.0, 2.0, 3.0])
    assert (got.mean, got.method, got.dof) == (2.0, "plain", 2.0)
    assert got.std == pytest.approx(TWO_DOF / np.sqrt(3), rel=1e-3)
    none = mean_angle([np.nan] * 5)
    assert np.isnan([none.mean, none.std, none.of(np.ones(5))]).all()
    assert np.isnan(mean_angle([1.0]).std)


def test_the_uncertainty_of_three_fields_covers():
    """Of 2,000 draws; without Student's t it would be 58 and 81 %."""
    drawn = np.random.default_rng(17).normal(size=(2000, 3))
    got = [mean_angle(each) for each in drawn]
    error = np.abs([each.mean for each in got])
    assert np.mean(error < [each.std for each in got]) == pytest.approx(0.683, abs=0.02)
    assert np.mean(error < [each.expanded() for each in got]) == pytest.approx(0.95, abs=0.01)


def test_expanded_uncertainty_adds_the_systematic_part():
    got = MeanAngle(0.0, 0.5, "plain", np.ones(1))
    assert got.expanded(2.0) == pytest.approx(1.96 * np.hypot(0.5, 2.0), rel=1e-4)


def test_expanded_uncertainty_knows_how_well_the_systematic_part_is_known():
    got = MeanAngle(0.0, 1.0, "plain", np.ones(1))
    assert got.expanded(1000.0, systematic_dof=5.0) == pytest.approx(2570.6, rel=1e-4)
    # (1 + 2^2)^2 / (2^4 / 5) by Welch and Satterthwaite, and Student's t there
    expected = stats.t.ppf(0.975, 25 / (16 / 5)) * np.sqrt(5)
    assert got.expanded(2.0, systematic_dof=5.0) == pytest.approx(expected)


def test_expanded_uncertainty_knows_how_well_the_noise_is_known():
    """Student's t of ten degrees of freedom, tabulated: 1.053 for 68.27 %, 2.228 for 95 %."""
    got = MeanAngle(0.0, 1.053, "process", np.ones(1), dof=10.0)
    assert got.expanded() == pytest.approx(2.228, abs=0.002)


def test_the_degrees_of_freedom_of_segments_are_those_of_their_scatter():
    rng = np.random.default_rng(18)
    drawn = [segmented_covariance(rng.normal(size=600)) for _ in range(400)]
    slow = np.array([2 * lags.sum() - lags[0] for lags, _ in drawn])
    assert slow.mean() == pytest.approx(1.0, abs=0.03)
    assert 2 * (slow.mean() / slow.std()) ** 2 == pytest.approx(drawn[0].dof, rel=0.25)


def test_a_stated_noise_steadies_what_segments_tell():
    angle = np.random.default_rng(19).normal(size=250)
    alone, stated = segmented_covariance(angle), segmented_covariance(angle, noise=1.0)
    assert stated.dof > alone.dof + 3
    departures = [abs(2 * lags.sum() - lags[0] - 1) for lags, _ in (alone, stated)]
    assert departures[1] < departures[0]


@pytest.mark.parametrize(("kind", "n_fields"), [("still", 60), ("sine", 60), ("modulated", 300)])
def test_the_stated_intervals_cover(kind, n_fields):
    """A hundred draws of what `python -m benchmarks.mean_coverage` draws thousands of."""
    (row,) = mean_coverage.coverage(100, 3, cases=[(kind, n_fields)])
    assert row.largest_deg < LIMIT_DEG
    assert row.one_sigma == pytest.approx(68.3, abs=8)
    assert row.ninety_five == pytest.approx(95, abs=5)
