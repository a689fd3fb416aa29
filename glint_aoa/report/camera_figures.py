"""The figure of a camera calibration: what each picture of the board leaves."""

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from calibration.camera.calibrate import CameraCalibration, ImageFit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["camera_figure"]

# Okabe and Ito's colours, told apart with any colour vision
_BLUE, _ORANGE, _GREY = "#0072B2", "#D55E00", "#7F7F7F"
_PER_ROW = 5
_MOST_PANELS = 30
_LONGEST_ARROW = 0.06  # of the sensor's width, for a residual of three times the rms
_REASON_LENGTH = 150
_NICE = (1.0, 2.0, 5.0)


def camera_figure(calibration: CameraCalibration) -> Figure:
    """Draw what each picture of the board leaves, all together and one by one.

    Parameters
    ----------
    calibration : CameraCalibration
        From `calibration.camera.calibrate.calibrate_camera`; one that was read from its file has no
        residuals to draw.

    Returns
    -------
    Figure
        Above, the residuals of all corners on the sensor, enlarged, and against their distance
        from the principal point; below, those of each picture, with its rms [pixels], or why it
        was left out. No more than 30 pictures: those left out, then those with the largest rms.
    """
    panels = _panels(calibration.images)
    n_rows = -(-len(panels) // _PER_ROW)
    figure = Figure(figsize=(12, 4 + 1.9 * n_rows), layout="constrained")
    parts = figure.subfigures(2, 1, squeeze=False, height_ratios=(4, 1.9 * max(n_rows, 1)))
    above, below = parts[:, 0]
    sensor, radial = above.subplots(1, 2)
    used = [image for image in calibration.images if len(image.uv)]
    uv = np.concatenate([image.uv for image in used] or [np.empty((0, 2))])
    residuals = np.concatenate([image.residuals for image in used] or [np.empty((0, 2))])
    enlarged = _enlargement(calibration)
    _sensor(sensor, calibration, labels=True)
    _arrows(sensor, uv, residuals, enlarged, width=0.002)
    sensor.plot(*calibration.principal_point, marker="+", markersize=10, color=_ORANGE)
    sensor.set_title(
        f"residuals of {len(uv)} corners, {enlarged:.0f} times enlarged; + principal point",
        fontsize="medium",
    )
    _radial(radial, calibration, uv, residuals)
    grid = below.subplots(max(n_rows, 1), _PER_ROW, squeeze=False)
    for axes, image in zip(grid.flat, panels, strict=False):
        _panel(axes, calibration, image, enlarged)
    for axes in grid.flat[len(panels) :]:
        axes.set_axis_off()
    n_used = sum(image.used for image in calibration.images)
    figure.suptitle(
        f"Camera calibration, {n_used} of {len(calibration.images)} pictures, "
        f"rms {calibration.rms_pixels:.3f} pixels"
    )
    return figure


def _panels(images: Sequence[ImageFit]) -> list[ImageFit]:
    """Return the pictures to draw, in their order."""
    if len(images) <= _MOST_PANELS:
        return list(images)
    urgent = sorted(images, key=lambda image: (image.used, -np.nan_to_num(image.rms)))
    chosen = {id(image) for image in urgent[:_MOST_PANELS]}
    return [image for image in images if id(image) in chosen]


def _enlargement(calibration: CameraCalibration) -> float:
    """Return a round factor that makes residuals visible."""
    wanted = _LONGEST_ARROW * calibration.sensor[0] / (3 * max(calibration.rms_pixels, 1e-9))
    power = 10 ** np.floor(np.log10(wanted))
    return float(max(each * power for each in _NICE if each * power <= wanted))


def _sensor(axes: "Axes", calibration: CameraCalibration, *, labels: bool) -> None:
    columns, lines = calibration.sensor
    axes.set_xlim(-0.5, columns - 0.5)
    axes.set_ylim(lines - 0.5, -0.5)  # v points down, as in the picture
    axes.set_aspect(calibration.pixel_pitch_m[1] / calibration.pixel_pitch_m[0])
    if labels:
        axes.set_xlabel("column u [pixels]")
        axes.set_ylabel("line v [pixels]")
    else:
        axes.set_xticks([])
        axes.set_yticks([])


def _arrows(
    axes: "Axes",
    uv: NDArray[np.float64],
    residuals: NDArray[np.float64],
    enlarged: float,
    *,
    width: float,
) -> None:
    if len(uv):
        axes.quiver(
            *uv.T,
            *residuals.T,
            angles="xy",
            scale_units="xy",
            scale=1 / enlarged,
            color=_BLUE,
            width=width,
        )


def _radial(
    axes: "Axes",
    calibration: CameraCalibration,
    uv: NDArray[np.float64],
    residuals: NDArray[np.float64],
) -> None:
    """Draw the radial part of the residuals: what is left of the lens's distortion."""
    aspect = calibration.pixel_pitch_m[1] / calibration.pixel_pitch_m[0]
    off = (uv - calibration.principal_point) * [1.0, aspect]
    radius = np.hypot(*off.T)
    radial = np.sum(residuals * [1.0, aspect] * off, axis=1) / np.maximum(radius, 1e-9)
    axes.plot(radius, radial, linestyle="none", marker=".", markersize=3, color=_BLUE)
    axes.axhline(0, color=_ORANGE, linewidth=1)
    axes.set_xlabel("distance from the principal point [columns]")
    axes.set_ylabel("radial residual [columns]")
    axes.set_title(
        f"noise {calibration.noise_pixels[0]:.3f} columns, {calibration.noise_pixels[1]:.3f} lines",
        fontsize="medium",
    )
    axes.grid(alpha=0.25)


def _panel(axes: "Axes", calibration: CameraCalibration, image: ImageFit, enlarged: float) -> None:
    _sensor(axes, calibration, labels=False)
    name = image.name if len(image.name) <= 28 else f"...{image.name[-25:]}"
    if not image.used:
        axes.set_facecolor("#F2F2F2")
        axes.set_title(f"{name}: left out", fontsize="small", color=_ORANGE)
        reason = image.reason
        reason = f"{reason[:_REASON_LENGTH]}..." if len(reason) > _REASON_LENGTH else reason
        axes.text(
            0.03,
            0.95,
            fill(reason, 38),
            transform=axes.transAxes,
            va="top",
            fontsize="x-small",
            color="black",
        )
        return
    _arrows(axes, image.uv, image.residuals, enlarged, width=0.006)
    axes.set_title(f"{name}: {image.rms:.3f}", fontsize="small")
    for spine in axes.spines.values():
        spine.set_color(_GREY)
