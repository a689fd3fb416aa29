"""Monte Carlo of the inertial corrections: do their uncertainties cover their real errors.

Each draw is a record of its own: modes, levels, kind of excitation, pitch angle, noise, and the
gain and direction of every accelerometer, as uncertain as the correction is told they are. One
row from the middle of the corrected record is held against the model's known pitch. Run with
``python -m benchmarks.inertial_coverage [METHOD ...] [--draws N] [--seed N]``.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks._draws import BAND, WITHIN, chosen
from benchmarks.rigid_tones import GRAVITY, Imperfections, ModeMotion, record, time_of, tones
from glint_aoa.errors import InputError
from glint_aoa.inertial import TABLE_1, Mode, correct
from glint_aoa.setup import Inertial

Floats = NDArray[np.float64]

EXCITATIONS = ("sine", "modulated", "random")


@dataclass(frozen=True)
class Study:
    """What is drawn for a method.

    Attributes
    ----------
    method : str
        Name, as `correct` takes it.
    imperfections : Imperfections
        Standard deviations of what is wrong with each accelerometer.
    radius_std : float
        Relative error of the effective radii in the setup.
    relative_std : float
        What the correction is told.
    places : tuple of str
        Where the accelerometers sit.
    duration_s : float
        Length of each record [s].
    excitations : tuple of str
        Kinds that are drawn from.
    first_modes_only : bool
        Whether only the lowest mode of each plane moves.
    """

    method: str
    imperfections: Imperfections = field(default_factory=Imperfections)
    radius_std: float = 0.0
    relative_std: float = 0.01
    places: tuple[str, ...] = ("face", "mid", "aft")
    duration_s: float = 12.0
    excitations: tuple[str, ...] = EXCITATIONS
    first_modes_only: bool = False


# a mode's bias goes with the gain squared over the radius: 1 % together
_MODAL = Study(
    "modal",
    Imperfections(gain_std=0.004, misalignment_std=0.0),
    radius_std=0.006,
    places=("face",),
    duration_s=20.0,
)

STUDIES = {
    "kinematic": Study("kinematic"),
    "modal": _MODAL,
    "regression": replace(
        _MODAL, method="regression", duration_s=40.0, excitations=("modulated", "random")
    ),
    "nlr": replace(_MODAL, method="nlr", first_modes_only=True),
    "harmonic": replace(_MODAL, method="harmonic"),
    "spectral": replace(_MODAL, method="spectral", excitations=("sine",)),
}


@dataclass(frozen=True, eq=False)
class Draws:
    """Results of the draws of one study: errors and standard uncertainties [draw, deg]."""

    method: str
    error_deg: Floats
    std_deg: Floats
    raw_error_deg: Floats
    seconds: float

    @property
    def known(self) -> NDArray[np.bool_]:
        """Draws for which the method vouches."""
        return np.isfinite(self.std_deg)

    @property
    def coverage(self) -> float:
        """Share of the 95 % intervals that hold the truth, of those that were given."""
        inside = np.abs(self.error_deg) <= WITHIN * self.std_deg
        return float(np.mean(inside[self.known])) if self.known.any() else np.nan


def run(study: Study, draws: int, *, seed: int = 1) -> Draws:
    """Correct that many independent records and hold one row of each against the truth."""
    started = time.perf_counter()
    rows = [_one(study, np.random.default_rng([seed, number])) for number in range(draws)]
    error, std, raw = np.array(rows).T
    return Draws(study.method, error, std, raw, time.perf_counter() - started)


def _one(study: Study, rng: np.random.Generator) -> tuple[float, float, float]:
    pitch_deg = float(rng.uniform(-5.0, 10.0))
    modes = _modes(study, rng)
    made = record(
        modes, pitch_deg=pitch_deg, rng=rng, imperfections=study.imperfections, places=study.places
    )
    surveyed = [
        Mode(
            m.number, m.plane, m.frequency_hz, m.radius_m * (1 + rng.normal(0.0, study.radius_std))
        )
        for m in TABLE_1
    ]
    try:
        rows = correct(
            made,
            _setup(surveyed),
            method=study.method,
            relative_std=study.relative_std,
            misalignment_std=study.imperfections.misalignment_std,
        )
    except InputError:
        return np.nan, np.nan, np.nan
    middle = rows.time_s.size // 2
    return (
        float(rows.angle_deg[middle] - pitch_deg),
        float(rows.angle_std_deg[middle]),
        float(rows.raw_angle_deg[middle] - pitch_deg),
    )


def _modes(study: Study, rng: np.random.Generator) -> list[ModeMotion]:
    """Draw the first mode of one plane or both, and others with what a test would give them."""
    time_s = time_of(study.duration_s)
    kind = rng.choice(study.excitations)
    planes = [("yaw",), ("pitch",), ("yaw", "pitch")][rng.integers(3)]
    found = []
    for mode in TABLE_1:
        first = mode.number in {1, 2}
        still = study.first_modes_only or rng.random() < 0.5
        if mode.plane not in planes or (not first and still):
            continue
        if first:  # rate of turning that gives a bias of 0.03 to 0.3 deg
            bias = np.radians(10 ** rng.uniform(-1.5, -0.5))
            rate = np.sqrt(GRAVITY * bias / mode.radius_m)
        else:
            rate = 10 ** rng.uniform(-2.0, -0.8)
        motion = _excite(kind, time_s, mode.frequency_hz, rate, rng)
        found.append(ModeMotion(mode.number, mode.plane, mode.frequency_hz, mode.radius_m, *motion))
    return found


def _excite(
    kind: str, time_s: Floats, natural_hz: float, rate_rms: float, rng: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """Move a mode with an rms rate [rad/s] about its resonance."""
    centre = natural_hz * (1 + rng.uniform(-0.01, 0.01))
    if kind == "sine":
        offsets, weights = np.zeros(1), np.ones(1)
    elif kind == "modulated":
        offsets, weights = np.array([-0.25, 0.0, 0.25]), np.array([0.5, 1.0, 0.5])
    else:
        offsets = rng.uniform(-6.0, 6.0, 40)
        weights = 1 / np.hypot(offsets, 0.01 * natural_hz)  # a resonance with 1 % damping
    frequencies = centre + offsets
    amplitudes = weights / np.sqrt(np.sum(weights**2) / 2) * rate_rms / (2 * np.pi * frequencies)
    phases = rng.uniform(0.0, 2 * np.pi, offsets.size)
    if kind == "modulated":
        phases = phases[0] + np.array([-1.0, 0.0, 1.0]) * phases[1]
    return tones(time_s, frequencies, amplitudes, phases)


def _setup(modes: Sequence[Mode]) -> Inertial:
    return Inertial.model_validate(
        {
            "mode": [
                {
                    "number": mode.number,
                    "plane": mode.plane,
                    "frequency": f"{mode.frequency_hz} Hz",
                    "radius": f"{mode.radius_m} m",
                }
                for mode in modes
            ]
        }
    )


def _line(result: Draws) -> str:
    known = result.known
    error, std = result.error_deg[known], result.std_deg[known]
    verdict = "covers" if result.coverage >= BAND[0] else "DOES NOT COVER"
    if result.coverage > BAND[1]:
        verdict = "covers, wider than need be"
    return (
        f"{result.method:<12}{known.size:>6}{100 * known.mean():>9.1f}"
        f"{100 * result.coverage:>10.1f}"
        f"{np.sqrt(np.mean(result.raw_error_deg[known] ** 2)):>10.4f}"
        f"{np.sqrt(np.mean(error**2)):>10.5f}{np.median(std):>10.5f}"
        f"{np.sqrt(np.mean((error / std) ** 2)):>9.2f}{result.seconds:>7.0f}  {verdict}"
    )


def main() -> int:
    """Print one line a method; 1 if an interval covers too little."""
    options = chosen(__doc__, STUDIES)
    print(
        f"{'method':<12}{'draws':>6}{'known %':>9}{'in 95 %':>10}{'raw rms':>10}{'rms':>10}"
        f"{'std':>10}{'err/std':>9}{'s':>7}"
    )
    verdicts = []
    for method in options.studies:
        result = run(STUDIES[method], options.draws, seed=options.seed)
        verdicts.append(result.coverage >= BAND[0] or not result.known.any())
        print(_line(result), flush=True)
    return 0 if all(verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
