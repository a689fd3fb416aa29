"""Figures 11 to 17: the bias of the indicated angle, measured and estimated."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glint_aoa.inertial.channels import package_output
from glint_aoa.inertial.correct import Correction, correct
from glint_aoa.inertial_benchmark import StudyRecord, shift
from glint_aoa.paper_figures.figure_data import Curve, Fact, FigureData, Panel
from glint_aoa.paper_figures.points import CampaignPoint, as_recorded_on_line
from glint_aoa.paper_figures.table import FigureSpec
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.setup import Inertial

__all__ = ["bias_in_time", "bias_of_levels", "shut_off"]

_Floats = NDArray[np.float64]

_SAME_STATION_M = 0.01


@dataclass(frozen=True, eq=False)
class _Corrected:
    """A point and its modal correction, as the paper's: one accelerometer a plane."""

    point: CampaignPoint
    correction: Correction

    @classmethod
    def of(cls, point: CampaignPoint, inertial: Inertial) -> "_Corrected":
        record = _with_face_accelerometers(as_recorded_on_line(point.record))
        return cls(point, correct(record, inertial, method="modal"))

    @cached_property
    def zero_deg(self) -> float:
        return self.point.zero_deg()

    @property
    def measured_deg(self) -> _Floats:
        """Indicated angle less that with the shaker off [row]."""
        return self.correction.raw_angle_deg - self.zero_deg

    @property
    def estimated_deg(self) -> _Floats:
        """Bias that the correction estimates [row]; NaN where it has not settled."""
        settled = self.correction.settled
        return np.where(settled, self.correction.bias_deg, np.nan)


def shut_off(spec: FigureSpec, points: Sequence[CampaignPoint]) -> FigureData:
    """Show the indicated angle against time while the shaker is on, then off: figures 11 to 13.

    Parameters
    ----------
    spec : FigureSpec
        The figure.
    points : sequence of CampaignPoint
        That it can be made from; the one at the largest moment is taken.

    Returns
    -------
    FigureData
        The fact is the angle with the shaker on less that after it stopped [deg].
    """
    point = _largest(points)
    record = as_recorded_on_line(point.record)
    found = correct(record, point.setup.inertial)
    raw, left = shift(found, StudyRecord(record, static_deg=0.0, off_s=point.off_s))
    curves = (
        Curve("indicated", found.time_s, found.raw_angle_deg),
        Curve(
            "corrected",
            found.time_s[found.settled],
            found.angle_deg[found.settled],
        ),
    )
    off = () if point.off_s is None else (point.off_s,)
    facts = (
        Fact("shift", raw, "deg", spec.paper["shift"]),
        Fact("shift left after correction", left, "deg"),
    )
    panel = Panel(spec.y, curves, marked_x=off)
    return FigureData(spec.number, spec.title, spec.x, (panel,), facts, (point.name,))


def bias_of_levels(spec: FigureSpec, points: Sequence[CampaignPoint]) -> FigureData:
    """Show the mean bias against level, measured and by the modal correction: figures 14 and 15.

    Parameters
    ----------
    spec : FigureSpec
        The figure.
    points : sequence of CampaignPoint
        One for each level.

    Returns
    -------
    FigureData
        Measured: mean indicated angle less that of the run's shaker-off points. The facts are the
        largest bias and the largest that the estimate leaves of it [deg].
    """
    points = sorted(points, key=lambda point: point.moment_in_lb)
    found = [_Corrected.of(point, point.setup.inertial) for point in points]
    moment = np.array([point.moment_in_lb for point in points])
    settled = [each.correction.settled for each in found]
    measured, estimated = (
        np.array(
            [np.mean(getattr(each, name)[use]) for each, use in zip(found, settled, strict=True)]
        )
        for name in ("measured_deg", "estimated_deg")
    )
    left = measured - estimated
    curves = (
        Curve("measured", moment, measured, "points"),
        Curve("estimated, modal", moment, estimated, "joined points"),
    )
    facts = (
        Fact("largest bias", _extreme(measured), "deg", spec.paper["largest bias"]),
        Fact("at a moment of", float(moment[np.argmax(np.abs(measured))]), "in lbf"),
        Fact("largest left", _extreme(left), "deg", spec.paper["largest left"]),
    )
    names = tuple(point.name for point in points)
    return FigureData(spec.number, spec.title, spec.x, (Panel(spec.y, curves),), facts, names)


def bias_in_time(spec: FigureSpec, points: Sequence[CampaignPoint]) -> FigureData:
    """Show the bias against time, measured and by the modal correction: figures 16 and 17.

    Parameters
    ----------
    spec : FigureSpec
        The figure; of a random excitation, the lowest mode of the plane alone is estimated.
    points : sequence of CampaignPoint
        That it can be made from; the one at the largest moment is taken.

    Returns
    -------
    FigureData
        Measured: indicated angle less that of the run's shaker-off points. The facts are the
        largest and the rms difference where the estimate has settled [deg].
    """
    point = _largest(points)
    inertial = point.setup.inertial
    is_random = point.announced.kind == "random"
    found = _Corrected.of(point, _lowest_mode(inertial, point) if is_random else inertial)
    time, estimated = found.correction.time_s, found.estimated_deg
    difference = (found.measured_deg - estimated)[found.correction.settled]
    label = "estimated, modal, first mode alone" if is_random else "estimated, modal"
    curves = (Curve("measured", time, found.measured_deg), Curve(label, time, estimated))
    facts = (
        Fact("largest bias", _extreme(found.measured_deg), "deg"),
        Fact(
            "largest difference", _extreme(difference), "deg", spec.paper.get("largest difference")
        ),
        Fact("rms difference", float(np.sqrt(np.mean(difference**2))), "deg"),
    )
    panel = Panel(spec.y, curves)
    return FigureData(spec.number, spec.title, spec.x, (panel,), facts, (point.name,))


def _largest(points: Sequence[CampaignPoint]) -> CampaignPoint:
    return max(points, key=lambda point: np.nan_to_num(point.moment_in_lb))


def _extreme(values: _Floats) -> float:
    return float(values[np.argmax(np.abs(values))])


def _with_face_accelerometers(record: AcquisitionRecord) -> AcquisitionRecord:
    """Leave out accelerometers that are not where the package is; the paper's method had none."""
    station = package_output(record).channel.station_m
    if station is None:
        return record
    kept = {
        name: channel
        for name, channel in record.channels.items()
        if channel.quantity != "acceleration"
        or channel.station_m is None
        or abs(channel.station_m - station) < _SAME_STATION_M
    }
    return AcquisitionRecord(record.name, kept, record.meta)


def _lowest_mode(inertial: Inertial, point: CampaignPoint) -> Inertial:
    in_plane = [mode for mode in inertial.mode if mode.plane == point.announced.plane]
    lowest = sorted(in_plane, key=lambda mode: mode.frequency)[:1]
    return inertial.model_copy(update={"mode": tuple(lowest)})
