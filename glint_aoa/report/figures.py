"""Figures: error against moment, and a field with its line.

Each function returns a `matplotlib.figure.Figure` that belongs to no window and no global state;
`save_figure` writes it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from glint_aoa.benchmark import PointError, Technique
from glint_aoa.coverage import coverage_factor
from glint_aoa.errors import OutputError
from glint_aoa.optical.drawn_line import drawn_line
from glint_aoa.optical.measure import fit_fields
from glint_aoa.process import PointResult
from glint_aoa.records._files import replacing
from glint_aoa.records.fields import FieldStack

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["check_picture_name", "error_figure", "field_with_line", "measured_field", "save_figure"]

# Okabe and Ito's colours, told apart with any colour vision; shapes tell them apart in grey
_BLUE, _ORANGE, _GREEN, _GREY = "#0072B2", "#D55E00", "#009E73", "#7F7F7F"
_STYLES: dict[Technique, tuple[str, str, str]] = {
    "video": (_BLUE, "o", "video"),
    "inertial": (_ORANGE, "s", "inertial, raw"),
    "inertial corrected": (_GREEN, "^", "inertial, corrected"),
}
_FORMATS = (".png", ".pdf", ".svg")
_CUT_COLUMNS = 30  # either side of the column in the magnified cut-out
_CUT_LINES = 6


def error_figure(errors: Sequence[PointError]) -> Figure:
    """Draw errors against peak-to-peak moment, as figure 27 of the paper.

    Parameters
    ----------
    errors : sequence of PointError
        From `glint_aoa.benchmark.point_errors`; points without a moment are left out.

    Returns
    -------
    Figure
        One panel for excitation in yaw, one for pitch; error [deg] against moment [in lbf].
    """
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, plane in zip(panels, ("yaw", "pitch"), strict=True):
        axes.axhline(0, color=_GREY, linewidth=0.8)
        for technique, (colour, marker, label) in _STYLES.items():
            drawn = [
                (error.point.moment_in_lb_pp, value)
                for error in errors
                if error.point.plane == plane and error.point.moment_in_lb_pp is not None
                if (value := error.error_deg(technique)) is not None
            ]
            axes.plot(
                [moment for moment, _ in drawn],
                [value for _, value in drawn],
                linestyle="none",
                marker=marker,
                markersize=5,
                markerfacecolor="none",
                color=colour,
                label=label,
            )
        axes.set_title(f"Excitation in {plane}")
        axes.set_xlabel(f"peak-to-peak {plane} moment [in lbf]")
        axes.set_xlim(left=0)
        axes.grid(alpha=0.25)
    panels[0].set_ylabel("error of the mean angle [deg]")
    panels[0].legend(loc="lower left")
    return figure


def field_with_line(
    field: NDArray[np.generic],
    line_v: NDArray[np.float64],
    *,
    centre_u: NDArray[np.float64],
    centre_v: NDArray[np.float64],
    used: NDArray[np.bool_] | None = None,
    first_line: float = 0.0,
    first_column: int = 0,
    pixel_aspect: float = 1.0,
    title: str = "",
) -> Figure:
    """Draw one field with the measured line and centres over it.

    Parameters
    ----------
    field : ndarray [line, column]
        Grey levels of the recorded window.
    line_v : ndarray [column]
        The fitted line, in field lines, at each column of the window.
    centre_u, centre_v : ndarray [centre]
        Column and field line of each measured centre; NaN where nothing was measured.
    used : ndarray of bool [centre], optional
        Which centres the line was fitted to; all that were measured by default.
    first_line : float
        Field line of the window's first row, in whatever zero `line_v` and `centre_v` have; with
        the half line of an odd field where they include it.
    first_column : int
        Column of the window's first column, in the zero of `centre_u`.
    pixel_aspect : float
        Pitch of a field line over that of a column; 1 draws pixels as squares.
    title : str
        What the picture shows.

    Returns
    -------
    Figure
        Above, the field; below, a magnified cut-out of it and the residuals of the centres
        from the line [lines].

    Raises
    ------
    ValueError
        If the shapes do not fit each other.
    """
    rows, columns = field.shape
    if line_v.shape != (columns,) or centre_u.shape != centre_v.shape:
        raise ValueError(
            f"line_v has shape {line_v.shape} for {columns} columns, "
            f"centre_u {centre_u.shape} and centre_v {centre_v.shape}"
        )
    measured = np.isfinite(centre_u) & np.isfinite(centre_v)
    used = measured if used is None else used & measured
    u = first_column + np.arange(columns)
    extent = (
        first_column - 0.5,
        first_column + columns - 0.5,
        first_line + rows - 0.5,
        first_line - 0.5,
    )
    height = min(max(10.0 * rows * pixel_aspect / columns, 1.2), 6.0)
    figure = Figure(figsize=(11, height + 3.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(height, 2.4), width_ratios=(2, 3))
    whole, cut = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[1, 0])
    for axes in (whole, cut):
        axes.imshow(field, cmap="gray", extent=extent, aspect=pixel_aspect, interpolation="nearest")
        axes.plot(u, line_v, color=_ORANGE, linewidth=1, label="fitted line")
        _draw_centres(axes, centre_u, centre_v, used, measured & ~used)
        axes.set_xlabel("column u [pixels]")
        axes.set_ylabel("line v [field lines]")
    whole.set_xlim(extent[0], extent[1])
    whole.set_ylim(extent[2], extent[3])
    whole.legend(loc="upper right", fontsize="small", ncols=3)
    _magnify(whole, cut, centre_u[used], u, line_v)
    residual = centre_v - np.interp(centre_u, u, line_v)
    _draw_residuals(figure.add_subplot(grid[1, 1]), centre_u, residual, used, measured & ~used)
    figure.suptitle(title)
    return figure


def measured_field(stack: FieldStack, result: PointResult, number: int) -> Figure:
    """Draw one field of a measured point with its line and centres over it.

    Parameters
    ----------
    stack : FieldStack
        The recorded fields.
    result : PointResult
        From `glint_aoa.process.measure_point`.
    number : int
        Number of the field.

    Returns
    -------
    Figure
        As from `field_with_line`, in sensor columns and field lines.
    """
    angles, how = result.angles, result.measurement
    recording = how.recording
    first_line = float(recording.line_of(np.zeros(1), angles.field[[number]])[0])
    field = stack.read(number, number + 1)
    centres, fit = fit_fields(field, angles.field[[number]], how)
    angle = result.values["angle_deg"][number]
    u95 = coverage_factor() * result.values["angle_std_deg"][number]
    measured = f"{angle:.4f} deg, 95 % within {u95:.4f} deg" if np.isfinite(angle) else "no angle"
    pitch = how.to_plane.pixel_pitch
    return field_with_line(
        field[0],
        first_line + drawn_line(fit, number, how, field.shape[1:]),
        centre_u=recording.first_column + how.columns.astype(np.float64),
        centre_v=first_line + centres.row[0],
        first_line=first_line,
        first_column=recording.first_column,
        pixel_aspect=pitch[1] / pitch[0],
        title=f"{result.name}, field {number}: {measured}",
    )


def save_figure(figure: Figure, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a figure, as PNG, PDF or SVG by the suffix of its name.

    Parameters
    ----------
    figure : Figure
        What to write.
    path : str or Path
        The file; it appears under its name only when it is whole.
    overwrite : bool
        Whether a file of that name may be replaced.

    Raises
    ------
    OutputError
        If the suffix is another, the file exists and `overwrite` is False, or it cannot be
        written.
    """
    path = Path(path)
    check_picture_name(path)
    with replacing(path, overwrite=overwrite) as temporary:
        figure.savefig(temporary, format=path.suffix.lower()[1:], dpi=150)


