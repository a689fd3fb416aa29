"""Figures of a sweep and of a check: what is drawn, where, and in which units."""

import numpy as np
import pytest
from test_drift import CHECK_DEG, drift_of, turned
from test_sweep_outliers import moved, noisy_points
from test_sweep_temperature import points_at

from calibration.sweep.fit import fit_sweep, fit_sweep_points
from glint_aoa.report.figures import save_figure
from glint_aoa.report.sweep_figures import drift_figure, sweep_figure


def drawn(axes, label):
    (line,) = [line for line in axes.get_lines() if line.get_label() == label]
    return line


def labels(axes):
    return axes.get_legend_handles_labels()[1]


class TestSweep:
    def test_points_curve_and_units(self):
        angles = np.arange(-6.0, 6.01, 1.0)
        sweep = fit_sweep(angles, 0.001, 1.01 * angles + 0.1, 0.002, degree=1)
        above, below = sweep_figure(sweep).axes
        points = drawn(above, "points").get_xydata()
        assert points[:, 0] == pytest.approx(angles)
        assert points[:, 1] == pytest.approx(0.01 * angles + 0.1)
        assert drawn(above, "degree 1").get_ydata()[0] == pytest.approx(0.04)
        assert above.get_ylabel() == "onboard - optical [deg]"
        assert below.get_ylabel() == "residual [deg]"
        assert below.get_xlabel() == "optical angle before calibration [deg]"

    def test_bands_are_the_prediction_intervals(self):
        rng = np.random.default_rng(1)
        sweep = fit_sweep_points(noisy_points(rng), degree=2)
        _, below = sweep_figure(sweep).axes
        point, own = (band.get_paths()[0].vertices for band in below.collections[:2])
        systematic = sweep.apply(6.0).systematic_std_deg
        noise = sweep.residual_std_deg(sweep.points[0])
        assert own[:, 1].max() == pytest.approx(1.96 * systematic, rel=0.01)
        assert point[:, 1].max() == pytest.approx(1.96 * np.hypot(systematic, noise), rel=0.01)

    def test_ways_and_outliers(self):
        points = moved(noisy_points(np.random.default_rng(2), loop=lambda a: 0.008), 5, 0.06)
        figure = sweep_figure(fit_sweep_points(points, degree=2))
        above, below = figure.axes
        assert labels(above) == ["degree 2", "on the way up", "on the way down", "points",
                                 "left out"]  # fmt: skip
        assert drawn(above, "on the way down").get_xydata().shape == (12, 2)
        (cross,) = [line for line in below.get_lines() if line.get_marker() == "x"]
        (text,) = below.texts
        assert text.get_text().startswith("\N{UPWARDS ARROW} p05 +0.0")
        assert cross.get_ydata()[0] < 0.06  # drawn at the edge, not to scale
        assert "1 left out" in figure.get_suptitle()
        assert "down less up +0.00" in figure.get_suptitle()

    def test_one_curve_for_each_temperature(self, tmp_path):
        points = [*points_at(284.0, 0.0), *points_at(294.0, 0.02), *points_at(304.0, 0.05)]
        figure = sweep_figure(fit_sweep_points(points, degree=1))
        above, _ = figure.axes
        curves = [drawn(above, f"degree 1, {kelvin} K") for kelvin in (284.0, 294.0, 304.0)]
        assert [curve.get_ydata()[0] for curve in curves] == pytest.approx([-0.06, -0.04, -0.01])
        assert len({curve.get_color() for curve in curves}) == 3
        save_figure(figure, tmp_path / "sweep.png")


class TestDrift:
    def test_shifts_lines_and_verdict(self, tmp_path):
        drift = drift_of(turned(omega=0.02, phi=0.01))
        figure = drift_figure(drift)
        above, below = figure.axes
        ends = drawn(above, "straight line").get_xydata()
        assert ends[:, 0] == pytest.approx(CHECK_DEG[[0, -1]], abs=0.01)
        assert ends[:, 1] == pytest.approx([-0.01, -0.01], abs=0.002)
        assert drawn(below, "straight line").get_ydata() == pytest.approx([-0.48, -0.48], abs=0.03)
        assert above.get_ylabel() == "optical - onboard [deg]"
        assert below.get_ylabel() == "intercept - the sweep's [mm]"
        assert below.get_xlabel() == "onboard angle [deg]"
        assert figure.get_suptitle().replace("\n", " ") == drift.sentence
        save_figure(figure, tmp_path / "check.png")

    def test_without_intercepts(self):
        figure = drift_figure(drift_of(silent=["intercept_mm"]))
        _, below = figure.axes
        assert below.get_lines() == []
        assert [text.get_text() for text in below.texts] == ["no intercepts to compare"]
