"""Resonances of a plane that the modal survey does not list."""

import math
from collections.abc import Sequence

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.inertial.channels import Accelerometer, PackageOutput
from glint_aoa.inertial.consistency import shown_by_package
from glint_aoa.inertial.filters import integrate_band
from glint_aoa.inertial.modes import Mode
from glint_aoa.inertial.spectrum import PlaneSpectrum

__all__ = ["named_unlisted", "unlisted_resonances", "unlisted_terms"]

_BAND = 0.08  # half-width of a resonance over its frequency
_HIGHEST = 0.45  # of the sampling rate: up to where the package's second harmonic is looked for
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
        near = any(abs(frequency - mode) < _BAND * (frequency + mode) for mode in spectrum.peaks_hz)
        inside = np.abs(bins - frequency) <= _BAND * frequency
        if not near and np.sum(velocity[inside]) > _LEAST_SHARE * np.sum(velocity):
            found.append(float(frequency))
    return found


def named_unlisted(unlisted_hz: Sequence[float]) -> str:
    """Name such resonances as the end of a sentence; empty if there are none."""
    if not unlisted_hz:
        return ""
    return f"; no mode lists {' and '.join(f'{each:.3g} Hz' for each in unlisted_hz)}"


def unlisted_terms(
    package: PackageOutput,
    sensor: Accelerometer,
    modes: Sequence[Mode],
    unlisted_hz: Sequence[float],
) -> list[NDArray[np.float64]]:
    """Give the bias of resonances whose points of rotation nobody knows, as error terms.

    Parameters
    ----------
    package : PackageOutput
        Output of the inertial package.
    sensor : Accelerometer
        The accelerometer of the plane.
    modes : sequence of Mode
        Modes of the plane.
    unlisted_hz : sequence of float
        From `unlisted_resonances` [Hz].

    Returns
    -------
    list of ndarray [sample]
        V^2 over the middle radius of the plane's modes [m/s^2], or more where the second harmonic
        of the package's unfiltered output, as large as the bias (eq. 6), shows more.
    """
    rate_hz = sensor.channel.rate_hz
    middle = float(np.median([abs(mode.radius_m) for mode in modes]))
    terms = []
    for frequency in unlisted_hz:
        low, high = (1 - _BAND) * frequency, (1 + _BAND) * frequency
        velocity = integrate_band(sensor.acceleration, rate_hz, low_hz=low, high_hz=high)
        guess = velocity**2 / middle
        shown = 0.0
        if not package.is_filtered and 2 * high < _HIGHEST * rate_hz:
            fraction, std = shown_by_package(
                package.specific_force, guess, rate_hz, low_hz=2 * low, high_hz=2 * high
            )
            shown = float(np.hypot(abs(fraction), std)) if np.isfinite(std) else 0.0
        terms.append(max(shown, 1.0) * guess)
    return terms
