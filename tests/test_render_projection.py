from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.errors import InputError
from render_sim.projection import Pinhole, distort, undistort, window_columns, window_lines
from render_sim.scene import Scene, paper_scene

LENS = (-0.21, 0.13, 1.1e-3, -0.7e-3, 0.05)


def scene_with(**changes) -> Scene:
    scene = paper_scene()
    return replace(scene, camera=scene.camera.model_copy(update=changes))


def test_agrees_with_opencv():
    rotation = (0.03, -0.02, 0.05)
    camera = Pinhole.of(scene_with(rotation=rotation, distortion=LENS))
    rng = np.random.default_rng(2)
    points = rng.uniform([-0.2, -0.1, -0.1], [0.2, 0.1, 0.2], size=(50, 3))
    to_cv = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) @ camera.rotation.T
    matrix = np.array([[camera.fx, 0, camera.u0], [0, camera.fy, camera.v0], [0, 0, 1]])
    expected, _ = cv2.projectPoints(
        points, cv2.Rodrigues(to_cv)[0], -to_cv @ camera.centre_m, matrix, np.array(LENS)
    )
    np.testing.assert_allclose(
        np.stack(camera.project(points), -1), expected[:, 0], atol=1e-8, rtol=0
    )


def test_pixels_are_not_square():
    camera = Pinhole.of(paper_scene())
    u, v = camera.project(np.array([[0.1, 0.0, 0.06], [0.0, 0.0, 0.16]]))
    depth = 56 * 0.0254
    assert u[0] - 375.5 == pytest.approx(0.1 / depth * 35e-3 / 11.7e-6)
    assert v[1] - 119.5 == pytest.approx(-0.1 / depth * 35e-3 / 27.5e-6)


@pytest.mark.parametrize(
    ("rotation", "direction"),
    [
        ((0.1, 0, 0), (0.0, np.cos(0.1), np.sin(0.1))),  # omega lifts the optical axis
        ((0, 0, 0.1), (-np.sin(0.1), np.cos(0.1), 0.0)),  # kappa turns it towards -X
        ((0, 0.1, 0), (0.0, 1.0, 0.0)),  # phi turns the image about it
    ],
)
def test_rotations_turn_the_optical_axis_as_stated(rotation, direction):
    camera = Pinhole.of(scene_with(rotation=rotation))
    np.testing.assert_allclose(camera.directions(375.5, 119.5), direction, atol=1e-15)


def test_positive_phi_lowers_the_right_side_of_the_image():
    right = Pinhole.of(scene_with(rotation=(0, 0.1, 0))).directions(600.0, 119.5)
    assert right[0] > 0
    assert right[2] < 0


@given(
    u=st.floats(0, 751),
    v=st.floats(0, 239),
    lens=st.tuples(*[st.floats(-s, s) for s in (0.3, 0.3, 1e-2, 1e-2, 0.1)]),
)
def test_ray_leads_back_to_its_pixel(u, v, lens):
    camera = Pinhole.of(scene_with(rotation=(0.02, 0.01, -0.03), distortion=lens))
    back = camera.project(camera.centre_m + 1.4 * camera.directions(u, v))
    np.testing.assert_allclose(back, (u, v), atol=1e-8, rtol=0)


def test_undistort_inverts_distort():
    lens = np.array(LENS)
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, 7), np.linspace(-0.2, 0.2, 7))
    np.testing.assert_allclose(undistort(*distort(x, y, lens), lens), (x, y), atol=1e-14)


def test_odd_lines_lie_half_a_line_lower():
    scene = paper_scene().with_window(126, 20)
    assert window_lines(scene)[[0, -1]].tolist() == [126.0, 145.0]
    assert window_lines(scene, parity=1)[0] == 126.5


def test_window_starts_at_first_column():
    scene = paper_scene()
    scene = replace(scene, fields=scene.fields.model_copy(update={"first_column": 40}))
    assert window_columns(scene)[[0, -1]].tolist() == [40.0, 791.0]


def test_principal_point_is_the_middle_of_the_sensor_by_default():
    camera = Pinhole.of(scene_with(principal_point=None, sensor=(640, 200)))
    assert (camera.u0, camera.v0) == (319.5, 99.5)


def test_a_camera_needs_a_place():
    with pytest.raises(InputError, match=r"^camera\.position is missing; a simulated camera"):
        Pinhole.of(scene_with(position=None))
