"""The package's output of a record, with what the setup knows of the package taken out."""

from dataclasses import replace

import numpy as np

from glint_aoa.inertial.channels import PackageOutput, package_output
from glint_aoa.inertial.sensor import SensorModel
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.temperature import is_of_tunnel
from glint_aoa.setup import Inertial

__all__ = ["calibrated_output"]


def calibrated_output(record: AcquisitionRecord, inertial: Inertial) -> PackageOutput:
    """Take the package's output and apply scale, bias, misalignment and temperature terms.

    Parameters
    ----------
    record : AcquisitionRecord
        As for `package_output`; its first channel of quantity temperature that is not the tunnel's
        (by its name) is the package's, and its mean counts. Without one the package is taken to be
        at its reference temperature.
    inertial : Inertial
        The setup's inertial section.

    Returns
    -------
    PackageOutput
        Specific force along model x [m/s^2]; as recorded if the setup states an ideal package.

    Raises
    ------
    RecordingError
        As for `package_output`, or if the temperature's unit is no temperature.
    """
    package, model = package_output(record), SensorModel.from_setup(inertial)
    if model == SensorModel(temperature=model.temperature):
        return package
    channels = [each for each in record.with_quantity("temperature") if not is_of_tunnel(each)]
    depends = model.scale_per_kelvin != 0 or model.bias_per_kelvin != 0
    temperature = float(np.nanmean(channels[0].values("K"))) if channels and depends else None
    force = model.specific_force(package.specific_force, temperature=temperature)
    return replace(package, specific_force=force)
