"""Shapes of the fuselage, against the equations of their surfaces."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.errors import InputError
from render_sim.bodies import body_hits, cylinder_hits, facing_point, fuselage_mesh
from render_sim.mirror import glint_line, mirror_points
from render_sim.motion import StaticMotion
from render_sim.projection import Pinhole
from render_sim.raytrace import RaytraceRenderer
from render_sim.renderer import make_renderer
from render_sim.scene import Body, Lamp, Scene, paper_scene

COLUMNS = np.array([0.0, 200.0, 375.5, 751.0])
SQUARISH = Body(shape="superellipse", exponent=3.5, half_width_m=0.07, half_height_m=0.05)
CONE = Body(shape="cone-cylinder")


def still(scene: Scene, pitch_deg: float = 0.0, yaw_deg: float = 0.0) -> np.ndarray:
    motion = StaticMotion(scene, np.radians(pitch_deg), yaw_rad=np.radians(yaw_deg))
    return motion.pose(np.zeros(1))


def height(body: Body, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The superellipse's equation: 1 on it."""
    half_width, half_height = body.half_axes_m
    return np.abs(y / half_width) ** body.exponent + np.abs(z / half_height) ** body.exponent


def slope(body: Body, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Unit normal [..., 2], by differences of the equation."""
    d = 1e-7
    along_y = height(body, y + d, z) - height(body, y - d, z)
    along_z = height(body, y, z + d) - height(body, y, z - d)
    return np.stack([along_y, along_z], -1) / np.hypot(along_y, along_z)[..., None]


@given(
    angle=st.floats(-3.1, 3.1),
    exponent=st.floats(2, 6),
    half_width=st.floats(0.03, 0.1),
    half_height=st.floats(0.03, 0.1),
)
def test_facing_point_lies_farthest_out(angle, exponent, half_width, half_height):
    body = Body(
        shape="superellipse",
        exponent=exponent,
        half_width_m=half_width,
        half_height_m=half_height,
    )
    y, z = facing_point(body, np.asarray(angle))
    assert height(body, y, z) == pytest.approx(1.0, abs=1e-12)
    others = facing_point(body, angle + np.linspace(-np.pi, np.pi, 400))
    reach = np.sin(angle) * others[0] + np.cos(angle) * others[1]
    assert reach.max() <= np.sin(angle) * y + np.cos(angle) * z + 1e-15


def test_facing_point_of_an_ellipse():
    body = Body(shape="superellipse", exponent=2.0, half_width_m=0.08, half_height_m=0.05)
    angle = np.linspace(-3, 3, 13)
    support = np.hypot(0.08 * np.sin(angle), 0.05 * np.cos(angle))
    expected = 0.08**2 * np.sin(angle) / support, 0.05**2 * np.cos(angle) / support
    np.testing.assert_allclose(facing_point(body, angle), expected, atol=1e-15)


@pytest.mark.parametrize("exponent", [2.0, 2.5, 6.0])
def test_mesh_of_a_superellipse_lies_on_it(exponent):
    body = replace(SQUARISH, exponent=exponent)
    mesh = fuselage_mesh(body, sides=256)
    tube = mesh.vertices[:, 0] <= body.shoulder_station_m
    y, z = mesh.vertices[tube, 1:].T
    np.testing.assert_allclose(height(body, y, z), 1.0, atol=1e-12)
    normals = mesh.vertex_normals[tube]
    np.testing.assert_allclose(normals[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(normals[:, 1:], slope(body, y, z), atol=1e-5)
    outward = np.sum(mesh.face_normals * mesh.vertex_normals[mesh.faces[:, 0]], axis=1)
    assert outward.min() > 0.9
    # neighbours turn by little, on flats and round corners alike
    turn = np.degrees(np.arccos(np.clip(np.sum(normals[:-1] * normals[1:], -1), -1, 1)))
    assert turn[:255].max() < 4.0
    assert np.linalg.norm(np.diff(mesh.vertices[:256], axis=0), axis=1).max() < 4e-3


def test_nose_of_a_superellipse_faces_square_to_its_surface():
    mesh = fuselage_mesh(SQUARISH, sides=64)
    rings = mesh.vertices.reshape(-1, 64, 3)
    normals = mesh.vertex_normals.reshape(-1, 64, 3)
    middle = 50  # half way along the nose
    ahead, around = rings[middle + 1] - rings[middle - 1], np.roll(rings[middle], -1, 0)
    around = around - np.roll(rings[middle], 1, 0)
    for tangent, tolerance in ((ahead, 2e-3), (around, 0.1)):
        size = np.linalg.norm(tangent, axis=-1)
        assert np.abs(np.sum(tangent * normals[middle], -1) / size).max() < tolerance


def test_cone_meets_its_cylinder_with_a_kink():
    mesh = fuselage_mesh(CONE, sides=64)
    x, radius = mesh.vertices[:, 0], np.linalg.norm(mesh.vertices[:, 1:], axis=1)
    np.testing.assert_allclose(radius, np.minimum(0.06, 0.06 * (1.25 - x) / 0.25), atol=1e-15)
    leans = np.degrees(np.arcsin(mesh.vertex_normals[:, 0]))
    half_angle = np.degrees(np.arctan(0.06 / 0.25))
    np.testing.assert_allclose(leans[x > 1.0], half_angle)
    np.testing.assert_allclose(leans[x < 1.0], 0.0, atol=1e-12)
    assert sorted(np.unique(leans[x == 1.0].round(9))) == pytest.approx([0.0, half_angle])


def test_cone_and_ogive_look_alike_where_they_are_round():
    scene = paper_scene().with_window(120, 30)
    pose = still(scene, 2.0)
    ogive = make_renderer(scene).radiance(pose)
    assert np.array_equal(make_renderer(replace(scene, body=CONE)).radiance(pose), ogive)


def test_rays_meet_a_superellipse_on_its_surface():
    scene = replace(paper_scene(), body=SQUARISH)
    pose, eye = still(scene, 3.0, 1.0)[0], Pinhole.of(scene).centre_m
    rays = Pinhole.of(scene).directions(375.0, np.linspace(60.0, 220.0, 161))
    points, normals = body_hits(SQUARISH, pose, eye, rays)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    hit = np.isfinite(points[:, 0])
    assert 70 < hit.sum() < 120
    y, z = local[hit, 1:].T
    np.testing.assert_allclose(height(SQUARISH, y, z), 1.0, atol=1e-9)
    np.testing.assert_allclose((normals @ pose[:3, :3])[hit, 1:], slope(SQUARISH, y, z), atol=1e-5)
    assert np.all(np.sum(normals[hit] * (eye - points[hit]), axis=-1) > 0.0)  # the nearer point


def test_a_round_superellipse_is_a_cylinder():
    scene = paper_scene()
    round_one = replace(scene, body=Body(shape="superellipse", exponent=2.0))
    pose, rays = still(scene, 4.0, -0.5), Pinhole.of(scene).directions(10.0, [120.0, 140.0])
    eye = Pinhole.of(scene).centre_m
    for one, other in zip(
        body_hits(round_one.body, pose[0], eye, rays),
        cylinder_hits(0.06, pose[0], eye, rays),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, atol=1e-13)
    np.testing.assert_allclose(
        mirror_points(round_one, pose, COLUMNS), mirror_points(scene, pose, COLUMNS), atol=1e-12
    )
    np.testing.assert_allclose(glint_line(round_one, pose), glint_line(scene, pose), atol=1e-12)


@pytest.mark.parametrize("lamp_y", [-0.6, 0.0, -1.4])
@pytest.mark.parametrize(("pitch", "yaw"), [(0.0, 0.0), (6.0, 0.7), (-5.0, -2.0)])
@pytest.mark.parametrize("exponent", [2.0, 2.5, 6.0])
def test_normal_of_a_superellipse_bisects_the_directions_to_camera_and_lamp(
    exponent, pitch, yaw, lamp_y
):
    body = replace(SQUARISH, exponent=exponent)
    scene = replace(paper_scene(), body=body, lamp=Lamp(centre_m=(0.0, lamp_y, 1.5)))
    pose = still(scene, pitch, yaw)
    points = mirror_points(scene, pose, COLUMNS)[0]
    local = (points - pose[0, :3, 3]) @ pose[0, :3, :3]
    np.testing.assert_allclose(height(body, local[:, 1], local[:, 2]), 1.0, atol=1e-12)
    across = slope(body, local[:, 1], local[:, 2])
    normal = across @ pose[0, :3, 1:3].T
    view = Pinhole.of(scene).centre_m - points
    mirrored = 2 * np.sum(normal * view, 1, keepdims=True) * normal - view
    reached = points + mirrored * ((1.5 - points[:, 2]) / mirrored[:, 2])[:, None]
    np.testing.assert_allclose(reached[:, 1], lamp_y, atol=2e-5)  # the normal is by differences
    u, _ = Pinhole.of(scene).project(points)
    np.testing.assert_allclose(u, COLUMNS, atol=1e-9)


def test_a_lamp_inside_a_superellipse_is_refused():
    scene = replace(paper_scene(), body=SQUARISH, lamp=Lamp(centre_m=(0.0, 0.0, 0.01)))
    with pytest.raises(InputError, match=r"^the body does not mirror the lamp into every column"):
        mirror_points(scene, still(scene), COLUMNS)


def centres(image: np.ndarray) -> np.ndarray:
    rows = np.arange(image.shape[0], dtype=np.float64)[:, None]
    near = np.abs(rows - image.argmax(axis=0)) <= 7
    weights = (image - image[-5:].mean()) * near
    return (rows * weights).sum(axis=0) / weights.sum(axis=0)


@pytest.mark.parametrize("exponent", [2.0, 2.5, 4.0])
def test_fast_image_of_a_superellipse_is_the_brute_force_image(exponent):
    scene = replace(paper_scene(), body=replace(SQUARISH, exponent=exponent))
    scene = replace(scene.with_window(90, 110), sensor=replace(scene.sensor, columns=64, rows=110))
    renderer, pose = RaytraceRenderer(scene), still(scene, -5.0, 0.7)
    fast, slow = renderer.radiance(pose)[0], renderer.brute_force(pose, subsamples=12)[0]
    np.testing.assert_allclose(centres(fast), centres(slow), atol=1e-3, rtol=0)
    np.testing.assert_allclose(fast, slow, atol=0.7, rtol=0)
