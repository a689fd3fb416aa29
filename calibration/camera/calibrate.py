"""Calibration of the camera: principal distance, pixel pitch, principal point and distortion.

Only the ratio of principal distance to pixel pitch can be seen in pictures, so the horizontal
pitch is held as given, and principal distance and vertical pitch are found in its unit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from calibration.camera import _checks as checks
from calibration.camera._bundle import ASPECT, DISTORTION, FOCAL, PRINCIPAL
from calibration.camera._fit import ORDERS, Fit
from calibration.camera._images import ImageFit, entry_of, image_of, rms, told
from calibration.camera._models import LensModels, lens_models
from calibration.camera._steps import fitted_images, ordered_images
from calibration.camera.boards import Board, BoardImage
from calibration.camera.file import (
    PARAMETERS,
    Provenance,
    lengths,
    read_camera_file,
    write_camera_file,
)
from glint_aoa.errors import CalibrationError

__all__ = [
    "HOLDS",
    "PARAMETERS",
    "CameraCalibration",
    "ImageFit",
    "Provenance",
    "calibrate_camera",
]

Floats = NDArray[np.float64]

HOLDS = ("pixel_pitch_v", "principal_point")
"""What may be held as given."""

_LEAST_DRAWS = 10
_BOARD_STD = 0.01  # of the spacing: a print on a plate that is flat to the eye


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A calibrated camera.

    Attributes
    ----------
    focal_length_m : float
        Principal distance [m]; that of the lens as focused, some per cent longer than engraved.
    pixel_pitch_m : tuple of float
        Horizontal pitch as given, and vertical pitch per field line [m].
    sensor : tuple of int
        Columns, and lines per field.
    principal_point : tuple of float
        u and v of an even field [pixels].
    distortion : tuple of float
        k1, k2, p1, p2, k3 in OpenCV's order; 0 where not estimated.
    parameters : tuple of str
        Names of what was estimated, from `PARAMETERS`.
    covariance : ndarray [parameter, parameter]
        Their covariance, metres and pixels.
    bootstrap_covariance : ndarray [parameter, parameter] or None
        The same by resampling the images.
    draws, seed : int
        How often they were resampled, and the seed.
    rms_pixels : float
        Root mean square distance of all corners from the fit, as OpenCV states it [pixels].
    noise_pixels : tuple of float
        Noise of u and v, 1 sigma, degrees of freedom accounted for [pixels].
    degrees_of_freedom : float
        Number of observations less that of the unknowns they determine.
    board : str
        Description of the board.
    board_std_m : float
        How well its corners' places were taken to be known, 1 sigma [m].
    board_departure_m, board_departure_std_m : float
        How far the board was found to depart from its description, rms, and how much of that
        is the uncertainty of finding it [m].
    hold : tuple of str
        What was held as given.
    criterion : mapping of int to float
        Akaike's criterion of each number of distortion coefficients that was compared, relative
        to the least; empty where it was given.
    images : tuple of ImageFit
        All pictures, used or not.
    provenance : Provenance
        Files and date.
    """

    focal_length_m: float
    pixel_pitch_m: tuple[float, float]
    sensor: tuple[int, int]
    principal_point: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    parameters: tuple[str, ...]
    covariance: Floats
    bootstrap_covariance: Floats | None
    draws: int
    seed: int
    rms_pixels: float
    noise_pixels: tuple[float, float]
    degrees_of_freedom: float
    board: str
    board_std_m: float
    board_departure_m: float
    board_departure_std_m: float
    hold: tuple[str, ...] = ()
    criterion: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    images: tuple[ImageFit, ...] = ()
    provenance: Provenance = field(default_factory=Provenance)

    @property
    def values(self) -> Floats:
        """Values of `parameters`, metres and pixels."""
        every = [self.focal_length_m, self.pixel_pitch_m[1], *self.principal_point]
        named = dict(zip(PARAMETERS, [*every, *self.distortion], strict=True))
        return np.array([named[name] for name in self.parameters])

    @property
    def std(self) -> Floats:
        """Their uncertainties, 1 sigma."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def bootstrap_std(self) -> Floats | None:
        """The same by resampling the images."""
        covariance = self.bootstrap_covariance
        return None if covariance is None else np.sqrt(np.diag(covariance))

    @property
    def reach(self) -> tuple[float, float]:
        """Shares of the sensor's columns and lines between the outermost corners used.

        NaN after `load`, which has no corners.
        """
        seen = [image.uv for image in self.images if len(image.uv)]
        if not seen:
            return np.nan, np.nan
        across, down = np.ptp(np.concatenate(seen), axis=0) / self.sensor
        return float(across), float(down)

    @property
    def left_out(self) -> tuple[ImageFit, ...]:
        """Pictures that were not used, each with the reason."""
        return tuple(image for image in self.images if not image.used)

    def camera_section(self) -> dict[str, Any]:
        """Return the section ``[camera]`` of a setup, with units, without position and rotation."""
        return {
            "focal_length": lengths(self.focal_length_m, "mm", 1e3)[0],
            "pixel_pitch": lengths(self.pixel_pitch_m, "um", 1e6),
            "sensor": list(self.sensor),
            "principal_point": list(self.principal_point),
            "distortion": list(self.distortion),
        }

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the calibration as TOML.

        Parameters
        ----------
        path : str or Path
            The file; it appears under its name only when it is whole.
        overwrite : bool
            Whether a file of that name may be replaced.

        Raises
        ------
        OutputError
            If the file exists and `overwrite` is False, or it cannot be written.
        """
        content: dict[str, Any] = {
            "kind": "camera calibration",
            "camera": self.camera_section(),
            "covariance": {
                "parameters": list(self.parameters),
                "matrix": self.covariance.tolist(),
            },
            "fit": {
                "rms": self.rms_pixels,
                "noise": list(self.noise_pixels),
                "degrees_of_freedom": self.degrees_of_freedom,
                "hold": list(self.hold),
                "criterion": {str(order): value for order, value in self.criterion.items()},
            },
            "board": {
                "description": self.board,
                "std_m": self.board_std_m,
                "departure_m": self.board_departure_m,
                "departure_std_m": self.board_departure_std_m,
            },
            "image": [entry_of(image) for image in self.images],
            "provenance": {
                "files": list(self.provenance.files),
                "date": self.provenance.date,
            },
        }
        if self.bootstrap_covariance is not None:
            content["bootstrap"] = {
                "draws": self.draws,
                "seed": self.seed,
                "matrix": self.bootstrap_covariance.tolist(),
            }
        write_camera_file(Path(path), content, self._summary(), overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> "CameraCalibration":
        """Read a calibration that `save` wrote.

        Parameters
        ----------
        path : str or Path
            The TOML file.

        Returns
        -------
        CameraCalibration
            The same calibration, without the images' corners and residuals.

        Raises
        ------
        CalibrationError
            If the file is missing, not TOML, or not a camera calibration; the message names the
            key.
        """
        content = read_camera_file(Path(path))
        bootstrap = content.bootstrap
        return cls(
            focal_length_m=content.camera.focal_length,
            pixel_pitch_m=content.camera.pixel_pitch,
            sensor=content.camera.sensor,
            principal_point=content.camera.principal_point,
            distortion=content.camera.distortion,
            parameters=tuple(content.covariance.parameters),
            covariance=np.array(content.covariance.matrix),
            bootstrap_covariance=None if bootstrap is None else np.array(bootstrap.matrix),
            draws=0 if bootstrap is None else bootstrap.draws,
            seed=0 if bootstrap is None else bootstrap.seed,
            rms_pixels=content.fit.rms,
            noise_pixels=content.fit.noise,
            degrees_of_freedom=content.fit.degrees_of_freedom,
            board=content.board.description,
            board_std_m=content.board.std_m,
            board_departure_m=content.board.departure_m,
            board_departure_std_m=content.board.departure_std_m,
            hold=tuple(content.fit.hold),
            criterion={int(order): value for order, value in content.fit.criterion.items()},
            images=tuple(image_of(entry) for entry in content.image),
            provenance=content.provenance,
        )

    def _summary(self) -> str:
        used = len(self.images) - len(self.left_out)
        return (
            f"{used} of {len(self.images)} pictures of {self.board}; "
            f"rms {self.rms_pixels:.3f} pixels"
        )


def calibrate_camera(
    images: Sequence[BoardImage],
    board: Board,
    *,
    sensor: tuple[int, int],
    pixel_pitch: tuple[float, float],
    distortion: int | None = None,
    hold: Sequence[str] = (),
    board_std: float | None = None,
    draws: int = 200,
    seed: int = 0,
    provenance: Provenance | None = None,
) -> CameraCalibration:
    r"""Calibrate a camera from pictures of a board.

    Principal distance, pixel aspect, principal point and distortion, the pose of the board in each
    picture and small corrections of the board's own corners minimise

    .. math:: \chi^2 = \sum \frac{\Delta u^2}{\sigma_u^2} + \frac{\Delta v^2}{\sigma_v^2}
                     + \sum \frac{|\Delta X|^2}{\sigma_X^2}

    with the noise of u and v found from the residuals themselves, and :math:`\sigma_X` how well
    the corners' places on the board are known.

    Parameters
    ----------
    images : sequence of BoardImage
        What was found in each picture, from `calibration.camera.boards.find_boards`.
    board : Board
        The board.
    sensor : tuple of int
        Columns, and lines per field.
    pixel_pitch : tuple of float
        Horizontal pitch, held as given, and vertical pitch per field line, to some per cent [m].
    distortion : {0, 1, 2, 4, 5}, optional
        Number of distortion coefficients, in the order k1, k2, p1, p2, k3. By default the mean of
        5 and 4, or of the two greatest numbers that the images determine, weighted by Akaike's
        criterion, with the doubt about the number in the covariance.
    hold : sequence of {"pixel_pitch_v", "principal_point"}, optional
        What is held as given; the principal point then at the sensor's centre.
    board_std : float, optional
        How well the places of the board's corners are known, 1 sigma in each direction [m]. By
        default a hundredth of the spacing; 0 takes the board as exact, as OpenCV does.
    draws : int, optional
        How often the images are resampled for the bootstrap; 0 for no bootstrap.
    seed : int, optional
        Of the bootstrap.
    provenance : Provenance, optional
        Files and date, to be saved with the calibration.

    Returns
    -------
    CameraCalibration
        Its covariance is the least squares' own. In 2,000 simulated calibrations its 95 %
        intervals hold the truth in 93 to 97 %, the bootstrap's in fewer where there are few images
        (``benchmarks/camera_coverage.py``).

    Raises
    ------
    CalibrationError
        If an option cannot be, fewer than three images are usable, they do not determine the
        camera, or the result can only come from a mix-up of units or of frames and fields.

    Notes
    -----
    A board that is taken as exact and is not biases the camera far beyond the stated uncertainty:
    a bend of 0.2 mm on 240 mm moved the focal length by several standard deviations in most trials.
    A board's corrections are separated from the camera by turning it between pictures; without
    that the principal point stays four times as uncertain.
    """
    _check_options(distortion, hold, sensor, pixel_pitch, board_std, draws)
    aspect = pixel_pitch[1] / pixel_pitch[0]
    place_std = _BOARD_STD * board.spacing if board_std is None else board_std
    listed = ordered_images(images, board, aspect)
    found = [image for image in listed if image.found]
    checks.refuse_off_sensor(found, sensor)
    checks.refuse_too_few({each.name: each.note for each in listed if not each.found}, len(found))
    # The matrices are small: threads of the linear algebra only get into each other's way.
    with threadpool_limits(limits=1, user_api="blas"):
        fit = fitted_images(
            found,
            board,
            sensor=sensor,
            aspect=aspect,
            hold=hold,
            place_std=place_std,
            order=distortion,
        )
        models = lens_models(fit, distortion, hold, sensor)
        _check_result(models, sensor, pixel_pitch, hold, board)
        bootstrap = _bootstrap(models, [found[each].source for each in fit.kept], draws, seed)
    return CameraCalibration(
        sensor=sensor,
        **_interior(models, pixel_pitch, bootstrap),
        draws=draws,
        seed=seed,
        **_quality(models.best, board),
        board=str(board),
        board_std_m=place_std,
        hold=tuple(hold),
        criterion=models.criterion,
        images=told(listed, found, models.best),
        provenance=provenance or Provenance(),
    )


def _check_result(
    models: LensModels,
    sensor: tuple[int, int],
    pixel_pitch: tuple[float, float],
    hold: Sequence[str],
    board: Board,
) -> None:
    best = models.best.adjusted
    checks.refuse_undetermined(best, sensor)
    checks.refuse_units(best.state, pixel_pitch, hold, board.spacing)
    checks.refuse_folds(models.interior, sensor, int(models.free[DISTORTION].sum()))


def _interior(
    models: LensModels, pixel_pitch: tuple[float, float], bootstrap: Floats | None
) -> dict[str, Any]:
    """Turn the camera and its covariances into metres and pixels, what was held left out."""
    free, values = models.free, models.interior.values
    unit = np.where(np.isin(np.arange(free.size), [FOCAL, ASPECT]), pixel_pitch[0], 1.0)
    squared, chosen = np.outer(unit, unit), np.ix_(free, free)
    return {
        "focal_length_m": float(values[FOCAL]) * pixel_pitch[0],
        "pixel_pitch_m": (pixel_pitch[0], float(values[ASPECT]) * pixel_pitch[0]),
        "principal_point": tuple(values[PRINCIPAL].tolist()),
        "distortion": tuple(values[DISTORTION].tolist()),
        "parameters": tuple(np.array(PARAMETERS)[free].tolist()),
        "covariance": (models.covariance * squared)[chosen],
        "bootstrap_covariance": None if bootstrap is None else (bootstrap * squared)[chosen],
    }


def _quality(fit: Fit, board: Board) -> dict[str, Any]:
    """Return how well the images and the board fit."""
    return {
        "rms_pixels": rms(np.concatenate(fit.adjusted.residuals)),
        "noise_pixels": tuple(fit.problem.noise.tolist()),
        "degrees_of_freedom": fit.degrees_of_freedom,
        "board_departure_m": rms(fit.adjusted.state.places - board.places),
        "board_departure_std_m": fit.adjusted.shape_std,
    }


def _check_options(
    distortion: int | None,
    hold: Sequence[str],
    sensor: tuple[int, int],
    pixel_pitch: tuple[float, float],
    board_std: float | None,
    draws: int,
) -> None:
    if distortion is not None and distortion not in ORDERS:
        raise CalibrationError(
            f"distortion is {distortion}; give the number of coefficients: 0, 1 (k1), 2 (k2), "
            "4 (p1 and p2) or 5 (k3)"
        )
    unknown = [each for each in hold if each not in HOLDS]
    if unknown:
        raise CalibrationError(f'hold is "{unknown[0]}"; give one of {", ".join(HOLDS)}')
    if min(sensor) < 1:
        raise CalibrationError(f"a sensor of {sensor[0]} x {sensor[1]} pixels cannot be")
    if not all(0 < pitch < 1e-3 for pitch in pixel_pitch):
        h, v = (f"{1e6 * pitch:.4g} um" for pitch in pixel_pitch)
        raise CalibrationError(
            f"a pixel pitch of {h} x {v} cannot be; give the sensor's, such as 11.7 um x 27.5 um"
        )
    if board_std is not None and not 0 <= board_std < np.inf:
        raise CalibrationError(
            f"the board's std is {board_std:g} m; give zero for an exact board, or more"
        )
    if draws < 0 or draws == 1:
        raise CalibrationError(f"draws is {draws}; give 0 for no bootstrap, or some hundred")


def _bootstrap(models: LensModels, sources: Sequence[str], draws: int, seed: int) -> Floats | None:
    """Covariance [9, 9] from resampling the files that the images came from; None for none."""
    names, which = np.unique(sources, return_inverse=True)
    n = len(names)
    if not draws or n < checks.LEAST_IMAGES:
        return None
    counts = np.random.default_rng(seed).multinomial(n, np.full(n, 1 / n), size=draws)
    counts = counts[np.sum(counts > 0, axis=1) >= checks.LEAST_IMAGES]
    if len(counts) < _LEAST_DRAWS:
        return None
    return models.bootstrap_covariance(counts[:, which].astype(np.float64)) * n / (n - 1)
