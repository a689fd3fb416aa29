"""Figures of a pitch sweep: what it takes out, what it leaves, and whether it still holds."""

import textwrap
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from calibration.drift.check import Drift
from calibration.sweep.fit import PitchSweep, SweepCurve, SweepPoint
from glint_aoa.coverage import coverage_factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["drift_figure", "sweep_figure"]

_BLUE, _ORANGE, _GREY = "#0072B2", "#D55E00", "#7F7F7F"  # Okabe and Ito
_WAYS = {"^": "on the way up", "v": "on the way down", "o": "points"}
_U95 = coverage_factor()
_BEYOND = 1.6  # times the largest residual used, from which a point left out is drawn at the edge


def sweep_figure(sweep: PitchSweep) -> Figure:
    """Draw a pitch sweep: what the calibration takes out, and what it leaves.

    Parameters
    ----------
    sweep : PitchSweep
        The calibration.

    Returns
    -------
    Figure
        Above, onboard less optical angle [deg] with the curve of each tunnel temperature; below,
        residuals [deg] with their stated uncertainty, the calibration's, and the prediction
        interval of another point, all 95 %, against optical angle. Triangles point where the
        sweep went; crosses are points left out.
    """
    figure = Figure(figsize=(8, 6.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1, 1))
    colours = _colours(len(sweep.curves))
    _draw_bands(below, sweep)
    for curve, colour in zip(sweep.curves, colours, strict=True):
        _draw_curve(above, curve, colour)
        _draw_points(above, below, sweep, curve, colour)
    _draw_left_out(above, below, sweep)
    above.set_ylabel("onboard - optical [deg]")
    below.set_ylabel("residual [deg]")
    below.set_xlabel("optical angle before calibration [deg]")
    for axes in (above, below):
        axes.grid(alpha=0.25)
    above.legend(fontsize="small")
    below.legend(ncols=2, fontsize="small", loc="upper center", bbox_to_anchor=(0.5, -0.2))
    figure.suptitle("\n".join(_title(sweep)), fontsize="medium")
    return figure


