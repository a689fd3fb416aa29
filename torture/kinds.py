"""What can be wrong with a recording: one function for each, which spoils a scene."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from glint_aoa.flags import Flag
from torture.profile import Profile
from torture.scene import LINES_PER_MM, RATE_HZ, STEEPEST, Scene, draw_scene

__all__ = ["KINDS", "draw"]

_Rng = np.random.Generator

_NOT_SEEN = Flag.NO_GLINT | Flag.LOW_CONTRAST | Flag.TRUNCATED | Flag.FEW_COLUMNS | Flag.POOR_LINE
_LARGE = (92, 752)
_MIXED_IN = 0.25  # share of the recordings with a second thing wrong


def plain(scene: Scene, rng: _Rng) -> None:
    """Leave the scene as it is."""


def steep(scene: Scene, rng: _Rng) -> None:
    """Make the line as steep as the window allows, up to 12 deg."""
    target = rng.choice([-1, 1]) * rng.uniform(0.7, 1.0) * STEEPEST / scene.aspect
    scene.slope += target - scene.slope.mean()
    scene.keep_in_view()


def partly_out(scene: Scene, rng: _Rng) -> None:
    """Let the line leave the window on its way."""
    out = rng.uniform(0.1, 0.6)
    half = (scene.columns - 1) / 2
    slope = rng.choice([-1, 1]) * rng.uniform(0.02, 1.0) * STEEPEST / scene.aspect
    scene.slope += slope - scene.slope.mean()
    edge = rng.choice([-0.5, scene.lines - 0.5])
    towards = np.sign(slope) * (1 if edge > 0 else -1)
    scene.row += edge - slope * towards * half * (1 - 2 * out) - scene.row.mean()


def low_contrast(scene: Scene, rng: _Rng) -> None:
    """Make the line hardly brighter than a textured background."""
    scene.peak = rng.uniform(12, 20)
    scene.background = scene.background - scene.background.mean() + rng.uniform(20, 60)
    grain = rng.standard_normal(scene.background.shape)
    scene.background += (0.8 * (grain + np.roll(grain, 1, axis=1)) / np.sqrt(2)).clip(-4, 4)
    scene.texture = float(np.hypot(scene.texture, 0.8))
    scene.read_noise = min(scene.read_noise, 1.2)
    scene.electrons_per_grey = max(scene.electrons_per_grey, 150.0)


def second_glint(scene: Scene, rng: _Rng) -> None:
    """Add a parallel line, dimmer than the glint."""
    away = rng.uniform(2.2, 5.0) * scene.profile.body / 2.5 + 3.0
    scene.second = [(rng.choice([-1, 1]) * away, rng.uniform(0.2, 0.6))]


def gradient(scene: Scene, rng: _Rng) -> None:
    """Let the background grow down the window."""
    v = np.linspace(-1, 1, scene.lines)[:, None]
    rise = rng.uniform(-60, 60) * v + rng.uniform(-30, 30) * v**2
    _lighten(scene, rise - rise.min())


def _lighten(scene: Scene, light: NDArray[np.float64]) -> None:
    """Add light to the background, as much of it as leaves the line below the top of the scale."""
    room = 245 - scene.background.max() - (scene.peak if scene.sign > 0 else 0)
    scene.background = scene.background + light * np.clip(room / light.max(), 0.0, 1.0)


def body_edge(scene: Scene, rng: _Rng) -> None:
    """Put the model's silhouette, a step of brightness, beside the line and parallel to it."""
    side = rng.choice([-1, 1])
    at = scene.centre(0) + side * rng.uniform(1.6, 4.0) * scene.profile.reach
    below = 1 / (1 + np.exp(-side * (np.arange(scene.lines)[:, None] - at) / 0.7))
    _lighten(scene, rng.uniform(10, 60) * below)
    scene.slope = np.full_like(scene.slope, scene.slope[0])
    scene.row = np.full_like(scene.row, scene.row[0])


def hot_pixels(scene: Scene, rng: _Rng) -> None:
    """Let single pixels shine always."""
    hot = rng.random(scene.background.shape) < rng.uniform(0.0002, 0.004)
    scene.fixed.append(np.where(hot, rng.uniform(120, 255, hot.shape), np.nan))


