"""``glint-aoa plan``: what it prints, writes and refuses."""

import csv
import json
import re
from pathlib import Path

import pytest
from plan_setups import SETUP, SMALL_MAP


@pytest.fixture
def setup(tmp_path):
    path = tmp_path / "glint-aoa.toml"
    path.write_text(SETUP + SMALL_MAP)
    return path


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_prints_both_layouts_and_what_was_assumed(program, setup):
    code, out, err = program("plan", setup)
    assert (code, err) == (0, "")
    present, suggested, assumed = out.split("\n\n")
    assert present.startswith("Present setup\ncamera 1.373 m from the plane of the glint, 35 mm ")
    pitches = re.findall(r"^ *([+-]\d\.\d\d) +[+-]\d\.\d{3} .* \d+/\d+ ", present, re.MULTILINE)
    assert pitches == ["-6.00", "-3.00", "+0.00", "+3.00", "+6.00"]
    assert "all of the wanted -6.0 to +6.0 deg." in present
    assert re.match(r"Suggested: camera 0\.\d{3} m (back|nearer), \d+ mm lens, ", suggested)
    assert "It lies at an end of " in suggested
    assert assumed.startswith("Assumed, since [plan] does not say: pitch -6 to +6 deg; ")
    for each in ("60 fields a point", "roughness 0.04", "no vibration", "an endless lamp"):
        assert f"; {each}" in assumed
    assert assumed.endswith("an exact geometry, since [uncertainty] is empty\n")


def test_json_and_files_hold_the_same(program, setup, tmp_path):
    out = tmp_path / "plan"
    code, printed, err = program("plan", setup, "--out", out, "--json")
    assert (code, err) == (0, "")
    value = json.loads(printed)
    names = ["plan-angles.csv", "plan-glint.png", "plan-map.csv", "plan-map.png"]
    assert sorted(value["files"]) == [str(out / name) for name in names]
    assert sorted(path.name for path in out.iterdir()) == names
    for name in names[1::2]:
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    angles = rows(out / "plan-angles.csv")
    assert [each["layout"] for each in angles] == ["present"] * 5 + ["suggested"] * 5
    for row, plain in zip(angles, value["present"]["angles"], strict=False):
        assert float(row["mean_std_deg"]) == pytest.approx(plain["mean_std_deg"], rel=1e-8)
        assert float(row["row_left"]) == pytest.approx(plain["row_left"], rel=1e-8)
    layouts = rows(out / "plan-map.csv")
    assert len(layouts) == value["layouts"] == 12
    assert sum(int(each["visible"]) for each in layouts) == value["layouts_that_see_all"]
    seen = [float(each["mean_std_deg"]) for each in layouts if each["visible"] == "1"]
    assert value["suggested"]["mean_std_deg"] == pytest.approx(min(seen), rel=1e-6)


def test_without_a_map_nothing_is_suggested(program, setup, tmp_path):
    out = tmp_path / "plan"
    code, said, _ = program("plan", setup, "--no-map", "--out", out)
    assert code == 0
    assert "Suggested" not in said
    assert said.endswith(f"Wrote {out / 'plan-angles.csv'}, {out / 'plan-glint.png'}\n")
    again = program("plan", setup, "--no-map", "--out", out)
    assert again[0] == 2
    assert again[2].startswith(f"glint-aoa: {out / 'plan-angles.csv'}")
    assert program("plan", setup, "--no-map", "--out", out, "--overwrite")[0] == 0


def test_a_map_in_which_nothing_will_do_says_so(program, setup):
    setup.write_text(SETUP.replace("lines = 92", "lines = 40") + SMALL_MAP)
    setup.write_text(setup.read_text() + 'angles = ["-18 deg", "18 deg"]\n')
    code, out, _ = program("plan", setup)
    assert code == 0
    assert "\nThe glint is seen at no angle: the recorded window ends.\n" in out
    assert re.search(r"^  \+0.00 .* 0/38 +- +- ", out, re.MULTILINE)
    assert (
        "\n\nNone of the 12 layouts of the map sees the whole wanted range; widen distances, "
        "focal_lengths, lamp_y or lamp_z in [plan], record more lines, or want less.\n"
    ) in out


def test_a_setup_without_a_lamp_ends_in_one_sentence(program, setup):
    setup.write_text(SETUP.split("[glint.reflection]", maxsplit=1)[0])
    assert program("plan", setup) == (
        2,
        "",
        "glint-aoa: a plan needs to know what is mirrored; give body and lamp in "
        "[glint.reflection]\n",
    )


def test_a_folder_that_is_a_file_ends_in_one_sentence(program, setup):
    code, out, err = program("plan", setup, "--out", setup)
    assert (code, out) == (2, "")
    assert err == f"glint-aoa: {setup}: a file, expected a folder for results; give another --out\n"


def test_the_example_of_the_documents_prints_what_they_say(program, tmp_path):
    text = (Path(__file__).parents[1] / "docs" / "plan.md").read_text()
    (example,) = re.findall(r"^```toml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    present, _ = re.findall(r"^```text\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    path = tmp_path / "glint-aoa.toml"
    path.write_text(example)
    assert program("plan", path, "--no-map")[1].startswith(present)
    path.write_text(example.replace("[glint]", '[glint]\nmean = "plain"'))
    plain = json.loads(program("plan", path, "--no-map", "--json")[1])["present"]["angles"][0]
    assert f"it would be {plain['vibration_std_deg']:.5f} deg" in text
