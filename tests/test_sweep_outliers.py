"""Points off the curve, points given twice, and the difference between up and down."""

import re
from dataclasses import replace

import numpy as np
import pytest

from calibration.sweep._hysteresis import directions
from calibration.sweep.fit import PitchSweep, SweepPoint, fit_sweep_points
from calibration.sweep.point import in_order_of_time
from glint_aoa.errors import CalibrationError

UP_AND_DOWN = np.r_[np.arange(-6.0, 6.01, 1.0), np.arange(5.0, -6.01, -1.0)]
NOISE = 0.002


def noisy_points(rng, angles=UP_AND_DOWN, *, loop=None, stated=NOISE):
    """Points in the order of time; `loop` is added on the way down, half of it taken off before."""
    middle = int(np.argmax(angles))
    down = np.arange(angles.size) > middle
    width = np.zeros(angles.size) if loop is None else loop(angles)
    onboard = 0.05 + 1.012 * angles + 2e-4 * angles**2 + np.where(down, 0.5, -0.5) * width
    onboard = onboard + NOISE * rng.standard_normal(angles.size)
    return [
        SweepPoint(
            name=f"p{number:02d}",
            optical_deg=x,
            optical_std_deg=stated / 10,
            onboard_deg=y,
            onboard_std_deg=stated,
            time=f"2026-01-12T{8 + number // 12:02d}:{5 * (number % 12):02d}:00",
        )
        for number, (x, y) in enumerate(zip(angles.tolist(), onboard.tolist(), strict=True))
    ]


def moved(points, number, by):
    points = list(points)
    points[number] = replace(points[number], onboard_deg=points[number].onboard_deg + by)
    return points


class TestOutliers:
    @pytest.mark.parametrize("number", [0, 3, 12, 24], ids=["first", "middle", "end", "last"])
    def test_a_wrong_point_is_named_with_its_distance_and_left_out(self, number):
        clean = noisy_points(np.random.default_rng(1))
        without = fit_sweep_points([p for k, p in enumerate(clean) if k != number], degree=2)
        sweep = fit_sweep_points(moved(clean, number, 0.03), degree=2)
        ((point, reason),) = sweep.left_out.items()
        assert point.name == f"p{number:02d}"
        said = re.fullmatch(
            r"([\d.]+) deg off the curve of the other points, ([\d.]+) times what noise explains "
            r"\(limit 3\.5\)",
            reason,
        )
        others = np.array([(p.optical_deg, p.onboard_deg) for p in clean if p.name != point.name])
        cubic = np.polyfit(*others.T, 3)
        off = clean[number].onboard_deg + 0.03 - np.polyval(cubic, point.optical_deg)
        assert float(said[1]) == pytest.approx(off, abs=1e-4)
        assert float(said[2]) > 6
        assert sweep.predict(2.5) == pytest.approx(without.predict(2.5), abs=1e-12)
        assert point not in sweep.points
        left = clean[number].onboard_deg + 0.03 - without.predict(point.optical_deg)
        assert sweep.residual_deg(point) == pytest.approx(float(left), abs=1e-12)

    def test_two_that_hide_each_other_are_both_found(self):
        points = noisy_points(np.random.default_rng(2))
        points = moved(moved(points, 12, 0.03), 11, 0.03)
        assert {p.name for p in fit_sweep_points(points).left_out} == {"p11", "p12"}

    def test_they_are_found_where_the_stated_noise_is_too_small(self):
        points = moved(noisy_points(np.random.default_rng(3), stated=NOISE / 8), 5, 0.03)
        ((point, reason),) = fit_sweep_points(points).left_out.items()
        assert point.name == "p05"
        limit = float(re.search(r"limit ([\d.]+)", reason)[1])
        assert limit > 3.6  # Student's: the scatter of the others was taken

    def test_noise_alone_is_left_in(self):
        rng = np.random.default_rng(4)
        named = [len(fit_sweep_points(noisy_points(rng), degree=2).left_out) for _ in range(80)]
        # 1 in 100 sweeps by chance: 4 of 80 has a probability of 1 %
        assert np.count_nonzero(named) < 4

    def test_no_more_than_a_fifth(self):
        points = noisy_points(np.random.default_rng(5))
        for number in (2, 6, 9, 15, 19, 22, 24):
            points = moved(points, number, 0.05)
        sweep = fit_sweep_points(points)
        assert len(sweep.left_out) <= 5
        assert sweep.reduced_chi_square > 10

    @pytest.mark.parametrize("count", [3, 4, 5])
    def test_few_points_are_not_tested(self, count):
        angles = np.linspace(-6, 6, count)
        points = moved(noisy_points(np.random.default_rng(6), angles), 1, 0.03)
        assert fit_sweep_points(points).left_out == {}

    def test_of_five_points_four_on_a_line_say_nothing_of_the_fifth(self):
        points = noisy_points(np.random.default_rng(6), np.linspace(-6, 6, 5))
        points = [replace(point, onboard_deg=1.01 * point.optical_deg) for point in points]
        assert fit_sweep_points(moved(points, 1, 0.03)).left_out == {}

    def test_they_stay_in_the_file(self, tmp_path):
        sweep = fit_sweep_points(moved(noisy_points(np.random.default_rng(7)), 5, 0.03))
        sweep.save(tmp_path / "sweep.toml")
        loaded = PitchSweep.load(tmp_path / "sweep.toml")
        assert loaded.left_out == sweep.left_out
        assert len(loaded.points) == 24


