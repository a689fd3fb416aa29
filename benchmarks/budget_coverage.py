"""Monte Carlo of the uncertainty budget: do the errors of real measurements follow it.

Each draw is a true camera: what the setup says, off by what the setup says that it may be off.
OpenCV projects an exact line with it; the nominal setup measures the line. The angle's error is
held against the uncertainty that is carried to measured angles. Run with
``python -m benchmarks.budget_coverage [STUDY ...] [--draws N] [--seed N]``.
"""

import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tomli_w
from numpy.typing import NDArray

from benchmarks._draws import BAND, WITHIN, chosen
from calibration.budget.uncertainty import (
    geometry_covariance,
    geometry_uncertainty,
    uncertain_geometry,
)
from calibration.resection.resect import resect
from calibration.resection.target_field import ImageTargets, TargetField
from calibration.sweep.fit import PitchSweep, SweepPoint, fit_sweep_points
from glint_aoa.geometry import PixelToPlane
from glint_aoa.optical.line import fit_lines
from glint_aoa.setup import Setup, load_setup

Floats = NDArray[np.float64]

COLUMNS = np.arange(10.0, 752.0, 20.0)

_SETUP = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [375.5, 119.5]
position = ["0.02 m", "-56 in", "60 mm"]
rotation = ["0.6 deg", "-0.4 deg", "1.5 deg"]
distortion = [-0.15, 0.1, 0.001, -0.001, 0.0]
[glint]
y = "-20 mm"
yaw = "1 deg"
"""
_TAPED = """
[uncertainty]
focal_length = "0.2 mm"
pixel_pitch = ["0.01 um", "0.05 um"]
principal_point = [4.0, 3.0]
distortion = [0.03, 0.05, 0.0005, 0.0005, 0.0]
position = ["5 mm", "5 mm", "3 mm"]
rotation = ["0.3 deg", "0.1 deg", "0.3 deg"]
y = "2 mm"
yaw = "0.2 deg"
"""
_PLANE_ONLY = '[uncertainty]\ny = "2 mm"\nyaw = "0.05 deg"\n'
_CALIBRATED = '[calibration]\ncamera = "camera.toml"\npose = "pose.toml"\n'
_ROW_STD = 0.01 / np.sqrt(60)  # lines: of a column's centre, 60 fields averaged
_ONBOARD_STD, _ONBOARD_ACCURACY = 0.001, 0.002  # deg
_TARGET_STD = 0.1  # pixels
_SWEPT = np.arange(-7.0, 7.1, 1.0)  # deg
_TO_OPENCV = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


@dataclass(frozen=True)
class TrueCamera:
    """A camera and the vertical plane of the glint, as a vector of what a setup may be wrong in.

    Attributes
    ----------
    values : ndarray [18]
        Principal distance, pixel pitches [m], principal point [pixels], k1, k2, p1, p2, k3,
        X, Y, Z [m], omega, phi, kappa [rad], Y [m] and heading [rad] of the plane.
    """

    values: Floats

    @classmethod
    def of_setup(cls, setup: Setup) -> "TrueCamera":
        """Return what a setup says."""
        camera, glint = setup.camera, setup.glint
        parts = (camera.focal_length, camera.pixel_pitch, camera.principal_point)
        parts += (camera.distortion, camera.position, camera.rotation, glint.y, glint.yaw)
        return cls(np.concatenate([np.atleast_1d(np.array(each, float)) for each in parts]))

    def pixels(self, points: Floats) -> Floats:
        """Project points [point, 3] with OpenCV: columns and lines [point, 2]."""
        f, pitch, middle = self.values[0], self.values[1:3], self.values[3:5]
        about_x, about_y, about_z = (
            cv2.Rodrigues(axis * angle)[0]
            for axis, angle in zip(np.eye(3), self.values[13:16], strict=True)
        )
        to_camera = _TO_OPENCV @ (about_z @ about_y @ about_x).T
        matrix = np.diag([*(f / pitch), 1.0])
        matrix[:2, 2] = middle
        moved = -to_camera @ self.values[10:13]
        seen, _ = cv2.projectPoints(
            points.reshape(-1, 1, 3), cv2.Rodrigues(to_camera)[0], moved, matrix, self.values[5:10]
        )
        return np.asarray(seen[:, 0])

    def rows(self, pitch_deg: float, intercept: float) -> Floats:
        """Return where a glint of a model with its nose to the left crosses the columns."""
        along = np.linspace(-0.4, 0.4, 401)
        y, heading = self.values[16:18]
        height = intercept - np.tan(np.radians(pitch_deg)) * along
        points = np.stack([along * np.cos(heading), y + along * np.sin(heading), height], axis=1)
        u, v = self.pixels(points).T
        # between the points the picture of a line is bent by less than 1e-5 lines
        return np.interp(COLUMNS, u, v)


@dataclass(frozen=True)
class Study:
    """What is drawn.

    Attributes
    ----------
    name : str
        What the study is called.
    setup : str
        The setup, as TOML.
    swept : bool
        Whether a pitch sweep is taken with the same camera, and applied.
    """

    name: str
    setup: str
    swept: bool = False


STUDIES = {
    each.name: each
    for each in (
        Study("taped", _SETUP + _TAPED),
        Study("taped, swept", _SETUP + _TAPED, swept=True),
        Study("calibrated", _SETUP + _PLANE_ONLY + _CALIBRATED),
    )
}


@dataclass(frozen=True)
class Row:
    """What a study found; angles in degrees.

    Attributes
    ----------
    study : str
        Its name.
    draws : int
        How many.
    inside : float
        Share of the 95 % intervals that held the true angle.
    rms_error_deg, rms_std_deg : float
        Of the angle's error, and of the uncertainty that was stated.
    seconds : float
        What it took.
    """

    study: str
    draws: int
    inside: float
    rms_error_deg: float
    rms_std_deg: float
    seconds: float


def coverage(draws: int, seed: int, studies: Sequence[str] = tuple(STUDIES)) -> list[Row]:
    """Measure lines with that many independent cameras for each study, and count the intervals."""
    rows = []
    for name in studies:
        started = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            one = _prepared(STUDIES[name], Path(folder))
            found = [one(np.random.default_rng([seed, number])) for number in range(draws)]
        error, std = np.array(found).T
        rows.append(
            Row(
                study=name,
                draws=draws,
                inside=float(np.mean(np.abs(error) <= WITHIN * std)),
                rms_error_deg=float(np.sqrt(np.mean(error**2))),
                rms_std_deg=float(np.sqrt(np.mean(std**2))),
                seconds=time.perf_counter() - started,
            )
        )
    return rows


def _prepared(study: Study, folder: Path) -> Callable[[np.random.Generator], tuple[float, float]]:
    if "calibrated" in study.name:
        return lambda rng: _calibrated(study, folder, rng)
    path = folder / "glint-aoa.toml"
    path.write_text(study.setup)
    setup = load_setup(path)
    nominal = TrueCamera.of_setup(setup)
    root = _root(geometry_covariance(setup).matrix)

    def one(rng: np.random.Generator) -> tuple[float, float]:
        true = TrueCamera(nominal.values + (root @ rng.standard_normal(len(root)))[:18])
        sweep = _sweep(setup, true, rng) if study.swept else None
        return _measured(setup, true, sweep, rng)

    return one


def _calibrated(study: Study, folder: Path, rng: np.random.Generator) -> tuple[float, float]:
    """Calibrate the camera, find its pose with that, and measure; each step with its errors."""
    content = tomllib.loads(study.setup)
    calibration = content.pop("calibration")
    said = TrueCamera.of_setup(Setup.model_validate(content))
    plane = np.array([2e-3, np.radians(0.05)]) * rng.standard_normal(2)
    true = TrueCamera(said.values + np.append(np.zeros(16), plane))
    content["camera"] |= _calibrate_camera(true, folder, rng)
    _resect(true, Setup.model_validate(content), folder, rng)
    del content["camera"]
    path = folder / "glint-aoa.toml"
    path.write_text(tomli_w.dumps(content | {"calibration": calibration}))
    return _measured(load_setup(path), true, None, rng)


def _calibrate_camera(
    true: TrueCamera, folder: Path, rng: np.random.Generator
) -> dict[str, object]:
    """Write the calibration of a camera, off by what its covariance says; returns its values."""
    names, covariance = _camera_covariance()
    wrong = _root(covariance) @ rng.standard_normal(len(names))
    interior = (true.values[[0, 2, 3, 4, 5]] + wrong).tolist()
    camera: dict[str, object] = {
        "focal_length": f"{interior[0]!r} m",
        "pixel_pitch": ["11.7 um", f"{interior[1]!r} m"],
        "sensor": [752, 240],
        "principal_point": interior[2:4],
        "distortion": [interior[4], *true.values[6:10].tolist()],
    }
    (folder / "camera.toml").write_text(camera_file(camera, names, covariance))
    return camera


def _resect(true: TrueCamera, setup: Setup, folder: Path, rng: np.random.Generator) -> None:
    """Find the pose from targets that the true camera sees, with the setup's interior."""
    targets = _targets()
    seen = true.pixels(targets) + _TARGET_STD * rng.standard_normal((len(targets), 2))
    ids = tuple(f"T{number}" for number in range(len(targets)))
    field = TargetField(ids, targets, np.zeros(targets.shape))
    spread = np.tile(_TARGET_STD**2 * np.eye(2), (len(targets), 1, 1))
    pose = resect(field, ImageTargets(ids, seen, spread), setup.camera)
    pose.save(folder / "pose.toml", overwrite=True)


