"""From pixels to the planes of known Y that a wing's targets lie in."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.targets.find import ellipse_correction
from calibration.twist.sighting import Sightings
from calibration.twist.wing_targets import WingTargets
from glint_aoa.errors import CalibrationError
from glint_aoa.geometry import PixelToPlane
from glint_aoa.setup import Setup

__all__ = ["WingPlanes"]

Floats = NDArray[np.float64]

_STEP = 0.5  # pixels, for derivatives
_LIKELY_SIZE = (0.5, 2.0)  # of a target's image, over what its radius and Y let expect


@dataclass(frozen=True)
class WingPlanes:
    """The planes of known Y of some targets."""

    targets: WingTargets
    index: NDArray[np.int64]
    setup: Setup

    def places(self, uv: Floats) -> Floats:
        """Places [..., target, 2] in the planes of their targets [m]."""
        y = self.targets.y[self.index]
        places = np.empty_like(uv)
        for each in np.unique(y):
            own = y == each
            plane = PixelToPlane.of_camera(
                self.setup.camera, y=float(each), yaw=self.setup.glint.yaw
            )
            places[..., own, :] = np.stack(plane(uv[..., own, 0], uv[..., own, 1]), axis=-1)
        return places

    def mapped(self, uv: Floats) -> tuple[Floats, Floats]:
        """Places [target, 2] in their planes [m], and derivatives [target, 2, 2] by u and v."""
        steps = _STEP * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        here, right, left, down, up = self.places(uv + steps[:, None])
        return here, np.stack([right - left, down - up], axis=-1) / (2 * _STEP)

    def in_space(self, uv: Floats) -> Floats:
        """Places [target, 3] in the tunnel frame [m]."""
        along, height = self.places(uv).T
        yaw = self.setup.glint.yaw
        y = self.targets.y[self.index]
        return np.stack([along * np.cos(yaw), y + along * np.sin(yaw), height], axis=-1)

    def perspective(self, uv: Floats) -> Floats:
        """Return what perspective adds to the centroids [target, 2] [pixels]."""
        radius = self.targets.radius[self.index]
        if not radius.any():
            return np.zeros_like(uv)
        du, dv = ellipse_correction(
            self.in_space(uv), self.targets.normal[self.index], radius, camera=self.setup.camera
        )
        return np.stack([du, dv], axis=-1)

    def check(self, uv: Floats, sightings: Sightings) -> None:
        """Refuse what is behind the camera, or of the wrong size."""
        hidden = ~np.isfinite(self.places(uv)).all(axis=1)
        if hidden.any():
            number = self.index[int(np.argmax(hidden))]
            raise CalibrationError(
                f"target {self.targets.ids[number]}: its Y of {1e3 * self.targets.y[number]:g} mm "
                "is not in front of the camera; check the sign and unit of y, and camera.position"
            )
        radius = self.targets.radius[self.index]
        known = radius > 0
        if not known.any():
            return
        seen = sightings.semi_axes[self.index].prod(axis=1)
        ratio = float(np.sqrt(np.median(seen[known] / self._expected(uv)[known])))
        if not _LIKELY_SIZE[0] < ratio < _LIKELY_SIZE[1]:
            raise CalibrationError(
                f"{sightings.name}: the targets at {self.targets.station[self.index[0]]} appear "
                f"{ratio:.3g} times as large as their radius and Y say; check the units of radius "
                "and y, and camera.position"
            )

    def _expected(self, uv: Floats) -> Floats:
        """Product of the semi-axes of the discs' images [pixels^2]."""
        normal = self.targets.normal[self.index]
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        arms = np.stack([first, np.cross(normal, first)], axis=1)
        centre = self.in_space(uv)[:, None]
        plane = PixelToPlane.of_camera(self.setup.camera, y=0.0, yaw=0.0)
        radius = self.targets.radius[self.index, None, None]
        ends = (plane.project(centre + sign * radius * arms) for sign in (1, -1))
        (u1, v1), (u2, v2) = ends
        du, dv = (u1 - u2) / 2, (v1 - v2) / 2
        return np.abs(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0])
