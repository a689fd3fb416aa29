"""Sweeps at several tunnel temperatures: groups, interpolation, and what it leaves in doubt."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.sweep.fit import PitchSweep, SweepPoint, fit_sweep_points
from calibration.sweep.temperatures import BEND, TemperatureWeights, temperature_groups
from glint_aoa.errors import CalibrationError

ANGLES = np.arange(-6.0, 6.01, 2.0)


def points_at(temperature_k, offset_deg, *, scale=1.01, name=None):
    """A sweep without noise whose onboard angle has an offset of its own."""
    return [
        SweepPoint(
            name=f"{name or temperature_k} {number}",
            optical_deg=angle,
            optical_std_deg=0.001,
            onboard_deg=offset_deg + scale * angle,
            onboard_std_deg=0.001,
            temperature_k=temperature_k,
        )
        for number, angle in enumerate(ANGLES.tolist())
    ]


def swept(law, temperatures_k):
    """Sweeps whose offset follows a law of the temperature."""
    return fit_sweep_points([p for t in temperatures_k for p in points_at(t, law(t))], degree=1)


class TestGroups:
    def test_neighbours_within_2_k_are_of_one_sweep(self):
        temperatures = [300.0, 290.0, 291.5, 293.0, 301.9, 310.0]
        assert temperature_groups(temperatures) == [[1, 2, 3], [0, 4], [5]]

    def test_a_sweep_has_the_mean_temperature_of_its_points(self):
        sweep = fit_sweep_points(points_at(293.5, 0.0) + points_at(294.5, 0.0) + points_at(310, 0))
        assert sweep.temperatures_k == pytest.approx([294.0, 310.0])
        assert sweep.temperature_range_k == (293.5, 310.0)

    def test_one_curve_may_hold_points_that_do_not_say_theirs(self):
        sweep = fit_sweep_points([*points_at(294.0, 0.0), *points_at(None, 0.0)])
        assert len(sweep.curves) == 1

    def test_several_may_not(self):
        points = [*points_at(284.0, 0.0), *points_at(304.0, 0.0), points_at(None, 0.0)[2]]
        message = (
            "None 2 does not say its tunnel temperature, and the others were taken at 2 "
            "temperatures; give tunnel_temperature_K in its /meta or leave it out"
        )
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
            fit_sweep_points(points)

    def test_each_sweep_needs_its_points(self):
        message = (
            "a pitch sweep needs at least 3 points at different angles, got 2 at 304.0 K; "
            "measure more points"
        )
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
            fit_sweep_points(points_at(284.0, 0.0) + points_at(304.0, 0.0)[:2])

    def test_all_curves_have_one_degree(self):
        bent = [
            SweepPoint(f"b{a}", a, 1e-3, a + 0.01 * a * a, 1e-3, temperature_k=304.0)
            for a in ANGLES.tolist()
        ]
        sweep = fit_sweep_points(points_at(284.0, 0.0) + bent)
        assert [curve.degree for curve in sweep.curves] == [2, 2]

    @pytest.mark.parametrize("kelvin", [21.0, 0.0, 600.0])
    def test_celsius_is_not_taken_for_kelvin(self, kelvin):
        message = (
            f"p: a tunnel temperature of {kelvin:g} K cannot be; "
            "give it in kelvins, or with its unit"
        )
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
            SweepPoint("p", 0.0, 1e-3, 0.0, 1e-3, temperature_k=kelvin)


class TestInterpolation:
    @pytest.mark.parametrize("temperature", [284.0, 287.0, 294.0, 303.9, 304.0])
    def test_two_sweeps_are_joined_by_a_straight_line(self, temperature):
        sweep = swept(lambda t: 0.003 * (t - 284), [284.0, 304.0])
        expected = 0.003 * (temperature - 284) + 1.01 * ANGLES
        applied = sweep.apply(ANGLES, temperature_k=temperature)
        assert applied.angle_deg == pytest.approx(expected, abs=1e-12)
        assert applied.gain == pytest.approx(1.01)
        assert not applied.outside.any()

    @pytest.mark.parametrize("temperature", [284.0, 290.0, 296.0, 301.0, 309.0, 314.0])
    def test_more_by_a_parabola(self, temperature):
        def law(t):
            return 0.002 * (t - 284) - 1e-4 * (t - 284) ** 2

        for sweeps in ([284.0, 296.0, 314.0], [284.0, 290.0, 304.0, 314.0]):
            applied = swept(law, sweeps).apply(1.0, temperature_k=temperature)
            assert float(applied.angle_deg) == pytest.approx(law(temperature) + 1.01, abs=1e-12)

    @settings(max_examples=50, deadline=None, derandomize=True)
    @given(st.lists(st.floats(100, 400), min_size=1, max_size=6, unique=True), st.floats(90, 410))
    def test_weights_add_up_to_one_and_pass_through_the_sweeps(self, sweeps, temperature):
        known = np.sort(sweeps)
        if known.size > 1 and np.diff(known).min() < 2:
            return
        at = TemperatureWeights.at(temperature, known)
        assert at.best.sum() == pytest.approx(1)
        assert at.straight.sum() == pytest.approx(1)
        assert at.straight.min() >= 0
        for number, each in enumerate(known):
            on = TemperatureWeights.at(float(each), known)
            assert on.best == pytest.approx(np.eye(known.size)[number], abs=1e-9)
            assert on.doubt(known) == pytest.approx(0, abs=1e-9)

    def test_there_is_no_step_where_the_next_parabola_takes_over(self):
        known = np.array([280.0, 285.0, 295.0, 310.0, 312.5])
        values = np.array([0.0, 0.3, -0.2, 0.5, 0.1])
        for edge in known[1:-1]:
            before, after = (
                TemperatureWeights.at(edge + step, known).best @ values for step in (-1e-7, 1e-7)
            )
            assert before == pytest.approx(after, abs=1e-6)

    def test_the_file_keeps_the_temperatures(self, tmp_path):
        sweep = swept(lambda t: 0.003 * (t - 284), [304.0, 284.0])
        sweep.save(tmp_path / "sweep.toml")
        loaded = PitchSweep.load(tmp_path / "sweep.toml")
        assert loaded.temperatures_k.tolist() == [284.0, 304.0]
        assert loaded.predict(1.5, temperature_k=290.0) == sweep.predict(1.5, temperature_k=290.0)

    @pytest.mark.parametrize(
        ("old", "new", "said"),
        [
            ("temperature_K = 304.0", "temperature_K = 274.0", "must rise from curve to curve"),
            ("temperature_K = 304.0\n", "", "temperature_K is missing in a curve of several"),
        ],
    )
    def test_a_file_out_of_order_is_refused(self, tmp_path, old, new, said):
        path = tmp_path / "sweep.toml"
        swept(lambda t: 0.0, [284.0, 304.0]).save(path)
        head, curve, rest = path.read_text().partition("temperature_K = 304.0\n")
        path.write_text(head + curve.replace(old, new) + rest)
        with pytest.raises(CalibrationError, match=re.escape(said)):
            PitchSweep.load(path)


class TestDoubt:
    """What a law of temperature may do between the sweeps, and the stated uncertainty of it."""

    def variance(self, sweep, temperature):
        """Of the interpolation alone, where the curves' own is known."""
        whole = sweep.apply(0.0, temperature_k=temperature).systematic_std_deg ** 2
        weights = TemperatureWeights.at(temperature, sweep.temperatures_k).best
        own = sum(
            w**2 * float(c.variance_of(0.0)) for w, c in zip(weights, sweep.curves, strict=True)
        )
        return whole - own

    @pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
    def test_between_two_a_bend_of_a_fifth_is_one_sigma(self, share):
        def law(t):
            s = (t - 284) / 20
            return 0.1 * (s - BEND * s * (1 - s))

        sweep, at = swept(law, [284.0, 304.0]), 284 + 20 * share
        error = float(sweep.predict(0.0, temperature_k=at)) - law(at)
        assert abs(error) > 1e-4
        assert self.variance(sweep, at) == pytest.approx(error**2, rel=1e-6)

    def test_among_three_it_is_a_fifth_of_the_parabolas_part(self):
        def law(t):
            s = (t - 284) / 20
            return 0.1 * (s + s * s)

        sweep, at = swept(law, [284.0, 294.0, 304.0]), 289.0
        parabola = law(289.0) - (law(284.0) + law(294.0)) / 2
        bend = BEND / 4 * (law(294.0) - law(284.0))
        expected = BEND**2 * (parabola**2 + bend**2)
        assert self.variance(sweep, at) == pytest.approx(expected, rel=1e-6)

    def test_sweeps_that_agree_leave_none(self):
        sweep = swept(lambda t: 0.02, [284.0, 304.0])
        assert self.variance(sweep, 294.0) == pytest.approx(0, abs=1e-15)

    def test_outside_the_nearest_sweep_counts_and_the_whole_step_is_in_doubt(self):
        sweep = swept(lambda t: 0.003 * (t - 284), [284.0, 304.0])
        applied = sweep.apply(0.0, temperature_k=310.0)
        assert float(applied.angle_deg) == pytest.approx(0.06, abs=1e-12)
        assert self.variance(sweep, 310.0) == pytest.approx((0.003 * 6) ** 2, rel=1e-6)
        assert bool(applied.outside)
        assert applied.doubts == (
            "the tunnel temperature is 310.0 K, 284.0 to 304.0 K in the sweep",
        )

    @pytest.mark.parametrize(
        ("temperature", "outside"), [(282.1, False), (305.9, False), (281.9, True), (306.1, True)]
    )
    def test_two_kelvins_are_allowed(self, temperature, outside):
        sweep = swept(lambda t: 0.0, [284.0, 304.0])
        assert bool(sweep.apply(0.0, temperature_k=temperature).outside) is outside

    def test_one_sweep_knows_nothing_of_other_temperatures(self):
        sweep = swept(lambda t: 0.0, [294.0])
        assert not sweep.apply(0.0, temperature_k=295.9).outside
        applied = sweep.apply([0.0, np.nan], temperature_k=299.0)
        assert applied.outside.tolist() == [True, False]
        assert applied.doubts == ("the tunnel temperature is 299.0 K, 294.0 K in the sweep",)
        assert not sweep.apply(0.0).outside

    def test_an_unknown_temperature_is_flagged_and_as_uncertain_as_the_sweeps_differ(self):
        sweep = swept(lambda t: 0.003 * (t - 284), [284.0, 304.0])
        applied = sweep.apply(0.0)
        assert float(applied.angle_deg) == pytest.approx(0.03)
        assert float(applied.systematic_std_deg) == pytest.approx(0.03, rel=1e-3)
        assert applied.doubts == (
            "the sweep was taken at 2 temperatures and the point states none",
        )

    def test_covariance_of_points_at_their_own_temperatures(self):
        sweep = swept(lambda t: 0.003 * (t - 284), [284.0, 304.0])
        angle, warm = np.array([1.0, -3.0, 4.0]), [284.0, 291.0, 300.0]
        covariance = sweep.covariance(angle, warm)
        stds = [
            float(sweep.apply(x, temperature_k=t).systematic_std_deg)
            for x, t in zip(angle, warm, strict=True)
        ]
        assert np.sqrt(np.diag(covariance)) == pytest.approx(stds)
        assert np.linalg.eigvalsh(covariance).min() > -1e-15
