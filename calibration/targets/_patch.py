"""One circular target: its background, outline, weighted centroid and what noise does to it."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage import measure

from calibration.targets._blobs import Blob
from glint_aoa.optical.noise import NoiseModel

__all__ = ["Outline", "Patch", "Scatter", "inside", "measure_patch", "outline_of"]

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_RING = 4.0  # pixels of background around the window
_SOFT = 1.0  # pixels over which a window fades
_EDGE = 1.5  # pixels within the outline from which the disc counts as evenly bright
_LEAST_RING = 12  # pixels that a plane is fitted to
_LEAST_BENT = 14  # pixels of the disc's middle from which it may be tilted and bent
_CLIP = 3.5  # standard deviations beyond which a pixel is not background
_ROUNDS = 3
_DEPARTURE = (0.12, 0.03)  # rms of the outline from an ellipse: pixels, and part of the radius


@dataclass(frozen=True)
class Outline:
    """An ellipse in pixels.

    Attributes
    ----------
    centre : ndarray, shape (2,)
        Column and row [pixels].
    semi_axes : ndarray, shape (2,)
        Major, then minor semi-axis [pixels].
    angle : float
        From +u to the major axis, towards +v [rad].
    """

    centre: Floats
    semi_axes: Floats
    angle: float

    @property
    def directions(self) -> Floats:
        """Unit vectors of the major and minor axis, as rows, shape (2, 2)."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        return np.array([[cos, sin], [-sin, cos]])

    def half_extent(self, margin: float) -> Floats:
        """Half width and half height of its box, `margin` added to both semi-axes [pixels]."""
        extent: Floats = np.linalg.norm(
            (self.semi_axes + margin)[:, None] * self.directions, axis=0
        )
        return extent


@dataclass(frozen=True)
class Scatter:
    """Sum of squared residuals [grey^2], its degrees of freedom, and the mean level [grey]."""

    squares: float
    freedom: int
    level: float

    @property
    def variance(self) -> float:
        """Mean square [grey^2]."""
        return self.squares / max(self.freedom, 1)


@dataclass(frozen=True)
class Patch:
    """A measured target.

    Attributes
    ----------
    outline : Outline
        Ellipse at half height; its centre is not the centroid.
    centroid : ndarray, shape (2,)
        Weighted centroid, column and row [pixels].
    height : float
        Height above the background; below 0 for a dark target [grey levels].
    sensitivity : ndarray, shape (2, pixel)
        Change of the centroid with each pixel of the window [pixels / grey level].
    grey : ndarray, shape (pixel,)
        Grey levels there.
    of_background : ndarray, shape (2, 2)
        Covariance of the centroid for a background whose pixels vary by 1 grey level [pixels^2].
    of_sampling : ndarray, shape (2,)
        Variance of u and v from the place of the disc's edge among the pixels [pixels^2].
    background, middle : Scatter
        What is left of the background, and of the disc's middle, after a smooth surface.
    """

    outline: Outline
    centroid: Floats
    height: float
    sensitivity: Floats
    grey: Floats
    of_background: Floats
    of_sampling: Floats
    background: Scatter
    middle: Scatter

    def covariance(self, noise: NoiseModel) -> Floats:
        """Covariance of the centroid [pixels^2], shape (2, 2)."""
        own = (self.sensitivity * noise.variance(self.grey)) @ self.sensitivity.T
        around = noise.variance(self.background.level)
        covariance: Floats = own + float(around) * self.of_background
        covariance += np.diag(self.of_sampling)
        return covariance


def outline_of(blob: Blob) -> Outline:
    """Return the ellipse that has a blob's moments."""
    values, vectors = np.linalg.eigh(blob.moments)
    angle = float(np.arctan2(vectors[1, 1], vectors[0, 1]))
    return Outline(blob.centre, 2 * np.sqrt(values[::-1]), angle)


def inside(u: Floats, v: Floats, outline: Outline, margin: float) -> Mask:
    """Whether pixels lie within an ellipse whose semi-axes are longer by `margin`."""
    major, minor = outline.directions
    du, dv = u - outline.centre[0], v - outline.centre[1]
    a, b = np.maximum(outline.semi_axes + margin, 1e-9)
    within: Mask = ((major[0] * du + major[1] * dv) / a) ** 2 + (
        (minor[0] * du + minor[1] * dv) / b
    ) ** 2 <= 1
    return within


def _window(u: Floats, v: Floats, outline: Outline, margin: float) -> Floats:
    """Weight of pixels, from 1 inside to 0 across the edge of an ellipse longer by `margin`.

    A pixel that the edge crosses counts in part: were it in or out, a target's last light would
    draw the centroid with the phase of the pixels.
    """
    du, dv = u - outline.centre[0], v - outline.centre[1]
    axes = (outline.semi_axes + margin)[:, None, None]
    across = np.einsum("kl,lij->kij", outline.directions, np.stack([du, dv])) / axes
    radius = np.maximum(np.hypot(*across), 1e-9)
    steepness = np.maximum(np.hypot(*(across / axes)) / radius, 1e-9)
    weight: Floats = np.clip(0.5 + (1 - radius) / steepness / _SOFT, 0.0, 1.0)
    return weight


