"""Figure of a space resection: where the residuals are, and how large."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from numpy.typing import NDArray
from scipy import stats

from calibration.resection.resect import ResectedTarget, SpaceResection

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["resection_figure"]

_BLUE, _ORANGE, _GREY = "#0072B2", "#D55E00", "#7F7F7F"  # Okabe and Ito
_ARROW = 0.08  # of the picture's width, for the largest residual of a target used
_EDGE = 1.5  # times what is drawn of the targets used; beyond it targets left out stand at the edge
_MOST_LABELS = 60

Floats = NDArray[np.float64]


def resection_figure(
    resection: SpaceResection,
    *,
    pixel_pitch: tuple[float, float],
    sensor: tuple[int, int] | None = None,
) -> Figure:
    """Draw the residuals of a space resection.

    Parameters
    ----------
    resection : SpaceResection
        The pose and its targets.
    pixel_pitch : tuple of float
        Horizontal pitch, and vertical pitch per field line, so that the picture has the sensor's
        proportions [m].
    sensor : tuple of int, optional
        Columns, and lines per field; the targets' surroundings are drawn if not given.

    Returns
    -------
    Figure
        Left, residuals in the image as magnified arrows, measured less computed; right,
        residual of v against that of u [pixels] with the ellipse that holds 95 % of targets
        with the median uncertainty. Crosses are targets left out.
    """
    figure = Figure(figsize=(11, 4.8), layout="constrained")
    image, scatter = figure.subplots(1, 2, width_ratios=(3, 2))
    aspect = pixel_pitch[1] / pixel_pitch[0]
    _draw_image(image, resection.targets, aspect, sensor)
    _draw_scatter(scatter, resection)
    u, v = resection.rms_pixels
    used = sum(each.used for each in resection.targets)
    figure.suptitle(
        f"Space resection, {used} of {len(resection.targets)} targets used, residuals "
        f"{u:.3f} (u) and {v:.3f} (v) pixels rms"
    )
    return figure


def _draw_image(
    axes: "Axes",
    targets: Sequence[ResectedTarget],
    aspect: float,
    sensor: tuple[int, int] | None,
) -> None:
    place, residual, used = _arrays(targets)
    width = float(sensor[0] if sensor else max(np.ptp(place[:, 0]), 1.0))
    largest = float(np.max(np.hypot(residual[used, 0], residual[used, 1] * aspect)))
    magnified = _round_down(_ARROW * width / largest) if largest > 0 else 1.0
    axes.plot(*place[used].T, "o", markersize=3, color=_BLUE, label="used")
    axes.plot(*place[~used].T, "x", markersize=7, color=_ORANGE, label="left out")
    axes.quiver(
        *place[used].T,
        *(magnified * residual[used]).T,
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.004,
        color=_BLUE,
        zorder=3,
    )
    for each in targets:
        if not each.used or len(targets) <= _MOST_LABELS:
            axes.annotate(
                each.id,
                (each.u, each.v),
                xytext=(4, 4),
                textcoords="offset points",
                fontsize="x-small",
                color=_GREY if each.used else _ORANGE,
            )
    if sensor:
        axes.set_xlim(-0.5, sensor[0] - 0.5)
        axes.set_ylim(sensor[1] - 0.5, -0.5)
    else:
        axes.margins(0.15)
        axes.invert_yaxis()
    axes.set_aspect(aspect)
    axes.set_xlabel("column u [pixels]")
    axes.set_ylabel("line v [field lines]")
    axes.set_title(f"residuals, {magnified:g} times as large", fontsize="medium")
    axes.grid(alpha=0.25)


def _draw_scatter(axes: "Axes", resection: SpaceResection) -> None:
    _, residual, used = _arrays(resection.targets)
    std = np.median([(t.std_u, t.std_v) for t in resection.targets if t.used], axis=0)
    radius = float(np.sqrt(stats.chi2.ppf(0.95, 2)))
    said = "stated" if resection.noise_known else "estimated"
    axes.add_patch(
        Ellipse(
            (0, 0),
            *(2 * radius * std),
            facecolor=_BLUE,
            alpha=0.15,
            label=f"95 % of the {said} uncertainty",
        )
    )
    reach = _EDGE * np.maximum(radius * std, np.abs(residual[used]).max(axis=0))
    axes.plot(*residual[used].T, "o", markerfacecolor="none", color=_BLUE, label="used")
    if not used.all():
        shown = np.clip(residual[~used], -0.97 * reach, 0.97 * reach)
        axes.plot(*shown.T, "x", markersize=7, color=_ORANGE, label="left out (far ones at edge)")
        names = [each.id for each in resection.targets if not each.used]
        for name, at in zip(names, shown, strict=True):
            axes.annotate(
                name,
                at,
                xytext=(-4 if at[0] > 0 else 4, 4),
                ha="right" if at[0] > 0 else "left",
                textcoords="offset points",
                fontsize="x-small",
                color=_ORANGE,
            )
    axes.set_xlim(-reach[0], reach[0])
    axes.set_ylim(reach[1], -reach[1])
    axes.axhline(0, color=_GREY, linewidth=0.8)
    axes.axvline(0, color=_GREY, linewidth=0.8)
    axes.locator_params(axis="x", nbins=6)  # else the numbers run into each other
    axes.set_xlabel("residual of u [pixels]")
    axes.set_ylabel("residual of v [field lines]")
    axes.grid(alpha=0.25)
    axes.legend(fontsize="small", loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3)


def _arrays(targets: Sequence[ResectedTarget]) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    return (
        np.array([(each.u, each.v) for each in targets]),
        np.array([(each.residual_u, each.residual_v) for each in targets]),
        np.array([each.used for each in targets]),
    )


def _round_down(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not above the value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value))
