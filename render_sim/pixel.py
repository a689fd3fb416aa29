"""What all renderers share: how a pixel answers to light, and the exposure.

The lens blur stands here and nowhere else, so that no two renderers can blur differently.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import j1, ndtr

from glint_aoa.errors import InputError
from render_sim.bodies import body_hits
from render_sim.light import radiance
from render_sim.mirror import mirror_points
from render_sim.motion import StaticMotion
from render_sim.projection import Pinhole, window_columns, window_lines
from render_sim.scene import Scene

__all__ = [
    "Blur",
    "edge_response",
    "exposure_gain",
    "integrate_lines",
    "lens_falloff",
    "pixel_response",
]

Floats = NDArray[np.float64]
_BLUR_REACH = 5.0  # standard deviations
_TAIL = 0.005  # of the light, which diffraction throws farther; it is put back at the far ends
_FINE = 512  # samples a line


@dataclass(frozen=True)
class Blur:
    """How the lens spreads a line of light across the field lines.

    Attributes
    ----------
    gaussian : float
        Standard deviation of its Gaussian part [field lines].
    disc : float
        Radius of the disc that a point is spread over out of focus [field lines].
    cutoff : float
        Spatial frequency above which diffraction lets nothing through [cycles / field line].
    """

    gaussian: float = 0.0
    disc: float = 0.0
    cutoff: float = np.inf

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Return the blur of a scene's lens."""
        optics, pitch = scene.optics, scene.camera.pixel_pitch
        if pitch is None:
            raise InputError("camera.pixel_pitch is missing; a simulated camera needs one")
        across = pitch[1]
        cutoff = np.inf
        if optics.f_number > 0:
            cutoff = across / (optics.wavelength_m * optics.f_number)
        return cls(optics.blur_lines, optics.defocus_m / across, cutoff)

    @property
    def margin(self) -> int:
        """Lines beyond its own from which a pixel takes light."""
        # beyond t lines diffraction throws 2 / (pi^2 cutoff t) of the light
        tail = 2.0 / (np.pi**2 * self.cutoff * _TAIL)
        return int(np.ceil(_BLUR_REACH * self.gaussian + self.disc + tail))


def pixel_response(offset_lines: ArrayLike, blur: Blur) -> Floats:
    """Return how much a pixel takes of light that falls `offset_lines` from its centre.

    One line high, blurred by the lens; its integral is 1. The lens blur stands here and nowhere
    else. Across the columns there is none: it would not move a nearly level line.

    Parameters
    ----------
    offset_lines : array_like
        Distance from the pixel's centre [...] [field lines].
    blur : Blur
        The lens's.
    """
    offset = np.asarray(offset_lines, dtype=np.float64)
    if blur.disc or np.isfinite(blur.cutoff):
        places, response, _ = _table(blur)
        return np.asarray(np.interp(offset, places, response, left=0.0, right=0.0))
    if blur.gaussian == 0.0:
        return np.where(np.abs(offset) < 0.5, 1.0, 0.0)
    high, low = (offset + 0.5) / blur.gaussian, (offset - 0.5) / blur.gaussian
    return np.asarray(ndtr(high) - ndtr(low))


def edge_response(offset_lines: ArrayLike, blur: Blur) -> Floats:
    """Return the part of a pixel's response beyond an edge `offset_lines` before its centre.

    The integral of `pixel_response` from minus infinity to `offset_lines` [...].
    """
    offset = np.asarray(offset_lines, dtype=np.float64)
    if blur.disc or np.isfinite(blur.cutoff):
        places, _, edge = _table(blur)
        return np.asarray(np.interp(offset, places, edge, left=0.0, right=1.0))
    if blur.gaussian == 0.0:
        return np.clip(offset + 0.5, 0.0, 1.0)

    def ramp(t: Floats) -> Floats:
        return np.asarray(t * ndtr(t) + np.exp(-0.5 * t * t) / np.sqrt(2.0 * np.pi))

    high, low = (offset + 0.5) / blur.gaussian, (offset - 0.5) / blur.gaussian
    return blur.gaussian * (ramp(high) - ramp(low))


