"""Monte Carlo of the space resection: whether its 95 % intervals hold the true pose.

Each draw is a camera of its own in front of a target field: place, rotation, noise of the image
and of the targets' coordinates. OpenCV projects. Run with
``python -m benchmarks.resection_coverage [STUDY ...] [--draws N] [--seed N]``.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks._draws import BAND, chosen
from calibration.resection.resect import SpaceResection, resect
from calibration.resection.target_field import ImageTargets, TargetField
from glint_aoa.geometry import rotation_matrix
from glint_aoa.setup import Camera

Floats = NDArray[np.float64]

NAMES = ("X", "Y", "Z", "omega", "phi", "kappa")
ANGLES = ("omega", "phi", "kappa")

_TO_OPENCV = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
_FOCAL, _PITCH = 35e-3, np.array([11.7e-6, 27.5e-6])  # m
_LENS = (-0.1, 0.1, 0.001, -0.001, 0.0)
_SENSOR_NOISE = 0.6e-6  # m, of a target's centre
_TARGET_STD = 0.05e-3  # m
_BLUNDER = 2.0  # pixels


@dataclass(frozen=True)
class Study:
    """What is drawn.

    Attributes
    ----------
    name : str
        What the study is called.
    coplanar : bool
        Whether the targets lie in a plane.
    noise_stated : bool
        Whether the resection is told the noise of the image.
    target_std : float
        Noise of the targets' coordinates [m].
    blunders : int
        Targets that are measured up to 2 pixels wrong.
    aligned : bool
        Whether the rotation is held at zero, uncertain by 0.1 deg, and the distance taped.
    """

    name: str
    coplanar: bool
    noise_stated: bool = True
    target_std: float = 0.0
    blunders: int = 0
    aligned: bool = False


STUDIES = {
    each.name: each
    for each in (
        Study("coplanar", coplanar=True),
        Study("in space", coplanar=False),
        Study("noise estimated", coplanar=True, noise_stated=False),
        Study("uncertain targets", coplanar=False, target_std=_TARGET_STD),
        Study("two blunders", coplanar=False, blunders=2),
        Study("aligned, taped", coplanar=True, aligned=True),
    )
}


@dataclass(frozen=True)
class Row:
    """Coverage of one parameter in one study.

    Attributes
    ----------
    study, parameter : str
        What was drawn, and of what.
    draws : int
        How many.
    inside : float
        Share of the 95 % intervals that held the truth.
    rms_error, median_std : float
        Of the parameter [mm, deg].
    """

    study: str
    parameter: str
    draws: int
    inside: float
    rms_error: float
    median_std: float


def coverage(draws: int, seed: int, studies: Sequence[str] = tuple(STUDIES)) -> list[Row]:
    """Resect that many independent cameras for each study, and count the intervals."""
    rows = []
    for name in studies:
        study = STUDIES[name]
        found = [_one(study, np.random.default_rng([seed, number])) for number in range(draws)]
        error, u95, std = (np.array(each) for each in zip(*found, strict=True))
        scale = np.array([1e3] * 3 + [np.degrees(1.0)] * 3)
        rows += [
            Row(
                study=name,
                parameter=parameter,
                draws=draws,
                inside=float(np.mean(np.abs(error[:, i]) <= u95[:, i])),
                rms_error=float(scale[i] * np.sqrt(np.mean(error[:, i] ** 2))),
                median_std=float(scale[i] * np.median(std[:, i])),
            )
            for i, parameter in enumerate(NAMES)
        ]
    return rows


def field_of(study: Study) -> Floats:
    """Return 15 targets over the view of the paper's camera [m]: on a board, or at three depths."""
    x, z = (each.ravel() for each in np.meshgrid(np.linspace(-0.11, 0.11, 5), [0.0, 0.05, 0.1]))
    y = np.zeros(x.size) if study.coplanar else np.resize([-0.06, 0.05, 0.0, 0.09], x.size)
    board = rotation_matrix(0.0, 0.0, np.radians(12.0)) if study.coplanar else np.eye(3)
    return np.stack([x, y, z], axis=-1) @ board.T


