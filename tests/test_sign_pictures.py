"""What the pictures of signs claim, held against the program and against the simulator."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from docs.pictures import signs
from glint_aoa.geometry.camera import image_plane
from glint_aoa.geometry.collinearity import PixelToPlane, project
from glint_aoa.inertial.sensor import bias_from_velocity
from glint_aoa.optical.measure import measure_stack
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.recording import Recording, resolve_recording
from glint_aoa.setup import Camera, Setup
from render_sim.film import attitude
from render_sim.motion import rigid, rotation_y, rotation_z
from render_sim.scene import paper_scene

CAMERA = {
    "focal_length": "35 mm",
    "pixel_pitch": ["11.7 um", "27.5 um"],
    "sensor": [752, 240],
    "position": ["0 m", "-56 in", "0 m"],
}
SMALL = 0.5  # deg


def seen(points, **angles):
    """Image x, z in metres of points of the tunnel, by a camera that is turned."""
    turned = [f"{angles.get(name, 0.0)} deg" for name in ("omega", "phi", "kappa")]
    camera = Camera.model_validate({**CAMERA, "rotation": turned})
    return np.stack(
        image_plane(
            *project(points, camera=camera),
            principal_point=camera.principal_point_used,
            pixel_pitch=camera.pixel_pitch,
        )
    )


@pytest.mark.parametrize("name", signs.IMAGE_MOVES)
def test_the_picture_moves_as_drawn_when_the_camera_turns(name):
    x, z = np.array([-0.4, 0.4, 0.0]), np.array([0.05, -0.05, 0.1])
    points = np.stack([x, np.zeros(3), z], axis=-1)
    found = seen(points, **{name: SMALL}) - seen(points)
    drawn = np.stack(signs.IMAGE_MOVES[name](x, z)) - np.stack([x, z])
    along = (found * drawn).sum() / np.linalg.norm(found) / np.linalg.norm(drawn)
    assert along > 0.99


@pytest.mark.parametrize("nose", signs.PITCHED_GLINT)
def test_the_drawn_glint_is_measured_nose_up(nose):
    ends = np.array(signs.PITCHED_GLINT[nose]) * 0.2
    setup = Setup.model_validate({"camera": CAMERA, "glint": {"nose": nose}})
    u, v = project(np.insert(ends, 1, 0.0, axis=1), camera=setup.camera)
    lines = np.interp(np.arange(752), u, v)
    rows = np.arange(240)[:, None]
    field = 10 + 150 * np.exp(-0.5 * ((rows - lines) / 1.4) ** 2)
    noise = np.random.default_rng(1).normal(0, 0.7, (6, *field.shape))
    fields = np.round(field + noise).astype(np.uint8)
    stack = FieldStack.from_array(fields, FieldInfo(rate_hz=60.0, interlaced=False))
    angles, _ = measure_stack(stack, setup, resolve_recording(stack, setup))
    drawn = np.degrees(np.arctan(0.25))
    assert np.degrees(angles.angle).mean() == pytest.approx(drawn, abs=0.5)


@pytest.mark.parametrize("nose", signs.PITCHED_GLINT)
def test_the_drawn_body_is_the_simulators_with_its_nose_up_and_yawed(nose):
    scene = replace(paper_scene(), nose=nose)
    ahead = np.eye(3) if nose == "right" else rotation_z(np.pi)
    up = np.array(signs.PITCHED_GLINT[nose])
    tip = up[0] if nose == "left" else up[1]
    pitched = rigid(ahead @ rotation_y(-np.arctan(0.25)), np.zeros(3))
    np.testing.assert_allclose(pitched[[0, 2], 0], tip / np.hypot(*tip), atol=1e-9)
    assert attitude(scene, pitched)[0] > 0

    drawn = np.array(signs.NOSE_IN_PLAN[nose])
    turn = np.arctan2(0.34, 0.94)
    yawed = rigid(rotation_z(turn) @ ahead, np.zeros(3))
    np.testing.assert_allclose(yawed[:2, 0], drawn / np.hypot(*drawn), atol=1e-9)
    assert attitude(scene, yawed)[1] == pytest.approx(turn)


def test_a_known_plane_of_positive_yaw_goes_where_the_drawn_body_lies():
    camera = Camera.model_validate(CAMERA)
    plane = PixelToPlane.of_camera(camera, y=0.0, yaw=np.arctan2(0.34, 0.94))
    right, left = (
        0.3 * np.array(signs.NOSE_IN_PLAN["right"]),
        0.3 * np.array(signs.NOSE_IN_PLAN["left"]),
    )
    for (x, y), sign in ((right, 1), (left, -1)):
        along, _ = plane(*project(np.array([x, y, 0.0]), camera=camera))
        assert along == pytest.approx(sign * 0.3 * np.hypot(0.94, 0.34), abs=1e-9)


def test_x_is_to_the_right_with_u_and_z_up_against_v():
    x, z = image_plane(
        np.array([0.0, 1.0]), np.array([0.0, 1.0]), principal_point=(0, 0), pixel_pitch=(1.0, 1.0)
    )
    assert x[1] > x[0]
    assert z[1] < z[0]


def test_odd_lines_lie_where_they_are_drawn():
    window = Recording(
        rate_hz=60.0,
        exposure_s=1e-3,
        first_line=0,
        first_column=0,
        first_parity=0,
        interlaced=True,
        start_s=0.0,
    )
    lines = window.line_of(np.tile(np.arange(3.0), (2, 1)), np.array([0, 1]))
    np.testing.assert_array_equal(lines, [signs.EVEN_LINES, signs.ODD_LINES])


@pytest.mark.parametrize("where", signs.SENSED)
def test_the_bias_has_the_drawn_sign(where):
    rho, bias = signs.SENSED[where]
    assert np.sign(bias_from_velocity(0.3, 0.5 * rho)) == bias
    # What the sensor feels along model x, forward, when it swings about the point
    time = np.linspace(0, 1, 20001)
    turn = 0.01 * np.sin(2 * np.pi * 10 * time)
    axis = np.stack([np.cos(turn), np.sin(turn)])
    acceleration = np.gradient(np.gradient(0.5 * rho * axis, time, axis=1), time, axis=1)
    felt = (acceleration * axis).sum(axis=0)[10:-10]
    assert felt.mean() == pytest.approx(-0.5 * rho * (0.01 * 2 * np.pi * 10) ** 2 / 2, rel=1e-3)
    assert np.sign(felt.mean()) == bias


def test_the_stored_pictures_are_those_that_are_drawn(tmp_path):
    for path in signs.draw_all(tmp_path):
        stored = Path(signs.__file__).with_name(path.name).read_text()
        words = [re.findall(r">([^<>\n]+)</text>", text) for text in (stored, path.read_text())]
        assert words[0] == words[1]
        assert "<dc:date>" not in stored
