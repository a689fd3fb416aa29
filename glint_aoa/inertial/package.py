"""The package's output of a record, with what the setup knows of the package taken out."""

from dataclasses import replace

import numpy as np

from glint_aoa.errors import RecordingError
from glint_aoa.inertial.channels import PackageOutput, package_output
from glint_aoa.inertial.sensor import SensorModel
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.setup import Inertial

__all__ = ["calibrated_output"]

_KELVIN = {  # unit: factor and offset to kelvins
    "K": (1.0, 0.0),
    "kelvin": (1.0, 0.0),
    "degC": (1.0, 273.15),
    "degF": (5 / 9, 459.67 * 5 / 9),
    "degR": (5 / 9, 0.0),
}


def calibrated_output(record: AcquisitionRecord, inertial: Inertial) -> PackageOutput:
    """Take the package's output and apply scale, bias, misalignment and temperature terms.

    Parameters
    ----------
    record : AcquisitionRecord
        As for `package_output`; its first channel of quantity temperature is the package's, and
        its mean counts. Without one the package is taken to be at its reference temperature.
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
    channels = record.with_quantity("temperature")[:1]
    depends = model.scale_per_kelvin != 0 or model.bias_per_kelvin != 0
    temperature = _mean_kelvin(record, channels[0]) if channels and depends else None
    force = model.specific_force(package.specific_force, temperature=temperature)
    return replace(package, specific_force=force)


def _mean_kelvin(record: AcquisitionRecord, channel: Channel) -> float:
    if channel.units not in _KELVIN:
        raise RecordingError(
            f"{record.name}: channel {channel.name} is in {channel.units or 'no unit'}, expected "
            f"a temperature in {', '.join(_KELVIN)}; correct units in the record or the setup"
        )
    factor, offset = _KELVIN[channel.units]
    mean = float(np.nanmean(np.asarray(channel.samples, np.float64) * channel.scale))
    return factor * mean + offset
