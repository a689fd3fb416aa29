"""Line profiles in closed form: grey level of the line across its width, integrated over pixels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

__all__ = ["Profile"]

_Array = NDArray[np.float64]


@dataclass(frozen=True)
class Profile:
    """A sum of Gaussians, each possibly drawn out to a flat top.

    Attributes
    ----------
    weight, offset, sigma, top : tuple of float
        Area share, offset from the centre, standard deviation and half the width of the flat top
        of each part [lines].
    """

    weight: tuple[float, ...]
    offset: tuple[float, ...]
    sigma: tuple[float, ...]
    top: tuple[float, ...]

    @classmethod
    def gaussian(cls, sigma: float) -> "Profile":
        """Return a Gaussian of unit area."""
        return cls((1.0,), (0.0,), (sigma,), (0.0,))

    @classmethod
    def skewed(cls, sigma: float, skew: float) -> "Profile":
        """Return a Gaussian with a wider one on one side of it."""
        return cls((0.7, 0.3), (0.0, skew * sigma), (sigma, 1.6 * sigma), (0.0, 0.0))

    @classmethod
    def skirted(cls, sigma: float) -> "Profile":
        """Return a Gaussian on a wide, low skirt."""
        return cls((0.75, 0.25), (0.0, 0.0), (sigma, 3.0 * sigma), (0.0, 0.0))

    @classmethod
    def flat(cls, sigma: float, top: float) -> "Profile":
        """Return a band with soft edges."""
        return cls((1.0,), (0.0,), (sigma,), (top,))

    @property
    def reach(self) -> float:
        """Distance from the centre beyond which nothing is left [lines]."""
        return max(abs(o) + 6 * s + t for o, s, t in self._extents())

    @property
    def body(self) -> float:
        """Distance from the centre that holds the line proper [lines]."""
        _, sigma, top = self._extents()[0]
        return 2.5 * sigma + top

    @property
    def height(self) -> float:
        """Height at the centre of a line of unit area."""
        return float(self.density(np.zeros(1))[0])

    def _extents(self) -> list[tuple[float, float, float]]:
        return list(zip(self.offset, self.sigma, self.top, strict=True))

    def share(self, low: _Array) -> _Array:
        """Area between each `low` and one line further [share of the whole]."""
        return self._integral(low + 1) - self._integral(low)

    def _integral(self, x: _Array) -> _Array:
        total = np.zeros_like(x)
        for weight, offset, sigma, top in zip(
            self.weight, self.offset, self.sigma, self.top, strict=True
        ):
            t = x - offset
            if top == 0:
                total += weight * ndtr(t / sigma)
            else:
                total += weight * (_ramp(t + top, sigma) - _ramp(t - top, sigma)) / (2 * top)
        return total

    def density(self, x: _Array) -> _Array:
        """Height at a distance from the centre, for unit area [1 / line]."""
        total = np.zeros_like(x)
        for weight, offset, sigma, top in zip(
            self.weight, self.offset, self.sigma, self.top, strict=True
        ):
            t = x - offset
            if top == 0:
                total += weight * _bell(t / sigma) / sigma
            else:
                total += weight * (ndtr((t + top) / sigma) - ndtr((t - top) / sigma)) / (2 * top)
        return total


def _bell(t: _Array) -> _Array:
    bell: _Array = np.exp(-0.5 * t * t) / np.sqrt(2 * np.pi)
    return bell


def _ramp(t: _Array, sigma: float) -> _Array:
    """Integral of the normal distribution function."""
    ramp: _Array = t * ndtr(t / sigma) + sigma * _bell(t / sigma)
    return ramp
