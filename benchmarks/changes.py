"""A line that moves: how well each way follows its change of angle, ours and other people's."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.rivals import PYIDI_COLUMNS, PYIDI_REFERENCE, RIVALS
from benchmarks.scene import COLUMNS, PITCH, Scene, prepared, table_row
from benchmarks.speed import measured_deg, rival_deg

_REFERENCE = PYIDI_REFERENCE  # fields at rest ahead of the motion
_MOVING = 60
_CYCLES = 9.2  # in the fields that move, as the paper's pitch mode in a second
_PITCH_DEG, _HEAVE = 0.28, 1.5  # amplitudes; the heave in lines
_WIDTHS = [34, 9, 13, 12]

_Floats = NDArray[np.float64]


def run() -> None:
    """Print the table."""
    scene = Scene()
    fields, true_deg = _film(scene, np.random.default_rng(5))
    print(f"\nA line that swings by {_PITCH_DEG} deg and {_HEAVE} lines, {_CYCLES} times in")
    print(f"{_MOVING} fields: its change of angle since {_REFERENCE} fields at rest, whose noise")
    print("shifts the mean. Std over the bound of a field's angle from the columns used")
    print(table_row(["", "columns", "std / bound", "mean [deg]"], _WIDTHS))
    for name, (measure, used) in _ways(fields).items():
        error = _since(measure())[_REFERENCE:] - true_deg
        ratio = error.std(ddof=1) / scene.bound_deg(used)
        cells = [str(used.size), f"{ratio:.2f}", f"{error.mean():.5f}"]
        print(table_row([name, *cells], _WIDTHS), flush=True)


def _film(scene: Scene, rng: np.random.Generator) -> tuple[NDArray[np.uint8], _Floats]:
    """Return fields at rest and then moving, and the true change of angle of those that move."""
    phase = np.sin(2 * np.pi * _CYCLES * np.arange(_MOVING) / _MOVING)
    angles = np.radians(scene.angle_deg + _PITCH_DEG * phase)
    slopes = np.tan(angles) * PITCH[0] / PITCH[1]
    still = scene.fields(rng, _REFERENCE)
    moving = [
        Scene(slope=slope, row=scene.row + _HEAVE * heave).fields(rng, 1)
        for slope, heave in zip(slopes, phase, strict=True)
    ]
    return np.concatenate([still, *moving]), _PITCH_DEG * phase


_Way = tuple[Callable[[], _Floats], NDArray[np.int64]]


def _ways(fields: NDArray[np.uint8]) -> dict[str, _Way]:
    """Return each way to the angles of all fields [deg], ours first, and the columns it uses."""
    ours = {name: prepared(fields, name, 20) for name in ("profile", "centroid", "gaussian")}
    columns = ours["profile"].columns
    ways: dict[str, _Way] = {
        f"glint-aoa {name}": (partial(measured_deg, fields, how), columns)
        for name, how in ours.items()
    }
    for name, (rows_of, _) in RIVALS.items():
        if not name.startswith("ridge"):  # a minute for these fields; precision has it
            ways[name] = (partial(_angles, rows_of, fields, columns), _used(name, columns))
    return ways


def _used(name: str, columns: NDArray[np.int64]) -> NDArray[np.int64]:
    if "fitLine" in name:
        return np.arange(COLUMNS)
    if name.startswith("pyidi"):
        windows = columns[:, None] + np.arange(PYIDI_COLUMNS) - PYIDI_COLUMNS // 2
        return np.unique(windows[windows < COLUMNS])
    return columns


def _angles(
    rows_of: Callable[..., _Floats], fields: NDArray[np.uint8], columns: NDArray[np.int64]
) -> _Floats:
    return rival_deg(rows_of(fields, columns), columns)[0]


def _since(angles: _Floats) -> _Floats:
    return np.asarray(angles - angles[:_REFERENCE].mean())