@cache
def camera() -> Camera:
    """Return the paper's camera with a distorting lens, where a tape would put it."""
    return Camera.model_validate(
        {
            "focal_length": f"{_FOCAL} m",
            "pixel_pitch": [f"{each} m" for each in _PITCH],
            "sensor": (752, 240),
            "position": ("0 m", "-1.4 m", "0.05 m"),
            "distortion": _LENS,
        }
    )


def pixels(points: Floats, pose: Floats) -> Floats:
    """Project with OpenCV."""
    to_camera = _TO_OPENCV @ rotation_matrix(*pose[3:]).T
    matrix = np.diag([*(_FOCAL / _PITCH), 1.0])
    matrix[:2, 2] = 375.5, 119.5
    seen, _ = cv2.projectPoints(points, to_camera, -to_camera @ pose[:3], matrix, np.array(_LENS))
    return np.asarray(seen[:, 0], np.float64)


def _one(study: Study, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    turn = np.radians(0.1 if study.aligned else 0.6) * rng.standard_normal(3)
    place = np.array([0.0, -1.4224, 0.06]) + 0.01 * rng.standard_normal(3)
    pose, points = np.concatenate([place, turn]), field_of(study)
    size = _SENSOR_NOISE * rng.uniform(0.5, 2.0, len(points))
    std = size[:, None] / _PITCH
    if not study.noise_stated:
        std = np.broadcast_to(_SENSOR_NOISE / _PITCH, std.shape)
    uv = pixels(points, pose) + std * rng.standard_normal(std.shape)
    wrong = rng.choice(len(points), study.blunders, replace=False)
    uv[wrong] += rng.uniform(-_BLUNDER, _BLUNDER, (study.blunders, 2))
    ids = tuple(f"T{i}" for i in range(len(points)))
    known = TargetField(
        ids,
        points + study.target_std * rng.standard_normal(points.shape),
        np.full(points.shape, study.target_std),
    )
    covariance = std[:, :, None] ** 2 * np.eye(2) if study.noise_stated else None
    found = _resected(study, known, ImageTargets(ids, uv, covariance), place, rng)
    return found.pose - pose, found.u95, found.std


def _resected(
    study: Study,
    known: TargetField,
    measured: ImageTargets,
    place: Floats,
    rng: np.random.Generator,
) -> SpaceResection:
    if not study.aligned:
        return resect(known, measured, camera())
    taped_std = 1e-3
    return resect(
        known,
        measured,
        camera(),
        hold=ANGLES,
        hold_std=dict.fromkeys(ANGLES, float(np.radians(0.1))),
        distance_m=-place[1] + taped_std * rng.standard_normal(),
        distance_std_m=taped_std,
    )


def main() -> int:
    """Print one line for each parameter; 1 if an interval holds too little."""
    options = chosen(__doc__, STUDIES)
    print(
        f"{'study':<19}{'parameter':<10}{'draws':>6}{'in 95 %':>9}{'rms error':>11}{'std':>9}  unit"
    )
    covers = True
    for name in options.studies:
        started = time.perf_counter()
        for row in coverage(options.draws, options.seed, [name]):
            good = BAND[0] <= row.inside <= BAND[1]
            covers &= good
            unit = "deg" if row.parameter in ANGLES else "mm"
            print(
                f"{row.study:<19}{row.parameter:<10}{row.draws:>6}{100 * row.inside:>9.1f}"
                f"{row.rms_error:>11.4f}{row.median_std:>9.4f}  {unit}{'' if good else '  NOT'}"
            )
        print(f"{name}: {time.perf_counter() - started:.0f} s", flush=True)
    return 0 if covers else 1


if __name__ == "__main__":
    sys.exit(main())
