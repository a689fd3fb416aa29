"""Drawings of the paper's data figures."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from glint_aoa.paper_figures import Axis, Curve, Fact, FigureData, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["paper_figure", "said_of"]

# Okabe and Ito's colours, told apart with any colour vision; dashes and shapes tell them apart in
# grey
_STYLES = (("#0072B2", "-", "o"), ("#D55E00", "--", "s"), ("#009E73", ":", "^"))
_GREY = "#7F7F7F"
_MANY = 200  # points to a curve, beyond which they are drawn small
_SMALL, _USUAL = 2.5, 4.5  # sizes of points
_LONG, _LONGEST = 26, 40  # letters along low and high panels, beyond which the unit goes below
_WIDTH, _SIDE_WIDTH, _LEAST = 8.0, 10.0, 4.4  # of figures, and the height of the lowest [in]
_ALIKE, _UNLIKE = 1.5, 2.4  # heights of panels of one quantity and of several [in]
_AROUND = 1.2  # height of titles and of the lowest axis [in]
_SIGNIFICANT = 3


def paper_figure(data: FigureData) -> Figure:
    """Draw a data figure of the paper.

    Parameters
    ----------
    data : FigureData
        From `glint_aoa.paper_figures.make_figure`.

    Returns
    -------
    Figure
        Its panels below each other or side by side; under the title the numbers that it comes
        down to, the paper's beside them.
    """
    count, is_alike = len(data.panels), len({panel.y for panel in data.panels}) == 1
    height = max(_LEAST, _AROUND + (_ALIKE if is_alike else _UNLIKE) * count)
    beside = data.is_side_by_side
    figure = Figure(figsize=(_SIDE_WIDTH if beside else _WIDTH, height), layout="constrained")
    rows, columns = (1, count) if beside else (count, 1)
    grid = figure.subplots(rows, columns, sharex=True, sharey=is_alike, squeeze=False)
    for axes, panel in zip(grid.flat, data.panels, strict=True):
        _draw(axes, panel, data.x)
    for axes in grid[-1]:
        axes.set_xlabel(data.x.label)
    _label_y(figure, list(grid.flat), data, is_alike=is_alike)
    if len(data.panels[0].curves) > 1:
        grid.flat[0].legend(fontsize="small")
    title, stated = f"Figure {data.number}. {data.title}", _stated(data)
    if beside:
        figure.suptitle("\n".join([title, *stated]), fontsize="medium")
    else:
        figure.suptitle(title, fontsize="medium")
        own = data.panels[0].title
        grid.flat[0].set_title("\n".join([*stated, *([own] if own else [])]), fontsize="small")
    return figure


def said_of(fact: Fact) -> tuple[str, str]:
    """Say a number as it is found here, and as the paper has it.

    Parameters
    ----------
    fact : Fact
        Of a figure.

    Returns
    -------
    here, paper : str
        To three significant digits or four decimals, with the unit; a dash where there is none.
    """
    unit = f" {fact.unit}" if fact.unit else ""
    here = f"{_rounded(fact.value)}{unit}" if np.isfinite(fact.value) else "-"
    if fact.paper is None:
        return here, "-"
    if isinstance(fact.paper, float):
        return here, f"{fact.paper:g}{unit}"
    return here, fact.paper + (unit if fact.paper[-1].isdigit() else "")


def _rounded(value: float) -> str:
    if value == 0:
        return "0"
    decimals = _SIGNIFICANT - 1 - int(np.floor(np.log10(abs(value))))
    return f"{value:.{min(max(decimals, 0), 4)}f}"


def _stated(data: FigureData) -> list[str]:
    """Return the facts that the paper states as well, two to a line."""
    words = []
    for fact in data.facts:
        if fact.paper is not None:
            here, paper = said_of(fact)
            words.append(f"{fact.what}: {here} (paper: {paper})")
    return ["; ".join(words[at : at + 2]) for at in range(0, len(words), 2)]


def _draw(axes: "Axes", panel: Panel, x: Axis) -> None:
    for place in panel.marked_x:
        axes.axvline(place, color=_GREY, linewidth=0.8, linestyle=(0, (5, 4)))
    for curve, style in zip(panel.curves, _STYLES, strict=False):
        _plot(axes, curve, style)
    if panel.y.has_zero:
        axes.axhline(0, color=_GREY, linewidth=0.8, zorder=0)
    if panel.y.log:
        axes.set_yscale("log")
    if all(curve.marks != "points" for curve in panel.curves):
        axes.margins(x=0.01)
    # limits of None would freeze the ends that are to follow the curves
    if (x.low, x.high) != (None, None):
        axes.set_xlim(x.low, x.high)
    if (panel.y.low, panel.y.high) != (None, None):
        axes.set_ylim(panel.y.low, panel.y.high)
    axes.set_title(panel.title, fontsize="small")
    axes.grid(alpha=0.25)
    if panel.ticks:
        places, words = zip(*panel.ticks, strict=True)
        axes.set_xticks(places, words, fontsize="small", rotation=25, ha="right")


def _plot(axes: "Axes", curve: Curve, style: tuple[str, str, str]) -> None:
    colour, dashes, marker = style
    size = _SMALL if curve.x.size > _MANY else _USUAL
    if curve.marks == "points":
        # no line, not even an unseen one: the legend would keep clear of it
        shape: dict[str, Any] = {"marker": marker, "facecolors": "none", "edgecolors": colour}
        axes.scatter(curve.x, curve.y, s=size**2, label=curve.label, **shape)
    elif curve.marks == "line":
        axes.plot(curve.x, curve.y, dashes, color=colour, linewidth=1.3, label=curve.label)
    else:
        shape = {"marker": marker, "markersize": size, "markerfacecolor": "none"}
        axes.plot(curve.x, curve.y, color=colour, linewidth=0.8, label=curve.label, **shape)


def _label_y(figure: Figure, axes: "list[Axes]", data: FigureData, *, is_alike: bool) -> None:
    """Name the vertical axes: once where all panels show one quantity."""
    if is_alike and data.is_side_by_side:
        axes[0].set_ylabel(data.panels[0].y.label)
    elif is_alike and len(axes) > 1:
        figure.supylabel(data.panels[0].y.label, fontsize="medium")
    else:
        longest = _LONG if len(axes) > 1 else _LONGEST
        for each, panel in zip(axes, data.panels, strict=True):
            label = panel.y.label
            each.set_ylabel(label.replace(" [", "\n[") if len(label) > longest else label)
