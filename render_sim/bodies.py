"""The shape of the fuselage: as a mesh to draw, and as an endless tube to cast rays at."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from render_sim.scene import Body

if TYPE_CHECKING:
    import trimesh

__all__ = ["body_hits", "cylinder_hits", "facing_point", "fuselage_mesh"]

Floats = NDArray[np.float64]
_RINGS_NOSE = 48
_RINGS_TUBE = 24
_NEWTON_STEPS = 40


def fuselage_mesh(body: Body, *, sides: int = 512) -> "trimesh.Trimesh":
    """Make the built-in body's mesh in the model frame, with the body's own outward normals.

    Parameters
    ----------
    body : Body
        Shape and dimensions.
    sides : int
        Facets round the circumference. The tube is open at its aft end: a cap would share
        vertices with the tube and spoil its normals.

    Returns
    -------
    trimesh.Trimesh
        The mesh [m].
    """
    import trimesh  # noqa: PLC0415  only the renderer that draws meshes needs it

    x, size, slope = _profile(body)
    section, facing = _outline(body, sides)
    along = np.array([1.0, 0.0, 0.0])
    vertices = x[:, None, None] * along + size[:, None, None] * section
    # a section that shrinks forward leans forward, by how far it reaches where it faces
    reach = np.sum(section * facing, axis=-1, keepdims=True)
    normals = facing - slope[:, None, None] * reach * along
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return trimesh.Trimesh(
        vertices=vertices.reshape(-1, 3),
        faces=_tube_faces(x.size, sides),
        vertex_normals=normals.reshape(-1, 3),
        process=False,
    )


def _outline(body: Body, sides: int) -> tuple[Floats, Floats]:
    """Return points of the tube's section and unit normals there [side, 3], from +y towards +z.

    Of a superellipse, the sides share its length and its turning evenly: corners need points for
    their bend, flats for their length.
    """
    half_width, half_height = body.half_axes_m
    angle = 2.0 * np.pi * np.arange(sides) / sides
    if body.is_round:
        around = np.stack([np.zeros(sides), np.cos(angle), np.sin(angle)], axis=-1)
        return body.radius_m * around, around
    n = body.exponent
    fine = np.linspace(0.0, 2.0 * np.pi, 64 * sides + 1)
    y, z = np.cos(fine) / half_width, np.sin(fine) / half_height
    away = (np.abs(y) ** n + np.abs(z) ** n) ** (-1.0 / n)
    turn = np.unwrap(np.arctan2(*_gradient(body, away * np.sin(fine), away * np.cos(fine))))
    run = np.cumsum(np.hypot(np.diff(away, append=away[1]), away * (fine[1] - fine[0])))
    run = (run - run[0]) / (run[-1] - run[0])
    share = 0.5 * run + 0.5 * (turn - turn[0]) / (turn[-1] - turn[0])
    polar = np.interp(np.arange(sides) / sides, share, fine)
    y, z = np.cos(polar), np.sin(polar)
    away = (np.abs(y / half_width) ** n + np.abs(z / half_height) ** n) ** (-1.0 / n)
    up, side = _gradient(body, away * z, away * y)
    size = np.hypot(up, side)
    nothing = np.zeros(sides)
    return (
        np.stack([nothing, away * y, away * z], axis=-1),
        np.stack([nothing, side / size, up / size], axis=-1),
    )


def _gradient(body: Body, z: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return the direction, of any length, that a superellipse faces at a point: along z and y."""
    half_width, half_height = body.half_axes_m
    power = body.exponent - 1.0
    return (
        np.sign(z) * np.abs(z / half_height) ** power / half_height,
        np.sign(y) * np.abs(y / half_width) ** power / half_width,
    )


