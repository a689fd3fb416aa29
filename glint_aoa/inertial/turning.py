"""How the model really turns at a mode's frequency, from accelerometers at other stations.

A mode's effective radius holds while the mode moves alone. Driven at the frequency of a mode that
hardly moves the sensor, the model answers with the skirts of stronger modes as well and turns about
another point; dividing by the surveyed radius is then wrong by any factor. Where accelerometers at
other stations are recorded, they show that point.
"""

from collections.abc import Sequence

import numpy as np
import scipy.fft
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.inertial.channels import Accelerometer

__all__ = ["turning_per_acceleration"]

_BAND = 0.08  # half-width over frequency: a resonance and its modulation


def turning_per_acceleration(
    sensor: Accelerometer, others: Sequence[Accelerometer], frequency_hz: float
) -> float:
    """Angular over tangential acceleration at a sensor, in phase, around a frequency.

    Parameters
    ----------
    sensor : Accelerometer
        The accelerometer at the package.
    others : sequence of Accelerometer
        At least one of the same plane and clock, at another station.
    frequency_hz : float
        Middle of the band [Hz].

    Returns
    -------
    float
        The inverse of the distance from the point of rotation forward to `sensor` [1/m];
        0 for a model that does not turn.

    Notes
    -----
    On a rigid body the acceleration is linear in the station: a_i = a_0 + theta'' d_i. The
    transfer of each accelerometer to the first, S_0i / S_00 over the band, therefore has the
    slope theta'' / a_0 over d, found by least squares. Its part in phase is what the mean of
    velocity times angular rate contains.
    """
    rate_hz = sensor.channel.rate_hz
    bins = scipy.fft.rfftfreq(sensor.acceleration.size, 1 / rate_hz)
    inside = np.abs(bins - frequency_hz) <= _BAND * frequency_hz
    first = _spectrum(sensor.acceleration, inside)
    power = np.vdot(first, first).real
    distance = np.array([other.ahead_m - sensor.ahead_m for other in others])
    transfer = np.array(
        [np.vdot(first, _spectrum(other.acceleration, inside)).real / power for other in others]
    )
    return float(distance @ (transfer - 1) / (distance @ distance))


def _spectrum(samples: NDArray[np.float64], inside: NDArray[np.bool_]) -> NDArray[np.complex128]:
    window = scipy.signal.windows.hann(samples.size, sym=False)
    spectrum: NDArray[np.complex128] = scipy.fft.rfft(window * (samples - samples.mean()))[inside]
    return spectrum
