"""The paper's figures as pictures and tables: what is drawn, and the command that makes them."""

import csv
import json
import re

import numpy as np
import pytest
from paper_points import das, described, written
from synthetic import line_fields

from glint_aoa.inertial.modes import TABLE_1, modes_toml
from glint_aoa.paper_figures import Axis, Curve, Fact, FigureData, Panel
from glint_aoa.records.fields import FieldInfo
from glint_aoa.report.paper_figures import paper_figure, said_of

TIME, ANGLE = Axis("time", "s"), Axis("angle", "deg")
X = np.linspace(0.0, 2.0, 5)


def figure_of(*panels, x=TIME, facts=(), beside=False):
    return paper_figure(FigureData(20, "A title", x, panels, facts, (), is_side_by_side=beside))


class TestPicture:
    def test_curves_axes_and_legend(self):
        bias = Axis("bias", "deg", has_zero=True)
        marks = ("line", "joined points", "points")
        curves = tuple(Curve(each, X, X - k, each) for k, each in enumerate(marks))
        figure = figure_of(Panel(bias, curves, marked_x=(1.5,)))
        (axes,) = figure.axes
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "bias [deg]")
        lines = {line.get_label(): line for line in axes.get_lines()}
        np.testing.assert_array_equal(lines["line"].get_xydata(), np.stack([X, X], axis=1))
        assert lines["line"].get_marker() in {"", "None"}
        assert lines["joined points"].get_marker() == "s"
        (points,) = axes.collections
        np.testing.assert_array_equal(points.get_offsets(), np.stack([X, X - 2], axis=1))
        assert [text.get_text() for text in axes.get_legend().get_texts()] == list(marks)
        colours = [lines["line"].get_color(), lines["joined points"].get_color()]
        assert colours == ["#0072B2", "#D55E00"]
        ends = [line.get_xydata().tolist() for line in lines.values() if line.get_alpha() is None]
        assert [[1.5, 0.0], [1.5, 1.0]] in ends
        assert [[0.0, 0.0], [1.0, 0.0]] in ends
        assert figure.get_suptitle() == "Figure 20. A title"

    def test_a_single_curve_needs_no_legend_and_no_zero(self):
        (axes,) = figure_of(Panel(ANGLE, (Curve("a", X, X + 5),))).axes
        assert axes.get_legend() is None
        assert axes.get_ylim()[0] > 4

    def test_panels_of_one_quantity_share_its_axis(self):
        one, two = Curve("a", X, X), Curve("b", X, 10 * X)
        figure = figure_of(Panel(ANGLE, (one,), "low"), Panel(ANGLE, (two,), "high"))
        low, high = figure.axes
        assert low.get_ylim() == high.get_ylim()
        assert high.get_ylim()[1] > 20.0
        assert (low.get_xlabel(), high.get_xlabel()) == ("", "time [s]")
        assert figure.get_supylabel() == "angle [deg]"
        assert high.get_title() == "high"

    def test_panels_of_two_quantities_do_not(self):
        power = Axis("power density of something", "deg^2/Hz", log=True, low=1.0)
        figure = figure_of(Panel(ANGLE, (Curve("a", X, X),)), Panel(power, (Curve("b", X, 1 + X),)))
        upper, lower = figure.axes
        assert upper.get_ylabel() == "angle [deg]"
        assert lower.get_ylabel() == "power density of something\n[deg^2/Hz]"
        assert lower.get_yscale() == "log"
        assert lower.get_ylim()[0] == 1.0
        assert lower.get_ylim()[1] > 3.0

    def test_side_by_side_with_words_along_the_axis(self):
        run = Axis("run", low=0.0, high=3.0)
        curve = Curve("a", X, X, "points")
        ticks = ((0.5, "first"), (2.0, "second"))
        facts = (Fact("largest", -0.21, "deg", -0.217), Fact("own", 1.0, "deg"))
        figure = figure_of(
            Panel(ANGLE, (curve,), "left", ticks=ticks),
            Panel(ANGLE, (curve,), "right"),
            x=run,
            facts=facts,
            beside=True,
        )
        left, right = figure.axes
        assert (left.get_title(), right.get_title()) == ("left", "right")
        assert (left.get_ylabel(), right.get_ylabel()) == ("angle [deg]", "")
        assert left.get_xlim() == (0.0, 3.0)
        assert [label.get_text() for label in left.get_xticklabels()] == ["first", "second"]
        title = "Figure 20. A title\nlargest: -0.210 deg (paper: -0.217 deg)"
        assert figure.get_suptitle() == title

    @pytest.mark.parametrize(
        ("fact", "here", "paper"),
        [
            (Fact("a", -0.14096, "deg", "negative"), "-0.141 deg", "negative"),
            (Fact("a", 0.00112, "deg", "below 0.005"), "0.0011 deg", "below 0.005 deg"),
            (Fact("a", 4001.3, "in lbf", 4000.0), "4001 in lbf", "4000 in lbf"),
            (Fact("a", 10.46, "", 10.0), "10.5", "10"),
            (Fact("a", 0.0, "deg"), "0 deg", "-"),
            (Fact("a", np.nan, "deg", 0.3), "-", "0.3 deg"),
        ],
    )
    def test_numbers_are_said_beside_the_papers(self, fact, here, paper):
        assert said_of(fact) == (here, paper)