def facing_point(body: Body, angle: Floats) -> tuple[Floats, Floats]:
    """Return y and z of the point of the tube's section that faces a direction.

    It lies farthest out in that direction: for a superellipse of exponent n and half axes a, b the
    gradient of the support function (|a sin t|^p + |b cos t|^p)^(1/p), p = n / (n - 1).

    Parameters
    ----------
    body : Body
        Shape and dimensions.
    angle : ndarray
        Angle t of the direction about the axis, from the top towards model +y [...] [rad].
    """
    if body.is_round:
        return body.radius_m * np.sin(angle), body.radius_m * np.cos(angle)
    half_width, half_height = body.half_axes_m
    n = body.exponent
    y, z = half_width * np.sin(angle), half_height * np.cos(angle)
    size = (np.abs(y) ** (n / (n - 1.0)) + np.abs(z) ** (n / (n - 1.0))) ** (1.0 / n)
    power = 1.0 / (n - 1.0)
    return (
        half_width * np.sign(y) * np.abs(y) ** power / size,
        half_height * np.sign(z) * np.abs(z) ** power / size,
    )


def _profile(body: Body) -> tuple[Floats, Floats, Floats]:
    """Return stations, sizes over the tube's and their slopes [1/m] of the rings, aft to nose.

    A tangent ogive is an arc of a circle that meets the cylinder without a kink; a cone meets it
    with one, where two rings face differently.
    """
    tube = np.linspace(body.base_station_m, body.shoulder_station_m, _RINGS_TUBE)
    length = body.nose_station_m - body.shoulder_station_m
    radius = max(body.half_axes_m)
    arc = (radius**2 + length**2) / (2.0 * radius)
    # rings crowd towards the tip; the last stops short of it, where a normal has no direction
    ahead = length * np.sin(np.linspace(0.0, 0.5 * np.pi, _RINGS_NOSE + 1)[1:])
    ahead[-1] = length * (1.0 - 1e-6)
    height = np.sqrt(arc**2 - ahead**2)
    nose, slope = (height + radius - arc) / radius, -ahead / height / radius
    if body.shape == "cone-cylinder":
        ahead = np.insert(ahead, 0, 0.0)
        nose, slope = 1.0 - ahead / length, np.full_like(ahead, -1.0 / length)
    return (
        np.concatenate([tube, body.shoulder_station_m + ahead]),
        np.concatenate([np.ones_like(tube), nose]),
        np.concatenate([np.zeros_like(tube), slope]),
    )


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


def body_hits(body: Body, pose: Floats, eye_m: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """Return where rays first meet the body's tube, taken as endless.

    Parameters
    ----------
    body : Body
        Shape and dimensions; of a mesh file its radius.
    pose, eye_m, directions : ndarray
        As of `cylinder_hits`.

    Returns
    -------
    points_m, normals : ndarray
        As of `cylinder_hits`.
    """
    if body.is_round:
        return cylinder_hits(body.radius_m, pose, eye_m, directions)
    across = pose[:3, 1:3]
    eye, rays = (eye_m - pose[:3, 3]) @ across, directions @ across
    axes, n = np.array(body.half_axes_m), body.exponent
    eye, rays = eye / axes, rays / axes
    # along a ray |y / a|^n + |z / b|^n is convex: Newton's steps never pass the nearer root
    a, b = np.sum(rays**2, axis=-1), rays @ eye
    under = b**2 - a * (eye @ eye - 2.0 ** (1.0 - 2.0 / n))
    depth = (-b - np.sqrt(np.where(under >= 0.0, under, np.nan))) / a
    for _ in range(_NEWTON_STEPS):
        at = eye + depth[..., None] * rays
        slope = n * np.sum(np.sign(at) * np.abs(at) ** (n - 1.0) * rays, axis=-1)
        over = np.sum(np.abs(at) ** n, axis=-1) - 1.0
        depth = np.where((slope < 0.0) & (over > 0.0), depth - over / slope, depth)
    at = eye + depth[..., None] * rays
    depth = np.where(np.sum(np.abs(at) ** n, axis=-1) > 1.0 + 1e-9, np.nan, depth)
    normals = np.sign(at) * np.abs(at) ** (n - 1.0) / axes
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = np.where(np.isnan(depth)[..., None], np.nan, normals)
    return eye_m + depth[..., None] * directions, normals @ across.T
