"""The shape of the fuselage: as a mesh to draw, and as a cylinder to cast rays at."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from render_sim.scene import Body

if TYPE_CHECKING:
    import trimesh

__all__ = ["cylinder_hits", "fuselage_mesh"]

Floats = NDArray[np.float64]
_RINGS_NOSE = 48
_RINGS_TUBE = 24


def fuselage_mesh(body: Body, *, sides: int = 512) -> "trimesh.Trimesh":
    """Make the body's mesh in the model frame, with smooth outward normals.

    Parameters
    ----------
    body : Body
        Dimensions, or the mesh file to read instead.
    sides : int
        Facets round the circumference. The tube is open at its aft end: a cap would share
        vertices with the tube and spoil its normals.

    Returns
    -------
    trimesh.Trimesh
        The mesh [m].

    Raises
    ------
    InputError
        If the mesh file cannot be read.
    """
    import trimesh  # noqa: PLC0415  only the renderer that draws meshes needs it

    if body.mesh is not None:
        try:
            return trimesh.load(body.mesh, force="mesh")
        except Exception as error:
            raise InputError(f"{body.mesh}: the mesh cannot be read ({error})") from None
    x, radius, slope = _profile(body)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    around = np.stack([np.zeros(sides), np.cos(angle), np.sin(angle)], axis=-1)
    along = np.array([1.0, 0.0, 0.0])
    vertices = x[:, None, None] * along + radius[:, None, None] * around
    normals = around - slope[:, None, None] * along
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return trimesh.Trimesh(
        vertices=vertices.reshape(-1, 3),
        faces=_tube_faces(x.size, sides),
        vertex_normals=normals.reshape(-1, 3),
        process=False,
    )


def _profile(body: Body) -> tuple[Floats, Floats, Floats]:
    """Return stations, radii and slopes dr/dx of the rings, aft to nose.

    A tangent ogive is an arc of a circle that meets the cylinder without a kink.
    """
    tube = np.linspace(body.base_station_m, body.shoulder_station_m, _RINGS_TUBE)
    length = body.nose_station_m - body.shoulder_station_m
    arc = (body.radius_m**2 + length**2) / (2.0 * body.radius_m)
    # rings crowd towards the tip; the last stops short of it, where a normal has no direction
    ahead = length * np.sin(np.linspace(0.0, 0.5 * np.pi, _RINGS_NOSE + 1)[1:])
    ahead[-1] = length * (1.0 - 1e-6)
    height = np.sqrt(arc**2 - ahead**2)
    x = np.concatenate([tube, body.shoulder_station_m + ahead])
    radius = np.concatenate([np.full_like(tube, body.radius_m), height + body.radius_m - arc])
    slope = np.concatenate([np.zeros_like(tube), -ahead / height])
    return x, radius, slope


def _tube_faces(rings: int, sides: int) -> NDArray[np.int64]:
    """Return the triangles between successive rings, counter-clockwise seen from outside."""
    ring = np.arange(rings - 1)[:, None] * sides
    here, beside = np.arange(sides), (np.arange(sides) + 1) % sides
    aft, aft_next, fore, fore_next = (
        ring + here,
        ring + beside,
        ring + sides + here,
        ring + sides + beside,
    )
    first = np.stack([aft, fore_next, fore], axis=-1)
    second = np.stack([aft, aft_next, fore_next], axis=-1)
    return np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])


def cylinder_hits(
    radius_m: float, pose: Floats, eye_m: Floats, directions: Floats
) -> tuple[Floats, Floats]:
    """Return where rays first meet an endless cylinder about the model's x axis.

    Parameters
    ----------
    radius_m : float
        Its radius [m].
    pose : ndarray
        Pose, model to tunnel [4, 4] [m].
    eye_m : ndarray
        Where the rays start, outside the cylinder [3] [m].
    directions : ndarray
        Their directions, tunnel frame [..., 3].

    Returns
    -------
    points_m, normals : ndarray
        Points and unit outward normals, tunnel frame [..., 3]; NaN for rays that miss.
    """
    across = pose[:3, 1:3]
    eye = (eye_m - pose[:3, 3]) @ across
    rays = directions @ across
    a = np.sum(rays**2, axis=-1)
    b = rays @ eye
    under = b**2 - a * (eye @ eye - radius_m**2)
    depth = (-b - np.sqrt(np.where(under >= 0.0, under, np.nan))) / a
    normals = (eye + depth[..., None] * rays) @ across.T / radius_m
    return eye_m + depth[..., None] * directions, normals
