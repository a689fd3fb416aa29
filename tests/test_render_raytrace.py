from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from glint_aoa.errors import InputError
from render_sim.bodies import cylinder_hits, fuselage_mesh
from render_sim.light import _distribution, lamp_samples, radiance, reflection
from render_sim.mirror import mirror_points
from render_sim.motion import StaticMotion
from render_sim.pixel import (
    Blur,
    edge_response,
    exposure_gain,
    integrate_lines,
    pixel_response,
)
from render_sim.projection import Pinhole, window_columns, window_lines
from render_sim.raytrace import RaytraceRenderer
from render_sim.renderer import make_renderer
from render_sim.scene import Body, Lamp, Optics, Scene, Surface, paper_scene

LENS = (-0.2, 0.1, 5e-4, -5e-4, 0.0)


def still(scene: Scene, pitch_deg: float = 0.0, yaw_deg: float = 0.0) -> np.ndarray:
    motion = StaticMotion(scene, np.radians(pitch_deg), yaw_rad=np.radians(yaw_deg))
    return motion.pose(np.zeros(1))


def small_scene(columns: int = 12) -> Scene:
    scene = paper_scene()
    fields = scene.fields.model_copy(update={"first_column": 370})
    return replace(scene, fields=fields, sensor=replace(scene.sensor, columns=columns))


def centres(image: np.ndarray, like: np.ndarray | None = None) -> np.ndarray:
    """Column centroids above the level of the window's end [lines]."""
    rows = np.arange(image.shape[0], dtype=np.float64)[:, None]
    near = np.abs(rows - (image if like is None else like).argmax(axis=0)) <= 7
    weights = (image - image[-5:].mean()) * near
    return (rows * weights).sum(axis=0) / weights.sum(axis=0)


@pytest.mark.parametrize(
    ("pitch", "yaw", "parity", "lens"),
    [
        (0.0, 0.0, 0, (0.0,) * 5),
        (5.0, 0.0, 1, (0.0,) * 5),
        (-6.0, 0.7, 0, (0.0,) * 5),
        (6.0, -3.0, 1, (0.0,) * 5),
        (-3.0, 3.0, 0, (0.0,) * 5),
        (4.3, 0, 0, LENS),
    ],
)
def test_fast_image_is_the_brute_force_image(pitch, yaw, parity, lens):
    scene = paper_scene()
    scene = replace(scene, camera=scene.camera.model_copy(update={"distortion": lens}))
    renderer = RaytraceRenderer(scene)
    pose = still(scene, pitch, yaw)
    fast = renderer.radiance(pose, parity=parity)[0]
    slow = renderer.brute_force(pose, parity=parity, subsamples=8)[0]
    np.testing.assert_allclose(centres(fast), centres(slow), atol=5e-4, rtol=0)
    # the largest differences are where the body's edge, grazed, is interpolated
    np.testing.assert_allclose(fast, slow, atol=0.5, rtol=0)
    assert np.sqrt(np.mean((fast - slow) ** 2)) < 0.05


OTHER_LIGHT = {
    "GGX": {"surface": Surface(distribution="ggx", roughness=0.02)},
    "a spot": {
        "other_lamps": (
            Lamp(centre_m=(0.1, -0.5, 0.9), length_m=0.05, aim_m=(0, 0, 0), beam=8, radiance=40),
        )
    },
    "two long lamps": {"other_lamps": (Lamp(centre_m=(0.0, -1.2, 1.2), radiance=0.4),)},
    "defocus": {"optics": Optics(blur_lines=0.3, defocus_m=40e-6, f_number=5.6)},
}


@pytest.mark.parametrize("light", OTHER_LIGHT.values(), ids=OTHER_LIGHT)
def test_fast_image_is_the_brute_force_image_in_other_light(light):
    scene = replace(paper_scene(), **light)
    renderer = RaytraceRenderer(scene)
    pose = still(scene, 2.0)
    fast, slow = renderer.radiance(pose)[0], renderer.brute_force(pose, subsamples=8)[0]
    np.testing.assert_allclose(centres(fast, slow), centres(slow), atol=1e-3, rtol=0)
    np.testing.assert_allclose(fast, slow, atol=0.6, rtol=0)


def test_another_lamp_need_not_be_mirrored():
    beneath = Lamp(centre_m=(0.0, 1.0, -1.0))  # it shines away from the body
    scene = replace(paper_scene(), other_lamps=(beneath,))
    alone = RaytraceRenderer(paper_scene()).radiance(still(scene))
    np.testing.assert_array_equal(RaytraceRenderer(scene).radiance(still(scene)), alone)


