"""Figures 18 to 26: filtered angle and integral-squared motion, their spectra, the residuals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.inertial.coherence import CrossSpectra, cross_spectra
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.inertial.package import calibrated_output
from glint_aoa.inertial.record_fit import Regression, regress
from glint_aoa.inertial.sensor import indicated_angle
from glint_aoa.paper_figures.figure_data import Axis, Curve, Fact, FigureData, Panel
from glint_aoa.paper_figures.points import CampaignPoint, as_recorded_on_line
from glint_aoa.paper_figures.table import FigureSpec
from glint_aoa.units import STANDARD_GRAVITY, convert

__all__ = ["coherence", "residual", "spectra", "time_series"]

_Floats = NDArray[np.float64]

_SHOWN_S = 70.0
"""Figures 18 and 21 show so much of the record [s]."""

_SEGMENT_S = 20.0
"""Length of a segment of the spectra [s]: bins of 0.05 Hz, six to the modulation's 0.3 Hz."""


@dataclass(frozen=True)
class _Square:
    """What an integral-squared signal comes from: units of the signal, and of its integral."""

    label: str
    si: str
    printed: str
    unit: str


_SQUARES = {
    "moment": _Square("integral-squared moment", "N*m", "in*lbf", "(in lbf s)"),
    "acceleration": _Square("integral-squared accelerometer", "m/s^2", "in/s^2", "(in/s)"),
}


@dataclass(frozen=True, eq=False)
class _Signals:
    """Filtered angle and integral-squared motion of a record, both behind the same low-pass.

    Attributes
    ----------
    time_s : ndarray [slow sample]
        Times after the trigger [s].
    angle_deg : ndarray [slow sample]
        Filtered angle [deg].
    squared : ndarray [slow sample]
        Integral-squared signal, in the paper's units.
    square : _Square
        What it comes from.
    """

    name: str
    time_s: _Floats
    angle_deg: _Floats
    squared: _Floats
    square: _Square

    @classmethod
    def of(cls, spec: FigureSpec, point: CampaignPoint) -> "_Signals":
        found = _regressed(spec, point)
        square = _SQUARES[spec.source]
        shown = found.time_s <= found.time_s[0] + _SHOWN_S
        shown &= found.used | found.uncorrelated
        squared = found.terms[0].slow * convert(square.si, square.printed) ** 2
        angle = np.degrees(indicated_angle(found.response))
        return cls(point.name, found.time_s[shown], angle[shown], squared[shown], square)

    @property
    def spectra(self) -> CrossSpectra:
        rate_hz = 1 / float(np.mean(np.diff(self.time_s)))
        return cross_spectra(self.angle_deg, self.squared, rate_hz, segment_s=_SEGMENT_S)


def time_series(spec: FigureSpec, points: Sequence[CampaignPoint]) -> FigureData:
    """Show filtered angle and integral-squared motion against time: figures 18 and 21.

    Parameters
    ----------
    spec : FigureSpec
        The figure.
    points : sequence of CampaignPoint
        That it can be made from; the longest record is taken.

    Returns
    -------
    FigureData
        Where the low-pass has settled, of the first 70 s. The fact is the correlation
        coefficient of the two.
    """
    found = _Signals.of(spec, _longest(points))
    square = Axis(found.square.label, f"{found.square.unit}^2")
    panels = (
        Panel(spec.y, (Curve("filtered angle", found.time_s, found.angle_deg),)),
        Panel(square, (Curve(found.square.label, found.time_s, found.squared),)),
    )
    together = float(np.corrcoef(found.angle_deg, found.squared)[0, 1])
    facts = (Fact("correlation", together, ""),)
    return FigureData(spec.number, spec.title, spec.x, panels, facts, (found.name,))


