"""What a figure holds: panels of curves in named axes, and the numbers it comes down to."""

import re
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Axis", "Curve", "Fact", "FigureData", "Panel"]

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Axis:
    """A quantity along an axis.

    Attributes
    ----------
    name : str
        What it is, such as "time".
    unit : str
        Its unit; empty for a plain number.
    log : bool
        Whether it is drawn in decades.
    has_zero : bool
        Whether zero means something and is drawn.
    low, high : float or None
        Ends of the axis, where they are fixed.
    """

    name: str
    unit: str = ""
    log: bool = False
    has_zero: bool = False
    low: float | None = None
    high: float | None = None

    @property
    def label(self) -> str:
        """Name and unit, such as "time [s]"."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def key(self) -> str:
        """Heading of a table's column, such as "time_s"."""
        words = f"{self.name} {self.unit}".lower().replace("/", " per ").replace("^", "")
        return re.sub(r"[^a-z0-9]+", "_", words).strip("_")


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve.

    Attributes
    ----------
    label : str
        What the legend says.
    x, y : ndarray [value]
        Its numbers, in the units of the axes; NaN leaves a gap.
    marks : {"line", "points", "joined points"}
        How it is drawn.
    """

    label: str
    x: _Floats
    y: _Floats
    marks: Literal["line", "points", "joined points"] = "line"


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves that share their axes.

    Attributes
    ----------
    y : Axis
        The vertical axis.
    curves : tuple of Curve
        At least one.
    title : str
        What sets the panel apart from its neighbours.
    marked_x : tuple of float
        Where a vertical line stands, as between two runs or where the shaker stops.
    ticks : tuple of (float, str)
        Places along x with words in place of numbers.
    """

    y: Axis
    curves: tuple[Curve, ...]
    title: str = ""
    marked_x: tuple[float, ...] = ()
    ticks: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True)
class Fact:
    """A number that a figure comes down to.

    Attributes
    ----------
    what : str
        In a few words.
    value : float
        As found here [unit].
    unit : str
        Its unit; empty for a plain number.
    paper : float, str or None
        The paper's [unit], a word such as "negative", or None where it gives none.
    """

    what: str
    value: float
    unit: str
    paper: float | str | None = None


@dataclass(frozen=True, eq=False)
class FigureData:
    """One figure of the paper, from recorded points.

    Attributes
    ----------
    number : int
        As in the paper.
    title : str
        What it shows.
    x : Axis
        The horizontal axis of all panels.
    panels : tuple of Panel
        From the top down, or from the left.
    facts : tuple of Fact
        The numbers it comes down to.
    points : tuple of str
        Names of the points it was made from.
    is_side_by_side : bool
        Whether the panels stand beside each other.
    """

    number: int
    title: str
    x: Axis
    panels: tuple[Panel, ...]
    facts: tuple[Fact, ...]
    points: tuple[str, ...]
    is_side_by_side: bool = False

    def columns(self) -> dict[str, list[Any]]:
        """Return all numbers as the columns of one table, a row for each value of each curve.

        Returns
        -------
        dict of str to list
            ``panel`` where there are several, ``curve``, the horizontal axis, and the vertical
            one: under its own heading, or ``value`` where the panels' differ.
        """
        rows = [(p, c) for p in self.panels for c in p.curves]
        keys = {panel.y.key for panel in self.panels}
        table: dict[str, list[Any]] = {}
        if len(self.panels) > 1:
            names = [panel.title or panel.y.label for panel, _ in rows]
            table["panel"] = _repeated(names, rows)
        table["curve"] = _repeated([curve.label for _, curve in rows], rows)
        table[self.x.key] = [float(x) for _, curve in rows for x in curve.x]
        heading = keys.pop() if len(keys) == 1 else "value"
        table[heading] = [float(y) for _, curve in rows for y in curve.y]
        return table


def _repeated(names: list[str], rows: list[tuple[Panel, Curve]]) -> list[str]:
    return [name for name, (_, c) in zip(names, rows, strict=True) for _ in range(c.x.size)]
