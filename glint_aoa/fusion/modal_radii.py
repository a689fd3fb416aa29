"""Points of rotation of the modes, from the smoothed motion of the running test.

Around a resonance the package's velocity is the effective radius times the rate of turning, so the
radius is the slope of one spectrum on the other. Its uncertainty is what the unknown gains and
directions leave, and what the two spectra do not share.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.fusion.smoother import Beliefs
from glint_aoa.inertial.lateral import Resonance
from glint_aoa.inertial.modes import Mode, Plane

__all__ = ["FusedMode", "radii"]

_Floats = NDArray[np.float64]

_HALF_WIDTH = 0.04  # of the frequency: a resonance and its modulation
_COHERENT = 0.9  # of velocity and turning: the model turns about one point
_POINT_M = 0.02  # or it does so within this of where a mode that hardly moves the package turns it
_HANN = 1.5  # bins that share their noise behind Hann's window
_SAME_MODE = 0.05  # of the frequency
_MOVES = 1e-3  # of the plane's power of turning
_LEAST_RATE = np.radians(0.01)  # rad/s rms: less is no vibration


@dataclass(frozen=True)
class FusedMode:
    """A mode that moved during the record.

    Attributes
    ----------
    number : int or None
        That of the setup's mode of this plane and frequency, if there is one.
    plane : {"yaw", "pitch"}
        Plane of its motion.
    frequency_hz : float
        Where the model answered [Hz].
    radius_m, radius_std_m : float
        Distance from its point of rotation forward to the package and the standard deviation of
        that [m].
    """

    number: int | None
    plane: Plane
    frequency_hz: float
    radius_m: float
    radius_std_m: float


def radii(
    plane: Plane,
    rate: _Floats,
    velocity: _Floats,
    beliefs: Beliefs,
    found: Sequence[Resonance],
    modes: Sequence[Mode],
    *,
    rate_hz: float,
    across: _Floats,
) -> list[FusedMode]:
    """Find the effective radius of each resonance that turns the model about one point.

    Parameters
    ----------
    plane : {"yaw", "pitch"}
        Plane of the motion.
    rate, velocity : ndarray [sample, 1 + unknown]
        Of turning [rad/s] and of the package [m/s], columns as of `Motion`.
    beliefs : Beliefs
        Of the unknowns.
    found : sequence of Resonance
        Where the model answers.
    modes : sequence of Mode
        Of the setup, for their numbers.
    rate_hz : float
        Samples a second [Hz].
    across : ndarray [sample]
        Rate of turning in the other plane [rad/s]: what turns further there is a mode of that.

    Returns
    -------
    list of FusedMode
        By frequency. Driven off resonance the model turns about another point than its mode's: the
        radius is that of the motion, whichever it is.
    """
    window = scipy.signal.windows.hann(len(rate), sym=False)[:, None]
    turning, moving = (scipy.fft.rfft(window * each, axis=0) for each in (rate, velocity))
    other = scipy.fft.rfft(window[:, 0] * across)
    bins = scipy.fft.rfftfreq(len(rate), 1 / rate_hz)
    own_turning = turning[:, 0] - turning[:, 1:] @ beliefs.mean
    own_moving = moving[:, 0] - moving[:, 1:] @ beliefs.mean
    least = max(_MOVES * np.sum(np.abs(own_turning) ** 2), _LEAST_RATE**2 * len(rate) ** 2 / 8)
    modes_found = []
    for resonance in found:
        middle = resonance.frequency_hz
        at = np.abs(bins - middle) <= max(_HALF_WIDTH * middle, 2.5 * bins[1])
        q, w = own_turning[at], own_moving[at]
        power = float(np.sum(np.abs(q) ** 2))
        if power < max(least, float(np.sum(np.abs(other[at]) ** 2))):
            continue
        radius = float(np.vdot(q, w).real / power)
        left = w - radius * q
        change = -moving[at, 1:] + radius * turning[at, 1:]
        slope = (np.conj(q) @ change - turning[at, 1:].T @ np.conj(left)).real / power
        scatter = _HANN * np.sum(np.abs(left) ** 2) / (2 * max(q.size - 1, 1) * power)
        std = float(np.sqrt(slope @ beliefs.covariance @ slope + scatter))
        apart = float(np.sum(np.abs(left) ** 2))
        if apart <= max((1 - _COHERENT) * float(np.sum(np.abs(w) ** 2)), _POINT_M**2 * power):
            number = _number(plane, middle, modes)
            modes_found.append(FusedMode(number, plane, middle, radius, std))
    return modes_found


def _number(plane: Plane, frequency_hz: float, modes: Sequence[Mode]) -> int | None:
    near = [
        mode
        for mode in modes
        if mode.plane == plane and abs(mode.frequency_hz - frequency_hz) < _SAME_MODE * frequency_hz
    ]
    if not near:
        return None
    return min(near, key=lambda mode: abs(mode.frequency_hz - frequency_hz)).number
