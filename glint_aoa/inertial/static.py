"""The angle of a model at rest, from the package alone."""

import numpy as np

from glint_aoa.inertial.package import calibrated_output
from glint_aoa.inertial.sensor import indicated_angle
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.setup import Inertial

__all__ = ["static_angle"]

_BATCHES = 8


def static_angle(
    record: AcquisitionRecord, inertial: Inertial | None = None
) -> tuple[float, float]:
    """Mean angle of a record without vibration, and how well it is known.

    Parameters
    ----------
    record : AcquisitionRecord
        With the package's unfiltered or filtered output.
    inertial : Inertial, optional
        The setup's inertial section: what is known of the package; an ideal one by default.

    Returns
    -------
    angle, std : float
        Mean angle and the 1-sigma standard deviation of that mean [deg], from the scatter of the
        means of eight equal parts of the record, so that slow noise counts. The package's static
        accuracy is not in it.

    Raises
    ------
    RecordingError
        If the record holds no package output, or one that is not finite.
    """
    package = calibrated_output(record, inertial or Inertial())
    angle = np.degrees(indicated_angle(package.specific_force))
    parts = np.array([part.mean() for part in np.array_split(angle, min(_BATCHES, angle.size))])
    std = parts.std(ddof=1) / np.sqrt(parts.size) if parts.size > 1 else np.nan
    return float(angle.mean()), float(std)
