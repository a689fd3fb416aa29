"""What became of each picture of a calibration board."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.camera._checks import tilts_deg
from calibration.camera._fit import Fit
from calibration.camera.boards import BoardImage
from calibration.camera.file import ImageEntry

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ImageFit:
    """One picture of the board, and what became of it.

    Attributes
    ----------
    name, source : str
        The picture's name, and the file it came from.
    used : bool
        Whether the camera was fitted to it.
    reason : str
        Why it was left out and what to photograph instead, or what was repaired in it.
    corners : int
        How many of its corners were used.
    rms : float
        Root mean square distance of its corners from the fit [pixels]; NaN where it is not used.
    tilt_deg : float
        How far the board is turned away from facing the camera squarely [deg]; NaN likewise.
    distance_m : float
        Distance of the board's origin along the optical axis [m]; NaN likewise.
    uv, residuals : ndarray [corner, 2]
        Sensor columns and lines of its corners, and observed less computed [pixels]; none after
        `calibration.camera.CameraCalibration.load`.
    """

    name: str
    source: str
    used: bool
    reason: str = ""
    corners: int = 0
    rms: float = np.nan
    tilt_deg: float = np.nan
    distance_m: float = np.nan
    uv: Floats = field(default_factory=lambda: np.empty((0, 2)))
    residuals: Floats = field(default_factory=lambda: np.empty((0, 2)))


def told(
    listed: Sequence[BoardImage], found: Sequence[BoardImage], fit: Fit
) -> tuple[ImageFit, ...]:
    """Say of each picture what became of it.

    Parameters
    ----------
    listed : sequence of BoardImage
        All pictures.
    found : sequence of BoardImage
        Those in which the board was found, as they were fitted.
    fit : Fit
        The fit to those.
    """
    tilts, poses = tilts_deg(fit.adjusted.state), fit.adjusted.state.poses
    place = {id(found[number]): row for row, number in enumerate(fit.kept)}
    reasons = {id(found[number]): reason for number, reason in fit.out.items()}
    every = []
    for image in listed:
        row = place.get(id(image))
        if row is None:
            reason = reasons.get(id(image), image.note)
            every.append(ImageFit(image.name, image.source, used=False, reason=reason))
            continue
        residuals = fit.adjusted.residuals[row]
        lost = fit.corners_out.get(fit.kept[row], 0)
        notes = [image.note] if image.note else []
        notes += [f"{lost} of its corners left out: far off the fit"] if lost else []
        every.append(
            ImageFit(
                image.name,
                image.source,
                used=True,
                reason="; ".join(notes),
                corners=len(residuals),
                rms=rms(residuals),
                tilt_deg=float(tilts[row]),
                distance_m=float(poses[row, 5]),
                uv=fit.problem.observations[row].uv,
                residuals=residuals,
            )
        )
    return tuple(every)


def rms(vectors: Floats) -> float:
    """Root mean square length of vectors [.., component]."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def entry_of(image: ImageFit) -> dict[str, Any]:
    """Return what the file says of a picture."""
    entry: dict[str, Any] = {"name": image.name, "used": image.used}
    if image.reason:
        entry["reason"] = image.reason
    if image.used:
        entry |= {
            "corners": image.corners,
            "rms": image.rms,
            "tilt_deg": image.tilt_deg,
            "distance_m": image.distance_m,
        }
    return entry


def image_of(entry: ImageEntry) -> ImageFit:
    """Return a picture as the file tells it."""
    return ImageFit(
        entry.name,
        entry.name,
        entry.used,
        entry.reason,
        corners=entry.corners,
        rms=_number(entry.rms),
        tilt_deg=_number(entry.tilt_deg),
        distance_m=_number(entry.distance_m),
    )


def _number(value: float | None) -> float:
    return np.nan if value is None else value
