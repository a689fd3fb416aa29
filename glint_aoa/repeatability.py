"""Repeatability with the shaker off, beside the paper's."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from glint_aoa.benchmark import (
    TECHNIQUES,
    BenchmarkPoint,
    by_run,
    check_runs,
    less,
    sample_std,
)

__all__ = ["PAPER_REPEATABILITY", "RepeatabilityRow", "repeatability"]

_Units = Literal["deg", "in"]
_MM_PER_IN = 25.4

PAPER_REPEATABILITY: dict[tuple[str, str], float] = {
    ("video angle, short term", "mean std"): 0.0018,
    ("video angle, short term", "max std"): 0.0034,
    ("intercept, short term", "mean std"): 0.0002,
    ("intercept, short term", "max std"): 0.0006,
    ("video angle, long term", "std"): 0.0035,
    ("onboard angle, long term", "std"): 0.0026,
    ("video - onboard, long term", "std"): 0.0016,
    ("intercept, long term", "std"): 0.0012,
    ("video angle, first - last", "std"): 0.0039,
    ("onboard angle, first - last", "std"): 0.0023,
}
"""Repeatability with the shaker off, from the paper's section "Optical System"; angles in
degrees, intercepts in inches."""


@dataclass(frozen=True)
class RepeatabilityRow:
    """One figure of repeatability with the shaker off.

    Attributes
    ----------
    quantity, statistic : str
        What it is the repeatability of, and how it is expressed.
    value : float or None
        The figure, 1 sigma [`units`]; None where there are too few points.
    units : {"deg", "in"}
        Unit of `value` and `paper`.
    count : int
        Number of points (or of runs, for first - last) behind it.
    paper : float
        What the paper found [`units`].
    """

    quantity: str
    statistic: str
    value: float | None
    units: _Units
    count: int
    paper: float

    @property
    def value_mm(self) -> float | None:
        """A length in millimetres [mm]; None for angles."""
        return None if self.value is None or self.units == "deg" else self.value * _MM_PER_IN


def repeatability(points: Iterable[BenchmarkPoint]) -> list[RepeatabilityRow]:
    """Evaluate repeatability from the points with the shaker off, as the paper does.

    Short term: standard deviation over the fields of a point, mean and largest over the points.
    Long term: standard deviation of the points' means, pooled over runs of one nominal angle
    (n - 1 in each group; runs without a nominal angle stand alone). First - last: standard
    deviation over the runs of the difference between a run's first and last point.

    Parameters
    ----------
    points : iterable of BenchmarkPoint
        All points; those with the shaker on are left out.

    Returns
    -------
    list of RepeatabilityRow
        Each beside the paper's figure.

    Raises
    ------
    InputError
        If a run does not start and end with the shaker off.
    """
    points = list(points)
    check_runs(points)
    runs = by_run(points)
    off = [point for members in runs.values() for point in members if point.shaker_off]
    return [*_short_term(off), *_long_term(off), *_first_minus_last(runs)]


def _short_term(off: Sequence[BenchmarkPoint]) -> list[RepeatabilityRow]:
    angle = [point.optical_std_deg for point in off]
    intercept = [point.intercept_std_mm / _MM_PER_IN for point in off]
    return [
        *_mean_and_max("video angle, short term", angle, "deg"),
        *_mean_and_max("intercept, short term", intercept, "in"),
    ]


def _mean_and_max(quantity: str, values: Sequence[float], units: _Units) -> list[RepeatabilityRow]:
    measured = [value for value in values if math.isfinite(value)]
    mean, largest = (float(np.mean(measured)), max(measured)) if measured else (None, None)
    return [
        _row(quantity, "mean std", mean, units, len(measured)),
        _row(quantity, "max std", largest, units, len(measured)),
    ]


def _long_term(off: Sequence[BenchmarkPoint]) -> list[RepeatabilityRow]:
    video = [(point, point.angle_deg("video")) for point in off]
    onboard = [(point, point.angle_deg("inertial")) for point in off]
    both = [
        (point, less(optical, inertial))
        for (point, optical), (_, inertial) in zip(video, onboard, strict=True)
    ]
    intercept = [
        (point, point.intercept_mm / _MM_PER_IN if math.isfinite(point.intercept_mm) else None)
        for point in off
    ]
    return [
        _row("video angle, long term", "std", _pooled_std(video), "deg", _measured(video)),
        _row("onboard angle, long term", "std", _pooled_std(onboard), "deg", _measured(onboard)),
        _row("video - onboard, long term", "std", _pooled_std(both), "deg", _measured(both)),
        _row("intercept, long term", "std", _pooled_std(intercept), "in", _measured(intercept)),
    ]


def _measured(values: Sequence[tuple[BenchmarkPoint, float | None]]) -> int:
    return sum(value is not None for _, value in values)


def _pooled_std(values: Sequence[tuple[BenchmarkPoint, float | None]]) -> float | None:
    groups: dict[float | str, list[float]] = {}
    for point, value in values:
        nominal = point.nominal_angle_deg
        if value is not None:
            groups.setdefault(point.run if nominal is None else nominal, []).append(value)
    freedom = sum(len(group) - 1 for group in groups.values())
    if freedom < 1:
        return None
    squares = sum(float(np.var(group)) * len(group) for group in groups.values())
    return math.sqrt(squares / freedom)


def _first_minus_last(runs: dict[str, list[BenchmarkPoint]]) -> list[RepeatabilityRow]:
    rows = []
    for name, technique in (("video angle", TECHNIQUES[0]), ("onboard angle", TECHNIQUES[1])):
        ends = [
            (run[0].angle_deg(technique), run[-1].angle_deg(technique)) for run in runs.values()
        ]
        differences = [value for pair in ends if (value := less(*pair)) is not None]
        quantity = f"{name}, first - last"
        rows.append(_row(quantity, "std", sample_std(differences), "deg", len(differences)))
    return rows


def _row(
    quantity: str, statistic: str, value: float | None, units: _Units, count: int
) -> RepeatabilityRow:
    paper = PAPER_REPEATABILITY[quantity, statistic]
    return RepeatabilityRow(quantity, statistic, value, units, count, paper)
