"""What a report says of calibrations and of what they leave uncertain."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calibration.budget.uncertainty import UncertaintyBudget, uncertainty_budget
from calibration.camera.calibrate import CameraCalibration
from calibration.resection.resect import SpaceResection
from calibration.sweep.pitch_sweep import PitchSweep
from glint_aoa.errors import InputError
from glint_aoa.report.budget_figures import budget_figure
from glint_aoa.report.cells import Cell, Table
from glint_aoa.report.pictures import FigureFiles, Picture, picture
from glint_aoa.report.point_page import Fact
from glint_aoa.report.resection_figures import resection_figure
from glint_aoa.report.results_folder import MeasuredPoint
from glint_aoa.report.sweep_figures import sweep_figure
from glint_aoa.setup import Setup

__all__ = ["Part", "budget_parts", "calibration_part"]

_USUAL_NOISE = 0.01  # of a column's centre [lines], where the results do not tell
_SQUARE = (1.0, 1.0)


@dataclass
class Part:
    """A part of a section of the report: what it says, shows and lacks."""

    title: str
    facts: list[Fact] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def calibration_part(
    path: Path, kind: str, number: int, *, setup: Setup | None, files: FigureFiles | None
) -> Part:
    """Show a calibration.

    Parameters
    ----------
    path : Path
        Its file.
    kind : {"pitch sweep", "camera calibration", "space resection"}
        What it is.
    number : int
        Of the calibration in the report, for the names of its figures.
    setup : Setup or None
        A setup of the results, for the proportions of the camera's picture.
    files : FigureFiles or None
        As for `picture`.

    Returns
    -------
    Part
        With its residuals; of a camera, whose file keeps none of them, the rms of each picture.

    Raises
    ------
    CalibrationError
        If it cannot be read.
    """
    part = Part(f"{kind.capitalize()} {path.name}")
    if kind == "pitch sweep":
        _add_sweep(part, PitchSweep.load(path), number, files)
    elif kind == "camera calibration":
        _add_camera(part, CameraCalibration.load(path))
    else:
        _add_pose(part, SpaceResection.load(path), number, setup, files)
    return part


def budget_parts(
    points: Sequence[MeasuredPoint],
    setups: Mapping[str, Setup],
    sweeps: Mapping[str, PitchSweep | None],
    *,
    files: FigureFiles | None,
) -> Iterator[Part]:
    """Show what each setup leaves uncertain at the angles that were measured with it.

    Parameters
    ----------
    points : sequence of MeasuredPoint
        The points.
    setups, sweeps : mapping of str to Setup, PitchSweep or None
        By the setup's hash.
    files : FigureFiles or None
        As for `picture`.

    Yields
    ------
    Part
        One for each setup; where there can be no budget it says why.
    """
    for number, (setup_hash, setup) in enumerate(setups.items(), start=1):
        own = [point for point in points if point.attrs.get("setup_hash") == setup_hash]
        part = Part(f"Setup {setup_hash}")
        try:
            _add_budget(part, _budget(own, setup, sweeps.get(setup_hash)), number, files)
        except InputError as error:
            part.notes.append(f"No uncertainty budget: {error}.")
        yield part


def _add_sweep(part: Part, sweep: PitchSweep, number: int, files: FigureFiles | None) -> None:
    low, high = sweep.range_deg
    residuals = sweep.residuals_deg
    part.facts += [
        Fact("Points", f"{len(sweep.points)} used, {len(sweep.left_out)} left out"),
        Fact("Degree", str(sweep.degree)),
        Fact("Range of the optical angle", f"{low:+.3f} to {high:+.3f} deg"),
        Fact("Residuals, rms", f"{np.sqrt(np.mean(residuals**2)):.5f} deg"),
        Fact("Largest residual", f"{residuals[np.argmax(np.abs(residuals))]:+.5f} deg"),
        Fact("Onboard accuracy, 1 sigma", f"{sweep.onboard_accuracy_deg:g} deg"),
        Fact("Measured", sweep.provenance.date or "not said"),
    ]
    part.notes += [f"{point.name} is left out: {why}." for point, why in sweep.left_out.items()]
    part.pictures.append(
        picture(
            sweep_figure(sweep),
            "sweep",
            alt="Onboard less optical angle against optical angle with the fitted curve, and the "
            "residuals of the points with their 95 % intervals.",
            caption="Above, what the calibration takes out; below, what it leaves.",
            files=files,
            stem=f"calibration-{number}",
        )
    )


def _add_camera(part: Part, camera: CameraCalibration) -> None:
    std = dict(zip(camera.parameters, camera.std, strict=True))
    values = dict(zip(camera.parameters, camera.values, strict=True))
    rows = [
        [Cell(name), Cell(f"{value:.6g}", repr(float(value))), Cell(f"{std[name]:.2g}")]
        for name, value in values.items()
    ]
    part.facts += [
        Fact("Residuals, rms", f"{camera.rms_pixels:.3f} pixels"),
        Fact("Pictures used", f"{sum(i.used for i in camera.images)} of {len(camera.images)}"),
        Fact("Board", camera.board),
        Fact("Photographed", camera.provenance.date or "not said"),
    ]
    header = ["Parameter", "Value", "1 sigma"]
    note = "Lengths in metres, the principal point in pixels."
    part.tables.append(Table("What was estimated", header, rows, note))
    images = [
        [
            Cell(image.name),
            Cell(f"{image.rms:.3f}" if image.used else ""),
            Cell("" if image.used else f"left out: {image.reason}"),
        ]
        for image in camera.images
    ]
    header = ["Picture", "Residuals, rms [pixels]", "Remark"]
    part.tables.append(Table("Pictures of the board", header, images))


def _add_pose(
    part: Part,
    pose: SpaceResection,
    number: int,
    setup: Setup | None,
    files: FigureFiles | None,
) -> None:
    std = np.sqrt(np.diagonal(pose.covariance))
    values = [*(pose.position_m * 1e3), *np.degrees(pose.rotation_rad)]
    stds = [*(std[:3] * 1e3), *np.degrees(std[3:])]
    names = [f"{axis} [mm]" for axis in "XYZ"] + [f"{a} [deg]" for a in ("omega", "phi", "kappa")]
    rows = [
        [Cell(name), Cell(f"{value:.4f}", repr(float(value))), Cell(f"{sigma:.2g}")]
        for name, value, sigma in zip(names, values, stds, strict=True)
    ]
    part.tables.append(Table("Where the camera stands", ["Parameter", "Value", "1 sigma"], rows))
    left_out = [target for target in pose.targets if not target.used]
    part.notes += [f"Target {target.id} is left out: {target.reason}." for target in left_out]
    camera = None if setup is None else setup.camera
    figure = resection_figure(
        pose,
        pixel_pitch=(camera.pixel_pitch if camera else None) or _SQUARE,
        sensor=camera.sensor if camera else None,
    )
    part.pictures.append(
        picture(
            figure,
            "pose",
            alt="Residuals of the targets as arrows on the picture, and of v against u.",
            caption="What the resection leaves of each target, magnified.",
            files=files,
            stem=f"calibration-{number}",
        )
    )


def _budget(
    points: Sequence[MeasuredPoint], setup: Setup, sweep: PitchSweep | None
) -> UncertaintyBudget:
    means = sorted(float(p.log["mean_angle_deg"]) for p in points if p.log.get("mean_angle_deg"))
    if not means:
        raise InputError("none of its points has a mean angle in log.csv; process them again")
    angles = sorted({round(float(each), 2) for each in np.quantile(means, (0, 0.5, 1))})
    used = [int(point.log["n_used"]) for point in points if point.log.get("n_used")]
    return uncertainty_budget(
        setup,
        angles,
        sweep=sweep,
        centroid_std_lines=_column_noise(points, setup),
        fields=max(1, int(np.median(used))),
    )


def _column_noise(points: Sequence[MeasuredPoint], setup: Setup) -> float:
    """Noise of one column's centre [lines] that gives the noise of the fields' angles."""
    std = np.concatenate([point.values["angle_std_deg"] for point in points])
    camera, used = setup.camera, std[np.isfinite(std)]
    if camera.sensor is None or camera.pixel_pitch is None or not used.size:
        return _USUAL_NOISE
    u = np.arange(0, camera.sensor[0], setup.glint.column_step, dtype=np.float64)
    spread = float(np.sqrt(np.sum((u - u.mean()) ** 2)))
    aspect = camera.pixel_pitch[0] / camera.pixel_pitch[1]
    return float(np.radians(np.median(used)) * spread * aspect)


def _add_budget(
    part: Part, budget: UncertaintyBudget, number: int, files: FigureFiles | None
) -> None:
    part.facts += [
        Fact("Noise of one column", f"{budget.centroid_std_lines:.4f} lines, as the fields state"),
        Fact("Fields averaged", f"{budget.fields}, the median"),
        Fact("Columns", str(budget.columns)),
        Fact("Monte Carlo", f"{budget.draws} draws"),
    ]
    if not budget.is_stated:
        part.notes.append(
            "The setup says nothing of how uncertain the camera is, so only what is seen in the "
            "fields and the sweep counts: add [uncertainty] to the setup, or calibrate camera and "
            "pose with glint-aoa calibrate."
        )
    part.tables += [_summary(budget), _sources(budget)]
    part.pictures.append(
        picture(
            budget_figure(budget),
            "budget",
            alt="Bars of what each source contributes to the angle, 1 sigma; figures in the table.",
            caption="What each source contributes to the angle's uncertainty, 1 sigma.",
            files=files,
            stem=f"budget-{number}",
        )
    )


def _summary(budget: UncertaintyBudget) -> Table:
    rows = [
        [
            Cell(f"{each.angle_deg:+.2f}", repr(each.angle_deg)),
            Cell(f"{each.intercept_mm:.1f}", repr(each.intercept_mm)),
            Cell(f"{each.u95_deg:.5f}", repr(each.u95_deg)),
            Cell(f"{each.monte_carlo.u95_deg:.5f}", repr(each.monte_carlo.u95_deg)),
            Cell("yes" if each.confirmed else "no"),
        ]
        for each in budget.angles
    ]
    header = ["Angle [deg]", "Glint at [mm]", "95 % within [deg]", "Monte Carlo [deg]", "Agree"]
    return Table("Uncertainty of the mean angle, by angle and place in the picture", header, rows)


def _sources(budget: UncertaintyBudget) -> Table:
    worst = max(budget.worst, key=lambda each: each.u95_deg)
    rows = [
        [
            Cell(row.source),
            Cell(f"{row.std:.3g} {row.unit}".removesuffix(" 1")),
            Cell(f"{row.contribution_deg:.5f}", repr(row.contribution_deg)),
            Cell(f"{100 * row.share:.1f}", repr(100 * row.share)),
        ]
        for row in worst.rows
        if row.std > 0
    ]
    header = ["Source", "1 sigma", "Contribution [deg]", "Share of variance [%]"]
    return Table(f"Budget at {worst.angle_deg:+.2f} deg, where it is largest", header, rows)
