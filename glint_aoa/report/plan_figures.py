"""A planned test as pictures: the map of layouts, and where the glint will fall."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator, NullLocator
from numpy.typing import NDArray

from glint_aoa.plan import Layout, LayoutForecast, LayoutMap, TestPlan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh

__all__ = ["glint_figure", "map_figure"]

_Array = NDArray[np.float64]

# dark to bright with any colour vision, and in grey
_COLOURS = "cividis"
_LINE, _WINDOW, _MARK = "#D55E00", "#0072B2", "#D55E00"  # Okabe and Ito
_MM = 1e3
_MILLI = 1e3
_TICKS = 6  # of the colour scale
_NUMBERED = 40  # cells of a map that have room for numbers
_WIDEST = 30.0  # largest over least on the colour scale


def map_figure(plan: TestPlan) -> Figure:
    """Draw what the layouts of a map measure.

    Parameters
    ----------
    plan : TestPlan
        A plan with a map.

    Returns
    -------
    Figure
        Largest standard uncertainty of a point's mean [1e-3 deg]: over distance and lens with the
        lamp where it is and where it is best, and over the lamp's place. Hatched is where the
        wanted range is not all seen. A circle marks the present setup, a star the suggested one.
    """
    layouts = plan.layouts
    assert layouts is not None
    best = plan.suggestion or plan.present
    norm = _norm(layouts)
    figure = Figure(figsize=(15, 5.2), layout="constrained")
    panels = figure.subplots(1, 3)
    for axes, layout, title in (
        (panels[0], plan.present.layout, "Lamp as it is, or nearest to it"),
        (panels[1], best.layout, "Lamp as suggested"),
    ):
        y, z = _nearest(layouts, layout)[2:]
        mesh = _draw_lenses(axes, layouts, norm, y, z)
        axes.set_title(f"{title}: Y {layouts.lamp_y[y]:.2f} m, Z {layouts.lamp_z[z]:.2f} m")
    _mark_camera(panels[0], layouts, plan.present.layout, "o")
    d, f, _, _ = _nearest(layouts, best.layout)
    mesh = _draw_lamps(panels[2], layouts, norm, d, f)
    _mark(panels[2], *plan.present.layout.lamp_yz, "o")
    if plan.suggestion is not None:
        _mark_camera(panels[1], layouts, best.layout, "*")
        _mark(panels[2], *best.layout.lamp_yz, "*")
    panels[2].set_title(
        f"Camera as suggested: {layouts.distances[d]:.2f} m, {layouts.focal_lengths[f] * _MM:g} mm"
    )
    bar = figure.colorbar(mesh, ax=panels, label=_scale_label(plan), extend="max", pad=0.01)
    ticks = np.geomspace(norm.vmin or 0.1, norm.vmax or 1.0, _TICKS)
    bar.set_ticks(list(ticks), labels=[f"{each:.3g}" for each in ticks])
    bar.ax.yaxis.set_minor_locator(NullLocator())
    figure.legend(
        handles=[*_marks(), _hatched()],
        loc="outside lower center",
        ncols=3,
        fontsize="small",
    )
    return figure


def glint_figure(plan: TestPlan) -> Figure:
    """Draw where the glint will fall on the sensor.

    Parameters
    ----------
    plan : TestPlan
        The plan.

    Returns
    -------
    Figure
        The sensor with the recorded window and the glint at each angle, three standard deviations
        wide, for the present setup and the suggested one; dashed where it is not measured.
    """
    shown = {"Present setup": plan.present}
    if plan.suggestion is not None:
        shown["Suggested"] = plan.suggestion
    figure = Figure(figsize=(7.5 * len(shown), 6), layout="constrained")
    panels = figure.subplots(1, len(shown), squeeze=False)[0]
    for axes, (title, forecast) in zip(panels, shown.items(), strict=True):
        _draw_glints(axes, forecast)
        layout = forecast.layout
        y, z = layout.lamp_yz
        axes.set_title(
            f"{title}: {layout.distance:.2f} m, {layout.focal_length * _MM:g} mm, lamp at "
            f"Y {y:.2f} m, Z {z:.2f} m"
        )
    return figure


def _norm(layouts: LayoutMap) -> LogNorm:
    values = layouts.allowed_std_deg if layouts.visible.any() else layouts.std_deg
    known = values[np.isfinite(values)] * _MILLI
    if not known.size:
        return LogNorm(0.1, 1.0)
    least = float(known.min())
    return LogNorm(least, max(min(float(known.max()), _WIDEST * least), 1.01 * least))


def _scale_label(plan: TestPlan) -> str:
    low, high = np.degrees(plan.setup.plan.angles)
    return (
        f"mean of {plan.setup.plan.fields} fields, 1 sigma [10$^{{-3}}$ deg]\n"
        f"largest over {low:+.3g} to {high:+.3g} deg, calibration not counted"
    )


def _nearest(layouts: LayoutMap, layout: Layout) -> tuple[int, int, int, int]:
    """Return the place in the map that is nearest to a layout."""
    axes = (layouts.distances, layouts.focal_lengths, layouts.lamp_y, layouts.lamp_z)
    wanted = (layout.distance, layout.focal_length, *layout.lamp_yz)
    d, f, y, z = (int(np.abs(axis - one).argmin()) for axis, one in zip(axes, wanted, strict=True))
    return d, f, y, z


def _draw_lenses(axes: "Axes", layouts: LayoutMap, norm: LogNorm, y: int, z: int) -> "QuadMesh":
    """Draw distances across and lenses up, each lens in a row of its own."""
    rows = np.arange(layouts.focal_lengths.size, dtype=np.float64)
    mesh = _draw_map(
        axes,
        (layouts.distances, rows),
        layouts.std_deg[:, :, y, z].T,
        layouts.visible[:, :, y, z].T,
        norm,
    )
    every = max(1, int(np.ceil(rows.size / 12)))
    axes.set_yticks(rows[::every], [f"{f * _MM:g}" for f in layouts.focal_lengths[::every]])
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("camera to the plane of the glint [m]")
    axes.set_ylabel("focal length [mm]")
    return mesh


def _draw_lamps(axes: "Axes", layouts: LayoutMap, norm: LogNorm, d: int, f: int) -> "QuadMesh":
    mesh = _draw_map(
        axes,
        (layouts.lamp_y, layouts.lamp_z),
        layouts.std_deg[d, f].T,
        layouts.visible[d, f].T,
        norm,
    )
    if layouts.std_deg[d, f].size <= _NUMBERED:
        for y, z in np.argwhere(layouts.visible[d, f]):
            value = layouts.std_deg[d, f, y, z] * _MILLI
            axes.annotate(
                f"{value:.3g}",
                (layouts.lamp_y[y], layouts.lamp_z[z]),
                xytext=(0, -16),
                textcoords="offset points",
                color="white" if norm(value) < 0.5 else "black",
                ha="center",
                va="center",
                fontsize="small",
            )
    axes.set_xlabel("lamp's Y [m], positive away from the camera")
    axes.set_ylabel("lamp's Z [m]")
    return mesh


def _draw_map(
    axes: "Axes",
    places: tuple[_Array, _Array],
    values: _Array,
    visible: NDArray[np.bool_],
    norm: LogNorm,
) -> "QuadMesh":
    x, y = (_edges(each) for each in places)
    mesh = axes.pcolormesh(x, y, _MILLI * values, norm=norm, cmap=_COLOURS, rasterized=True)
    for row, column in np.argwhere(~visible):
        axes.add_patch(
            Rectangle(
                (x[column], y[row]),
                x[column + 1] - x[column],
                y[row + 1] - y[row],
                facecolor="white",
                edgecolor="#7F7F7F",
                hatch="///",
                linewidth=0,
            )
        )
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(y[0], y[-1])
    axes.xaxis.set_major_locator(MaxNLocator(6))
    return mesh


def _edges(places: _Array) -> _Array:
    """Return the edges of cells about places."""
    if places.size == 1:
        half = 0.05 * max(abs(float(places[0])), 1.0)
        return np.array([places[0] - half, places[0] + half])
    middle = (places[1:] + places[:-1]) / 2
    first, last = 2 * places[0] - middle[0], 2 * places[-1] - middle[-1]
    return np.concatenate([[first], middle, [last]])


def _mark_camera(axes: "Axes", layouts: LayoutMap, layout: Layout, marker: str) -> None:
    rows = np.arange(layouts.focal_lengths.size)
    row = float(np.interp(layout.focal_length, layouts.focal_lengths, rows))
    _mark(axes, layout.distance, row, marker)


def _mark(axes: "Axes", x: float, y: float, marker: str) -> None:
    """Mark a layout; one that is off the map is not drawn."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    if not (left <= x <= right and low <= y <= high):
        return
    axes.plot(
        x,
        y,
        linestyle="none",
        marker=marker,
        markersize=17 if marker == "*" else 11,
        markerfacecolor=_MARK if marker == "*" else "white",
        markeredgecolor="black",
        markeredgewidth=1.5,
        clip_on=False,
        zorder=5,
    )


