"""Figures 27 to 30 and 37: errors and scatter of the campaign's points."""

from collections.abc import Sequence

import numpy as np

from glint_aoa.benchmark import BenchmarkPoint, PointError, Technique, by_run
from glint_aoa.paper_figures.figure_data import Axis, Curve, Fact, FigureData, Panel
from glint_aoa.paper_figures.table import FigureSpec

__all__ = ["errors_against_moment", "errors_by_run", "scatter_against_moment"]

_TECHNIQUES: dict[Technique, str] = {
    "video": "video",
    "inertial": "inertial, raw",
    "inertial corrected": "inertial, corrected",
}


def errors_against_moment(spec: FigureSpec, errors: Sequence[PointError]) -> FigureData:
    """Show errors against peak-to-peak moment, yaw and pitch side by side: figure 27.

    Parameters
    ----------
    spec : FigureSpec
        The figure.
    errors : sequence of PointError
        Of the points; those without a moment are left out.

    Returns
    -------
    FigureData
        The facts are the errors of largest magnitude [deg], as in Table 4.
    """
    panels, facts = [], []
    for plane in ("yaw", "pitch"):
        drawn = [
            each
            for each in errors
            if each.point.plane == plane and each.point.moment_in_lb_pp is not None
        ]
        moment = np.array([each.point.moment_in_lb_pp for each in drawn], float)
        curves = tuple(
            Curve(label, moment, _values(drawn, technique), "points")
            for technique, label in _TECHNIQUES.items()
        )
        panels.append(Panel(spec.y, curves, title=f"Excitation in {plane}"))
        facts += _largest(spec, drawn, f"{plane}, ")
    return FigureData(
        spec.number,
        spec.title,
        spec.x,
        tuple(panels),
        tuple(facts),
        _names(errors),
        is_side_by_side=True,
    )


def errors_by_run(spec: FigureSpec, errors: Sequence[PointError]) -> FigureData:
    """Show the errors of point after point, run after run: figures 28 to 30.

    Parameters
    ----------
    spec : FigureSpec
        The figure.
    errors : sequence of PointError
        Of its points, those of a run together.

    Returns
    -------
    FigureData
        The facts are the errors of largest magnitude [deg].
    """
    place = np.arange(1.0, len(errors) + 1)
    curves = tuple(
        Curve(label, place, _values(errors, technique), "points")
        for technique, label in _TECHNIQUES.items()
    )
    sizes = [len(run) for run in by_run(each.point for each in errors).values()]
    ends = np.cumsum(sizes)
    middles = ends - (np.array(sizes) - 1) / 2
    names = dict.fromkeys(each.point.run for each in errors)
    panel = Panel(
        spec.y,
        curves,
        marked_x=tuple(map(float, ends[:-1] + 0.5)),
        ticks=tuple(zip(map(float, middles), names, strict=True)),
    )
    facts = tuple(_largest(spec, errors, ""))
    return FigureData(spec.number, spec.title, spec.x, (panel,), facts, _names(errors))


def scatter_against_moment(spec: FigureSpec, points: Sequence[BenchmarkPoint]) -> FigureData:
    """Show the standard deviation of the video angle over a point against moment: figure 37.

    Parameters
    ----------
    spec : FigureSpec
        The figure.
    points : sequence of BenchmarkPoint
        With the shaker on.

    Returns
    -------
    FigureData
        The facts are the largest in each plane [deg], and one over the other.
    """
    curves, largest = [], {}
    for plane in ("yaw", "pitch"):
        drawn = [p for p in points if p.plane == plane and p.moment_in_lb_pp is not None]
        moment = np.array([p.moment_in_lb_pp for p in drawn], float)
        scatter = np.array([p.optical_std_deg for p in drawn], float)
        curves.append(Curve(f"excitation in {plane}", moment, scatter, "points"))
        largest[plane] = float(np.max(scatter, initial=np.nan if not drawn else 0.0))
    facts = (
        Fact("yaw, largest", largest["yaw"], "deg", spec.paper["yaw, largest"]),
        Fact("pitch, largest", largest["pitch"], "deg"),
        Fact("pitch over yaw", largest["pitch"] / largest["yaw"], "", spec.paper["pitch over yaw"]),
    )
    return FigureData(
        spec.number,
        spec.title,
        spec.x,
        (Panel(Axis(spec.y.name, spec.y.unit, low=0.0), tuple(curves)),),
        facts,
        tuple(point.point for point in points),
    )


def _values(
    errors: Sequence[PointError], technique: Technique
) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    values = [each.error_deg(technique) for each in errors]
    return np.array([np.nan if value is None else value for value in values])


def _largest(spec: FigureSpec, errors: Sequence[PointError], where: str) -> list[Fact]:
    facts = []
    for technique, label in _TECHNIQUES.items():
        values = _values(errors, technique)
        values = values[np.isfinite(values)]
        if values.size:
            extreme = float(values[np.argmax(np.abs(values))])
            paper = spec.paper.get(f"{where}{label.removesuffix(', raw')}, largest")
            facts.append(Fact(f"{where}{label}, largest", extreme, "deg", paper))
    return facts


def _names(errors: Sequence[PointError]) -> tuple[str, ...]:
    return tuple(each.point.point for each in errors)
