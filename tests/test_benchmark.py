"""Runs and points, Table 4 and repeatability: by hand, and the paper's figures."""

import csv
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.benchmark import (
    PAPER_TABLE_4,
    BenchmarkPoint,
    moment_peak_to_peak_in_lb,
    point_errors,
    table4,
)
from glint_aoa.errors import InputError, OutputError, RecordingError
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.repeatability import PAPER_REPEATABILITY, repeatability
from glint_aoa.report.tables import (
    format_repeatability,
    format_table4,
    write_errors_csv,
    write_repeatability_csv,
    write_table4_csv,
)

PAPER_FACTS = Path(__file__).parents[2] / "shared" / "reference" / "paper-facts.toml"


def read_csv(path):
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def point(name, optical, inertial, corrected=None, *, run="1", plane="none", kind="off", **others):
    settings = {
        "excitation": "off" if plane == "none" else f"{plane} {kind} 9.8 Hz",
        "moment_in_lb_pp": 100.0,
        "optical_std_deg": 0.0015,
        "intercept_mm": 2.0,
        "intercept_std_mm": 0.01,
        "nominal_angle_deg": 0.0,
    } | others
    return BenchmarkPoint(
        run=run,
        point=name,
        plane=plane,
        kind=kind,
        optical_deg=optical,
        inertial_deg=inertial,
        corrected_deg=corrected,
        **settings,
    )


def two_runs():
    yaw = {"plane": "yaw", "kind": "sine"}
    random = {"plane": "yaw", "kind": "random"}
    pitch = {"plane": "pitch", "kind": "modulated sine", "run": "2"}
    return [
        point("1", 1.000, 2.000, 2.000, optical_std_deg=0.001, intercept_mm=2.00),
        point("2", 1.003, 1.900, 2.002, **yaw),
        point("3", 0.998, 1.800, 2.011, **yaw),
        point("4", 9.000, 9.000, 9.000),  # in the middle of a run: in no table, not in the zero
        point("5", 1.001, 1.700, 1.991, **random),
        point("6", 1.002, 2.002, 2.002, optical_std_deg=0.003, intercept_mm=2.04),
        point("7", -0.500, -0.400, run="2"),
        point("8", -0.490, -0.500, **pitch),
        point("9", -0.504, -0.406, run="2"),
    ]


