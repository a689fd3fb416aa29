"""The angle of a model at rest, from the package alone."""

import numpy as np

from glint_aoa.inertial.channels import package_output
from glint_aoa.inertial.sensor import indicated_angle
from glint_aoa.records.acquisition import AcquisitionRecord

__all__ = ["static_angle"]

_BATCHES = 8


def static_angle(record: AcquisitionRecord) -> tuple[float, float]:
    """Mean indicated angle of a record without vibration, and how well it is known.

    Parameters
    ----------
    record : AcquisitionRecord
        With the package's unfiltered or filtered output.

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
    angle = np.degrees(indicated_angle(package_output(record).specific_force))
    parts = np.array([part.mean() for part in np.array_split(angle, min(_BATCHES, angle.size))])
    std = parts.std(ddof=1) / np.sqrt(parts.size) if parts.size > 1 else np.nan
    return float(angle.mean()), float(std)
