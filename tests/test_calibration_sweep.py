"""The no-flow pitch sweep: known truth, other implementations, files and messages."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from calibration.sweep.fit import DEFAULT_ONBOARD_STD_DEG, PitchSweep, Provenance, fit_sweep
from glint_aoa.errors import CalibrationError, OutputError

ANGLES = np.arange(-6.0, 6.01, 0.5)
TRUTH = np.array([0.05, 1.012, 4e-4])


FIRST_VERSION = """
kind = "pitch sweep"

[polynomial]
centre_deg = 0.0
half_range_deg = 1.0
coefficients_deg = [0.1, 1.01]
covariance_deg2 = [[1e-6, 0.0], [0.0, 4e-6]]

[fit]
chi_square = 0.5
degrees_of_freedom = 1
onboard_accuracy_deg = 0.0

[fit.criterion]

[points]
optical_deg = [-1.0, 0.0, 1.0]
optical_std_deg = [0.001, 0.001, 0.001]
onboard_deg = [-0.91, 0.1, 1.11]
onboard_std_deg = [0.002, 0.002, 0.002]

[provenance]
files = ["a.h5", "b.h5", "c.h5"]
setup_hash = "0123abc"
date = ""
"""


def truth(angle_deg):
    return np.polynomial.polynomial.polyval(angle_deg, TRUTH)


def noisy_sweep(rng, *, optical_std=0.0004, onboard_std=0.002, degree=2):
    optical = ANGLES + optical_std * rng.standard_normal(ANGLES.size)
    onboard = truth(ANGLES) + onboard_std * rng.standard_normal(ANGLES.size)
    return fit_sweep(optical, optical_std, onboard, onboard_std, degree=degree)


def only_curve(sweep):
    (curve,) = sweep.curves
    return curve


def in_powers_of_angle(sweep):
    """Coefficients in powers of the optical angle itself."""
    curve = only_curve(sweep)
    series = np.polynomial.Polynomial(
        curve.coefficients_deg, domain=list(curve.range_deg), window=[-1, 1]
    )
    return series.convert().coef


def slope_variance_of(sweep):
    curve = only_curve(sweep)
    return curve.covariance_deg2[1, 1] / curve.half_range_deg**2


def york(x, sx, y, sy):
    """York et al. 2004, uncorrelated errors: intercept, slope and their variances."""
    slope = np.polyfit(x, y, 1)[0]
    wx, wy = 1 / sx**2, 1 / sy**2
    for _ in range(100):
        w = wx * wy / (wx + slope**2 * wy)
        x_bar, y_bar = np.average(x, weights=w), np.average(y, weights=w)
        u, v = x - x_bar, y - y_bar
        beta = w * (u / wy + slope * v / wx)
        slope = np.sum(w * beta * v) / np.sum(w * beta * u)
    adjusted = x_bar + beta
    mean_adjusted = np.average(adjusted, weights=w)
    slope_variance = 1 / np.sum(w * (adjusted - mean_adjusted) ** 2)
    intercept_variance = 1 / np.sum(w) + mean_adjusted**2 * slope_variance
    return y_bar - slope * x_bar, slope, intercept_variance, slope_variance


class TestFit:
    @pytest.mark.parametrize("coefficients", [[0.1, 0.99], [0.1, 1.01, 5e-4], [0, 1, 1e-3, -2e-5]])
    def test_without_noise_the_truth_comes_back(self, coefficients):
        onboard = np.polynomial.polynomial.polyval(ANGLES, coefficients)
        sweep = fit_sweep(ANGLES, 1e-3, onboard, 1e-3, degree=len(coefficients) - 1)
        assert in_powers_of_angle(sweep) == pytest.approx(coefficients, abs=1e-12)
        assert sweep.chi_square == pytest.approx(0, abs=1e-18)
        assert sweep.residuals_deg == pytest.approx(np.zeros(ANGLES.size), abs=1e-12)

    def test_straight_line_is_yorks(self):
        rng = np.random.default_rng(1)
        sx, sy = rng.uniform(0.01, 0.1, (2, ANGLES.size))
        x = ANGLES + sx * rng.standard_normal(ANGLES.size)
        y = 0.3 + 1.4 * ANGLES + sy * rng.standard_normal(ANGLES.size)
        sweep = fit_sweep(x, sx, y, sy, degree=1)
        intercept, slope, intercept_variance, slope_variance = york(x, sx, y, sy)
        assert sweep.predict(0.0) == pytest.approx(intercept, abs=1e-9)
        assert sweep.derivative(0.0) == pytest.approx(slope, abs=1e-9)
        systematic = sweep.apply(0.0).systematic_std_deg
        assert systematic**2 == pytest.approx(intercept_variance, rel=1e-6)
        assert slope_variance_of(sweep) == pytest.approx(slope_variance, rel=1e-6)

    def test_without_optical_error_it_is_numpys_weighted_polynomial(self):
        rng = np.random.default_rng(2)
        sy = rng.uniform(0.001, 0.004, ANGLES.size)
        y = truth(ANGLES) + sy * rng.standard_normal(ANGLES.size)
        sweep = fit_sweep(ANGLES, 1e-8, y, sy, degree=2)
        expected, covariance = np.polyfit(ANGLES, y, 2, w=1 / sy, cov="unscaled")
        assert in_powers_of_angle(sweep) == pytest.approx(expected[::-1], abs=1e-10)
        assert slope_variance_of(sweep) == pytest.approx(covariance[1, 1], rel=1e-5)

    def test_parabola_is_the_least_distance_one(self):
        rng = np.random.default_rng(3)
        sx, sy = 0.05, 0.08
        x = ANGLES + sx * rng.standard_normal(ANGLES.size)
        y = 0.1 + ANGLES + 0.05 * ANGLES**2 + sy * rng.standard_normal(ANGLES.size)
        sweep = fit_sweep(x, sx, y, sy, degree=2)

        def distance(coefficients):
            total = 0.0
            for at, value in zip(x, y, strict=True):
                total += optimize.minimize_scalar(
                    lambda t, at=at, value=value: (
                        ((t - at) / sx) ** 2 + ((np.polyval(coefficients, t) - value) / sy) ** 2
                    ),
                    bounds=(at - 0.5, at + 0.5),
                    method="bounded",
                    options={"xatol": 1e-10},
                ).fun
            return total

        best = in_powers_of_angle(sweep)[::-1]
        assert sweep.chi_square == pytest.approx(distance(best), rel=1e-6)
        for step in np.vstack([np.eye(3), -np.eye(3)]) * [1e-4, 1e-3, 1e-3]:
            assert distance(best + step) > sweep.chi_square

    def test_exchanging_the_variables_inverts_the_line(self):
        rng = np.random.default_rng(4)
        x = ANGLES + 0.01 * rng.standard_normal(ANGLES.size)
        y = 0.2 + 1.1 * ANGLES + 0.02 * rng.standard_normal(ANGLES.size)
        there, back = fit_sweep(x, 0.01, y, 0.02, degree=1), fit_sweep(y, 0.02, x, 0.01, degree=1)
        assert back.predict(there.predict(ANGLES)) == pytest.approx(ANGLES, abs=1e-8)
        assert there.chi_square == pytest.approx(back.chi_square, rel=1e-8)

    @settings(max_examples=25, deadline=None)
    @given(shift=st.floats(-5, 5), scale=st.floats(0.5, 1.8))
    def test_moving_and_scaling_the_optical_angle_changes_nothing(self, shift, scale):
        rng = np.random.default_rng(5)
        x = ANGLES + 0.001 * rng.standard_normal(ANGLES.size)
        y = truth(ANGLES) + 0.002 * rng.standard_normal(ANGLES.size)
        plain = fit_sweep(x, 0.001, y, 0.002, degree=2).apply(ANGLES)
        moved = fit_sweep(shift + scale * x, scale * 0.001, y, 0.002, degree=2)
        again = moved.apply(shift + scale * ANGLES)
        assert again.angle_deg == pytest.approx(plain.angle_deg, abs=1e-8)
        assert again.systematic_std_deg == pytest.approx(plain.systematic_std_deg, rel=1e-5)

    def test_stated_intervals_hold_the_truth(self):
        rng = np.random.default_rng(6)
        at = np.array([-5.25, 0.1, 4.3])
        inside = []
        for _ in range(200):
            calibrated = noisy_sweep(rng, optical_std=0.002).apply(at)
            error = np.abs(calibrated.angle_deg - truth(at))
            inside.append(error < 1.96 * calibrated.systematic_std_deg)
        # 200 draws of 95 %: one sigma of the share is 1.5 %
        assert np.mean(inside, axis=0) == pytest.approx([0.95] * 3, abs=0.046)

    def test_scatter_beyond_the_stated_one_widens_the_covariance(self):
        rng = np.random.default_rng(7)
        onboard = truth(ANGLES) + 0.01 * rng.standard_normal(ANGLES.size)
        sweep = fit_sweep(ANGLES, 0.0002, onboard, 0.002, degree=2)
        stated = fit_sweep(ANGLES, 0.0002, truth(ANGLES), 0.002, degree=2)
        assert sweep.reduced_chi_square > 10
        widened = only_curve(sweep).covariance_deg2 / sweep.reduced_chi_square
        expected = only_curve(stated).covariance_deg2
        assert widened == pytest.approx(expected, rel=1e-3, abs=1e-12)

    def test_the_onboard_sensors_noise_has_a_default(self):
        sweep = fit_sweep(ANGLES, 0.0004, truth(ANGLES), None)
        assert {point.onboard_std_deg for point in sweep.points} == {DEFAULT_ONBOARD_STD_DEG}

    def test_accuracy_that_all_points_share_is_not_averaged(self):
        plain = fit_sweep(ANGLES, 0.0004, truth(ANGLES), 0.002, degree=2)
        shared = fit_sweep(
            ANGLES, 0.0004, truth(ANGLES), 0.002, degree=2, onboard_accuracy_deg=0.01
        )
        expected = np.hypot(plain.apply(1.0).systematic_std_deg, 0.01)
        assert shared.apply(1.0).systematic_std_deg == pytest.approx(expected)


class TestDegree:
    @pytest.mark.parametrize(
        ("coefficients", "degree"), [([0.1, 1.0], 1), ([0, 1, 2e-3], 2), ([0, 1, 0, 2e-4], 3)]
    )
    def test_the_criterion_finds_it(self, coefficients, degree):
        rng = np.random.default_rng(8)
        expected = np.polynomial.polynomial.polyval(ANGLES, coefficients)
        chosen = []
        for _ in range(40):
            onboard = expected + 0.002 * rng.standard_normal(ANGLES.size)
            sweep = fit_sweep(ANGLES, 0.0004, onboard, 0.002)
            criterion = only_curve(sweep).criterion
            assert set(criterion) == {1, 2, 3}
            assert criterion[sweep.degree] == 0
            chosen.append(sweep.degree)
        # the criterion takes a needless power where its coefficient exceeds about 1.6 sigma
        assert min(chosen) == degree
        assert np.mean(np.array(chosen) == degree) > 0.7

    @pytest.mark.parametrize(("points", "most"), [(3, 1), (4, 1), (5, 2), (6, 3), (9, 3)])
    def test_never_more_than_the_points_support(self, points, most):
        x = np.linspace(-6, 6, points)
        sweep = fit_sweep(x, 0.001, x + 0.01 * x**2 + 0.003 * x**3, 0.002)
        assert sweep.degree <= most
        assert max(only_curve(sweep).criterion, default=1) == most

    def test_repeated_angles_are_one_angle(self):
        x = np.repeat([-3.0, 3.0], 10) + np.linspace(0, 0.005, 20)
        assert fit_sweep(x, 0.001, x, 0.002).degree == 1

    def test_without_points_to_spare_there_is_no_chi_square(self):
        sweep = fit_sweep([-1, 0, 1], 0.001, [-1, 0.01, 1], 0.002, degree=2)
        assert sweep.degrees_of_freedom == 0
        assert sweep.reduced_chi_square is None

    def test_a_power_left_out_is_not_known_to_be_zero(self):
        rng = np.random.default_rng(11)
        straight = [noisy_sweep(rng, degree=None) for _ in range(20)]
        chosen = next(each for each in straight if each.degree == 2)
        assert len(only_curve(chosen).covariance_deg2) == 4
        alone = fit_sweep(chosen.optical_deg, 0.0004, chosen.onboard_deg, 0.002, degree=2)
        assert np.array_equal(alone.predict(ANGLES), chosen.predict(ANGLES))
        wider, as_given = (each.apply(ANGLES).systematic_std_deg for each in (chosen, alone))
        assert np.mean(wider**2) > np.mean(as_given**2)


class TestApply:
    def test_shape_nan_and_range(self):
        sweep = fit_sweep(ANGLES, 0.0004, truth(ANGLES), 0.002, degree=2)
        angle = np.array([[-6.05, -7.0, np.nan], [0.0, 6.1, 6.2]])
        calibrated, systematic, fitted, outside, gain, doubts = sweep.apply(angle)
        assert calibrated.shape == systematic.shape == outside.shape == gain.shape == (2, 3)
        assert np.array_equal(fitted, systematic, equal_nan=True)  # nothing else is uncertain
        assert doubts == (
            "the optical angle is -7.00 to 6.20 deg in 2 of 6, -6.00 to 6.00 in the sweep",
        )
        assert outside.tolist() == [[False, True, False], [False, False, True]]
        assert np.isnan(calibrated).tolist() == np.isnan(angle).tolist()
        assert calibrated[1] == pytest.approx(truth(angle[1]), abs=1e-10)
        assert systematic[0, 1] > systematic[1, 0]

    def test_derivative_is_the_slope_of_the_prediction(self):
        sweep = noisy_sweep(np.random.default_rng(9))
        step = 1e-5
        slope = (sweep.predict(ANGLES + step) - sweep.predict(ANGLES - step)) / (2 * step)
        assert sweep.derivative(ANGLES) == pytest.approx(slope, abs=1e-8)


class TestPredictionInterval:
    def test_it_is_of_the_normal_distribution_where_the_noise_is_as_stated(self):
        sweep = fit_sweep(ANGLES, 0.0004, truth(ANGLES), 0.002, degree=2)
        low, high = sweep.interval([1.0, 5.0], 0.003)
        applied = sweep.apply([1.0, 5.0])
        std = np.hypot(applied.systematic_std_deg, 0.003 * applied.gain)
        assert (high + low) / 2 == pytest.approx(applied.angle_deg)
        assert (high - low) / 2 == pytest.approx(1.959964 * std, rel=1e-6)
        narrow = sweep.interval(1.0, level=0.6827)
        assert (narrow[1] - narrow[0]) / 2 == pytest.approx(applied.systematic_std_deg[0], rel=1e-4)

    def test_and_students_with_the_points_scatter_where_that_is_larger(self):
        rng = np.random.default_rng(12)
        onboard = truth(ANGLES) + 0.01 * rng.standard_normal(ANGLES.size)
        sweep = fit_sweep(ANGLES, 0.0002, onboard, 0.002, degree=2)
        residuals = sweep.residuals_deg
        scatter = only_curve(sweep).scatter_deg
        # what is left of the points' variance when the stated one is taken off
        expected = residuals @ residuals / 22 - 0.002**2 - (1.012 * 0.0002) ** 2
        assert scatter == pytest.approx(np.sqrt(expected), rel=0.01)
        low, high = sweep.interval(0.0)
        freedom = 22 * (scatter**2 / (residuals @ residuals / 22)) ** 2
        factor = stats.t.ppf(0.975, freedom)
        assert factor > 2.0739  # of 22 degrees of freedom
        expected = factor * sweep.apply(0.0).systematic_std_deg
        assert (high - low) / 2 == pytest.approx(expected, rel=1e-4)
        assert sweep.apply(0.0).systematic_std_deg > scatter

    def test_intervals_at_a_point_are_of_the_calibration_and_of_another(self):
        sweep = noisy_sweep(np.random.default_rng(14))
        point = sweep.points[3]
        systematic = float(sweep.apply(point.optical_deg).systematic_std_deg)
        gain = float(sweep.derivative(point.optical_deg))
        noise = np.hypot(point.onboard_std_deg, gain * point.optical_std_deg)
        calibration, another = sweep.expanded_deg(point)
        assert calibration == pytest.approx(1.959964 * systematic, rel=1e-6)
        assert another == pytest.approx(1.959964 * np.hypot(systematic, noise), rel=1e-6)

    def test_covariance_agrees_with_the_systematic_uncertainty(self):
        sweep = noisy_sweep(np.random.default_rng(13), degree=None)
        covariance = sweep.covariance(ANGLES)
        expected = sweep.apply(ANGLES).systematic_std_deg ** 2
        assert np.diag(covariance) == pytest.approx(expected)
        assert np.linalg.matrix_rank(covariance, tol=1e-12) <= 4


class TestFile:
    def test_round_trip_to_the_last_bit(self, tmp_path):
        rng = np.random.default_rng(10)
        saved = fit_sweep(
            ANGLES,
            0.0004,
            truth(ANGLES) + 0.002 * rng.standard_normal(ANGLES.size),
            0.002,
            onboard_accuracy_deg=0.005,
            provenance=Provenance(files=("a.h5", "b.h5"), setup_hash="0123abc", date="1995-07-01"),
        )
        path = tmp_path / "sweep.toml"
        saved.save(path)
        loaded = PitchSweep.load(path)
        assert loaded.points == saved.points
        assert only_curve(loaded).criterion == only_curve(saved).criterion
        assert loaded.provenance == saved.provenance
        for ours, theirs in zip(loaded.apply(ANGLES), saved.apply(ANGLES), strict=True):
            assert np.array_equal(ours, theirs)
        text = path.read_text(encoding="utf-8")
        assert "# Degree" in text
        assert "onboard_deg = sum over k of coefficients_deg[k] * t^k" in text

    def test_it_is_not_overwritten_unasked(self, tmp_path):
        path = tmp_path / "sweep.toml"
        sweep = fit_sweep(ANGLES, 0.0004, truth(ANGLES), 0.002)
        sweep.save(path)
        message = f"{path}: exists already; choose another name or allow overwriting"
        with pytest.raises(OutputError, match=f"^{re.escape(message)}$"):
            sweep.save(path)
        sweep.save(path, overwrite=True)
        assert [each.name for each in tmp_path.iterdir()] == ["sweep.toml"]

    def test_a_folder_that_is_not_there(self, tmp_path):
        sweep = fit_sweep(ANGLES, 0.0004, truth(ANGLES), 0.002)
        with pytest.raises(OutputError, match="cannot be written"):
            sweep.save(tmp_path / "none" / "sweep.toml")

    def test_missing(self, tmp_path):
        path = tmp_path / "none.toml"
        message = f"{path}: no such pitch sweep; make one with glint-aoa calibrate sweep"
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
            PitchSweep.load(path)

    @pytest.mark.parametrize(
        ("old", "new", "said"),
        [
            ('kind = "pitch sweep"', "", "kind: missing"),
            (
                "chi_square",
                "chi_squared",
                "unknown key curve[0].chi_squared; did you mean chi_square?",
            ),
            ("[provenance]", "[provenance]\nextra = 1", "unknown key provenance.extra"),
            ("half_range_deg = 6.0", "half_range_deg = 0.0", "curve[0].half_range_deg: "),
            ("degrees_of_freedom = 23", "degrees_of_freedom = 3", "degrees_of_freedom of curve 1"),
            ("curve = 1", "curve = 0", "point[0].curve: "),
            ("    [\n        ", "    [\n        1.0,\n        ", "must be square, 2 x 2 at least"),
            ("    [\n        ", "    [\n        -", "covariance_deg2 has a negative variance"),
        ],
    )
    def test_malformed(self, tmp_path, old, new, said):
        path = tmp_path / "sweep.toml"
        fit_sweep(ANGLES, 0.0004, 1.01 * ANGLES, 0.002, degree=1).save(path)
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(CalibrationError, match=re.escape(said)) as caught:
            PitchSweep.load(path)
        assert str(caught.value).startswith(f"{path}: not a pitch sweep that can be used (")

    def test_of_the_first_version_still_loads(self, tmp_path):
        path = tmp_path / "sweep.toml"
        path.write_text(FIRST_VERSION)
        loaded = PitchSweep.load(path)
        assert [point.name for point in loaded.points] == ["a", "b", "c"]
        assert loaded.setup is None
        assert loaded.apply([-1.0, 0.5]).angle_deg == pytest.approx([-0.91, 0.605])
        std = np.hypot(0.001, 0.5 * 0.002)
        assert loaded.apply(0.5).systematic_std_deg == pytest.approx(std)
        assert loaded.apply(0.5, temperature_k=300.0, line_v=12.0).doubts == ()
        assert loaded.apply(1.2).outside
        loaded.save(path, overwrite=True)
        again = PitchSweep.load(path)
        assert again.points == loaded.points
        assert again.apply(0.5) == loaded.apply(0.5)

    @pytest.mark.parametrize(
        ("old", "new", "said"),
        [
            ("chi_square = 0.5", "", "fit.chi_square: missing"),
            ("[points]", "[points]\nextra = 1", "unknown key points.extra"),
            ("onboard_deg = [-0.91, 0.1, 1.11]", "onboard_deg = [0.1]", "not of one length"),
            ("degrees_of_freedom = 1", "degrees_of_freedom = 2", "degrees_of_freedom of curve 1"),
        ],
    )
    def test_of_the_first_version_malformed(self, tmp_path, old, new, said):
        path = tmp_path / "sweep.toml"
        assert old in FIRST_VERSION
        path.write_text(FIRST_VERSION.replace(old, new))
        with pytest.raises(CalibrationError, match=re.escape(said)):
            PitchSweep.load(path)

    def test_no_toml(self, tmp_path):
        path = tmp_path / "sweep.toml"
        path.write_bytes(b"\xff\xfe nonsense")
        with pytest.raises(CalibrationError, match="cannot be read"):
            PitchSweep.load(path)
        path.write_text("= 3")
        with pytest.raises(CalibrationError, match="not a TOML file"):
            PitchSweep.load(path)


def changed(values, index, value):
    values = np.array(values, float)
    values[index] = value
    return values


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (
            ([0, 1], 0.001, [0, 1], 0.002),
            {},
            "a pitch sweep needs at least 3 points at different angles, got 2; measure more points",
        ),
        (
            ([4.0, 4.001, 4.002, 4.003], 0.001, [4, 4, 4, 4], 0.002),
            {},
            "the pitch sweep holds one angle only (about 4.002 deg); "
            "measure points over the range of angles to be calibrated",
        ),
        (
            ([-1, -1, 1, 1], 0.001, [-1, -1, 1, 1], 0.002),
            {"degree": 2},
            "a polynomial of degree 2 needs 3 different angles, the pitch sweep holds 2; "
            "choose a lower degree or measure more angles",
        ),
        (
            (ANGLES, 0.001, ANGLES, 0.002),
            {"degree": 0},
            "degree is 0; give 1 for a straight line, or more",
        ),
        (
            (changed(ANGLES, 3, np.nan), 0.001, ANGLES, 0.002),
            {},
            "point 4: optical_deg is nan; leave that point out or repeat it",
        ),
        (
            (ANGLES, 0.001, changed(ANGLES, 2, np.inf), 0.002),
            {},
            "point 3: onboard_deg is inf; leave that point out or repeat it",
        ),
        (
            (ANGLES, 0.0, ANGLES, 0.002),
            {},
            "point 1: optical_std_deg is 0; an uncertainty must be greater than zero",
        ),
        (
            (ANGLES, 0.001, ANGLES, changed(np.ones(25), 4, -1)),
            {},
            "point 5: onboard_std_deg is -1; an uncertainty must be greater than zero",
        ),
        (
            (ANGLES, 0.001, ANGLES[:-1], 0.002),
            {},
            "onboard_deg holds 24 values for 25 optical angles; give one for each point",
        ),
        (
            (["a", "b", "c"], 0.001, [1, 2, 3], 0.002),
            {},
            "optical_deg does not hold numbers only; give angles in deg",
        ),
        (
            (ANGLES, 0.001, -ANGLES, 0.002),
            {},
            "the onboard angle falls where the optical angle rises; "
            "check glint.nose in the setup and the sign of the onboard channel",
        ),
        (
            (ANGLES, 0.001, np.deg2rad(ANGLES), 0.002),
            {},
            "the onboard angle changes 0.0175 deg per optical deg; "
            "check that both are in degrees and belong to the same points",
        ),
        (
            (ANGLES, 0.001, ANGLES, 0.002),
            {"onboard_accuracy_deg": -1.0},
            "onboard_accuracy_deg is -1.0; give zero or more [deg]",
        ),
    ],
)
def test_refusals(arguments, options, message):
    with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
        fit_sweep(*arguments, **options)
