"""The page's plots. Each holds its sources; what is shown changes with `show`."""

import itertools
from collections.abc import Sequence

import numpy as np
from bokeh.models import ColumnDataSource, Legend, LegendItem, LinearColorMapper, Range1d, Span
from bokeh.palettes import Greys256
from bokeh.plotting import figure
from numpy.typing import NDArray

from glint_aoa.flags import REJECTING
from glint_aoa.monitor.details import HIGHEST_HZ, Onboard, Picture, PointDetails, Spectrum
from glint_aoa.monitor.live_client import LiveReading

__all__ = ["BLUE", "GREEN", "ORANGE", "FieldPlot", "SpectraPlot", "StripPlot"]

# Okabe and Ito's colours, told apart with any colour vision; dashes tell them apart in grey
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
_COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7", "#56B4E9", "#8C6D00")
_DASHES = ("solid", "dashed", "dotted", "dashdot", "dotdash", "solid")

_MOST_DOTS = 300  # more would be a band
_LEAST_DEG = 0.004  # of the strip chart's height: less is noise
_WIDEST = 3.0  # times what is to be seen
_DECADES = 1e6  # of power: spectra below are not looked for

MOST_SHOWN = 2000
"""Of a long record, so many fields or fewer are drawn."""

_Floats = NDArray[np.float64]


