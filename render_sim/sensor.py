"""The sensor: light to grey levels, with shot noise, read noise, black level, bits and clipping."""

import numpy as np
from numpy.typing import NDArray

from render_sim.scene import Sensor

__all__ = ["expected_noise", "record"]

Floats = NDArray[np.float64]
Levels = NDArray[np.uint8] | NDArray[np.uint16]


def expected_noise(light: Floats, sensor: Sensor) -> Floats:
    r"""Return the standard deviation of the noise before rounding [grey levels].

    .. math:: \sigma^2 = g L + \sigma_r^2

    with L the light and g the grey levels of one electron.

    Parameters
    ----------
    light : ndarray
        Light above black [...] [grey levels].
    sensor : Sensor
        Full well and read noise.
    """
    per_electron = (sensor.top_level - sensor.black_level) / sensor.full_well_e
    return np.asarray(np.sqrt(np.maximum(light, 0.0) * per_electron + sensor.read_noise**2))


def record(
    light: Floats,
    sensor: Sensor,
    *,
    rng: np.random.Generator,
    gain: float = 1.0,
    black_change: float = 0.0,
) -> Levels:
    """Turn light into recorded grey levels.

    Shot noise is drawn from a normal distribution: where light is so weak that a Poisson's
    skewness would show, the read noise of some hundred electrons covers it.

    Parameters
    ----------
    light : ndarray
        Mean light over the exposure, above black [...] [grey levels].
    sensor : Sensor
        Noise, black level and bits.
    rng : numpy.random.Generator
        Source of the noise.
    gain : float
        Of the amplifier, over its usual one [-].
    black_change : float
        What the black level lies over its usual one [grey levels].

    Returns
    -------
    ndarray
        Grey levels [...], uint8 for 8 bits, uint16 for more.
    """
    noise = rng.standard_normal(light.shape, dtype=np.float32)
    signal = light + noise * expected_noise(light, sensor)
    levels = sensor.black_level + black_change + gain * signal
    clipped = np.clip(np.rint(levels), 0, sensor.top_level)
    return clipped.astype(np.uint8) if sensor.bits == 8 else clipped.astype(np.uint16)