class TestDuplicates:
    def test_a_name_given_twice(self):
        points = noisy_points(np.random.default_rng(8))
        with pytest.raises(
            CalibrationError, match=r"^point p03 is given twice; give each point once$"
        ):
            fit_sweep_points([*points, points[3]])

    def test_a_copy_under_another_name(self):
        points = noisy_points(np.random.default_rng(8))
        message = (
            "points p03 and copy hold the same recording (taken at 2026-01-12T08:15:00, the same "
            "angles to the last digit); give one of them"
        )
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
            fit_sweep_points([*points, replace(points[3], name="copy")])


class TestHysteresis:
    def test_directions_are_those_of_the_steps(self):
        angles = [0.0, 1.0, 2.0, 2.001, 1.0, 1.5]
        points = [SweepPoint(str(a), a, 1e-3, a, 1e-3) for a in angles]
        assert directions(points) == [0, 1, 1, 1, -1, 1]

    def test_points_are_in_the_order_of_time_whatever_the_order_given(self):
        points = noisy_points(np.random.default_rng(9))
        mixed = [points[k] for k in np.random.default_rng(1).permutation(25)]
        assert in_order_of_time(mixed) == points
        loops = [fit_sweep_points(each, degree=2).curves[0].hysteresis for each in (mixed, points)]
        assert loops[0] == loops[1]
        silent = [replace(point, time="") for point in mixed]
        assert in_order_of_time(silent) == silent

    def test_a_constant_width_is_measured_and_significant(self):
        points = noisy_points(np.random.default_rng(10), loop=lambda a: 0.008)
        sweep = fit_sweep_points(points, degree=2)
        loop = sweep.curves[0].hysteresis
        assert abs(loop.width_deg - 0.008) < 3 * loop.std_deg
        # 12 points each way: NOISE * sqrt(1/12 + 1/12), a little more for the polynomial
        assert loop.std_deg == pytest.approx(NOISE * np.sqrt(2 / 12), rel=0.08)
        assert loop.is_significant
        assert "p00" not in loop.up + loop.down
        assert (loop.up[0], loop.up[-1], loop.down[0], loop.down[-1]) == (
            "p01",
            "p12",
            "p13",
            "p24",
        )
        half = loop.width_deg / 2
        assert sweep.lasting_std_deg() >= half
        assert sweep.apply(0.0).systematic_std_deg == pytest.approx(half, rel=0.15)

    def test_its_interval_is_students_where_the_scatter_is_estimated(self):
        points = noisy_points(np.random.default_rng(10), loop=lambda a: 0.008)
        stated = fit_sweep_points(points, degree=2).curves[0].hysteresis
        assert stated.u95_deg == pytest.approx(1.959964 * stated.std_deg, rel=1e-6)
        precise = [replace(point, onboard_std_deg=1e-4, optical_std_deg=1e-5) for point in points]
        found = fit_sweep_points(precise, degree=2).curves[0].hysteresis
        assert found.degrees_of_freedom == 25 - 4
        assert found.u95_deg == pytest.approx(2.0796 * found.std_deg, rel=1e-4)  # tabulated
        assert found.p_value < 1e-6

    def test_a_loop_that_closes_shows_its_mean_width(self):
        points = noisy_points(np.random.default_rng(11), loop=lambda a: 0.012 * (1 - (a / 6) ** 2))
        loop = fit_sweep_points(points, degree=2).curves[0].hysteresis
        assert loop.is_significant
        assert loop.width_deg == pytest.approx(0.008, abs=3 * loop.std_deg)

    def test_noise_alone_is_significant_once_in_a_hundred_sweeps(self):
        rng = np.random.default_rng(12)
        loops = [
            fit_sweep_points(noisy_points(rng), degree=2).curves[0].hysteresis for _ in range(60)
        ]
        assert sum(loop.is_significant for loop in loops) < 4
        widths = np.array([loop.width_deg / loop.std_deg for loop in loops])
        assert widths.std() == pytest.approx(1, abs=0.27)  # 3 sigma

    def test_one_way_has_none(self):
        points = noisy_points(np.random.default_rng(13), np.arange(-6.0, 6.01, 1.0))
        assert fit_sweep_points(points).curves[0].hysteresis is None

    def test_nor_have_ways_that_cover_different_angles(self):
        angles = np.r_[np.arange(-6.0, 6.01, 1.0), 5.0, 4.0, 3.0, 2.0]
        assert (
            fit_sweep_points(noisy_points(np.random.default_rng(14), angles)).curves[0].hysteresis
            is None
        )

    def test_it_stays_in_the_file(self, tmp_path):
        sweep = fit_sweep_points(noisy_points(np.random.default_rng(15), loop=lambda a: 0.008))
        sweep.save(tmp_path / "sweep.toml")
        loaded = PitchSweep.load(tmp_path / "sweep.toml")
        assert loaded.curves[0].hysteresis == sweep.curves[0].hysteresis
        assert loaded.lasting_std_deg() == sweep.lasting_std_deg()
