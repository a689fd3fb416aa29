"""What all renderers share: how a pixel answers to light, and the exposure.

The lens blur stands here and nowhere else, so that no two renderers can blur differently.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from render_sim.bodies import cylinder_hits
from render_sim.light import radiance
from render_sim.mirror import mirror_points
from render_sim.motion import StaticMotion
from render_sim.projection import Pinhole, window_columns
from render_sim.scene import Scene

__all__ = [
    "edge_response",
    "exposure_gain",
    "integrate_lines",
    "pixel_response",
    "response_margin",
]

Floats = NDArray[np.float64]
_BLUR_REACH = 5.0


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
