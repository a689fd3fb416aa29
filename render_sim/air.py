"""Light that changes in time: fog that draws in, and lamps that flicker with the mains."""

import numpy as np
from numpy.typing import NDArray

from render_sim.scene import Air

__all__ = ["light_in_time"]

Floats = NDArray[np.float64]


def light_in_time(air: Air, time_s: Floats, span_s: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return what air and mains make of the light at times.

    Parameters
    ----------
    air : Air
        Fog and flicker.
    time_s : ndarray
        Times after the trigger [time] [s].
    span_s : tuple of float
        The record's first and last moment [s], between which the fog changes evenly.

    Returns
    -------
    share : ndarray
        Of the still, clear light that reaches the lens [time].
    airlight : ndarray
        What the fog adds [time] [grey levels].
    """
    clear = np.interp(time_s, span_s, air.fog)
    swing = np.cos(4 * np.pi * air.mains_hz * time_s)
    return clear * (1 + air.flicker * swing), (1 - clear) * air.airlight_level
