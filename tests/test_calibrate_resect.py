"""The command ``glint-aoa calibrate resect``, from tables and pictures to the calibration."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from independent_camera import Camera, turned
from known_targets import APPROXIMATE, STD, TRUE, board
from matplotlib.figure import Figure

from calibration.resection.resect import SpaceResection
from glint_aoa.report.resection_figures import resection_figure
from render_sim.discs import paint


def write(path, header, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a setup, a field of targets in mm, and where they are seen."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    (tmp_path / "glint-aoa.toml").write_text(APPROXIMATE.toml)
    points = board()
    write(
        tmp_path / "targets.csv",
        ["id", "X [mm]", "Y [mm]", "Z [mm]"],
        [[f"T{i + 1}", *1e3 * point] for i, point in enumerate(points)],
    )
    write_seen(tmp_path / "image.csv", points)
    return tmp_path


def write_seen(path, points, *, camera=TRUE, wrong=()):
    uv = np.stack(camera.pixels(points), axis=-1)
    uv += np.random.default_rng(1).normal(size=uv.shape) * STD
    uv[list(wrong), 0] += 2.0
    rows = [[f"T{i + 1}", *place, *STD] for i, place in enumerate(uv)]
    write(path, ["id", "u", "v", "std_u", "std_v"], rows)


@pytest.fixture
def undrawn(monkeypatch):
    """Write pictures without drawing them, which takes longer than all else."""
    monkeypatch.setattr(Figure, "savefig", lambda self, path, **how: Path(path).write_bytes(b"-"))


@pytest.fixture
def program(program, here):
    """Run ``calibrate resect``; returns exit code, stdout and stderr."""

    def run(*arguments):
        code, out, err = program("calibrate", "resect", *arguments)
        assert "Traceback" not in out + err
        return code, out, err

    return run


def test_the_pose_is_printed_and_written_with_its_picture(program, here):
    code, out, err = program("targets.csv", "--measured", "image.csv")
    assert (code, err) == (0, "")
    found = SpaceResection.load("pose.toml")
    assert (np.abs(found.position_m - TRUE.position) < 4 * found.std[:3]).all()
    said = dict(re.findall(r"^(\w+) \[(?:mm|deg)\] +(\S+)", out, re.MULTILINE))
    expected = [*1e3 * found.position_m, *np.degrees(found.rotation_rad)]
    assert [float(each) for each in said.values()] == pytest.approx(expected, abs=5e-5)
    assert list(said) == ["X", "Y", "Z", "omega", "phi", "kappa"]
    omega, phi, kappa = found.textbook_deg
    assert f"Textbook: omega {omega:.4f}, phi {phi:.4f}, kappa {kappa:.4f} deg of M = R3(" in out
    assert "R = Rz(kappa) Ry(phi) Rx(omega), camera to tunnel" in out
    assert 'and add:\n\n[calibration]\npose = "pose.toml"\n' in out
    assert (here / "pose.png").read_bytes().startswith(b"\x89PNG")
    assert found.provenance.targets == "targets.csv"
    assert found.provenance.measured == "image.csv"


@pytest.mark.usefixtures("undrawn")
def test_the_pose_is_applied_as_the_output_says(program, here):
    assert program("targets.csv", "-m", "image.csv")[0] == 0
    lines = APPROXIMATE.toml.splitlines()
    text = "\n".join(each for each in lines if not each.startswith(("position", "rotation")))
    (here / "glint-aoa.toml").write_text(text + '\n[calibration]\npose = "pose.toml"\n')
    code, out, _ = program("targets.csv", "-m", "image.csv", "-o", "again.toml")
    assert code == 0
    assert "To apply it" not in out
    one, two = (SpaceResection.load(name).pose for name in ("pose.toml", "again.toml"))
    np.testing.assert_allclose(two, one, atol=1e-9)


@pytest.mark.usefixtures("undrawn")
def test_json_is_all_that_is_on_stdout(program):
    code, out, _ = program("targets.csv", "-m", "image.csv", "--json")
    assert code == 0
    result = json.loads(out)
    found = SpaceResection.load("pose.toml")
    assert result["position_m"] == pytest.approx(found.position_m.tolist())
    assert result["rotation_u95_deg"] == pytest.approx(np.degrees(found.u95[3:]).tolist())
    assert result["textbook_rotation_deg"] == pytest.approx(found.textbook_deg.tolist())
    assert [each["id"] for each in result["targets"]] == [f"T{i + 1}" for i in range(12)]


@pytest.mark.usefixtures("undrawn")
def test_a_target_left_out_is_named_on_stderr(program, here):
    write_seen(here / "image.csv", board(), wrong=[4])
    code, out, err = program("targets.csv", "-m", "image.csv")
    assert code == 0
    assert re.fullmatch(r"T5 left out: [\d.]+ pixels off, \d+ standard deviations\n", err)
    assert re.search(r"^T5 .* pixels off, ", out, re.MULTILINE)


@pytest.mark.usefixtures("undrawn")
def test_the_papers_form(program, here):
    aligned = Camera(position=(0.012, -56 * 0.0254, 0.055))
    (here / "glint-aoa.toml").write_text(replace(aligned, position=(0.0, -1.4, 0.06)).toml)
    write_seen(here / "image.csv", board(), camera=aligned)
    arguments = ["targets.csv", "-m", "image.csv", "--hold", "omega,phi,kappa"]
    code, out, err = program(
        *arguments, "--prior-distance", "56 in", "--prior-std", "5 mm", "-o", "aligned.toml"
    )
    assert (code, err) == (0, "")
    assert re.search(r"^kappa \[deg\] +0\.0000 +held$", out, re.MULTILINE)
    found = SpaceResection.load("aligned.toml")
    assert found.held == ("omega", "phi", "kappa")
    assert (found.distance_m, found.distance_std_m) == pytest.approx((1.4224, 0.005))
    assert (np.abs(found.position_m - aligned.position) < 4 * found.std[:3]).all()
    code, _, err = program(
        *arguments, "--prior-distance", "1.5 m", "--prior-std", "5 mm", "-o", "wrong.toml"
    )
    assert code == 0
    assert "The taped distance lies +77.6 mm from what the targets say, 16 times its" in err


@pytest.mark.usefixtures("undrawn")
def test_what_is_held_has_the_uncertainty_that_the_setup_gives_it(program, here):
    aligned = Camera(position=(0.012, -1.4224, 0.055))
    write_seen(here / "image.csv", board(), camera=aligned)
    uncertain = '[uncertainty]\nrotation = ["0.1 deg", "0.2 deg", "0.3 deg"]\n'
    (here / "glint-aoa.toml").write_text(aligned.toml + uncertain)
    code, out, _ = program("targets.csv", "-m", "image.csv", "--hold", "phi, kappa")
    assert code == 0
    found = SpaceResection.load("pose.toml")
    assert np.degrees(found.std[4:]) == pytest.approx([0.2, 0.3])
    assert found.held == ("phi", "kappa")
    assert re.search(r"^kappa \[deg\] +0\.0000 +0\.3000 +0\.5880$", out, re.MULTILINE)


@pytest.mark.usefixtures("undrawn")
def test_residuals_beyond_the_stated_noise_are_told(program, here):
    with (here / "image.csv").open() as file:
        rows = list(csv.reader(file))
    write(here / "image.csv", rows[0], [[*row[:3], 0.005, 0.002] for row in rows[1:]])
    code, _, err = program("targets.csv", "-m", "image.csv")
    assert code == 0
    assert re.fullmatch(
        r"The residuals are \d+\.\d times what the stated noise explains; look at pose\.png\n", err
    )


@pytest.mark.usefixtures("undrawn")
def test_a_plane_that_allows_two_poses_is_told(program, here):
    points = 0.1 * board() @ turned("z", -15).T
    write(
        here / "targets.csv",
        ["id", "X [mm]", "Y [mm]", "Z [mm]"],
        [[f"T{i + 1}", *1e3 * point] for i, point in enumerate(points)],
    )
    write_seen(here / "image.csv", points)
    code, _, err = program("targets.csv", "-m", "image.csv")
    assert code == 0
    assert re.search(r"^These targets allow another pose as well \(omega, phi, kappa ", err)
    assert "These targets hardly show which way they are tilted, and the uncertainty is " in err


# A picture of circles


def discs(parity):
    """Draw the board's targets as bright discs."""
    turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    face = turned("z", 15)
    outlines = []
    for centre in board():
        rim = 0.004 * (np.outer(np.cos(turn), face[:, 0]) + np.outer(np.sin(turn), face[:, 2]))
        u, v = TRUE.pixels(centre + rim)
        outlines.append(np.stack([u, v - 0.5 * parity], axis=-1))
    grey = 20 + 153 * paint(outlines, (240, 752), blur=(1.0, 0.5))
    noise = np.random.default_rng(2 + parity).normal(size=grey.shape)
    return np.clip(np.rint(grey + noise), 0, 255).astype(np.uint8)


