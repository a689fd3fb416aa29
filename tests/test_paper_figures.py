"""The paper's data figures as numbers: what feeds them, and what they come down to."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from paper_points import channel, das, described, gain, modulated, written
from synthetic import line_fields

from glint_aoa.benchmark import BenchmarkPoint, PointError
from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial.modes import TABLE_1, modes_toml
from glint_aoa.paper_figures import (
    FIGURES,
    CampaignPoint,
    FigureSource,
    MissingPointError,
    make_figure,
    read_points,
)
from glint_aoa.paper_figures.errors import errors_by_run, scatter_against_moment
from glint_aoa.paper_figures.figure_data import Axis, Curve, FigureData, Panel
from glint_aoa.paper_figures.points import chosen
from glint_aoa.paper_figures.table import Wanted
from glint_aoa.paper_figures.video import MeasuredFilm, film_figure, films_of
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.fields import FieldInfo
from glint_aoa.setup import Setup
from render_sim.campaign import load_campaign, point_acquisition

PAPER_FACTS = Path(__file__).parents[2] / "shared" / "reference" / "paper-facts.toml"
INCH = 0.0254
SETUP = Setup.model_validate(tomllib.loads(modes_toml(TABLE_1)))


def facts(data):
    return {fact.what: fact.value for fact in data.facts}


def curves(data):
    return {curve.label: curve for panel in data.panels for curve in panel.curves}


def made(number, *paths):
    return make_figure(number, FigureSource(read_points(paths, SETUP)))


@pytest.fixture
def paper():
    """The paper's numbers, from the file beside the repository."""
    if not PAPER_FACTS.exists():
        pytest.skip("the paper's numbers are not beside this repository")
    return tomllib.loads(PAPER_FACTS.read_text(encoding="utf-8"))


class TestTable:
    def test_every_data_figure_of_the_paper_is_there(self, paper):
        assert sorted(FIGURES) == sorted(map(int, paper["figures"])) == list(range(11, 38))
        assert all(spec.number == number for number, spec in FIGURES.items())

    def test_each_wants_the_excitation_that_the_paper_shows(self, paper):
        told = {int(number): words for number, words in paper["figures"].items()}
        planes = {number: re.findall(r"\b(yaw|pitch)\b", words) for number, words in told.items()}
        for number, words in told.items():
            wanted = FIGURES[number].wanted
            if len(planes[number]) == 1:
                assert wanted.plane == planes[number][0], number
            frequency = re.search(r"([\d.]+) Hz", words)
            if frequency and wanted.kind != "random":
                assert wanted.frequency_hz == pytest.approx(float(frequency[1]), rel=0.01), number
            if "random" in words or "modulated" in words or "sine" in words:
                kind = ("random", "modulated sine", "sine")
                assert wanted.kind == next(each for each in kind if each.split()[0] in words)
            if "against time" in words:
                assert FIGURES[number].x.label == "time [s]", number
        assert FIGURES[35].wanted == FIGURES[33].wanted
        assert FIGURES[36].wanted == FIGURES[34].wanted
        assert FIGURES[32].wanted == FIGURES[31].wanted

    def test_published_numbers_are_the_papers(self, paper):
        modal, temporal = paper["modal_correction"], paper["temporal"]
        for number, key in ((14, "yaw_first_mode_deg"), (15, "pitch_first_mode_deg")):
            said = FIGURES[number].paper
            assert [said["largest bias"], said["largest left"]] == modal[key]
        assert FIGURES[31].paper["largest change"] == temporal["yaw_video_angle_change_deg"]
        assert FIGURES[31].paper["at a moment of"] == temporal["yaw_9_8_hz_largest_moment_in_lb_pp"]
        assert FIGURES[32].paper["largest change"] == temporal["yaw_intercept_change_in"]
        assert FIGURES[35].paper["largest change"] == temporal["pitch_9_2_hz_intercept_change_in"]
        largest = {
            (row["excitation"], row["technique"]): row["max_deg"] for row in paper["table_4"]
        }
        for (plane, technique), value in largest.items():
            assert FIGURES[27].paper[f"{plane}, {technique}, largest"] == value
        rows = {(row["segment_s"][0], row["source"]): row for row in paper["table_2"]}
        assert FIGURES[24].paper["standard error"] == rows[15, "pitch moment"]["standard_error_deg"]
        first = rows[20, "pitch moment"]["standard_error_deg"]
        assert FIGURES[25].paper["standard error"] == pytest.approx(first, abs=5e-4)
        yaw = paper["table_3"][0]["standard_error_deg"]
        assert FIGURES[26].paper["standard error"] == yaw

    def test_a_figure_that_is_none(self):
        message = "figure 10 is no data figure of the paper; choose 11 to 37"
        with pytest.raises(InputError, match=re.escape(message)):
            make_figure(10, FigureSource([]))

    def test_what_is_wanted_is_said_in_words(self):
        said = {number: str(FIGURES[number].wanted) for number in (11, 14, 24, 29, 31, 33)}
        assert said == {
            11: "yaw sine near 9.8 Hz with the shaker shut off within the record",
            14: "yaw sine near 9.8 Hz at 0 deg in a run that starts and ends with the shaker off",
            24: "pitch modulated sine near 9.2 Hz recorded for 60 s or more",
            29: "yaw at an angle other than 0 deg in a run that starts and ends with the shaker "
            "off",
            31: "yaw sine near 9.8 Hz at 0 deg in a run that starts and ends with the shaker off "
            "at 4100 in lbf or less",
            33: "pitch modulated sine near 9.2 Hz with fields over 4 s or more",
        }
        assert str(Wanted()) == "any excitation"


