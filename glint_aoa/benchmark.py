"""Optical against inertial: runs and points, and the paper's Table 4.

In each run the shaker is off at the first and the last point. The mean of the two is subtracted
from every point of the run, technique by technique, and what is left at the points with the
shaker on is the error due to dynamics.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from glint_aoa.errors import InputError
from glint_aoa.records.acquisition import AcquisitionRecord

__all__ = [
    "PAPER_TABLE_4",
    "TECHNIQUES",
    "BenchmarkPoint",
    "PaperRow",
    "PointError",
    "Table4Row",
    "by_run",
    "check_runs",
    "less",
    "moment_peak_to_peak_in_lb",
    "point_errors",
    "sample_std",
    "table4",
]

Plane = Literal["none", "yaw", "pitch"]
Kind = Literal["off", "sine", "modulated sine", "random", "sine sweep"]
Technique = Literal["video", "inertial", "inertial corrected"]

TECHNIQUES: tuple[Technique, ...] = ("video", "inertial", "inertial corrected")
"""The techniques of Table 4, and the paper's inertial technique after correction."""

_PLANES: tuple[Plane, ...] = ("yaw", "pitch")
_KINDS: tuple[Kind, ...] = ("sine", "modulated sine", "random", "sine sweep")


@dataclass(frozen=True)
class PaperRow:
    """A row of Table 4 as the paper prints it; angles in degrees."""

    mean_deg: float
    std_deg: float
    max_deg: float
    points: int


PAPER_TABLE_4: dict[tuple[str, str], PaperRow] = {
    ("video", "yaw"): PaperRow(0.000, 0.002, 0.006, 49),
    ("inertial", "yaw"): PaperRow(-0.050, 0.057, -0.217, 49),
    ("video", "pitch"): PaperRow(0.002, 0.004, 0.010, 42),
    ("inertial", "pitch"): PaperRow(-0.033, 0.046, -0.174, 42),
}
"""Table 4 of the paper, "Summary of AOA Error for Video and Inertial AOA Measurements", by
technique and excitation plane."""


@dataclass(frozen=True, kw_only=True)
class BenchmarkPoint:
    """One point of a run, as both techniques measured it.

    Attributes
    ----------
    run, point : str
        Names; the points of a run follow each other in the order in which they were taken.
    excitation : str
        What the shaker did, in words, such as "yaw sine 9.8 Hz".
    kind : {"off", "sine", "modulated sine", "random", "sine sweep"}
        Kind of excitation.
    plane : {"none", "yaw", "pitch"}
        Plane of the excitation; "none" with the shaker off.
    moment_in_lb_pp : float or None
        Peak-to-peak balance moment in that plane [in lbf].
    optical_deg, optical_std_deg : float
        Mean over the fields of the calibrated video angle, and their standard deviation [deg].
    intercept_mm, intercept_std_mm : float
        The same of the line's intercept [mm].
    inertial_deg : float
        Mean angle from the onboard package, uncorrected [deg].
    corrected_deg : float or None
        The same after correction of the vibration bias [deg].
    nominal_angle_deg : float or None
        Pitch angle that the support was set to [deg].
    flags : int
        Mask of `glint_aoa.flags.Flag`.

    Raises
    ------
    InputError
        If plane and kind contradict each other or are not known.
    """

    run: str
    point: str
    excitation: str
    kind: Kind
    plane: Plane
    moment_in_lb_pp: float | None
    optical_deg: float
    optical_std_deg: float
    intercept_mm: float
    intercept_std_mm: float
    inertial_deg: float
    corrected_deg: float | None = None
    nominal_angle_deg: float | None = None
    flags: int = 0

    def __post_init__(self) -> None:
        """Refuse an excitation that is not one."""
        for name, value, known in (
            ("plane", self.plane, ("none", *_PLANES)),
            ("kind", self.kind, ("off", *_KINDS)),
        ):
            if value not in known:
                raise InputError(
                    f"run {self.run}, point {self.point}: excitation {name} is {value!r}; "
                    f"choose one of {', '.join(known)}"
                )
        if (self.plane == "none") != (self.kind == "off"):
            raise InputError(
                f"run {self.run}, point {self.point}: excitation plane is {self.plane!r} with "
                f"kind {self.kind!r}; with the shaker off they are 'none' and 'off'"
            )

    @property
    def shaker_off(self) -> bool:
        """Whether the shaker was off."""
        return self.plane == "none"

    def angle_deg(self, technique: Technique) -> float | None:
        """Angle by `technique` [deg]; None where it was not measured."""
        angle = {
            "video": self.optical_deg,
            "inertial": self.inertial_deg,
            "inertial corrected": self.corrected_deg,
        }[technique]
        return angle if angle is not None and math.isfinite(angle) else None


