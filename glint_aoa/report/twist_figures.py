"""Figure of wing twist: rotation and displacement along the span."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from calibration.twist.measure import WingTwist

__all__ = ["twist_figure"]

_MM = 1e3
_MARKERS = "osD^v<>P"
_MOST_NAMED = 10  # in the legend


def twist_figure(results: Sequence[WingTwist]) -> Figure:
    """Draw the twist along the span.

    Parameters
    ----------
    results : sequence of WingTwist
        One for each state with flow.

    Returns
    -------
    Figure
        Above, rotation of each station [deg], less the reference's where there is one, leading
        edge up positive, with 95 % intervals; in the middle, how the intervals compare, the
        rotation's half interval alone [deg]; below, vertical displacement of the middle of the
        targets [mm]; all against the known Y [mm].
    """
    figure = Figure(figsize=(8, 7), layout="constrained")
    above, between, below = figure.subplots(3, 1, sharex=True, height_ratios=(5, 2, 3))
    colours = mpl.colormaps["cividis"](np.linspace(0.0, 0.8, max(len(results), 2)))
    for number, (result, colour) in enumerate(zip(results, colours, strict=False)):
        y = [_MM * one.y_m for one in result.stations]
        twist, u95 = _drawn(result)
        style = {
            "color": colour,
            "marker": _MARKERS[number % len(_MARKERS)],
            "markerfacecolor": "none",
            "linewidth": 1.2,
        }
        label = result.name if number < _MOST_NAMED else None
        above.errorbar(y, twist, yerr=u95, capsize=3, label=label, **style)
        between.plot(y, u95, **style)
        below.plot(y, [_MM * one.shift_z_m for one in result.stations], **style)
    reference = results[0].reference
    above.set_ylabel("twist [deg]" if reference is None else f"twist less {reference}'s [deg]")
    between.set_ylabel("95 % [deg]")
    between.set_ylim(bottom=0)
    below.set_ylabel("Z displacement [mm]")
    below.set_xlabel("Y of the station [mm]")
    for axes in (above, between, below):
        axes.grid(alpha=0.25)
    above.axhline(0, color="#7F7F7F", linewidth=0.8)
    above.legend(fontsize="small")
    figure.suptitle("Wing twist, leading edge up positive", fontsize="medium")
    return figure


def _drawn(result: WingTwist) -> tuple[list[float], list[float]]:
    """Twist and half its 95 % interval [deg], relative where there is a reference."""
    if result.reference is None:
        return (
            [one.twist_deg for one in result.stations],
            [one.twist_u95_deg for one in result.stations],
        )
    return (
        [one.relative_deg or 0.0 for one in result.stations],
        [one.relative_u95_deg or 0.0 for one in result.stations],
    )