class TestChoice:
    @pytest.fixture
    def points(self, tmp_path):
        off, on = das(seconds=1.0), das(bias_deg=0.1, moment_in_lb=1000.0, seconds=1.0)
        return read_points(
            [
                written(tmp_path, "a1", off, described("a", "off")),
                written(tmp_path, "a2", on, described("a", "yaw sine 9.8 Hz")),
                written(tmp_path, "a3", on, described("a", "yaw modulated sine 9.75 Hz at 0.3 Hz")),
                written(tmp_path, "a4", off, described("a", "off")),
                written(tmp_path, "b", on, described("b", "yaw sine 9.8 Hz")),
                written(
                    tmp_path, "c", on, described("c", "yaw sine 19.5 Hz", nominal_angle_deg=4.3)
                ),
                written(
                    tmp_path,
                    "d",
                    on,
                    described(
                        "d",
                        "yaw sine sweep 5-60 Hz",
                        run_kind="record",
                        excitation_kind="sine sweep",
                        excitation_plane="yaw",
                    ),
                ),
            ],
            SETUP,
        )

    @pytest.mark.parametrize(
        ("wanted", "names"),
        [
            (Wanted("yaw", "sine", 9.8), "a2 b"),
            (Wanted("yaw", "sine", 9.8, in_run=True), "a2"),
            (Wanted("yaw", "modulated sine", 9.8), "a3"),
            (Wanted("yaw", "sine", 19.5), "c"),
            (Wanted("yaw", "sine", angle_deg=0.0), "a2 b"),
            (Wanted("yaw", other_than_deg=0.0), "c"),
            (Wanted(), "a2 a3 b c"),
            (Wanted(least_s=1.0, most_in_lb=1000.5), "a2 a3 b c"),
        ],
        ids=str,
    )
    def test_points_are_chosen_by_what_they_say(self, points, wanted, names):
        assert [point.name for point in chosen(points, wanted)] == names.split()

    @pytest.mark.parametrize(
        ("wanted", "words"),
        [
            (Wanted("pitch"), "no point with pitch"),
            (Wanted(least_s=1.1), "no point with any excitation recorded for 1.1 s or more"),
            (Wanted(most_in_lb=900.0), "no point with any excitation at 900 in lbf or less"),
            (Wanted(least_film_s=1.0), "no point with any excitation with fields over 1 s or more"),
            (
                Wanted(shuts_off=True),
                "no point with any excitation with the shaker shut off within the record",
            ),
        ],
        ids=str,
    )
    def test_what_is_missing_is_said(self, points, wanted, words):
        with pytest.raises(MissingPointError, match=f"^{re.escape(words)}$"):
            chosen(points, wanted)

    def test_a_sine_sweep_feeds_no_figure(self, points):
        assert "d" not in [point.name for point in points]

    def test_the_zero_is_that_of_the_runs_ends(self, tmp_path):
        paths = [
            written(tmp_path, f"p{k}", das(angle_deg=angle, bias_deg=bias, seconds=1.0), meta)
            for k, (angle, bias, meta) in enumerate(
                (
                    (0.10, 0.0, described("r", "off")),
                    (0.10, 0.2, described("r", "yaw sine 9.8 Hz")),
                    (0.14, 0.0, described("r", "off")),
                )
            )
        ]
        assert read_points(paths, SETUP)[1].zero_deg() == pytest.approx(0.12, abs=1e-9)

    def test_a_file_without_a_description(self, tmp_path):
        path = written(tmp_path, "p", das(seconds=1.0), {"run": "r"})
        message = "p.h5: /meta does not say excitation; a comparison needs run, point and"
        with pytest.raises(RecordingError, match=re.escape(message)):
            read_points([path], SETUP)

    def test_when_the_shaker_stopped_shows_in_its_signal(self, tmp_path):
        record = das(seconds=10.0)
        time = record["aoa_filtered"].time_s
        drive = np.where(time < 4.0, np.sin(2 * np.pi * 9.8 * time), 0.05 * np.cos(71 * time))
        shaker = replace(channel("shaker", drive, "excitation", "V", "+y"), start_s=0.5)
        record = AcquisitionRecord("das", {"shaker": shaker, **record.channels})
        point = CampaignPoint(Path("p.h5"), None, SETUP)
        for seen, off_s in ((record, 4.5), (das(seconds=10.0), None)):
            point.__dict__.pop("off_s", None)
            point.__dict__["record"] = seen
            assert point.off_s == (None if off_s is None else pytest.approx(off_s, abs=0.1))