def dead_columns(scene: Scene, rng: _Rng) -> None:
    """Make columns dark or bright from top to bottom."""
    layer = np.full(scene.background.shape, np.nan)
    for column in rng.integers(scene.columns, size=int(rng.integers(1, 9))):
        layer[:, column] = rng.choice([0.0, 255.0, rng.uniform(0, 255)])
    scene.fixed.append(layer)


def stripe(scene: Scene, rng: _Rng) -> None:
    """Paint a stripe across the line."""
    u, v = np.arange(scene.columns), np.arange(scene.lines)[:, None]
    middle = rng.uniform(0, scene.columns) + rng.uniform(-1.0, 1.0) * (v - scene.lines / 2)
    inside = np.abs(u - middle) < rng.uniform(0.008, 0.06) * scene.columns
    scene.background = np.where(inside, rng.uniform(60, 230), scene.background)


def flare(scene: Scene, rng: _Rng) -> None:
    """Put a spot of light on the model beside the line or on it."""
    u, v = np.arange(scene.columns), np.arange(scene.lines)[:, None]
    at_u, at_v = rng.uniform(0, scene.columns), rng.uniform(0, scene.lines)
    wide, high = rng.uniform(8, 60), rng.uniform(3, 20)
    spot = np.exp(-0.5 * (((u - at_u) / wide) ** 2 + ((v - at_v) / high) ** 2))
    scene.background = scene.background + rng.uniform(30, 200) * spot


def dark(scene: Scene, rng: _Rng) -> None:
    """Make the line dark on a bright body."""
    scene.sign = -1
    scene.background = scene.background - scene.background.mean() + rng.uniform(150, 220)
    scene.peak = min(scene.peak, 130.0)
    scene.glint["polarity"] = "dark"


def narrow_window(scene: Scene, rng: _Rng) -> None:
    """Record twenty lines only."""
    scene.profile = Profile.gaussian(rng.uniform(0.8, 1.5))
    scene.keep_in_view()


def search_window(scene: Scene, rng: _Rng) -> None:
    """Put a brighter rail in view, outside the rows that the setup says to look in."""
    scene.row -= scene.lines / 4
    room = scene.lines / 4 - scene.profile.body - 3
    scene.slope *= min(1.0, room / (np.abs(scene.slope).max() * scene.columns / 2 + 1e-9))
    swing = scene.row - scene.row.mean()
    scene.row = scene.lines / 4 + swing * min(1.0, 1.0 / (np.abs(swing).max() + 1e-9))
    rail = 0.8 * scene.lines + rng.uniform(-0.02, 0.02) * scene.u
    across = (np.arange(scene.lines)[:, None] - rail) / 1.5
    scene.background = scene.background + 200 * np.exp(-0.5 * across**2)
    scene.glint["search_window"] = (0, int(0.6 * scene.lines))


def clipped(scene: Scene, rng: _Rng) -> None:
    """Make the line's middle brighter than the scale."""
    scene.peak = rng.uniform(1.1, 1.8) * 255


def uneven(scene: Scene, rng: _Rng) -> None:
    """Vary the brightness along the line."""
    wave = np.sin(2 * np.pi * (rng.uniform(0.3, 3) * scene.u / scene.columns + rng.random()))
    scene.over_columns = 1 - rng.uniform(0.2, 0.4) * (1 + wave)


def vibration(scene: Scene, rng: _Rng) -> None:
    """Shake the model as strongly as in the paper's test, in one mode or two."""
    time = np.arange(len(scene.row)) / RATE_HZ
    for _ in range(int(rng.integers(1, 3))):
        phase = 2 * np.pi * (rng.uniform(5, 29) * time + rng.random())
        amplitude = np.radians(rng.uniform(0.05, 0.3)) / scene.aspect
        scene.slope = scene.slope + amplitude * np.sin(phase)
        heave = rng.uniform(0, 4) * LINES_PER_MM
        scene.row = scene.row + heave * np.sin(phase + rng.uniform(0, 2 * np.pi))
    scene.keep_in_view()


