"""A picture of a target field: its circles found, named, and measured."""

from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calibration.photographs import Photograph
from calibration.resection.target_field import ImageTargets, TargetField, match_targets
from calibration.targets.find import find_targets
from glint_aoa.errors import CalibrationError
from glint_aoa.setup import Camera

__all__ = ["PicturedTargets", "measure_target_field"]

Floats = NDArray[np.float64]


class PicturedTargets(NamedTuple):
    """Targets of a field as pictures show them.

    Attributes
    ----------
    measured : ImageTargets
        Their places, averaged over the pictures that show them.
    missing : tuple of str
        Targets of the field that no picture shows.
    spurious : ndarray [circle, 2]
        Sensor column and line of circles that are no target of the field [pixels].
    """

    measured: ImageTargets
    missing: tuple[str, ...]
    spurious: Floats


def measure_target_field(
    pictures: Iterable[Photograph],
    targets: TargetField,
    camera: Camera,
    *,
    polarity: Literal["bright", "dark"] = "bright",
) -> PicturedTargets:
    """Find the circular targets of a field in pictures that a camera took from one place.

    Parameters
    ----------
    pictures : iterable of Photograph
        Frames or fields, such as the means of all even and of all odd fields.
    targets : TargetField
        The known targets.
    camera : Camera
        Interior orientation and approximate pose.
    polarity : {"bright", "dark"}, optional
        Whether targets are brighter or darker than their background.

    Returns
    -------
    PicturedTargets
        Clipped targets are left out, since their centre is not known to their covariance.

    Raises
    ------
    CalibrationError
        If the circles are not the field's, in any of the pictures.
    """
    seen: dict[str, list[tuple[Floats, Floats]]] = {}
    spurious = []
    for picture in pictures:
        found = find_targets(picture.grey, polarity=polarity)
        found = found.take(~found.clipped)
        uv = picture.on_sensor(np.stack([found.u, found.v], axis=-1))
        try:
            matched = match_targets(targets, uv, found.covariance, camera)
        except CalibrationError as error:
            raise CalibrationError(f"{picture.name}: {error}") from None
        spurious.append(np.delete(uv, matched.circle, axis=0))
        for name, place, i in zip(
            matched.measured.ids, matched.measured.uv, matched.circle, strict=True
        ):
            seen.setdefault(name, []).append((place, found.covariance[i]))
    ids = tuple(name for name in targets.ids if name in seen)
    means = [_weighted_mean(seen[name]) for name in ids]
    return PicturedTargets(
        ImageTargets(
            ids, np.array([place for place, _ in means]), np.array([each for _, each in means])
        ),
        tuple(name for name in targets.ids if name not in seen),
        np.concatenate(spurious) if spurious else np.empty((0, 2)),
    )


def _weighted_mean(places: list[tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
    weights = [np.linalg.inv(covariance) for _, covariance in places]
    total = np.linalg.inv(np.sum(weights, axis=0))
    pulled = np.sum([w @ place for w, (place, _) in zip(weights, places, strict=True)], axis=0)
    return total @ pulled, total
