"""The body as a mesh file: STL, OBJ, GLB or PLY, with the materials that the file states.

A file is read in the model frame (x forward to the nose, z up, origin at the balance moment
centre), whatever its format says of axes, with `Body.mesh_unit_m` as its unit; the transforms of a
GLB's nodes apply. Normals are the file's own where it has them, and else the mean of the faces that
meet in a vertex. An STL file has neither normals nor shared vertices: equal vertices are merged,
and faces that meet at less than 30 degrees share their normals.

A material of a GLB file sets the surface of its part, by the metallic-roughness model of glTF 2.0
(section 3.9.2, appendix B): roughness m = r^2; with L the luminance of the base colour and M the
metalness, specular = 0.04 (1 - M) + L M and diffuse = L (1 - M). What a material does not state is
as in the scene; textures are not read.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from glint_aoa.errors import InputError
from render_sim.scene import Body, Surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["read_mesh", "surface_of"]

_FORMATS = (".stl", ".obj", ".glb", ".ply")
_SMOOTH_RAD = np.radians(30.0)
_LONGEST_M = 50.0
_SMOOTHEST = 0.01  # a mirror would need endless lamp samples
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # ITU-R BT.709, of linear colours
_DIELECTRIC = 0.04


def read_mesh(body: Body, surface: Surface) -> list[tuple["trimesh.Trimesh", Surface]]:
    """Read a body's mesh file.

    Parameters
    ----------
    body : Body
        Names the file and its unit.
    surface : Surface
        The surface of what has no material.

    Returns
    -------
    list of (Trimesh, Surface)
        The parts, in the model frame [m], and the surface of each.

    Raises
    ------
    InputError
        If the file is missing, cannot be read, is of another kind, holds no faces, or is so large
        that its unit must be wrong.
    """
    import trimesh  # noqa: PLC0415  only the renderer that draws meshes needs it

    path = body.mesh
    if path is None:
        raise InputError("body.mesh is missing; name a mesh file")
    if path.suffix.lower() not in _FORMATS:
        raise InputError(f"{path}: not a mesh file of a known kind; use STL, OBJ, GLB or PLY")
    if not path.is_file():
        raise InputError(f"{path}: no such file; body.mesh is relative to the scene file")
    try:
        loaded = trimesh.load_scene(path).dump()
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: the mesh cannot be read ({reason})") from None
    parts = [part for part in loaded if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not parts:
        raise InputError(f"{path}: the mesh has no faces; export the model as triangles")
    if path.suffix.lower() == ".stl":
        parts = [
            trimesh.graph.smooth_shade(part, angle=_SMOOTH_RAD, facet_minarea=None)
            for part in parts
        ]
    for part in parts:
        part.apply_scale(body.mesh_unit_m)
    _check_size(body, parts)
    return [(part, surface_of(part.visual, surface)) for part in parts]


def _check_size(body: Body, parts: list[Any]) -> None:
    corners = np.array([part.bounds for part in parts])
    size = float(np.max(corners[:, 1].max(axis=0) - corners[:, 0].min(axis=0)))
    if size > _LONGEST_M:
        raise InputError(
            f"{body.mesh}: the mesh is {size:.4g} m long; state its unit, "
            'e.g. body.mesh_unit = "1 mm"'
        )


def surface_of(visual: Any, surface: Surface) -> Surface:
    """Return the surface that a part's material states.

    Parameters
    ----------
    visual : trimesh.visual
        The part's; only a metallic-roughness material counts.
    surface : Surface
        Says what the material does not.
    """
    material: Any = getattr(visual, "material", None)
    if type(material).__name__ != "PBRMaterial":
        return surface
    if material.roughnessFactor is not None:
        roughness = float(material.roughnessFactor) ** 2
        surface = replace(surface, roughness=max(roughness, _SMOOTHEST))
    if material.baseColorFactor is not None:
        colour = np.asarray(material.baseColorFactor, dtype=np.float64)[:3] / 255.0
        luminance = min(float(_LUMINANCE @ colour), 1.0)
        metalness = 1.0 if material.metallicFactor is None else float(material.metallicFactor)
        surface = replace(
            surface,
            specular=_DIELECTRIC * (1.0 - metalness) + luminance * metalness,
            diffuse=luminance * (1.0 - metalness),
        )
    return surface