def ramp(scene: Scene, rng: _Rng) -> None:
    """Pitch the model while the camera runs."""
    n = len(scene.row)
    swept = np.tan(np.radians(rng.uniform(-4, 4))) / scene.aspect
    scene.slope = scene.slope + swept * np.linspace(-0.5, 0.5, n)
    scene.row = scene.row + rng.uniform(-0.25, 0.25) * scene.lines * np.linspace(-1, 1, n)
    scene.keep_in_view()


def leaving(scene: Scene, rng: _Rng) -> None:
    """Move the model out of the window, and perhaps back."""
    n = len(scene.row)
    first = int(rng.integers(4, n - 4))
    away = np.clip(np.arange(n) - first, 0, None) / rng.uniform(2, 12)
    if rng.random() < 0.5:
        last = int(rng.integers(first + 1, n))
        away = np.where(np.arange(n) <= last, away, np.clip(away[last] - (away - away[last]), 0, 1))
    scene.row = scene.row + rng.choice([-1, 1]) * np.minimum(away, 1.6) * scene.lines
    for k in range(n):
        centre = scene.centre(k)
        if (np.abs(centre - (scene.lines - 1) / 2) > scene.lines / 2 + scene.profile.body).all():
            scene.owed[k] = _NOT_SEEN
    scene.allowed |= Flag.MOVED | Flag.FADING


def fog(scene: Scene, rng: _Rng) -> None:
    """Fade the contrast through the recording."""
    n = len(scene.row)
    left = rng.uniform(0.03, 0.4)
    share = np.linspace(0, 1, n) ** rng.uniform(0.5, 2)
    scene.over_fields = 1 - (1 - left) * (share if rng.random() < 0.7 else share[::-1])
    scene.background = scene.background + rng.uniform(0, 30)
    lasting = np.sort(scene.over_fields)[-2]  # the very first field may be a flash
    scene.owed[scene.over_fields < 0.45 * lasting] = Flag.FADING | _NOT_SEEN
    scene.allowed |= Flag.FADING


def lamp(scene: Scene, rng: _Rng) -> None:
    """Make the lamp brighter or darker at some field."""
    n = len(scene.row)
    step = rng.choice([rng.uniform(0.2, 0.8), rng.uniform(1.25, 2.0)])
    scene.over_fields[int(rng.integers(3, n - 3)) :] = step
    scene.peak = min(scene.peak, 200 / max(step, 1.0))
    dim = scene.over_fields < 0.45 * scene.over_fields.max()
    scene.owed[dim] = Flag.FADING | _NOT_SEEN
    scene.allowed |= Flag.FADING


