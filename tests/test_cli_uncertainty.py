"""``glint-aoa uncertainty``: what it prints, writes and refuses."""

import csv
import json
import re
import sys

import pytest

from calibration.sweep.fit import fit_sweep
from glint_aoa.cli import main

SETUP = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
position = ["0 m", "-56 in", "60 mm"]
[uncertainty]
rotation = ["0.1 deg", "0.05 deg", "0.2 deg"]
"""
FAST = ("--draws", "1000")


@pytest.fixture
def setup(tmp_path):
    path = tmp_path / "glint-aoa.toml"
    path.write_text(SETUP)
    return path


@pytest.fixture
def run(monkeypatch, capsys):
    def call(*words):
        monkeypatch.setattr(sys, "argv", ["glint-aoa", "uncertainty", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
        out, err = capsys.readouterr()
        return end.value.code, out, err

    return call


def test_prints_a_table_of_each_angle_and_one_of_all(run, setup):
    code, out, err = run(setup, "--angles", "-6,0", *FAST)
    assert (code, err) == (0, "")
    tables = re.findall(r"^([+-]\d\.00) deg, glint at", out, re.MULTILINE)
    assert tables == ["-6.00", "+0.00"]
    phi, combined = (
        re.findall(rf"^{name} .*$", out, re.MULTILINE)[0] for name in ("rotation phi", "combined")
    )
    *cells, share, percent = phi.split()
    assert cells == ["rotation", "phi", "0.05", "deg", "+1", "deg/deg", "0.05000"]
    assert percent == "%"
    assert float(share) == pytest.approx(100 * (0.05 / float(combined.split()[1])) ** 2, abs=0.06)
    assert len(re.findall(r"^ +[+-]\d\.00 .* rotation phi, \d+ %$", out, re.MULTILINE)) == 6
    assert (
        "\nTaken as exact, since nothing is said of them: principal distance; pixel pitch, "
        "horizontal; pixel pitch, vertical; principal point u; "
    ) in out
    assert re.search(r"^95 %: \+- 0\.09\d\d\d deg$", out, re.MULTILINE)


def test_json_csv_and_picture_hold_the_same(run, setup, tmp_path):
    out = tmp_path / "budget"
    code, printed, err = run(setup, "--angles", "2.5", "--out", out, "--json", *FAST)
    assert (code, err) == (0, "")
    value = json.loads(printed)
    assert value["files"] == [str(out / f"uncertainty.{kind}") for kind in ("json", "csv", "png")]
    written = json.loads((out / "uncertainty.json").read_text())
    assert written == {key: each for key, each in value.items() if key != "files"}
    assert [each["angle_deg"] for each in written["angles"]] == [2.5] * 3
    first = written["angles"][0]
    assert first["degrees_of_freedom"] is None  # infinitely many
    assert first["monte_carlo"]["confirms_first_order"] is True
    with (out / "uncertainty.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * len(first["rows"])
    for row, plain in zip(rows, first["rows"], strict=False):
        assert row["source"] == plain["source"]
        assert float(row["contribution_deg"]) == pytest.approx(plain["contribution_deg"], rel=1e-8)
        assert float(row["u95_deg"]) == pytest.approx(first["u95_deg"], rel=1e-8)
    assert (out / "uncertainty.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["b.json", "b.csv", "b.svg"])
def test_one_file_of_a_name(run, setup, tmp_path, name):
    code, out, _ = run(
        setup, "--angles", "1", "--intercepts", "80", "--out", tmp_path / name, *FAST
    )
    assert code == 0
    assert out.endswith(f"Wrote {tmp_path / name}\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "glint-aoa.toml"])


def test_the_sweep_of_the_setup_takes_out_what_it_can(run, setup, tmp_path):
    angles = [-6.0, -3.0, 0.0, 3.0, 6.0]
    fit_sweep(angles, 1e-4, angles, 1e-3, degree=1).save(tmp_path / "sweep.toml")
    setup.write_text(SETUP + '[calibration]\nsweep = "sweep.toml"\n')
    _, out, _ = run(setup, "--angles", "4", "--intercepts", "60", *FAST)
    (phi,) = re.findall(r"^rotation phi .*$", out, re.MULTILINE)
    _, contribution, share, percent, unswept = phi.rsplit(maxsplit=4)
    assert (contribution, share, percent, unswept) == ("0.00000", "0.0", "%", "0.05000")
    assert "unswept" in out


def test_a_setup_that_says_nothing_is_told_so(run, setup):
    setup.write_text(SETUP.split("[uncertainty]", maxsplit=1)[0])
    code, out, err = run(setup, "--angles", "0", *FAST)
    assert code == 0
    assert "centroids, 100 %" in out
    assert err == (
        f"{setup} says nothing of how uncertain the camera is; add [uncertainty], or calibrations "
        "of camera and pose\n"
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--angles", "one"],
            "--angles is 'one'; give numbers with commas between, such as --angles=-6,0,6",
        ),
        (["--angles", "200"], "angles between -60 and 60 deg are wanted and 200 deg is none; "),
        (
            ["--draws", "100000000"],
            "draws is 100000000; 1000000 give three digits and are the most",
        ),
        (["--temperature", "21"], "a tunnel temperature of 21 K cannot be; give it in kelvins\n"),
        (["--noise", "inf"], "the centroids' noise is inf lines; give zero or more\n"),
        (["--intercepts", "nan"], "the intercepts are none, or not all numbers; give mm\n"),
        (["--draws", "5"], "draws is 5; a 95 % interval takes 1000 at least, 10000 are better"),
        (["--out", "{folder}/b.xlsx"], "{folder}/b.xlsx: not a kind of budget; end its name with "),
        (["--out", "{folder}/glint-aoa.toml/sub"], "{folder}/glint-aoa.toml: a file, expected a "),
    ],
)
def test_bad_input_ends_in_one_sentence(run, setup, tmp_path, words, message):
    code, out, err = run(setup, *(word.format(folder=tmp_path) for word in words))
    assert (code, out) == (2, "")
    assert err.startswith(f"glint-aoa: {message.format(folder=tmp_path)}")
    assert err.count("\n") == 1


def test_nothing_is_overwritten_unless_asked(run, setup, tmp_path):
    path = tmp_path / "b.json"
    path.write_text("mine")
    code, _, err = run(setup, "--out", path, *FAST)
    assert code == 2
    assert err == (
        f"glint-aoa: {path} is there already; give another --out, or --overwrite to replace it\n"
    )
    assert path.read_text() == "mine"
    assert run(setup, "--angles", "0", "--out", path, "--overwrite", *FAST)[0] == 0
    assert json.loads(path.read_text())["fields"] == 60
