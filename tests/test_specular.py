"""The glint's place on the body, against the law of reflection and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.geometry import Cylinder, glint_points
from glint_aoa.setup import Reflection
from render_sim.mirror import mirror_points
from render_sim.motion import StaticMotion
from render_sim.scene import Lamp, paper_scene

EYE = np.array([0.1, -1.4, 0.06])
PLACES = np.array([-0.25, -0.1, 0.0, 0.2])


def lit(lamp=(0.0, -0.6, 1.5), *, radius=0.06, axis_y=0.0, **more):
    metres = [f"{c} m" for c in lamp]
    return Reflection(radius=f"{radius} m", axis_y=f"{axis_y} m", lamp=metres, **more)


def body_of(reflection, rise=0.0, height=0.0, yaw=0.0):
    radius, axis_y = reflection.radius, reflection.axis_y
    return Cylinder.of_attitude(rise, height, yaw=yaw, axis_y=axis_y, radius=radius)


def at_stations(x):
    return np.tile([1.0, 0.0, 0.0], (len(x), 1)), np.array(x)


def radial(body, points):
    """Vectors from the axis to points, and the unit normals there."""
    away = points - body.origin
    away = away - (away @ body.axis)[..., None] * body.axis
    return away, away / np.linalg.norm(away, axis=-1, keepdims=True)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def miss_of_the_lamp(points, normals, eye, reflection):
    """Distance at which the mirrored views pass the lamp's line, and place along it."""
    view = unit(eye - points)
    ray = 2 * np.sum(normals * view, axis=-1, keepdims=True) * normals - view
    along = unit(np.array(reflection.lamp_direction))
    between = np.array(reflection.lamp) - points
    square = unit(np.cross(ray, along))
    plane = np.cross(ray, square)
    return np.abs(np.sum(between * square, axis=-1)), -np.sum(between * plane, -1) / (plane @ along)


def test_camera_and_lamp_at_one_distance_mirror_halfway_between():
    reflection = lit((0.0, 0.0, 1.5))
    eye = np.array([0.0, -1.5, 0.0])
    points = glint_points(body_of(reflection), *at_stations(PLACES), eye=eye, lamp=reflection)
    half = 0.06 * np.sqrt(0.5)
    expected = np.stack([PLACES, np.full(4, -half), np.full(4, half)], axis=-1)
    np.testing.assert_allclose(points, expected, atol=1e-15)


@pytest.mark.parametrize("shape", ["long", "small"])
def test_far_lamp_and_camera_make_a_glint_parallel_to_the_axis(shape):
    far = 1e7
    eye = np.array([0.3 * far, -far, 0.2 * far])
    reflection = lit((-0.2 * far, -0.5 * far, far), lamp_shape=shape)
    body = body_of(reflection, 0.08, 0.02, 0.03)
    points = glint_points(body, *at_stations(PLACES), eye=eye, lamp=reflection)
    away, _ = radial(body, points)
    np.testing.assert_allclose(away, np.broadcast_to(away[0], away.shape), atol=1e-8)


attitudes = st.tuples(
    st.floats(-0.2, 0.2), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.005, 0.12)
)
lamps = st.tuples(st.floats(-1, 1), st.floats(-1.2, 0.3), st.floats(0.6, 3))
directions = st.tuples(st.just(1.0), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))


@given(attitudes, lamps, directions)
def test_normal_bisects_the_directions_to_camera_and_long_lamp(attitude, lamp, direction):
    rise, height, yaw, radius = attitude
    reflection = lit(lamp, radius=radius, axis_y=0.01, lamp_direction=direction)
    body = body_of(reflection, rise, height, yaw)
    points = glint_points(body, *at_stations(PLACES), eye=EYE, lamp=reflection)
    away, normals = radial(body, points)
    np.testing.assert_allclose(np.linalg.norm(away, axis=-1), radius, atol=1e-13)
    np.testing.assert_allclose(points[:, 0], PLACES, atol=1e-13)
    assert (np.sum(normals * (EYE - points), axis=-1) > 0).all()
    np.testing.assert_allclose(
        miss_of_the_lamp(points, normals, EYE, reflection)[0], 0.0, atol=1e-10
    )


