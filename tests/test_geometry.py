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


anywhere = {"u": st.floats(0, 751), "v": st.floats(0, 239.5)}
any_plane = {"y": st.floats(-0.2, 0.2), "yaw": st.floats(-0.2, 0.2)}
any_camera = {
    "angles": st.tuples(*[st.floats(-0.1, 0.1)] * 3),
    "lens": st.tuples(
        st.floats(-0.5, 0.5),
        st.floats(-0.5, 0.5),
        st.floats(-0.005, 0.005),
        st.floats(-0.005, 0.005),
        st.floats(-0.5, 0.5),
    ),
}


@given(seed=st.integers(0, 2**32 - 1), **any_camera)
def test_projection_is_opencvs(seed, angles, lens):
    cam, xyz = camera(rotation=angles, distortion=lens), points(np.random.default_rng(seed), 5)
    matrix, rotation, translation = in_opencv(cam)
    expected, _ = cv2.projectPoints(xyz, rotation, translation, matrix, np.array(lens))
    np.testing.assert_allclose(np.stack(project(xyz, camera=cam), -1), expected[:, 0], atol=1e-9)


def undistorted_by_opencv(u, v, cam):
    """Return normalised coordinates, to the right and down."""
    return cv2.undistortPoints(
        np.array([[[u, v]]]),
        in_opencv(cam)[0],
        np.array(cam.distortion),
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-14),
    )[0, 0]


@given(**anywhere, lens=any_camera["lens"])
def test_undistortion_is_opencvs(u, v, lens):
    cam = camera(distortion=lens)
    x, z = image_plane(u, v, principal_point=cam.principal_point, pixel_pitch=cam.pixel_pitch)
    x, z = undistort(x, z, focal_length=cam.focal_length, distortion=cam.distortion)
    got = np.array([x, -z]) / cam.focal_length
    np.testing.assert_allclose(got, undistorted_by_opencv(u, v, cam), atol=1e-9)


@given(**anywhere, **any_plane, **any_camera)
def test_collinearity_with_known_y_is_opencvs_ray_on_the_plane(u, v, y, yaw, angles, lens):
    """The ray that OpenCV's camera sees the pixel by, cut with the plane as linear equations."""
    cam = camera(rotation=angles, distortion=lens)
    _, rotation, translation = in_opencv(cam)
    x, down = undistorted_by_opencv(u, v, cam)
    to_camera = cv2.Rodrigues(rotation)[0]
    # camera coordinates t (x, down, 1) of the point (s cos, y + s sin, z): three equations
    unknown = np.stack(
        [to_camera @ (np.cos(yaw), np.sin(yaw), 0), to_camera[:, 2], (-x, -down, -1.0)], axis=1
    )
    s, z, _ = np.linalg.solve(unknown, -translation - to_camera @ (0, y, 0))
    got = PixelToPlane.of_camera(cam, y=y, yaw=yaw)(u, v)
    np.testing.assert_allclose(got, (s, z), atol=1e-9)


@given(**anywhere, **any_plane, **any_camera)
def test_pixel_to_plane_and_back(u, v, y, yaw, angles, lens):
    plane = PixelToPlane.of_camera(camera(rotation=angles, distortion=lens), y=y, yaw=yaw)
    np.testing.assert_allclose(plane.to_pixels(*plane(u, v)), (u, v), rtol=0, atol=1e-10)


@given(s=st.floats(-0.15, 0.15), z=st.floats(-0.05, 0.15), **any_plane, **any_camera)
def test_plane_to_pixel_and_back(s, z, y, yaw, angles, lens):
    plane = PixelToPlane.of_camera(camera(rotation=angles, distortion=lens), y=y, yaw=yaw)
    np.testing.assert_allclose(plane(*plane.to_pixels(s, z)), (s, z), rtol=0, atol=1e-10)


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