def camera_file(camera: dict[str, object], names: list[str], covariance: Floats) -> str:
    """Return the file of a camera calibration that estimated what is named."""
    return tomli_w.dumps(
        {
            "kind": "camera calibration",
            "camera": camera,
            "covariance": {"parameters": names, "matrix": covariance.tolist()},
            "fit": {"rms": 0.05, "noise": [0.05, 0.02], "degrees_of_freedom": 1500.0},
            "board": {
                "description": "drawn",
                "std_m": 0.0,
                "departure_m": 0.0,
                "departure_std_m": 0.0,
            },
        }
    )


def _camera_covariance() -> tuple[list[str], Floats]:
    """Of a calibration: principal distance and vertical pitch hang together, as do the others."""
    names = ["focal_length_m", "pixel_pitch_v_m", "principal_point_u", "principal_point_v", "k1"]
    std = np.array([40e-6, 0.015e-6, 2.0, 1.5, 0.003])
    correlation = np.eye(5)
    for first, second, value in ((0, 1, 0.7), (0, 4, -0.5), (2, 3, 0.2)):
        correlation[first, second] = correlation[second, first] = value
    return names, correlation * std[:, None] * std


def _targets() -> Floats:
    x, z = (each.ravel() for each in np.meshgrid(np.linspace(-0.12, 0.12, 5), [0.0, 0.06, 0.12]))
    return np.stack([x, np.resize([-0.06, 0.05, 0.0, 0.09], x.size), z], axis=-1)


