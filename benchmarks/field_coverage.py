"""How often the truth lies within the stated uncertainty of one field.

Run with ``python -m benchmarks.field_coverage [--stacks N] [--seed N]``.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.scene import ESTIMATORS, Scene, prepared, table_row
from glint_aoa.optical.measure import measure_fields

STACKS, FIELDS = 25, 200
SCENES = {
    "good contrast (peak 170, read noise 0.7)": Scene(peak=170.0, row=31.3, lines=64),
    "poor contrast (peak 20, read noise 3)": Scene(peak=20.0, read_noise=3.0, row=31.3, lines=64),
}
LIMITS = ((1.0, 68.27, 2.0), (1.96, 95.0, 1.5))  # standard deviations, share and tolerance [%]
_FEW = 5  # stacks, for a first look
_WIDTHS = [42, 12, 12, 12, 10]


@dataclass(frozen=True)
class Row:
    """What became of one scene and estimator.

    Attributes
    ----------
    scene, estimator : str
        Their names.
    n_fields : int
        How many were measured.
    shares : tuple of float
        Share of them whose 1-sigma and 95 % intervals hold the truth [%].
    """

    scene: str
    estimator: str
    n_fields: int
    shares: tuple[float, ...]

    @property
    def holds(self) -> bool:
        """Whether both shares keep to the limits."""
        return all(
            abs(share - wanted) <= off
            for share, (_, wanted, off) in zip(self.shares, LIMITS, strict=True)
        )


def coverage(stacks: int, seed: int, *, estimators: tuple[str, ...] = ESTIMATORS) -> Iterator[Row]:
    """Measure stacks of 200 fields and count how many intervals hold the truth.

    Parameters
    ----------
    stacks : int
        Stacks of each scene.
    seed : int
        Seed of all stacks.
    estimators : tuple of str, optional
        Those to measure with.

    Yields
    ------
    Row
        One row a scene and estimator.
    """
    for name, scene in SCENES.items():
        distances: dict[str, list[float]] = {each: [] for each in estimators}
        for number in range(stacks):
            fields = scene.fields(np.random.default_rng([seed, number]), FIELDS)
            for each in estimators:
                angles = measure_fields(fields, np.arange(FIELDS), prepared(fields, each, 20))
                error = np.degrees(angles.angle) - scene.angle_deg
                distances[each] += (np.abs(error) / np.degrees(angles.angle_std)).tolist()
        for each, distance in distances.items():
            shares = [100 * float(np.mean(np.array(distance) <= limit)) for limit, _, _ in LIMITS]
            yield Row(name, each, len(distance), tuple(shares))


def run(stacks: int = _FEW, seed: int = 1) -> bool:
    """Print the table; return whether all limits are kept."""
    n_fields = stacks * FIELDS
    chance = np.sqrt(68.27 * 31.73 / n_fields)
    print(f"\nCoverage: share of {n_fields} fields that hold the truth, from {stacks} stacks;")
    print(f"limits 68.3 +- 2 % and 95 +- 1.5 %, chance {chance:.1f} % (1 sigma)")
    print(table_row(["", "estimator", "1 sigma", "95 %", "holds"], _WIDTHS))
    holds = []
    for row in coverage(stacks, seed):
        cells = [f"{share:.1f} %" for share in row.shares]
        verdict = "yes" if row.holds else "no"
        print(table_row([row.scene, row.estimator, *cells, verdict], _WIDTHS), flush=True)
        holds.append(row.holds)
    return all(holds)


def main() -> int:
    """Run the command; 1 where an interval does not hold what it should."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stacks", type=int, default=STACKS, help="of 200 fields, for each scene")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    return 0 if run(options.stacks, options.seed) else 1


if __name__ == "__main__":
    sys.exit(main())
