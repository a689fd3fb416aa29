"""``glint-aoa init``."""

import json
import tomllib

import numpy as np
import pytest
from synthetic import line_fields

from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.setup import load_setup

TAPED = (
    "camera.focal_length=35 mm",
    'camera.pixel_pitch = ["11.7 um", "27.5 um"]',
    'camera.position=["0 m", "-56 in", "60 mm"]',
    "glint.nose=right",
)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def point(here):
    record = AcquisitionRecord(
        "das", {name: Channel(name, np.arange(9.0), 800.0) for name in ("aoa", "ay_face")}
    )
    info = FieldInfo(
        rate_hz=59.94005994005994,
        exposure_s=1e-3,
        first_line=98,
        interlaced=True,
        first_parity="odd",
    )
    fields = line_fields(n_fields=4, shape=(40, 200), row=20.0)
    write_point(here / "point.h5", RecordedPoint(fields=fields, info=info, acquisition=record))
    return here / "point.h5"


def with_values(*values):
    return [word for value in values for word in ("--set", value)]


def test_a_new_setup_says_what_is_left_to_fill_in(program, here):
    code, out, err = program("init")
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "Wrote glint-aoa.toml",
        "Fill in, with any editor:",
        "  camera.focal_length",
        "  camera.pixel_pitch",
        "  camera.sensor",
        "  camera.position",
        "  glint.nose",
    ]
    (here / "x.npy").write_bytes(b"")
    code, _, err = program("process", "x.npy", "--out", "results")
    assert code == 2
    assert err == (
        "glint-aoa: glint-aoa.toml: fill in camera.focal_length, camera.pixel_pitch, "
        "camera.sensor, camera.position and glint.nose; put a value in place of each "
        '"FILL IN"\n'
    )


def test_all_that_is_given_stands_in_the_setup(program, here):
    code, out, _ = program("init", "--camera", "752x240", *with_values(*TAPED), "--json")
    assert (code, json.loads(out)) == (0, {"setup": "glint-aoa.toml", "fill_in": []})
    setup = load_setup("glint-aoa.toml")
    assert setup.camera.sensor == (752, 240)
    assert setup.camera.position == pytest.approx((0, -1.4224, 0.06))
    assert setup.glint.nose == "right"


def test_a_recording_gives_its_timing_and_names_its_channels(program, here, point):
    code, _, _ = program("init", "--from", point, "--image-plane", "--set", "glint.nose=left")
    assert code == 0
    setup = load_setup("glint-aoa.toml")
    assert setup.fields.rate == 59.94005994005994
    assert setup.fields.exposure == 1e-3
    assert setup.fields.interlaced is True
    # the window and the parity of field 0 may differ from point to point
    assert (setup.fields.first_line, setup.fields.first_parity) == (None, None)
    text = (here / "glint-aoa.toml").read_text()
    assert "\n# 98: that of point.h5, which says so itself\n#first_line = " in text
    assert "\n# the window of point.h5 has 200 columns and 40 lines\n#sensor = " in text
    assert '\n# channels of point.h5: aoa, ay_face\n#name = "ay_face"  # example\n' in text
    assert program("process", point, "--out", "results")[0] == 0


def test_a_recording_that_does_not_say_its_rate_leaves_it_to_the_user(program, here):
    np.save(here / "clip.npy", line_fields(n_fields=2, shape=(40, 200), row=20.0))
    program("init", "--from", "clip.npy", "--image-plane")
    assert tomllib.loads((here / "glint-aoa.toml").read_text())["fields"] == {"rate": "FILL IN"}


def test_a_setup_is_not_replaced_unless_asked_for(program, here):
    (here / "glint-aoa.toml").write_text("")
    code, out, err = program("init")
    assert (code, out) == (2, "")
    assert err == (
        "glint-aoa: glint-aoa.toml is there already; give another --out, or --overwrite to "
        "replace it\n"
    )
    assert program("init", "--overwrite", "--image-plane")[0] == 0
    assert "FILL IN" in (here / "glint-aoa.toml").read_text()
    assert program("init", "--out", "sub/other.toml")[0] == 0
    assert (here / "sub" / "other.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["--camera", "752"],
            "--camera is 752; expected columns and lines of a field, e.g. 752x240",
        ),
        (["--set", "glint"], "--set is glint; expected KEY=VALUE, e.g. glint.nose=left"),
        (["--set", "glint.nsoe=left"], "unknown key glint.nsoe; did you mean nose?"),
        (
            ["--set", "glint=3"],
            "glint: Input should be a valid dictionary or instance of Glint",
        ),
        (["--set", "glint.y=3"], 'glint.y: 3 has no unit; write it as a string, e.g. "3 m"'),
        (["--from", "none.h5"], "none.h5: no such file; check its name and folder"),
    ],
)
def test_what_cannot_be_is_one_sentence_and_nothing_is_written(program, here, arguments, sentence):
    assert program("init", *arguments) == (2, "", f"glint-aoa: {sentence}\n")
    assert list(here.iterdir()) == []