def test_a_lamp_that_grazes_the_body_is_refused():
    scene = replace(paper_scene(), other_lamps=(Lamp(centre_m=(0.0, 3.0, 0.3)),))
    with pytest.raises(InputError, match="mirrored at the very edge"):
        RaytraceRenderer(scene).radiance(still(scene))


def test_ggx_has_the_longer_tails():
    scene = paper_scene()
    other = replace(scene, surface=replace(scene.surface, distribution="ggx"))
    near, far = np.array([0.9995, 0.97])
    usual, tailed = (_distribution(np.array([near, far]), each.surface) for each in (scene, other))
    assert 0.5 < usual[0] / tailed[0] < 1.5
    assert tailed[1] > 100 * usual[1]


@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
def test_slopes_project_to_the_whole_surface(distribution):
    surface = Surface(distribution=distribution, roughness=0.3)

    def projected(angle):
        cosine = np.cos(angle)
        return 2 * np.pi * np.sin(angle) * cosine * _distribution(cosine**2, surface)

    whole, _ = quad(projected, 0, np.pi / 2)
    assert whole == pytest.approx(1.0, abs=1e-6)


def test_grazing_light_is_mirrored_by_anything():
    surface = replace(paper_scene().surface, specular=0.04, diffuse=0.0)
    lamp = Lamp(centre_m=(0.0, 1.0, 0.05), width_m=0.5, beam=0.0)
    dull = replace(paper_scene(), surface=surface, lamp=lamp)
    metal = replace(dull, surface=replace(surface, specular=0.96))
    seen = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    at_grazing, above = np.array([0.0, -1.0, 0.05]), np.array([0.0, -1.0, 1.0])
    over = replace(lamp, centre_m=(0.0, 1.0, 1.0))

    def ratio(eye, lamp):
        one, other = (replace(each, lamp=lamp) for each in (dull, metal))
        return float((radiance(one, *seen, eye) / radiance(other, *seen, eye))[0])

    # Schlick's reflectance at 87 degrees, and at 45
    assert ratio(at_grazing, lamp) == pytest.approx(0.78, abs=0.03)
    assert ratio(above, over) == pytest.approx((0.04 + 0.96 * 0.293**5) / 0.96, rel=0.02)


def test_a_spot_lights_where_it_aims():
    scene = paper_scene()
    spot = Lamp(centre_m=(0.0, 0.0, 1.0), length_m=0.02, width_m=0.02, aim_m=(1.0, 0, 0), beam=60)
    scene = replace(scene, lamp=spot, surface=replace(scene.surface, specular=0.0, ambient=0.0))
    places = np.zeros((3, 3))
    places[:, 0] = [0.0, 1.0, 2.0]
    up = np.broadcast_to([0.0, 0.0, 1.0], (3, 3))
    below, aimed, beyond = radiance(scene, places, up, np.array([0.0, -2.0, 1.0]))
    assert aimed > 1000 * below
    assert aimed > 5 * beyond


def test_brute_force_is_the_formula_of_light():
    scene = small_scene()
    pose = still(scene, 4.0, 0.5)
    camera = Pinhole.of(scene)
    margin = Blur.of(scene).margin
    lines = window_lines(scene)[0] - 0.5 - margin + (np.arange((92 + 2 * margin) * 4) + 0.5) / 4
    rays = camera.directions(window_columns(scene), lines[:, None])
    points, normals = cylinder_hits(scene.body.radius_m, pose[0], camera.centre_m, rays)
    hit = np.isfinite(points[..., 0])
    fine = np.full(hit.shape, scene.surface.wall)
    fine[hit] = radiance(scene, points[hit], normals[hit], camera.centre_m)
    expected = integrate_lines(fine, subsamples=4, blur=Blur.of(scene))
    image = RaytraceRenderer(scene).brute_force(pose, subsamples=4)[0]
    np.testing.assert_allclose(image, expected * exposure_gain(scene), atol=1e-5)