@lru_cache(maxsize=8)
def _table(blur: Blur) -> tuple[Floats, Floats, Floats]:
    """Return places, the response there and its integral, for a lens that is more than Gaussian.

    The spread of a line of light has a section of the optical transfer function as its spectrum:
    of a disc 2 J1(x) / x with x = 2 pi radius frequency, of a circular pupil in focus
    2 (acos s - s sqrt(1 - s^2)) / pi with s the frequency over its cutoff (Goodman, Introduction
    to Fourier Optics, section 6.4).
    """
    reach = blur.margin + 1
    places = (np.arange(2 * reach * _FINE + 1) - reach * _FINE) / _FINE
    plain = np.diff(
        edge_response(np.append(places, places[-1] + 1 / _FINE) - 0.5 / _FINE, Blur(blur.gaussian))
    )
    frequency = np.fft.rfftfreq(places.size, 1 / _FINE)
    argument = 2 * np.pi * blur.disc * frequency
    defocus = np.where(argument > 0, 2 * j1(argument) / np.maximum(argument, 1e-300), 1.0)
    s = np.minimum(frequency / blur.cutoff, 1.0)
    diffraction = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s**2))
    response = np.fft.irfft(np.fft.rfft(plain) * defocus * diffraction, places.size)
    response = np.maximum(response, 0.0)
    response *= _FINE / response.sum()
    edge = np.concatenate([[0.0], np.cumsum(response[1:] + response[:-1]) / (2 * _FINE)])
    return places, response, edge / edge[-1]


def integrate_lines(fine: NDArray[np.floating], *, subsamples: int, blur: Blur) -> Floats:
    """Integrate an image that is finely sampled in v over the pixels' response.

    Parameters
    ----------
    fine : ndarray
        Radiance, `subsamples` evenly spaced samples a line, with `blur.margin` lines more than the
        result has at either end [..., fine row, column].
    subsamples : int
        Samples a line.
    blur : Blur
        The lens's.

    Returns
    -------
    ndarray
        Integrated radiance [..., row, column].
    """
    span = 1 + 2 * blur.margin
    offset = (np.arange(span * subsamples) + 0.5) / subsamples - 0.5 * span
    weights = pixel_response(offset, blur)
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
    points, normals = body_hits(scene.body, pose, camera.centre_m, rays)
    profile = np.nan_to_num(radiance(scene, points, normals, camera.centre_m))
    blur = Blur.of(scene)
    reach = blur.margin + 0.5
    kernel = pixel_response(np.arange(-reach, reach + 0.025, 0.05), blur)
    kernel /= kernel.sum()
    brightest = max(np.convolve(each, kernel, mode="same").max() for each in profile.T)
    return float((sensor.peak_level - sensor.black_level) / brightest)


def _undistorted_line(camera: Pinhole, points: Floats) -> Floats:
    seen = (points - camera.centre_m) @ camera.rotation
    return np.asarray(camera.v0 - camera.fy * seen[..., 2] / seen[..., 1])


def _undistorted_rays(camera: Pinhole, columns: Floats, lines: Floats) -> Floats:
    x, y = np.broadcast_arrays((columns - camera.u0) / camera.fx, (lines - camera.v0) / camera.fy)
    return np.asarray(np.stack([x, np.ones_like(x), -y], axis=-1) @ camera.rotation.T)


def lens_falloff(scene: Scene, *, parity: int = 0) -> Floats:
    """Return the light that the lens lets through over that on its axis [row, column].

    The fourth power of the cosine of the angle to the optical axis, to the power of
    `Optics.vignetting`.
    """
    camera = Pinhole.of(scene)
    across = (window_columns(scene) - camera.u0) / camera.fx
    down = (window_lines(scene, parity=parity) - camera.v0) / camera.fy
    cosine2 = 1.0 / (1.0 + across**2 + down[:, None] ** 2)
    return np.asarray(cosine2 ** (2.0 * scene.optics.vignetting))
