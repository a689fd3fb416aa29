"""Draw the pictures of signs in docs/conventions.md; what they claim stands here as plain numbers.

Run ``python -m docs.pictures.signs`` to draw them anew. The claims are written by hand, from the
words of the conventions; tests/test_sign_pictures.py holds each against the program.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

__all__ = [
    "EVEN_LINES",
    "IMAGE_MOVES",
    "NOSE_IN_PLAN",
    "ODD_LINES",
    "PITCHED_GLINT",
    "SENSED",
    "draw_all",
]

_INK, _OLD, _NEW, _LIGHT = "#22313a", "#9aa7af", "#0072b2", "#d55e00"
_STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "glint-aoa",
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.titlesize": 10,
}

# What the pictures claim

PITCHED_GLINT = {
    "left": ((-1.0, 0.25), (1.0, -0.25)),
    "right": ((-1.0, -0.25), (1.0, 0.25)),
}
"""Two points X, Z of the glint of a model with its nose up, by where the nose points."""

NOSE_IN_PLAN = {"left": (-0.94, -0.34), "right": (0.94, 0.34)}
"""Direction X, Y of the nose at a positive yaw."""

EVEN_LINES, ODD_LINES = (0.0, 1.0, 2.0), (0.5, 1.5, 2.5)
"""Sensor line v of the first rows of an even and of an odd field."""

_SHIFT, _TURN = 0.22, 0.2

IMAGE_MOVES: dict[str, Callable[[Any, Any], tuple[Any, Any]]] = {
    "omega": lambda x, z: (x, z - _SHIFT),
    "phi": lambda x, z: (x - _TURN * z, z + _TURN * x),
    "kappa": lambda x, z: (x + _SHIFT, z),
}
"""Where a point x (right), z (up) of the picture goes when the camera turns by a positive angle."""

SENSED = {"aft": (1.0, -1.0), "forward": (-1.0, 1.0)}
"""Sign of rho and of the bias, by where the point of rotation lies from the sensor."""


# The drawings


def draw_all(folder: Path) -> list[Path]:
    """Draw every picture as SVG into `folder`, without date, so that equal drawings are equal."""
    drawings = {
        "pitch": _pitch,
        "yaw": _yaw,
        "image": _image,
        "camera": _camera,
        "radius": _radius,
    }
    paths = []
    with mpl.rc_context(_STYLE):
        for name, draw in drawings.items():
            figure = draw()
            path = folder / f"{name}.svg"
            figure.savefig(path, metadata={"Date": None}, facecolor="white", bbox_inches="tight")
            plt.close(figure)
            lines = path.read_text().splitlines()  # some end in blanks
            path.write_text("\n".join(line.rstrip() for line in lines) + "\n")
            paths.append(path)
    return paths


def _panels(n: int, size: tuple[float, float]) -> tuple[Any, list[Any]]:
    figure, axes = plt.subplots(1, n, figsize=size)
    all_axes = list(np.atleast_1d(axes))
    for each in all_axes:
        each.set_aspect("equal")
        each.axis("off")
    return figure, all_axes


def _arrow(axes: Any, start: Any, end: Any, colour: str = _INK, **how: Any) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 0} | how
    axes.annotate("", xy=end, xytext=start, arrowprops=style)


def _cross(
    axes: Any, at: tuple[float, float], names: tuple[str, str], length: float = 0.35
) -> None:
    """Draw two axes of a frame, to the right and up."""
    x, y = at
    _arrow(axes, at, (x + length, y))
    _arrow(axes, at, (x, y + length))
    axes.text(x + length + 0.04, y, names[0], va="center", color=_INK)
    axes.text(x, y + length + 0.04, names[1], ha="center", va="bottom", color=_INK)


def _pitch() -> Any:
    figure, panels = _panels(2, (8.0, 2.6))
    for axes, (nose, ends) in zip(panels, PITCHED_GLINT.items(), strict=True):
        first, last = (np.array(end) for end in ends)
        ahead = first if nose == "left" else last
        _body(axes, *((first, last) if nose == "right" else (last, first)))
        axes.plot(*np.array(ends).T, color=_LIGHT, lw=2.5)
        axes.plot([-1.0, 1.0], [0, 0], color=_OLD, lw=0.8, ls="--")
        axes.text(*(1.56 * ahead), "nose", ha="center", va="center", color=_INK)
        axes.text(-0.55 * np.sign(ahead[0]), 0.28, "glint", color=_LIGHT, ha="center")
        side = np.sign(ahead[0])
        _arrow(
            axes, (0.75 * side, 0.0), 0.75 * ahead, _NEW, connectionstyle=f"arc3,rad={0.18 * side}"
        )
        axes.text(0.45 * side, -0.32, r"$\alpha > 0$", color=_NEW, ha="center")
        sign = "−" if nose == "left" else "+"
        axes.set_title(f'nose = "{nose}": α = {sign}atan(dZ/dX)', color=_INK)
        _cross(axes, (-1.75, -0.62), ("X", "Z"))
        axes.set(xlim=(-1.9, 1.75), ylim=(-0.8, 0.75))
    return figure


def _body(axes: Any, tail: NDArray[np.float64], nose: NDArray[np.float64]) -> None:
    """Draw a fuselage about the line from `tail` to `nose`."""
    along = (nose - tail) / np.hypot(*(nose - tail))
    across = 0.13 * np.array([-along[1], along[0]])
    tip = nose + 0.25 * along
    outline = np.array([tail + across, nose + across, tip, nose - across, tail - across])
    axes.fill(*outline.T, facecolor="#eef1f3", edgecolor=_OLD, lw=1.0)


def _yaw() -> Any:
    figure, panels = _panels(2, (8.0, 3.0))
    for axes, (nose, ahead) in zip(panels, NOSE_IN_PLAN.items(), strict=True):
        direction = np.array(ahead)
        axes.plot([-1.1, 1.1], [0, 0], color=_OLD, lw=0.8, ls="--")
        _body(axes, -0.9 * direction, 0.9 * direction)
        axes.text(*(1.5 * direction), "nose", ha="center", va="center", color=_INK)
        side = np.sign(ahead[0])
        _arrow(axes, (0.75 * side, 0.0), 0.75 * direction, _NEW, connectionstyle="arc3,rad=0.2")
        axes.text(1.05 * side, 0.12 * side, r"$\psi > 0$", color=_NEW, ha="center", va="center")
        axes.fill([-0.12, 0.12, 0.12, -0.12], [-1.18, -1.18, -1.0, -1.0], color=_INK)
        axes.text(0.2, -1.1, "camera", va="center", color=_INK)
        _arrow(axes, (0.0, -1.0), (0.0, -0.65), _INK, ls="-")
        axes.set_title(f'nose = "{nose}", from above\n(Z towards you)', color=_INK)
        _cross(axes, (-1.75, -1.1), ("X", "Y"))
        axes.set(xlim=(-1.9, 1.6), ylim=(-1.3, 0.65))
    return figure


def _image() -> Any:
    figure, (axes, lines) = _panels(2, (8.0, 3.2))
    axes.add_patch(plt.Rectangle((0, 0), 3.0, 2.0, fill=False, ec=_INK))
    _arrow(axes, (0, 2.0), (0.8, 2.0), _NEW)
    _arrow(axes, (0, 2.0), (0, 1.2), _NEW)
    axes.text(0.85, 2.0, "u", color=_NEW, va="center", backgroundcolor="white")
    axes.text(0.0, 1.1, "v", color=_NEW, ha="center", va="top", backgroundcolor="white")
    axes.plot(1.5, 1.0, "o", color=_LIGHT, ms=4)
    _arrow(axes, (1.5, 1.0), (2.3, 1.0), _LIGHT)
    _arrow(axes, (1.5, 1.0), (1.5, 1.7), _LIGHT)
    axes.text(2.35, 1.0, "x", color=_LIGHT, va="center")
    axes.text(1.5, 1.75, "z", color=_LIGHT, ha="center")
    axes.text(1.5, 0.88, "principal point", color=_LIGHT, ha="center", va="top")
    axes.set_title("pixels u, v and image plane x, z", color=_INK)
    axes.set(xlim=(-0.25, 3.2), ylim=(-0.15, 2.2))
    for rows, colour, name in ((EVEN_LINES, _NEW, "even"), (ODD_LINES, _LIGHT, "odd")):
        for row, v in enumerate(rows):
            lines.plot([0, 2.2], [-v, -v], color=colour, lw=2, ls="-" if name == "even" else "--")
            lines.text(2.3, -v, f"row {row}, {name} field: v = {v:g}", va="center", color=colour)
    _arrow(lines, (-0.15, 0.1), (-0.15, -2.7))
    lines.text(-0.25, -2.6, "v", ha="right", color=_INK)
    lines.set_title("interlace: odd lines lie half a line lower", color=_INK)
    lines.set(xlim=(-0.5, 5.2), ylim=(-2.9, 0.3), aspect="auto")
    return figure


_CAMERA_WORDS = {
    "omega": ("ω > 0: optical axis rises,", "picture sinks"),
    "phi": ("φ > 0: right side sinks,", "picture turns back"),
    "kappa": ("κ > 0: optical axis turns to −X,", "picture moves right"),
}


def _camera() -> Any:
    figure, panels = _panels(3, (9.5, 2.9))
    corners = np.array([[-0.6, 0.6, 0.6, -0.6, -0.6], [-0.3, -0.3, 0.3, 0.3, -0.3]])
    for axes, (name, move) in zip(panels, IMAGE_MOVES.items(), strict=True):
        axes.add_patch(plt.Rectangle((-1.0, -0.75), 2.0, 1.5, fill=False, ec=_INK))
        axes.plot(*corners, color=_OLD, lw=1.5)
        axes.plot(*move(*corners), color=_NEW, lw=2)
        for x, z in ((-0.6, 0.0), (0.6, 0.0)):
            _arrow(axes, (x, z), move(x, z), _LIGHT)
        first, second = _CAMERA_WORDS[name]
        axes.set_title(f"{first}\n{second}", color=_INK)
        axes.set(xlim=(-1.05, 1.05), ylim=(-0.8, 0.8))
    return figure


def _radius() -> Any:
    figure, panels = _panels(2, (9.5, 2.5))
    for axes, (where, (rho, bias)) in zip(panels, SENSED.items(), strict=True):
        sensor, pivot = (-0.75, 0.0), (-0.75 + 0.7 * rho, 0.0)
        _body(axes, np.array([1.1, 0.0]), np.array([-1.0, 0.0]))
        axes.plot(*sensor, "s", color=_NEW, ms=8)
        axes.plot(*pivot, "o", color=_INK, ms=6)
        _arrow(axes, sensor, (sensor[0] + 0.3 * rho, 0.0), _LIGHT, lw=2)
        swing = np.radians(np.linspace(-28, 28, 30))
        arc = np.array([np.cos(swing) * -0.7 * rho, np.sin(swing) * 0.7])
        axes.plot(pivot[0] + arc[0], arc[1], color=_NEW, lw=1.2, ls="--")
        axes.annotate("", (pivot[0], -0.5), (sensor[0], -0.5), arrowprops={"arrowstyle": "<->"})
        axes.text(np.mean([sensor[0], pivot[0]]), -0.56, "|ρ|", ha="center", va="top", color=_INK)
        axes.text(pivot[0] + 0.1 * rho, 0.22, "point of rotation", ha="center", color=_INK)
        axes.text(
            sensor[0] + 0.15 * rho, -0.19, "acceleration", ha="center", va="top", color=_LIGHT
        )
        sign = "<" if bias < 0 else ">"
        rho_sign = ">" if rho > 0 else "<"
        axes.set_title(f"point {where} of the sensor: ρ {rho_sign} 0, bias {sign} 0", color=_INK)
        axes.set(xlim=(-2.3, 1.4), ylim=(-0.8, 0.5))
    return figure


if __name__ == "__main__":
    for drawn in draw_all(Path(__file__).parent):
        print(drawn)
