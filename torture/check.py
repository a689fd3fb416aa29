"""Measure the recordings of the set and hold the angles against their truth."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from glint_aoa.flags import REJECTING, Flag
from glint_aoa.optical.columns import used_columns
from glint_aoa.process import measure_point
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.setup import Setup
from torture.kinds import draw
from torture.render import Truth, render, truth_of
from torture.scene import RATE_HZ, Scene

__all__ = ["SEQUENCE", "WARNING", "Outcome", "add", "judge", "measure", "run"]

_STDS, _LEAST_DEG = 5.0, 0.002

WARNING = (
    REJECTING | Flag.LOW_CONTRAST | Flag.TRUNCATED | Flag.SATURATED | Flag.TIMING
    | Flag.PARITY_ORDER | Flag.REPEATED | Flag.DROPPED | Flag.FADING | Flag.MOVED
    | Flag.CAMERA_MOVED | Flag.SECOND_GLINT | Flag.CURVED_LINE | Flag.UNEVEN
)  # fmt: skip
"""Flags that warn of a field's angle."""

SEQUENCE = (
    Flag.PARITY_ORDER | Flag.REPEATED | Flag.DROPPED | Flag.FADING | Flag.MOVED | Flag.CAMERA_MOVED
)
"""Flags that no recording may carry where nothing of the kind happened."""


@dataclass(frozen=True)
class Outcome:
    """Counts of fields over one or more recordings.

    Attributes
    ----------
    stacks, fields : int
        How many there were.
    unflagged : int
        Fields with an angle and nothing that warns of it.
    wrong : int
        Of these, the ones off by more than 5 of their own standard deviations and 0.002 deg.
    worst_deg : float
        Largest error among the unflagged [deg]; infinite for an angle where no line is in view.
    measurable, measured : int
        Fields that could be measured, and those of them that were: with an angle that counts and
        is right.
    owed, paid : int
        Fields that must carry a flag, and those that do.
    alarms : int
        Fields with a flag of the sequence where nothing of the kind happened.
    """

    stacks: int
    fields: int
    unflagged: int
    wrong: int
    worst_deg: float
    measurable: int
    measured: int
    owed: int
    paid: int
    alarms: int


def run(seed: int, number: int) -> tuple[str, Outcome]:
    """Draw, render, measure and judge one recording."""
    scene, rng = draw(seed, number)
    record = measure(scene, render(scene, rng))
    columns = used_columns(scene.columns, scene.glint["column_step"])
    return scene.kind, judge(scene, truth_of(scene, columns), *record)


def measure(
    scene: Scene, stored: NDArray[np.uint8]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Measure the stored fields: angles, their standard deviations [deg] and flags."""
    info = FieldInfo(
        rate_hz=RATE_HZ,
        exposure_s=1e-3,
        first_line=30,
        first_column=0,
        interlaced=scene.interlaced,
        first_parity=("even", "odd")[scene.first_parity],
    )
    stack = FieldStack.from_array(stored, info, times_s=scene.times_s)
    values = measure_point(stack, setup_of(scene)).values
    return (
        values["angle_deg"],
        values["angle_std_deg"],
        values["flags"],
    )


def setup_of(scene: Scene) -> Setup:
    """Return the setup with which a scene is measured."""
    pitch = [f"{p} um" for p in scene.pitch_um]
    camera: dict[str, object] = {"pixel_pitch": pitch}
    if scene.oriented:
        camera |= {
            "focal_length": "35 mm",
            "sensor": [752, 240],
            "position": ["0 m", "-56 in", "60 mm"],
        }
    return Setup.model_validate(
        {"camera": camera, "glint": {"nose": "left", "mean": "plain", **scene.glint}}
    )


def judge(
    scene: Scene,
    truth: Truth,
    angle: NDArray[np.float64],
    std: NDArray[np.float64],
    flags: NDArray[np.int64],
) -> Outcome:
    """Hold measured angles [deg] against the truth."""
    error = np.abs(angle - truth.angle_deg)
    error = np.where(np.isfinite(angle) & np.isnan(truth.angle_deg), np.inf, error)
    right = error <= np.fmax(_STDS * std, _LEAST_DEG)
    unflagged = np.isfinite(angle) & (flags & int(WARNING) == 0)
    used = np.isfinite(angle) & (flags & int(REJECTING) == 0)
    owed = scene.owed != 0
    false = flags & int(SEQUENCE) & ~scene.owed & ~int(scene.allowed)
    return Outcome(
        stacks=1,
        fields=len(angle),
        unflagged=int(unflagged.sum()),
        wrong=int((unflagged & ~right).sum()),
        worst_deg=float(np.max(error[unflagged], initial=0.0)),
        measurable=int(truth.measurable.sum()),
        measured=int((truth.measurable & used & right).sum()),
        owed=int(owed.sum()),
        paid=int((owed & (flags & scene.owed != 0)).sum()),
        alarms=int((false != 0).sum()),
    )


def add(one: Outcome, other: Outcome) -> Outcome:
    """Join two outcomes."""
    counts = {f.name: getattr(one, f.name) + getattr(other, f.name) for f in fields(Outcome)}
    return Outcome(**{**counts, "worst_deg": max(one.worst_deg, other.worst_deg)})
