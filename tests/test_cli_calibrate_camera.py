"""``glint-aoa calibrate camera`` from pictures to file, figure and exit code."""

import dataclasses
import json

import cv2
import numpy as np
import pytest
from board_pictures import Lens, chessboard, interlaced, pose, views

from calibration.camera.boards import Board, BoardImage
from calibration.camera.calibrate import CameraCalibration, calibrate_camera
from glint_aoa.cli.calibrate_camera import _warn

LENS = Lens(0.0175, sensor=(376, 120), principal=(190.3, 58.2), distortion=(-0.2, 0, 0, 0, 0))
BOARD = ["--board", "chessboard:6x4:30mm"]
PITCH = ["--pixel-pitch", "11.7 um", "27.5 um"]
SETUP = """
[camera]
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [376, 120]
"""
FEW = ["--distortion", "1", "--hold", "principal_point", "--draws", "20"]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Folder with five interlaced frames of a board, a dark one, and a setup."""
    folder, rng = tmp_path_factory.mktemp("boards"), np.random.default_rng(12)
    for k in range(5):
        at = pose(
            25 + 3 * k,
            direction_deg=72 * k + 20,
            turn_deg=90 * k + 6,
            distance=1.45,
            at=0.03 * np.array([np.cos(2 * k), np.sin(2 * k)]),
            middle=(0.075, 0.045),
        )
        cv2.imwrite(
            str(folder / f"board-{k}.png"), interlaced(chessboard(6, 4, 0.03), LENS, *at, rng)
        )
    cv2.imwrite(str(folder / "dark.png"), np.full((240, 376), 30, np.uint8))
    (folder / "glint-aoa.toml").write_text(SETUP)
    return folder


@pytest.fixture
def program(program, pictures, tmp_path, monkeypatch):
    """Run ``calibrate camera`` on the pictures; returns exit code, stdout and stderr."""

    def run(*arguments, names="board-*.png", out="camera.toml"):
        monkeypatch.chdir(pictures)
        images = [path.name for path in sorted(pictures.glob(names))]
        return program("calibrate", "camera", *images, *arguments, "--out", tmp_path / out)

    return run


def test_interlaced_frames_to_file_and_picture(program, tmp_path):
    code, out, err = program(*BOARD, *PITCH, *FEW, "--scan", "interlaced", names="*.png")
    assert code == 0, err
    lines = out.splitlines()
    assert lines[0].split() == ["parameter", "value", "1", "sigma", "bootstrap"]
    assert [line.split("  ")[0] for line in lines[1:4]] == [
        "focal length",
        "vertical pixel pitch",
        "k1",
    ]
    assert "Held as given: principal_point" in lines
    assert "10 of 12 pictures used, rms 0.0" in out
    for field in ("even", "odd"):
        assert (
            f"Left out: dark.png ({field} field): the picture is of one grey, 30 to 30; light the "
            "board and expose longer"
        ) in lines
    assert f"Wrote {tmp_path / 'camera.toml'} and {tmp_path / 'camera.png'}" in lines
    assert lines[-4:] == [
        "To apply it, add to a setup:",
        "",
        "[calibration]",
        'camera = "camera.toml"',
    ]
    found = CameraCalibration.load(tmp_path / "camera.toml")
    assert found.sensor == (376, 120)
    assert abs(found.pixel_pitch_m[1] / 27.5e-6 - 1) < 5e-4
    assert err == (
        "The corners leave out much of the sensor, where the distortion is only extrapolated; "
        "photograph the board near the edges of the picture too\n"
    )
    assert len(found.provenance.files) == 6
    assert found.provenance.date
    assert (tmp_path / "camera.png").stat().st_size > 10_000


def test_the_setup_gives_pitch_and_sensor_and_json_the_numbers(program, tmp_path, pictures):
    setup = ["--setup", "glint-aoa.toml"]
    code, out, _ = program(
        *BOARD, *setup, *FEW, "--board-std", "0 mm", "--scan", "interlaced", "--json"
    )
    assert code == 0
    said = json.loads(out)
    found = CameraCalibration.load(tmp_path / "camera.toml")
    assert said["camera"] == found.camera_section()
    assert said["parameters"]["k1"]["std"] == found.std[2]
    assert said["parameters"]["k1"]["bootstrap_std"] == found.bootstrap_std[2]
    assert said["hold"] == ["principal_point"]
    assert [image["used"] for image in said["images"]] == [True] * 10
    assert found.board_std_m == 0


def test_frames_for_fields_are_told_apart_by_the_sensor(program):
    code, out, err = program(*BOARD, "--setup", "glint-aoa.toml")
    assert (code, out) == (2, "")
    assert err == (
        "glint-aoa: board-0.png: 376 x 240 pixels from column 0, line 0 do not fit a sensor of 376 "
        "x 120; these are frames of two fields: give --scan interlaced\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            BOARD,
            "the pixel pitch is not known; give --pixel-pitch H V, or --setup with "
            "camera.pixel_pitch",
        ),
        (
            [*BOARD, "--pixel-pitch", "11.7", "27.5"],
            "--pixel-pitch: '11.7' is not a quantity in m; give a length such as \"11.7 um\"",
        ),
        (
            ["--board", "6x4", *PITCH],
            'board "6x4": "6x4" is not a kind of board; give one such as chessboard:9x6:30mm, '
            "circles:7x6:36mm, asymmetric-circles:4x11:20mm, charuco:11x8:30mm:22mm:5x5_250",
        ),
        (
            [*BOARD, *PITCH, "--board-std", "thin", "--scan", "interlaced"],
            "--board-std: 'thin' is not a quantity that can be read; expected m; give a length "
            'such as "11.7 um"',
        ),
    ],
)
def test_what_cannot_be_is_one_sentence(program, arguments, message):
    code, out, err = program(*arguments, names="board-0.png")
    assert (code, out) == (2, "")
    assert err == f"glint-aoa: {message}\n"


def test_one_picture_is_too_few(program, tmp_path):
    code, _, err = program(*BOARD, *PITCH, "--scan", "interlaced", names="board-0.png")
    assert code == 2
    assert err == (
        "glint-aoa: a camera is calibrated from 3 images of the board or more, better 12, and 2 "
        "are usable; photograph the board at other places and tilts\n"
    )
    assert list(tmp_path.iterdir()) == []


class TestOutput:
    def test_nothing_is_replaced_unasked(self, program, tmp_path):
        (tmp_path / "camera.png").write_text("mine")
        code, _, err = program(*BOARD, *PITCH)
        assert code == 2
        assert err == (
            f"glint-aoa: {tmp_path / 'camera.png'} is there already; give another --out, or "
            "--overwrite to replace it\n"
        )

    def test_another_suffix(self, program, tmp_path):
        code, _, err = program(*BOARD, *PITCH, out="camera.json")
        assert code == 2
        assert err == (
            f"glint-aoa: {tmp_path / 'camera.json'}: a calibration is a TOML file; end its name "
            "with .toml\n"
        )

    def test_the_picture_of_the_residuals_spares_those_of_the_board(self, program, pictures):
        code, _, err = program(*BOARD, *PITCH, out=pictures / "board-1.toml")
        assert code == 2
        assert err == (
            f"glint-aoa: {pictures / 'board-1.png'}, the picture of the residuals, would replace a "
            "picture of the board; give another --out\n"
        )

    def test_the_setup_itself(self, program, pictures):
        code, _, err = program(
            *BOARD, "--setup", pictures / "glint-aoa.toml", out=pictures / "glint-aoa.toml"
        )
        assert code == 2
        assert err == (
            f"glint-aoa: {pictures / 'glint-aoa.toml'} is the setup itself; give the calibration "
            "another name\n"
        )


def test_a_bootstrap_far_above_the_least_squares_is_a_warning(capsys):
    lens = Lens(0.008, (1e-5, 1e-5), (640, 480), (322.0, 236.0))
    board = Board("chessboard", 7, 5, 0.03)
    seen = views(lens, board.places, np.random.default_rng(1), 9)
    images = [BoardImage(f"{k}", f"{k}", np.arange(35), uv) for k, (uv, _) in enumerate(seen)]
    fitted = calibrate_camera(
        images, board, sensor=lens.sensor, pixel_pitch=lens.pitch, distortion=2, draws=0
    )
    apart = dataclasses.replace(fitted, bootstrap_covariance=9 * fitted.covariance)
    _warn(apart, "a.png")
    told = (
        "Resampling the pictures gives 3.0 times the uncertainty: they disagree more than their "
        "noise explains; look at a.png\n"
    )
    err = capsys.readouterr().err
    assert err.startswith(told)
    few = tuple(dataclasses.replace(image, source="one") for image in fitted.images)
    _warn(dataclasses.replace(apart, images=few), "a.png")
    assert capsys.readouterr().err == err.removeprefix(told)
