"""Stripes, joints and screws: where they are seen, and how much of a pixel they fill."""

import re
from dataclasses import replace

import numpy as np
import pytest

from glint_aoa.errors import SetupError
from render_sim.bodies import facing_point
from render_sim.markings import column_blur, extents
from render_sim.mirror import mirror_points
from render_sim.motion import StaticMotion
from render_sim.projection import Pinhole, window_columns, window_lines
from render_sim.raytrace import RaytraceRenderer
from render_sim.scene import Body, Lamp, Marking, Optics, Scene, Surface, load_scene, paper_scene

DULL = {"roughness": 0.3, "specular": 0.02, "diffuse": 0.02}
WHITE = {"roughness": 0.3, "specular": 0.04, "diffuse": 0.6}
JOINT = Marking(station_m=0.45, length_m=0.4e-3, **DULL)
STRIPE = Marking(station_m=0.45, length_m=6e-3, **WHITE)
SCREW = Marking(
    station_m=0.45,
    azimuth_rad=np.radians(52),
    length_m=4e-3,
    width_m=5e-3,
    outline="ellipse",
    roughness=0.1,
    specular=0.3,
)
ALONG = Marking(azimuth_rad=np.radians(75), width_m=12e-3, **WHITE)


def marked(*markings: Marking, columns: int = 32, first_column: int = 360, **changes) -> Scene:
    scene = paper_scene()
    return replace(
        scene,
        body=replace(scene.body, markings=markings),
        fields=scene.fields.model_copy(update={"first_column": first_column}),
        sensor=replace(scene.sensor, columns=columns),
        **changes,
    )


def differences(
    scene: Scene, pose: np.ndarray, *, parity: int = 0, subsamples: int = 20
) -> np.ndarray:
    """Fast less brute force in a window about the glint and the station 0.45 m [grey levels]."""
    u, v = seen_at(scene, 0.45, np.radians(54), pose)
    fields = scene.fields.model_copy(update={"first_column": int(u) - 5})
    near = replace(scene, fields=fields, sensor=replace(scene.sensor, columns=10))
    renderer = RaytraceRenderer(near.with_window(int(v) - 12, 24))
    slow = renderer.brute_force(pose, parity=parity, subsamples=subsamples)
    return np.asarray(renderer.radiance(pose, parity=parity) - slow)


def still(scene: Scene, pitch_deg: float = 0.0, yaw_deg: float = 0.0) -> np.ndarray:
    motion = StaticMotion(scene, np.radians(pitch_deg), yaw_rad=np.radians(yaw_deg))
    return motion.pose(np.zeros(1))


def seen_at(scene: Scene, station: float, azimuth: float, pose: np.ndarray) -> tuple[float, float]:
    """Column and line of a point of the body."""
    y, z = facing_point(scene.body, np.asarray(azimuth))
    point = pose[0, :3, :3] @ [station, y, z] + pose[0, :3, 3]
    u, v = Pinhole.of(scene).project(point)
    return float(u), float(v)


def darkening(scene: Scene, pose: np.ndarray) -> np.ndarray:
    """Light that the markings take away [line, column]."""
    bare = replace(scene, body=replace(scene.body, markings=()))
    dense = replace(bare, surface=replace(scene.surface))
    return (RaytraceRenderer(dense).radiance(pose) - RaytraceRenderer(scene).radiance(pose))[0]


@pytest.mark.parametrize(
    ("pitch", "yaw", "parity"), [(0.7, 0.3, 0), (5.5, -1.0, 1), (-6.0, 0.7, 0)]
)
@pytest.mark.parametrize(
    "markings", [(JOINT,), (STRIPE, SCREW), (ALONG,)], ids=["joint", "stripe, screw", "along"]
)
def test_fast_image_is_the_brute_force_image(markings, pitch, yaw, parity):
    scene = marked(*markings)
    fine = 40 if markings == (JOINT,) else 20  # rays must resolve a column's part
    apart = differences(scene, still(scene, pitch, yaw), parity=parity, subsamples=fine)
    assert np.abs(apart).max() < 0.35
    assert np.sqrt(np.mean(apart**2)) < 0.07


