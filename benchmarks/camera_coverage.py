"""Monte Carlo of the camera calibration: whether its 95 % intervals hold the true camera.

Each draw is a camera and a set of board positions of its own; OpenCV projects the corners, and
noise is added to them. The whole of `calibrate_camera` runs on each. Run with
``python -m benchmarks.camera_coverage [STUDY ...] [--draws N] [--seed N]``.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks._draws import BAND, WITHIN, chosen
from calibration.camera.boards import Board, BoardImage
from calibration.camera.calibrate import PARAMETERS, CameraCalibration, calibrate_camera

Floats = NDArray[np.float64]

BOARD = Board("chessboard", 7, 5, 0.03)

_PICTURES = 10
_NOISE = 0.05  # pixels, of a corner
_BEND, _PRINT = 0.3e-3, 0.05e-3  # m: a sheet on a plate, printed at home
_RESAMPLINGS = 100
_MARGIN = 3  # pixels that a board keeps from the edges


@dataclass(frozen=True)
class Study:
    """What is drawn.

    Attributes
    ----------
    name : str
        What the study is called.
    sensor : tuple of int
        Columns and lines.
    pixel_pitch : tuple of float
        Horizontal and vertical [m].
    focal : float
        Principal distance about which it is drawn [m].
    lens : tuple of float
        Standard deviations of k1, k2, p1, p2, k3.
    order : int or None
        Number of distortion coefficients that are estimated; None averages over all numbers,
        whose intervals may be too wide but not too narrow.
    imperfect : bool
        Whether the board is bent and badly printed, and its corners are adjusted too.
    uneven : bool
        Whether pictures differ in noise, by factors of two or so.
    """

    name: str
    sensor: tuple[int, int]
    pixel_pitch: tuple[float, float]
    focal: float
    lens: tuple[float, float, float, float, float]
    order: int | None
    imperfect: bool = False
    uneven: bool = False


_FIELD = (752, 240), (11.7e-6, 27.5e-6), 35e-3
_SQUARE = (640, 480), (10e-6, 10e-6), 8e-3

STUDIES = {
    each.name: each
    for each in (
        Study("fields", *_FIELD, (0.2, 0.2, 1e-3, 1e-3, 0.0), 4),
        Study("square, wide", *_SQUARE, (0.1, 0.03, 1e-3, 1e-3, 0.01), 5),
        Study("fields, imperfect board", *_FIELD, (0.2, 0.2, 0.0, 0.0, 0.0), 2, imperfect=True),
        Study("square, uneven noise", *_SQUARE, (0.1, 0.03, 0.0, 0.0, 0.0), 2, uneven=True),
        Study("square, averaged", *_SQUARE, (0.1, 0.01, 3e-4, 3e-4, 0.0), None),
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
        In how many the parameter was estimated.
    inside : float
        Share of the 95 % intervals that held the truth.
    bootstrap_inside : float
        The same of the bootstrap's intervals; 0 where there was none.
    bootstrapped : bool
        Whether there was.
    rms_error, median_std : float
        Of the parameter, in its own unit.
    """

    study: str
    parameter: str
    draws: int
    inside: float
    bootstrap_inside: float
    bootstrapped: bool
    rms_error: float
    median_std: float


def coverage(draws: int, seed: int, studies: Sequence[str] = tuple(STUDIES)) -> list[Row]:
    """Calibrate that many independent cameras for each study, and count the intervals."""
    rows = []
    for name in studies:
        drawn = [_one(STUDIES[name], np.random.default_rng([seed, k])) for k in range(draws)]
        for parameter in PARAMETERS:
            values = np.array([each[parameter] for each in drawn if parameter in each])
            if not len(values):
                continue
            error, std, bootstrap_std = values.T
            rows.append(
                Row(
                    study=name,
                    parameter=parameter,
                    draws=len(values),
                    inside=float(np.mean(np.abs(error) <= WITHIN * std)),
                    bootstrap_inside=float(np.mean(np.abs(error) <= WITHIN * bootstrap_std)),
                    bootstrapped=bool(np.isfinite(bootstrap_std).all()),
                    rms_error=float(np.sqrt(np.mean(error**2))),
                    median_std=float(np.median(std)),
                )
            )
    return rows


def _one(study: Study, rng: np.random.Generator) -> dict[str, tuple[float, float, float]]:
    """Return error, standard deviation and the bootstrap's, of each parameter."""
    truth = _camera(study, rng)
    images = pictures(study, truth, rng)
    fitted = calibrate_camera(
        images,
        BOARD,
        sensor=study.sensor,
        pixel_pitch=study.pixel_pitch,
        distortion=study.order,
        board_std=None if study.imperfect else 0.0,
        draws=_RESAMPLINGS if study.order and not study.imperfect else 0,
    )
    return _errors(fitted, dict(zip(PARAMETERS, truth, strict=True)))


