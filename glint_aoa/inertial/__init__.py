"""From an acquisition record to the inertial angle without its vibration bias."""

from glint_aoa.inertial.correct import Correction, correct
from glint_aoa.inertial.modes import TABLE_1, Mode, modes_from_setup

__all__ = ["TABLE_1", "Correction", "Mode", "correct", "modes_from_setup"]
