"""The inertial part of the paper beside ours: Table 1 and the errors behind Figures 11 to 17.

Records are handed in; how they were made is not known here. Each is corrected by several methods
and held against the angle of the motionless model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from glint_aoa.errors import InputError
from glint_aoa.flags import Flag
from glint_aoa.inertial.correct import Correction, correct
from glint_aoa.inertial.modes import TABLE_1, Mode, ModeShape, RotationPoint, rotation_point
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.setup import Inertial

__all__ = [
    "LIMIT_DEG",
    "PAPER_FIGURES",
    "FigureRow",
    "PaperFigure",
    "StudyRecord",
    "Table1Row",
    "figure_row",
    "shift",
    "table_1",
]

LIMIT_DEG = 0.002
"""What a method may leave of the bias where its assumptions hold [deg]."""

_SAME_MODE = 0.1
"""Two frequencies within this fraction may be those of one mode."""

_NOISE_DEG = 1e-4
"""What noise of the accelerometers moves an angle that is left as it is [deg]."""

_RADIUS_PRINTED_M = 0.1 * 0.0254

_DECAYED_S = 6.0
"""After the shaker is shut off: a first mode of 1 % damping has decayed and the filter settled."""

Statistic = Literal["shift", "mean", "largest"]


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper: what it shows, and its numbers where the text gives them.

    Attributes
    ----------
    number : int
        Of the figure.
    what : str
        Excitation, in words.
    statistic : {"shift", "mean", "largest"}
        "shift": indicated angle with the shaker on less that with it off. "mean": mean error of a
        record, the largest of all levels. "largest": largest error at any time of the record.
    raw_deg, left_deg : float
        Bias and what the paper's modal correction left of it [deg]; NaN where it gives none.
    sign : int
        Sign of the bias that the figure shows.
    is_one_mode : bool
        Whether the model moves in one mode of the survey. Where it does not, a modal correction
        from one accelerometer a plane is held to improve the angle, no more.
    """

    number: int
    what: str
    statistic: Statistic
    raw_deg: float = float("nan")
    left_deg: float = float("nan")
    sign: int = -1
    is_one_mode: bool = True


PAPER_FIGURES: Mapping[int, PaperFigure] = {
    each.number: each
    for each in (
        PaperFigure(11, "yaw sine 9.8 Hz, on then off", "shift"),
        PaperFigure(12, "yaw sine 19.5 Hz, on then off", "shift", is_one_mode=False),
        PaperFigure(13, "yaw sine 29.8 Hz, on then off", "shift", sign=1, is_one_mode=False),
        PaperFigure(14, "yaw sine 9.8 Hz, levels", "mean", -0.146, -0.009),
        PaperFigure(15, "pitch sine 9.2 Hz, levels", "mean", -0.175, -0.006),
        PaperFigure(16, "pitch 9.2 Hz modulated at 0.25 Hz", "largest", left_deg=0.005),
        PaperFigure(17, "pitch random 5-60 Hz, 8 s", "largest", is_one_mode=False),
    )
}
"""Figures 11 to 17; the numbers are those of the section "Modal Correction Technique"."""


@dataclass(frozen=True, eq=False)
class StudyRecord:
    """One record of the study.

    Attributes
    ----------
    record : AcquisitionRecord
        Package output, accelerometers and balance.
    static_deg : float
        Angle of the motionless model [deg].
    off_s : float or None
        When the shaker was shut off [s]; None if it was on throughout.
    """

    record: AcquisitionRecord
    static_deg: float
    off_s: float | None = None


@dataclass(frozen=True)
class FigureRow:
    """A figure of the paper beside ours.

    Attributes
    ----------
    paper : PaperFigure
        As printed.
    raw_deg : float
        Bias of the uncorrected angle [deg], by the figure's statistic.
    left_deg : mapping of str to float
        What each method left of it [deg].
    std_deg : mapping of str to float
        What each method says its uncertainty is, 1 sigma [deg]: root mean square over the rows.
    """

    paper: PaperFigure
    raw_deg: float
    left_deg: Mapping[str, float]
    std_deg: Mapping[str, float]

    @property
    def is_met(self) -> bool:
        """Whether the bias has the paper's sign and every method leaves what it may."""
        if np.sign(self.raw_deg) != self.paper.sign:
            return False
        improved = abs(self.raw_deg) + _NOISE_DEG
        modal = LIMIT_DEG if self.paper.is_one_mode else improved
        return all(
            abs(left) <= (modal if name == "modal" else LIMIT_DEG)
            for name, left in self.left_deg.items()
        )


@dataclass(frozen=True)
class Table1Row:
    """A mode of Table 1 beside the survey's.

    Attributes
    ----------
    paper : Mode
        As printed.
    found : RotationPoint or None
        The survey's; None if it did not find the mode.
    """

    paper: Mode
    found: RotationPoint | None

    @property
    def is_met(self) -> bool:
        """Whether the survey found the radius within three of its standard deviations and 0.1 in.

        The larger of the two: the paper prints radii to 0.1 in and 0.01 in.
        """
        if self.found is None:
            return False
        error = abs(self.found.mode.radius_m - self.paper.radius_m)
        return error <= max(3 * self.found.radius_std_m, _RADIUS_PRINTED_M)


