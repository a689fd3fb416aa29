"""Noise of the angle over the Cramer-Rao bound, estimator by estimator."""

import itertools

import numpy as np
from numpy.typing import NDArray

from benchmarks.rivals import RIVALS
from benchmarks.scene import ESTIMATORS, Scene, prepared, table_row
from benchmarks.speed import measured_deg, rival_deg

_LIGHT = ((0.5, 20.0), (0.5, 240.0), (3.0, 20.0), (3.0, 240.0))
"""Read noise and peak [grey levels]: the corners of what the limit is asked for."""

_SIGMA = (0.7, 1.4, 4.0)
_SLOPE = (0.0, 0.0005, 0.01)
_FIELDS = 200
_FIELDS_ALL = 100  # where all columns are used
_WIDTHS = [28, *(24 for _ in ESTIMATORS)]


def run() -> None:
    """Print the tables."""
    print("\nPrecision: std of the angle over the bound, at slopes of 0 / 0.0005 / 0.01 lines a")
    print(f"column; {_FIELDS} fields, so each is known to 5 %. Steger's filter takes in more than")
    print("the 38 columns of the bound.")
    print(table_row(["noise  peak  sigma  columns", *ESTIMATORS], _WIDTHS))
    worst = dict.fromkeys(ESTIMATORS, 0.0)
    for (read_noise, peak), sigma in itertools.product(_LIGHT, _SIGMA):
        _row(read_noise, peak, sigma, 20, _FIELDS, worst)
    for sigma in _SIGMA:
        _row(0.7, 160.0, sigma, 1, _FIELDS_ALL, worst)
    print(table_row(["worst", *(f"{worst[name]:.3f}" for name in ESTIMATORS)], _WIDTHS))
    _rivals()


def _row(
    read_noise: float, peak: float, sigma: float, step: int, n: int, worst: dict[str, float]
) -> None:
    ratios = np.array(
        [_ratios(_scene(read_noise, peak, sigma, slope), step, n) for slope in _SLOPE]
    )
    label = f"{read_noise:5.1f} {peak:5.0f} {sigma:6.1f} {'38' if step > 1 else '752':>8}"
    cells = [" / ".join(f"{r:.2f}" for r in column) for column in ratios.T]
    print(table_row([label, *cells], _WIDTHS), flush=True)
    for name, column in zip(ESTIMATORS, ratios.T, strict=True):
        worst[name] = max(worst[name], float(np.nan_to_num(column, nan=np.inf).max()))


def _scene(read_noise: float, peak: float, sigma: float, slope: float) -> Scene:
    return Scene(sigma, peak, read_noise, slope, row=31.27, lines=64)


def _ratios(scene: Scene, step: int, n: int) -> NDArray[np.float64]:
    """Ratio to the bound of every estimator; NaN where less than nine in ten are measured."""
    fields = scene.fields(np.random.default_rng(1), n)
    ratios = []
    for estimator in ESTIMATORS:
        how = prepared(fields, estimator, step)
        angles = measured_deg(fields, how)
        there = np.isfinite(angles)
        spread = angles[there].std(ddof=1) if there.mean() > 0.9 else np.nan
        ratios.append(spread / scene.bound_deg(how.columns))
    return np.array(ratios)


def _rivals() -> None:
    scene = Scene()
    fields = scene.fields(np.random.default_rng(2), 200)
    columns = prepared(fields, "centroid", 20).columns
    print("\nThe other ways, on the line of the speed table, over the bound of 38 columns; fitLine")
    print("uses all columns, ridge-detection and pyidi those around the 38 too")
    print(table_row(["", "fields", "std / bound", "bias [deg]"], [34, 8, 14, 14]))
    for name, (measure, n) in RIVALS.items():
        angles, count = rival_deg(measure(fields[:n], columns), columns)
        ratio, bias = angles.std(ddof=1) / scene.bound_deg(columns), angles.mean() - scene.angle_deg
        print(table_row([name, f"{count:.0f}", f"{ratio:.2f}", f"{bias:.5f}"], [34, 8, 14, 14]))