def measure_patch(
    image: Floats,
    start: Outline,
    *,
    sign: float,
    margin: float,
    owner: NDArray[np.int32],
    number: int,
) -> Patch | None:
    """Measure the target that `start` outlines.

    Parameters
    ----------
    image : ndarray, shape (row, column)
        Grey levels.
    start : Outline
        Where it is, to a pixel or so.
    sign : float
        +1 for a target brighter than its background, -1 for a darker one.
    margin : float
        How far the window reaches beyond the outline [pixels].
    owner : ndarray, shape (row, column)
        Number of the target in whose window a pixel lies, 0 where in none.
    number : int
        This target's own.

    Returns
    -------
    Patch or None
        None where the window leaves the image, too little background is left or the outline is
        no ellipse.
    """
    cut = _Cut.around(image, start, margin, owner, number)
    outline = None if cut is None else cut.outlined(start, sign)
    if outline is None:
        return None
    cut = _Cut.around(image, outline, margin, owner, number)
    return None if cut is None else cut.measured(outline, sign)


@dataclass(frozen=True)
class _Cut:
    """The part of an image around a target, with its background known."""

    u: Floats
    v: Floats
    grey: Floats
    signal: Floats  # above the background
    margin: float
    taken: Mask
    inverse: Floats  # of the plane's normal equations
    origin: Floats  # of the plane's design
    background: Scatter

    @classmethod
    def around(
        cls,
        image: Floats,
        outline: Outline,
        margin: float,
        owner: NDArray[np.int32],
        number: int,
    ) -> "_Cut | None":
        window = outline.half_extent(margin)
        size = np.array(image.shape[::-1])
        if (outline.centre - window < 0).any() or (outline.centre + window > size - 1).any():
            return None
        reach = outline.half_extent(margin + _RING) + 1
        low = np.maximum(np.floor(outline.centre - reach), 0).astype(int)
        high = np.minimum(np.ceil(outline.centre + reach) + 1, size).astype(int)
        box = np.s_[low[1] : high[1], low[0] : high[0]]
        v, u = (axis.astype(np.float64) for axis in np.mgrid[box])
        taken = (owner[box] > 0) & (owner[box] != number)
        ring = ~inside(u, v, outline, margin) & inside(u, v, outline, margin + _RING) & ~taken
        if ring.sum() < _LEAST_RING:
            return None
        design = _plane(u[ring], v[ring], outline.centre)
        fitted = _robust_plane(design, image[box][ring])
        if fitted is None:
            return None
        plane, inverse, scatter = fitted
        grey = image[box]
        signal = grey - _plane(u, v, outline.centre) @ plane
        return cls(u, v, grey, signal, margin, taken, inverse, outline.centre, scatter)

    def middle(self, outline: Outline) -> Mask:
        # Lens blur is round in space as the disc is, so on oblong pixels both are longer one way.
        part = max(1 - _EDGE / float(outline.semi_axes[1]), 0.0)
        return inside(self.u, self.v, replace(outline, semi_axes=part * outline.semi_axes), 0.0)

    def height(self, outline: Outline, sign: float) -> float:
        middle = self.middle(outline)
        if middle.sum() >= 4:
            return float(self.signal[middle].mean())
        smooth = cv2.GaussianBlur(self.signal, (0, 0), 0.5)
        return sign * float((sign * smooth)[inside(self.u, self.v, outline, 0.0)].max())

    def outlined(self, outline: Outline, sign: float) -> Outline | None:
        """Ellipse through the contour at half height; None if the contour is no ellipse."""
        height = self.height(outline, sign)
        if not sign * height > 0:
            return None
        contours = measure.find_contours(sign * self.signal, sign * height / 2)
        corner = np.array([self.u[0, 0], self.v[0, 0]])
        around = [
            line[:, ::-1] + corner
            for line in contours
            if line.shape[0] >= 8 and (line[0] == line[-1]).all()
        ]
        around = [line for line in around if measure.points_in_poly([outline.centre], line)[0]]
        if not around:
            return None
        contour = max(around, key=len)[:-1]
        found = _ellipse_through(contour)
        return found if found is not None and _fits(contour, found) else None

    def measured(self, outline: Outline, sign: float) -> Patch | None:
        weight = _window(self.u, self.v, outline, self.margin) * ~self.taken
        window = weight > 0
        points, weight = np.stack([self.u[window], self.v[window]]), weight[window]
        total = weight @ self.signal[window]
        if not sign * total > 0:
            return None
        centroid = points @ (weight * self.signal[window]) / total
        sensitivity = weight * (points - centroid[:, None]) / total
        pull = sensitivity @ _plane(points[0], points[1], self.origin)
        return Patch(
            outline=outline,
            centroid=centroid,
            height=self.height(outline, sign),
            sensitivity=sensitivity,
            grey=self.grey[window],
            of_background=pull @ self.inverse @ pull.T,
            of_sampling=_sampling_variance(outline, self.blur(outline, sign)),
            background=self.background,
            middle=self._middle_scatter(outline),
        )

    def blur(self, outline: Outline, sign: float) -> float:
        """Return the standard deviation of the edge's Gaussian blur, without the pixel's [pixels].

        A blurred step of height 1 has the integral blur / sqrt(pi) of s (1 - s).
        """
        near = _window(self.u, self.v, outline, self.margin) * ~self.taken
        share = np.clip(self.signal / self.height(outline, sign), 0.0, 1.0)
        a, b = outline.semi_axes
        perimeter = np.pi * (3 * (a + b) - np.sqrt((3 * a + b) * (a + 3 * b)))  # Ramanujan's
        whole = np.sqrt(np.pi) * float(np.sum(near * share * (1 - share))) / perimeter
        return float(np.sqrt(max(whole**2 - 1 / 12, 0.0)))

    def _middle_scatter(self, outline: Outline) -> Scatter:
        middle = self.middle(outline)
        count = int(middle.sum())
        if count < 3:
            return Scatter(0.0, 0, 0.0)
        grey = self.grey[middle]
        plane = _plane(self.u[middle], self.v[middle], outline.centre)
        bent = plane[:, [1, 1, 2]] * plane[:, [1, 2, 2]]  # blur still rounds the disc off here
        design = np.hstack([plane, bent]) if count >= _LEAST_BENT else plane[:, :1]
        left = grey - design @ np.linalg.lstsq(design, grey, rcond=None)[0]
        return Scatter(float(left @ left), count - design.shape[1], float(grey.mean()))