def figure_row(
    number: int,
    records: Sequence[StudyRecord],
    inertial: Inertial,
    *,
    methods: Mapping[str, Sequence[str]],
) -> FigureRow:
    """Correct the records of a figure and hold what is left against the paper.

    Parameters
    ----------
    number : int
        Of the figure, 11 to 17.
    records : sequence of StudyRecord
        One for each level.
    inertial : Inertial
        Filter and modes.
    methods : mapping of str to sequence of str
        Methods of `correct`, and the channels that each may use; all if empty.

    Returns
    -------
    FigureRow
        Of several levels, the largest error by magnitude.

    Raises
    ------
    InputError
        If there is no such figure or no record; and as for `correct`.
    """
    if number not in PAPER_FIGURES or not records:
        raise InputError(f"figure {number} with {len(records)} records; give records for 11 to 17")
    paper = PAPER_FIGURES[number]
    raw: list[float] = []
    left: dict[str, list[float]] = {name: [] for name in methods}
    std: dict[str, list[float]] = {name: [] for name in methods}
    for each in records:
        for name, channels in methods.items():
            result = correct(_only(each.record, channels), inertial, method=name)
            shown = _statistic(paper.statistic, result, each)
            left[name].append(shown[1])
            std[name].append(float(np.sqrt(np.mean(result.angle_std_deg[result.settled] ** 2))))
        raw.append(shown[0])
    return FigureRow(
        paper=paper,
        raw_deg=_largest(raw),
        left_deg={name: _largest(values) for name, values in left.items()},
        std_deg={name: max(values) for name, values in std.items()},
    )


def table_1(shapes: Sequence[ModeShape], sensor_station_m: float) -> list[Table1Row]:
    """Hold the modes of a survey against Table 1.

    Parameters
    ----------
    shapes : sequence of ModeShape
        Of both planes.
    sensor_station_m : float
        Station of the inertial sensor, model x [m].

    Returns
    -------
    list of Table1Row
        One for each mode of Table 1, with the shape of its plane nearest in frequency, if there
        is one within a tenth.
    """
    rows = []
    for mode in TABLE_1:
        off = {
            abs(shape.frequency_hz - mode.frequency_hz): shape
            for shape in shapes
            if shape.plane == mode.plane
        }
        nearest = min(off, default=np.inf)
        found = nearest < _SAME_MODE * mode.frequency_hz
        rows.append(
            Table1Row(mode, rotation_point(off[nearest], sensor_station_m) if found else None)
        )
    return rows


def shift(result: Correction, each: StudyRecord) -> tuple[float, float]:
    """Angle with the shaker on less that after it stopped, as figures 11 to 13 show it.

    Parameters
    ----------
    result : Correction
        Of the record.
    each : StudyRecord
        When the shaker stopped; 3 s to either side of that are left out.

    Returns
    -------
    raw, corrected : float
        Shift of the uncorrected and of the corrected mean angle [deg].

    Raises
    ------
    InputError
        If nothing settled is left on one of the sides.
    """
    settled = (result.flags & int(Flag.FILTER_SETTLING)) == 0
    off = np.inf if each.off_s is None else each.off_s
    margin = _DECAYED_S / 2
    on = settled & (result.time_s < off - margin)
    after = settled & (result.time_s > off + margin)
    if not (on.any() and after.any()):
        raise InputError(
            f"{each.record.name}: too short on either side of the shaker's shut-off; record longer"
        )
    angles = np.array([result.raw_angle_deg, result.angle_deg])
    raw, corrected = angles[:, on].mean(axis=1) - angles[:, after].mean(axis=1)
    return float(raw), float(corrected)


def _only(record: AcquisitionRecord, names: Sequence[str]) -> AcquisitionRecord:
    if not names:
        return record
    return AcquisitionRecord(record.name, {name: record[name] for name in names}, record.meta)


def _statistic(statistic: Statistic, result: Correction, each: StudyRecord) -> tuple[float, float]:
    """Error of raw and corrected angle [deg] by the figure's statistic."""
    if statistic == "shift":
        return shift(result, each)
    settled = (result.flags & int(Flag.FILTER_SETTLING)) == 0
    errors = np.array([result.raw_angle_deg, result.angle_deg]) - each.static_deg
    if statistic == "mean":
        values = errors[:, settled].mean(axis=1)
    else:
        at = np.argmax(np.abs(errors[:, settled]), axis=1)
        values = errors[:, settled][[0, 1], at]
    return float(values[0]), float(values[1])


def _largest(values: Sequence[float]) -> float:
    return max(values, key=abs)
