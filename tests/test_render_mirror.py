from dataclasses import replace

import numpy as np
import pytest

from glint_aoa.errors import InputError
from render_sim.mirror import glint_line, mirror_points
from render_sim.motion import StaticMotion
from render_sim.projection import Pinhole, window_columns
from render_sim.raytrace import RaytraceRenderer
from render_sim.scene import Lamp, Scene, paper_scene

COLUMNS = np.array([0.0, 200.0, 375.5, 751.0])


def still(scene: Scene, pitch_deg: float = 0.0, yaw_deg: float = 0.0) -> np.ndarray:
    motion = StaticMotion(scene, np.radians(pitch_deg), yaw_rad=np.radians(yaw_deg))
    return motion.pose(np.zeros(1))


def test_camera_and_lamp_at_one_distance_mirror_halfway_between():
    scene = paper_scene()
    camera = scene.camera.model_copy(update={"position": (0.0, -1.5, 0.0)})
    scene = replace(scene, camera=camera, lamp=Lamp(centre_m=(0.0, 0.0, 1.5)))
    points = mirror_points(scene, still(scene), COLUMNS)[0]
    half = 0.060 * np.sqrt(0.5)
    np.testing.assert_allclose(points[:, 1:], [[-half, half]] * 4, atol=1e-13)
    slant = (COLUMNS - 375.5) * 11.7e-6 / 35e-3
    np.testing.assert_allclose(points[:, 0], slant * (1.5 - half), atol=1e-13)


@pytest.mark.parametrize(("pitch", "yaw"), [(0.0, 0.0), (5.0, 0.0), (-6.0, 0.7), (4.3, -1.0)])
def test_normal_bisects_the_directions_to_camera_and_lamp(pitch, yaw):
    scene = paper_scene()
    pose = still(scene, pitch, yaw)
    points = mirror_points(scene, pose, COLUMNS)[0]
    eye = Pinhole.of(scene).centre_m
    radial = (points - pose[0, :3, 3]) @ pose[0, :3, :3] * [0, 1, 1]
    assert np.linalg.norm(radial, axis=1) == pytest.approx(scene.body.radius_m, abs=1e-13)
    normal = radial @ pose[0, :3, :3].T / scene.body.radius_m
    view = eye - points
    mirrored = 2 * np.sum(normal * view, 1, keepdims=True) * normal - view
    lamp = np.array(scene.lamp.centre_m)
    reached = points + mirrored * ((lamp[2] - points[:, 2]) / mirrored[:, 2])[:, None]
    np.testing.assert_allclose(reached[:, 1], lamp[1], atol=1e-11)


def test_points_lie_in_their_columns():
    scene = paper_scene()
    u, _ = Pinhole.of(scene).project(mirror_points(scene, still(scene, 6.0), COLUMNS))
    np.testing.assert_allclose(u[0], COLUMNS, atol=1e-9)


def test_glint_is_not_parallel_to_the_axis():
    scene = paper_scene()
    angle, _ = glint_line(scene, still(scene, 5.0))
    assert np.degrees(angle[0]) == pytest.approx(4.942, abs=5e-4)


def test_far_lamp_and_camera_see_the_axis_in_true_pitch():
    # with both at infinity the normal that bisects them stands still: the glint is a straight
    # line along the cylinder, and the camera looks square at the plane of pitch
    scene = paper_scene()
    camera = scene.camera.model_copy(
        update={"position": (0.0, -1e5, 0.0), "focal_length": 2.5e3, "principal_point": (375.5, 0)}
    )
    scene = replace(scene, camera=camera, lamp=Lamp(centre_m=(0.0, 0.0, 1e5)), glint_y_m=0.0)
    angle, _ = glint_line(scene, still(scene, 5.0))
    assert np.degrees(angle[0]) == pytest.approx(5.0, abs=1e-4)


@pytest.mark.parametrize("nose", ["left", "right"])
def test_angle_is_positive_with_the_nose_up(nose):
    scene = replace(paper_scene(), nose=nose)
    up, _ = glint_line(scene, still(scene, 3.0))
    down, _ = glint_line(scene, still(scene, -3.0))
    assert up == pytest.approx(-down, abs=1e-12)
    assert np.degrees(up[0]) == pytest.approx(2.965, abs=0.005)


def test_many_poses_at_once_agree_with_one_by_one():
    scene = paper_scene()
    poses = np.stack([still(scene, p, y)[0] for p, y in [(0, 0), (5, 0.5), (-3, -1)]])
    together = glint_line(scene, poses.reshape(3, 1, 4, 4))[0]
    alone = [glint_line(scene, pose)[0] for pose in poses]
    np.testing.assert_allclose(together[:, 0], alone, atol=1e-13)


def test_is_the_centre_of_a_narrow_rendered_glint():
    scene = paper_scene().with_window(110, 70)
    surface = replace(scene.surface, roughness=0.006, diffuse=0.0, ambient=0.0, wall=0.0)
    scene = replace(
        scene,
        lamp=replace(scene.lamp, width_m=1e-3),
        surface=surface,
        fields=scene.fields.model_copy(update={"first_column": 300, "first_line": 110}),
        sensor=replace(scene.sensor, columns=5, rows=70),
    )
    pose = still(scene, 5.0)
    image = RaytraceRenderer(scene).brute_force(pose, subsamples=64)[0]
    rows = np.arange(70.0)[:, None]
    centre = (image * rows).sum(axis=0) / image.sum(axis=0) + 110
    points = mirror_points(scene, pose, window_columns(scene))
    _, v = Pinhole.of(scene).project(points)
    np.testing.assert_allclose(centre, v[0], atol=2e-3)


def test_a_lamp_that_no_column_mirrors_is_refused():
    scene = replace(paper_scene(), lamp=Lamp(centre_m=(0.0, 0.0, 0.01)))
    with pytest.raises(InputError, match=r"^the body does not mirror the lamp into every column"):
        mirror_points(scene, still(scene), COLUMNS)
