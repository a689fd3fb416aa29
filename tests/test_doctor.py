"""``glint-aoa doctor``, and what it looks at."""

import json
import re

import crashing
import pytest

from glint_aoa import installation, machine
from glint_aoa.cli import _renderer_trial
from glint_aoa.cli._renderer_trial import RendererTrial, try_renderer
from glint_aoa.errors import MissingLibraryError
from glint_aoa.installation import LibraryState, SystemLibrary
from glint_aoa.machine import Speed, field_rate, look_at_machine

SPEED = Speed(1234.4, 0.25, 240, 752, 1e-6, 2e-5)
WORKS = [RendererTrial("raytrace", 0.002, None), RendererTrial("pyrender", 0.1, None)]


@pytest.fixture
def healthy(monkeypatch, tmp_path):
    """A machine on which all is well, in an instant; change what stands in it."""
    found = {
        "libraries": [LibraryState("numpy", ">=1.26", "2.2.1")],
        "system": [SystemLibrary("EGL", "libegl1", "libEGL.so.1")],
        "renderers": {each.name: each for each in WORKS},
        "speed": SPEED,
    }
    monkeypatch.setattr(installation, "library_states", lambda: found["libraries"])
    monkeypatch.setattr(installation, "system_libraries", lambda: found["system"])
    monkeypatch.setattr(_renderer_trial, "try_renderer", lambda name: found["renderers"][name])
    monkeypatch.setattr(machine, "field_rate", lambda *, seconds: found["speed"])
    monkeypatch.chdir(tmp_path)
    return found


def test_a_healthy_machine_is_told_in_full(program, healthy, tmp_path):
    code, out, err = program("doctor")
    assert (code, err) == (0, "")
    assert re.match(r"glint-aoa \S+, Python 3\.\d+\.\d+, ", out)
    for line in (
        "  numpy                    2.2.1",
        "  libEGL                   libEGL.so.1",
        "  raytrace                 works, 2.0 ms an image of 752 x 24 pixels",
        "  pyrender                 works, 100.0 ms an image of 752 x 24 pixels",
        "  speed                    1234 fields/s of 752 x 240 pixels, from memory",
        "                           and 0.2 s a point to learn the glint and the noise",
        "  angle                    off by +0.000001 deg, stated 1 sigma 0.000020 deg",
    ):
        assert f"\n{line}\n" in out
    assert f"\n  folder                   {tmp_path} can be written to, " in out
    assert out.endswith("\nAll that is needed works\n")


def test_json_holds_the_same(program, healthy):
    code, out, _ = program("doctor", "--json")
    found = json.loads(out)
    assert (code, found["problems"]) == (0, [])
    assert found["installed"][0]["version"] == "2.2.1"
    assert found["renderers"][1] == {"name": "pyrender", "seconds": 0.1, "problem": None}
    assert found["speed"]["fields_per_s"] == 1234.4
    assert found["machine"]["processors"] >= 1


def test_what_is_missing_is_one_sentence_and_what_needs_it_is_not_tried(program, healthy):
    healthy["libraries"] = [LibraryState("numba", ">=0.60", "0.50")]
    healthy["renderers"] = {}
    sentence = 'numba is 0.50, wanted is >=0.60; pip install "numba>=0.60"'
    code, out, err = program("doctor")
    assert (code, err) == (2, f"glint-aoa: {sentence}\n")
    assert f"  numba                    0.50          {sentence}\n" in out
    code, out, err = program("doctor", "--json")
    assert (code, json.loads(out)["problems"]) == (2, [sentence])


def test_extras_and_opengl_are_told_and_can_be_done_without(program, healthy):
    healthy["libraries"].append(LibraryState("panel", ">=1.4", None, "monitor"))
    healthy["system"] = [SystemLibrary("EGL", "libegl1", None), SystemLibrary("GL", "libgl1", None)]
    healthy["renderers"]["pyrender"] = RendererTrial("pyrender", None, "it needs OpenGL")
    code, out, err = program("doctor")
    assert (code, err) == (0, "")
    assert 'panel is not installed, wanted is >=1.4; pip install "glint-aoa[monitor]"\n' in out
    assert "does not work: it needs OpenGL (apt install libegl1 libgl1)\n" in out


def test_a_renderer_that_all_need_and_a_wrong_angle_are_told(program, healthy):
    healthy["renderers"]["raytrace"] = RendererTrial("raytrace", None, "it crashed (SIGSEGV)")
    healthy["speed"] = Speed(1234.4, 0.25, 240, 752, 2e-4, 2e-5)
    code, _, err = program("doctor")
    assert code == 2
    assert err == (
        "glint-aoa: the renderer raytrace does not work: it crashed (SIGSEGV); fields of a known "
        "angle were measured +0.00020 deg off; install numba and numpy again and report it if "
        "that does not help\n"
    )


def test_a_folder_that_is_none_is_refused(program, healthy):
    assert program("doctor", "--folder", "none") == (
        *(2, ""),
        "glint-aoa: none: no such folder; make it, or give another --folder\n",
    )


def test_a_disk_that_takes_nothing_is_seen(monkeypatch, tmp_path):
    def full(**_):
        raise OSError(28, "No space left on device")

    assert look_at_machine(tmp_path).is_writable
    monkeypatch.setattr("tempfile.TemporaryFile", full)
    assert not look_at_machine(tmp_path).is_writable


@pytest.mark.parametrize("name", ["raytrace", "pyrender"])
def test_a_renderer_is_tried_in_a_process_of_its_own(name):
    trial = try_renderer(name)
    assert trial.works or name == "pyrender", trial.problem
    assert (trial.seconds is None) == (trial.problem is not None)


@pytest.mark.parametrize(
    ("does", "problem"),
    [
        ("crash", "it crashed (SIGKILL); update the graphics driver, or use another renderer"),
        ("leave", "it crashed (exit code 3); update the graphics driver, or use another renderer"),
        ("be_idle", "it drew nothing in 1 s; use another renderer"),
    ],
)
def test_a_renderer_that_takes_its_process_down_is_told(monkeypatch, does, problem):
    monkeypatch.setattr(_renderer_trial, "_draw", getattr(crashing, does))
    monkeypatch.setattr(_renderer_trial, "_PATIENCE_S", 1.0 if does == "be_idle" else 60.0)
    assert try_renderer("any") == RendererTrial("any", None, problem)


def test_what_a_renderer_says_is_told():
    trial = try_renderer("brush")
    assert trial.problem == "unknown renderer 'brush'; choose auto, raytrace or pyrender"


def test_a_picture_without_a_glint_is_no_picture(monkeypatch):
    class Black:
        def radiance(self, poses):
            import numpy as np

            return np.zeros((1, 24, 752))

    monkeypatch.setattr("render_sim.renderer.make_renderer", lambda scene, name: Black())
    with pytest.raises(MissingLibraryError, match="picture that it drew shows no glint"):
        _renderer_trial._timed("raytrace")


def test_the_synthetic_fields_give_their_angle():
    speed = field_rate(seconds=0.0, n_fields=40)
    assert speed.is_right
    assert abs(speed.error_deg) < 3e-4
    assert speed.fields_per_s > 0