@given(attitudes, lamps)
def test_way_from_camera_to_small_lamp_is_the_shortest_round_the_body(attitude, lamp):
    rise, height, yaw, radius = attitude
    reflection = lit(lamp, radius=radius, lamp_shape="small")
    body = body_of(reflection, rise, height, yaw)
    point = glint_points(body, *at_stations(PLACES[:1]), eye=EYE, lamp=reflection)[0]
    away, normal = radial(body, point)
    foot = point - away
    tangent = np.cross(body.axis, normal)
    turns = np.linspace(-0.1, 0.1, 41)
    there = np.cos(turns)[:, None] * normal + np.sin(turns)[:, None] * tangent
    path = sum(
        np.linalg.norm(np.array(end) - foot - radius * there, axis=-1) for end in (EYE, lamp)
    )
    assert path.argmin() == 20


def test_small_lamp_is_the_place_of_a_long_one_that_is_mirrored_there():
    long = lit()
    body = body_of(long, -0.05)
    point = glint_points(body, *at_stations([-0.25]), eye=EYE, lamp=long)
    _, place = miss_of_the_lamp(point, radial(body, point)[1], EYE, long)
    there = lit((*place, -0.6, 1.5), lamp_shape="small")
    same = glint_points(body, *at_stations([-0.25]), eye=EYE, lamp=there)
    np.testing.assert_allclose(same, point, atol=1e-13)
    elsewhere = glint_points(body, *at_stations([-0.25]), eye=EYE, lamp=lit(lamp_shape="small"))
    assert np.linalg.norm(elsewhere - point) > 1e-4


@pytest.mark.parametrize(("pitch", "yaw"), [(0.0, 0.0), (5.0, 2.0), (-12.0, -3.0)])
def test_is_where_the_simulator_mirrors_the_lamp(pitch, yaw):
    scene = replace(paper_scene(), lamp=Lamp(centre_m=(0.3, -0.5, 1.3)))
    pose = StaticMotion(scene, np.radians(pitch), yaw_rad=np.radians(yaw), heave_m=0.01)
    columns = np.linspace(0, 751, 5)
    expected = mirror_points(scene, pose.pose(np.zeros(1)), columns)[0]
    eye = np.array(scene.camera.position)
    slant = (columns - 375.5) * 11.7e-6 / 35e-3
    normal = np.stack([np.ones(5), -slant, np.zeros(5)], axis=-1)
    reflection = lit((0.3, -0.5, 1.3))
    body = body_of(reflection, -np.radians(pitch), 0.01, np.radians(yaw))  # the nose is left
    points = glint_points(body, normal, normal @ eye, eye=eye, lamp=reflection)
    np.testing.assert_allclose(points, expected, atol=1e-12)


def test_many_attitudes_at_once_are_as_one_by_one():
    reflection = lit()
    rise, height = np.array([[0.0, 0.05], [-0.03, 0.1]]), np.array([[0.0, 0.01], [0.02, -0.04]])
    together = glint_points(
        body_of(reflection, rise, height), *at_stations(PLACES), eye=EYE, lamp=reflection
    )
    assert together.shape == (2, 2, 4, 3)
    for k in np.ndindex(2, 2):
        body = body_of(reflection, rise[k], height[k])
        alone = glint_points(body, *at_stations(PLACES), eye=EYE, lamp=reflection)
        np.testing.assert_allclose(together[k], alone, atol=1e-14)


@pytest.mark.parametrize("lamp", [(0.0, 0.0, 0.01), (0.0, 0.02, -0.03)])
def test_a_lamp_inside_the_body_is_not_mirrored(lamp):
    for shape in ("long", "small"):
        reflection = lit(lamp, lamp_shape=shape)
        points = glint_points(body_of(reflection), *at_stations([0.0]), eye=EYE, lamp=reflection)
        assert np.isnan(points).all()