@dataclass(frozen=True)
class PointError:
    """Errors of one point with the shaker on [deg]; None where a technique has no angle."""

    point: BenchmarkPoint
    video_deg: float | None
    inertial_deg: float | None
    corrected_deg: float | None

    def error_deg(self, technique: Technique) -> float | None:
        """Error of `technique` [deg]; None where it was not measured."""
        errors = (self.video_deg, self.inertial_deg, self.corrected_deg)
        return errors[TECHNIQUES.index(technique)]


@dataclass(frozen=True)
class Table4Row:
    """A row of Table 4.

    Attributes
    ----------
    technique : {"video", "inertial", "inertial corrected"}
        How the angle was measured.
    excitation : {"yaw", "pitch"}
        Plane of the excitation.
    kind : {"all", "sine", "modulated sine", "random", "sine sweep"}
        Kind of excitation that the row is about.
    mean_deg : float
        Mean error [deg].
    std_deg : float or None
        Standard deviation of the errors with n - 1 in the denominator [deg]; None for one point.
    max_deg : float
        Signed error of largest magnitude [deg].
    points : int
        Number of points.
    paper : PaperRow or None
        What the paper found.
    """

    technique: Technique
    excitation: Plane
    kind: str
    mean_deg: float
    std_deg: float | None
    max_deg: float
    points: int
    paper: PaperRow | None


def check_runs(points: Iterable[BenchmarkPoint]) -> None:
    """Check that each run starts and ends with the shaker off; no angle is looked at.

    Parameters
    ----------
    points : iterable of BenchmarkPoint
        All points, those of each run in the order in which they were taken.

    Raises
    ------
    InputError
        If a run does not, or there are no points; the message names the run.
    """
    for run, members in by_run(points).items():
        _check_ends(run, members)


def point_errors(points: Iterable[BenchmarkPoint]) -> list[PointError]:
    """Subtract the shaker-off angle of each run from its points.

    Parameters
    ----------
    points : iterable of BenchmarkPoint
        All points, those of each run in the order in which they were taken.

    Returns
    -------
    list of PointError
        The points with the shaker on, run by run.

    Raises
    ------
    InputError
        If a run does not start and end with the shaker off, or these points lack an angle;
        the message names the run.
    """
    errors = []
    for run, members in by_run(points).items():
        _check_ends(run, members)
        ends = members[0], members[-1]
        video, inertial = (_zero(run, ends, technique) for technique in TECHNIQUES[:2])
        corrected = _mean_angle(ends, "inertial corrected")
        errors += [
            PointError(
                point=point,
                video_deg=less(point.angle_deg("video"), video),
                inertial_deg=less(point.angle_deg("inertial"), inertial),
                corrected_deg=less(point.angle_deg("inertial corrected"), corrected),
            )
            for point in members
            if not point.shaker_off
        ]
    return errors


