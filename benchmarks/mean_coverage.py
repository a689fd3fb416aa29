"""How often the truth lies within the stated uncertainty of a point's mean.

Fields of a vibrating angle without optics: 0.3 deg at any frequency from 5 to 25 Hz, steady or
modulated, the paper's model under random excitation from 5 to 60 Hz, or at rest; with the noise
that a field of the paper's camera has. Run with ``python -m benchmarks.mean_coverage [--draws N]
[--seed N]``.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import special

from benchmarks.scene import table_row
from glint_aoa.optical.average import mean_angle
from render_sim.excitation import modulated_sine, random_band
from render_sim.modes import modal_angles, paper_model_system

Floats = NDArray[np.float64]
Rng = np.random.Generator

RATE_HZ = 60.0
NOISE_DEG = 0.0008
AMPLITUDE_DEG, RANDOM_RMS_DEG = 0.3, 0.09
BAND_HZ = (5.0, 25.0)
DRAWS = 2000
CASES = (
    ("still", 8), ("still", 20), ("still", 60),
    ("sine", 20), ("sine", 60), ("sine", 250),
    ("modulated", 60),
    ("random", 60), ("random", 250),
)  # fmt: skip
"""Motion and number of fields."""

LIMITS = ((68.3, 4.0), (95.0, 2.5))  # share and tolerance [%] at 1 sigma and 95 %
_EXCITATIONS, _LONGEST_S = 12, 40.0
_WIDTHS = [12, 8, 12, 12, 12, 10, 10, 8]


@dataclass(frozen=True)
class Row:
    """What became of one case.

    Attributes
    ----------
    kind : str
        Motion.
    n_fields : int
        Fields of a record.
    rms_deg, largest_deg, stated_deg : float
        Of the errors of the mean, and the median of the stated standard deviations [deg].
    one_sigma, ninety_five : float
        Share of the records whose intervals hold the truth [%].
    """

    kind: str
    n_fields: int
    rms_deg: float
    largest_deg: float
    stated_deg: float
    one_sigma: float
    ninety_five: float

    @property
    def holds(self) -> bool:
        """Whether both shares lie within their limits."""
        shares = (self.one_sigma, self.ninety_five)
        return all(
            abs(share - wanted) <= off for share, (wanted, off) in zip(shares, LIMITS, strict=True)
        )


def still(time_s: Floats, _: Rng) -> Floats:
    """Return no motion."""
    return np.zeros_like(time_s)


def sine(time_s: Floats, rng: Rng) -> Floats:
    """Return a steady vibration [deg]."""
    turn = rng.uniform(*BAND_HZ) * time_s + rng.random()
    return AMPLITUDE_DEG * np.sin(2 * np.pi * turn)


def modulated(time_s: Floats, rng: Rng) -> Floats:
    """Return a vibration whose amplitude goes up and down in 4 s [deg]."""
    return modulated_sine(rng.uniform(*BAND_HZ), rng=rng).scaled(AMPLITUDE_DEG / 2).at(time_s)


def random(time_s: Floats, rng: Rng) -> Floats:
    """Return a stretch of the model's answer to random excitation [deg]."""
    answer = _random_answers()[rng.integers(_EXCITATIONS)]
    first = rng.integers(answer.size - time_s.size + 1)
    return answer[first : first + time_s.size]


@cache
def _random_answers() -> Floats:
    """Pitch of the paper's model under random forces [excitation, field], deg."""
    system, time_s = paper_model_system(), np.arange(_LONGEST_S * RATE_HZ) / RATE_HZ
    answers = []
    for number in range(_EXCITATIONS):
        force = random_band(rng=np.random.default_rng([9, number]))
        modes = modal_angles(system, force, "pitch")
        power = sum(np.abs(tones.amplitude) ** 2 / 2 for _, tones in modes).sum()
        answers.append(RANDOM_RMS_DEG / np.sqrt(power) * sum(t.at(time_s) for _, t in modes))
    return np.array(answers)


MOTIONS: dict[str, Callable[[Floats, Rng], Floats]] = {
    "still": still,
    "sine": sine,
    "modulated": modulated,
    "random": random,
}


def coverage(draws: int, seed: int, *, cases: Sequence[tuple[str, int]] = CASES) -> list[Row]:
    """Draw records and count how many intervals hold their means.

    Parameters
    ----------
    draws : int
        Records of each case.
    seed : int
        Seed of all cases.
    cases : sequence of (str, int), optional
        Motion, from `MOTIONS`, and number of fields.

    Returns
    -------
    list of Row
        One row a case.
    """
    return [
        _row(kind, n_fields, draws, [seed, list(MOTIONS).index(kind), n_fields])
        for kind, n_fields in cases
    ]


def _row(kind: str, n_fields: int, draws: int, seed: list[int]) -> Row:
    rng, time_s = np.random.default_rng(seed), np.arange(n_fields) / RATE_HZ
    # The means of the noise are drawn one from each of so many equal parts of their distribution:
    # chance then moves the shares less than it would with independent draws.
    share = (rng.permutation(draws) + rng.random(draws)) / draws
    mean_noise = NOISE_DEG / np.sqrt(n_fields) * special.ndtri(share)
    found = []
    for mean in mean_noise:
        noise = rng.normal(0.0, NOISE_DEG, n_fields)
        angle = MOTIONS[kind](time_s, rng) + noise - noise.mean() + mean
        got = mean_angle(angle, rate_hz=RATE_HZ, noise=NOISE_DEG)
        found.append((abs(got.mean), got.std, got.expanded()))
    error, std, u95 = np.array(found).T
    return Row(
        kind=kind,
        n_fields=n_fields,
        rms_deg=float(np.sqrt(np.mean(error**2))),
        largest_deg=float(error.max()),
        stated_deg=float(np.median(std)),
        one_sigma=100 * float(np.mean(error < std)),
        ninety_five=100 * float(np.mean(error < u95)),
    )


def run(draws: int = DRAWS, seed: int = 1) -> bool:
    """Print the table; return whether every interval holds."""
    print(f"\nMean of a vibrating angle: {draws} records a case, {NOISE_DEG} deg of noise a field;")
    print("limits 68.3 +- 4 % and 95 +- 2.5 %")
    heads = ["motion", "fields", "rms [deg]", "largest", "1 sigma", "covers", "95 %", "holds"]
    print(table_row(heads, _WIDTHS))
    rows = []
    for case in CASES:
        (row,) = coverage(draws, seed, cases=[case])
        rows.append(row)
        cells = [f"{v:.5f}" for v in (row.rms_deg, row.largest_deg, row.stated_deg)]
        cells += [f"{row.one_sigma:.1f} %", f"{row.ninety_five:.1f} %"]
        print(
            table_row([row.kind, str(row.n_fields), *cells, "yes" if row.holds else "no"], _WIDTHS),
            flush=True,
        )
    return all(row.holds for row in rows)


def main() -> int:
    """Run the command; 1 where an interval does not hold what it should."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mean_coverage", description=__doc__)
    parser.add_argument("--draws", type=int, default=DRAWS, help="records of each case")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    start = time.process_time()
    holds = run(options.draws, options.seed)
    print(f"{time.process_time() - start:.0f} s of processor time")
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
