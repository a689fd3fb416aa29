"""The report of a folder of results: what is in it, what it lacks, and what it never does."""

import base64
import csv
import datetime
import functools
import html
import itertools
import json
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest
from known_targets import TRUE, field, in_setup, in_space, seen
from matplotlib.figure import Figure
from report_campaign import NAMES, NASTY, write_campaign

from calibration.camera.calibrate import CameraCalibration
from calibration.resection.resect import resect
from glint_aoa.cli.benchmark import run_benchmark
from glint_aoa.errors import InputError, OutputError
from glint_aoa.records.provenance import file_hash
from glint_aoa.report.html_report import write_report
from glint_aoa.report.pictures import FigureFiles, drawing, picture
from glint_aoa.report.point_page import PageOptions, point_page
from glint_aoa.report.results_folder import read_results_folder
from glint_aoa.setup import load_setup

DATE = datetime.datetime(2026, 1, 12, 9, 0, tzinfo=datetime.UTC)
VOID = {"meta", "img", "link", "br"}


class Page(HTMLParser):
    """Elements of a page, and the text of each."""

    def __init__(self, path):
        super().__init__()
        self.elements, self._open = [], []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        element = {"tag": tag, "text": "", **dict(attrs)}
        self.elements.append(element)
        if tag not in VOID:
            self._open.append(element)

    def handle_endtag(self, tag):
        assert self._open.pop()["tag"] == tag

    def handle_data(self, data):
        for element in self._open:
            element["text"] += data

    def all(self, tag):
        return [each for each in self.elements if each["tag"] == tag]

    def text(self):
        return " ".join(self.all("body")[0]["text"].split())


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def report(folder, **how):
    return write_report(folder, date=DATE, overwrite=True, **how)