def _errors(
    fitted: CameraCalibration, truth: dict[str, float]
) -> dict[str, tuple[float, float, float]]:
    bootstrap = fitted.bootstrap_std
    if bootstrap is None:
        bootstrap = np.full(len(fitted.parameters), np.nan)
    numbers = zip(fitted.parameters, fitted.values, fitted.std, bootstrap, strict=True)
    return {name: (value - truth[name], std, boot) for name, value, std, boot in numbers}


def _camera(study: Study, rng: np.random.Generator) -> Floats:
    """Draw a camera, as values of `PARAMETERS`."""
    middle = (np.array(study.sensor) - 1) / 2
    return np.array(
        [
            study.focal * rng.uniform(0.8, 1.25),
            study.pixel_pitch[1] * rng.uniform(0.98, 1.02),
            *(middle + rng.uniform(-0.02, 0.02, 2) * study.sensor),
            *(rng.uniform(-1, 1, 5) * study.lens),
        ]
    )


def pictures(study: Study, camera: Floats, rng: np.random.Generator) -> list[BoardImage]:
    """Draw what is found in ten pictures of the board.

    Parameters
    ----------
    study : Study
        What is drawn.
    camera : ndarray [9]
        Values of `PARAMETERS`.
    rng : Generator
        Random numbers.
    """
    real = BOARD.places + (_imperfection(rng) if study.imperfect else 0.0)
    images: list[BoardImage] = []
    while len(images) < _PICTURES:
        uv = _seen(study, camera, real, rng)
        limit = np.array(study.sensor) - 1 - _MARGIN
        if (uv > _MARGIN).all() and (uv < limit).all():
            noise = _NOISE * (np.exp(rng.normal(0.0, 0.7)) if study.uneven else 1.0)
            name = f"picture {len(images)}"
            measured = uv + noise * rng.standard_normal(uv.shape)
            images.append(BoardImage(name, name, np.arange(len(uv)), measured))
    return images


def _imperfection(rng: np.random.Generator) -> Floats:
    """Draw how far a board's corners lie off their places: a bend, and the printer's errors."""
    off = BOARD.places[:, :2] - BOARD.places[:, :2].mean(axis=0)
    x, y = (off / np.abs(off).max()).T
    twist = rng.standard_normal(3) @ np.array([x * x, x * y, y * y])
    return np.column_stack([_PRINT * rng.standard_normal((len(x), 2)), _BEND * twist])


def _seen(study: Study, camera: Floats, real: Floats, rng: np.random.Generator) -> Floats:
    """Place the board at random, tilted and turned by quarters, and project it."""
    width = study.sensor[0] * study.pixel_pitch[0] / camera[0]  # at unit distance
    distance = rng.uniform(1.6, 2.3) * np.ptp(BOARD.places[:, 0]) / width
    towards = rng.uniform(0, 2 * np.pi)
    axis = np.array([np.cos(towards), np.sin(towards), 0.0])
    tilt = cv2.Rodrigues(np.radians(rng.uniform(10, 40)) * axis)[0]
    turn = np.radians(90.0 * rng.integers(4) + rng.uniform(-15, 15))
    rotation = tilt @ cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
    aside = rng.uniform(-0.3, 0.3, 2) * width * distance
    translation = np.array([*aside, distance]) - rotation @ BOARD.places.mean(axis=0)
    matrix = np.array(
        [
            [camera[0] / study.pixel_pitch[0], 0.0, camera[2]],
            [0.0, camera[0] / camera[1], camera[3]],
            [0.0, 0.0, 1.0],
        ]
    )
    seen, _ = cv2.projectPoints(real, cv2.Rodrigues(rotation)[0], translation, matrix, camera[4:])
    return np.asarray(seen, np.float64).reshape(-1, 2)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 1 if a share is outside the band."""
    given = chosen(__doc__, STUDIES, arguments)
    print(f"Camera calibration: share of {given.draws} draws whose 95 % interval holds the truth")
    header = ["study", "parameter", "draws", "inside", "bootstrap", "rms error", "median std"]
    widths = [24, 19, 6, 8, 10, 11, 11]
    print("".join(cell.ljust(width) for cell, width in zip(header, widths, strict=True)))
    outside = 0
    for name in given.studies:
        started = time.process_time()
        for row in coverage(given.draws, given.seed, [name]):
            most = 1.0 if STUDIES[name].order is None else BAND[1]
            holds = BAND[0] <= row.inside <= most
            outside += not holds
            cells = [
                row.study,
                row.parameter,
                str(row.draws),
                f"{100 * row.inside:.1f} %",
                f"{100 * row.bootstrap_inside:.1f} %" if row.bootstrapped else "-",
                f"{row.rms_error:.3g}",
                f"{row.median_std:.3g}",
                "" if holds else "  outside",
            ]
            print(
                "".join(cell.ljust(width) for cell, width in zip(cells, [*widths, 0], strict=True))
            )
        print(f"({time.process_time() - started:.0f} s of processor time)", flush=True)
    return int(outside > 0)


if __name__ == "__main__":
    sys.exit(main())
