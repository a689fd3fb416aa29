"""Monte Carlo of the pitch sweep: do its prediction intervals hold the true angle.

The mirror line of the paper's model is projected through a distorted lens, by a camera that is
turned by 2 deg about each axis and 5 mm off in distance, and measured as if it were neither: the
raw angle of each pitch. Every draw is a sweep of its own from -6 to 6 deg in steps of 0.5 deg
with noise in both angles, and is asked for the angles half-way between. What changes with the
tunnel's temperature is the optical angle, in offset and scale. Run with
``python -m benchmarks.sweep_coverage [--draws N] [--seed N] [--rendered]``.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks._draws import BAND
from calibration.sweep.fit import PitchSweep, SweepPoint, fit_sweep_points
from glint_aoa.geometry import PixelToPlane
from glint_aoa.process import measure_point
from glint_aoa.records.fields import FieldStack
from glint_aoa.setup import Glint, Setup
from render_sim.film import film
from render_sim.mirror import mirror_points
from render_sim.motion import StaticMotion
from render_sim.projection import Pinhole
from render_sim.renderer import make_renderer
from render_sim.scene import Scene, paper_scene

Floats = NDArray[np.float64]

SWEEP_DEG = np.arange(-6.0, 6.01, 0.5)
BETWEEN_DEG = (SWEEP_DEG[1:] + SWEEP_DEG[:-1]) / 2
DISTORTION = (-0.15, 0.08, 0.002, -0.0015, 0.01)
TURNED_RAD = float(np.radians(2.0))
TOO_FAR_M = 0.005
ONBOARD_STD_DEG, OPTICAL_STD_DEG = 0.002, 0.0003
SPAN_K, COLD_K = 20.0, 284.0
OFFSET_DEG, SCALE = 0.06, 0.005
"""What the temperature adds to the optical angle over `SPAN_K`."""

BENT = 0.1 / 1.1  # quadratic part over the change: 10 % of the linear one
_WINDOW = (140, 92)  # first line and lines: a camera that is turned sees the glint lower
_FILM = 7


def true_scene() -> Scene:
    """Return the scene as it is: distorted, turned and too far."""
    scene = paper_scene()
    x, y, z = scene.camera.position or (0.0, 0.0, 0.0)
    camera = scene.camera.model_copy(
        update={
            "rotation": (TURNED_RAD,) * 3,
            "distortion": DISTORTION,
            "position": (x, y - TOO_FAR_M, z),
        }
    )
    return replace(scene, camera=camera)


def optical_angles(
    pitch_deg: Floats, scene: Scene | None = None, *, columns: int = 39
) -> tuple[Floats, Floats]:
    """Return the angle [deg] and intercept [mm] that the nominal setup makes of the mirror line.

    Parameters
    ----------
    pitch_deg : ndarray [pitch]
        Pitch of the model [deg].
    scene : Scene, optional
        The scene as it is; by default `true_scene`.
    columns : int
        Columns that the line is fitted to.
    """
    scene, nominal = scene or true_scene(), paper_scene()
    poses = [StaticMotion(scene, np.radians(each)).pose(np.zeros(1))[0] for each in pitch_deg]
    u = np.linspace(5.0, 746.0, columns)
    seen = Pinhole.of(scene).project(mirror_points(scene, np.array(poses), u))
    to_plane = PixelToPlane.of_camera(nominal.camera, y=nominal.glint_y_m, yaw=0.0)
    along, height = to_plane(*seen)
    lines = np.array([np.polyfit(s, z, 1) for s, z in zip(along, height, strict=True)])
    sign = 1.0 if nominal.nose == "right" else -1.0
    return sign * np.degrees(np.arctan(lines[:, 0])), 1e3 * lines[:, 1]


def rendered_angles(pitch_deg: Floats, *, n_fields: int = 24) -> tuple[Floats, Floats]:
    """Return the same of ray-traced fields with noise, measured by the program."""
    scene, nominal = true_scene().with_window(*_WINDOW), paper_scene()
    setup = Setup(camera=nominal.camera, glint=Glint(y=f"{nominal.glint_y_m} m"))
    renderer = make_renderer(scene, "raytrace")
    found = []
    for number, pitch in enumerate(pitch_deg):
        motion = StaticMotion(scene, np.radians(pitch))
        rng = np.random.default_rng([_FILM, number])
        filmed = film(scene, motion, n_fields, renderer=renderer, rng=rng)
        log = measure_point(FieldStack.from_array(filmed.fields, filmed.info), setup).log
        found.append((log["mean_angle_deg"], log["mean_intercept_mm"]))
    angle, intercept = np.array(found).T
    return angle, intercept


@dataclass(frozen=True)
class Case:
    """What is drawn.

    Attributes
    ----------
    name : str
        What the row is called.
    temperatures_k : tuple of float
        Tunnel temperatures of the sweeps; none for one sweep at an unknown temperature.
    bent : callable
        Draws the quadratic part of the temperature's law over the whole change.
    optical_std_deg : float
        Real noise of the optical angle, 1 sigma [deg]; stated is `OPTICAL_STD_DEG`.
    """

    name: str
    temperatures_k: tuple[float, ...] = ()
    bent: Callable[[np.random.Generator], float] = lambda rng: BENT  # noqa: ARG005
    optical_std_deg: float = OPTICAL_STD_DEG


CASES = (
    Case("one temperature"),
    Case("one, points repeat to 0.005 deg only", optical_std_deg=0.005),
    Case("between two temperatures, 10 % bent", (COLD_K, COLD_K + SPAN_K)),
    Case(
        "between two, bent by 20 % (1 sigma)",
        (COLD_K, COLD_K + SPAN_K),
        lambda rng: float(rng.normal(0.0, 0.2)),
    ),
    Case("between three temperatures, 10 % bent", (COLD_K, COLD_K + SPAN_K / 2, COLD_K + SPAN_K)),
)


def coverage(
    draws: int,
    seed: int,
    *,
    cases: Sequence[Case] = CASES,
    angles: Callable[[Floats], tuple[Floats, Floats]] = optical_angles,
) -> list[dict[str, Any]]:
    """Fit that many sweeps of each case and hold their angles against the truth.

    Parameters
    ----------
    draws, seed : int
        Draws of each case; each has a stream of its own.
    cases : sequence of Case
        What is drawn.
    angles : callable
        Gives the optical angle and the intercept at pitches: `optical_angles`, or
        `rendered_angles`, whose noise comes on top.

    Returns
    -------
    list of dict
        By case: ``name``; ``share``, of the angles of all draws, inside the 95 % interval;
        ``rms_deg``, of the error over all of them; ``worst_rms_deg``, of the worst draw;
        ``seconds``.
    """
    raw = {key: angles(pitch)[0] for key, pitch in _PITCHES.items()}
    return [_row(case, draws, seed, raw) for case in cases]


_PITCHES = {"sweep": SWEEP_DEG, "between": BETWEEN_DEG}


def _row(case: Case, draws: int, seed: int, raw: dict[str, Floats]) -> dict[str, Any]:
    started = time.perf_counter()
    errors, inside = [], []
    for number in range(draws):
        rng = np.random.default_rng([seed, number])
        bent = case.bent(rng)
        fitted = drawn_sweep(case, raw["sweep"], bent, rng)
        warm = float(rng.uniform(COLD_K, COLD_K + SPAN_K)) if case.temperatures_k else None
        seen = warmed(raw["between"], BETWEEN_DEG, warm, bent)
        seen = seen + case.optical_std_deg * rng.standard_normal(seen.size)
        low, high = fitted.interval(seen, OPTICAL_STD_DEG, temperature_k=warm)
        errors.append(fitted.predict(seen, temperature_k=warm) - BETWEEN_DEG)
        inside.append((low <= BETWEEN_DEG) & (high >= BETWEEN_DEG))
    rms = np.sqrt(np.mean(np.square(errors), axis=1))
    return {
        "name": case.name,
        "share": float(np.mean(inside)),
        "rms_deg": float(np.sqrt(np.mean(rms**2))),
        "worst_rms_deg": float(rms.max()),
        "seconds": time.perf_counter() - started,
    }


def drawn_sweep(case: Case, raw: Floats, bent: float, rng: np.random.Generator) -> PitchSweep:
    """Fit one draw of the sweeps of a case, whose law of temperature is bent that much."""
    points = []
    for warm in case.temperatures_k or (None,):
        seen = warmed(raw, SWEEP_DEG, warm, bent)
        seen = seen + case.optical_std_deg * rng.standard_normal(raw.size)
        onboard = SWEEP_DEG + ONBOARD_STD_DEG * rng.standard_normal(raw.size)
        points += [
            SweepPoint(
                name=f"{warm} K {number}",
                optical_deg=x,
                optical_std_deg=OPTICAL_STD_DEG,
                onboard_deg=y,
                onboard_std_deg=ONBOARD_STD_DEG,
                temperature_k=warm,
            )
            for number, (x, y) in enumerate(zip(seen.tolist(), onboard.tolist(), strict=True))
        ]
    return fit_sweep_points(points)


def warmed(raw: Floats, pitch_deg: Floats, temperature_k: float | None, bent: float) -> Floats:
    """Return the optical angle [deg] with what the temperature adds to it."""
    if temperature_k is None:
        return raw
    share = (temperature_k - COLD_K) / SPAN_K
    return raw + (share - bent * share * (1 - share)) * (OFFSET_DEG + SCALE * pitch_deg)


def _print(rows: list[dict[str, Any]]) -> None:
    print(f"{'':<44}{'in 95 %':>9}{'rms [deg]':>12}{'worst draw':>12}{'s':>7}")
    for row in rows:
        print(
            f"{row['name']:<44}{100 * row['share']:>8.1f}%{row['rms_deg']:>12.5f}"
            f"{row['worst_rms_deg']:>12.5f}{row['seconds']:>7.0f}"
        )


def main() -> int:
    """Print one line a case; 1 if an interval covers too little."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rendered", action="store_true", help="ray-trace and measure the points")
    options = parser.parse_args()
    angles = rendered_angles if options.rendered else optical_angles
    rows = coverage(options.draws, options.seed, angles=angles)
    _print(rows)
    return int(any(row["share"] < BAND[0] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
