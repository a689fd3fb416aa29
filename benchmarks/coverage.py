"""How often the truth lies within the stated uncertainty of one field."""

import numpy as np

from benchmarks.scene import ESTIMATORS, Scene, prepared, table_row
from glint_aoa.optical.measure import measure_fields

_STACKS, _FIELDS = 25, 200
_SCENES = {
    "good contrast (peak 170, read noise 0.7)": Scene(peak=170.0, row=31.3, lines=64),
    "poor contrast (peak 20, read noise 3)": Scene(peak=20.0, read_noise=3.0, row=31.3, lines=64),
}
_LIMITS = ((1.0, 68.27, 2.0), (1.96, 95.0, 1.5))  # standard deviations, share and tolerance [%]
_WIDTHS = [42, 12, 12, 12, 10]


def run() -> None:
    """Print the table."""
    print(f"\nCoverage: share of {_STACKS * _FIELDS} fields that hold the truth, from {_STACKS}")
    print("stacks; limits 68.3 +- 2 % and 95 +- 1.5 %")
    print(table_row(["", "estimator", "1 sigma", "95 %", "holds"], _WIDTHS))
    for name, scene in _SCENES.items():
        for estimator in ESTIMATORS:
            shares = _shares(scene, estimator)
            holds = all(
                abs(share - wanted) <= tolerance
                for share, (_, wanted, tolerance) in zip(shares, _LIMITS, strict=True)
            )
            cells = [f"{share:.1f} %" for share in shares]
            print(
                table_row([name, estimator, *cells, "yes" if holds else "no"], _WIDTHS), flush=True
            )


def _shares(scene: Scene, estimator: str) -> list[float]:
    distances = []
    for seed in range(_STACKS):
        fields = scene.fields(np.random.default_rng(100 + seed), _FIELDS)
        angles = measure_fields(fields, np.arange(_FIELDS), prepared(fields, estimator, 20))
        distances.append(
            (np.degrees(angles.angle) - scene.angle_deg) / np.degrees(angles.angle_std)
        )
    distance = np.abs(np.concatenate(distances))
    return [100 * float((distance <= limit).mean()) for limit, _, _ in _LIMITS]