def test_lamp_samples_are_dense_enough():
    scene = small_scene()
    pose = still(scene, 3.0)
    camera = Pinhole.of(scene)
    rays = camera.directions(375.0, np.arange(120.0, 160.0))
    points, normals = cylinder_hits(0.06, pose[0], camera.centre_m, rays)
    _, usual = reflection(scene, points, normals, camera.centre_m)
    short = replace(scene.lamp, length_m=scene.lamp.length_m / 120)
    parts = []
    for n in range(120):  # pieces so short that each is one sample along its length
        x = scene.lamp.length_m * ((n + 0.5) / 120 - 0.5)
        piece = replace(short, centre_m=(x, *scene.lamp.centre_m[1:]))
        one = replace(scene, lamp=piece)
        parts.append(reflection(one, points, normals, camera.centre_m)[1])
    np.testing.assert_allclose(usual, np.sum(parts, axis=0), atol=5e-5 * usual.max())


def test_lamp_samples_add_up_to_the_lamp():
    scene = paper_scene()
    samples = lamp_samples(scene)
    lamp = scene.lamp
    assert samples[:, 3].sum() == pytest.approx(lamp.length_m * lamp.width_m * lamp.radiance)
    np.testing.assert_allclose(samples[:, :3].mean(axis=0), lamp.centre_m, atol=1e-12)


def test_reflection_of_a_large_lamp_is_the_mirror_reflectance():
    # a smooth surface that mirrors the middle of an even, endless lamp shows specular * radiance
    scene = paper_scene()
    scene = replace(
        scene,
        lamp=replace(scene.lamp, centre_m=(0.0, 0.0, 1.5), width_m=1.5),
        surface=replace(scene.surface, diffuse=0.0, roughness=0.02),
    )
    half = np.sqrt(0.5)
    level = radiance(
        scene,
        np.array([[0.0, 0.0, 0.0]]),
        np.array([[0.0, -half, half]]),
        np.array([0.0, -1.5, 0.0]),
    )
    assert level[0] == pytest.approx(scene.surface.specular, rel=0.01)


def test_odd_field_is_seen_half_a_line_lower():
    scene = small_scene()
    lifted = scene.camera.model_copy(update={"principal_point": (375.5, 119.0)})
    odd = RaytraceRenderer(scene).radiance(still(scene, 2.0), parity=1)
    even = RaytraceRenderer(replace(scene, camera=lifted)).radiance(still(scene, 2.0))
    np.testing.assert_allclose(odd, even, atol=1e-9)


@pytest.mark.parametrize(("pitch", "parity"), [(0.0, 0), (6.0, 1), (-6.0, 0)])
def test_a_narrow_glint_of_a_thin_lamp_is_the_mirror_line(pitch, parity):
    # roughness m shifts the centre by the square of m: the lobe's slope over its width
    scene = small_scene(64)
    pose = still(scene, pitch)
    _, mirrored = Pinhole.of(scene).project(mirror_points(scene, pose, window_columns(scene)))
    line = mirrored[0] - window_lines(scene, parity=parity)[0]
    shifts = []
    for roughness in (0.02, 0.01):
        surface = Surface(roughness=roughness, diffuse=0.0, ambient=0.0, wall=0.0)
        thin = replace(scene, lamp=replace(scene.lamp, width_m=1e-4), surface=surface)
        image = RaytraceRenderer(thin).radiance(pose, parity=parity)[0]
        rows = np.arange(image.shape[0])[:, None]
        shifts.append((rows * image).sum(axis=0) / image.sum(axis=0) - line)
    wide, narrow = shifts
    assert 0.005 < wide.mean() < 0.01
    np.testing.assert_allclose((4 * narrow - wide) / 3, 0.0, atol=1e-3)  # at zero roughness
    assert abs((4 * narrow - wide).mean() / 3) < 2e-4


def test_narrow_window_shows_part_of_the_wide_one():
    wide = paper_scene()
    narrow = wide.with_window(130, 20)
    pose = still(wide, 6.0)  # the glint leaves the narrow window at both ends
    part = RaytraceRenderer(wide).radiance(pose)[0, 32:52]
    np.testing.assert_allclose(RaytraceRenderer(narrow).radiance(pose)[0], part, atol=0.3)


def test_brightest_pixel_reaches_the_peak_level():
    scene = paper_scene()
    image = RaytraceRenderer(scene).radiance(still(scene))[0] + scene.sensor.black_level
    assert image.max() == pytest.approx(170.0, abs=4.0)  # as the line lies between the pixels
    assert 20 < image[60:].min() < image[60:].max() < 30


def test_glint_is_as_wide_as_in_the_paper():
    image = RaytraceRenderer(paper_scene()).radiance(still(paper_scene(), 5.0))[0][:, 375]
    peak = int(image.argmax())
    rows = np.arange(peak - 3, peak + 4)
    curvature = np.polyfit(rows - peak, np.log(image[rows] - 16.0), 2)[0]
    assert np.sqrt(-0.5 / curvature) == pytest.approx(1.4, abs=0.05)


