"""The built-in renderer: rays cast at a cylinder, without OpenGL.

Only where it matters. Every few dozen columns the radiance is cast on a grid much finer than a
line in a band round the mirror line. Along that line the profile across it hardly changes, so the
columns between are interpolated along the line (cubic), and the pixel's response, lens blur
included, is integrated exactly for the interpolated profile. The matte part, smooth everywhere, is
cast on a coarse grid; the body's upper and lower edges, known in closed form, cover their pixels
exactly. `RaytraceRenderer.brute_force` casts every ray instead and is what the fast way is held
against.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from render_sim import _markings_kernel as patches
from render_sim import _raytrace_kernel as kernel
from render_sim.bodies import body_hits
from render_sim.light import lamp_samples, reflection
from render_sim.markings import column_blur, extents
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
from render_sim.scene import Scene, Surface

__all__ = ["RaytraceRenderer"]

Floats = NDArray[np.float64]
_NODE_SPACING = 47.0
_SPOT_M, _SPOT_SHARE = 1.0, 0.25  # lamps shorter than this light the columns less evenly
_SAMPLES_TO_HALF = 5.1  # from the glint's middle to where it has half its height
_FAINT = 1e-5
_TILT = 60  # lines that a mirror line may run beyond the window
_PROBLEMS = {
    1: "the body does not mirror the lamp into every column; move lamp or camera",
    2: "the cylinder ends within the window, and the built-in renderer shows nothing else; "
    "use the pyrender renderer",
    3: "one of other_lamp is mirrored at the very edge of the body, which the built-in renderer "
    "cannot show; move the lamp or use the pyrender renderer",
}


class RaytraceRenderer:
    """Renders a cylinder under a long lamp.

    Parameters
    ----------
    scene : Scene
        The scene; its body must be the built-in one.

    Raises
    ------
    InputError
        If the body is a mesh file.
    """

    name = "raytrace"

    def __init__(self, scene: Scene) -> None:
        if scene.body.mesh is not None:
            raise InputError("the built-in renderer shows no mesh file; use the pyrender renderer")
        self._scene = scene
        gain = exposure_gain(scene)
        self._nodes, self._first, self._blend = _column_nodes(scene)
        self._per_line, self._half, self._weights = _profile_grid(scene)
        self._edge = _edge_table(Blur.of(scene))
        camera, body = Pinhole.of(scene), scene.body
        self._section = np.array([*body.half_axes_m, 2.0 if body.is_round else body.exponent])
        self._stations = np.array([body.base_station_m, body.shoulder_station_m])
        self._lens = (
            camera.centre_m,
            camera.rotation,
            np.array([camera.fx, camera.fy, camera.u0, camera.v0]),
            camera.distortion,
        )
        # the exposure's gain scales every source of light, so that images come in grey levels
        lamps = (scene.lamp, *scene.other_lamps)
        samples = [lamp_samples(scene, lamp) for lamp in lamps]
        self._lamp = np.concatenate(samples)
        self._lamp[:, 3] *= gain
        self._lamp_first = np.cumsum([0, *map(len, samples)])
        self._lamp_lines = np.array([lamp.centre_m for lamp in lamps])
        self._surfaces = np.array([_numbers(each, gain) for each in scene.surfaces])
        self._marks = extents(scene)
        if len(self._marks):
            self._grids = np.array([_marking_grid(scene, each) for each in scene.surfaces])
            self._strips = _strips(scene)

    def radiance(self, poses: Floats, *, parity: int = 0, turns: Floats | None = None) -> Floats:
        """Return one image a pose; see `Renderer.radiance`.

        Raises
        ------
        InputError
            If the cylinder ends within the window, or no lamp is mirrored in some column.
        """
        centre, rotation, *lens = self._lens
        turned = rotation if turns is None else rotation @ turns
        images, problem = kernel.fast_images(
            np.ascontiguousarray(poses),
            float(window_lines(self._scene, parity=parity)[0]),
            self._scene.sensor.rows,
            self._nodes,
            self._blend,
            self._first,
            self._per_line,
            self._half,
            self._weights,
            self._edge,
            self._stations,
            centre,
            np.broadcast_to(turned, (len(poses), 3, 3)),
            *lens,
            self._lamp,
            self._lamp_first,
            self._lamp_lines,
            self._surfaces[0],
            self._section,
        )
        if problem:
            raise InputError(_PROBLEMS[problem])
        if len(self._marks):
            self._add_markings(images, poses, turned, parity)
        return np.asarray(images)

    def _add_markings(self, images: Floats, poses: Floats, turned: Floats, parity: int) -> None:
        centre, _, *lens = self._lens
        patches.add_markings(
            images,
            np.ascontiguousarray(poses),
            float(window_lines(self._scene, parity=parity)[0]),
            Blur.of(self._scene).margin,
            self._nodes,
            *self._strips,
            self._marks,
            self._surfaces,
            self._grids,
            centre,
            np.broadcast_to(turned, (len(poses), 3, 3)),
            *lens,
            self._lamp,
            self._lamp_first,
            self._lamp_lines,
            self._section,
        )

    def brute_force(self, poses: Floats, *, parity: int = 0, subsamples: int = 16) -> Floats:
        """Return the same images with every ray cast, `subsamples` a line; slow.

        Here the cylinder has no ends. With markings as many rays are cast across a column, and the
        lens blurs the columns too.
        """
        blur = Blur.of(self._scene)
        margin = blur.margin
        first = float(window_lines(self._scene, parity=parity)[0]) - 0.5 - margin
        count = (self._scene.sensor.rows + 2 * margin) * subsamples
        lines = first + (np.arange(count) + 0.5) / subsamples
        columns, across = window_columns(self._scene), column_blur(self._scene)
        if len(self._marks):
            columns = _finely(columns, across.margin, subsamples)
        scene = (*self._lens, self._lamp, self._surfaces, self._section, self._marks)
        fine = np.array([kernel.fine_image(pose, columns, lines, *scene) for pose in poses])
        images = integrate_lines(fine, subsamples=subsamples, blur=blur)
        if len(self._marks) == 0:
            return images
        turned = integrate_lines(images.swapaxes(1, 2), subsamples=subsamples, blur=across)
        return turned.swapaxes(1, 2)


def _finely(pixels: Floats, margin: int, parts: int) -> Floats:
    """Return the middles of the parts of successive pixels, and of `margin` more at either end."""
    count = (pixels.size + 2 * margin) * parts
    return np.asarray(pixels[0] - 0.5 - margin + (np.arange(count) + 0.5) / parts)


def _numbers(surface: Surface, gain: float) -> tuple[float, ...]:
    """Return a surface as the kernel reads it, its own light in grey levels."""
    reflectance = (surface.roughness**2, surface.specular, surface.diffuse)
    around = (surface.ambient * gain, surface.wall * gain)
    return (*reflectance, *around, float(surface.distribution == "ggx"))


def _marking_grid(scene: Scene, surface: Surface) -> tuple[int, int]:
    """Return samples a line, and on either side of the mirror line, for one of the surfaces."""
    fields = scene.fields.first_line or 0
    tilted = scene.with_window(fields, scene.sensor.rows + _TILT)
    per_line, half, _ = _profile_grid(replace(tilted, surface=surface))
    return per_line, half


def _strips(scene: Scene) -> tuple[Floats, Floats, NDArray[np.int64], Floats, Floats]:
    """Return the columns' strips, how they lie between nodes, and pixels' response to the parts."""
    blur, across = Blur.of(scene), column_blur(scene)
    strips = _finely(window_columns(scene), across.margin, patches.STRIPS)
    _, first, blend = _column_nodes(scene, strips)
    return strips, blend, first, _shares(blur, patches.CELLS), _shares(across, patches.STRIPS)


def _shares(blur: Blur, parts: int) -> Floats:
    """Return a pixel's response to parts of its own and of `blur.margin` pixels on either side."""
    reach = 0.5 + blur.margin
    edges = np.arange((1 + 2 * blur.margin) * parts + 1) / parts - reach
    return np.diff(edge_response(edges, blur))