def _sampling_variance(outline: Outline, blur: float) -> Floats:
    r"""Variance of u and v of the sampled centroid of a sharp disc [pixels^2], shape (2,).

    Pixels see what a box has averaged. The centroid of the samples departs from the disc's by
    :math:`\hat g(1) / \pi`, where :math:`\hat g(1)` is the disc's spectrum at one cycle a pixel,
    times the sine of its phase: :math:`2 J_1(q) / q \, e^{-2 \pi^2 \sigma^2}` with q = 2 pi times
    its half extent. J1 is taken at its crests.
    """
    q = 2 * np.pi * outline.half_extent(0.0)
    variance: Floats = 4 / (np.pi * q) ** 3 * np.exp(-4 * (np.pi * blur) ** 2)
    return variance


def _plane(u: Floats, v: Floats, centre: Floats) -> Floats:
    return np.stack([np.ones_like(u), u - centre[0], v - centre[1]], axis=-1)


def _robust_plane(design: Floats, grey: Floats) -> tuple[Floats, Floats, Scatter] | None:
    """Plane through the background without what stands out of it.

    Returns its coefficients, the inverse of the normal matrix and what it leaves.
    """
    kept = np.abs(grey - np.median(grey)) <= 4 * max(_spread(grey - np.median(grey)), 1.0)
    for _ in range(_ROUNDS):
        if kept.sum() < _LEAST_RING or (np.ptp(design[kept], axis=0)[1:] < 2).any():
            return None
        inverse = np.asarray(np.linalg.inv(design[kept].T @ design[kept]), np.float64)
        plane = inverse @ design[kept].T @ grey[kept]
        left = grey - design @ plane
        again = np.abs(left) <= _CLIP * max(_spread(left[kept]), 0.5)
        if (again == kept).all():
            break
        kept = again
    left = left[kept]
    freedom = max(left.size - design.shape[1], 1)
    return plane, inverse, Scatter(float(left @ left), freedom, float(grey[kept].mean()))


def _spread(values: Floats) -> float:
    """Return the standard deviation of what scatters about zero, by the median."""
    return 1.4826 * float(np.median(np.abs(values)))


def _ellipse_through(contour: Floats) -> Outline | None:
    middle = contour.mean(axis=0)
    (u, v), axes, degrees = cv2.fitEllipseDirect((contour - middle).astype(np.float32))
    if not np.isfinite([u, v, *axes, degrees]).all() or min(axes) <= 0:
        return None
    angle = np.radians(degrees)
    if axes[0] < axes[1]:
        axes, angle = axes[::-1], angle + np.pi / 2
    return Outline(
        middle + np.array([u, v]),
        np.array(axes) / 2,
        float((angle + np.pi / 2) % np.pi - np.pi / 2),
    )


def _fits(contour: Floats, outline: Outline) -> bool:
    """Whether a contour follows an ellipse; a square's or a corner's does not."""
    across = (contour - outline.centre) @ outline.directions.T / outline.semi_axes
    radius = float(np.sqrt(outline.semi_axes.prod()))
    departure = radius * float(np.sqrt(np.mean((np.linalg.norm(across, axis=1) - 1) ** 2)))
    return departure <= _DEPARTURE[0] + _DEPARTURE[1] * radius