@pytest.mark.parametrize(
    "light",
    [
        {"surface": Surface(distribution="ggx", roughness=0.03)},
        {"optics": Optics(blur_lines=0.3, defocus_m=30e-6, f_number=5.6)},
        {"other_lamps": (Lamp(centre_m=(0.0, -1.2, 1.2), radiance=0.4),)},
        {"optics": Optics(blur_lines=0.2)},
    ],
    ids=["GGX", "defocus", "two lamps", "sharp"],
)
def test_fast_image_is_the_brute_force_image_in_other_light(light):
    scene = marked(STRIPE, SCREW, **light)
    assert np.abs(differences(scene, still(scene, 2.0))).max() < 0.35


def test_fast_image_is_the_brute_force_image_on_a_superellipse():
    scene = marked(STRIPE, SCREW)
    body = replace(scene.body, shape="superellipse", exponent=3.0, half_height_m=0.05)
    scene = replace(scene, body=body)
    assert np.abs(differences(scene, still(scene, 3.0))).max() < 0.35


def test_columns_away_from_a_marking_keep_their_light():
    scene = marked(STRIPE, columns=80, first_column=330)
    away = np.abs(darkening(scene, still(scene, 4.0))).max(axis=0)
    changed = np.flatnonzero(away > 1e-6)
    reach = column_blur(scene).margin
    edges = [
        seen_at(scene, STRIPE.station_m + side * 3e-3, azimuth, still(scene, 4.0))[0]
        for side in (-1.0, 1.0)
        for azimuth in np.linspace(-0.2, 1.7, 40)
    ]
    assert changed.min() + 330 >= min(edges) - reach - 1
    assert changed.max() + 330 <= max(edges) + reach + 1
    assert changed.size < 60


def test_a_joint_takes_its_own_width_of_light():
    matte = {"roughness": None, "specular": 0.0, "diffuse": 0.0}
    joint = Marking(station_m=0.45, length_m=0.25e-3, **matte)
    scene = marked(joint)
    pose = still(scene)
    bare = RaytraceRenderer(marked()).radiance(pose)[0]
    line = int(bare[:, 16].argmax())
    lost = (darkening(scene, pose) / bare)[line].sum()
    point = mirror_points(scene, pose, np.array([375.5]))[0, 0]
    columns = 0.25e-3 * Pinhole.of(scene).fx / (point[1] - scene.camera.position[1])
    assert lost == pytest.approx(columns, rel=0.01)


@pytest.mark.parametrize("pitch", [-5.0, 0.0, 6.0])
def test_a_joint_is_seen_where_it_crosses_the_glint(pitch):
    dark = Surface(diffuse=0.0, ambient=0.0, wall=0.0)
    scene = marked(replace(JOINT, diffuse=0.0, specular=0.0), surface=dark)
    pose = still(scene, pitch)
    u = window_columns(scene)
    points = mirror_points(scene, pose, u)[0]
    stations = (points - pose[0, :3, 3]) @ pose[0, :3, 0]
    expected = np.interp(-JOINT.station_m, -stations, u)  # the nose is to the left
    lost = darkening(scene, pose).sum(axis=0)
    assert (lost * u).sum() / lost.sum() == pytest.approx(expected, abs=0.02)


def test_a_stripe_along_the_body_ends_at_its_azimuths():
    scene = marked(ALONG, columns=8, first_column=372)
    pose = still(scene)
    gained = -darkening(scene, pose)[:, 4]
    lines = window_lines(scene)
    half = ALONG.width_m / 2 / scene.body.radius_m
    edges = [seen_at(scene, 0.45, ALONG.azimuth_rad + side * half, pose)[1] for side in (-1.0, 1.0)]
    assert gained.max() > 10.0
    inner = np.abs(lines - np.mean(edges)) < 3
    height = np.polyval(np.polyfit(lines[inner], gained[inner], 1), np.mean(edges))
    assert gained.sum() / height == pytest.approx(edges[1] - edges[0], abs=0.1)
    rising = np.abs(lines - edges[0]) < 3
    assert np.interp(0.5 * height, gained[rising], lines[rising]) == pytest.approx(
        edges[0], abs=0.1
    )


def test_a_screw_takes_the_area_of_its_ellipse():
    dark = {"roughness": None, "specular": 0.0, "diffuse": 0.0}
    where = {"station_m": 0.45, "azimuth_rad": np.radians(75), "length_m": 4e-3, "width_m": 5e-3}
    pose = still(paper_scene())
    screw = darkening(marked(Marking(outline="ellipse", **where, **dark)), pose).sum()
    plate = darkening(marked(Marking(**where, **dark)), pose).sum()
    assert screw / plate == pytest.approx(np.pi / 4, rel=2e-3)


