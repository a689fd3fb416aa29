import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.geometry import (
    PixelToPlane,
    distort,
    image_plane,
    intersect_known_plane,
    project,
    rotation_matrix,
    undistort,
)
from glint_aoa.setup import Camera

DISTORTION = (-0.21, 0.13, 0.0012, -0.0007, 0.02)
ANGLES = (0.031, -0.044, 0.052)


def camera(*, rotation=ANGLES, distortion=DISTORTION):
    return Camera(
        focal_length="35 mm",
        pixel_pitch=("11.7 um", "27.5 um"),
        sensor=(752, 240),
        principal_point=(370.25, 121.75),
        position=("12 mm", "-56 in", "60 mm"),
        rotation=tuple(f"{a} rad" for a in rotation),
        distortion=distortion,
    )


def in_opencv(cam):
    """Camera matrix, rotation vector and translation for OpenCV, whose camera has y down."""
    to_camera = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) @ rotation_matrix(*cam.rotation).T
    matrix = np.diag([cam.focal_length / p for p in cam.pixel_pitch] + [1.0])
    matrix[:2, 2] = cam.principal_point
    return matrix, cv2.Rodrigues(to_camera)[0], -to_camera @ np.array(cam.position)


def points(rng, n=50):
    return rng.uniform([-0.15, -0.1, -0.05], [0.15, 0.1, 0.1], (n, 3))


def test_projection_is_opencvs():
    cam, xyz = camera(), points(np.random.default_rng(1))
    matrix, rotation, translation = in_opencv(cam)
    expected, _ = cv2.projectPoints(xyz, rotation, translation, matrix, np.array(cam.distortion))
    np.testing.assert_allclose(np.stack(project(xyz, camera=cam), -1), expected[:, 0], atol=1e-9)


def test_undistortion_is_opencvs():
    cam = camera()
    matrix, _, _ = in_opencv(cam)
    rng = np.random.default_rng(2)
    pixels = rng.uniform([0, 0], [751, 239], (50, 2))
    expected = cv2.undistortPoints(
        pixels[:, None],
        matrix,
        np.array(cam.distortion),
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-14),
    )[:, 0]
    x, z = image_plane(*pixels.T, principal_point=cam.principal_point, pixel_pitch=cam.pixel_pitch)
    x, z = undistort(x, z, focal_length=cam.focal_length, distortion=cam.distortion)
    got = np.stack([x, -z], -1) / cam.focal_length
    np.testing.assert_allclose(got, expected, atol=1e-9)


@given(
    u=st.floats(0, 751),
    v=st.floats(0, 239.5),
    angles=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
    y=st.floats(-0.2, 0.2),
    yaw=st.floats(-0.2, 0.2),
)
def test_pixel_to_plane_and_back(u, v, angles, y, yaw):
    plane = PixelToPlane.of_camera(camera(rotation=angles), y=y, yaw=yaw)
    along, height = plane(u, v)
    again = plane.to_pixels(along, height)
    np.testing.assert_allclose(again, (u, v), atol=1e-9)


def test_a_ray_through_a_point_of_the_plane_finds_it():
    cam, rng = camera(), np.random.default_rng(3)
    xyz = points(rng)
    xyz[:, 1] = 0.03
    along, height = PixelToPlane.of_camera(cam, y=0.03, yaw=0.0)(*project(xyz, camera=cam))
    np.testing.assert_allclose(np.stack([along, height], -1), xyz[:, [0, 2]], atol=1e-12)


def test_the_heading_of_the_plane_turns_about_its_point_at_zero():
    yaw, y = np.radians(5), 0.02
    s, height = np.array([-0.1, 0.0, 0.1]), np.array([0.05, 0.06, 0.07])
    on_plane = np.stack([s * np.cos(yaw), y + s * np.sin(yaw), height], -1)
    cam = camera()
    got = PixelToPlane.of_camera(cam, y=y, yaw=yaw)(*project(on_plane, camera=cam))
    np.testing.assert_allclose(got, (s, height), atol=1e-12)


@pytest.mark.parametrize(
    ("angles", "axis", "expected"),
    [
        # A positive omega lifts the optical axis.
        ((0.1, 0, 0), (0, 1, 0), (0, np.cos(0.1), np.sin(0.1))),
        # A positive phi lowers the image's right side.
        ((0, 0.1, 0), (1, 0, 0), (np.cos(0.1), 0, -np.sin(0.1))),
        # A positive kappa turns the optical axis towards -X.
        ((0, 0, 0.1), (0, 1, 0), (-np.sin(0.1), np.cos(0.1), 0)),
    ],
)
def test_signs_of_the_rotation(angles, axis, expected):
    np.testing.assert_allclose(rotation_matrix(*angles) @ axis, expected, atol=1e-15)


def test_rotation_order_is_z_y_x():
    each = [rotation_matrix(*(a if i == j else 0 for j, a in enumerate(ANGLES))) for i in range(3)]
    np.testing.assert_allclose(rotation_matrix(*ANGLES), each[2] @ each[1] @ each[0], atol=1e-15)


def test_signs_of_the_image_plane():
    x, z = image_plane(
        [376.5], [118.5], principal_point=(375.5, 119.5), pixel_pitch=(11.7e-6, 27.5e-6)
    )
    assert x == pytest.approx(11.7e-6)
    assert z == pytest.approx(27.5e-6)  # a smaller line number is higher up


def test_a_ray_that_never_meets_the_plane_is_nan():
    along, height = intersect_known_plane((0, -1, 0), ([0.0], [-1.0], [0.0]), y=0)
    assert np.isnan(along).all()
    assert np.isnan(height).all()


@given(x=st.floats(-0.004, 0.004), z=st.floats(-0.0033, 0.0033))
def test_distortion_round_trip(x, z):
    there = distort(x, z, focal_length=0.035, distortion=DISTORTION)
    back = undistort(*there, focal_length=0.035, distortion=DISTORTION)
    np.testing.assert_allclose(back, (x, z), atol=1e-12)


def test_an_empty_camera_gives_pixels_about_the_windows_centre():
    plane = PixelToPlane.of_camera(Camera(), y=0.0, yaw=0.0, window=(319.5, 19.5))
    x, z = plane(np.array([320.5]), np.array([18.5]))
    assert (x[0], z[0]) == (1.0, 1.0)
