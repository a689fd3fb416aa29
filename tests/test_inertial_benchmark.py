"""The inertial benchmark: the paper's figures on records from rigid-body kinematics."""

import json
import re
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
import rigid_body

from glint_aoa.cli import benchmark_inertial
from glint_aoa.cli._inertial_study import DAS_CHANNELS, study_records
from glint_aoa.cli._regression_study import PaperRow
from glint_aoa.errors import InputError
from glint_aoa.inertial import TABLE_1
from glint_aoa.inertial.modes import ModeShape, modes_toml
from glint_aoa.inertial_benchmark import (
    LIMIT_DEG,
    PAPER_FIGURES,
    FigureRow,
    StudyRecord,
    figure_row,
    table_1,
)
from glint_aoa.setup import Inertial
from render_sim.decay import ShutOff
from render_sim.excitation import Tones
from render_sim.modes import paper_model_system

SETUP = Inertial.model_validate(tomllib.loads(modes_toml(TABLE_1))["inertial"])
BOTH = {"modal": DAS_CHANNELS, "kinematic": ()}


@pytest.mark.parametrize("figure", [12, 13])
def test_the_higher_yaw_modes_shift_the_angle_as_in_figures_12_and_13(figure):
    """Driven by the shaker they hardly move alone: only kinematics can take the bias out."""
    (record,) = study_records(figure)
    row = figure_row(figure, [record], SETUP, methods=BOTH)
    assert np.sign(row.raw_deg) == PAPER_FIGURES[figure].sign
    assert abs(row.left_deg["kinematic"]) < 0.0005
    assert abs(row.left_deg["modal"]) < abs(row.raw_deg) + 1e-4
    assert row.is_met


def test_the_modulated_sine_of_figure_16_is_followed_by_both_methods():
    row = figure_row(16, study_records(16), SETUP, methods=BOTH)
    assert row.raw_deg < -0.1
    assert all(abs(left) < 0.0005 for left in row.left_deg.values())


def test_the_worst_of_several_levels_counts():
    records = [
        StudyRecord(
            rigid_body.record(rigid_body.sine(1, bias_deg=bias, duration_s=8.0)), static_deg=0.0
        )
        for bias in (0.03, 0.146)
    ]
    row = figure_row(14, records, SETUP, methods={"modal": ()})
    assert row.raw_deg == pytest.approx(-0.146, rel=0.02)
    assert abs(row.left_deg["modal"]) < LIMIT_DEG
    assert row.std_deg["modal"] == pytest.approx(0.00146, rel=0.05)
    assert row.is_met


@pytest.mark.parametrize(
    ("figure", "raw", "left", "met"),
    [
        (14, -0.146, {"modal": 0.0019, "kinematic": -0.0001}, True),
        (14, -0.146, {"modal": 0.0021, "kinematic": -0.0001}, False),
        (14, 0.146, {"modal": 0.0, "kinematic": 0.0}, False),
        (17, -0.11, {"modal": -0.10, "kinematic": 0.001}, True),
        (17, -0.11, {"modal": -0.12, "kinematic": 0.001}, False),
        (17, -0.11, {"modal": -0.10, "kinematic": 0.003}, False),
        (13, -0.002, {"modal": 0.0, "kinematic": 0.0}, False),
    ],
)
def test_a_figure_is_met_within_its_limits_only(figure, raw, left, met):
    row = FigureRow(PAPER_FIGURES[figure], raw, left, dict.fromkeys(left, 0.001))
    assert row.is_met is met


def test_figures_need_records_of_their_own():
    message = "figure 18 with 0 records; give records for 11 to 17"
    with pytest.raises(InputError, match=re.escape(message)):
        figure_row(18, [], SETUP, methods=BOTH)
    short = rigid_body.record(rigid_body.sine(1, duration_s=8.0))
    message = "rigid-body: too short on either side of the shaker's shut-off; record longer"
    with pytest.raises(InputError, match=re.escape(message)):
        figure_row(11, [StudyRecord(short, 0.0, off_s=7.5)], SETUP, methods={"modal": ()})


def shape_of(mode, *, frequency_hz=None, radius_m=None, noise=1e-4):
    station = np.array([0.1, 0.55, 0.9])
    radius = mode.radius_m if radius_m is None else radius_m
    return ModeShape(
        mode.number,
        mode.plane,
        frequency_hz or mode.frequency_hz,
        station,
        station - (0.9 - radius),
        np.full(3, noise),
    )


def test_table_1_is_matched_by_plane_and_frequency():
    shapes = [shape_of(mode) for mode in reversed(TABLE_1) if mode.number != 4]
    shapes.append(shape_of(TABLE_1[3], frequency_hz=25.0))
    rows = table_1(shapes, 0.9)
    assert [row.paper for row in rows] == list(TABLE_1)
    assert [row.is_met for row in rows] == [True, True, True, False, True, True]
    assert rows[3].found is None
    far = table_1([shape_of(TABLE_1[0], radius_m=0.80)], 0.9)[0]
    assert not far.is_met
    assert table_1([shape_of(TABLE_1[0], radius_m=0.80, noise=0.01)], 0.9)[0].is_met