def table4(errors: Sequence[PointError], *, by_kind: bool = False) -> list[Table4Row]:
    """Summarise errors as in Table 4 of the paper.

    Parameters
    ----------
    errors : sequence of PointError
        From `point_errors`.
    by_kind : bool
        Whether to add rows for each kind of excitation after those for all.

    Returns
    -------
    list of Table4Row
        By excitation plane, kind and technique; what holds no point is left out.
    """
    rows = []
    for kind in ("all", *_KINDS) if by_kind else ("all",):
        for plane in _PLANES:
            for technique in TECHNIQUES:
                values = [
                    value
                    for error in errors
                    if error.point.plane == plane and kind in ("all", error.point.kind)
                    if (value := error.error_deg(technique)) is not None
                ]
                if values:
                    rows.append(_table4_row(technique, plane, kind, values))
    return rows


def moment_peak_to_peak_in_lb(record: AcquisitionRecord, plane: Plane) -> float | None:
    """Return the peak-to-peak balance moment of a record.

    Parameters
    ----------
    record : AcquisitionRecord
        Acquisition of one point.
    plane : {"yaw", "pitch", "none"}
        Yaw takes the first channel of quantity moment about model z, pitch the first about y;
        "none" gives None.

    Returns
    -------
    float or None
        Greatest less least value [in lbf]; None if there is no such channel or it holds no
        finite sample.
    """
    axis = {"yaw": "z", "pitch": "y", "none": ""}[plane]
    for channel in record.with_quantity("moment"):
        if axis and channel.axis is not None and channel.axis[-1:] == axis:
            moment = channel.values("in*lbf")
            finite = moment[np.isfinite(moment)]
            return float(np.ptp(finite)) if finite.size else None
    return None


def by_run(points: Iterable[BenchmarkPoint]) -> dict[str, list[BenchmarkPoint]]:
    """Sort points into their runs, in the order given; refuse none at all."""
    runs: dict[str, list[BenchmarkPoint]] = {}
    for point in points:
        runs.setdefault(point.run, []).append(point)
    if not runs:
        raise InputError("the benchmark holds no points; give the points of one run or more")
    return runs


def _check_ends(run: str, members: Sequence[BenchmarkPoint]) -> None:
    missing = [
        which
        for which, point in (("first", members[0]), ("last", members[-1]))
        if not point.shaker_off
    ]
    if missing:
        point = members[0] if missing[0] == "first" else members[-1]
        raise InputError(
            f"run {run}: the {' and '.join(missing)} point must have the shaker off, "
            f"point {point.point} has {point.excitation}; add that point or leave the run out"
        )
    if len(members) < 2:
        raise InputError(
            f"run {run}: one point only, a run starts and ends with the shaker off; "
            "add its other points or leave the run out"
        )


def _mean_angle(points: Sequence[BenchmarkPoint], technique: Technique) -> float | None:
    angles = [angle for point in points if (angle := point.angle_deg(technique)) is not None]
    return sum(angles) / len(angles) if len(angles) == len(points) else None


def _zero(run: str, ends: Sequence[BenchmarkPoint], technique: Technique) -> float:
    mean = _mean_angle(ends, technique)
    if mean is None:
        lacking = next(point for point in ends if point.angle_deg(technique) is None)
        raise InputError(
            f"run {run}: the shaker-off point {lacking.point} has no {technique} angle; "
            "measure it again or leave the run out"
        )
    return mean


def less(angle: float | None, zero: float | None) -> float | None:
    """Return the difference; None where one of the two is not there."""
    return None if angle is None or zero is None else angle - zero


def _table4_row(technique: Technique, plane: Plane, kind: str, values: list[float]) -> Table4Row:
    return Table4Row(
        technique=technique,
        excitation=plane,
        kind=kind,
        mean_deg=float(np.mean(values)),
        std_deg=sample_std(values),
        max_deg=max(values, key=abs),
        points=len(values),
        paper=PAPER_TABLE_4.get((technique, plane)) if kind == "all" else None,
    )


def sample_std(values: Sequence[float]) -> float | None:
    """Return the standard deviation over n - 1; None for less than two values."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else None