@pytest.fixture(scope="module", autouse=True)
def few_draws():
    """Let the Monte Carlo of the budget be short: no test here asks what it finds."""
    from glint_aoa.report import calibration_section

    with pytest.MonkeyPatch.context() as patch:
        short = functools.partial(calibration_section.uncertainty_budget, draws=1000)
        patch.setattr(calibration_section, "uncertainty_budget", short)
        yield


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Folder with recorded points, setup, pitch sweep, and the results of a comparison."""
    folder = tmp_path_factory.mktemp("campaign")
    paths = write_campaign(folder)
    run_benchmark(paths, load_setup(folder / "glint-aoa.toml"), folder / "results")
    return folder


@pytest.fixture(scope="module")
def made(campaign):
    return report(campaign / "results", out=campaign / "report.html")


@pytest.fixture(scope="module")
def page(made):
    return Page(made.file)


@pytest.fixture
def whole(campaign, tmp_path):
    """Copy of the results of one point alone, to be spoilt."""
    folder = tmp_path / "results"
    folder.mkdir()
    for name in ("run-0.csv", "run-0.nc", "log.csv"):
        shutil.copy(campaign / "results" / name, folder)
    return folder


@pytest.fixture
def results(whole):
    """The same, of which nothing is known but the angles: soon drawn."""
    spoil(whole, recording="", calibration="none", setup_hash="")
    return whole


class TestPage:
    def test_needs_nothing_else(self, page):
        ids = {each["id"] for each in page.elements if "id" in each}
        for element in page.elements:
            assert element["tag"] not in {"script", "link", "iframe", "object", "form"}
            assert not [name for name in element if name.startswith("on")]
            if "src" in element:
                assert element["src"].startswith("data:image/svg+xml;base64,")
            if "href" in element:
                assert element["href"][0] == "#"
                assert element["href"][1:] in ids
        (style,) = page.all("style")
        assert "url(" not in style["text"]
        assert "@import" not in style["text"]

    def test_pictures_need_nothing_else(self, page):
        for image in page.all("img"):
            svg = base64.b64decode(image["src"].partition(",")[2]).decode()
            used = re.findall(r'(?:xlink:)?href="([^"]*)"', svg) + re.findall(
                r"url\(([^)]*)\)", svg
            )
            assert all(each.startswith(("#", "data:image/png;base64,")) for each in used)

    def test_can_be_read_aloud(self, page):
        tags = [each["tag"] for each in page.elements]
        levels = [int(tag[1]) for tag in tags if tag in {"h1", "h2", "h3", "h4"}]
        assert levels.count(1) == 1
        assert all(later <= earlier + 1 for earlier, later in itertools.pairwise(levels))
        assert all(len(image["alt"]) > 30 for image in page.all("img"))
        assert len(page.all("caption")) == len(page.all("table"))
        assert all(each["text"].strip() for each in page.all("caption"))
        assert all(each.get("scope") in {"col", "row"} for each in page.all("th"))
        ids = [each["id"] for each in page.elements if "id" in each]
        assert len(ids) == len(set(ids))
        assert page.all("html")[0]["lang"] == "en"

    def test_numbers_are_those_of_the_results(self, page, campaign):
        shown = [each["value"] for each in page.all("data")]
        for row in rows(campaign / "results" / "log.csv"):
            for name in ("mean_angle_deg", "mean_angle_u95_deg", "std_angle_deg"):
                assert shown.count(row[name]) >= 2  # in the table of points, and on its page
        for name, kept in (("table4.csv", "mean_deg"), ("errors.csv", "error_deg")):
            for row in rows(campaign / "results" / name):
                found = {value for key, value in row.items() if key.endswith(kept)} - {""}
                assert found
                assert found <= set(shown)

    def test_prints_what_it_means(self, page):
        for each in page.all("data"):
            number = re.search(r"[-+]?\d+(?:\.(\d+))?", each["text"])
            places = len(number[1] or "")
            assert float(number[0]) == pytest.approx(
                round(float(each["value"]), places), abs=10.0**-places * 0.51
            )

    def test_names_are_text(self, page, made):
        assert NASTY in page.text()
        source = made.file.read_text(encoding="utf-8")
        assert "<script" not in source
        assert [each.key for each in made.pages] == list(NAMES)
        titles = [each["text"] for each in page.all("h3")]
        assert set(NAMES) <= set(titles)

    def test_shows_all_that_there_is(self, page, made):
        classes = [each.get("class") for each in page.all("figure")]
        wanted = ["optical", "field", "inertial"] * 3
        assert classes == ["errors", "sweep", "budget", *wanted]
        text = page.text()
        assert "Flags NO_GLINT" not in text
        assert "No flags." in text
        assert "yaw sine 9.8 Hz" in text
        assert made.lacks == [
            "No calibration of the camera or its pose is here: glint-aoa calibrate camera and "
            "glint-aoa calibrate resect make them."
        ]
        assert [each.lacks for each in made.pages] == [[], [], []]

    def test_inputs_stand_with_their_hashes(self, page, campaign):
        text = page.text()
        for name in NAMES:
            path = campaign / "points" / f"{name}.h5"
            assert f"{path}{file_hash(path)}unchanged" in text
        assert f"{file_hash(campaign / 'sweep.toml')}unchanged" in text

    def test_settings_are_the_setup(self, page):
        (pre,) = page.all("pre")
        assert "focal_length = 0.035" in pre["text"]
        assert "number = 1" in pre["text"]

    def test_is_the_same_each_time(self, made, campaign, results):
        point = read_results_folder(campaign / "results").points[1]
        again = point_page((2, point), options=PageOptions(campaign / "results"))
        assert again == made.pages[1]
        first, second = (report(results, out=results / "r.html").file.read_bytes() for _ in "12")
        assert first == second


class TestMissing:
    def test_table_4_and_calibrations(self, results):
        made = report(results)
        assert made.file == results / "report.html"
        assert made.lacks == [
            "Table 4 is not here: glint-aoa benchmark POINT... --setup FILE --out FOLDER holds the "
            "points of runs against the onboard sensor.",
            "No pitch sweep is here or was applied: glint-aoa calibrate sweep POINT... --setup "
            "FILE --out sweep.toml makes one of points at rest.",
            "No calibration of the camera or its pose is here: glint-aoa calibrate camera and "
            "glint-aoa calibrate resect make them.",
        ]

    def test_recording_that_is_gone(self, whole, tmp_path, campaign):
        spoil(whole, recording=str(tmp_path / "gone" / "run-0.h5"))
        made = report(whole)
        assert made.pages[0].lacks == [
            f"The field and the onboard sensor: {tmp_path}/gone/run-0.h5 is not found; give the "
            "folder of the recordings with --points."
        ]
        assert [each.name for each in made.pages[0].pictures] == ["optical"]
        found = report(whole, points=campaign / "points")
        assert found.pages[0].lacks == []

    def test_recording_that_has_changed(self, whole, tmp_path):
        other = tmp_path / "run-0.h5"
        other.write_bytes(b"another recording")
        spoil(whole, recording=str(other))
        made = report(whole)
        assert made.pages[0].lacks == [
            f"The field and the onboard sensor: {other} is changed since then: {other} has another "
            "hash; process the point again, or give the folder of the recordings with --points as "
            "they were."
        ]

    def test_calibration_that_has_changed(self, results, campaign):
        sweep = str(campaign / "sweep.toml")
        spoil(results, calibration=sweep, calibration_sha256="0" * 64)
        made = report(results)
        said = f"The pitch sweep {sweep}: changed since then: {sweep} has another hash."
        assert made.lacks[0] == said
        assert "sweep" not in [each.get("class") for each in Page(made.file).all("figure")]

    def test_setup_of_another_version(self, whole):
        spoil(whole, setup='{"camera": {"zoom": 2.0}}')
        made = report(whole)
        assert made.pages[0].lacks == [
            "The field and the onboard sensor: the results' attribute setup cannot be read "
            "(unknown key camera.zoom; known keys here: focal_length, pixel_pitch, sensor, "
            "principal_point, position, rotation, distortion); process the point again."
        ]

    def test_no_netcdf(self, results):
        (results / "run-0.nc").unlink()
        made = report(results)
        assert made.pages[0].lacks == [
            "The field and the onboard sensor: the results do not name a recording."
        ]
        assert [each.name for each in made.pages[0].pictures] == ["optical"]
        text = Page(made.file).text()
        mean = rows(results / "log.csv")[0]["mean_angle_deg"]
        assert f"{float(mean):+.4f} deg" in text

    def test_damaged_netcdf_is_named(self, results):
        whole = (results / "run-0.nc").read_bytes()
        (results / "other.nc").write_bytes(whole[: len(whole) // 2])
        made = report(results)
        assert made.lacks[0].startswith(f"{results / 'other.nc'}: cannot be read (")
        assert len(made.pages) == 1

    def test_what_correct_wrote_is_taken(self, results):
        (results / "corrected").mkdir()
        time = np.arange(20) / 20
        lines = [f"{t:.6f},1.5,0.001,1.25,-0.25,0" for t in time]
        header = "time_s,angle_deg,angle_std_deg,raw_angle_deg,bias_deg,flags"
        (results / "corrected" / "run-0.csv").write_text("\n".join([header, *lines]) + "\n")
        (page,) = report(results).pages
        told = {fact.what: fact.text for fact in page.facts}
        assert told["Onboard mean, corrected"] == "+1.5000 deg"
        assert told["Onboard mean, raw"] == "+1.2500 deg"
        assert "as correct wrote it to run-0.csv" in page.pictures[-1].caption

    def test_of_a_point_that_shows_no_glint(self, results):
        nothing = np.full(12, np.nan)
        spoil(results, values={"angle_deg": nothing, "intercept_mm": nothing, "flags": 1})
        (page,) = report(results).pages
        assert page.pictures == []
        assert page.lacks[0] == (
            "Angle and intercept: no field could be measured; its flags say why."
        )

    def test_flags_are_told_in_words(self, results):
        from glint_aoa.flags import Flag

        flags = np.zeros(12, np.int64)
        flags[:2] = Flag.MOVED | Flag.SATURATED
        spoil(results, values={"flags": flags})
        made = report(results)
        assert made.pages[0].flags == [
            "SATURATED (2 of 12 fields): pixels of the glint are clipped at the top of the scale",
            "MOVED (2 of 12 fields): the glint is not where the fields around this one put it",
        ]
        text = Page(made.file).text()
        assert "MOVED at 1 of 1 points: the glint is not where" in text
        assert "SATURATED, MOVED" in text


class TestCalibrations:
    def test_of_camera_and_pose(self, tmp_path):
        camera_calibration().save(tmp_path / "camera.toml")
        targets = in_space()
        resect(field(targets), seen(targets), in_setup(TRUE)).save(tmp_path / "pose.toml")
        made = report(tmp_path)
        page = Page(made.file)
        text = page.text()
        assert "Camera calibration camera.toml" in text
        assert "left out: too dark & <b>blurred</b>" in text
        assert "0.0351" in text
        assert [each.get("class") for each in page.all("figure")] == ["pose"]
        assert [lack.partition(":")[0] for lack in made.lacks] == [
            "No results of points are here",
            "Table 4 is not here",
            "No pitch sweep is here or was applied",
        ]


class TestFiles:
    def test_figures_beside(self, results, tmp_path):
        out = tmp_path / "out.html"
        made = report(results, out=out, figures="pdf")
        assert made.figures == tmp_path / "out-figures"
        assert [file.name for file in made.figures.iterdir()] == ["run-0-optical.pdf"]
        with pytest.raises(OutputError, match=re.escape(f"{made.figures} is there already;")):
            write_report(results, tmp_path / "out.htm", figures="pdf")

    @pytest.mark.parametrize(
        ("kind", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
    )
    def test_of_each_kind_repeat_to_the_byte(self, tmp_path, kind, start):
        found = []
        for folder in (tmp_path / "one", tmp_path / "two"):
            files = FigureFiles(folder, kind)
            with drawing():
                figure = Figure(figsize=(2, 2))
                figure.subplots().plot([1.0, 2.0], [0.123456, 0.1], label="$a$")
                figure.suptitle("$\\frac")
                shown = picture(figure, "x", alt="", caption="", files=files, stem="x")
            found.append(((folder / f"x.{kind}").read_bytes(), shown.source))
        assert found[0] == found[1]
        assert found[0][0].startswith(start)

    def test_letters_and_numbers_on_a_page_are_not_cut(self):
        with drawing():
            figure = Figure(figsize=(2, 2))
            figure.subplots().set_title('0.123456 "0.123456" 1.23456')
            shown = picture(figure, "x", alt="", caption="", files=None, stem="x")
        svg = base64.b64decode(shown.source.partition(",")[2]).decode()
        assert '0.123456 "0.123456" 1.23456' in html.unescape(svg)
        assert not re.search(r' d="[^"]*\.\d{3}', svg)


class TestRefusals:
    def test_no_folder(self, tmp_path):
        with pytest.raises(InputError, match=re.escape(
            f"{tmp_path / 'x'}: no such folder; give the folder that process or benchmark wrote"
        )):  # fmt: skip
            report(tmp_path / "x")

    def test_a_file(self, tmp_path):
        (tmp_path / "x").write_text("")
        with pytest.raises(InputError, match=re.escape(
            f"{tmp_path / 'x'}: a file; give the folder that process or benchmark wrote"
        )):  # fmt: skip
            report(tmp_path / "x")

    def test_nothing_in_it(self, tmp_path):
        with pytest.raises(InputError, match=re.escape(
            f"{tmp_path}: no results of process, benchmark or calibrate in it; give the folder "
            "named with their --out"
        )):  # fmt: skip
            report(tmp_path)

    def test_no_folder_of_recordings(self, results, tmp_path):
        with pytest.raises(InputError, match=re.escape(
            f"{tmp_path / 'x'}: no such folder; give that of the recordings with --points"
        )):  # fmt: skip
            report(results, points=tmp_path / "x")

    def test_one_that_is_there(self, results):
        (results / "report.html").write_text("mine")
        with pytest.raises(OutputError, match=re.escape(
            f"{results / 'report.html'} is there already; give another --out, or --overwrite to "
            "replace it"
        )):  # fmt: skip
            write_report(results)
        assert (results / "report.html").read_text() == "mine"

    def test_a_table_of_errors_that_is_cut(self, campaign, tmp_path):
        header, row, *_ = (campaign / "results" / "errors.csv").read_text().splitlines()
        (tmp_path / "errors.csv").write_text(f"{header}\n{row.replace('yaw,', 'roll,')}\n")
        made = report(tmp_path)
        assert "excitation plane is 'roll'; choose one of none, yaw, pitch" in made.lacks[0]


def test_command(program, results, tmp_path):
    code, out, err = program("report", results, "--out", tmp_path / "r.html")
    assert (code, out) == (0, f"Wrote {tmp_path / 'r.html'}: 1 points\n")
    assert err.startswith("Table 4 is not here: glint-aoa benchmark POINT...")
    code, out, err = program("report", results, "--out", tmp_path / "r.pdf")
    assert (code, out) == (2, "")
    assert err == (
        f"glint-aoa: {tmp_path / 'r.pdf'}: a report is an HTML file; end its name with .html\n"
    )


def test_command_as_json(program, results, tmp_path):
    spoil(results, recording="gone.h5")
    code, out, err = program("report", results, "--out", tmp_path / "r.html", "--json")
    assert (code, err) == (0, "")
    told = json.loads(out)
    assert (told["points"], told["figures"]) == (1, None)
    assert told["not_shown"][-1].startswith("run-0: The field and the onboard sensor: gone.h5 is")


def test_points_of_one_name_in_two_folders_keep_apart(results):
    shutil.copytree(results, results / "again")
    keys = [point.key for point in read_results_folder(results).points]
    assert keys == ["again/run-0", "run-0"]


def spoil(folder, values=None, **attrs):
    """Change attributes and columns in the NetCDF of a point."""
    import netCDF4

    with netCDF4.Dataset(folder / "run-0.nc", "a") as file:
        file.setncatts(attrs)
        for name, each in (values or {}).items():
            file[name][:] = each


def camera_calibration():
    from calibration.camera._images import ImageFit

    return CameraCalibration(
        focal_length_m=0.0351,
        pixel_pitch_m=(11.7e-6, 27.5e-6),
        sensor=(752, 240),
        principal_point=(375.5, 119.5),
        distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
        parameters=("focal_length_m",),
        covariance=np.array([[1e-10]]),
        bootstrap_covariance=None,
        draws=0,
        seed=0,
        rms_pixels=0.05,
        noise_pixels=(0.04, 0.03),
        degrees_of_freedom=100.0,
        board="chessboard 9 x 6, 30 mm",
        board_std_m=1e-5,
        board_departure_m=0.0,
        board_departure_std_m=0.0,
        images=(
            ImageFit("one.png", "one.png", True, corners=54, rms=0.05, tilt_deg=10, distance_m=1.4),
            ImageFit("two.png", "two.png", False, reason="too dark & <b>blurred</b>"),
        ),
    )
