"""Circular targets in an image: found, and measured by the weighted centroid.

The image of a disc is an ellipse, and under perspective the ellipse's centre is not the image of
the disc's centre; `ellipse_correction` gives the difference where radius and plane are known.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.targets._blobs import find_blobs
from calibration.targets._patch import Outline, Patch, Scatter, inside, measure_patch, outline_of
from glint_aoa.errors import CalibrationError
from glint_aoa.geometry import distort, pixel_coordinates, rotation_matrix
from glint_aoa.optical.noise import ROUNDING, NoiseModel
from glint_aoa.setup import Camera

__all__ = ["TargetImages", "ellipse_correction", "find_targets"]

Floats = NDArray[np.float64]

_LEAST_MARGIN = 1.0  # pixels
_LEAST_FREEDOM = 12  # of the discs' middles, to tell shot noise by
_CORNERS = 64  # of the outline of a distorted ellipse
_LEAST_SIDE = 8  # pixels


@dataclass(frozen=True, eq=False)
class TargetImages:
    """Circular targets as an image shows them, by rows and then columns.

    Attributes
    ----------
    u, v : ndarray, shape (target,)
        Weighted centroid: column and row from 0 at the first pixel's centre [pixels].
    covariance : ndarray, shape (target, 2, 2)
        Covariance of u and v from noise and sampling [pixels^2].
    semi_axes : ndarray, shape (target, 2)
        Major and minor semi-axis of the outline at half height [pixels].
    angle : ndarray, shape (target,)
        From +u to the major axis, towards +v [rad].
    contrast : ndarray, shape (target,)
        Height above the background; negative for dark targets [grey levels].
    clipped : ndarray of bool, shape (target,)
        Whether pixels of the target clip; it is then not a weighted centroid any more, and the
        stated covariance does not hold.
    noise : NoiseModel
        The pixels' noise that the covariance comes from.
    """

    u: Floats
    v: Floats
    covariance: Floats
    semi_axes: Floats
    angle: Floats
    contrast: Floats
    clipped: NDArray[np.bool_]
    noise: NoiseModel

    def __len__(self) -> int:
        """Return the number of targets."""
        return int(self.u.size)

    def take(self, which: ArrayLike) -> "TargetImages":
        """Return the targets that an index or mask names."""
        index = np.asarray(which)
        return TargetImages(
            self.u[index],
            self.v[index],
            self.covariance[index],
            self.semi_axes[index],
            self.angle[index],
            self.contrast[index],
            self.clipped[index],
            self.noise,
        )


def find_targets(
    image: ArrayLike,
    *,
    polarity: Literal["bright", "dark"] = "bright",
    min_diameter: float = 4.0,
    max_diameter: float = 60.0,
    max_axis_ratio: float = 4.0,
    min_contrast: float = 10.0,
    margin: float = 3.0,
    noise: NoiseModel | None = None,
    saturation: float | None = None,
) -> TargetImages:
    r"""Find the circular targets of an image and measure their weighted centroids.

    .. math:: \hat c = \frac{\sum_i w_i c_i (I_i - B_i)}{\sum_i w_i (I_i - B_i)}

    over the pixels of a window `margin` wider than the target, whose weights w fade over its last
    pixel, with B a plane through the background around it.

    Parameters
    ----------
    image : array_like, shape (row, column)
        Grey levels.
    polarity : {"bright", "dark"}, optional
        Whether targets are brighter or darker than their background.
    min_diameter, max_diameter : float, optional
        Limits of the diameter of a circle of the target's area [pixels].
    max_axis_ratio : float, optional
        Greatest ratio of the axes in pixels; a disc seen squarely has 2.35 on pixels of
        11.7 x 27.5 um.
    min_contrast : float, optional
        Least contrast, in noise of the background.
    margin : float, optional
        How far the window reaches beyond the half height [pixels]; less where a neighbour is
        near. The lens must not blur further than that.
    noise : NoiseModel, optional
        The camera's noise. By default its growth with the grey level is taken from the
        backgrounds and the middles of the targets in this image; texture of the targets then
        counts as noise.
    saturation : float, optional
        Grey level at which pixels clip. By default the top of the least number of bits that
        holds the image, 8 or more.

    Returns
    -------
    TargetImages
        None, one or more targets. A target that the image's edge cuts is not among them, nor a
        mark whose outline is no ellipse.

    Raises
    ------
    CalibrationError
        If the image is not two-dimensional, not finite or too small, or an option cannot be.

    Notes
    -----
    The centroid of evenly lit discs is unbiased as long as the window holds all of their light:
    below 0.01 pixel from 5 pixels across, pixel locking included, measured on area-integrated
    discs. A target that is lit unevenly, dirty or in shadow is off by its first moment of
    brightness, and no covariance shows it. Under perspective see `ellipse_correction`.
    The covariance holds the pixels' noise, directly and by the background, and what sampling
    does to a small and sharp disc. Light that the lens blurs beyond the window counts as noise of
    the background: it is too large then, up to fourfold in means of many fields.
    The method is that of video model deformation (A. W. Burner and T. Liu, "Videogrammetric
    model deformation measurement technique", J. Aircraft 38(4), 2001, doi:10.2514/2.2826).
    """
    grey, whole = _checked_image(image)
    diameters = min_diameter, max_diameter
    _check_options(polarity, diameters, max_axis_ratio, min_contrast, margin)
    sign = 1.0 if polarity == "bright" else -1.0
    least = min_contrast * _background_noise(grey, whole)
    blobs = find_blobs(
        sign * grey,
        diameters=diameters,
        max_axis_ratio=max_axis_ratio,
        least_height=least,
    )
    patches = [
        each
        for each in _patches(grey, [outline_of(blob) for blob in blobs], sign, margin)
        if min_diameter / 2 <= np.sqrt(each.outline.semi_axes.prod()) <= max_diameter / 2
        and each.outline.semi_axes[0] <= max_axis_ratio * each.outline.semi_axes[1]
        and sign * each.height >= least
    ]
    patches.sort(key=lambda each: (each.centroid[1], each.centroid[0]))
    top = saturation if saturation is not None else _top_level(grey)
    model = noise or _noise_of(patches, rounded=whole, saturation=top)
    return _collected(patches, model, top)


def ellipse_correction(
    centre: ArrayLike, normal: ArrayLike, radius: ArrayLike, *, camera: Camera
) -> tuple[Floats, Floats]:
    r"""Return how far the centre of a disc's image lies from the image of the disc's centre.

    The image of a circle is the conic :math:`C = H^{-T} \mathrm{diag}(1, 1, -r^2) H^{-1}`, with H
    the homography of the disc's plane. The ellipse's centre is the pole of the image's line at
    infinity, a column of the dual conic: for a disc of centre c, unit normal n and radius r in
    camera axes, y along the optical axis, it lies in the direction

    .. math:: c \, c_y - r^2 (\hat y - n \, n_y)

    Parameters
    ----------
    centre : array_like, shape (target, 3)
        Centres of the discs in the tunnel frame [m].
    normal : array_like, shape (3,) or (target, 3)
        Normals of their planes, of any length and either sign.
    radius : float or array_like, shape (target,)
        Their radii [m]; 0 where there is nothing to correct.
    camera : Camera
        An oriented camera.

    Returns
    -------
    du, dv : ndarray, shape (target,)
        What to subtract from the measured centroid [pixels].

    Raises
    ------
    CalibrationError
        If the camera has no place in the tunnel.

    Notes
    -----
    J. Heikkila and O. Silven, "A four-step camera calibration procedure with implicit image
    correction", CVPR 1997, doi:10.1109/CVPR.1997.609468, give the effect. What distortion
    adds is taken from the centroid of the ellipse's distorted outline.
    """
    if camera.position is None or camera.focal_length is None or camera.pixel_pitch is None:
        raise CalibrationError(
            "the camera has no place in the tunnel; give focal_length, pixel_pitch and position "
            "in [camera] to correct for perspective"
        )
    points = np.atleast_2d(np.asarray(centre, np.float64))
    normals = np.broadcast_to(np.asarray(normal, np.float64), points.shape)
    radii = np.broadcast_to(np.asarray(radius, np.float64), points.shape[:1])
    to_camera = rotation_matrix(*camera.rotation).T
    disc = (points - np.asarray(camera.position)) @ to_camera.T
    across = (normals / np.linalg.norm(normals, axis=1, keepdims=True)) @ to_camera.T
    ellipse = _projected_ellipse(disc, across, radii)
    true = _pixels(disc[:, ::2] / disc[:, 1:2], camera)
    seen = _centroid(ellipse, camera) if any(camera.distortion) else _pixels(ellipse[0], camera)
    return seen[:, 0] - true[:, 0], seen[:, 1] - true[:, 1]


def _projected_ellipse(disc: Floats, normal: Floats, radius: Floats) -> tuple[Floats, Floats]:
    """Centre [target, 2] and matrix [target, 2, 2] of the ideal image, at unit distance.

    The matrix has the squared semi-axes as its eigenvalues.
    """
    in_plane = np.eye(3) - normal[:, :, None] * normal[:, None]
    dual = radius[:, None, None] ** 2 * in_plane - disc[:, :, None] * disc[:, None]
    dual = dual / dual[:, 1:2, 1:2]
    centre = dual[:, ::2, 1]
    return centre, centre[:, :, None] * centre[:, None] - dual[:, ::2, ::2]


def _centroid(ellipse: tuple[Floats, Floats], camera: Camera) -> Floats:
    """Centroid of the area that a distorted ellipse covers [pixels], by Green's theorem."""
    centre, matrix = ellipse
    squares, directions = np.linalg.eigh(matrix)
    t = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    unit = np.stack([np.cos(t), np.sin(t)], axis=-1)
    axes = directions * np.sqrt(np.maximum(squares, 0.0))[:, None]
    edge = _pixels(centre[:, None] + unit @ axes.transpose(0, 2, 1), camera)
    middle = edge.mean(axis=1)
    one = edge - middle[:, None]
    other = np.roll(one, -1, axis=1)
    cross = one[..., 0] * other[..., 1] - other[..., 0] * one[..., 1]
    area = cross.sum(axis=1, keepdims=True) / 2
    moment = ((one + other) * cross[..., None]).sum(axis=1) / 6
    centroid: Floats = middle + moment / np.where(area == 0, 1.0, area)
    return centroid


def _pixels(ideal: Floats, camera: Camera) -> Floats:
    """Pixels [..., 2], from the principal point, of ideal points x, z at unit distance."""
    focal, pitch = camera.focal_length or 1.0, camera.pixel_pitch or (1.0, 1.0)
    x, z = distort(
        focal * ideal[..., 0],
        focal * ideal[..., 1],
        focal_length=focal,
        distortion=camera.distortion,
    )
    u, v = pixel_coordinates(x, z, principal_point=(0.0, 0.0), pixel_pitch=pitch)
    return np.stack([u, v], axis=-1)


def _checked_image(image: ArrayLike) -> tuple[Floats, bool]:
    """Return the image as float64, and whether its grey levels are whole numbers."""
    given = np.asarray(image)
    if given.ndim != 2 or min(given.shape) < _LEAST_SIDE:
        raise CalibrationError(
            f"an image of shape {list(given.shape)} cannot be searched for targets; give one grey "
            f"image [row, column] of {_LEAST_SIDE} x {_LEAST_SIDE} pixels or more"
        )
    grey = given.astype(np.float64)
    if not np.isfinite(grey).all():
        raise CalibrationError("the image holds values that are not finite; give grey levels")
    return grey, bool((grey == np.rint(grey)).all())


def _check_options(
    polarity: str, diameters: tuple[float, float], ratio: float, contrast: float, margin: float
) -> None:
    if polarity not in {"bright", "dark"}:
        raise CalibrationError(f'polarity is {polarity!r}; give "bright" or "dark"')
    low, high = diameters
    if not 2 <= low < high:
        raise CalibrationError(
            f"targets of {low:g} to {high:g} pixels across cannot be measured; give min_diameter "
            "of 2 pixels or more, and max_diameter greater than it"
        )
    for name, value, least in (
        ("max_axis_ratio", ratio, 1.0),
        ("min_contrast", contrast, 1.0),
        ("margin", margin, _LEAST_MARGIN),
    ):
        if not value >= least:
            raise CalibrationError(f"{name} is {value:g}; give {least:g} or more")


def _background_noise(grey: Floats, whole: bool) -> float:
    """Noise of most pixels, from what no smooth image has [grey levels]."""
    across = grey[:, :-2] - 2 * grey[:, 1:-1] + grey[:, 2:]
    both = across[:-2] - 2 * across[1:-1] + across[2:]
    least = np.sqrt(ROUNDING) if whole else 1e-6 * float(np.ptp(grey)) + 1e-12
    return max(1.4826 * float(np.median(np.abs(both))) / 6, float(least))


def _patches(grey: Floats, outlines: list[Outline], sign: float, margin: float) -> list[Patch]:
    """Measure what the outlines hold, the light of the others left out of each background."""
    margins = _margins(outlines, margin)
    owner = np.zeros(grey.shape, np.int32)
    for number, (outline, own) in enumerate(zip(outlines, margins, strict=True), start=1):
        box = _box(outline, own, grey.shape)
        v, u = (axis.astype(np.float64) for axis in np.mgrid[box])
        owner[box][inside(u, v, outline, own)] = number
    found = (
        measure_patch(grey, outline, sign=sign, margin=own, owner=owner, number=number)
        for number, (outline, own) in enumerate(zip(outlines, margins, strict=True), start=1)
    )
    return [each for each in found if each is not None]


def _box(outline: Outline, margin: float, shape: tuple[int, ...]) -> tuple[slice, slice]:
    reach = outline.half_extent(margin) + 1
    low = np.maximum(np.floor(outline.centre - reach), 0).astype(int)
    high = np.minimum(np.ceil(outline.centre + reach) + 1, shape[::-1]).astype(int)
    return np.s_[low[1] : high[1], low[0] : high[0]]


def _margins(outlines: list[Outline], margin: float) -> Floats:
    """Half the gap to the nearest neighbour where that is less than `margin` [pixels]."""
    if len(outlines) < 2:
        return np.full(len(outlines), margin)
    centres = np.array([each.centre for each in outlines])
    axes = np.array([each.directions / each.semi_axes[:, None] for each in outlines])
    apart = centres - centres[:, None]
    distance = np.linalg.norm(apart, axis=2)
    # Along the line to the other centre an ellipse reaches distance / |scaled line|.
    scaled = np.linalg.norm(np.einsum("ikl,ijl->ijk", axes, apart), axis=2)
    reach = distance / np.where(scaled > 0, scaled, 1.0)
    gap = distance - reach - reach.T
    np.fill_diagonal(gap, np.inf)
    margins: Floats = np.clip(gap.min(axis=1) / 2, _LEAST_MARGIN, margin)
    return margins


def _top_level(grey: Floats) -> float:
    bits = max(math.ceil(grey.max()).bit_length(), 8)
    return float((1 << bits) - 1)


def _noise_of(patches: Sequence[Patch], *, rounded: bool, saturation: float) -> NoiseModel:
    """Variance against grey level, from backgrounds and from the middles of the discs."""
    least = ROUNDING if rounded else 0.0
    around = _pooled([each.background for each in patches])
    middle = _pooled([each.middle for each in patches])
    if middle.freedom < _LEAST_FREEDOM:
        variance = max(around.variance, least)
        return NoiseModel(variance, 0.0, around.level, saturation, "background")
    growth = (middle.variance - around.variance) / (middle.level - around.level)
    growth = max(growth, 0.0)  # what a darker disc's middle has more is its blurred edge
    black = min(around.level, middle.level)
    read = around.variance - growth * (around.level - black)
    return NoiseModel(max(read, least), growth, black, saturation, "stack")


def _pooled(scatters: Sequence[Scatter]) -> Scatter:
    freedom = sum(each.freedom for each in scatters)
    level = sum(each.level * each.freedom for each in scatters) / max(freedom, 1)
    return Scatter(sum(each.squares for each in scatters), freedom, level)


def _collected(patches: Sequence[Patch], noise: NoiseModel, top: float) -> TargetImages:
    centroid = np.array([each.centroid for each in patches]).reshape(-1, 2)
    return TargetImages(
        u=centroid[:, 0],
        v=centroid[:, 1],
        covariance=np.array([each.covariance(noise) for each in patches]).reshape(-1, 2, 2),
        semi_axes=np.array([each.outline.semi_axes for each in patches]).reshape(-1, 2),
        angle=np.array([each.outline.angle for each in patches], np.float64),
        contrast=np.array([each.height for each in patches], np.float64),
        clipped=np.array([(each.grey >= top).any() for each in patches], np.bool_),
        noise=noise,
    )