def spectra(spec: FigureSpec, points: Sequence[CampaignPoint]) -> FigureData:
    """Show the power spectra of filtered angle and integral-squared motion: figures 19 and 22.

    Parameters
    ----------
    spec : FigureSpec
        The figure; that of the accelerometer shows its own spectrum only, as the paper's.
    points : sequence of CampaignPoint
        That it can be made from; the longest record is taken.

    Returns
    -------
    FigureData
        Averaged over half-overlapped Hann windows of 20 s. The facts are where the power peaks
        [Hz] and its share below the peak.
    """
    found = _Signals.of(spec, _longest(points))
    both = found.spectra
    shown = _shown(spec, both.frequency_hz)
    square = Axis(spec.y.name, f"{found.square.unit}^4/Hz", log=True)
    drawn = [
        ("angle", "filtered angle", spec.y, both.first_power),
        ("square", found.square.label, square, both.second_power),
    ]
    if spec.source == "acceleration":
        drawn = drawn[1:]
    panels, facts = [], []
    for name, title, axis, power in drawn:
        frequency, density = both.frequency_hz[shown], power[shown]
        panels.append(Panel(axis, (Curve(title, frequency, density, "joined points"),), title))
        peak = float(frequency[np.argmax(density)])
        below = frequency < peak - 1.5 / _SEGMENT_S  # a Hann window is a bin and a half wide
        paper = spec.paper.get(f"peak of the {name}")
        facts.append(Fact(f"peak of the {name}", peak, "Hz", paper))
        share = 100 * float(density[below].sum() / density.sum())
        facts.append(Fact(f"power of the {name} below its peak", share, "%"))
    return FigureData(spec.number, spec.title, spec.x, tuple(panels), tuple(facts), (found.name,))


def coherence(spec: FigureSpec, points: Sequence[CampaignPoint]) -> FigureData:
    """Show the coherence of filtered angle and integral-squared motion: figures 20 and 23.

    Parameters
    ----------
    spec : FigureSpec
        The figure.
    points : sequence of CampaignPoint
        That it can be made from; the longest record is taken.

    Returns
    -------
    FigureData
        The squared coherence of eq. 10, and what independent signals exceed one time in twenty.
        The facts are the coherence where the angle's power peaks and its mean below.
    """
    found = _Signals.of(spec, _longest(points))
    both = found.spectra
    shown = _shown(spec, both.frequency_hz)
    frequency, coherent = both.frequency_hz[shown], both.coherence[shown]
    at = int(np.argmax(both.first_power[shown]))
    below = frequency < frequency[at] - 1.5 / _SEGMENT_S
    chance = np.full(frequency.size, both.by_chance())
    curves = (
        Curve("coherence", frequency, coherent, "joined points"),
        Curve("exceeded by chance, 5 %", frequency, chance),
    )
    facts = (
        Fact("frequency of the peak", float(frequency[at]), "Hz"),
        Fact("coherence there", float(coherent[at]), ""),
        Fact("mean coherence below", float(coherent[below].mean()), ""),
    )
    panel = Panel(spec.y, curves)
    return FigureData(spec.number, spec.title, spec.x, (panel,), facts, (found.name,))


def residual(spec: FigureSpec, points: Sequence[CampaignPoint]) -> FigureData:
    """Show the residual of the regression on the integral-squared moment: figures 24 to 26.

    Parameters
    ----------
    spec : FigureSpec
        The figure, with the stretch that is regressed.
    points : sequence of CampaignPoint
        That it can be made from; the longest record is taken.

    Returns
    -------
    FigureData
        The facts are the standard error [deg] and by how much it is below the standard deviation
        of the filtered angle.
    """
    point = _longest(points)
    found = _regressed(spec, point)
    stretch = found.used | found.uncorrelated
    slope = STANDARD_GRAVITY * np.cos(indicated_angle(found.response[stretch]))
    left = np.degrees(found.fit.residual[stretch] / slope)
    figures = found.figures()
    facts = (
        Fact(
            "standard error",
            figures["standard_error_deg"],
            "deg",
            spec.paper["standard error"],
        ),
        Fact("reduction", 100 * figures["reduction"], "%", spec.paper["reduction"]),
    )
    panel = Panel(spec.y, (Curve("residual", found.time_s[stretch], left),))
    return FigureData(spec.number, spec.title, spec.x, (panel,), facts, (point.name,))


def _regressed(spec: FigureSpec, point: CampaignPoint) -> Regression:
    record = as_recorded_on_line(point.record)
    inertial = point.setup.inertial
    task = CorrectionTask(record, calibrated_output(record, inertial), (), inertial.filter)
    plane = point.announced.plane
    assert plane != "none"  # of a point with the shaker on
    return regress(task, source=spec.source, planes=(plane,), between_s=spec.between_s)


def _shown(spec: FigureSpec, frequency_hz: _Floats) -> NDArray[np.bool_]:
    """Bins [bin] within the figure's axis but zero, whose power the removed mean took."""
    highest = np.inf if spec.x.high is None else spec.x.high * (1 + 1e-6)
    return (frequency_hz > 0) & (frequency_hz <= highest)


def _longest(points: Sequence[CampaignPoint]) -> CampaignPoint:
    return max(points, key=lambda point: point.duration_s)
