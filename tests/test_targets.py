"""Circular targets: found, measured without bias, with a covariance that holds."""

import re

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from independent_camera import Camera as IndependentCamera

from calibration.targets.find import ellipse_correction, find_targets
from glint_aoa.errors import CalibrationError
from glint_aoa.geometry import project
from glint_aoa.optical.noise import NoiseModel
from glint_aoa.setup import Camera
from render_sim.discs import paint
from render_sim.scene import Sensor
from render_sim.sensor import record

CAMERA = Camera.model_validate(
    {
        "focal_length": "35 mm",
        "pixel_pitch": ["11.7 um", "27.5 um"],
        "sensor": [752, 240],
        "position": ["0 m", "-56 in", "60 mm"],
    }
)


def ellipse(centre, semi_axes, angle=0.0, vertices=120):
    t = 2 * np.pi * np.arange(vertices) / vertices
    cos, sin = np.cos(angle), np.sin(angle)
    points = np.stack([semi_axes[0] * np.cos(t), semi_axes[1] * np.sin(t)], axis=1)
    return np.asarray(centre) + points @ np.array([[cos, sin], [-sin, cos]])


def at(outline, u, v):
    return outline + np.array([u, v])


def grid(rng, shape, spacing):
    """Centres at random phases of the pixels, shape (target, 2)."""
    u, v = np.meshgrid(
        np.arange(spacing[0] / 2, shape[1] - spacing[0] / 2 + 1, spacing[0]),
        np.arange(spacing[1] / 2, shape[0] - spacing[1] / 2 + 1, spacing[1]),
    )
    return np.stack([u.ravel(), v.ravel()], axis=1) + rng.uniform(-0.5, 0.5, (u.size, 2))


def errors(found, centres):
    """Measured less true centres, each target once; shape (target, 2)."""
    away = np.hypot(found.u[:, None] - centres[:, 0], found.v[:, None] - centres[:, 1])
    nearest = away.argmin(axis=1)
    assert sorted(nearest) == list(range(len(centres)))
    return np.stack([found.u, found.v], axis=1) - centres[nearest]


KINDS = {  # semi-axes, angle, blur, shape, spacing, bits
    "field": ((5.9, 2.5), 0.0, (1.0, 0.5), (120, 416), (32, 20), 8),
    "large in a field": ((28.0, 12.0), 0.1, (1.0, 0.5), (138, 480), (80, 46), 8),
    "small": ((2.5, 2.5), 0.0, (0.6, 0.6), (220, 264), (22, 22), 8),
    "oblique, 12 bits": ((10.0, 6.0), 0.6, (0.5, 0.5), (180, 320), (40, 36), 12),
    "large, 16 bits": ((30.0, 29.0), 1.2, (0.5, 0.5), (160, 320), (80, 80), 16),
}


@pytest.mark.parametrize("polarity", ["bright", "dark"])
@pytest.mark.parametrize("kind", KINDS)
def test_centroids_are_unbiased_and_their_covariance_holds(kind, polarity):
    semi_axes, angle, blur, shape, spacing, bits = KINDS[kind]
    rng = np.random.default_rng(5)
    top = (1 << bits) - 1
    sensor = Sensor(bits=bits, read_noise=0.7 * top / 255, black_level=0.04 * top)
    centres = grid(rng, shape, spacing)
    marks = paint([ellipse(c, semi_axes, angle) for c in centres], shape, blur=blur)
    marks = marks if polarity == "bright" else 1 - marks
    uneven = 1 + 0.3 * np.arange(shape[1]) / shape[1]
    image = record(top * (0.06 * uneven + 0.6 * marks), sensor, rng=rng)
    found = find_targets(image, polarity=polarity)
    off = errors(found, centres)
    assert np.all(np.abs(off.mean(axis=0)) < 0.002 + 3 * off.std(axis=0) / np.sqrt(len(off)))
    inverse = np.linalg.inv(found.covariance)
    chi_square = np.einsum("ni,nij,nj->n", off, inverse, off)
    # 2 degrees of freedom each; a mean of n of them has a standard deviation of 2 / sqrt(n)
    assert abs(chi_square.mean() - 2) < 0.4 + 6 / np.sqrt(len(off))
    assert not found.clipped.any()
    assert found.noise.source == "stack"
    expected = 0.6 * top if polarity == "bright" else -0.6 * top
    assert found.contrast == pytest.approx(np.full(len(off), expected), rel=0.06)
    assert found.semi_axes.mean(axis=0) == pytest.approx(semi_axes, abs=0.25)