def test_a_mode_decays_freely_from_where_the_shaker_left_it():
    """The free decay solves q'' + 2 z w q' + w^2 q = 0 and joins without a step or a corner."""
    mode = paper_model_system().mode[0]
    steady = Tones(np.array([mode.frequency]), np.array([0.003 * np.exp(0.7j)]))
    angle = ShutOff(mode, steady, off_s=2.0)
    step = 1e-5
    before = angle.at(np.array([2.0 - 2 * step, 2.0 - step]))
    after = angle.at(np.array([2.0, 2.0 + step]))
    assert after[0] - before[1] == pytest.approx(before[1] - before[0], rel=2e-2)
    assert after[1] - after[0] == pytest.approx(before[1] - before[0], rel=2e-2)
    natural = 2 * np.pi * mode.frequency
    roots = np.roots([1, 2 * mode.damping * natural, natural**2])  # of q'' + 2 z w q' + w^2 q = 0
    time = np.linspace(0.0, 1.0, 50)
    rate = steady.derivative().at(np.array([2.0]))[0]
    parts = np.linalg.solve([[1, 1], roots], [after[0], rate])
    free = (parts @ np.exp(np.outer(roots, time))).real
    np.testing.assert_allclose(angle.at(2.0 + time), free, atol=1e-12)
    assert np.max(np.abs(angle.at(np.array([12.0, 13.0])))) < 1e-6
    early = np.linspace(0, 1.9, 7)
    np.testing.assert_array_equal(angle.at(early), steady.at(early))


FOUND = {
    "table_1": [{"mode": 1, "plane": "yaw", "radius_in": 31.02, "met": True}],
    "figures": [{"figure": 14, "raw_deg": -0.146, "kinematic_left_deg": np.nan, "met": False}],
    "tables_2_3": [{"table": 2, "from_s": 15.0, "source": "pitch moment", "reduction": 0.891}],
}


@pytest.fixture
def program(program, monkeypatch, tmp_path):
    """Run the program in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    return program


@pytest.fixture
def study(monkeypatch):
    """The study without its minute of simulation; returns the seeds it was asked for."""
    seeds = []

    def found(seed):
        seeds.append(seed)
        return {name: [{"met": True, **row} for row in rows] for name, rows in FOUND.items()}

    monkeypatch.setattr(benchmark_inertial, "_study", found)
    return seeds


def test_benchmark_inertial_prints_and_writes_its_tables(program, tmp_path, study):
    code, out, err = program("benchmark", "inertial", "--seed", 3, "--out", "res")
    assert (code, err, study) == (0, "", [3])
    assert re.search(r"met +mode +plane +radius in\nyes +1 +yaw +31.02\n", out)
    assert re.search(r"figure +raw +kinematic left\nno +14 +-0.1460 +-\n", out)
    assert re.search(r"source +reduction\nyes +2 +15 +pitch moment +89%\n", out)
    assert out.endswith(
        "Wrote res/inertial-table1.csv, res/inertial-figures.csv, res/inertial-tables23.csv\n"
    )
    first = (tmp_path / "res/inertial-table1.csv").read_text()
    assert first.startswith("met,mode,plane,radius_in\n")
    code, _, err = program("benchmark", "inertial", "--out", "res")
    assert code == 2
    assert "inertial-table1.csv" in err
    assert program("benchmark", "inertial", "--out", "res", "--overwrite")[0] == 0


def test_benchmark_inertial_is_strict_and_speaks_json(program, study):
    code, out, _ = program("benchmark", "inertial", "--json", "--strict")
    assert code == 3
    assert json.loads(out)["figures"][0]["kinematic_left_deg"] is None


def test_benchmark_inertial_has_a_help_of_its_own(program):
    code, out, err = program("benchmark", "inertial", "--help")
    assert (code, err) == (0, "")
    assert "  Example: glint-aoa benchmark inertial --out results\n" in out
    assert "--seed" in out
    code, out, _ = program("benchmark", "--help")
    assert "POINT" in out
    assert "--seed" not in out


def test_benchmark_of_points_still_asks_for_its_folder(program):
    code, _, err = program("benchmark", "./inertial")
    assert code == 2
    assert "Missing option '--out' / '-o'" in err


@pytest.mark.parametrize(
    ("paper", "reduction", "is_correlated", "met"),
    [
        (0.91, 0.95, True, True),
        (0.91, 0.90, True, False),
        (0.91, 0.90, False, False),
        (0.58, 0.57, False, True),
        (0.58, 0.57, True, False),
    ],
)
def test_a_warning_stands_for_a_reduction_only_where_the_papers_failed_too(
    paper, reduction, is_correlated, met
):
    printed = PaperRow("yaw", (10, 30), "moment", -0.433, 1.0, -0.148, -0.285, 1 - paper)
    figures = {"bias_deg": -0.15, "standard_error_deg": 0.007, "reduction": reduction}
    row = SimpleNamespace(
        paper=printed, paper_reduction=paper, figures=figures, is_correlated=is_correlated
    )
    assert benchmark_inertial._regression_row(row)["met"] is met