@pytest.mark.usefixtures("undrawn")
def test_a_frame_of_two_fields_gives_the_pose(program, here):
    frame = np.empty((480, 752), np.uint8)
    frame[0::2], frame[1::2] = discs(0), discs(1)
    frame[26:42, 40:56] = 200  # a square that is no target
    cv2.imwrite(str(here / "frame.png"), frame)
    cv2.imwrite(str(here / "dark.png"), 255 - frame)
    code, _, err = program("targets.csv", "--image", "frame.png", "--scan", "interlaced")
    assert code == 0
    found = SpaceResection.load("pose.toml")
    np.testing.assert_allclose(found.position_m, TRUE.position, atol=1e-3)
    np.testing.assert_allclose(np.degrees(found.rotation_rad), TRUE.rotation, atol=0.05)
    assert "left out" not in err
    dark = ["--image", "dark.png", "--scan", "interlaced", "--polarity", "dark"]
    assert program("targets.csv", *dark, "-o", "other.toml")[0] == 0
    np.testing.assert_allclose(SpaceResection.load("other.toml").pose, found.pose, atol=1e-4)


# What is refused


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["targets.csv"],
            "where the targets are seen comes from --measured FILE.csv or from --image FILE; give "
            "one of the two",
        ),
        (
            ["targets.csv", "-m", "image.csv", "-i", "image.csv"],
            "where the targets are seen comes from --measured FILE.csv or from --image FILE; give "
            "one of the two",
        ),
        (
            ["gone.csv", "-m", "image.csv"],
            "gone.csv: no such table; check its name and folder",
        ),
        (
            ["targets.csv", "-m", "image.csv", "--units", "m"],
            "targets.csv: column X says mm, --units says m; leave --units out or correct the "
            "header",
        ),
        (
            ["targets.csv", "-m", "image.csv", "--prior-distance", "56"],
            "--prior-distance: '56' is not a quantity in m; give a length such as \"56 in\"",
        ),
        (
            ["targets.csv", "-m", "image.csv", "--prior-distance", "56 in"],
            "a taped distance needs its uncertainty, and the uncertainty a distance; give both, "
            "e.g. 56 in and 5 mm",
        ),
        (
            ["targets.csv", "-m", "image.csv", "--hold", "omega,roll"],
            "'roll' cannot be held; choose from X, Y, Z, omega, phi, kappa",
        ),
        (
            ["targets.csv", "-m", "image.csv", "-o", "pose.png"],
            "pose.png: a calibration is a TOML file; end its name with .toml",
        ),
        (
            ["targets.csv", "-m", "image.csv", "-o", "glint-aoa.toml", "--overwrite"],
            "glint-aoa.toml is the setup itself; give the calibration another name",
        ),
        (
            ["targets.csv", "-m", "image.csv", "-s", "gone.toml"],
            "gone.toml: no such setup file; give one with --setup",
        ),
    ],
)
def test_what_cannot_be_used_is_one_sentence(program, here, arguments, sentence):
    before = sorted(path.name for path in here.iterdir())
    assert program(*arguments) == (2, "", f"glint-aoa: {sentence}\n")
    assert sorted(path.name for path in here.iterdir()) == before


