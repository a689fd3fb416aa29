"""What matters to the angle: an uncertainty budget as bars."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from calibration.budget.uncertainty import AngleBudget, UncertaintyBudget

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["budget_figure"]

# Okabe and Ito's colours, told apart with any colour vision; hatches tell them apart in grey
_COLOURS = ("#0072B2", "#E69F00", "#009E73")
_HATCHES = ("", "///", "...")
_GREY = "#7F7F7F"
_LEAST = 0.005  # of the longest bar: shorter ones cannot be seen
_TOGETHER = "combined"
_TICKS = 5  # intervals: more labels of four digits touch each other


def budget_figure(budget: UncertaintyBudget) -> Figure:
    """Draw what each source contributes to the angle.

    Parameters
    ----------
    budget : UncertaintyBudget
        The budget; of each angle the place in the picture where u95 is largest is drawn, and of
        more than three angles the first, the middle and the last.

    Returns
    -------
    Figure
        Standard uncertainties [deg], a bar for each source and angle, the combined one on top;
        where a pitch sweep is applied, beside what they would be without it.
    """
    worst = budget.worst
    shown = [worst[k] for k in sorted({0, len(worst) // 2, len(worst) - 1})]
    if len(worst) <= len(_COLOURS):
        shown = list(worst)
    sides = {"": [_contributions(each, before=False) for each in shown]}
    if budget.sweep_degree is not None:
        sides = {
            "with the pitch sweep": sides[""],
            "without it": [_contributions(each, before=True) for each in shown],
        }
    rows = max(len(_sources(values)) for values in sides.values())
    height = 2.2 + 0.12 * rows * (len(shown) + 1)
    figure = Figure(figsize=(2 + 5.5 * len(sides), height), layout="constrained")
    panels = figure.subplots(1, len(sides), squeeze=False)[0]
    for axes, (title, values) in zip(panels, sides.items(), strict=True):
        _draw(axes, shown, values)
        axes.set_title(title)
    figure.legend(
        *panels[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=len(shown),
        fontsize="small",
    )
    figure.suptitle(_title(budget))
    return figure


def _contributions(budget: AngleBudget, *, before: bool) -> dict[str, float]:
    """Return the standard uncertainty [deg] from each source; a calibration's inputs in one."""
    values: dict[str, float] = {}
    for block in budget.blocks:
        rows = [row for row in budget.rows if row.block == block.name and row.std > 0]
        if block.name == "taped":
            values |= {
                row.source: row.before_sweep_deg if before else row.contribution_deg for row in rows
            }
        elif rows:
            values[block.name] = block.before_sweep_deg if before else block.contribution_deg
    together = math.sqrt(math.fsum(value**2 for value in values.values()))
    return {_TOGETHER: together, **values}


def _sources(values: Sequence[dict[str, float]]) -> list[str]:
    """Return the sources whose bars can be seen, the longest first."""
    longest = {name: max(each[name] for each in values) for name in values[0]}
    least = _LEAST * longest[_TOGETHER]
    seen = [name for name, value in longest.items() if value > least or name == _TOGETHER]
    return sorted(seen, key=lambda name: -longest[name])


def _draw(axes: "Axes", shown: Sequence[AngleBudget], values: Sequence[dict[str, float]]) -> None:
    sources = _sources(values)
    place, width = np.arange(len(sources)), 0.8 / len(shown)
    for number, (budget, each) in enumerate(zip(shown, values, strict=True)):
        axes.barh(
            place + (number - (len(shown) - 1) / 2) * width,
            [each[name] for name in sources],
            height=0.9 * width,
            color=_COLOURS[number],
            hatch=_HATCHES[number],
            edgecolor="white",
            linewidth=0,
            label=f"{_signed(budget.angle_deg)} deg, line {budget.line:.0f}",
        )
    axes.axhline(0.5, color=_GREY, linewidth=0.8)
    axes.set_yticks(place, sources)
    axes.set_ylim(len(sources) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.set_xlabel("contribution to the angle, 1 sigma [deg]")
    axes.grid(axis="x", alpha=0.25)
    axes.xaxis.set_major_locator(MaxNLocator(_TICKS))


def _title(budget: UncertaintyBudget) -> str:
    largest = max(budget.worst, key=lambda each: each.u95_deg)
    return (
        f"Uncertainty budget, mean of {budget.fields} fields\n95 % within "
        f"{largest.u95_deg:.2g} deg at {_signed(largest.angle_deg)} deg, "
        f"{largest.monte_carlo.u95_deg:.2g} deg by Monte Carlo"
    )


def _signed(angle_deg: float) -> str:
    return f"{angle_deg:+g}" if angle_deg else "0"