def drift_figure(drift: Drift) -> Figure:
    """Draw check points against the sweep they check.

    Parameters
    ----------
    drift : Drift
        From `calibration.drift.check.check_drift`.

    Returns
    -------
    Figure
        Above, calibrated optical less onboard angle [deg]; below, intercept less the sweep's
        [mm]; both against the onboard angle, with 95 % intervals and the straight lines through
        them. The verdict is the title.
    """
    figure = Figure(figsize=(8, 6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    angle = np.array([each.point.onboard_deg for each in drift.points])
    rows = [(each.angle_deg, each.angle_std_deg) for each in drift.points]
    _draw_shifts(above, angle, np.array(rows), drift, "angle")
    known = [
        (each.intercept_mm, each.intercept_std_mm)
        for each in drift.points
        if each.intercept_mm is not None and each.intercept_std_mm is not None
    ]
    if len(known) == angle.size:
        _draw_shifts(below, angle, np.array(known), drift, "intercept")
    else:
        middle = {"transform": below.transAxes, "ha": "center", "va": "center"}
        below.text(0.5, 0.5, "no intercepts to compare", **middle)
    above.set_ylabel("optical - onboard [deg]")
    below.set_ylabel("intercept - the sweep's [mm]")
    below.set_xlabel("onboard angle [deg]")
    figure.suptitle("\n".join(textwrap.wrap(drift.sentence, 95)), fontsize="medium")
    return figure


def _draw_shifts(
    axes: "Axes",
    angle: NDArray[np.float64],
    shifts: NDArray[np.float64],
    drift: Drift,
    kind: str,
) -> None:
    axes.axhline(0, color=_GREY, linewidth=0.8)
    axes.errorbar(
        angle,
        shifts[:, 0],
        yerr=_U95 * shifts[:, 1],
        fmt="o",
        color=_ORANGE,
        markerfacecolor="none",
        capsize=2,
        label="check points, 95 %",
    )
    line = [each.value for each in drift.signatures if each.name.startswith(kind)]
    ends = np.array([angle.min(), angle.max()])
    axes.plot(
        ends, np.polynomial.polynomial.polyval(ends, line), color=_BLUE, label="straight line"
    )
    axes.grid(alpha=0.25)
    axes.legend(fontsize="small")


def _colours(count: int) -> list[str]:
    """Colours from cold to warm that are told apart with any colour vision and in grey."""
    if count == 1:
        return [_BLUE]
    scale = mpl.colormaps["cividis"]
    return [mpl.colors.to_hex(scale(share)) for share in np.linspace(0.0, 0.85, count)]


def _draw_curve(axes: "Axes", curve: SweepCurve, colour: str) -> None:
    angle = np.linspace(*curve.range_deg, 201)
    at = "" if curve.temperature_k is None else f", {curve.temperature_k:.1f} K"
    label = f"degree {curve.degree}{at}"
    axes.plot(angle, curve.predict(angle) - angle, color=colour, label=label)


def _draw_points(
    above: "Axes", below: "Axes", sweep: PitchSweep, curve: SweepCurve, colour: str
) -> None:
    many = len(sweep.curves) > 1
    edge = colour if many else _ORANGE
    for marker, points in _by_way(curve).items():
        if not points:
            continue
        x = np.array([point.optical_deg for point in points])
        onboard = np.array([point.onboard_deg for point in points])
        label = _label(_WAYS[marker], above)
        above.plot(x, onboard - x, marker, color=edge, markerfacecolor="none", label=label)
        below.errorbar(
            x,
            [sweep.residual_deg(point) for point in points],
            yerr=[_U95 * sweep.residual_std_deg(point) for point in points],
            fmt=marker,
            color=edge,
            markerfacecolor="none",
            capsize=2,
            elinewidth=0.8,
        )


def _by_way(curve: SweepCurve) -> dict[str, list[SweepPoint]]:
    """Points by the marker of the direction from which they were reached."""
    loop = curve.hysteresis
    up, down = ((), ()) if loop is None else (loop.up, loop.down)
    found: dict[str, list[SweepPoint]] = {marker: [] for marker in _WAYS}
    for point in curve.points:
        found["^" if point.name in up else "v" if point.name in down else "o"].append(point)
    return found


def _draw_left_out(above: "Axes", below: "Axes", sweep: PitchSweep) -> None:
    """Draw points left out with their names; those far off at the edge of the residuals."""
    used = np.abs(sweep.residuals_deg) + [_U95 * sweep.residual_std_deg(p) for p in sweep.points]
    limit = _BEYOND * float(used.max())
    for point in sweep.left_out:
        residual, off = sweep.residual_deg(point), point.onboard_deg - point.optical_deg
        place = float(np.clip(residual, -limit, limit))
        arrow = (
            ""
            if place == residual
            else "\N{UPWARDS ARROW} "
            if residual > 0
            else "\N{DOWNWARDS ARROW} "
        )
        label = _label("left out", above)
        above.plot(point.optical_deg, off, "x", color="black", markersize=7, label=label)
        below.plot(point.optical_deg, place, "x", color="black", markersize=7)
        below.annotate(
            f"{arrow}{point.name} {residual:+.4f}",
            (point.optical_deg, place),
            textcoords="offset points",
            xytext=(6, -10 if residual > 0 else 4),
            fontsize="small",
        )


def _draw_bands(axes: "Axes", sweep: PitchSweep) -> None:
    """Draw the widest bands of all curves: of the calibration, and of another point."""
    angle = np.linspace(*sweep.range_deg, 201)
    own, point = (np.max(each, axis=0) for each in zip(*_half_widths(sweep, angle), strict=True))
    axes.axhline(0, color=_GREY, linewidth=0.8)
    axes.fill_between(
        angle, -point, point, color=_GREY, alpha=0.15, linewidth=0, label="another point, 95 %"
    )
    axes.fill_between(
        angle, -own, own, color=_BLUE, alpha=0.3, linewidth=0, label="calibration, 95 %"
    )


def _half_widths(
    sweep: PitchSweep, angle: NDArray[np.float64]
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    found = []
    for curve in sweep.curves:
        applied = sweep.apply(angle, temperature_k=curve.temperature_k)
        noise = np.median([sweep.residual_std_deg(each) for each in curve.points])
        both = (0.0, noise / applied.gain)
        ends = [sweep.interval(angle, each, temperature_k=curve.temperature_k) for each in both]
        own, another = ((high - low) / 2 for low, high in ends)
        found.append((own, another))
    return found


def _label(words: str, axes: "Axes") -> str:
    """Return the label the first time, and one that legends leave out later."""
    there = axes.get_legend_handles_labels()[1]
    return f"_{words}" if words in there else words


def _title(sweep: PitchSweep) -> list[str]:
    out = f", {len(sweep.left_out)} left out" if sweep.left_out else ""
    ratio = sweep.reduced_chi_square
    fit = "" if ratio is None else f", reduced chi-square {ratio:.2f}"
    return [f"No-flow pitch sweep, {len(sweep.points)} points{out}{fit}", *_loops(sweep)]


def _loops(sweep: PitchSweep) -> list[str]:
    """Say the hysteresis of each curve that has both ways."""
    said = []
    for curve in sweep.curves:
        loop = curve.hysteresis
        if loop is None:
            continue
        at = f" at {curve.temperature_k:.1f} K" if len(sweep.curves) > 1 else ""
        how = "significant" if loop.is_significant else "not significant"
        said.append(
            f"down less up{at} {loop.width_deg:+.4f} deg, 95 % within {loop.u95_deg:.4f}: {how}"
        )
    return said
