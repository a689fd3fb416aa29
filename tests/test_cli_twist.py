"""``glint-aoa twist`` from files to table, picture and exit code."""

import csv
import json

import cv2
import numpy as np
import pytest
import wings

TWISTS = (2.0, -1.5)


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    """Recordings and single fields of a wing without flow and with it."""
    folder = tmp_path_factory.mktemp("wing")
    rng = np.random.default_rng(1)
    rows = wings.sections()
    after = wings.flown(rows, TWISTS)
    wings.write_recording(folder / "off.h5", rows, 2, rng)
    wings.write_recording(folder / "on.h5", after, 2, rng)
    wings.write_image(folder / "off.png", rows, rng)
    wings.write_image(folder / "on.png", after, rng)
    (folder / "glint-aoa.toml").write_text(wings.TOML)
    wings.write_table(folder / "targets.csv", wings.targets(rows))
    return folder


@pytest.fixture
def program(program, films, tmp_path, monkeypatch):
    """Run ``twist`` in the folder of the films; returns exit code, stdout and stderr."""

    def run(*arguments, out=tmp_path / "out"):
        monkeypatch.chdir(films)
        return program("twist", *arguments, "--targets", "targets.csv", "--out", out)

    return run


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_recordings_to_table_and_picture(program, tmp_path):
    code, out, err = program("off.h5", "on.h5", "--reference", "body")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    header = "flow  station  y [mm]  twist [deg]  95 %  less body's  95 %  Z [mm]  targets"
    assert lines[0].split() == header.split()
    assert [line.split()[:3] for line in lines[1:3]] == [
        ["on", "body", "-50.0"],
        ["on", "tip", "150.0"],
    ]
    table = rows_of(tmp_path / "out" / "twist.csv")
    for row, true in zip(table, TWISTS, strict=True):
        assert abs(float(row["twist_deg"]) - true) < 0.006
        assert abs(float(row["twist_deg"]) - true) < 4 * float(row["twist_std_deg"])
        assert float(row["twist_u95_deg"]) == pytest.approx(
            1.96 * float(row["twist_std_deg"]), 1e-3
        )
        assert row["targets_used"] == "6"
    assert float(table[1]["relative_deg"]) == pytest.approx(-3.5, abs=0.008)
    targets = rows_of(tmp_path / "out" / "twist-targets.csv")
    assert [row["id"] for row in targets] == list(wings.targets(wings.sections()).ids)
    assert {row["used"] for row in targets} == {"yes"}
    centres = np.concatenate([row.centres_m for row in wings.sections()])
    found = [[float(row["no_flow_x_mm"]), float(row["no_flow_z_mm"])] for row in targets]
    assert np.array(found) == pytest.approx(1e3 * centres[:, [0, 2]], abs=0.03)
    assert min(cv2.imread(str(tmp_path / "out" / "twist.png")).shape[:2]) > 500


def test_images_and_json(program):
    code, out, err = program("off.png", "on.png", "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    (flow,) = result["results"]
    assert (flow["flow"], flow["reference"], flow["clipped"]) == ("on", None, [])
    for station, true in zip(flow["stations"], TWISTS, strict=True):
        assert abs(station["twist_deg"] - true) < 4 * station["twist_std_deg"] < 0.04
        assert station["relative_deg"] is None
        assert len(station["used"]) == 6
    assert len(result["files"]) == 3


def test_nothing_is_overwritten_silently(program, tmp_path):
    out = tmp_path / "results"
    assert program("off.png", "on.png", out=out)[0] == 0
    code, _, err = program("off.png", "on.png", out=out)
    assert code == 2
    assert err == (
        f"glint-aoa: {out}/twist.csv is there already; give another --out, or --overwrite to "
        "replace it\n"
    )
    assert program("off.png", "on.png", "--overwrite", out=out)[0] == 0


def test_what_is_doubtful_is_told_and_strict_counts_it(program, films):
    rng = np.random.default_rng(2)
    rows = wings.flown(wings.sections(), TWISTS)
    rows[1].centres_m[2] += [0.0, 0.0, 0.003]
    wings.write_image(films / "slipped.png", rows, rng)
    code, _, err = program("off.png", "slipped.png", "--strict")
    assert code == 3
    assert err == ("slipped: station tip: tip-2 did not move with the others and was left out\n")


def test_a_hidden_target(program, films, tmp_path):
    rng = np.random.default_rng(3)
    rows = wings.flown(wings.sections(), TWISTS)
    image = wings.render_wing(wings.SCENE, rows, rng=rng)
    u, v = wings.pixels(rows)[9]
    v -= wings.FIRST_LINE
    image[int(v) - 8 : int(v) + 9, int(u) - 16 : int(u) + 17] = 35
    cv2.imwrite(str(films / "hidden.png"), image)
    code, _, err = program("off.png", "hidden.png")
    assert code == 2
    assert err == (
        "glint-aoa: hidden: tip-3 not found; see that every target is in view and lit, take it "
        "out of the table, or allow missing targets\n"
    )
    code, _, err = program("off.png", "hidden.png", "--allow-missing", out=tmp_path / "b")
    assert (code, err) == (0, "hidden: station tip: tip-3 not found\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("off.png", "none.png"), "none.png: no such file; check its name and folder"),
        (
            ("off.png", "on.png", "--polarity", "dark"),
            "off.png: 0 of the 12 targets found among 0 circles (not body-0, body-1, body-2, "
            "body-3, body-4, body-5 and more); check polarity, the limits of the diameter and the "
            "light",
        ),
        (
            ("off.png", "on.png", "--reference", "root"),
            "'root' is no station of the targets; give one of body, tip",
        ),
        (
            ("off.png", "on.png", "--min-diameter", "70"),
            "targets of 70 to 60 pixels across cannot be measured; give min_diameter of 2 pixels "
            "or more, and max_diameter greater than it",
        ),
    ],
)
def test_refusals(program, arguments, said):
    code, out, err = program(*arguments)
    assert (code, out, err) == (2, "", f"glint-aoa: {said}\n")