def check_picture_name(path: Path) -> None:
    """Refuse a name that no picture can have; commands call it before work is done.

    Raises
    ------
    OutputError
        If the suffix is none of a picture's.
    """
    if path.suffix.lower() not in _FORMATS:
        raise OutputError(f"{path}: not a kind of picture; end its name with {', '.join(_FORMATS)}")


def _draw_centres(
    axes: "Axes",
    u: NDArray[np.float64],
    v: NDArray[np.float64],
    used: NDArray[np.bool_],
    left_out: NDArray[np.bool_],
) -> None:
    axes.plot(
        u[used],
        v[used],
        linestyle="none",
        marker="o",
        markersize=4,
        markerfacecolor="none",
        color="#56B4E9",
        label="centres",
    )
    if left_out.any():
        axes.plot(
            u[left_out],
            v[left_out],
            linestyle="none",
            marker="x",
            markersize=5,
            color="#F0E442",
            label="left out",
        )


def _magnify(
    whole: "Axes",
    cut: "Axes",
    used_u: NDArray[np.float64],
    u: NDArray[np.int64],
    line_v: NDArray[np.float64],
) -> None:
    """Show the surroundings of the middle centre, and mark them in the whole field."""
    middle = float(np.sort(used_u)[used_u.size // 2]) if used_u.size else float(u.mean())
    level = float(np.interp(middle, u, line_v))
    level = level if np.isfinite(level) else float(np.mean(whole.get_ylim()))
    cut.set_xlim(middle - _CUT_COLUMNS, middle + _CUT_COLUMNS)
    cut.set_ylim(level + _CUT_LINES, level - _CUT_LINES)
    cut.set_aspect("auto")
    cut.set_title("magnified", fontsize="medium")
    corner = (middle - _CUT_COLUMNS, level - _CUT_LINES)
    whole.indicate_inset((*corner, 2 * _CUT_COLUMNS, 2 * _CUT_LINES), edgecolor="white", alpha=0.8)


def _draw_residuals(
    axes: "Axes",
    u: NDArray[np.float64],
    residual: NDArray[np.float64],
    used: NDArray[np.bool_],
    left_out: NDArray[np.bool_],
) -> None:
    axes.axhline(0, color=_ORANGE, linewidth=1)
    axes.plot(
        u[used], residual[used], linestyle="none", marker="o", markerfacecolor="none", color=_BLUE
    )
    axes.set_xlabel("column u [pixels]")
    axes.set_ylabel("centre - line [field lines]")
    axes.grid(alpha=0.25)
    spread = (
        f"rms {np.sqrt(np.mean(residual[used] ** 2)):.4f} lines" if used.any() else "no centres"
    )
    out = f", {int(left_out.sum())} left out" if left_out.any() else ""
    axes.set_title(f"residuals, {spread}{out}", fontsize="medium")
    largest = float(np.abs(residual[used]).max()) if used.any() else 0.0
    half = 1.3 * largest or 1.0
    axes.set_ylim(half, -half)  # v points down, as in the field
