"""The shaker shut off: its force ends, and each mode decays freely."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render_sim.excitation import Sum, Tones
from render_sim.modes import VibrationMode

__all__ = ["ShutOff", "UntilOff"]


@dataclass(frozen=True, eq=False)
class ShutOff:
    """A mode's angle, steady until the shaker is shut off and in free decay from then on.

    Angle and rate go on without a step; the acceleration does not, since the force is gone.

    Attributes
    ----------
    mode : VibrationMode
        Gives natural frequency and damping.
    steady : Tones or Sum
        Angle under the force [rad].
    off_s : float
        When the shaker is shut off, after the trigger [s].
    """

    mode: VibrationMode
    steady: Tones | Sum
    off_s: float

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angle [rad] at the times `time_s` [s], of its shape."""
        time_s = np.asarray(time_s, np.float64)
        natural = 2 * np.pi * self.mode.frequency
        damped = natural * np.sqrt(1 - self.mode.damping**2)
        off = np.array([self.off_s])
        angle, rate = float(self.steady.at(off)[0]), float(self.steady.derivative().at(off)[0])
        after = np.maximum(time_s - self.off_s, 0.0)
        pull = (rate + self.mode.damping * natural * angle) / damped
        free = np.exp(-self.mode.damping * natural * after) * (
            angle * np.cos(damped * after) + pull * np.sin(damped * after)
        )
        return np.where(time_s < self.off_s, self.steady.at(time_s), free)


@dataclass(frozen=True, eq=False)
class UntilOff:
    """The shaker's force, nothing once it is shut off.

    Attributes
    ----------
    force : Tones
        The force while it is on [N].
    off_s : float
        When the shaker is shut off, after the trigger [s].
    """

    force: Tones
    off_s: float

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force [N] at the times `time_s` [s], of its shape."""
        time_s = np.asarray(time_s, np.float64)
        return np.where(time_s < self.off_s, self.force.at(time_s), 0.0)
