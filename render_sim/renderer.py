"""What a renderer is, and what all of them share: the pixel's response and the exposure."""

from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from glint_aoa.errors import InputError, MissingLibraryError
from render_sim.bodies import cylinder_hits
from render_sim.light import radiance
from render_sim.mirror import mirror_points
from render_sim.motion import StaticMotion
from render_sim.projection import Pinhole, window_columns
from render_sim.scene import Scene

__all__ = [
    "Renderer",
    "edge_response",
    "exposure_gain",
    "integrate_lines",
    "make_renderer",
    "opengl_missing",
    "pixel_response",
    "response_margin",
]

Floats = NDArray[np.float64]
_BLUR_REACH = 5.0


class Renderer(Protocol):
    """Anything that makes noiseless images of one scene."""

    @property
    def name(self) -> str:
        """Its name, as `make_renderer` knows it."""
        ...

    def radiance(self, poses: Floats, *, parity: int = 0) -> Floats:
        """Return one image a pose, integrated over pixels, lens blur included.

        Parameters
        ----------
        poses : ndarray
            Poses, model to tunnel [image, 4, 4] [m].
        parity : int
            0 for even fields, 1 for odd ones, whose lines lie half a line lower.

        Returns
        -------
        ndarray
            Linear light in grey levels above black [image, row, column].
        """
        ...


def make_renderer(scene: Scene, name: Literal["auto", "raytrace", "pyrender"] = "auto") -> Renderer:
    """Make a renderer for a scene.

    Parameters
    ----------
    scene : Scene
        The scene.
    name : {"auto", "raytrace", "pyrender"}
        ``raytrace`` casts rays at a cylinder and needs no OpenGL; ``pyrender`` draws any mesh.
        ``auto`` takes the first, unless the body is a mesh file.

    Raises
    ------
    InputError
        If there is no renderer of that name, or it cannot show this scene.
    MissingLibraryError
        If ``pyrender`` is asked for and there is no OpenGL on this machine.
    """
    if name == "auto":
        name = "raytrace" if scene.body.mesh is None else "pyrender"
    if name == "raytrace":
        from render_sim.raytrace import RaytraceRenderer  # noqa: PLC0415  numba is slow to import

        return RaytraceRenderer(scene)
    if name == "pyrender":
        from render_sim.opengl import PyrenderRenderer  # noqa: PLC0415  OpenGL may be missing

        return PyrenderRenderer(scene)
    raise InputError(f"unknown renderer {name!r}; choose auto, raytrace or pyrender")


def opengl_missing() -> str | None:
    """Say in one sentence what the OpenGL renderer lacks on this machine; None if it works."""
    from render_sim._pyrender_repairs import egl_context  # noqa: PLC0415  loads OpenGL

    try:
        egl_context()
    except MissingLibraryError as error:
        return str(error)
    return None


def pixel_response(offset_lines: ArrayLike, blur_lines: float) -> Floats:
    """Return how much a pixel takes of light that falls `offset_lines` from its centre.

    One line high, blurred by a Gaussian; its integral is 1. The lens blur stands here and nowhere
    else. Across the columns there is none: it would not move a nearly level line.

    Parameters
    ----------
    offset_lines : array_like
        Distance from the pixel's centre [...] [field lines].
    blur_lines : float
        Standard deviation of the blur [field lines]; 0 for none.
    """
    offset = np.asarray(offset_lines, dtype=np.float64)
    if blur_lines == 0.0:
        return np.where(np.abs(offset) < 0.5, 1.0, 0.0)
    return np.asarray(ndtr((offset + 0.5) / blur_lines) - ndtr((offset - 0.5) / blur_lines))


def edge_response(offset_lines: ArrayLike, blur_lines: float) -> Floats:
    """Return the part of a pixel's response beyond an edge `offset_lines` before its centre.

    The integral of `pixel_response` from minus infinity to `offset_lines` [...].
    """
    offset = np.asarray(offset_lines, dtype=np.float64)
    if blur_lines == 0.0:
        return np.clip(offset + 0.5, 0.0, 1.0)

    def ramp(t: Floats) -> Floats:
        return np.asarray(t * ndtr(t) + np.exp(-0.5 * t * t) / np.sqrt(2.0 * np.pi))

    high, low = (offset + 0.5) / blur_lines, (offset - 0.5) / blur_lines
    return blur_lines * (ramp(high) - ramp(low))


def response_margin(blur_lines: float) -> int:
    """Return how many lines beyond its own a pixel takes light from [field lines]."""
    return int(np.ceil(_BLUR_REACH * blur_lines))


def integrate_lines(fine: NDArray[np.floating], *, subsamples: int, blur_lines: float) -> Floats:
    """Integrate an image that is finely sampled in v over the pixels' response.

    Parameters
    ----------
    fine : ndarray
        Radiance, `subsamples` evenly spaced samples a line, with `response_margin` lines more than
        the result has at either end [..., fine row, column].
    subsamples : int
        Samples a line.
    blur_lines : float
        Standard deviation of the blur [field lines].

    Returns
    -------
    ndarray
        Integrated radiance [..., row, column].
    """
    span = 1 + 2 * response_margin(blur_lines)
    offset = (np.arange(span * subsamples) + 0.5) / subsamples - 0.5 * span
    weights = pixel_response(offset, blur_lines)
    weights /= weights.sum()
    rows = fine.shape[-2] // subsamples - span + 1
    result = np.zeros((*fine.shape[:-2], rows, fine.shape[-1]))
    for n, weight in enumerate(weights):
        result += weight * fine[..., n : n + rows * subsamples : subsamples, :]
    return result


def exposure_gain(scene: Scene) -> float:
    """Return the gain that brings the static glint at zero pitch to the sensor's peak level.

    The profile across the mirror line is integrated over a pixel centred on its brightest place,
    in a few columns of the window, with the body's cylinder: one exposure for every renderer.

    Returns
    -------
    float
        Grey levels per unit of radiance.
    """
    camera, sensor = Pinhole.of(scene), scene.sensor
    pose = StaticMotion(scene).pose(np.zeros(()))
    columns = window_columns(scene)[np.linspace(0, sensor.columns - 1, 9).astype(int)]
    centre = _undistorted_line(camera, mirror_points(scene, pose, columns))
    offsets = np.arange(-12.0, 12.0, 0.05)
    rays = _undistorted_rays(camera, columns, centre + offsets[:, None])
    points, normals = cylinder_hits(scene.body.radius_m, pose, camera.centre_m, rays)
    profile = np.nan_to_num(radiance(scene, points, normals, camera.centre_m))
    kernel = pixel_response(np.arange(-4.0, 4.025, 0.05), scene.optics.blur_lines)
    kernel /= kernel.sum()
    brightest = max(np.convolve(each, kernel, mode="same").max() for each in profile.T)
    return float((sensor.peak_level - sensor.black_level) / brightest)


def _undistorted_line(camera: Pinhole, points: Floats) -> Floats:
    seen = (points - camera.centre_m) @ camera.rotation
    return np.asarray(camera.v0 - camera.fy * seen[..., 2] / seen[..., 1])


def _undistorted_rays(camera: Pinhole, columns: Floats, lines: Floats) -> Floats:
    x, y = np.broadcast_arrays((columns - camera.u0) / camera.fx, (lines - camera.v0) / camera.fy)
    return np.asarray(np.stack([x, np.ones_like(x), -y], axis=-1) @ camera.rotation.T)