HARD = {  # semi-axes, blur, spacing, where noise is not all: a mean of 16 fields has little
    "small and sharp": ((3.0, 3.0), (0.0, 0.0), (22, 22)),
    "near each other": ((6.0, 6.0), (0.6, 0.6), (15, 15)),
    "blurred as far as the window": ((11.9, 5.1), (1.8, 0.9), (50, 36)),
}


@pytest.mark.parametrize("fields", [1, 16])
@pytest.mark.parametrize("kind", HARD)
def test_the_scatter_of_rendered_discs_is_no_more_than_stated(kind, fields):
    """Errors over the phases of the pixels: sampling and what the window cuts off included."""
    semi_axes, blur, spacing = HARD[kind]
    rng, shape = np.random.default_rng(7), (180, 420)
    sensor = Sensor(read_noise=0.7, black_level=10)
    centres = grid(rng, shape, spacing)
    light = 15 + 150 * paint([ellipse(c, semi_axes) for c in centres], shape, blur=blur)
    image = np.mean([record(light, sensor, rng=rng) for _ in range(fields)], axis=0)
    found = find_targets(image)
    inside = np.all((centres > 17) & (centres < np.array(shape[::-1]) - 17), axis=1)
    centres = centres[inside]
    apart = np.hypot(found.u[:, None] - centres[:, 0], found.v[:, None] - centres[:, 1])
    found = found.take(apart.min(axis=1) < 1)
    white = errors(found, centres) / np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    scatter = np.sqrt(np.mean(white**2, axis=0))
    assert np.all(scatter < 1 + 2.5 / np.sqrt(2 * len(found)))
    assert np.all(scatter > 0.35)


@pytest.mark.parametrize("blur", [0.0, 0.3])
@pytest.mark.parametrize("semi_axes", [(2.5, 2.5), (5.9, 2.5), (6.1, 6.1)])
def test_no_centroid_is_drawn_to_whole_pixels(semi_axes, blur):
    """The phases of a pixel one by one, without noise: bias and locking below 0.01 pixel."""
    phases = np.stack(np.meshgrid(np.arange(8) / 8, np.arange(8) / 8), axis=-1).reshape(-1, 2)
    cells = np.stack(np.meshgrid(np.arange(8), np.arange(8)), axis=-1).reshape(-1, 2)
    centres = 20 + 32 * cells + phases
    marks = paint([ellipse(c, semi_axes) for c in centres], (280, 280), blur=(blur, blur))
    off = errors(find_targets(20 + 200 * marks), centres)
    assert np.abs(off).max() < 0.01


def test_only_ellipses_are_targets():
    """Squares, triangles, a bar, a ring, a board and what the edge cuts are none."""
    rng = np.random.default_rng(3)
    shape = (300, 400)
    square = np.array([[10.0, -10], [10, 10], [-10, 10], [-10, -10]])
    triangle = np.array([[0.0, -10], [9, 8], [-9, 8]])
    targets = [ellipse((60, 60), (2.6, 2.6)), ellipse((250, 70), (15, 15))]
    close = [ellipse((200, 200), (6, 6)), ellipse((214, 200), (6, 6))]
    others = [at(square, 340, 40), at(0.4 * square, 370, 40), at((5, 0.2) * square, 330, 250)]
    others += [at(triangle, 340, 150), at(0.5 * triangle, 370, 150)]
    others += [ellipse((300, 298), (6, 6)), ellipse((1, 120), (8, 8))]
    board = [
        at(0.7 * square, 40 + 14 * i, 180 + 14 * j) for i in range(6) for j in range(i % 2, 6, 2)
    ]
    light = paint([*targets, *close, *others, *board], shape, blur=(0.6, 0.6))
    ring = paint([ellipse((140, 60), (12, 12))], shape) - paint([ellipse((140, 60), (6, 6))], shape)
    image = record(100 * (light + ring) + np.linspace(20, 80, 400), Sensor(), rng=rng)
    found = find_targets(image)
    centres = np.array([[60, 60], [250, 70], [200, 200], [214, 200]])
    assert np.abs(errors(found, centres)).max() < 0.06
    assert [round(v) for v in found.v] == sorted(round(v) for v in found.v)