class TestErrors:
    def test_by_hand(self):
        errors = point_errors(two_runs())
        assert [error.point.point for error in errors] == ["2", "3", "5", "8"]
        video = [error.video_deg for error in errors]
        inertial = [error.inertial_deg for error in errors]
        corrected = [error.corrected_deg for error in errors]
        assert video == pytest.approx([0.002, -0.003, 0.000, 0.012])
        assert inertial == pytest.approx([-0.101, -0.201, -0.301, -0.097])
        assert corrected[:3] == pytest.approx([0.001, 0.010, -0.010])
        assert corrected[3] is None

    @given(st.floats(-10, 10), st.floats(-10, 10))
    def test_what_a_technique_reads_with_the_shaker_off_does_not_matter(self, video, inertial):
        yaw = {"plane": "yaw", "kind": "sine"}
        (error,) = point_errors(
            [
                point("1", video, inertial),
                point("2", video + 0.01, inertial - 0.2, **yaw),
                point("3", video, inertial),
            ]
        )
        assert error.video_deg == pytest.approx(0.01, abs=1e-12)
        assert error.inertial_deg == pytest.approx(-0.2, abs=1e-12)

    def test_points_of_two_runs_may_be_mixed(self):
        points = two_runs()
        mixed = [points[i] for i in (0, 6, 1, 2, 7, 3, 4, 8, 5)]
        assert point_errors(mixed) == point_errors(points)

    def test_a_point_without_an_angle_has_no_error(self):
        points = two_runs()
        points[1] = point("2", math.nan, 1.9, plane="yaw", kind="sine")
        assert point_errors(points)[0].video_deg is None
        assert point_errors(points)[0].inertial_deg == pytest.approx(-0.101)

    @pytest.mark.parametrize(
        ("leave_out", "message"),
        [
            (
                0,
                "run 1: the first point must have the shaker off, point 2 has yaw sine 9.8 Hz; "
                "add that point or leave the run out",
            ),
            (
                8,
                "run 2: the last point must have the shaker off, point 8 has pitch modulated sine "
                "9.8 Hz; add that point or leave the run out",
            ),
        ],
    )
    def test_a_run_that_does_not_start_and_end_with_the_shaker_off(self, leave_out, message):
        points = two_runs()
        del points[leave_out]
        for evaluate in (point_errors, repeatability):
            with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
                evaluate(points)

    @pytest.mark.parametrize(
        ("points", "message"),
        [
            ([], "the benchmark holds no points; give the points of one run or more"),
            (
                [point("1", 0, 0)],
                "run 1: one point only, a run starts and ends with the shaker off; "
                "add its other points or leave the run out",
            ),
            (
                [point("1", 0, 0), point("2", math.nan, 0)],
                "run 1: the shaker-off point 2 has no video angle; "
                "measure it again or leave the run out",
            ),
        ],
    )
    def test_refusals(self, points, message):
        with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
            point_errors(points)

    @pytest.mark.parametrize(
        ("plane", "kind", "message"),
        [
            (
                "roll",
                "sine",
                "run 1, point 1: excitation plane is 'roll'; choose one of none, yaw, pitch",
            ),
            (
                "yaw",
                "off",
                "run 1, point 1: excitation plane is 'yaw' with kind 'off'; "
                "with the shaker off they are 'none' and 'off'",
            ),
        ],
    )
    def test_an_excitation_that_is_none(self, plane, kind, message):
        with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
            point("1", 0, 0, plane=plane, kind=kind)


class TestTable4:
    def test_by_hand(self):
        rows = {(r.technique, r.excitation): r for r in table4(point_errors(two_runs()))}
        assert list(rows) == [
            ("video", "yaw"),
            ("inertial", "yaw"),
            ("inertial corrected", "yaw"),
            ("video", "pitch"),
            ("inertial", "pitch"),
        ]
        video = rows["video", "yaw"]
        assert video.mean_deg == pytest.approx(-0.001 / 3)
        assert video.std_deg == pytest.approx(np.std([0.002, -0.003, 0.0], ddof=1))
        assert video.max_deg == pytest.approx(-0.003)
        assert video.points == 3
        assert video.paper == PAPER_TABLE_4["video", "yaw"]
        assert rows["inertial", "yaw"].max_deg == pytest.approx(-0.301)
        assert rows["inertial", "pitch"].std_deg is None
        assert rows["inertial corrected", "yaw"].paper is None

    def test_by_kind(self):
        rows = table4(point_errors(two_runs()), by_kind=True)
        counts = {(r.kind, r.excitation): r.points for r in rows if r.technique == "video"}
        assert counts == {
            ("all", "yaw"): 3,
            ("all", "pitch"): 1,
            ("sine", "yaw"): 2,
            ("modulated sine", "pitch"): 1,
            ("random", "yaw"): 1,
        }

    def test_text(self):
        text = format_table4(table4(point_errors(two_runs()), by_kind=True))
        lines = text.splitlines()
        assert lines[0] == "Table 4: error of the angle with the shaker on [deg]"
        assert max(len(line) for line in lines) <= 100
        assert "yaw  video  -0.0003  0.0025  -0.0030  3  +0.000  0.002  +0.006  49" in "\n".join(
            re.sub(r" +", "  ", line) for line in lines
        )

    def test_no_minus_zero(self):
        points = [
            point("1", 0.0, 0.0),
            point("2", -1e-6, 0.0, plane="yaw", kind="sine"),
            point("3", 0.0, 0.0),
        ]
        assert "-0.0000" not in format_table4(table4(point_errors(points)))

    def test_csv(self, tmp_path):
        path = tmp_path / "table4.csv"
        write_table4_csv(path, table4(point_errors(two_runs())))
        rows = read_csv(path)
        assert rows[0]["technique"] == "video"
        assert float(rows[0]["std_deg"]) == pytest.approx(0.0025166, abs=1e-7)
        assert rows[0]["paper_points"] == "49"
        assert rows[2]["paper_mean_deg"] == ""
        assert rows[3]["std_deg"] == ""
        message = f"{path}: exists already; choose another name or allow overwriting"
        with pytest.raises(OutputError, match=f"^{re.escape(message)}$"):
            write_table4_csv(path, [])

    def test_csv_of_the_errors(self, tmp_path):
        path = tmp_path / "errors.csv"
        errors = point_errors(two_runs())
        write_errors_csv(path, errors)
        rows = read_csv(path)
        assert [row["point"] for row in rows] == ["2", "3", "5", "8"]
        assert [float(row["video_error_deg"]) for row in rows] == [0.002, -0.003, 0.0, 0.012]
        assert rows[3]["corrected_error_deg"] == ""
        assert rows[0]["excitation"] == "yaw sine 9.8 Hz"


