import re
from dataclasses import fields, replace

import pytest

from glint_aoa.errors import SetupError
from render_sim.campaign_file import load_campaign, scene_of
from render_sim.scene import Body, Lamp, Optics, Sensor, Surface, load_scene, paper_scene

CAMERA = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
position = ["0 m", "-1.4 m", "60 mm"]
[fields]
rate = "60 Hz"
exposure = "1 ms"
"""


def scene_file(folder, text):
    path = folder / "scene.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("part", [Body, Lamp, Surface, Optics, Sensor])
def test_what_a_file_leaves_out_is_as_in_the_papers_scene(part):
    name = part.__name__.lower()
    stated, usual = getattr(paper_scene(), name), part()
    for each in fields(part):
        assert getattr(stated, each.name) == getattr(usual, each.name)


def test_quantities_have_units(tmp_path):
    text = CAMERA + '[body]\nradius = "2 in"\n[lamp]\ncentre = ["0 m", "-24 in", "5 ft"]\n'
    scene = load_scene(scene_file(tmp_path, 'glint_y = "-50 mm"\nnose = "right"\n' + text))
    assert scene.body.radius_m == pytest.approx(0.0508)
    assert scene.lamp.centre_m == pytest.approx((0.0, -0.6096, 1.524))
    assert (scene.glint_y_m, scene.nose) == (-0.05, "right")
    assert scene.surface == Surface()


def test_a_mesh_lies_beside_its_scene_file(tmp_path):
    scene = load_scene(scene_file(tmp_path, CAMERA + '[body]\nmesh = "model.stl"\n'))
    assert scene.body.mesh == tmp_path / "model.stl"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[body]\nradios = '1 m'\n", "unknown key body.radios; did you mean radius?"),
        ("[body]\nradius_m = 0.06\n", "unknown key body.radius_m; did you mean radius?"),
        (
            "[body]\nradius = 0.06\n",
            'body.radius: 0.06 has no unit; write it as a string, e.g. "0.06 m"',
        ),
        ("[body]\nradius = '-6 mm'\n", "body.radius: -0.006 must be greater than zero"),
        ("[lamp]\ncentre = ['1 m']\n", "lamp.centre[1]: missing"),
        ("[sensor]\nbits = 7\n", "sensor.bits: Input should be greater than or equal to 8"),
        ("[surfce]\n", "unknown key surfce; did you mean surface?"),
    ],
)
def test_a_wrong_value_is_named(tmp_path, text, message):
    path = scene_file(tmp_path, CAMERA + text)
    with pytest.raises(SetupError, match=f"^{re.escape(f'{path}: {message}')}$"):
        load_scene(path)


def test_a_campaign_names_its_scene(tmp_path):
    scene_file(tmp_path, CAMERA)
    (tmp_path / "test.toml").write_text(
        'name = "test"\nstart = 2026-01-12T08:00:00\nscene = "scene.toml"\n'
        '[[sweep]]\nname = "sweep"\nfirst = "-1 deg"\nlast = "1 deg"\npoints = 2\n'
    )
    scene = scene_of(load_campaign(tmp_path / "test.toml"))
    assert scene == replace(paper_scene(), camera=scene.camera, fields=scene.fields)
    assert scene.camera.position == (0.0, -1.4, 0.06)
    assert scene_of(load_campaign("demo")) == paper_scene()
