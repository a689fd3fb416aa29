"""Resonances of a plane that the modal survey does not list."""

import math

import numpy as np
import scipy.signal

from glint_aoa.inertial.spectrum import PlaneSpectrum

__all__ = ["BAND", "unlisted_resonances"]

BAND = 0.08
"""Half-width of a resonance over its frequency."""

_PROMINENCE = 20.0  # of the averaged power over the saddles beside it: noise and zeros stay below
_LEAST_SHARE = 0.02  # of the energy of the velocity: less moves no angle that anyone looks at


def unlisted_resonances(spectrum: PlaneSpectrum) -> list[float]:
    """Find peaks of a plane's spectrum away from all modes of the survey.

    Parameters
    ----------
    spectrum : PlaneSpectrum
        Of the tangential acceleration, with the peaks of the listed modes.

    Returns
    -------
    list of float
        Frequencies [Hz], rising, of peaks that stand twenty times over the saddles beside them,
        hold a fiftieth of the energy of the velocity, and share no band with a listed mode.
        Beyond 0.4 times the lowest and 1.8 times the highest mode nothing is looked for.
    """
    bins, velocity = spectrum.bins_hz, spectrum.power / spectrum.bins_hz**2
    peaks, _ = scipy.signal.find_peaks(np.log(spectrum.power), prominence=math.log(_PROMINENCE))
    found = []
    for frequency in bins[peaks]:
        near = any(abs(frequency - mode) < BAND * (frequency + mode) for mode in spectrum.peaks_hz)
        inside = np.abs(bins - frequency) <= BAND * frequency
        if not near and np.sum(velocity[inside]) > _LEAST_SHARE * np.sum(velocity):
            found.append(float(frequency))
    return found
