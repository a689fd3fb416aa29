"""Where circular targets may be: bright blobs of elliptical outline on their own background."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Blob", "find_blobs"]

Floats = NDArray[np.float64]

_BLUR = 0.7  # pixels, against noise
_LEVEL_RATIO = 1.25  # from one threshold to the next
_HALF = (0.5 / 1.2, 0.5 * 1.2)  # of the blob's height, between which a threshold is its half
_LEAST_FILL = 0.80  # area over that of the ellipse of the same moments; 1 for an ellipse
_SIZE_MARGIN = 1.5  # of the diameters; the threshold is only about the half


@dataclass(frozen=True)
class Blob:
    """An ellipse of the same moments as a blob.

    Attributes
    ----------
    centre : ndarray, shape (2,)
        Column and row [pixels].
    moments : ndarray, shape (2, 2)
        Second moments of the area about the centre [pixels^2]; a quarter of the squared
        semi-axes in their own directions.
    height : float
        Height above the background [grey levels].
    """

    centre: Floats
    moments: Floats
    height: float


def find_blobs(
    image: Floats, *, diameters: tuple[float, float], max_axis_ratio: float, least_height: float
) -> list[Blob]:
    """Find bright blobs of elliptical outline, of whatever brightness each.

    Parameters
    ----------
    image : ndarray, shape (row, column)
        Grey levels, targets brighter than what surrounds them.
    diameters : tuple of float
        Least and greatest diameter of a circle of the blob's area [pixels].
    max_axis_ratio : float
        Greatest ratio of the axes.
    least_height : float
        Least height above the background [grey levels].

    Returns
    -------
    list of Blob
        Those that touch no edge of the image, each once, highest first.

    Notes
    -----
    What no square of the greatest diameter fits into is the top hat of the image (Serra, *Image
    Analysis and Mathematical Morphology*, 1982); it is cut at levels that rise by a quarter, and a
    blob is taken at the level that is about half its height.
    """
    flat = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _BLUR)
    size = int(np.ceil(diameters[1])) + 4
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (size, size))
    flat = cv2.morphologyEx(flat, cv2.MORPH_TOPHAT, square, borderType=cv2.BORDER_REPLICATE)
    top = float(flat.max())
    blobs: list[Blob] = []
    level = least_height * _HALF[0]
    while level < top:
        blobs += _blobs_at(flat, level, diameters, max_axis_ratio, least_height)
        level *= _LEVEL_RATIO
    return _each_once(blobs)


def _blobs_at(
    flat: NDArray[np.float32],
    level: float,
    diameters: tuple[float, float],
    max_axis_ratio: float,
    least_height: float,
) -> list[Blob]:
    """Blobs above a level that is about the half of their height."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats((flat > level).astype(np.uint8))
    area = stats[:, cv2.CC_STAT_AREA]
    left, top, width, height = (stats[:, k] for k in range(4))
    inside = (left > 0) & (top > 0)
    inside &= (left + width < flat.shape[1]) & (top + height < flat.shape[0])
    low, high = (
        np.pi / 4 * (diameters[0] / _SIZE_MARGIN) ** 2,
        np.pi / 4 * (diameters[1] * _SIZE_MARGIN) ** 2,
    )
    wanted = np.flatnonzero(inside & (area >= low) & (area <= high))
    blobs = []
    for label in wanted[wanted > 0]:
        box = np.s_[
            top[label] : top[label] + height[label], left[label] : left[label] + width[label]
        ]
        own = labels[box] == label
        peak = float(flat[box][own].max())
        if peak < least_height or not _HALF[0] <= level / peak <= _HALF[1]:
            continue
        blob = _ellipse_of(own, (left[label], top[label]), peak, max_axis_ratio)
        if blob is not None:
            blobs.append(blob)
    return blobs


def _ellipse_of(
    own: NDArray[np.bool_], corner: tuple[int, int], peak: float, max_axis_ratio: float
) -> Blob | None:
    row, column = np.nonzero(own)
    points = np.stack([column, row]).astype(np.float64)
    centre = points.mean(axis=1)
    moments = np.cov(points, bias=True) + np.eye(2) / 12  # a pixel is a square, not a point
    small, large = np.linalg.eigvalsh(moments)
    fill = own.sum() / (4 * np.pi * np.sqrt(small * large))
    if fill < _LEAST_FILL or large > (max_axis_ratio * 1.2) ** 2 * small:
        return None
    return Blob(centre + corner, moments, peak)


def _each_once(blobs: list[Blob]) -> list[Blob]:
    """Keep the highest of those that lie within each other."""
    blobs = sorted(blobs, key=lambda each: -each.height)
    if not blobs:
        return []
    centres = np.array([each.centre for each in blobs])
    inverse = np.linalg.inv([each.moments for each in blobs])
    away = centres[:, None] - centres
    distance = np.einsum("ijk,jkl,ijl->ij", away, inverse, away)  # of i in the ellipse of j
    together = np.minimum(distance, distance.T) < 4
    kept: list[int] = []
    for number, row in enumerate(together):
        if not row[kept].any():
            kept.append(number)
    return [blobs[number] for number in kept]