@pytest.mark.usefixtures("undrawn")
def test_the_input_is_never_replaced(program, here):
    cv2.imwrite(str(here / "pose.png"), discs(0))
    before = (here / "pose.png").read_bytes()
    assert program("targets.csv", "--image", "pose.png", "--overwrite") == (
        2,
        "",
        "glint-aoa: pose.png is an input, and the picture of the residuals would replace it; give "
        "another --out\n",
    )
    assert (here / "pose.png").read_bytes() == before


@pytest.mark.usefixtures("undrawn")
def test_millimetres_taken_for_metres_are_recognised(program, here):
    text = (here / "targets.csv").read_text().replace("[mm]", "[m]")
    (here / "targets.csv").write_text(text)
    code, out, err = program("targets.csv", "-m", "image.csv")
    assert (code, out) == (2, "")
    assert re.fullmatch(
        r"glint-aoa: the camera would stand 14\d\d m from the targets, as if millimetres were "
        r"taken for metres; correct the unit of the target field\n",
        err,
    )
    assert not (here / "pose.toml").exists()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("there", ["pose.toml", "pose.png"])
def test_nothing_is_replaced_unless_asked(program, here, there):
    (here / there).write_text("mine")
    assert program("targets.csv", "-m", "image.csv") == (
        2,
        "",
        f"glint-aoa: {there} is there already; give another --out, or --overwrite to replace it\n",
    )
    assert (here / there).read_text() == "mine"
    assert program("targets.csv", "-m", "image.csv", "--overwrite")[0] == 0


# The picture of the residuals


@pytest.mark.usefixtures("undrawn")
def test_the_figure_shows_every_target_once(program, here):
    write_seen(here / "image.csv", board(), wrong=[4])
    program("targets.csv", "-m", "image.csv")
    found = SpaceResection.load("pose.toml")
    figure = resection_figure(found, pixel_pitch=TRUE.pitch, sensor=TRUE.sensor)
    image, scatter = figure.axes
    used, left_out = image.lines
    assert len(used.get_xdata()) == 11
    assert left_out.get_xdata() == pytest.approx([found.targets[4].u])
    assert sorted(text.get_text() for text in image.texts) == sorted(f"T{i + 1}" for i in range(12))
    assert image.get_xlabel() == "column u [pixels]"
    assert image.get_ylim() == (239.5, -0.5)
    assert scatter.get_ylabel() == "residual of v [field lines]"
    assert image.get_aspect() == pytest.approx(27.5 / 11.7)
    without = resection_figure(found, pixel_pitch=TRUE.pitch)
    low, high = sorted(without.axes[0].get_ylim())
    assert low < min(each.v for each in found.targets)
    assert high > max(each.v for each in found.targets)