def test_rendering_is_reproducible_to_the_bit():
    scene = small_scene()
    poses = np.concatenate([still(scene, 1.0), still(scene, 1.1)])
    first = RaytraceRenderer(scene).radiance(poses)
    assert np.array_equal(first, RaytraceRenderer(scene).radiance(poses))
    assert np.array_equal(first[1:], RaytraceRenderer(scene).radiance(poses[1:]))


@pytest.mark.parametrize("blur", [0.0, 0.3, 1.0])
def test_edge_response_is_the_integral_of_the_pixels(blur):
    for offset in (-1.3, -0.5, 0.0, 0.2, 2.0):
        lens = Blur(blur)
        area, _ = quad(pixel_response, -8.0, offset, args=(lens,), points=[-0.5, 0.5], limit=200)
        assert edge_response(offset, lens) == pytest.approx(area, abs=1e-7)


@pytest.mark.parametrize("radius", [0.4, 1.7])
def test_a_defocused_pixel_sees_a_disc(radius):
    def share(t):  # of a disc's light within `t` of its diameter
        x = np.clip(t / radius, -1, 1)
        return 0.5 + (x * np.sqrt(1 - x**2) + np.arcsin(x)) / np.pi

    offset = np.linspace(-3, 3, 61)
    response = pixel_response(offset, Blur(disc=radius))
    np.testing.assert_allclose(response, share(offset + 0.5) - share(offset - 0.5), atol=2e-3)
    assert edge_response(0.0, Blur(0.3, disc=radius)) == pytest.approx(0.5, abs=1e-6)


def test_diffraction_is_that_of_a_circular_pupil():
    lens = Blur(cutoff=4.0)

    def spectrum(frequency, offset):
        s = frequency / 4.0
        transfer = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s**2))
        return 2 * transfer * np.sinc(frequency) * np.cos(2 * np.pi * frequency * offset)

    for offset in (0.0, 0.3, 0.5, 1.0, 2.2):
        expected, _ = quad(spectrum, 0, 4, args=(offset,), limit=200)
        assert pixel_response(offset, lens) == pytest.approx(expected, abs=5e-4)


def test_blurs_add_as_their_variances():
    offset = np.linspace(-6, 6, 2401)
    both = pixel_response(offset, Blur(0.5, disc=0.8))
    variance = np.trapezoid(offset**2 * both, offset)
    assert variance == pytest.approx(1 / 12 + 0.25 + 0.8**2 / 4, rel=1e-3)
    gaussian = pixel_response(offset, Blur(0.5))
    np.testing.assert_allclose(pixel_response(offset, Blur(0.5, disc=1e-9)), gaussian, atol=1e-4)


def test_integrating_an_even_image_changes_nothing():
    margin = Blur(0.5).margin
    fine = np.full(((4 + 2 * margin) * 8, 3), 7.0)
    np.testing.assert_allclose(
        integrate_lines(fine, subsamples=8, blur=Blur(0.5)), np.full((4, 3), 7.0)
    )


def test_fuselage_is_a_tube_with_an_ogive_nose():
    body = Body()
    mesh = fuselage_mesh(body, sides=64)
    assert mesh.bounds[:, 0] == pytest.approx([body.base_station_m, body.nose_station_m], abs=1e-6)
    tube = mesh.vertices[:, 0] <= body.shoulder_station_m
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices[tube, 1:], axis=1), 0.06)
    np.testing.assert_allclose(mesh.vertex_normals[tube, 0], 0.0, atol=1e-12)
    outward = np.sum(mesh.face_normals * mesh.vertex_normals[mesh.faces[:, 0]], axis=1)
    assert outward.min() > 0.9


def test_mesh_needs_the_other_renderer():
    scene = replace(paper_scene(), body=Body(mesh=Path("body.stl")))
    with pytest.raises(InputError, match=r"^the built-in renderer shows no mesh file; use"):
        make_renderer(scene, "raytrace")


def test_cylinder_that_ends_in_the_window_is_refused():
    scene = replace(paper_scene(), body=Body(shoulder_station_m=0.5))
    with pytest.raises(InputError, match=r"^the cylinder ends within the window"):
        make_renderer(scene).radiance(still(scene))


def test_unknown_renderer_is_refused():
    with pytest.raises(InputError, match=r"^unknown renderer 'blender'; choose auto, raytrace or"):
        make_renderer(paper_scene(), "blender")