class TestRepeatability:
    def test_by_hand(self):
        points = [
            point("1", 1.000, 2.000, optical_std_deg=0.001, intercept_mm=2.00),
            point("2", 1.004, 2.002, optical_std_deg=0.003, intercept_mm=2.04),
            point("3", 0.998, 1.999, run="2", optical_std_deg=0.002, intercept_mm=2.02),
            point("4", 0.999, 1.998, run="2", optical_std_deg=0.002, intercept_mm=2.02),
            point("5", 4.300, 4.400, run="3", nominal_angle_deg=4.3, optical_std_deg=0.002),
            point("6", 4.301, 4.401, run="3", nominal_angle_deg=4.3, optical_std_deg=0.002),
        ]
        rows = {(row.quantity, row.statistic): row for row in repeatability(points)}
        assert list(rows) == list(PAPER_REPEATABILITY)
        value = {key: row.value for key, row in rows.items()}
        assert value["video angle, short term", "mean std"] == pytest.approx(0.002)
        assert value["video angle, short term", "max std"] == pytest.approx(0.003)
        assert value["intercept, short term", "mean std"] == pytest.approx(0.01 / 25.4)

        def pooled(level, other):
            level, other = np.array(level), np.array(other)
            squares = np.sum((level - level.mean()) ** 2) + np.sum((other - other.mean()) ** 2)
            return np.sqrt(squares / (3 + 1))

        video, onboard = [1.000, 1.004, 0.998, 0.999], [2.000, 2.002, 1.999, 1.998]
        expected = pooled(video, [4.300, 4.301])
        assert value["video angle, long term", "std"] == pytest.approx(expected)
        expected = pooled(onboard, [4.400, 4.401])
        assert value["onboard angle, long term", "std"] == pytest.approx(expected)
        expected = pooled(np.subtract(video, onboard), [-0.1, -0.1])
        assert value["video - onboard, long term", "std"] == pytest.approx(expected)
        expected = pooled([2.00, 2.04, 2.02, 2.02], [2.0, 2.0])
        assert rows["intercept, long term", "std"].value_mm == pytest.approx(expected)
        expected = np.std([-0.004, -0.001, -0.001], ddof=1)
        assert value["video angle, first - last", "std"] == pytest.approx(expected)
        expected = np.std([-0.002, 0.001, -0.001], ddof=1)
        assert value["onboard angle, first - last", "std"] == pytest.approx(expected)
        assert rows["video angle, first - last", "std"].count == 3
        assert rows["video angle, long term", "std"].count == 6

    def test_runs_without_a_nominal_angle_stand_alone(self):
        points = [
            point(str(i), angle, angle, run=run, nominal_angle_deg=None)
            for i, (run, angle) in enumerate([("1", 0.0), ("1", 0.002), ("2", 6.0), ("2", 6.0)])
        ]
        rows = {row.quantity: row.value for row in repeatability(points)}
        assert rows["video angle, long term"] == pytest.approx(0.001)

    def test_text_and_csv(self, tmp_path):
        rows = repeatability(two_runs()[6:])
        text = format_repeatability(rows)
        assert max(map(len, text.splitlines())) <= 100
        assert "video angle, short term" in text
        path = tmp_path / "repeatability.csv"
        write_repeatability_csv(path, rows)
        written = read_csv(path)
        assert len(written) == len(PAPER_REPEATABILITY)
        assert written[-1]["value"] == ""  # one run has no scatter of first minus last
        assert written[2]["units"] == "in"
        assert float(written[2]["value_mm"]) == pytest.approx(0.01)


