"""From an acquisition record to the inertial angle without its vibration bias."""

from glint_aoa.inertial.correct import Correction, correct
from glint_aoa.inertial.modes import (
    TABLE_1,
    Mode,
    ModeShape,
    RotationPoint,
    modes_from_setup,
    rotation_point,
)

__all__ = [
    "TABLE_1",
    "Correction",
    "Mode",
    "ModeShape",
    "RotationPoint",
    "correct",
    "modes_from_setup",
    "rotation_point",
]
