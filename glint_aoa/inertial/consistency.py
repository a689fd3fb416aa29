"""Whether the package itself shows the bias that a method predicts.

Squared motion has as much power at twice the frequency as in its mean: the second harmonic of
eq. 6 of the paper is as large as the bias. The unfiltered output holds it, so a prediction that the
package does not show there is wrong in its mean as well, by about as much.
"""

import numpy as np
import scipy.fft
import scipy.signal
from numpy.typing import NDArray

__all__ = ["shown_by_package"]

_Floats = NDArray[np.float64]


def shown_by_package(
    specific_force: _Floats, addition: _Floats, rate_hz: float, *, low_hz: float, high_hz: float
) -> tuple[complex, float]:
    """Compare the package's output with a predicted bias within a band above the angle's changes.

    Parameters
    ----------
    specific_force : ndarray [sample]
        Unfiltered output of the package [m/s^2].
    addition : ndarray [sample]
        Predicted centripetal acceleration, which the package feels with the other sign [m/s^2].
    rate_hz : float
        Samples a second [Hz].
    low_hz, high_hz : float
        The band [Hz], such as around twice a mode's frequency.

    Returns
    -------
    fraction : complex
        Least-squares fraction of the prediction that the output shows; 1 for a true one. The
        imaginary part is what it shows out of step. NaN if nothing is predicted there.
    std : float
        Standard deviation of either part, from what else the output holds in the band.

    Notes
    -----
    Longitudinal vibration counts for the second harmonic: two modes that one sine drives together
    have such a part, so the fraction then holds to the order of its size only.
    """
    bins = scipy.fft.rfftfreq(addition.size, 1 / rate_hz)
    inside = (bins >= low_hz) & (bins <= high_hz)
    window = scipy.signal.windows.hann(addition.size, sym=False)
    shown, predicted = (
        scipy.fft.rfft(window * (each - each.mean()))[inside]
        for each in (specific_force, -addition)
    )
    power = float(np.vdot(predicted, predicted).real)
    if not power > 0:
        return complex("nan"), float("inf")
    fraction = complex(np.vdot(predicted, shown)) / power
    left = shown - fraction * predicted
    noise = float(np.vdot(left, left).real) / left.size
    return fraction, float(np.sqrt(1.5 * noise / power / 2))