class TestPaper:
    @pytest.fixture(scope="class")
    @classmethod
    def facts(cls):
        if not PAPER_FACTS.exists():
            pytest.skip("the paper's figures are not beside this checkout")
        return tomllib.loads(PAPER_FACTS.read_text(encoding="utf-8"))

    def test_table_4(self, facts):
        for row in facts["table_4"]:
            ours = PAPER_TABLE_4[row["technique"], row["excitation"]]
            assert ours.mean_deg == row["mean_deg"]
            assert ours.std_deg == row["std_deg"]
            assert ours.max_deg == row["max_deg"]
            assert ours.points == row["points"]
        assert len(PAPER_TABLE_4) == len(facts["table_4"])

    def test_repeatability(self, facts):
        optical = facts["optical"]
        paper = PAPER_REPEATABILITY
        for name in ("mean", "max"):
            angle, intercept = "short_term_std_deg", "short_term_intercept_std_in"
            assert paper["video angle, short term", f"{name} std"] == optical[angle][name]
            assert paper["intercept, short term", f"{name} std"] == optical[intercept][name]
        long_term = optical["long_term_std_deg"]
        assert paper["video angle, long term", "std"] == long_term["video"]
        assert paper["onboard angle, long term", "std"] == long_term["accelerometer"]
        assert paper["video - onboard, long term", "std"] == long_term["difference"]
        ends = optical["first_minus_last_std_deg"]
        assert paper["video angle, first - last", "std"] == ends["video"]
        assert paper["onboard angle, first - last", "std"] == ends["accelerometer"]


class TestMoment:
    def record(self, *channels):
        return AcquisitionRecord("p1", {channel.name: channel for channel in channels})

    def moment(self, axis, amplitude, *, units="N*m", quantity="moment", name="m"):
        samples = amplitude * np.sin(2 * np.pi * 10 * np.arange(800) / 800)
        return Channel(name, samples, 800.0, quantity=quantity, units=units, axis=axis)

    @pytest.mark.parametrize(("plane", "expected"), [("yaw", 4000.0), ("pitch", 600.0)])
    def test_peak_to_peak(self, plane, expected):
        newton_metre = 0.1129848290276167  # one inch pound-force
        record = self.record(
            self.moment("+x", 9.0, name="roll_moment"),
            self.moment("-y", 300 * newton_metre, name="pitch_moment"),
            self.moment("+z", 2000, units="in*lbf", name="yaw_moment"),
            self.moment("+z", 7, units="in*lbf", name="analyser_yaw_moment"),
            self.moment("+z", 9, units="N", quantity="force", name="force"),
        )
        assert moment_peak_to_peak_in_lb(record, plane) == pytest.approx(expected, rel=1e-9)

    def test_no_channel_or_no_sample(self):
        assert moment_peak_to_peak_in_lb(self.record(), "yaw") is None
        assert moment_peak_to_peak_in_lb(self.record(self.moment("+y", 1.0)), "yaw") is None
        assert moment_peak_to_peak_in_lb(self.record(self.moment(None, 1.0)), "yaw") is None
        assert moment_peak_to_peak_in_lb(self.record(self.moment("+z", 1.0)), "none") is None
        assert moment_peak_to_peak_in_lb(self.record(self.moment("+z", np.nan)), "yaw") is None

    def test_a_unit_that_is_no_moment(self):
        with pytest.raises(RecordingError, match="channel m: "):
            moment_peak_to_peak_in_lb(self.record(self.moment("+z", 1.0, units="K")), "yaw")
