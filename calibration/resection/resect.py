"""Space resection: the camera's pose in the tunnel from targets of known place.

The pose is the perspective centre X, Y, Z and the angles omega, phi, kappa that make the
collinearity equations explain best where the targets are seen, each weighted by its uncertainty.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from calibration.resection._attitude import textbook_angles
from calibration.resection._checks import (
    check_arrangement,
    check_determined,
    check_direction,
    check_explained,
    check_in_front,
    check_on_sensor,
    check_scale,
    is_coplanar,
    suffices,
)
from calibration.resection._pose_fit import POSE, fit_used
from calibration.resection._projection import INTERIOR
from calibration.resection._steps import (
    checked_distance,
    loosened,
    make_problem,
    sensitivity_to_interior,
    solve,
    spread_of_held,
    starting_poses,
    target_rows,
    widening,
)
from calibration.resection.file import (
    PARAMETERS,
    MirrorPose,
    PoseFile,
    ResectedTarget,
    ResectionProvenance,
    read_pose_file,
    write_pose_file,
)
from calibration.resection.target_field import ImageTargets, TargetField
from glint_aoa.coverage import coverage_factor
from glint_aoa.geometry import rotation_matrix
from glint_aoa.setup import Camera

__all__ = [
    "MirrorPose",
    "ResectedTarget",
    "ResectionProvenance",
    "SpaceResection",
    "resect",
]

Floats = NDArray[np.float64]

_NOTHING: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class SpaceResection:
    """A camera's pose with its uncertainty.

    Attributes
    ----------
    position_m : ndarray [3]
        Perspective centre X, Y, Z in the tunnel frame [m].
    rotation_rad : ndarray [3]
        omega, phi, kappa of R = Rz(kappa) Ry(phi) Rx(omega) [rad].
    covariance : ndarray [6, 6]
        Of X, Y, Z [m] and omega, phi, kappa [rad], from the noise of image and targets and from
        what was held; already multiplied by `excess` and `widening`.
    sensitivity : ndarray [6, 10]
        Change of the pose with each of `interior_parameters`, which were held.
    chi_square : float
        Sum of squared residuals in units of their stated variance, what is held moving within
        its uncertainty; `degrees_of_freedom` where the noise was estimated from them.
    degrees_of_freedom : int
        Equations less unknowns.
    excess : float
        Reduced chi-square where a test at 1 % finds it too large for the stated noise, else 1.
    widening : float
        Factor of the variances where chi-square is no parabola, 1 to 16: the targets hardly show
        which way they are tilted, and the intervals are rough.
    noise_known : bool
        Whether the noise of the image was stated, not estimated from the residuals.
    coplanar : bool
        Whether the targets used lie in a plane.
    targets : tuple of ResectedTarget
        Residuals of all measured targets, and why some were left out.
    held : tuple of str
        Parameters that were not estimated.
    distance_m, distance_std_m : float or None
        Taped distance from the perspective centre to Y = 0 that took part [m].
    mirror : MirrorPose or None
        The other pose that the targets allow, where there is one.
    provenance : ResectionProvenance
        Files and setup.
    interior_parameters : tuple of str
        Names of the interior orientation's parameters.
    interior_values : tuple of float or None
        Their values, with which the pose was found [m, pixels]; None if the file does not say.
    """

    position_m: Floats
    rotation_rad: Floats
    covariance: Floats
    sensitivity: Floats
    chi_square: float
    degrees_of_freedom: int
    excess: float
    widening: float
    noise_known: bool
    coplanar: bool
    targets: tuple[ResectedTarget, ...]
    held: tuple[str, ...] = ()
    distance_m: float | None = None
    distance_std_m: float | None = None
    mirror: MirrorPose | None = None
    provenance: ResectionProvenance = field(default_factory=ResectionProvenance)
    interior_parameters: tuple[str, ...] = INTERIOR
    interior_values: tuple[float, ...] | None = None

    @property
    def pose(self) -> Floats:
        """X, Y, Z [m] and omega, phi, kappa [rad], as [6]."""
        return np.concatenate([self.position_m, self.rotation_rad])

    @property
    def std(self) -> Floats:
        """Uncertainty of the pose, 1 sigma [m, rad], as [6]."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)), np.float64)

    @property
    def u95(self) -> Floats:
        """Half width of the 95 % intervals [m, rad], as [6].

        Student's t where the size of the noise comes from the residuals.
        """
        freedom = np.inf if self.noise_known and self.excess == 1 else self.degrees_of_freedom
        return coverage_factor(freedom) * self.std

    @property
    def rotation(self) -> Floats:
        """Rotation from camera axes to the tunnel, as [3, 3]."""
        return rotation_matrix(*self.rotation_rad)

    @property
    def textbook_deg(self) -> Floats:
        """The same rotation as omega, phi, kappa of the photogrammetric textbooks [deg].

        M = R3(kappa) R2(phi) R1(omega) takes tunnel axes to camera axes x right, y up, z towards
        the viewer. A camera that looks along +Y has omega = 90 deg.
        """
        return np.degrees(textbook_angles(self.rotation))

    @property
    def rms_pixels(self) -> tuple[float, float]:
        """Rms residuals of u and v over the targets used [pixels]."""
        used = [each for each in self.targets if each.used]
        u = float(np.sqrt(np.mean([each.residual_u**2 for each in used])))
        return u, float(np.sqrt(np.mean([each.residual_v**2 for each in used])))

    def applied_to(self, camera: Camera) -> Camera:
        """Return a camera with this pose."""
        x, y, z = self.position_m.tolist()
        omega, phi, kappa = self.rotation_rad.tolist()
        return camera.model_copy(update={"position": (x, y, z), "rotation": (omega, phi, kappa)})

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the pose as TOML.

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
        omega, phi, kappa = self.textbook_deg.tolist()
        rms = self.rms_pixels
        content = {
            "kind": "space resection",
            "camera": {
                "position": [f"{value!r} m" for value in self.position_m.tolist()],
                "rotation": [f"{value!r} rad" for value in self.rotation_rad.tolist()],
            },
            "textbook": {"omega_deg": omega, "phi_deg": phi, "kappa_deg": kappa},
            "covariance": {"parameters": PARAMETERS, "matrix": self.covariance.tolist()},
            "interior": {
                "parameters": self.interior_parameters,
                "sensitivity": self.sensitivity.tolist(),
                "values": self.interior_values,
            },
            "fit": {
                "chi_square": self.chi_square,
                "degrees_of_freedom": self.degrees_of_freedom,
                "excess": self.excess,
                "widening": self.widening,
                "noise_known": self.noise_known,
                "rms_u_pixels": rms[0],
                "rms_v_pixels": rms[1],
                "coplanar": self.coplanar,
                "held": self.held,
                "distance_m": self.distance_m,
                "distance_std_m": self.distance_std_m,
                "mirror": self.mirror,
            },
            "target": self.targets,
            "provenance": self.provenance,
        }
        write_pose_file(
            Path(path), PoseFile.model_validate(content), self._summary(), overwrite=overwrite
        )

    @classmethod
    def load(cls, path: str | Path) -> "SpaceResection":
        """Read a pose that `save` wrote.

        Parameters
        ----------
        path : str or Path
            The TOML file.

        Raises
        ------
        CalibrationError
            If the file is missing, not TOML, or not a space resection; the message names the key.
        """
        content = read_pose_file(Path(path))
        fit = content.fit
        return cls(
            position_m=np.array(content.camera.position),
            rotation_rad=np.array(content.camera.rotation),
            covariance=np.array(content.covariance.matrix),
            sensitivity=np.array(content.interior.sensitivity),
            chi_square=fit.chi_square,
            degrees_of_freedom=fit.degrees_of_freedom,
            excess=fit.excess,
            widening=fit.widening,
            noise_known=fit.noise_known,
            coplanar=fit.coplanar,
            targets=content.target,
            held=fit.held,
            distance_m=fit.distance_m,
            distance_std_m=fit.distance_std_m,
            mirror=fit.mirror,
            provenance=content.provenance,
            interior_parameters=content.interior.parameters,
            interior_values=(
                None if content.interior.values is None else tuple(content.interior.values)
            ),
        )

    def _summary(self) -> str:
        u, v = self.rms_pixels
        used = sum(each.used for each in self.targets)
        return (
            f"{used} of {len(self.targets)} targets used, residuals {u:.3f} and {v:.3f} pixels "
            f"rms, {self.degrees_of_freedom} degrees of freedom."
        )


