"""Vibration modes of the model on its sting, as the inertial sensor meets them."""

from dataclasses import dataclass
from typing import Literal

from glint_aoa.errors import InputError
from glint_aoa.setup import Inertial

__all__ = ["TABLE_1", "Mode", "Plane", "modes_from_setup"]

Plane = Literal["yaw", "pitch"]

_INCH = 0.0254


@dataclass(frozen=True)
class Mode:
    """One vibration mode: the fuselage turns as a rigid body about one point of its axis.

    Attributes
    ----------
    number : int
        Mode number.
    plane : {"yaw", "pitch"}
        Plane of the motion.
    frequency_hz : float
        Natural frequency [Hz].
    radius_m : float
        Effective radius [m]: distance from the point of rotation forward to the sensor, positive
        with the point of rotation aft of the sensor.
    """

    number: int
    plane: Plane
    frequency_hz: float
    radius_m: float


TABLE_1 = (
    Mode(1, "yaw", 9.8, 31.0 * _INCH),
    Mode(2, "pitch", 9.2, 30.2 * _INCH),
    Mode(3, "yaw", 19.5, 0.18 * _INCH),
    Mode(4, "pitch", 20.3, -1.08 * _INCH),
    Mode(5, "yaw", 29.8, -7.14 * _INCH),
    Mode(6, "pitch", 34.2, -7.65 * _INCH),
)
"""The six modes of the paper's Table 1 (modal survey of July 1993), inches turned into metres.

Mode 1 was met between 8.8 and 9.8 Hz, depending on the set-up; most tests excited 9.8 Hz.
"""


def modes_from_setup(inertial: Inertial) -> tuple[Mode, ...]:
    """Return the modes that the setup lists, in order of frequency.

    Parameters
    ----------
    inertial : Inertial
        The setup's inertial section.

    Returns
    -------
    tuple of Mode
        Empty if the setup lists none.

    Raises
    ------
    InputError
        If two modes bear the same number.
    """
    numbers = [mode.number for mode in inertial.mode]
    for number in numbers:
        if numbers.count(number) > 1:
            raise InputError(f"inertial.mode: number {number} is listed twice; number modes apart")
    modes = (Mode(m.number, m.plane, m.frequency, m.radius) for m in inertial.mode)
    return tuple(sorted(modes, key=lambda mode: mode.frequency_hz))