@pytest.mark.parametrize(
    ("number", "name", "sign"),
    [
        (11, "yaw-9.8hz-shaker-off", -1),
        (12, "yaw-19.5hz-shaker-off", -1),
        (13, "yaw-29.8hz-shaker-off", 1),
    ],
)
def test_the_angle_shifts_with_the_sign_of_the_radius(number, name, sign, tmp_path):
    campaign = load_campaign("paper")
    (point,) = (each for each in campaign.points if each.name == name)
    acquired = point_acquisition(campaign, point)
    kept = ("aoa_unfiltered", "aoa_filtered", "ay_face", "az_face", "yaw_moment", "shaker")
    record = AcquisitionRecord(name, {each: acquired.channels[each] for each in kept})
    path = written(tmp_path, name, record, described(name, point.series.label))
    data = made(number, path)
    assert data.panels[0].marked_x[0] == pytest.approx(14.0, abs=0.11)
    shift = facts(data)["shift"]
    assert np.sign(shift) == sign
    truth = acquired.truth["bias_deg"][:8000].mean()
    quantum = np.degrees(0.35 / 2**15)
    assert shift == pytest.approx(truth, abs=quantum)
    drawn = curves(data)["indicated"]
    late = drawn.y[drawn.x > 20.0].mean()
    assert late == pytest.approx(np.mean(acquired.truth["static_pitch_deg"]), abs=quantum)


@pytest.mark.parametrize(("number", "plane", "hz"), [(14, "yaw", 9.8), (15, "pitch", 9.2)])
def test_bias_against_level_is_measured_and_estimated(number, plane, hz, tmp_path):
    bias = {3000.0: 0.05, 1000.0: 0.05 / 9, 4000.0: 0.05 * 16 / 9}
    off = written(tmp_path, "off", das(angle_deg=0.03), described("r", "off"))
    paths = [
        written(
            tmp_path,
            f"{moment:.0f}",
            das(plane, hz, bias_deg=value, moment_in_lb=moment, angle_deg=0.03),
            described("r", f"{plane} sine {hz} Hz"),
        )
        for moment, value in bias.items()
    ]
    data = made(number, off, *paths, off)
    levels = np.sort(list(bias))
    expected = -np.array([bias[level] for level in levels])
    for label, tolerance in (("measured", 1e-5), ("estimated, modal", 1e-4)):
        np.testing.assert_allclose(curves(data)[label].x, levels, rtol=1e-3)
        np.testing.assert_allclose(curves(data)[label].y, expected, atol=tolerance)
    found = facts(data)
    assert found["largest bias"] == pytest.approx(-0.05 * 16 / 9, abs=1e-5)
    assert found["at a moment of"] == pytest.approx(4000.0, rel=1e-3)
    assert abs(found["largest left"]) < 1e-4
    assert data.points == ("1000", "3000", "4000")


