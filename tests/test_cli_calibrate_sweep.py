"""``glint-aoa calibrate sweep`` and ``check``: what they print, write and refuse."""

import json
import re
import sys

import numpy as np
import pytest
from test_at_rest import CAMERA, record

from calibration.sweep.fit import PitchSweep
from glint_aoa.campaign import calibrate_sweep
from glint_aoa.cli import main
from glint_aoa.setup import load_setup

UP_AND_DOWN = (-3.0, -1.5, 0.0, 1.0, 2.0, 3.0, 1.5, 0.5, -1.0, -2.5)


@pytest.fixture(scope="module")
def points(tmp_path_factory):
    """A sweep whose ways up and down differ, one point wrong; a warmer one; points taken later."""
    folder = tmp_path_factory.mktemp("points")
    for number, angle in enumerate(UP_AND_DOWN):
        onboard = angle + 0.5 * (number == 4) + 0.03 * (number > 5)
        record(folder / f"s{number:02d}.h5", angle, seed=number, onboard_deg=onboard)
    for number, angle in enumerate((-3.0, -1.0, 1.0, 3.0)):
        warm = {"tunnel_temperature_K": 310.0}
        record(folder / f"w{number}.h5", angle, seed=20 + number, meta=warm, hour=10)
    for number, angle in enumerate((-2.0, 0.0, 2.0)):
        record(folder / f"same{number}.h5", angle, seed=30 + number, hour=20)
        record(folder / f"rise{number}.h5", angle, row=20.5, seed=30 + number, hour=21)
    return folder


@pytest.fixture(scope="module")
def sweep_file(points):
    (points / "glint-aoa.toml").write_text(CAMERA)
    setup = load_setup(points / "glint-aoa.toml")
    calibrate_sweep(sorted(points.glob("s0*.h5")), setup).save(points / "sweep.toml")
    return points / "sweep.toml"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    (tmp_path / "glint-aoa.toml").write_text(CAMERA)
    return tmp_path


@pytest.fixture
def calibrate(here, monkeypatch, capsys):
    def run(*words):
        monkeypatch.setattr(sys, "argv", ["glint-aoa", "calibrate", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return end.value.code or 0, out, err

    return run


def test_a_sweep_up_and_down_with_a_wrong_point(calibrate, here, points):
    code, out, err = calibrate("sweep", *sorted(points.glob("s0*.h5")))
    assert code == 0
    assert re.search(
        r"^s04 left out: 0\.\d{4} deg off the curve of the other points, [\d.]+ times", err
    )
    rows = [line.split() for line in out.splitlines() if re.match(r"s\d", line)]
    assert [row[0] for row in rows if row[-2:] == ["left", "out"]] == ["s04"]
    assert rows[0][:2] == ["s00", "294.0"]
    assert len(rows) == len(UP_AND_DOWN)
    width = r"\+0\.0[23]\d\d deg, 95 % within 0\.0\d\d\d"  # of six degrees of freedom
    assert re.search(rf"^Hysteresis at 294\.0 K: down less up {width}$", out, re.MULTILINE)
    said = "half of it is in the calibration's uncertainty"
    assert re.search(
        rf"^Significant hysteresis at 294\.0 K: .* {width}; {said}$", err, re.MULTILINE
    )
    assert (here / "sweep.png").read_bytes().startswith(b"\x89PNG")
    loaded = PitchSweep.load(here / "sweep.toml")
    assert [point.name for point in loaded.left_out] == ["s04"]
    halves = [loaded.expanded_deg(point) for point in loaded.points]
    own, another = (f"{min(each):.4f} to {max(each):.4f}" for each in zip(*halves, strict=True))
    assert (
        f"\n95 % over the sweep's angles: calibration within {own} deg, another point like these "
        f"within {another}\n"
    ) in out


def test_json_says_the_same(calibrate, here, points):
    given = [*sorted(points.glob("s0*.h5")), *sorted(points.glob("w*.h5"))]
    code, out, _ = calibrate("sweep", *given, "-o", "two.toml", "--json")
    said = json.loads(out)
    assert code == 0
    assert said["temperatures_K"] == pytest.approx([294.0, 310.0])
    assert list(said["left_out"]) == ["s04"]
    loop, none = said["hysteresis"]
    assert (loop["is_significant"], none) == (True, None)
    assert loop["width_deg"] == pytest.approx(0.03, abs=4 * loop["std_deg"])
    for key in ("residuals_deg", "calibration_u95_deg", "prediction_u95_deg"):
        assert len(said[key]) == len(UP_AND_DOWN) - 1 + 4


def test_a_check_that_finds_nothing(calibrate, points, sweep_file):
    later = sorted(points.glob("same*.h5"))
    code, out, err = calibrate("check", *later, "--sweep", sweep_file, "--strict")
    assert (code, err) == (0, "")
    rows = [line.split() for line in out.splitlines() if line.startswith("same")]
    assert [row[0] for row in rows] == ["same0", "same1", "same2"]
    assert float(rows[0][1]) == pytest.approx(12.35, abs=0.1)
    assert out.endswith(
        "Nothing has changed that these points could show; the calibration holds.\n"
    )


def test_a_check_that_finds_a_change(calibrate, here, points, sweep_file):
    with (here / "glint-aoa.toml").open("a") as file:
        file.write(f'[calibration]\nsweep = "{sweep_file}"\n')
    later = sorted(points.glob("rise*.h5"))
    code, out, err = calibrate("check", *later, "--strict", "--png", "check.png")
    assert (code, err) == (3, "")
    assert re.search(r"^intercept offset +-0\.5\d+ \+/- 0\.0\d+ +mm$", out, re.MULTILINE)
    assert "the model moved up or down" in out.splitlines()[-1]
    assert (here / "check.png").read_bytes().startswith(b"\x89PNG")
    code, out, _ = calibrate("check", *later, "--json", "--strict")
    said = json.loads(out)
    assert code == 3
    assert (said["verdict"], said["has_drifted"], said["angle_holds"]) == ("undecided", True, True)
    assert np.sum([each["probability"] for each in said["hypotheses"]]) == pytest.approx(1)
    assert said["points"][0]["intercept_mm"] == pytest.approx(-0.559, abs=0.03)


def test_what_a_check_refuses(calibrate, here, points, sweep_file):
    later = sorted(points.glob("same*.h5"))
    assert calibrate("check", *later) == (
        2,
        "",
        "glint-aoa: glint-aoa.toml: no calibration.sweep to check; name one there, or give it "
        "with --sweep\n",
    )
    assert calibrate("check", *later, "--sweep", sweep_file, "--png", "check.bmp") == (
        2,
        "",
        "glint-aoa: check.bmp: not a kind of picture; end its name with .png, .pdf, .svg\n",
    )
    (here / "check.png").write_text("mine")
    code, out, err = calibrate("check", *later, "--sweep", sweep_file, "--png", "check.png")
    assert (code, out) == (2, "")
    assert err.startswith("glint-aoa: check.png is there already; ")
    (here / "glint-aoa.toml").write_text(CAMERA + '[glint]\ny = "1 mm"\n')
    code, out, err = calibrate("check", *later, "--sweep", sweep_file)
    assert (code, out) == (2, "")
    assert err.startswith(
        f"glint-aoa: {sweep_file} was measured with another setup (glint.y is 0.001 m here"
    )