def _sweep(setup: Setup, true: TrueCamera, rng: np.random.Generator) -> PitchSweep:
    """Take a sweep in the middle of the picture."""
    shared = _ONBOARD_ACCURACY * rng.standard_normal()
    points = []
    for pitch in _SWEPT:
        raw, intercept = _angle(setup, true, float(pitch), 0.06, rng)
        onboard = pitch + shared + _ONBOARD_STD * rng.standard_normal()
        points.append(
            SweepPoint(
                name=f"{pitch:g}",
                optical_deg=raw,
                optical_std_deg=_noise(setup),
                onboard_deg=onboard,
                onboard_std_deg=_ONBOARD_STD,
                intercept_mm=1e3 * intercept,
            )
        )
    return fit_sweep_points(points, degree=3, onboard_accuracy_deg=_ONBOARD_ACCURACY)


def _measured(
    setup: Setup, true: TrueCamera, sweep: PitchSweep | None, rng: np.random.Generator
) -> tuple[float, float]:
    """Measure a glint anywhere in the picture: error of the angle and its stated std [deg]."""
    pitch, intercept = float(rng.uniform(-6.0, 6.0)), float(rng.uniform(0.02, 0.11))
    raw, seen = _angle(setup, true, pitch, intercept, rng)
    covariance = uncertain_geometry(setup)
    assert covariance is not None
    carried = geometry_uncertainty(
        setup,
        covariance,
        np.radians([raw]),
        np.array([seen]),
        u=COLUMNS,
        std=np.ones(COLUMNS.size),
        sweep=sweep,
    ).std_deg[0]
    if sweep is None:
        return raw - pitch, float(np.hypot(carried, _noise(setup)))
    applied = sweep.apply(raw)
    stds = carried, applied.systematic_std_deg, applied.gain * _noise(setup)
    return float(applied.angle_deg) - pitch, float(np.sqrt(np.sum(np.square(stds))))


def _angle(
    setup: Setup, true: TrueCamera, pitch_deg: float, intercept: float, rng: np.random.Generator
) -> tuple[float, float]:
    """Measure a glint with the setup: raw angle [deg] and intercept [m]."""
    rows = true.rows(pitch_deg, intercept) + _ROW_STD * rng.standard_normal(COLUMNS.size)
    to_plane = PixelToPlane.of_camera(setup.camera, y=setup.glint.y, yaw=setup.glint.yaw)
    along, height = to_plane(COLUMNS, rows[None])
    fit = fit_lines(along, height, np.ones(COLUMNS.size))
    return -float(np.degrees(np.arctan(fit.slope[0]))), float(fit.intercept[0])


def _noise(setup: Setup) -> float:
    """Noise of the angle from the columns' [deg]; good to a few per cent, for it hardly counts."""
    assert setup.camera.pixel_pitch is not None
    pitch = setup.camera.pixel_pitch[1] / setup.camera.pixel_pitch[0]
    slope = _ROW_STD * pitch / np.sqrt(np.sum((COLUMNS - COLUMNS.mean()) ** 2))
    return float(np.degrees(slope))


def _root(covariance: Floats) -> Floats:
    """Return a square root of a covariance whose units differ."""
    std = np.sqrt(np.diag(covariance))
    scale = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def main() -> int:
    """Print one line a study; 1 if an interval holds the truth too seldom or too often."""
    options = chosen(__doc__, STUDIES)
    print(f"{'study':<16}{'draws':>6}{'in 95 %':>9}{'rms error':>11}{'rms std':>10}{'s':>6}")
    verdicts = []
    for study in options.studies:
        (row,) = coverage(options.draws, options.seed, [study])
        verdicts.append(BAND[0] <= row.inside <= BAND[1])
        print(
            f"{row.study:<16}{row.draws:>6}{100 * row.inside:>9.1f}{row.rms_error_deg:>11.5f}"
            f"{row.rms_std_deg:>10.5f}{row.seconds:>6.0f}  "
            f"{'holds' if verdicts[-1] else 'DOES NOT HOLD'}",
            flush=True,
        )
    return 0 if all(verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