def _column_nodes(
    scene: Scene, places: Floats | None = None
) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Return node columns, and each column's first node and four weights (cubic Lagrange).

    The columns are the window's, or `places` near them.
    """
    columns = window_columns(scene)
    is_spot = any(lamp.length_m < _SPOT_M for lamp in (scene.lamp, *scene.other_lamps))
    spacing = _NODE_SPACING * (_SPOT_SHARE if is_spot else 1.0)
    intervals = max(3, int(np.ceil((columns.size - 1) / spacing)))
    span = max(columns[-1] - columns[0], 1.0)
    nodes = columns[0] + span * np.arange(intervals + 1) / intervals
    place = ((columns if places is None else places) - columns[0]) / span * intervals
    first = np.clip(place.astype(np.int64) - 1, 0, intervals - 3)
    x = (place - first)[:, None]
    others = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]], dtype=np.float64)
    own = np.arange(4.0)
    blend = np.prod((x[..., None] - others) / (own[:, None] - others), axis=-1)
    return nodes, first, blend


def _profile_grid(scene: Scene) -> tuple[int, int, Floats]:
    """Return samples a line, samples on either side of the mirror line, the response's weights.

    The band reaches to where the glint is 1e-5 of its peak, with a fifth to spare; or beyond the
    window.
    """
    blur = Blur.of(scene)
    half_width, reach = _glint_reach(scene)
    reach *= 1.2
    per_line = int(np.ceil(_SAMPLES_TO_HALF / half_width))
    half = int(np.ceil((reach + 0.5 + blur.margin) * per_line)) + 2
    return per_line, half, _response_weights(1.0 / per_line, blur)


def _glint_reach(scene: Scene) -> tuple[float, float]:
    """Return how far the static glint reaches at half its height, and at all [field lines]."""
    camera = Pinhole.of(scene)
    pose = StaticMotion(scene).pose(np.zeros(()))
    middle = window_columns(scene)[scene.sensor.columns // 2 : scene.sensor.columns // 2 + 1]
    u, v = camera.project(mirror_points(scene, pose, middle))
    most = float(scene.sensor.rows)
    offsets = np.linspace(-most, most, 80 * scene.sensor.rows + 1)
    rays = camera.directions(u, v + offsets)
    points, normals = body_hits(scene.body, pose, camera.centre_m, rays)
    _, specular = reflection(scene, points, normals, camera.centre_m)
    share = specular / np.nanmax(specular)
    half, all_of_it = (np.max(np.abs(offsets[share > least])) for least in (0.5, _FAINT))
    return float(half), float(all_of_it)


def _edge_table(blur: Blur) -> Floats:
    reach = (0.5 + blur.margin) * kernel.EDGE_STEPS
    return edge_response(np.arange(-reach, reach + 1) / kernel.EDGE_STEPS, blur)


def _response_weights(step: float, blur: Blur) -> Floats:
    """Return weights that integrate sampled values times the pixel's response.

    Exact for the cubic that runs through neighbouring samples: each weight is the integral of the
    response times a sample's cardinal function.
    """
    fine = 64
    half = int(np.ceil((0.5 + blur.margin) / step)) + 2
    x = np.abs((np.arange(-2 * fine, 2 * fine) + 0.5) / fine)
    near = (1.0 - x**2) * (2.0 - x) / 2.0
    cardinal = np.where(x < 1.0, near, (1.0 - x) * (2.0 - x) * (3.0 - x) / 6.0)
    x = (np.arange(-2 * fine, 2 * fine) + 0.5) / fine
    places = (np.arange(-half, half + 1)[:, None] + x) * step
    weights = pixel_response(places, blur) @ cardinal
    return np.asarray(weights / weights.sum())
