"""Monte Carlo of the wing twist: do its stated 95 % intervals hold the true rotation.

A wing section with targets in a plane of known Y is turned about an axis off its middle and bent;
a camera that is turned by some degrees, with a distorted lens, sees it before and after. Centres
are drawn with the noise that their covariance states, or more. Run with
``python -m benchmarks.twist_coverage [CASE ...] [--draws N] [--seed N]``.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks._draws import BAND, chosen
from calibration.twist.measure import measure_twist
from calibration.twist.sighting import Sightings
from calibration.twist.wing_targets import WingTargets
from glint_aoa.setup import Camera, Glint, Setup
from render_sim.projection import Pinhole
from render_sim.scene import Scene, paper_scene
from render_sim.wing import WingSection

Floats = NDArray[np.float64]

STATED_STD = (0.008, 0.004)
"""Stated noise of a centre, 1 sigma: columns, field lines."""

CHORD_M, Y_M = 0.24, 0.15
_STILL_FIELDS = 7
_RATE = 9.8 / 60.0  # cycles of the vibration in a field


@dataclass(frozen=True)
class Case:
    """What is drawn.

    Attributes
    ----------
    name : str
        What the row is called.
    targets : int
        Targets at the station.
    fields : int
        Fields with flow, and without it up to 7: of more the twist would look for a vibration
        there too, which costs as much again and shows nothing new.
    noise : float
        Real noise of the centres over the stated one.
    shake_deg : float
        Amplitude of a vibration with flow [deg].
    slipped_m : float
        How far the first target has slipped with flow [m].
    free_scale : bool
        Whether the scale is fitted.
    """

    name: str
    targets: int = 6
    fields: int = 1
    noise: float = 1.0
    shake_deg: float = 0.0
    slipped_m: float = 0.0
    free_scale: bool = False


CASES = (
    Case("two targets", targets=2),
    Case("three targets", targets=3),
    Case("six targets"),
    Case("six targets, free scale", free_scale=True),
    Case("six targets, noise three times the stated", noise=3.0),
    Case("six targets, one slipped by 1 mm", slipped_m=0.001),
    Case("six targets, 24 fields, vibrating by 0.3 deg", fields=24, shake_deg=0.3),
)


@cache
def wing_scene() -> Scene:
    """Return the paper's camera with a distorted lens, turned by some degrees."""
    scene = paper_scene()
    camera = scene.camera.model_copy(
        update={
            "rotation": tuple(np.radians([2.0, -1.0, 1.5]).tolist()),
            "distortion": (-0.1, 0.02, 1e-3, -5e-4, 0.0),
        }
    )
    return replace(scene, camera=camera)


def section(targets: int) -> WingSection:
    """Return a station with targets along its chord, the first ones higher."""
    x = np.linspace(-CHORD_M / 2, CHORD_M / 2, targets)
    z = 0.08 + 0.01 * np.cos(3 * np.arange(targets))
    return WingSection(np.stack([x, np.full(targets, Y_M), z], axis=1), radius_m=0.0055)


def coverage(draws: int, seed: int, *, cases: Sequence[Case] = CASES) -> list[dict[str, Any]]:
    """Measure that many wings of each case and hold their twist against the truth.

    Parameters
    ----------
    draws : int
        Wings of each case, each with a rotation of its own up to 6 deg.
    seed : int
        Of the noise.
    cases : sequence of Case
        What to draw.

    Returns
    -------
    list of dict
        One row a case: part of the intervals that hold the truth, rms error and rms stated
        standard deviation [deg].
    """
    rows = []
    for case in cases:
        found = [_draw(case, np.random.default_rng([seed, number])) for number in range(draws)]
        error, std, u95 = np.array(found).T
        rows.append(
            {
                "case": case.name,
                "draws": draws,
                "coverage": float(np.mean(np.abs(error) <= u95)),
                "rms_error_deg": float(np.sqrt(np.mean(error**2))),
                "rms_stated_deg": float(np.sqrt(np.mean(std**2))),
            }
        )
    return rows


def _draw(case: Case, rng: np.random.Generator) -> tuple[float, float, float]:
    """Error, stated standard deviation and half the interval of one wing [deg]."""
    scene = wing_scene()
    twist = rng.uniform(-6.0, 6.0)
    axis = tuple(rng.uniform(-0.1, 0.1, 2))
    shift = (rng.uniform(-0.002, 0.002), 0.0, rng.uniform(-0.01, 0.01))
    wing, phase = section(case.targets), rng.uniform(0, 2 * np.pi)
    slip = np.zeros((case.targets, 3))
    slip[0, 2] = case.slipped_m
    turns = twist + case.shake_deg * np.sin(2 * np.pi * _RATE * np.arange(case.fields) + phase)
    after = [
        wing.twisted(np.radians(turn), axis_m=axis, nose="left", shift_m=shift).centres_m + slip
        for turn in turns
    ]
    targets = WingTargets(
        ids=tuple(f"t{k}" for k in range(case.targets)),
        station=("s",) * case.targets,
        y=np.full(case.targets, Y_M),
        start=_seen(scene, wing.centres_m[None])[0],
        radius=np.zeros(case.targets),
        normal=np.tile([0.0, 1.0, 0.0], (case.targets, 1)),
    )
    still = np.broadcast_to(
        wing.centres_m, (min(case.fields, _STILL_FIELDS), *wing.centres_m.shape)
    )
    states = (
        _sighted(scene, targets, points, case.noise, rng) for points in (still, np.array(after))
    )
    setup = Setup(camera=Camera.model_construct(**scene.camera.__dict__), glint=Glint(nose="left"))
    (one,) = measure_twist(targets, *states, setup, free_scale=case.free_scale).stations
    return one.twist_deg - twist, one.twist_std_deg, one.twist_u95_deg


def _seen(scene: Scene, points: Floats) -> Floats:
    """Sensor columns and lines [..., 2] of points [..., 3] in the tunnel."""
    return np.stack(Pinhole.of(scene).project(points), axis=-1)


def _sighted(
    scene: Scene, targets: WingTargets, points: Floats, noise: float, rng: np.random.Generator
) -> Sightings:
    uv = _seen(scene, points)
    uv = uv + noise * np.array(STATED_STD) * rng.standard_normal(uv.shape)
    return Sightings(
        name="drawn",
        ids=targets.ids,
        uv=uv,
        covariance=np.broadcast_to(np.diag(np.square(STATED_STD)), (*uv.shape, 2)),
        semi_axes=np.ones((len(targets), 2)),
        clipped=np.zeros(len(targets), bool),
    )


def main() -> int:
    """Print the table; 1 if a coverage lies outside 93 to 97 %."""
    given = chosen(__doc__, [case.name for case in CASES])
    print(f"{'wing twist':46s} draws  95 % holds  rms error  stated [deg]")
    holds = True
    for case in CASES:
        if case.name not in given.studies:
            continue
        started = time.process_time()
        (row,) = coverage(given.draws, given.seed, cases=[case])
        holds &= BAND[0] <= row["coverage"] <= BAND[1]
        print(
            f"{row['case']:46s} {row['draws']:5d} {100 * row['coverage']:9.1f} % "
            f"{row['rms_error_deg']:10.5f} {row['rms_stated_deg']:9.5f}"
            f"  ({time.process_time() - started:.0f} s of one core)",
            flush=True,
        )
    return int(not holds)


if __name__ == "__main__":
    sys.exit(main())