def test_bias_against_time_follows_the_modulation(tmp_path):
    record = modulated("pitch", 9.2, 0.25, angle_deg=-0.2, seconds=20.0)
    off = written(tmp_path, "off", das(angle_deg=-0.2), described("r", "off"))
    on = written(tmp_path, "on", record, described("r", "pitch modulated sine 9.2 Hz at 0.25 Hz"))
    data = made(16, off, on, off)
    largest = 0.1 * (1 + 0.6 * abs(gain(0.25)))
    assert facts(data)["largest bias"] == pytest.approx(-largest, rel=1e-3)
    assert abs(facts(data)["largest difference"]) < 2e-3
    estimated = curves(data)["estimated, modal"]
    assert np.isnan(estimated.y[estimated.x < 2.5]).all()
    assert np.isfinite(estimated.y[(estimated.x > 3) & (estimated.x < 18)]).all()


class TestRegression:
    AT_HZ = 0.3

    def paths(self, folder, plane="yaw", **more):
        hz = 9.8 if plane == "yaw" else 9.2
        record = modulated(plane, hz, self.AT_HZ, seconds=90.0, angle_deg=-0.28, **more)
        said = described("r", f"{plane} modulated sine {hz} Hz at 0.3 Hz")
        return [written(folder, f"long-{plane}", record, said)]

    def test_the_square_has_the_papers_units(self, tmp_path):
        data = made(18, *self.paths(tmp_path))
        square = curves(data)["integral-squared moment"]
        # (M / w)^2 / 2, of the envelope's mean square over its largest
        expected = (2000.0 / (2 * np.pi * 9.8)) ** 2 / 2 / 1.6
        assert square.y[square.x > 20].mean() == pytest.approx(expected, rel=0.02)
        assert data.panels[1].y.label == "integral-squared moment [(in lbf s)^2]"
        assert square.x.min() > 2.0
        assert square.x.max() <= 70.0 + 0.1
        assert facts(data)["correlation"] < -0.999

    def test_spectra_peak_at_the_modulation(self, tmp_path):
        paths = self.paths(tmp_path)
        data = made(19, *paths)
        assert facts(data)["peak of the angle"] == pytest.approx(self.AT_HZ)
        assert facts(data)["peak of the square"] == pytest.approx(self.AT_HZ)
        assert [panel.y.label for panel in data.panels] == [
            "power density [deg^2/Hz]",
            "power density [(in lbf s)^4/Hz]",
        ]
        angle = data.panels[0].curves[0]
        # the tone's power, its bins summed: a Hann window spreads it and loses none
        power = np.sum(angle.y) * 0.05
        assert power == pytest.approx((0.1 * 0.6 * abs(gain(self.AT_HZ))) ** 2 / 2, rel=0.02)
        assert len(made(22, *paths).panels) == 1

    def test_coherence_stands_beside_that_of_chance(self, tmp_path):
        chance = curves(made(20, *self.paths(tmp_path)))["exceeded by chance, 5 %"]
        # 67 s hold five windows of 20 s half overlapped, which share 1/36 of their power
        averages = 5 / (1 + 2 / 36 * 4 / 5)
        np.testing.assert_allclose(chance.y, 1 - 0.05 ** (1 / (averages - 1)), rtol=1e-6)

    def test_coherence_tells_what_the_angle_does_not_share(self, tmp_path):
        noise = np.random.default_rng(5).normal(size=90)

        def stray(time):
            return 1.0 + np.clip(np.interp(time, np.arange(90.0), noise), -1.5, 1.5) * 0.6

        clean, dirty = tmp_path / "clean", tmp_path / "dirty"
        for folder in (clean, dirty):
            folder.mkdir()
        alone, mixed = self.paths(clean), self.paths(dirty, stray=stray)
        shared, torn = (facts(made(20, *paths)) for paths in (alone, mixed))
        assert shared["coherence there"] > 0.999
        assert torn["coherence there"] > 0.7
        assert torn["mean coherence below"] < 0.5
        below = "power of the square below its peak"
        assert facts(made(22, *mixed))[below] > 5.0
        assert facts(made(22, *alone))[below] < 0.1

    @pytest.mark.parametrize(
        ("number", "plane", "between_s"), [(24, "pitch", (15, 85)), (26, "yaw", (10, 30))]
    )
    def test_residuals_are_what_the_square_does_not_explain(
        self, number, plane, between_s, tmp_path
    ):
        data = made(number, *self.paths(tmp_path, plane))
        residual = curves(data)["residual"]
        assert residual.x.min() == pytest.approx(between_s[0], abs=0.1)
        assert residual.x.max() == pytest.approx(between_s[1], abs=0.1)
        found = facts(data)
        scatter = np.sqrt(np.sum(residual.y**2) / (residual.x.size - 2))
        assert found["standard error"] == pytest.approx(scatter, rel=0.02)
        assert found["reduction"] > 95.0


