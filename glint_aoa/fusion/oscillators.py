"""The motion of one plane as a state-space model: sprung coordinates under a shaped force.

A rigid model that moves in one plane has two coordinates, heave of the package and turning. Each
is an oscillator

    x'' = -w0^2 x - 2 zeta w0 x' + F,

and its force F is white noise behind a band-pass, the rate of a second, well damped oscillator
after a low-pass: broad about the vibration, nothing at rest, and so little at half the sampling
rate that what the samples fold back lies below the accelerometers' noise. The spring keeps what
accelerometers do not see, slow motion, from growing; within the vibration's band their signals
outweigh the prior thousands of times, whatever the excitation.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.fft
import scipy.linalg
from numpy.typing import NDArray

__all__ = ["BAND_HZ", "Coordinate", "Oscillators", "fit_coordinate"]

_Floats = NDArray[np.float64]

BAND_HZ = (3.0, 80.0)
"""Where the vibration is looked for [Hz]."""

STATES = 5
"""Of a coordinate: displacement, its rate, the force, and the two of its band-pass."""

_DAMPING = 0.01  # of a model on its sting; matters below the vibration only through the spring
_FORCE_DAMPING = 0.5  # the force's band is as wide as its middle
_LOW_PASS = 1.5  # times the middle
_LEAST_FORCE = 0.02  # of the accelerometers' noise: what never moves may still begin to


@dataclass(frozen=True)
class Coordinate:
    """One coordinate and what drives it.

    Attributes
    ----------
    heave : float
        Displacement of the package [m] for one unit of the coordinate.
    turning : float
        Angle of the model [rad] for one unit of the coordinate.
    frequency_hz : float
        Of its spring [Hz].
    force_hz : float
        Middle of the force's band [Hz].
    force_std : float
        Of the force over the mass [unit/s^2].
    """

    heave: float
    turning: float
    frequency_hz: float
    force_hz: float
    force_std: float


@dataclass(frozen=True)
class Oscillators:
    """State-space model of a plane, and of the slow angle if `drift` is not None.

    Attributes
    ----------
    coordinates : tuple of Coordinate
        Five states each: displacement, rate, force, and the two of its band-pass.
    rate_hz : float
        Steps a second [Hz].
    drift : float or None
        Random walk of the slow angle, the last state [rad/sqrt(s)].
    start_std : float
        Of the slow angle at the first step [rad].
    """

    coordinates: tuple[Coordinate, ...]
    rate_hz: float
    drift: float | None = None
    start_std: float = 0.0

    @property
    def size(self) -> int:
        """Number of states."""
        return STATES * len(self.coordinates) + (self.drift is not None)

    @cached_property
    def matrices(self) -> tuple[_Floats, _Floats, _Floats]:
        """Transition of one step, covariance that it adds, covariance at the start."""
        blocks = [_discrete(each, self.rate_hz) for each in self.coordinates]
        if self.drift is not None:
            walk = np.array([[self.drift**2 / self.rate_hz]])
            blocks.append((np.eye(1), walk, np.array([[self.start_std**2]])))
        transition, process, start = zip(*blocks, strict=True)
        joined = scipy.linalg.block_diag
        return joined(*transition), joined(*process), joined(*start)

    def row(self, derivative: int, *, heave: float = 0.0, turning: float = 0.0) -> _Floats:
        """Combine the coordinates' displacement, rate or acceleration.

        Parameters
        ----------
        derivative : int
            0, 1 or 2.
        heave, turning : float
            Factors of the package's heave [1] and of the model's angle [per rad].

        Returns
        -------
        ndarray [state]
            The combination as a row.
        """
        row = np.zeros(self.size)
        for index, each in enumerate(self.coordinates):
            share = heave * each.heave + turning * each.turning
            row[STATES * index : STATES * (index + 1)] = share * _derivative(each, derivative)
        return row

    def angle_rows(self, ahead_s: _Floats, exposure_s: float) -> _Floats:
        """Mean angle over exposures whose middles lie `ahead_s` [row] after a step.

        The mean over an exposure T is theta + theta'' T^2 / 24, good to (pi f T)^4 / 120.

        Returns
        -------
        ndarray [row, state]
            The slow angle is in it.
        """
        row = self.row(0, turning=1.0) + exposure_s**2 / 24 * self.row(2, turning=1.0)
        rows = np.zeros((ahead_s.size, self.size))
        if self.drift is not None:
            rows[:, -1] = 1.0
        for index, each in enumerate(self.coordinates):
            at = slice(STATES * index, STATES * (index + 1))
            steps = scipy.linalg.expm(ahead_s[:, None, None] * _continuous(each))
            rows[:, at] = row[at] @ steps
        return rows


def fit_coordinate(
    acceleration: _Floats,
    noise_variance: float,
    rate_hz: float,
    *,
    heave: float,
    turning: float,
    band_hz: tuple[float, float] = BAND_HZ,
) -> Coordinate:
    """Find spring and force of a coordinate from its measured acceleration.

    The spring is the one that leaves the least force in the band,
    w0^2 = sum(S / w^2) / sum(S / w^4) with S the power of the acceleration less its noise; the
    force is what it leaves.

    Parameters
    ----------
    acceleration : ndarray [sample]
        Of the coordinate [unit/s^2].
    noise_variance : float
        Of its white noise.
    rate_hz : float
        Samples a second [Hz].
    heave, turning : float
        As of `Coordinate`.
    band_hz : (float, float)
        Where its motion lies [Hz].
    """
    window = np.sin(np.pi * (np.arange(acceleration.size) + 0.5) / acceleration.size) ** 2
    spectrum = scipy.fft.rfft(window * (acceleration - acceleration.mean()))
    power = 2 * np.abs(spectrum) ** 2 / (acceleration.size * np.sum(window**2))
    bins = scipy.fft.rfftfreq(acceleration.size, 1 / rate_hz)
    inside = (bins >= band_hz[0]) & (bins <= min(band_hz[1], 0.4 * rate_hz))
    circular = 2 * np.pi * bins[inside]
    floor = 2 * noise_variance / acceleration.size
    seen = np.maximum(power[inside] - floor, 0.0) + 1e-3 * floor
    spring = np.sum(seen / circular**2) / np.sum(seen / circular**4)
    damping = 2 * _DAMPING * np.sqrt(spring) / circular
    force = seen * ((1 - spring / circular**2) ** 2 + damping**2)
    middle = np.sqrt(np.sum(force * circular**2) / np.sum(force))
    least = _LEAST_FORCE**2 * noise_variance
    return Coordinate(
        heave,
        turning,
        frequency_hz=float(np.sqrt(spring) / (2 * np.pi)),
        force_hz=float(middle / (2 * np.pi)),
        force_std=float(np.sqrt(np.sum(force) + least)),
    )


def _derivative(coordinate: Coordinate, order: int) -> _Floats:
    if order < 2:
        return np.asarray(np.eye(STATES)[order])
    return np.asarray(_continuous(coordinate)[1])


def _continuous(coordinate: Coordinate) -> _Floats:
    own, force = 2 * np.pi * coordinate.frequency_hz, 2 * np.pi * coordinate.force_hz
    pole = _LOW_PASS * force
    return np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-(own**2), -2 * _DAMPING * own, 1.0, 0.0, 0.0],
            [0.0, 0.0, -pole, 0.0, pole],
            [0.0, 0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, 0.0, -(force**2), -2 * _FORCE_DAMPING * force],
        ]
    )


def _discrete(coordinate: Coordinate, rate_hz: float) -> tuple[_Floats, _Floats, _Floats]:
    """Transition, process noise (Van Loan 1978, doi:10.1109/TAC.1978.1101743), stationary start."""
    motion = _continuous(coordinate)
    white = np.zeros((STATES, STATES))
    white[-1, -1] = 1.0
    start = scipy.linalg.solve_continuous_lyapunov(motion, -white)
    scale = coordinate.force_std**2 / start[2, 2]
    joint = np.block([[-motion, white], [np.zeros((STATES, STATES)), motion.T]]) / rate_hz
    exponential = scipy.linalg.expm(joint)
    transition = exponential[STATES:, STATES:].T
    process = scale * transition @ exponential[:STATES, STATES:]
    return transition, (process + process.T) / 2, scale * (start + start.T) / 2