def resect(
    targets: TargetField,
    measured: ImageTargets,
    camera: Camera,
    *,
    hold: Collection[str] = (),
    hold_std: Mapping[str, float] = _NOTHING,
    distance_m: float | None = None,
    distance_std_m: float | None = None,
    provenance: ResectionProvenance | None = None,
) -> SpaceResection:
    r"""Find the pose of a camera from targets of known place.

    With P the target, :math:`X_0` the perspective centre and
    :math:`(x, y, z)^T = R^T (P - X_0)` the collinearity equations are

    .. math:: u = u_p + \frac{f}{p_h} d_u\!\left(\frac{x}{y}, \frac{-z}{y}\right), \qquad
              v = v_p + \frac{f}{p_v} d_v\!\left(\frac{x}{y}, \frac{-z}{y}\right)

    with d the lens distortion. A closed-form start (P3P, IPPE, SQPnP) that a few wrong targets do
    not disturb is followed by a Levenberg-Marquardt fit with Cauchy's loss. Targets whose
    studentised residual has a probability below 1 % among all are then left out, and the rest
    is fitted by weighted least squares.

    Parameters
    ----------
    targets : TargetField
        The known targets; those that were not measured do not matter.
    measured : ImageTargets
        Where they are seen. Without a covariance the noise is taken to be equal in metres on the
        sensor, as it is for the centre of a round spot, and its size from the residuals.
    camera : Camera
        Interior orientation, and an approximate position and rotation.
    hold : collection of str, optional
        Which of X, Y, Z, omega, phi, kappa to leave at the camera's values.
    hold_std : mapping of str to float, optional
        Uncertainty of what is held, 1 sigma [m, rad]; it is carried to the pose.
    distance_m, distance_std_m : float, optional
        Taped distance from the perspective centre to Y = 0, along Y, and its uncertainty,
        1 sigma [m]. It counts as one more measurement, of Y.
    provenance : ResectionProvenance, optional
        Files and setup, to be saved with the pose.

    Returns
    -------
    SpaceResection
        The pose. Where a chi-square test at 1 % says that the stated noise cannot explain the
        residuals, the covariance is multiplied by the reduced chi-square; it is never reduced.

    Raises
    ------
    CalibrationError
        If the targets do not determine the pose, or the result cannot be: too few, on a line,
        unknown, behind the camera, in another unit, or not explained by any pose.

    Notes
    -----
    The covariance holds the noise of the image and of the targets' coordinates, independent from
    target to target. An error of the interior orientation moves the pose by `sensitivity`; one
    of the whole field in the tunnel moves it with the field. Targets in a plane that is seen
    squarely from far away allow two poses; see `mirror`.

    The method is that of textbooks (T. Luhmann et al., *Close-Range Photogrammetry and 3D
    Imaging*, 4.2.3), with the paper's constrained form ("the camera could be aligned to be
    parallel to the Y axis") as ``hold=("omega", "phi", "kappa")`` and a taped distance.
    """
    known = targets.of(measured.ids)
    distance = checked_distance(distance_m, distance_std_m)
    problem = make_problem(known, measured, camera, hold=hold, distance=distance)
    loose = loosened(problem, hold_std)
    check_on_sensor(measured.ids, measured.uv, camera.sensor)
    check_arrangement(measured.ids, problem)
    starts = starting_poses(problem)
    check_scale(problem.points, starts[0], problem.value[:3])
    judged, used, mirror = solve(loose, starts, lambda some: suffices(problem, some))
    fit = fit_used(problem, judged.pose, used, noise=judged.noise)
    check_in_front(measured.ids, problem.interior.project(known.points, fit.pose).depth)
    check_direction(fit.pose, problem.value[3:])
    rows = target_rows(problem, fit, used, measured.ids)
    check_explained(rows, within_noise=problem.noise_known and judged.excess == 1)
    wider = widening(problem, fit, used, excess=judged.excess)
    noise = fit.inverse * judged.excess * wider
    check_determined(fit.pose, known.points, np.sqrt(np.diagonal(noise)))
    return SpaceResection(
        position_m=fit.pose[:3],
        rotation_rad=fit.pose[3:],
        covariance=noise + spread_of_held(fit, used, hard=problem, loose=loose),
        sensitivity=sensitivity_to_interior(problem, fit, used),
        chi_square=judged.chi_square,
        degrees_of_freedom=judged.degrees_of_freedom,
        excess=judged.excess,
        widening=wider,
        noise_known=problem.noise_known,
        coplanar=is_coplanar(known.points[used]),
        targets=rows,
        held=tuple(name for name, is_held in zip(POSE, problem.held, strict=True) if is_held),
        distance_m=distance_m,
        distance_std_m=distance_std_m,
        mirror=mirror,
        provenance=provenance or ResectionProvenance(),
        interior_values=problem.interior.values,
    )
