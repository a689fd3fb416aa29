import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from trimesh.visual.material import PBRMaterial

from glint_aoa.errors import InputError, MissingLibraryError
from render_sim.bodies import fuselage_mesh
from render_sim.mirror import mirror_points
from render_sim.motion import StaticMotion
from render_sim.projection import Pinhole, window_columns, window_lines
from render_sim.raytrace import RaytraceRenderer
from render_sim.recorder import camera_turns
from render_sim.renderer import make_renderer
from render_sim.scene import Body, Lamp, Marking, Optics, Scene, Shake, Surface, paper_scene


def still(scene: Scene, pitch_deg: float = 0.0, yaw_deg: float = 0.0) -> np.ndarray:
    motion = StaticMotion(scene, np.radians(pitch_deg), yaw_rad=np.radians(yaw_deg))
    return motion.pose(np.zeros(1))


def opengl(scene: Scene):
    try:
        return make_renderer(scene, "pyrender")
    except MissingLibraryError as error:
        pytest.skip(str(error))


def centres(image: np.ndarray, like: np.ndarray | None = None) -> np.ndarray:
    rows = np.arange(image.shape[0], dtype=np.float64)[:, None]
    near = np.abs(rows - (image if like is None else like).argmax(axis=0)) <= 7
    weights = (image - image[-5:].mean()) * near
    return (rows * weights).sum(axis=0) / weights.sum(axis=0)


def angle_deg(centre: np.ndarray) -> float:
    slope = np.polyfit(np.arange(centre.size), centre, 1)[0]
    return float(np.degrees(np.arctan(slope * 27.5 / 11.7)))


@pytest.mark.parametrize(
    ("pitch", "yaw", "parity"),
    [(0.0, 0.0, 0), (6.0, 0.0, 1), (3.0, -1.0, 0), (-3.0, 0.0, 1), (-6.0, 0.7, 0)],
)
def test_both_renderers_show_the_same_glint(pitch, yaw, parity):
    scene = paper_scene()
    pose = still(scene, pitch, yaw)
    drawn = opengl(scene).radiance(pose, parity=parity)[0]
    traced = RaytraceRenderer(scene).radiance(pose, parity=parity)[0]
    centre = centres(drawn, traced)
    np.testing.assert_allclose(centre, centres(traced), atol=2e-3, rtol=0)
    assert angle_deg(centre) == pytest.approx(angle_deg(centres(traced)), abs=1e-4)
    np.testing.assert_allclose(drawn, traced, atol=0.6, rtol=0)


@pytest.mark.parametrize(
    "light",
    [
        {"surface": Surface(distribution="ggx", roughness=0.02)},
        {"other_lamps": (Lamp(centre_m=(0.1, -0.5, 0.9), length_m=0.05, aim_m=(0, 0, 0), beam=8),)},
        {"optics": Optics(blur_lines=0.3, defocus_m=40e-6, f_number=5.6)},
    ],
    ids=["GGX", "a spot", "defocus"],
)
def test_both_renderers_show_the_same_glint_in_other_light(light):
    scene = replace(paper_scene().with_window(114, 48), **light)
    pose = still(scene, 2.0)
    drawn, traced = opengl(scene).radiance(pose)[0], RaytraceRenderer(scene).radiance(pose)[0]
    centre = centres(drawn, traced)
    np.testing.assert_allclose(centre, centres(traced), atol=2e-3, rtol=0)
    assert angle_deg(centre) == pytest.approx(angle_deg(centres(traced)), abs=1e-4)


MARKINGS = (
    Marking(station_m=0.35, length_m=0.03, roughness=0.3, specular=0.04, diffuse=0.6),
    Marking(station_m=0.46, length_m=0.4e-3, specular=0.02, diffuse=0.02),
    Marking(azimuth_rad=1.5, width_m=0.01, roughness=0.3, specular=0.02, diffuse=0.02),
    Marking(0.52, 6e-3, 0.55, 6e-3, "ellipse", roughness=0.1, specular=0.3),
)


@pytest.mark.parametrize(
    ("body", "pitch", "yaw", "parity"),
    [
        (Body(), -6.0, 0.7, 0),
        (Body(shape="superellipse", exponent=3.0), 6.0, -0.5, 1),
    ],
)
def test_both_renderers_show_the_same_markings(body, pitch, yaw, parity):
    scene = replace(paper_scene(), body=replace(body, markings=MARKINGS))
    bare = replace(scene, body=body)
    pose = still(scene, pitch, yaw)
    drawn = opengl(scene).radiance(pose, parity=parity)[0]
    traced = RaytraceRenderer(scene).radiance(pose, parity=parity)[0]
    # the largest differences are where facets and fragments draw the body's own edge
    np.testing.assert_allclose(drawn, traced, atol=1.2, rtol=0)
    changed = np.abs(traced - RaytraceRenderer(bare).radiance(pose, parity=parity)[0])
    assert changed.max() > 100.0
    assert np.sqrt(np.mean((drawn - traced)[changed > 1.0] ** 2)) < 0.1
    near = np.abs(np.arange(92)[:, None] - traced.argmax(axis=0)) < 8
    crossed = np.where(near, changed, 0.0)
    lit = crossed.max(axis=0) < 0.1
    assert 400 < lit.sum() < 752
    np.testing.assert_allclose(centres(drawn, traced)[lit], centres(traced)[lit], atol=2e-3)
    columns = np.flatnonzero(lit)
    slopes = [np.polyfit(columns, centres(each, traced)[lit], 1)[0] for each in (drawn, traced)]
    assert np.degrees((slopes[0] - slopes[1]) * 27.5 / 11.7) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("pitch", [0.0, -6.0])
