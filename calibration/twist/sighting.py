"""A wing's targets in pictures: each found, named and measured in every one."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.photographs import Photograph
from calibration.targets.find import TargetImages, find_targets
from calibration.twist._tracking import track
from calibration.twist.wing_targets import WingTargets
from glint_aoa.errors import CalibrationError
from glint_aoa.setup import Camera

__all__ = ["Sightings", "sight_targets"]

Floats = NDArray[np.float64]

_MOST_NAMED = 6


@dataclass(frozen=True, eq=False)
class Sightings:
    """Targets as pictures of one state of the wing show them.

    Attributes
    ----------
    name : str
        What to call the state in reports.
    ids : tuple of str
        Names of the targets.
    uv : ndarray, shape (picture, target, 2)
        Sensor column and line of an even field [pixels]; NaN where a target was not found.
    covariance : ndarray, shape (picture, target, 2, 2)
        Of u and v [pixels^2].
    semi_axes : ndarray, shape (target, 2)
        Mean semi-axes of the outlines [pixels].
    clipped : ndarray of bool, shape (target,)
        Whether pixels of the target clip in any picture.
    """

    name: str
    ids: tuple[str, ...]
    uv: Floats
    covariance: Floats
    semi_axes: Floats
    clipped: NDArray[np.bool_]

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Where a target was found, shape (picture, target)."""
        return np.isfinite(self.uv[..., 0])

    @property
    def missing(self) -> tuple[str, ...]:
        """Targets that less than half of the pictures show."""
        rare = 2 * self.seen.sum(axis=0) < len(self.uv)
        return tuple(np.array(self.ids)[rare].tolist())

    def mean(self) -> tuple[Floats, Floats]:
        """Average over the pictures that show each target.

        Returns
        -------
        uv : ndarray, shape (target, 2)
            Mean places [pixels]; NaN for a target that was never found.
        covariance : ndarray, shape (target, 2, 2)
            Of these, from the noise of the pixels [pixels^2].
        """
        count = self.seen.sum(axis=0)
        share = 1 / np.where(count > 0, count, np.nan)
        uv = share[:, None] * np.nansum(self.uv, axis=0)
        covariance = share[:, None, None] ** 2 * np.nansum(self.covariance, axis=0)
        return uv, covariance


def sight_targets(
    pictures: Iterable[Photograph],
    targets: WingTargets,
    camera: Camera,
    *,
    name: str,
    start: Floats | None = None,
    polarity: Literal["bright", "dark"] = "bright",
    diameters: tuple[float, float] = (4.0, 60.0),
    progress: Callable[[str], None] | None = None,
) -> Sightings:
    """Find a wing's targets in pictures of one state of the wing.

    Parameters
    ----------
    pictures : iterable of Photograph
        One or more frames or fields, all from one place.
    targets : WingTargets
        The targets.
    camera : Camera
        Its pixel pitch, by which turns keep their size.
    name : str
        What to call the state in reports.
    start : ndarray, shape (target, 2), optional
        Sensor columns and lines near which the targets are seen, but for a common turn, scale
        and shift [pixels]; those of `targets` by default. Each picture starts from the last.
    polarity : {"bright", "dark"}, optional
        Whether targets are brighter or darker than the wing.
    diameters : tuple of float, optional
        Least and greatest diameter of a circle of a target's area [pixels].
    progress : callable, optional
        Called with the name of each picture when it is done.

    Returns
    -------
    Sightings
        What was found; targets may be missing.

    Raises
    ------
    CalibrationError
        If a picture shows fewer than half of the targets; the message says how many circles
        there were.
    """
    pitch = np.array(camera.pixel_pitch or (1.0, 1.0))
    expected = targets.start if start is None else start
    measured = []
    for picture in pictures:
        found = find_targets(
            picture.grey, polarity=polarity, min_diameter=diameters[0], max_diameter=diameters[1]
        )
        uv = picture.on_sensor(np.stack([found.u, found.v], axis=-1))
        circle = track(expected * pitch, uv * pitch)
        if 2 * (circle >= 0).sum() < len(targets):
            _refuse(picture.name, circle, found, targets)
        there = circle >= 0
        expected = np.where(there[:, None], uv[np.where(there, circle, 0)], expected)
        measured.append(_of_targets(found, uv, circle))
        if progress is not None:
            progress(picture.name)
    if not measured:
        raise CalibrationError(f"{name}: no picture; give an image or a recording that has fields")
    all_uv, covariance, semi_axes, clipped = (
        np.array(each) for each in zip(*measured, strict=True)
    )
    seen = np.isfinite(all_uv[..., :1])
    count = np.maximum(seen.sum(axis=0), 1)
    return Sightings(
        name=name,
        ids=targets.ids,
        uv=all_uv,
        covariance=covariance,
        semi_axes=np.where(seen, semi_axes, 0.0).sum(axis=0) / count,
        clipped=np.asarray(clipped.any(axis=0), np.bool_),
    )


def _of_targets(
    found: TargetImages, uv: Floats, circle: NDArray[np.int64]
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
    """Measurements in the order of the targets, NaN for those without a circle."""
    there = circle >= 0
    own = circle[there]
    n = len(circle)
    places, covariance, semi_axes = (np.full((n, *shape), np.nan) for shape in ((2,), (2, 2), (2,)))
    clipped = np.zeros(n, bool)
    places[there], covariance[there] = uv[own], found.covariance[own]
    semi_axes[there], clipped[there] = found.semi_axes[own], found.clipped[own]
    return places, covariance, semi_axes, clipped


def _refuse(
    picture: str, circle: NDArray[np.int64], found: TargetImages, targets: WingTargets
) -> None:
    lost = [name for name, each in zip(targets.ids, circle, strict=True) if each < 0]
    named = ", ".join(lost[:_MOST_NAMED]) + (" and more" if len(lost) > _MOST_NAMED else "")
    advice = (
        "check polarity, the limits of the diameter and the light"
        if len(found) < len(targets)
        else "check u and v of the targets"
    )
    raise CalibrationError(
        f"{picture}: {len(targets) - len(lost)} of the {len(targets)} targets found among "
        f"{len(found)} circles (not {named}); {advice}"
    )
