"""Does the package's output follow the squared velocity of the model? The test of eq. 10.

What centrifugal acceleration adds to the output is proportional to the squared velocity, so the two
are coherent: at twice a mode's frequency, and where its motion grows and fades.
"""

from dataclasses import dataclass

import numpy as np

from glint_aoa.errors import RecordingError
from glint_aoa.inertial.coherence import CrossSpectra, cross_spectra
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.inertial.filters import band_settling_s, integrate_band
from glint_aoa.inertial.lateral import BAND_HZ, LateralSignal, lateral_signals
from glint_aoa.inertial.modes import PLANES, Plane
from glint_aoa.inertial.package import calibrated_output
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.setup import Inertial

__all__ = ["BiasCoherence", "bias_coherence"]

_SEGMENTS = 6  # of a record, before they overlap
_LONGEST_S = 20.0  # bins of 0.05 Hz, six to the paper's modulation of 0.3 Hz
_HIGHEST = 0.4  # of the sampling rate


@dataclass(frozen=True, eq=False)
class BiasCoherence:
    """Spectra of the package's output and of squared velocity.

    Attributes
    ----------
    plane : {"yaw", "pitch"}
        Plane of the motion.
    source : str
        Channel whose integral stands for the velocity.
    spectra : CrossSpectra
        First signal the squared integral, second the specific force [m/s^2].
    """

    plane: Plane
    source: str
    spectra: CrossSpectra


def bias_coherence(record: AcquisitionRecord, inertial: Inertial) -> BiasCoherence:
    """Hold the package's output against the squared velocity of the plane that moves most.

    Parameters
    ----------
    record : AcquisitionRecord
        Package output and accelerometers (or balance moments), on one clock.
    inertial : Inertial
        The setup's inertial section.

    Returns
    -------
    BiasCoherence
        Averaged over a sixth of the record or 20 s at a time, half overlapped.

    Raises
    ------
    RecordingError
        If no channel shows motion in yaw or pitch, or the record is too short.

    Notes
    -----
    The velocity is integrated from 4 to 60 Hz. The output is the one before the low-pass where it
    is recorded; of a filtered one only what is slower than the low-pass can be coherent.
    """
    package = calibrated_output(record, inertial)
    task = CorrectionTask(record, package, (), inertial.filter)
    signal = _liveliest(task)
    rate_hz = package.channel.rate_hz
    low, high = BAND_HZ[0], min(BAND_HZ[1], _HIGHEST * rate_hz)
    square = integrate_band(signal.samples, rate_hz, low_hz=low, high_hz=high) ** 2
    unsettled = round(band_settling_s(low, high) * rate_hz)
    settled = slice(unsettled, square.size - unsettled)
    segment_s = min(square[settled].size / rate_hz / _SEGMENTS, _LONGEST_S)
    spectra = cross_spectra(
        square[settled], package.specific_force[settled], rate_hz, segment_s=segment_s
    )
    return BiasCoherence(signal.plane, signal.channel.name, spectra)


def _liveliest(task: CorrectionTask) -> LateralSignal:
    """Return the signal that moves most, of the first kind that is recorded."""
    signals = [signal for plane in PLANES for signal in lateral_signals(task, plane)]
    for kind in ("acceleration", "moment", "force"):
        found = [signal for signal in signals if signal.kind == kind]
        if found:
            return max(found, key=lambda signal: float(np.std(signal.samples)))
    raise RecordingError(
        f"{task.record.name}: no accelerometer or balance channel of yaw or pitch on the package's "
        "clock; record one, or name it under [[inertial.channel]] in the setup"
    )