def compared(name, plane, moment, std, run="1"):
    return BenchmarkPoint(
        run=run,
        point=name,
        excitation=f"{plane} sine",
        kind="sine",
        plane=plane,
        moment_in_lb_pp=moment,
        optical_deg=0.0,
        optical_std_deg=std,
        intercept_mm=0.0,
        intercept_std_mm=0.0,
        inertial_deg=0.0,
    )


class TestErrors:
    def test_errors_run_by_run(self):
        errors = [
            PointError(compared("a", "yaw", 1000.0, 0.01, "one"), 0.001, -0.05, 0.002),
            PointError(compared("b", "yaw", 2000.0, 0.01, "one"), -0.003, -0.10, None),
            PointError(compared("c", "yaw", 3000.0, 0.01, "two"), 0.002, -0.20, 0.001),
        ]
        data = errors_by_run(FIGURES[28], errors)
        (panel,) = data.panels
        assert panel.marked_x == (2.5,)
        assert panel.ticks == ((1.5, "one"), (3.0, "two"))
        assert curves(data)["inertial, raw"].x.tolist() == [1, 2, 3]
        assert np.isnan(curves(data)["inertial, corrected"].y[1])
        assert facts(data) == {
            "video, largest": -0.003,
            "inertial, raw, largest": -0.2,
            "inertial, corrected, largest": 0.002,
        }

    def test_errors_against_moment_are_table_4s(self):
        errors = [
            PointError(compared("a", "yaw", 1000.0, 0.01), 0.001, -0.05, 0.002),
            PointError(compared("b", "pitch", 2000.0, 0.01), -0.003, -0.10, None),
            PointError(compared("c", "pitch", None, 0.01), -0.3, -0.90, None),
        ]
        from glint_aoa.paper_figures.errors import errors_against_moment

        data = errors_against_moment(FIGURES[27], errors)
        assert [panel.title for panel in data.panels] == [
            "Excitation in yaw",
            "Excitation in pitch",
        ]
        assert data.panels[1].curves[0].x.tolist() == [2000.0]
        assert {fact.what: (fact.value, fact.paper) for fact in data.facts} == {
            "yaw, video, largest": (0.001, 0.006),
            "yaw, inertial, raw, largest": (-0.05, -0.217),
            "yaw, inertial, corrected, largest": (0.002, None),
            "pitch, video, largest": (-0.003, 0.010),
            "pitch, inertial, raw, largest": (-0.10, -0.174),
        }
        assert list(data.columns()) == [
            "panel",
            "curve",
            "peak_to_peak_moment_in_lbf",
            "error_of_the_mean_angle_deg",
        ]

    def test_scatter_of_both_planes(self):
        points = [
            compared("a", "yaw", 1000.0, 0.01),
            compared("b", "yaw", 4000.0, 0.02),
            compared("c", "pitch", 4000.0, 0.2),
        ]
        data = scatter_against_moment(FIGURES[37], points)
        assert curves(data)["excitation in yaw"].y.tolist() == [0.01, 0.02]
        assert facts(data) == pytest.approx(
            {"yaw, largest": 0.02, "pitch, largest": 0.2, "pitch over yaw": 10.0}
        )
        alone = facts(scatter_against_moment(FIGURES[37], points[:2]))
        assert np.isnan(alone["pitch, largest"])
        assert np.isnan(alone["pitch over yaw"])


