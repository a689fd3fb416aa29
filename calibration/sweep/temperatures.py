"""From tunnel temperatures to weights of the sweeps taken there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["BEND", "SAME_TEMPERATURE_K", "TemperatureWeights", "temperature_groups"]

Floats = NDArray[np.float64]

SAME_TEMPERATURE_K = 2.0
"""Points whose temperatures follow each other within this are of one sweep [K]."""

BEND = 0.2
"""How large the first term is that an interpolation leaves out, 1 sigma, over the last it used."""


def temperature_groups(temperatures_k: Sequence[float]) -> list[list[int]]:
    """Group points by temperature, in rising order of it.

    Parameters
    ----------
    temperatures_k : sequence of float
        Tunnel temperature of each point [K].

    Returns
    -------
    list of list of int
        Numbers of the points of each group, in the order given. Neighbouring groups are more than
        `SAME_TEMPERATURE_K` apart.
    """
    order = sorted(range(len(temperatures_k)), key=temperatures_k.__getitem__)
    groups: list[list[int]] = []
    last = -np.inf
    for number in order:
        if temperatures_k[number] - last > SAME_TEMPERATURE_K:
            groups.append([])
        groups[-1].append(number)
        last = temperatures_k[number]
    return [sorted(group) for group in groups]


@dataclass(frozen=True, eq=False)
class TemperatureWeights:
    """How much each sweep counts at one temperature; arrays have shape (sweep,).

    Attributes
    ----------
    best : ndarray
        Weights of the interpolation: linear between two temperatures, quadratic among more.
    straight : ndarray
        Weights of the linear interpolation between the two nearest.
    bend : ndarray
        What a quadratic part of `BEND` times the change between the two nearest adds, as weights.
    beyond : ndarray
        Weights of the straight line's rise from the last sweep to the temperature, outside.
    is_known : bool
        Whether the temperature is known; if not, every sweep counts alike.
    """

    best: Floats
    straight: Floats
    bend: Floats
    beyond: Floats
    is_known: bool = True

    @classmethod
    def unknown(cls, n_sweeps: int) -> "TemperatureWeights":
        """Weights where the temperature is unknown."""
        alike = np.full(n_sweeps, 1 / n_sweeps)
        return cls(alike, alike, 0 * alike, 0 * alike, is_known=False)

    @classmethod
    def at(cls, temperature_k: float, sweeps_k: Floats) -> "TemperatureWeights":
        """Work the weights out.

        Parameters
        ----------
        temperature_k : float
            The temperature [K]; outside the sweeps' the nearest sweep counts alone.
        sweeps_k : ndarray [sweep]
            Temperatures of the sweeps, rising [K].

        Notes
        -----
        Among three sweeps or more, the parabolas through the two nearest and the one below and
        the one above are blended linearly (Overhauser, 1968): the curve is smooth and goes
        through every sweep.
        """
        n = sweeps_k.size
        none = np.zeros(n)
        if n == 1:
            return cls(np.ones(1), np.ones(1), none, none)
        inside = float(np.clip(temperature_k, sweeps_k[0], sweeps_k[-1]))
        low = min(int(np.searchsorted(sweeps_k, inside, side="right")) - 1, n - 2)
        share = (inside - sweeps_k[low]) / (sweeps_k[low + 1] - sweeps_k[low])
        straight, bend, beyond = none.copy(), none.copy(), none.copy()
        straight[[low, low + 1]] = 1 - share, share
        bend[[low, low + 1]] = BEND * share * (1 - share) * np.array([-1, 1])
        rise = (temperature_k - inside) / (sweeps_k[low + 1] - sweeps_k[low])
        beyond[[low, low + 1]] = -rise, rise
        if n == 2:
            return cls(straight, straight, bend, beyond)
        best = none.copy()
        for first, weight in ((low - 1, 1 - share), (low, share)):
            start = min(max(first, 0), n - 3)
            best[start : start + 3] += weight * _lagrange(inside, sweeps_k[start : start + 3])
        return cls(best, straight, bend, beyond)

    def doubt(self, values: Floats) -> Floats:
        """Return what the interpolation leaves in doubt of values [sweep, ...], 1 sigma [...].

        With two sweeps a quadratic part cannot be seen; with three or more the next order is
        taken to be `BEND` of what the quadratic one added. Outside, the whole change that a
        straight line would add is in doubt. At an unknown temperature it is half of the sweeps'
        spread.
        """
        if not self.is_known:
            return np.asarray(np.ptp(values, axis=0) / 2, np.float64)
        bent = np.tensordot(self.bend, values, 1)
        if self.best.size > 2:
            added = np.tensordot(self.best - self.straight, values, 1)
            bent = BEND * np.hypot(added, bent)
        return np.asarray(np.hypot(bent, np.tensordot(self.beyond, values, 1)), np.float64)


def _lagrange(at: float, nodes: Floats) -> Floats:
    """Weights [3] of the parabola through three nodes."""
    weights = np.ones(3)
    for k in range(3):
        for other in range(3):
            if other != k:
                weights[k] *= (at - nodes[other]) / (nodes[k] - nodes[other])
    return weights