def test_an_image_without_targets_has_none():
    rng = np.random.default_rng(4)
    for image in (np.zeros((60, 80), np.uint8), rng.integers(0, 255, (60, 80), np.uint8)):
        found = find_targets(image)
        assert len(found) == 0
        assert found.covariance.shape == (0, 2, 2)


def test_size_and_contrast_are_limits():
    marks = paint([ellipse((40, 40), (8, 8)), ellipse((90, 40), (4, 4))], (80, 130))
    image = np.round(20 + 100 * marks).astype(np.uint8)
    assert sorted(find_targets(image).u) == pytest.approx([40, 90], abs=0.02)
    assert find_targets(image, min_diameter=12).u == pytest.approx([40], abs=0.02)
    assert find_targets(image, max_diameter=12).u == pytest.approx([90], abs=0.02)
    assert len(find_targets(image, min_contrast=500)) == 0
    assert len(find_targets(image, polarity="dark")) == 0


def test_clipped_targets_are_marked():
    marks = paint([ellipse((40, 40), (8, 8)), ellipse((90, 40), (8, 8))], (80, 130))
    image = np.round(20 + np.where(np.arange(130) < 65, 100, 600) * marks)
    clipped = np.minimum(image, 255).astype(np.uint8)
    found = find_targets(clipped)
    assert found.clipped[np.argsort(found.u)].tolist() == [False, True]
    in_twelve_bits = np.minimum(8 * image, 4095).astype(np.uint16)
    found = find_targets(in_twelve_bits)
    assert found.clipped[np.argsort(found.u)].tolist() == [False, True]
    mean = np.mean([clipped, np.maximum(clipped, 1)], axis=0)  # of two fields
    found = find_targets(mean)
    assert found.clipped[np.argsort(found.u)].tolist() == [False, True]
    assert not find_targets(image).clipped.any()
    assert find_targets(image, saturation=110).clipped.all()


def test_a_stated_noise_is_taken():
    rng = np.random.default_rng(6)
    marks = paint([ellipse((40, 40), (8, 8))], (80, 80), blur=(0.5, 0.5))
    image = record(100 * marks, Sensor(), rng=rng)
    one, four = (NoiseModel(each, 0.0, 0.0, 255.0) for each in (1.0, 4.0))
    covariance = find_targets(image, noise=one).covariance
    assert find_targets(image, noise=four).covariance == pytest.approx(4 * covariance)


def test_taking_some():
    marks = paint([ellipse((40, 40), (8, 8)), ellipse((90, 40), (4, 4))], (80, 130))
    found = find_targets(20 + 100 * marks)
    some = found.take([1])
    assert len(some) == 1
    assert some.semi_axes[0] == pytest.approx(found.semi_axes[1])
    assert len(found.take(found.u > 1000)) == 0


@pytest.mark.parametrize(
    ("image", "options", "message"),
    [
        (
            np.zeros((4, 5, 3)),
            {},
            "an image of shape [4, 5, 3] cannot be searched for targets; give one grey image "
            "[row, column] of 8 x 8 pixels or more",
        ),
        (
            np.full((20, 20), np.nan),
            {},
            "the image holds values that are not finite; give grey levels",
        ),
        (
            np.zeros((20, 20)),
            {"polarity": "white"},
            'polarity is \'white\'; give "bright" or "dark"',
        ),
        (
            np.zeros((20, 20)),
            {"min_diameter": 9, "max_diameter": 8},
            "targets of 9 to 8 pixels across cannot be measured; give min_diameter of 2 pixels "
            "or more, and max_diameter greater than it",
        ),
        (np.zeros((20, 20)), {"margin": 0.5}, "margin is 0.5; give 1 or more"),
        (np.zeros((20, 20)), {"max_axis_ratio": 0.5}, "max_axis_ratio is 0.5; give 1 or more"),
    ],
)
def test_refusals(image, options, message):
    with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
        find_targets(image, **options)


# --- perspective ----------------------------------------------------------------------------------


