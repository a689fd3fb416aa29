import re

import numpy as np
import pytest

from glint_aoa.errors import SetupError
from glint_aoa.setup import Setup, load_setup

WHOLE = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [375.5, 119.5]
position = ["0 m", "-56 in", "60 mm"]
rotation = ["0 deg", "1 deg", "0 deg"]
distortion = [0, 0, 0, 0, 0]

[fields]
rate = "60 Hz"
exposure = "1 ms"
first_line = 98
interlaced = true
first_parity = "even"

[glint]
y = "0 mm"
nose = "left"
column_step = 20
search_window = [0, 92]

[inertial.filter]
kind = "butterworth"
order = 2
cutoff = "0.4 Hz"

[[inertial.channel]]
name = "ay_face"
quantity = "acceleration"
units = "m/s^2"
scale = 1.0
station = "0.9 m"
axis = "+y"
range = ["-100 m/s^2", "100 m/s^2"]

[[inertial.mode]]
number = 1
plane = "yaw"
frequency = "9.8 Hz"
radius = "31 in"

[calibration]
sweep = "sweep.toml"
"""


@pytest.fixture
def written(tmp_path):
    def write(old="", new=""):
        assert old in WHOLE
        path = tmp_path / "glint-aoa.toml"
        path.write_text(WHOLE.replace(old, new, 1) if old else WHOLE)
        return path

    return write


def test_units_become_si_and_radians(written):
    setup = load_setup(written())
    assert setup.camera.focal_length == pytest.approx(0.035)
    assert setup.camera.pixel_pitch == pytest.approx((11.7e-6, 27.5e-6))
    assert setup.camera.position == pytest.approx((0, -1.4224, 0.06))
    assert setup.camera.rotation == pytest.approx((0, np.pi / 180, 0))
    assert setup.fields.exposure == pytest.approx(1e-3)
    assert setup.inertial.mode[0].radius == pytest.approx(0.7874)
    assert setup.inertial.channel[0].limits == pytest.approx((-100, 100))
    assert setup.sweep_path == written().parent / "sweep.toml"


def test_an_empty_file_is_a_setup_without_a_camera(tmp_path):
    path = tmp_path / "empty.toml"
    path.write_text("")
    setup = load_setup(path)
    assert not setup.camera.is_oriented
    assert setup.glint.column_step == 20
    assert setup.sweep_path is None


def test_hash_follows_the_content_and_not_the_place(written, tmp_path):
    one = load_setup(written())
    elsewhere = tmp_path / "copy"
    elsewhere.mkdir()
    (elsewhere / "other.toml").write_text(WHOLE)
    assert load_setup(elsewhere / "other.toml").hash == one.hash
    assert load_setup(written("column_step = 20", "column_step = 10")).hash != one.hash
    assert re.fullmatch("[0-9a-f]{12}", one.hash)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("column_step", "colum_step", "unknown key glint.colum_step; did you mean column_step?"),
        ("[glint]", "[glnt]", "unknown key glnt; did you mean glint?"),
        (
            "radius =",
            "raduis =",
            "unknown key inertial.mode[0].raduis; did you mean radius?",
        ),
        (
            "column_step = 20",
            "zzz = 20",
            "unknown key glint.zzz; known keys here: y, yaw, nose, column_step, search_window, "
            "estimator, polarity, half_width, saturation, read_noise, electrons_per_grey, "
            "min_contrast, mean, vibration, reference, reflection",
        ),
        ('"35 mm"', '"35 kg"', "camera.focal_length: '35 kg' is not a quantity in m"),
        (
            '"35 mm"',
            "35",
            'camera.focal_length: 35 has no unit; write it as a string, e.g. "35 m"',
        ),
        ('"35 mm"', '"-35 mm"', "camera.focal_length: -0.035 must be greater than zero"),
        ('"35 mm"', '"nan mm"', "camera.focal_length: nan is not a finite number"),
        (
            '"60 Hz"',
            '"60 bananas"',
            "fields.rate: '60 bananas' is not a quantity that can be read; expected Hz",
        ),
        ("[752, 240]", "[752, 0]", "camera.sensor[1]: Input should be greater than or equal to 1"),
        ('nose = "left"', 'nose = "up"', "glint.nose: Input should be 'left' or 'right'"),
        (
            "search_window = [0, 92]",
            "search_window = [92, 92]",
            "glint: search_window [92, 92] is empty; give the first row and one past the last",
        ),
        (
            'position = ["0 m", "-56 in", "60 mm"]',
            "",
            "camera: position missing; give focal_length, pixel_pitch and position, or "
            "pixel_pitch alone for an angle in the image plane",
        ),
        ('radius = "31 in"', 'radius = "0 in"', "inertial.mode[0]: radius must not be zero"),
        (
            '["-100 m/s^2", "100 m/s^2"]',
            '["100 m/s^2", "-100 m/s^2"]',
            "inertial.channel[0]: range ['100 m/s^2', '-100 m/s^2'] is empty; "
            "give least, then greatest",
        ),
        (
            'units = "m/s^2"',
            'units = "bananas"',
            "inertial.channel[0].units: 'bananas' is not a unit that is known here",
        ),
    ],
)
def test_a_wrong_key_or_value_is_named(written, old, new, message):
    path = written(old, new)
    with pytest.raises(SetupError) as caught:
        load_setup(path)
    assert str(caught.value) == f"{path}: {message}"


def test_what_is_not_toml_or_not_there_is_said(tmp_path):
    with pytest.raises(SetupError, match=r"no such setup file; give one with --setup$"):
        load_setup(tmp_path / "absent.toml")
    path = tmp_path / "broken.toml"
    path.write_text('[glint]\ny = "0 mm')
    with pytest.raises(SetupError, match=r"not a TOML file: "):
        load_setup(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(SetupError, match=r"the file cannot be read"):
        load_setup(path)


def test_sections_are_frozen():
    with pytest.raises(ValueError, match="frozen"):
        Setup().glint = None


CALIBRATED = """\
kind = "camera calibration"
[camera]
focal_length = "35.02 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [370.2, 118.9]
distortion = [-0.1, 0.0, 0.0, 0.0, 0.0]
"""
RESECTED = """\
kind = "space resection"
[camera]
position = ["12.5 mm", "-1.42 m", "60 mm"]
rotation = ["0.1 deg", "0 deg", "-0.2 deg"]
"""
BOTH = '[calibration]\ncamera = "camera.toml"\npose = "pose.toml"\n'


@pytest.fixture
def calibrated(tmp_path):
    """Write a setup beside a camera calibration and a space resection."""
    (tmp_path / "camera.toml").write_text(CALIBRATED)
    (tmp_path / "pose.toml").write_text(RESECTED)

    def write(text):
        (tmp_path / "glint-aoa.toml").write_text(text)
        return tmp_path / "glint-aoa.toml"

    return write


def test_calibrations_fill_in_the_camera(calibrated):
    setup = load_setup(calibrated('[camera]\nfocal_length = "0.03502 m"\n' + BOTH))
    assert setup.camera.focal_length == pytest.approx(0.03502)
    assert setup.camera.principal_point == (370.2, 118.9)
    assert setup.camera.position == pytest.approx((0.0125, -1.42, 0.06))
    assert setup.camera.rotation[2] == pytest.approx(np.radians(-0.2))
    assert setup.camera_path.name == "camera.toml"
    assert setup.pose_path.name == "pose.toml"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '[camera]\nfocal_length = "35 mm"\n' + BOTH,
            "camera.focal_length is 35 mm in the setup and 35.02 mm in {folder}/camera.toml; "
            "take it out of the setup, or the calibration",
        ),
        (
            '[calibration]\npose = "gone.toml"\n',
            "{folder}/gone.toml: no such space resection; make one with glint-aoa calibrate resect",
        ),
        (
            '[calibration]\ncamera = "pose.toml"\n',
            "{folder}/pose.toml: not a camera calibration; "
            "make one with glint-aoa calibrate camera",
        ),
        (
            BOTH + '[uncertainty]\nposition = ["1 mm", "0 mm", "0 mm"]\n',
            "{folder}/glint-aoa.toml: uncertainty.position is given and calibration.pose states "
            "it too; keep one of them",
        ),
        (
            '[uncertainty]\ny = "-1 mm"\n',
            "{folder}/glint-aoa.toml: uncertainty.y: Input should be greater than or equal to 0",
        ),
    ],
)
def test_calibrations_that_cannot_be_joined_are_refused(calibrated, text, message):
    path = calibrated(text)
    with pytest.raises(SetupError) as refused:
        load_setup(path)
    assert str(refused.value) == message.format(folder=path.parent)