def thinned(values: _Floats, most: int = MOST_SHOWN) -> NDArray[np.int64]:
    """Choose samples [sample] to draw: in each of equal stretches the least and the greatest."""
    if values.size <= most:
        return np.arange(values.size)
    edges = np.linspace(0, values.size, most // 2 + 1).astype(int)
    chosen = []
    for start, stop in itertools.pairwise(edges):
        stretch = values[start:stop]
        if np.isfinite(stretch).any():
            chosen += [start + int(np.nanargmin(stretch)), start + int(np.nanargmax(stretch))]
        else:
            chosen.append(start)
    return np.unique(chosen)


class FieldPlot:
    """A field with its measured line over it."""

    def __init__(self) -> None:
        self._image = ColumnDataSource({name: [] for name in ("image", "x", "y", "dw", "dh")})
        self._line = ColumnDataSource({"u": [], "v": []})
        self._grey = LinearColorMapper(palette=Greys256, low=0, high=255)
        self._columns, self._rows = Range1d(-0.5, 0.5), Range1d(0.5, -0.5)
        self.figure = _figure(
            "column [pixels]",
            "row [field lines]",
            name="field",
            height=265,
            x_range=self._columns,
            y_range=self._rows,
        )
        self.figure.image(
            "image", "x", "y", "dw", "dh", source=self._image, color_mapper=self._grey
        )
        self.figure.line("u", "v", source=self._line, color=ORANGE, line_width=2)
        self.figure.grid.visible = False
        self.figure.background_fill_color = "#e9edf0"

    def show(self, picture: Picture | None) -> None:
        """Draw a field; None empties the plot."""
        if picture is None:
            self._image.data = {name: [] for name in ("image", "x", "y", "dw", "dh")}
            self._line.data = {"u": [], "v": []}
            return
        lines, columns = picture.shape
        self._columns.update(start=-0.5, end=columns - 0.5)
        self._rows.update(start=lines - 0.5, end=-0.5)
        self._grey.high = max(int(picture.levels.max()), 1)
        self._image.data = {
            "image": [picture.levels],
            "x": [-0.5],
            "y": [-0.5],
            "dw": [columns],
            "dh": [lines],
        }
        u = np.arange(columns, dtype=np.float64)
        kept = np.isfinite(picture.line_row) & (picture.line_row > -1) & (picture.line_row < lines)
        self._line.data = {"u": u[kept], "v": picture.line_row[kept]}


class StripPlot:
    """Angle against time, with its uncertainty and what the onboard sensor says."""

    def __init__(self) -> None:
        self._angle = ColumnDataSource({name: [] for name in ("time", "angle", "low", "high")})
        self._flagged = ColumnDataSource({"time": [], "angle": []})
        self._raw = ColumnDataSource({"time": [], "angle": []})
        self._corrected = ColumnDataSource({"time": [], "angle": []})
        self._mean = Span(dimension="width", line_color=BLUE, line_alpha=0.5, line_width=1)
        self._times, self._angles = Range1d(0.0, 1.0), Range1d(-0.1, 0.1)
        self.figure = _figure(
            "time after the trigger [s]",
            "angle [deg]",
            name="strip",
            height=290,
            x_range=self._times,
            y_range=self._angles,
        )
        self._draw()

    def _draw(self) -> None:
        plot = self.figure
        bars = plot.segment(
            "time", "low", "time", "high", source=self._angle, color="#56B4E9", line_width=3
        )
        angle = plot.line("time", "angle", source=self._angle, color=BLUE, line_width=1.5)
        self._dots = plot.scatter("time", "angle", source=self._angle, color=BLUE, size=4)
        flagged = plot.scatter(
            "time",
            "angle",
            source=self._flagged,
            marker="x",
            color="#B3400A",
            size=11,
            line_width=3,
        )
        raw = plot.line(
            "time", "angle", source=self._raw, color=ORANGE, line_width=2, line_dash="dashed"
        )
        corrected = plot.line(
            "time", "angle", source=self._corrected, color=GREEN, line_width=2, line_dash="dotdash"
        )
        plot.add_layout(self._mean)
        items = {
            "optical": [angle, self._dots],
            "95 % of a field": [bars],
            "left out": [flagged],
            "onboard, raw": [raw],
            "onboard, corrected": [corrected],
        }
        _legend(
            plot,
            [LegendItem(label={"value": label}, renderers=made) for label, made in items.items()],
        )

    def show_point(self, details: PointDetails | None, mean_deg: float) -> None:
        """Draw a measured point; None empties the plot."""
        self.figure.xaxis.axis_label = "time after the trigger [s]"
        if details is None:
            self._times.update(start=0.0, end=1.0)
            self._show(np.empty(0), np.empty(0), np.empty(0), np.empty(0, bool))
            self._show_onboard(None)
            return
        left_out = (details.flags & int(REJECTING)) != 0
        self._show(details.time_s, details.angle_deg, details.u95_deg, left_out)
        onboard = details.onboard
        self._frame(details.time_s, details.angle_deg, details.u95_deg, onboard)
        self._show_onboard(onboard)
        self._mean.location = mean_deg if np.isfinite(mean_deg) else None

    def show_live(self, readings: Sequence[LiveReading]) -> None:
        """Draw the newest readings of a live session."""
        self.figure.xaxis.axis_label = "time since the session began [s]"
        time_s, angle, u95 = (
            np.array([(each.time_s, each.angle_deg, each.u95_deg) for each in readings])
            .reshape(-1, 3)
            .T
        )
        self._frame(time_s, angle, u95, None)
        self._show(time_s, angle, u95, np.array([bool(each.flags) for each in readings], bool))
        self._show_onboard(None)
        self._mean.location = None

    def _frame(
        self, time_s: _Floats, angle: _Floats, u95: _Floats, onboard: Onboard | None
    ) -> None:
        """Choose what of time and angle is seen; angles keep still while they fit."""
        if not np.isfinite(time_s).any():
            return
        first, last = float(np.nanmin(time_s)), float(np.nanmax(time_s))
        self._times.update(start=first, end=max(last, first + 1e-3))
        seen = [angle - np.nan_to_num(u95), angle + np.nan_to_num(u95)]
        if onboard is not None:
            during = (onboard.time_s >= first) & (onboard.time_s <= last)
            seen += [onboard.raw_deg[during], onboard.corrected_deg[during]]
        values = np.concatenate(seen)
        values = values[np.isfinite(values)]
        if values.size:
            _fit(self._angles, float(values.min()), float(values.max()))

    def _show(
        self, time_s: _Floats, angle: _Floats, u95: _Floats, left_out: NDArray[np.bool_]
    ) -> None:
        kept = thinned(angle)
        self._dots.visible = kept.size <= _MOST_DOTS
        self._angle.data = {
            "time": time_s[kept],
            "angle": angle[kept],
            "low": (angle - u95)[kept],
            "high": (angle + u95)[kept],
        }
        self._flagged.data = {"time": time_s[left_out], "angle": angle[left_out]}

    def _show_onboard(self, onboard: Onboard | None) -> None:
        time_s, raw, corrected = (
            (np.empty(0),) * 3
            if onboard is None
            else (onboard.time_s, onboard.raw_deg, onboard.corrected_deg)
        )
        self._raw.data = {"time": time_s, "angle": raw}
        self._corrected.data = {"time": time_s, "angle": corrected}


class SpectraPlot:
    """Spectra of all channels of one quantity.

    Parameters
    ----------
    quantity : str
        "moment" or "acceleration".
    """

    def __init__(self, quantity: str) -> None:
        self._quantity = quantity
        self._sources = [ColumnDataSource({"frequency": [], "density": []}) for _ in _COLOURS]
        self._densities = Range1d(1e-3, 1.0)
        self.figure = _figure(
            "frequency [Hz]",
            quantity,
            name=f"{quantity}s",
            height=290,
            x_range=Range1d(0.0, HIGHEST_HZ),
            y_range=self._densities,
            y_axis_type="log",
        )
        lines = [
            self.figure.line(
                "frequency", "density", source=source, color=colour, line_dash=dash, line_width=1.5
            )
            for source, colour, dash in zip(self._sources, _COLOURS, _DASHES, strict=True)
        ]
        self._items = [
            LegendItem(label={"value": ""}, renderers=[line], visible=False) for line in lines
        ]
        _legend(self.figure, self._items, columns=3)

    def show(self, point: str, spectra: Sequence[Spectrum]) -> None:
        """Draw a point's spectra of this quantity; those beyond six channels are left out."""
        self.figure.title.text = point
        mine = [each for each in spectra if each.quantity == self._quantity][: len(_COLOURS)]
        units = sorted({_printed(each.units) for each in mine})
        words = f" [{' or '.join(units)}/√Hz]" if units else ""
        self.figure.yaxis.axis_label = f"{self._quantity}{words}"
        there = np.concatenate([np.empty(0), *(each.density for each in mine)])
        there = there[there > 0]
        if there.size:
            top = 2 * float(there.max())
            self._densities.update(start=max(float(there.min()) / 2, top / _DECADES), end=top)
        for place, (source, item) in enumerate(zip(self._sources, self._items, strict=True)):
            shown = mine[place] if place < len(mine) else None
            item.update(label={"value": shown.channel if shown else ""}, visible=shown is not None)
            source.data = (
                {"frequency": [], "density": []}
                if shown is None
                else {
                    "frequency": shown.frequency_hz,
                    "density": np.where(shown.density > 0, shown.density, np.nan),
                }
            )


def _figure(x: str, y: str, **options: object) -> figure:
    plot = figure(
        tools="box_zoom,reset,save",
        sizing_mode="stretch_width",
        min_border_right=12,
        border_fill_color=None,
        outline_line_color=None,
        **options,
    )
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    plot.title.text_font_size, plot.title.text_font_style = "13px", "normal"
    plot.xaxis.axis_label, plot.yaxis.axis_label = x, y
    plot.axis.axis_label_text_font_size = "14px"
    plot.axis.axis_label_text_font_style = "normal"
    plot.axis.major_label_text_font_size = "13px"
    plot.axis.axis_line_color = plot.axis.major_tick_line_color = "#8796a3"
    plot.axis.minor_tick_line_color = None
    plot.grid.grid_line_color = "#e3e8ec"
    return plot


def _fit(span: Range1d, low: float, high: float) -> None:
    """Move a range to hold `low` to `high`, unless it does already and is not too wide."""
    start, end = float(span.start), float(span.end)
    size = max(high - low, _LEAST_DEG)
    if start <= low and high <= end and end - start < _WIDEST * size:
        return
    middle = (low + high) / 2
    span.update(start=middle - 0.6 * size, end=middle + 0.6 * size)


def _printed(units: str) -> str:
    return units.replace("**", "^").replace("^2", "²").replace("*", "·")


def _legend(plot: figure, items: list[LegendItem], columns: int = 5) -> None:
    legend = Legend(items=items, orientation="horizontal", location="left")
    legend.update(
        border_line_color=None,
        background_fill_color=None,
        label_text_font_size="13px",
        padding=2,
        margin=2,
        spacing=12,
        ncols=columns,
    )
    plot.add_layout(legend, "above")