def with_moment(moment_in_lb, name="p"):
    point = CampaignPoint(Path(f"{name}.h5"), compared(name, "yaw", None, 0.0), SETUP)
    point.__dict__["moment_in_lb"] = moment_in_lb
    return point


class TestFilms:
    def test_four_moments_are_spread_and_hold_the_largest(self):
        points = [with_moment(float(moment)) for moment in (5, 1, 3, 2, 7, 6, 4)]
        assert [p.moment_in_lb for p in films_of(FIGURES[31], points)] == [1, 3, 5, 7]
        assert [p.moment_in_lb for p in films_of(FIGURES[33], points)] == [7]
        assert [p.moment_in_lb for p in films_of(FIGURES[31], points[:2])] == [1, 5]

    def test_change_and_departure(self):
        time = np.arange(4) / 60
        film = MeasuredFilm(
            with_moment(4000.0), time, np.array([0.0, 0.03, np.nan, -0.015]), np.arange(4.0)
        )
        quiet = replace(film, point=with_moment(10.0), angle_deg=np.zeros(4))
        data = film_figure(FIGURES[31], [quiet, film])
        assert facts(data) == pytest.approx(
            {
                "change at 10 in lbf": 0.0,
                "largest change": 0.045,
                "largest departure from the mean": 0.025,
                "at a moment of": 4000.0,
            }
        )
        assert [panel.title for panel in data.panels] == [
            "10 in lbf peak to peak",
            "4000 in lbf peak to peak",
        ]
        assert facts(film_figure(FIGURES[32], [film]))["largest change"] == 3.0

    def test_fields_are_measured_in_degrees_and_inches(self, tmp_path):
        rng = np.random.default_rng(3)
        n, pitch_h, pitch_v = 30, 11.7e-6, 27.5e-6
        phase = 2 * np.pi * 9.8 * np.arange(n) / 60
        angle, row = 0.2 * np.sin(phase), 20 + 3 * np.cos(phase)
        slope = np.tan(np.radians(angle)) * pitch_h / pitch_v
        fields = line_fields(rng, n_fields=n, shape=(40, 300), row=row, slope=slope)
        off = written(tmp_path, "off", das(seconds=2.0), described("r", "off"))
        on = written(
            tmp_path,
            "on",
            das(bias_deg=0.1, moment_in_lb=4000.0, seconds=2.0),
            described("r", "yaw sine 9.8 Hz"),
            fields=fields,
            info=FieldInfo(rate_hz=60.0, exposure_s=1e-3, interlaced=False),
        )
        setup = Setup.model_validate(
            {
                "camera": {"pixel_pitch": ["11.7 um", "27.5 um"]},
                "glint": {"nose": "left"},
            }
        )
        source = FigureSource(read_points([off, on, off], setup))
        angles, intercepts = (make_figure(number, source) for number in (31, 32))
        noise_deg = 0.01  # of one field of 300 columns, three times over
        assert facts(angles)["largest change"] == pytest.approx(np.ptp(angle), abs=noise_deg)
        height = np.ptp(row) * pitch_v / INCH
        assert facts(intercepts)["largest change"] == pytest.approx(height, rel=0.02)
        np.testing.assert_allclose(
            angles.panels[0].curves[0].x, np.arange(n) / 60 + 0.5e-3, atol=1e-9
        )


def test_columns_hold_every_value_of_every_curve():
    x, time = np.array([0.0, 1.0]), Axis("time", "s")
    one = Panel(Axis("angle", "deg"), (Curve("a", x, x + 1), Curve("b", x[:1], x[:1])), "first")
    other = Panel(Axis("power density", "deg^2/Hz"), (Curve("c", x, x),))
    data = FigureData(1, "t", time, (one, other), (), ())
    assert data.columns() == {
        "panel": ["first"] * 3 + ["power density [deg^2/Hz]"] * 2,
        "curve": ["a", "a", "b", "c", "c"],
        "time_s": [0.0, 1.0, 0.0, 0.0, 1.0],
        "value": [1.0, 2.0, 0.0, 0.0, 1.0],
    }
    assert list(replace(data, panels=(one,)).columns()) == ["curve", "time_s", "angle_deg"]