@pytest.fixture(scope="module")
def points(tmp_path_factory):
    folder = tmp_path_factory.mktemp("points")
    rng = np.random.default_rng(1)
    info = FieldInfo(rate_hz=60.0, exposure_s=1e-3, first_line=98, interlaced=False)

    def point(name, excitation, **record):
        fields = line_fields(rng, n_fields=8, shape=(40, 200), row=20.0)
        meta = described("run", excitation)
        return written(folder, name, das(**record), meta, fields=fields, info=info)

    on = {"bias_deg": 0.05, "moment_in_lb": 1000.0}
    return [
        point("p1", "off"),
        point("p2", "yaw sine 9.8 Hz", **on),
        point("p3", "yaw sine 9.8 Hz", bias_deg=0.2, moment_in_lb=2000.0),
        point("p4", "off"),
    ]


@pytest.fixture
def program(program, monkeypatch, tmp_path):
    """Run the program in a folder with a setup."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    (tmp_path / "glint-aoa.toml").write_text(modes_toml(TABLE_1))
    return program


def test_the_command_writes_pictures_and_numbers(program, points, tmp_path):
    asked = ("-f", 28, "-f", 14, "-f", 33, "-f", 14)
    code, out, err = program("benchmark", "figures", *points, "-o", "figs", *asked)
    assert code == 0
    assert err == (
        "figure 33 is left out: no point with pitch modulated sine near 9.2 Hz with fields over "
        "4 s or more\n"
    )
    assert out.endswith("\nWrote 2 figures and figures.csv to figs\n")
    assert re.search(r"^14 +largest bias +-0.200 deg +-0.146 deg$", out, re.MULTILINE)
    names = sorted(path.name for path in (tmp_path / "figs").iterdir())
    assert names == [
        *("figure-14.csv", "figure-14.png", "figure-28.csv", "figure-28.png"),
        "figures.csv",
    ]
    assert (tmp_path / "figs/figure-14.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "figs/figure-14.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        "curve",
        "peak_to_peak_moment_in_lbf",
        "bias_of_the_inertial_angle_deg",
    ]
    measured = [row for row in rows if row["curve"] == "measured"]
    values = [float(row["bias_of_the_inertial_angle_deg"]) for row in measured]
    assert values == pytest.approx([-0.05, -0.2], abs=1e-5)
    with (tmp_path / "figs/figures.csv").open() as file:
        first = next(csv.DictReader(file))
    assert first["what"] == "largest bias"
    assert (first["paper"], first["unit"], first["points"]) == ("-0.146", "deg", "p2 p3")


def test_json_and_other_pictures(program, points, tmp_path):
    code, out, _ = program(
        *("benchmark", "figures", *points, "-o", "figs", "-f", 14, "--format", "svg", "--json")
    )
    assert code == 0
    (figure,) = json.loads(out)["figures"]
    assert figure["files"] == ["figs/figure-14.svg", "figs/figure-14.csv"]
    assert figure["points"] == ["p2", "p3"]
    assert figure["facts"][0]["paper"] == -0.146
    assert "<svg" in (tmp_path / "figs/figure-14.svg").read_text()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            ("-f", 38),
            "glint-aoa: figure 38 is no data figure of the paper; choose 11 to 37\n",
        ),
        (
            ("-f", 16),
            "figure 16 is left out: no point with pitch modulated sine near 9.2 Hz in a run that "
            "starts and ends with the shaker off\n"
            "glint-aoa: none of the figures asked for can be made from these points; see what each "
            "lacks above\n",
        ),
    ],
)
def test_what_cannot_be_made_ends_in_a_sentence(program, points, options, sentence):
    assert program("benchmark", "figures", *points, "-o", "figs", *options) == (2, "", sentence)


def test_a_figure_that_fails_does_not_stop_the_others(program, points, tmp_path):
    (tmp_path / "glint-aoa.toml").write_text("")
    code, _, err = program("benchmark", "figures", *points, "-o", "figs", "-f", 14, "-f", 37)
    assert code == 0
    assert err == (
        "figure 14 is left out: p2: the modal correction lacks modes: list each vibration mode as "
        "[[inertial.mode]] in the setup\n"
    )
    assert (tmp_path / "figs/figure-37.png").exists()


def test_nothing_is_replaced_unasked(program, points, tmp_path):
    (tmp_path / "figs").mkdir()
    (tmp_path / "figs/figure-14.csv").write_text("mine")
    asked = ("benchmark", "figures", *points, "-o", "figs", "-f", 14)
    code, _, err = program(*asked)
    assert code == 2
    assert err == (
        "glint-aoa: figs/figure-14.csv is there already; give another --out, or --overwrite to "
        "replace it\n"
    )
    assert (tmp_path / "figs/figure-14.csv").read_text() == "mine"
    assert program(*asked, "--overwrite")[0] == 0


def test_the_command_has_a_help_of_its_own(program):
    code, out, err = program("benchmark", "figures", "--help")
    assert (code, err) == (0, "")
    assert "benchmark figures [OPTIONS]" in out
    assert "--figure" in out