def test_a_marking_like_the_body_changes_nothing():
    surface = paper_scene().surface
    same = Marking(0.45, 5e-3, specular=surface.specular, diffuse=surface.diffuse)
    assert np.abs(darkening(marked(same), still(paper_scene(), 3.0))).max() < 1e-9


def test_a_marking_out_of_sight_changes_nothing():
    for away in (Marking(0.8, 5e-3), replace(SCREW, azimuth_rad=np.radians(-110))):
        assert np.all(darkening(marked(away), still(paper_scene(), 3.0)) == 0.0)


def test_later_markings_cover_earlier_ones():
    pose = still(paper_scene(), 2.0)
    above, alone, below = (
        RaytraceRenderer(marked(*each)).radiance(pose)
        for each in ((JOINT, STRIPE), (STRIPE,), (STRIPE, JOINT))
    )
    np.testing.assert_allclose(above, alone, atol=1e-9)
    assert np.abs(below - alone).max() > 3.0


@pytest.mark.parametrize(("nose", "side"), [("left", 1.0), ("right", -1.0)])
def test_azimuth_grows_towards_model_y(nose, side):
    # with the nose to the left, model y points to the camera
    pose = still(replace(paper_scene(), nose=nose))
    for sign in (-1.0, 1.0):
        screw = replace(SCREW, azimuth_rad=sign * np.radians(60))
        changed = np.abs(darkening(marked(screw, nose=nose), pose)).max()
        assert (changed > 0.3) == (sign == side)


def test_extents_are_halved_and_turned_to_angles():
    scene = marked(JOINT, SCREW, JOINT)
    station, half, azimuth, turn, is_ellipse, surface = extents(scene).T
    np.testing.assert_allclose(station, 0.45)
    np.testing.assert_allclose(half, [0.2e-3, 2e-3, 0.2e-3])
    np.testing.assert_allclose(azimuth, [0.0, np.radians(52), 0.0])
    np.testing.assert_allclose(turn, [1e6, 2.5e-3 / 0.06, 1e6])
    assert is_ellipse.tolist() == [0, 1, 0]
    assert surface.tolist() == [1, 2, 1]
    assert len(scene.surfaces) == 3
    flat = replace(scene.body, shape="superellipse", half_width_m=0.1, half_height_m=0.05)
    side = replace(SCREW, azimuth_rad=np.radians(90))
    squat = replace(scene, body=replace(flat, markings=(side,)))
    assert extents(squat)[0, 3] == pytest.approx(2.5e-3 / 0.1)


CAMERA = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
position = ["0 m", "-1.4 m", "60 mm"]
"""


def test_markings_stand_in_the_scene_file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(
        CAMERA
        + '[fields]\n[[body.marking]]\nstation = "0.5 m"\nlength = "0.4 mm"\ndiffuse = 0.02\n'
        '[[body.marking]]\nazimuth = "90 deg"\nwidth = "1 in"\n'
    )
    joint, stripe = load_scene(path).body.markings
    assert joint == Marking(station_m=0.5, length_m=pytest.approx(0.4e-3), diffuse=0.02)
    assert (stripe.azimuth_rad, stripe.width_m) == pytest.approx((np.pi / 2, 0.0254))
    assert joint.surface_on(Surface()) == Surface(diffuse=0.02)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            'outline = "ellipse"\nlength = "5 mm"\n',
            "body.marking[0]: an ellipse needs both length and width",
        ),
        ('lenght = "5 mm"\n', "unknown key body.marking[0].lenght; did you mean length?"),
        ('width = "-1 mm"\n', "body.marking[0].width: -0.001 must be greater than zero"),
    ],
)
def test_a_wrong_marking_is_named(tmp_path, text, message):
    path = tmp_path / "scene.toml"
    path.write_text(CAMERA + "[fields]\n[[body.marking]]\n" + text)
    with pytest.raises(SetupError, match=f"^{re.escape(f'{path}: {message}')}$"):
        load_scene(path)


def test_a_body_has_no_markings_unless_stated():
    assert Body().markings == ()
    assert paper_scene().surfaces == (paper_scene().surface,)