def _marks() -> list[object]:
    """Return what the legend shows of the marks."""
    axes = Figure().subplots()
    for marker in "o*":
        _mark(axes, 0, 0, marker)
    for line, label in zip(axes.lines, ("present setup", "suggested"), strict=True):
        line.set_label(label)
        line.set_markersize(10)
    return list(axes.lines)


def _hatched() -> Rectangle:
    return Rectangle(
        (0, 0),
        1,
        1,
        facecolor="white",
        edgecolor="#7F7F7F",
        hatch="///",
        linewidth=0,
        label="the wanted range of angle is not all seen",
    )


def _draw_glints(axes: "Axes", forecast: LayoutForecast) -> None:
    prediction, layout = forecast.prediction, forecast.layout
    assert layout.camera.sensor is not None
    assert layout.camera.pixel_pitch is not None
    width, height = layout.camera.sensor
    axes.add_patch(
        Rectangle(
            (-0.5, layout.first_line - 0.5),
            width,
            layout.lines,
            facecolor=_WINDOW,
            alpha=0.12,
            edgecolor="none",
        )
    )
    axes.text(
        4,
        layout.first_line + 1,
        f"recorded window, lines {layout.first_line} to {layout.first_line + layout.lines - 1}",
        color=_WINDOW,
        fontsize="small",
        va="top",
    )
    columns = layout.columns
    for each in forecast.angles:
        k = int(prediction.at(np.radians(each.angle_deg))[0])
        row, reach, seen = prediction.row[k], 3 * prediction.sigma[k], prediction.sees[k]
        axes.fill_between(
            columns, row - reach, row + reach, color=_LINE, alpha=0.3, linewidth=0, where=seen
        )
        axes.plot(columns, np.where(seen, row, np.nan), color=_LINE, linewidth=1)
        axes.plot(
            columns, np.where(seen, np.nan, row), color="black", linewidth=1, linestyle=(0, (3, 3))
        )
        there = np.flatnonzero(prediction.on_body[k])
        if there.size:
            axes.annotate(
                f"{each.angle_deg:+.3g} deg" if each.angle_deg else "0 deg",
                (columns[there[-1]], row[there[-1]]),
                xytext=(12, 0),
                textcoords="offset points",
                va="center",
                fontsize="small",
                annotation_clip=False,
            )
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect(layout.camera.pixel_pitch[1] / layout.camera.pixel_pitch[0])
    axes.set_xlabel("column u [pixels]")
    axes.set_ylabel("sensor line v [field lines]")