def test_a_narrow_glint_of_a_thin_lamp_is_the_mirror_line(pitch):
    # as of the built-in renderer; the mesh's facets move the glint by 0.0004 line
    scene = paper_scene()
    fields = scene.fields.model_copy(update={"first_column": 360})
    scene = replace(scene, fields=fields, sensor=replace(scene.sensor, columns=16))
    pose = still(scene, pitch)
    points = mirror_points(scene, pose, window_columns(scene))
    line = Pinhole.of(scene).project(points)[1][0] - window_lines(scene)[0]
    shifts = []
    for roughness in (0.02, 0.01):
        surface = Surface(roughness=roughness, diffuse=0.0, ambient=0.0, wall=0.0)
        thin = replace(scene, lamp=replace(scene.lamp, width_m=1e-4), surface=surface)
        image = opengl(thin).radiance(pose)[0]
        rows = np.arange(image.shape[0])[:, None]
        shifts.append((rows * image).sum(axis=0) / image.sum(axis=0) - line)
    np.testing.assert_allclose((4 * shifts[1] - shifts[0]) / 3, 0.0, atol=1e-3)


def test_a_cone_is_drawn_as_a_cone():
    scene = paper_scene().with_window(60, 130)
    ogive = replace(scene, view_station_m=1.1)
    cone = replace(ogive, body=Body(shape="cone-cylinder"))
    width = []
    for each in (ogive, cone):
        image = opengl(each).radiance(still(each))[0]
        width.append((image[:, 150] > 2 * image[0, 150]).sum())
    assert width[1] < 0.8 * width[0]


def test_parts_of_a_mesh_file_have_their_own_surfaces(tmp_path):
    stage = trimesh.Scene()
    for x, tone in ((0.0, 60), (0.5, 255)):
        part = trimesh.creation.box(extents=(0.4, 0.1, 0.1))
        material = PBRMaterial(baseColorFactor=[tone] * 3 + [255], metallicFactor=0.0)
        part.visual = trimesh.visual.TextureVisuals(material=material)
        place = trimesh.transformations.translation_matrix([x + 0.2, 0, 0])
        stage.add_geometry(part, transform=place)
    stage.export(tmp_path / "model.glb")
    scene = replace(paper_scene(), body=Body(mesh=tmp_path / "model.glb"))
    row = opengl(scene).radiance(still(scene))[0][80]
    # the nose is to the left: the farther part is the brighter one, by its albedo
    assert row[150] / row[600] == pytest.approx(255 / 60, rel=0.1)


def test_both_renderers_turn_the_camera_alike():
    scene = paper_scene()
    pose, turns = still(scene), camera_turns((Shake("roll", 0.01, 1.0, np.pi / 2),), np.zeros(1))
    drawn = opengl(scene).radiance(pose, turns=turns)[0]
    traced = RaytraceRenderer(scene).radiance(pose, turns=turns)[0]
    assert abs(angle_deg(centres(traced))) > 0.5
    np.testing.assert_allclose(centres(drawn), centres(traced), atol=2e-3, rtol=0)


def test_a_turned_camera_shows_the_same_glint():
    scene = paper_scene()
    turned = {"rotation": (0.01, -0.015, 0.02), "principal_point": (380.0, 100.0)}
    scene = replace(scene, camera=scene.camera.model_copy(update=turned)).with_window(90, 92)
    pose = still(scene, 2.0)
    drawn = opengl(scene).radiance(pose)[0]
    traced = RaytraceRenderer(scene).radiance(pose)[0]
    np.testing.assert_allclose(centres(drawn), centres(traced), atol=2e-3, rtol=0)


def test_a_mesh_file_is_drawn_as_the_same_body_built_in(tmp_path):
    path = tmp_path / "body.ply"
    fuselage_mesh(Body()).export(path)
    scene = paper_scene().with_window(126, 30)
    renderer = opengl(replace(scene, body=Body(mesh=path)))
    built_in = opengl(scene).radiance(still(scene, 1.0))
    np.testing.assert_allclose(renderer.radiance(still(scene, 1.0)), built_in, atol=0.05)


def test_several_renderers_live_side_by_side():
    scene = paper_scene().with_window(126, 20)
    first, second = opengl(scene), opengl(scene)
    before = first.radiance(still(scene))
    del second
    assert np.array_equal(first.radiance(still(scene)), before)


def test_distortion_is_refused():
    scene = paper_scene()
    camera = scene.camera.model_copy(update={"distortion": (0.1, 0, 0, 0, 0)})
    with pytest.raises(InputError, match=r"^the pyrender renderer cannot show camera\.distortion"):
        make_renderer(replace(scene, camera=camera), "pyrender")


def test_missing_opengl_libraries_are_named():
    program = """
import ctypes
load = ctypes.CDLL.__init__
def refuse(self, name, *args, **kwargs):
    if name and "GL" in str(name):
        raise OSError(f"{name}: cannot open shared object file")
    load(self, name, *args, **kwargs)
ctypes.CDLL.__init__ = refuse
from glint_aoa.errors import MissingLibraryError
from render_sim.renderer import make_renderer
from render_sim.scene import paper_scene
try:
    make_renderer(paper_scene(), "pyrender")
except MissingLibraryError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    expected = "the pyrender renderer needs OpenGL; install libegl1 and libgl1, or use raytrace"
    assert done.stdout.strip() == expected
