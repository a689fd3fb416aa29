"""Fields of a scene, and what its truth says of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.bound import centre_information, pixel_variance, slope_std_bound
from torture.scene import Scene

__all__ = ["Truth", "render", "truth_of"]

_Array = NDArray[np.float64]

_LEAST_SHARE = 0.6  # of the measured columns in which the line must be in view
_LARGEST_BOUND = 0.02  # deg: per field, beyond which nobody could measure well
_LEAST_CONTRAST = 6.0  # peak over the background's noise, texture included
_WHITE = 255.0


@dataclass(frozen=True)
class Truth:
    """What is known of the stored fields.

    Attributes
    ----------
    angle_deg : ndarray, shape (field,)
        True angle [deg]; NaN where the line is not in view at all.
    measurable : ndarray of bool, shape (field,)
        Whether the line is in view in at least 60 % of the measured columns, a field's
        Cramer-Rao bound is at most 0.02 deg, the peak at least 6 times the background's noise,
        and no fault of the recording is owed a flag.
    """

    angle_deg: _Array
    measurable: NDArray[np.bool_]


def render(scene: Scene, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return the stored fields of a scene [field, line, column]."""
    stored = np.empty((len(scene.order), scene.lines, scene.columns), np.uint8)
    done: dict[int, int] = {}
    for i, k in enumerate(scene.order):
        if int(k) in done:  # the same field once more, to the bit
            stored[i] = stored[done[int(k)]]
            continue
        done[int(k)] = i
        image = _without_noise(scene, int(k))
        variance = np.maximum(image, 0) / scene.electrons_per_grey + scene.read_noise**2
        noise = rng.standard_normal(image.shape, dtype=np.float32)
        image = image + noise * np.sqrt(variance)
        for layer in scene.fixed:
            image = np.where(np.isnan(layer), image, layer)
        stored[i] = np.clip(np.rint(image), 0, _WHITE)
    return stored


def _without_noise(scene: Scene, k: int) -> _Array:
    image = scene.background.copy()
    centre = scene.centre(k)
    bright = scene.peak * scene.over_fields[k] * scene.over_columns
    image += scene.sign * _line(scene, centre, bright)
    for offset, ratio in scene.second:
        image += scene.sign * _line(scene, centre + offset, ratio * bright)
    if scene.mark is not None:
        row, where = scene.mark
        at = row + scene.camera_row[k] - 0.5 * scene.parity[k] + scene.camera_slope[k] * scene.u
        band = np.zeros(scene.columns)
        band[where] = 120.0
        image += _line(scene, at, band)
    return image


def _line(scene: Scene, centre: _Array, bright: _Array) -> _Array:
    """Grey levels of a line, pixel-integrated; `bright` is its height in each column."""
    reach = int(np.ceil(scene.profile.reach)) + 1
    pad = 2 * reach + 2
    middle = np.clip(np.rint(centre), -reach - 1, scene.lines + reach).astype(np.int64)
    rows = middle + np.arange(-reach, reach + 1)[:, None]
    canvas = np.zeros((scene.lines + 2 * pad, scene.columns))
    height = scene.profile.share(rows - 0.5 - centre) / scene.profile.height
    canvas[rows + pad, np.arange(scene.columns)] = bright * height
    return canvas[pad : pad + scene.lines]


def truth_of(scene: Scene, columns: NDArray[np.int64]) -> Truth:
    """Return the truth of the stored fields, for a measurement in the given columns."""
    bounds = {int(k): _seen(scene, int(k), columns) for k in np.unique(scene.order)}
    share = np.array([bounds[int(k)][0] for k in scene.order])
    bound = np.array([bounds[int(k)][1] for k in scene.order])
    noise = np.hypot(np.hypot(scene.read_noise, scene.texture), _shot(scene))
    contrast = scene.peak * scene.over_fields[scene.order] * np.median(scene.over_columns) / noise
    measurable = (share >= _LEAST_SHARE) & (bound <= _LARGEST_BOUND)
    return Truth(
        angle_deg=np.where(share > 0, scene.angle_deg[scene.shows], np.nan),
        measurable=measurable & (contrast >= _LEAST_CONTRAST) & (scene.owed == 0),
    )


def _shot(scene: Scene) -> float:
    return float(np.sqrt(np.median(scene.background) / scene.electrons_per_grey))


def _seen(scene: Scene, k: int, columns: NDArray[np.int64]) -> tuple[float, float]:
    """Share of the columns with the line in view, and the bound on the angle's noise [deg]."""
    centre = scene.centre(k)[columns]
    body = scene.profile.body
    inside = (centre > body - 0.5) & (centre < scene.lines - 0.5 - body)
    partly = (centre > -0.5) & (centre < scene.lines - 0.5)
    if inside.sum() < 3:
        return 1e-9 * float(partly.sum() > 0), np.inf
    grey = _without_noise(scene, k)[:, columns[inside]]
    low = np.arange(scene.lines)[:, None] - 0.5 - centre[inside]
    bright = scene.peak * scene.over_fields[k] * scene.over_columns[columns[inside]]
    gradient = scene.profile.density(low) - scene.profile.density(low + 1)
    gradient *= bright / scene.profile.height * (grey < _WHITE)
    variance = pixel_variance(
        grey,
        read_noise=np.hypot(scene.read_noise, scene.texture),
        electrons_per_grey=scene.electrons_per_grey,
    )
    information = centre_information(gradient, variance)
    if not information.sum() > 0:
        return 1e-9, np.inf
    slope = (scene.slope[k] + scene.camera_slope[k]) * scene.aspect
    std = slope_std_bound(information, columns[inside]) * scene.aspect / (1 + slope**2)
    return float(inside.mean()), float(np.degrees(std))