def disc_edge(centre, normal, radius, count=2000):
    """Points of a disc's edge in space, made by OpenCV's rotation of a circle about Z."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    axis = np.cross([0.0, 0.0, 1.0], normal)
    length = np.linalg.norm(axis)
    turn = np.arctan2(length, normal[2])
    rotation = cv2.Rodrigues(axis / length * turn if length > 0 else np.zeros(3))[0]
    t = 2 * np.pi * np.arange(count) / count
    return centre + radius * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1) @ rotation.T


def centroid_of_polygon(u, v):
    """Centroid of an area by Green's theorem."""
    u0, v0 = u.mean(), v.mean()
    u, v = u - u0, v - v0
    cross = u * np.roll(v, -1) - np.roll(u, -1) * v
    area = cross.sum() / 2
    return (
        u0 + ((u + np.roll(u, -1)) * cross).sum() / (6 * area),
        v0 + ((v + np.roll(v, -1)) * cross).sum() / (6 * area),
    )


angles = st.floats(-0.6, 0.6)


class TestEllipseCorrection:
    @given(
        x=st.floats(-0.15, 0.15),
        z=st.floats(-0.05, 0.15),
        tilt=st.tuples(angles, angles),
        radius=st.floats(0.001, 0.02),
        turn=st.tuples(angles, angles, angles),
    )
    def test_closed_form_is_the_numerical_projection(self, x, z, tilt, radius, turn):
        camera = CAMERA.model_copy(update={"rotation": tuple(0.1 * each for each in turn)})
        centre, normal = np.array([x, 0.0, z]), np.array([tilt[0], -1.0, tilt[1]])
        du, dv = ellipse_correction(centre, normal, radius, camera=camera)
        seen = centroid_of_polygon(*project(disc_edge(centre, normal, radius), camera=camera))
        true = project(centre, camera=camera)
        assert du[0] == pytest.approx(seen[0] - true[0], abs=1e-6)
        assert dv[0] == pytest.approx(seen[1] - true[1], abs=1e-6)

    @pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.1, 0.02, 1e-3, -1e-3, 0.0)])
    def test_against_an_independent_camera_with_distortion(self, distortion):
        ours = CAMERA.model_copy(
            update={"distortion": distortion, "rotation": tuple(np.radians([2.0, -1.0, 3.0]))}
        )
        theirs = IndependentCamera(distortion=distortion, rotation=(2.0, -1.0, 3.0))
        centres = np.array([[0.1, 0.0, 0.05], [-0.12, 0.05, 0.1], [0.02, -0.1, -0.02]])
        normals = np.array([[0.3, -1, 0.8], [-0.8, -1, 1.5], [0.0, -1, 0.0]])
        du, dv = ellipse_correction(centres, normals, 0.012, camera=ours)
        assert np.hypot(du, dv).max() > 0.04
        for k, (centre, normal) in enumerate(zip(centres, normals, strict=True)):
            seen = centroid_of_polygon(*theirs.pixels(disc_edge(centre, normal, 0.012)))
            true = np.concatenate(theirs.pixels(centre[None]))
            assert [du[k], dv[k]] == pytest.approx(np.array(seen) - true, abs=2e-5)

    def test_a_disc_parallel_to_the_sensor_needs_none(self):
        du, dv = ellipse_correction([0.1, 0.3, 0.05], [0, -2.0, 0], 0.01, camera=CAMERA)
        assert (du[0], dv[0]) == pytest.approx((0, 0), abs=1e-12)

    def test_it_takes_the_bias_out_of_a_rendered_disc(self):
        centre, normal, radius = np.array([0.08, 0.0, 0.1]), np.array([1.0, -1.0, 1.0]), 0.012
        outline = np.stack(project(disc_edge(centre, normal, radius, 360), camera=CAMERA), axis=1)
        found = find_targets(20 + 200 * paint([outline], (240, 752), blur=(1.0, 0.5)))
        du, dv = ellipse_correction(centre, normal, radius, camera=CAMERA)
        true = project(centre, camera=CAMERA)
        assert np.hypot(du[0], dv[0]) > 0.06
        assert (found.u[0] - du[0], found.v[0] - dv[0]) == pytest.approx(true, abs=0.005)

    def test_a_camera_without_a_place_is_refused(self):
        message = (
            "the camera has no place in the tunnel; give focal_length, pixel_pitch and position "
            "in [camera] to correct for perspective"
        )
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
            ellipse_correction([0, 0, 0], [0, 1, 0], 0.01, camera=Camera())
