"""The slow angle from the package: windows of its output with the vibration's bias put back.

What the package feels of the vibration beyond gravity and the products of velocity and rate, a
crooked axis, the lag of its servo, the axial motion of two modes at once, has no mean. So it is not
modelled but kept out: windows of a second, tapered to 90 dB, turn the output into a few angles, and
what their scatter shows beyond the white noise counts as noise too.
"""

from dataclasses import dataclass

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.fusion.smoother import Beliefs

__all__ = ["SlowAngle", "slow_angle"]

_Floats = NDArray[np.float64]

_WINDOW_S = 1.0
_LEAST_WINDOWS = 3
_NOISE_BAND = (0.125, 0.475)  # times the rate: above the vibration
_LEAST_DRIFT = np.radians(5e-5)  # rad/sqrt(s)
_DRIFTS = np.concatenate([[0.0], np.geomspace(1e-4, 1e2, 13)])  # variance a window, over the noise
_NOISES = np.geomspace(1.0, 1e4, 25)  # over the white noise


@dataclass(frozen=True, eq=False)
class SlowAngle:
    """Angles of the windows.

    Attributes
    ----------
    sample : ndarray [window]
        Middle of each.
    columns : ndarray [window, 1 + unknown]
        Angle from a reference [rad], then what one unit of each unknown adds.
    variance : float
        Of each angle [rad^2].
    drift : float
        Random walk of the true angle that the scatter shows [rad/sqrt(s)].
    """

    sample: NDArray[np.int64]
    columns: _Floats
    variance: float
    drift: float


def slow_angle(columns: _Floats, rate_hz: float, beliefs: Beliefs, *, first: int = 0) -> SlowAngle:
    """Take windows of the package's angle and find how it drifts.

    Parameters
    ----------
    columns : ndarray [sample, 1 + unknown]
        The package's angle with the vibration's part taken off, from a reference [rad], then what
        one unit of each unknown adds.
    rate_hz : float
        Samples a second [Hz].
    beliefs : Beliefs
        Of the unknowns.
    first : int
        Sample from which on the angle may be used.

    Notes
    -----
    Noise and drift are those of a local level model, by maximum likelihood on a grid; neither is
    taken to be less than the white noise above the vibration and 0.00005 deg/sqrt(s).
    """
    samples = len(columns) - first
    length = min(round(_WINDOW_S * rate_hz), max(2 * samples // (_LEAST_WINDOWS + 1), 1))
    taper = scipy.signal.windows.blackmanharris(length)
    taper /= taper.sum()
    hop = max(length // 2, 1)
    starts = np.arange(first, first + samples - length + 1, hop)
    angles = np.array([taper @ columns[start : start + length] for start in starts])
    white = _white_noise(columns[:, 0], rate_hz) * float(np.sum(taper**2))
    level = _without_unknowns(angles, white, beliefs)
    variance, walk = _local_level(level, white)
    drift = max(float(np.sqrt(walk * rate_hz / hop)), _LEAST_DRIFT)
    return SlowAngle(starts + length // 2, angles, variance, drift)


def _white_noise(angle: _Floats, rate_hz: float) -> float:
    bins, density = scipy.signal.welch(angle, rate_hz, nperseg=min(angle.size, 2048))
    free = (bins > _NOISE_BAND[0] * rate_hz) & (bins < _NOISE_BAND[1] * rate_hz)
    return max(float(np.median(density[free])) * rate_hz / 2, 1e-16)


def _without_unknowns(angles: _Floats, variance: float, beliefs: Beliefs) -> _Floats:
    """Take off the mean and what the unknowns may explain of the scatter."""
    centred = angles - angles.mean(axis=0)
    level, sensitive = centred[:, 0], centred[:, 1:]
    # what the windows say beside the unknowns' spread, in the windows' own space
    spread = sensitive @ beliefs.covariance @ sensitive.T
    explained = spread @ np.linalg.solve(spread + variance * np.eye(level.size), level)
    return np.asarray(level - explained)


def _local_level(level: _Floats, white: float) -> tuple[float, float]:
    """Variance of the noise, and of the walk from window to window."""
    noise, walk = (each.ravel() for each in np.meshgrid(white * _NOISES, _DRIFTS))
    walk = walk * noise
    mean, spread = np.full(noise.size, level[0]), noise.copy()
    loss = np.zeros(noise.size)
    for value in level[1:]:
        spread = spread + walk
        expected = spread + noise
        left = value - mean
        loss += np.log(expected) + left**2 / expected
        mean = mean + spread / expected * left
        spread = spread * noise / expected
    best = int(np.argmin(loss))
    return float(noise[best]), float(walk[best])
