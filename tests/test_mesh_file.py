"""Mesh files: their parts, normals, units and materials."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.visual.material import PBRMaterial

from glint_aoa.errors import InputError
from render_sim.bodies import fuselage_mesh
from render_sim.mesh_file import read_mesh, surface_of
from render_sim.scene import Body, Surface

SURFACE = Surface()


def saved(path: Path, mesh=None) -> Body:
    (mesh or fuselage_mesh(Body(), sides=128)).export(path)
    return Body(mesh=path)


def only(body: Body) -> trimesh.Trimesh:
    ((mesh, surface),) = read_mesh(body, SURFACE)
    assert surface == SURFACE
    return mesh


@pytest.mark.parametrize("kind", ["stl", "obj", "glb", "ply"])
def test_every_kind_of_file_is_read_in_the_model_frame(tmp_path, kind):
    mesh = only(saved(tmp_path / f"body.{kind}"))
    np.testing.assert_allclose(mesh.bounds, fuselage_mesh(Body()).bounds, atol=1e-5)


@pytest.mark.parametrize("kind", ["stl", "obj", "glb", "ply"])
def test_normals_are_smooth(tmp_path, kind):
    mesh = only(saved(tmp_path / f"body.{kind}"))
    tube = np.abs(mesh.vertices[:, 0] - 0.3) < 0.6
    radial = mesh.vertices[tube] * [0, 1, 1] / 0.06
    assert tube.sum() > 1000
    np.testing.assert_allclose(mesh.vertex_normals[tube], radial, atol=2e-3)


def test_an_stl_file_keeps_its_sharp_edges(tmp_path):
    box = trimesh.creation.box(extents=(1.0, 0.2, 0.1))
    mesh = only(saved(tmp_path / "box.stl", box))
    np.testing.assert_allclose(np.abs(mesh.vertex_normals).max(axis=1), 1.0, atol=1e-12)
    assert len(mesh.vertices) == 24


def test_a_file_may_be_in_millimetres(tmp_path):
    large = fuselage_mesh(Body(), sides=64)
    large.apply_scale(1000.0)
    body = saved(tmp_path / "body.stl", large)
    mesh = only(replace(body, mesh_unit_m=1e-3))
    np.testing.assert_allclose(mesh.bounds, fuselage_mesh(Body()).bounds, atol=1e-5)
    message = f'{body.mesh}: the mesh is 1700 m long; state its unit, e.g. body.mesh_unit = "1 mm"'
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        read_mesh(body, SURFACE)


def test_each_part_of_a_glb_file_has_its_own_material(tmp_path):
    scene = trimesh.Scene()
    for x, material in (
        (0.0, PBRMaterial(baseColorFactor=[204, 204, 204, 255], metallicFactor=1.0)),
        (1.0, PBRMaterial(roughnessFactor=0.5, metallicFactor=0.0)),
    ):
        part = trimesh.creation.box(extents=(0.5, 0.1, 0.1))
        part.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(part, transform=trimesh.transformations.translation_matrix([x, 0, 0]))
    scene.export(tmp_path / "model.glb")
    parts = read_mesh(Body(mesh=tmp_path / "model.glb"), SURFACE)
    metal, dull = (surface for _, surface in sorted(parts, key=lambda each: each[0].bounds[0, 0]))
    assert metal == replace(SURFACE, specular=pytest.approx(0.8), diffuse=0.0)
    assert dull == replace(SURFACE, roughness=0.25)
    assert max(part.bounds[1, 0] for part, _ in parts) == pytest.approx(1.25)


@pytest.mark.parametrize(
    ("factors", "expected"),
    [
        ({}, {}),
        ({"roughnessFactor": 0.3}, {"roughness": 0.09}),
        ({"roughnessFactor": 0.0}, {"roughness": 0.01}),
        ({"baseColorFactor": [255, 255, 255, 255]}, {"specular": 1.0, "diffuse": 0.0}),
        (
            {"baseColorFactor": [255, 0, 0, 255], "metallicFactor": 0.0},
            {"specular": 0.04, "diffuse": 0.2126},
        ),
        (
            {"baseColorFactor": [0, 255, 0, 255], "metallicFactor": 0.5},
            {"specular": 0.02 + 0.3576, "diffuse": 0.3576},
        ),
    ],
)
def test_material_sets_the_surface(factors, expected):
    visual = trimesh.visual.TextureVisuals(material=PBRMaterial(**factors))
    surface = surface_of(visual, SURFACE)
    for name in ("roughness", "specular", "diffuse"):
        usual = getattr(SURFACE, name)
        assert getattr(surface, name) == pytest.approx(expected.get(name, usual), abs=1e-12)


def test_colours_of_vertices_are_not_a_material(tmp_path):
    mesh = fuselage_mesh(Body(), sides=32)
    mesh.visual.vertex_colors = [200, 30, 30, 255]
    assert only(saved(tmp_path / "body.ply", mesh)) is not None


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("no.stl", None, "no such file; body.mesh is relative to the scene file"),
        ("body.step", b"", "not a mesh file of a known kind; use STL, OBJ, GLB or PLY"),
        ("body.stl", b"solid x", "the mesh has no faces; export the model as triangles"),
        ("body.obj", b"v 0 0 0\n", "the mesh has no faces; export the model as triangles"),
    ],
)
def test_a_file_that_is_no_mesh_is_refused(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=f"^{re.escape(f'{path}: {message}')}$"):
        read_mesh(Body(mesh=path), SURFACE)


@pytest.mark.parametrize("kind", ["stl", "obj", "glb", "ply"])
def test_a_damaged_file_is_refused_in_one_sentence(tmp_path, kind):
    whole = saved(tmp_path / f"body.{kind}").mesh.read_bytes()
    for content in (b"", whole[: len(whole) // 3], b"\x00" * 300, whole[:200] + b"\xff" * 200):
        path = tmp_path / f"damaged.{kind}"
        path.write_bytes(content)
        said, parts = outcome(path)
        if said:
            assert re.match(rf"^{re.escape(str(path))}: the mesh .*\S$", said)
            assert "\n" not in said
        else:  # text formats may be whole after any line
            assert kind in {"obj", "stl"}
            assert all(np.isfinite(part.vertices).all() for part, _ in parts)


def outcome(path: Path):
    try:
        return "", read_mesh(Body(mesh=path), SURFACE)
    except InputError as error:
        return str(error), []
