"""Recorded points as the figures see them, and the choice among them."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import get_args

import numpy as np
from scipy.ndimage import uniform_filter1d

from glint_aoa.benchmark import BenchmarkPoint, moment_peak_to_peak_in_lb
from glint_aoa.campaign import announced_point
from glint_aoa.errors import InputError
from glint_aoa.inertial.static import static_angle
from glint_aoa.paper_figures.table import Kind, Wanted
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.conditioning import prepared
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.formats import HDF5_SUFFIXES, open_acquisition, open_fields, said_of
from glint_aoa.records.formats.hdf5 import has_fields
from glint_aoa.setup import Setup

__all__ = ["CampaignPoint", "MissingPointError", "as_recorded_on_line", "chosen", "read_points"]

_SAME_ANGLE_DEG = 0.1
_SAME_MODE = 0.05  # of the frequency; the paper's first mode moved by a tenth, its plane says which
_SAMPLE_S = 0.01  # a record is as long as its samples reach: the last period is not recorded
_WINDOW_S = 0.2  # over which the shaker's power is averaged: the crest of a sine is no stop
_OFF_S = 5.0  # that the shaker must be silent at the end: modulated sines rest for less
_FREQUENCY = re.compile(r"(\d+(?:\.\d+)?)\s*Hz")


class MissingPointError(InputError):
    """No recorded point can feed a figure; the message says what is wanted."""


@dataclass(frozen=True, eq=False)
class CampaignPoint:
    """One recorded point.

    Attributes
    ----------
    path : Path
        Its file.
    announced : BenchmarkPoint
        What its description says of run and excitation; no angles.
    setup : Setup
        The setup.
    shaker_off_s : float or None
        When the description says that the shaker stopped [s].
    zero_points : tuple of CampaignPoint
        First and last point of its run, with the shaker off; empty for a point of no such run.
    """

    path: Path
    announced: BenchmarkPoint
    setup: Setup
    shaker_off_s: float | None = None
    zero_points: "tuple[CampaignPoint, ...]" = ()

    @property
    def name(self) -> str:
        """Its name."""
        return self.announced.point

    @property
    def frequency_hz(self) -> float | None:
        """First frequency in the words of its excitation [Hz]."""
        found = _FREQUENCY.search(self.announced.excitation)
        return float(found[1]) if found else None

    @cached_property
    def record(self) -> AcquisitionRecord:
        """Its acquisition channels, on one clock."""
        return prepared(open_acquisition(self.path, self.setup.inertial))

    @cached_property
    def duration_s(self) -> float:
        """Length of its acquisition record [s]."""
        clock = self.record.package_clock()
        return clock.size / clock.rate_hz

    @cached_property
    def moment_in_lb(self) -> float:
        """Peak-to-peak balance moment in the plane of the excitation [in lbf]; NaN without one."""
        moment = moment_peak_to_peak_in_lb(self.record, self.announced.plane)
        return np.nan if moment is None else moment

    @cached_property
    def off_s(self) -> float | None:
        """When the shaker stopped within the record [s]; None if it did not, or is not recorded."""
        if self.shaker_off_s is not None:
            return self.shaker_off_s
        return _last_drive_s(self.record)

    @cached_property
    def film_s(self) -> float:
        """How long its fields last [s]; 0 where there are none."""
        if self.path.suffix.lower() in HDF5_SUFFIXES and not has_fields(self.path):
            return 0.0
        stack = self.fields()
        return stack.n_fields / (stack.info.rate_hz or self.setup.fields.rate or np.inf)

    def fields(self) -> FieldStack:
        """Open its fields."""
        return open_fields(self.path)

    def zero_deg(self) -> float:
        """Mean indicated angle of the first and the last point of its run [deg]."""
        inertial = self.setup.inertial
        records = (as_recorded_on_line(point.record) for point in self.zero_points)
        return float(np.mean([static_angle(record, inertial)[0] for record in records]))


def as_recorded_on_line(record: AcquisitionRecord) -> AcquisitionRecord:
    """Keep the package's filtered output, which the paper's figures show, where it is recorded."""
    if not record.with_quantity("aoa_filtered"):
        return record
    kept = {k: c for k, c in record.channels.items() if c.quantity != "aoa_unfiltered"}
    return replace(record, channels=kept)


def read_points(paths: Iterable[str | Path], setup: Setup) -> list[CampaignPoint]:
    """Read what recorded points say of themselves.

    Parameters
    ----------
    paths : iterable of str or Path
        Recorded points with acquisition channels; those of a run in the order in which they were
        taken.
    setup : Setup
        The setup.

    Returns
    -------
    list of CampaignPoint
        In the order given, each with the shaker-off points of its run.

    Raises
    ------
    RecordingError
        If a file cannot be read, or does not say run, point and excitation.
    """
    points = [point for path in paths if (point := _read(Path(path), setup)) is not None]
    runs: dict[str, list[CampaignPoint]] = {}
    for point in points:
        runs.setdefault(point.announced.run, []).append(point)
    return [replace(each, zero_points=_ends(runs[each.announced.run])) for each in points]


def chosen(points: Sequence[CampaignPoint], wanted: Wanted) -> list[CampaignPoint]:
    """Choose the points that a figure can be made from.

    Parameters
    ----------
    points : sequence of CampaignPoint
        All that are recorded.
    wanted : Wanted
        What the figure needs.

    Returns
    -------
    list of CampaignPoint
        At least one, in their order.

    Raises
    ------
    MissingPointError
        If there is none.
    """
    found = [point for point in points if _is_wanted(point, wanted)]
    if not found:
        raise MissingPointError(f"no point with {wanted}")
    return found


def _read(path: Path, setup: Setup) -> CampaignPoint | None:
    """Read one point; None for a single record of an excitation that no figure shows."""
    meta = said_of(path)
    if meta.get("run_kind") == "record" and meta.get("excitation_kind") not in get_args(Kind):
        return None
    off = meta.get("shaker_off_s")
    return CampaignPoint(
        path,
        announced_point(path, meta),
        setup,
        shaker_off_s=float(off) if isinstance(off, int | float) else None,
    )


def _ends(run: list[CampaignPoint]) -> tuple[CampaignPoint, ...]:
    ends = (run[0], run[-1])
    return ends if len(run) > 1 and all(point.announced.shaker_off for point in ends) else ()


def _is_wanted(point: CampaignPoint, wanted: Wanted) -> bool:
    """Whether a point will do; what takes reading its channels is asked last."""
    said = point.announced
    return (
        not said.shaker_off
        and wanted.plane in (None, said.plane)
        and wanted.kind in (None, said.kind)
        and (not wanted.in_run or bool(point.zero_points))
        and _is_near(point.frequency_hz, wanted.frequency_hz, _SAME_MODE)
        and _is_angle(said.nominal_angle_deg, wanted)
        and point.film_s >= wanted.least_film_s
        and (wanted.least_s == 0 or point.duration_s >= wanted.least_s - _SAMPLE_S)
        and (not wanted.shuts_off or point.off_s is not None)
        and (wanted.most_in_lb == np.inf or point.moment_in_lb <= wanted.most_in_lb)
    )


def _is_near(found: float | None, wanted: float | None, share: float) -> bool:
    return wanted is None or (found is not None and abs(found - wanted) <= share * wanted)


def _is_angle(nominal_deg: float | None, wanted: Wanted) -> bool:
    found = 0.0 if nominal_deg is None else nominal_deg
    if wanted.angle_deg is not None:
        return abs(found - wanted.angle_deg) < _SAME_ANGLE_DEG
    if wanted.other_than_deg is not None:
        return abs(found - wanted.other_than_deg) >= _SAME_ANGLE_DEG
    return True


def _last_drive_s(record: AcquisitionRecord) -> float | None:
    """Time of the last sample at which the shaker's signal has half its largest power [s]."""
    for channel in record.with_quantity("excitation")[:1]:
        drive = np.nan_to_num(np.asarray(channel.samples, np.float64))
        window = max(round(_WINDOW_S * channel.rate_hz), 1)
        level = uniform_filter1d((drive - drive.mean()) ** 2, window)
        at_work = np.flatnonzero(level > level.max() / 2)
        if at_work.size:
            silent_s = (level.size - 1 - at_work[-1]) / channel.rate_hz
            if silent_s > _OFF_S:
                return float(channel.start_s + at_work[-1] / channel.rate_hz)
    return None