def bump(scene: Scene, rng: _Rng) -> None:
    """Knock the camera; a mark in view shows it."""
    n, first = len(scene.row), int(rng.integers(6, len(scene.row) - 3))
    scene.row -= scene.row.mean() - 0.36 * scene.lines
    room = 0.36 * scene.lines - scene.profile.body - 6
    scene.slope *= min(1.0, room / (np.abs(scene.slope).max() * scene.columns / 2 + 1e-9))
    swing = scene.row - scene.row.mean()
    scene.row = scene.row.mean() + swing * min(1.0, 2.0 / (np.abs(swing).max() + 1e-9))
    moved = np.arange(n) >= first
    scene.camera_row[moved] = rng.choice([-1, 1]) * rng.uniform(0.4, 3.0)
    scene.camera_slope[moved] = rng.uniform(-1, 1) * 0.002
    row, left = scene.lines - 14.0, int(0.1 * scene.columns)
    right = left + max(30, scene.columns // 12)
    scene.mark = (row, slice(left, right))
    scene.glint["reference"] = {
        "rows": (int(row) - 10, int(row) + 11), "columns": (left, right)
    }  # fmt: skip
    scene.glint["search_window"] = (0, int(row) - 10)
    scene.owed[moved] = Flag.CAMERA_MOVED
    scene.allowed |= Flag.MOVED


def parity_order(scene: Scene, rng: _Rng) -> None:
    """Store odd fields where the recording says even ones are."""
    n = len(scene.row)
    scene.interlaced = True
    scene.parity = (np.arange(n) + scene.first_parity + 1) % 2
    if rng.random() < 0.3:  # a progressive camera that calls itself interlaced
        scene.parity = np.zeros(n, np.int64)
    if rng.random() < 0.2:  # and the other way round
        scene.parity = (np.arange(n) + 1) % 2
        scene.interlaced, scene.first_parity = False, 0
    scene.owed[:] = Flag.PARITY_ORDER


def parity_slip(scene: Scene, rng: _Rng) -> None:
    """Drop a field, with which even and odd change places."""
    n = len(scene.row)
    scene.interlaced = True
    scene.parity = (np.arange(n) + scene.first_parity) % 2
    lost = int(rng.integers(6, n - 6))
    scene.order = np.delete(np.arange(n), lost)
    scene.shows = scene.order
    scene.owed = np.zeros(n - 1, np.int64)
    # In strong motion the place may be found one field off; the order is wrong there all the same.
    scene.owed[lost] = Flag.DROPPED | Flag.PARITY_ORDER
    scene.allowed |= Flag.DROPPED | Flag.PARITY_ORDER


def dropped_times(scene: Scene, rng: _Rng) -> None:
    """Drop fields, as the timestamps show."""
    n = len(scene.row)
    lost = int(rng.integers(4, n - 8))
    count = int(rng.integers(1, 4))
    if scene.interlaced:
        count = 2  # so that parity goes on as if nothing had happened
    scene.order = np.delete(np.arange(n), np.arange(lost, lost + count))
    scene.shows = scene.order
    scene.times_s = scene.order / RATE_HZ + 2e-5 * rng.standard_normal(n - count)
    scene.owed = np.zeros(n - count, np.int64)
    scene.owed[lost] = Flag.TIMING | Flag.DROPPED


def repeated(scene: Scene, rng: _Rng) -> None:
    """Make some fields copies of the one before, or of the one of the same parity."""
    n = len(scene.row)
    back = 2 if scene.interlaced else int(rng.integers(1, 3))
    # In order, so that a copy of what was itself replaced shows the same field as that one.
    for k in np.sort(rng.choice(np.arange(4, n - 2), size=int(rng.integers(1, 4)), replace=False)):
        scene.order[k] = scene.order[k - back]
        scene.owed[k] = Flag.REPEATED


KINDS: dict[str, tuple[Callable[[Scene, _Rng], None], tuple[int, int] | None]] = {
    "plain": (plain, None),
    "steep": (steep, None),
    "partly out": (partly_out, None),
    "low contrast": (low_contrast, None),
    "second glint": (second_glint, (64, 752)),
    "gradient": (gradient, None),
    "body edge": (body_edge, _LARGE),
    "hot pixels": (hot_pixels, None),
    "dead columns": (dead_columns, None),
    "stripe": (stripe, None),
    "flare": (flare, None),
    "dark line": (dark, None),
    "20 lines": (narrow_window, (20, 752)),
    "search window": (search_window, _LARGE),
    "clipped": (clipped, None),
    "uneven": (uneven, None),
    "vibration": (vibration, _LARGE),
    "ramp": (ramp, _LARGE),
    "leaving": (leaving, None),
    "fog": (fog, None),
    "lamp": (lamp, None),
    "bump": (bump, _LARGE),
    "parity order": (parity_order, None),
    "parity slip": (parity_slip, None),
    "dropped": (dropped_times, None),
    "repeated": (repeated, None),
}
"""What is wrong: its function, and the window [line, column] where it needs one."""

_MILD = (gradient, hot_pixels, dead_columns, uneven)


def draw(seed: int, number: int) -> tuple[Scene, _Rng]:
    """Draw recording `number` of a set; its kind goes round with the number."""
    rng = np.random.default_rng([seed, number])
    kind = list(KINDS)[number % len(KINDS)]
    spoil, window = KINDS[kind]
    scene = draw_scene(rng, kind, window=window)
    spoil(scene, rng)
    if kind != "plain" and rng.random() < _MIXED_IN:
        _MILD[rng.integers(len(_MILD))](scene, rng)
    return scene, rng
