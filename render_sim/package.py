"""The inertial package: a servo-accelerometer along the model axis and its two outputs.

Both outputs are given as A / g, the accelerometer's reading over standard gravity; the indicated
angle is its arcsine. The package is ideal but for its two filters, unless errors are stated; noise
and digits are the acquisition's.

Of the specific force f in model axes the accelerometer senses

    A = (k + k_T dT) (u . f + c_y f_y + c_z f_z) + b + b_T dT

with u its axis, model x turned nose up and then to port, c the cross-axis sensitivities, and dT the
package's temperature less the one at which scale k and bias b hold.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy.signal
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from glint_aoa.setup import InertialFilter, Section, positive, quantity
from glint_aoa.units import STANDARD_GRAVITY

__all__ = ["InertialPackage", "PackageOutputs", "package_outputs", "sensed_force"]

_SETTLING_CYCLES = 3.2

_Angle = Annotated[float, quantity("rad"), Field(gt=-1.0, lt=1.0)]
_Kelvin = Annotated[float, quantity("K"), positive]
_Acceleration = Annotated[float, quantity("m/s^2"), Field(allow_inf_nan=False)]
_PerKelvin = Annotated[float, quantity("1/K"), Field(allow_inf_nan=False)]
_AccelerationPerKelvin = Annotated[float, quantity("m/s^2/K"), Field(allow_inf_nan=False)]
_KelvinRate = Annotated[float, quantity("K/s"), Field(allow_inf_nan=False)]
_Share = Annotated[float, Field(strict=True, gt=-1.0, lt=1.0)]


class InertialPackage(Section):
    """Filters and errors of the package; SI units and radians."""

    filter: InertialFilter = Field(
        default_factory=InertialFilter,
        description="low-pass of the filtered output, causal; the paper's passes 0 to 0.4 Hz",
    )
    bandwidth: Annotated[float, quantity("Hz"), Field(gt=0, le=1000)] = Field(
        300.0, description="-3 dB of the servo ahead of both outputs, second-order Butterworth"
    )
    scale: Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)] = Field(
        1.0, description="indicated over true specific force"
    )
    bias: _Acceleration = Field(0.0, description="indicated where nothing is felt")
    misalignment: _Angle = Field(0.0, description="sensitive axis above model x")
    side_misalignment: _Angle = Field(0.0, description="sensitive axis to port of model x")
    cross_axis: tuple[_Share, _Share] = Field(
        (0.0, 0.0), description="sensitivity to specific force along model y and z"
    )
    scale_per_kelvin: _PerKelvin = Field(0.0, description="change of the scale with temperature")
    bias_per_kelvin: _AccelerationPerKelvin = Field(
        0.0, description="change of the bias with temperature"
    )
    reference_temperature: _Kelvin = Field(
        344.261, description="at which scale and bias hold; the paper's package is kept at 160 degF"
    )
    temperature: _Kelvin | None = Field(
        None, description="of the package at the campaign's start; recorded where it is given"
    )
    warming: _KelvinRate = Field(0.0, description="rate at which the temperature changes")

    @property
    def settling_s(self) -> float:
        """Time after which the filters have forgotten their start to one part in a million [s]."""
        return _SETTLING_CYCLES / self.filter.cutoff

    def later(self, elapsed_s: float) -> "InertialPackage":
        """Return the package as it is a time after the campaign's start [s]."""
        if self.temperature is None:
            return self
        return self.model_copy(update={"temperature": self.temperature + self.warming * elapsed_s})

    def temperature_at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the package's temperature [K] at times after the trigger [s]."""
        start = self.reference_temperature if self.temperature is None else self.temperature
        rate = 0.0 if self.temperature is None else self.warming
        return np.asarray(start + rate * time_s)


@dataclass(frozen=True, eq=False)
class PackageOutputs:
    """The package's outputs before sampling, as A / g [sample]."""

    unfiltered: NDArray[np.float64]
    filtered: NDArray[np.float64]


def sensed_force(
    force: NDArray[np.float64], package: InertialPackage, *, temperature_k: ArrayLike
) -> NDArray[np.float64]:
    """Return what the accelerometer senses of the specific force.

    Parameters
    ----------
    force : ndarray [..., 3]
        Specific force in model axes at the package [m/s^2].
    package : InertialPackage
        Its errors.
    temperature_k : array_like
        The package's temperature [K], broadcast against the forces.

    Returns
    -------
    ndarray [...]
        Sensed specific force [m/s^2]; its x component for a package without errors.
    """
    up, port = package.misalignment, package.side_misalignment
    across_y, across_z = package.cross_axis
    warmer = np.asarray(temperature_k, np.float64) - package.reference_temperature
    along = (
        np.cos(up) * np.cos(port) * force[..., 0]
        + (np.cos(up) * np.sin(port) + across_y) * force[..., 1]
        + (np.sin(up) + across_z) * force[..., 2]
    )
    scale = package.scale + package.scale_per_kelvin * warmer
    return np.asarray(scale * along + package.bias + package.bias_per_kelvin * warmer)


def package_outputs(
    axial_force: NDArray[np.float64],
    *,
    rest_force: float,
    rate_hz: float,
    package: InertialPackage | None = None,
) -> PackageOutputs:
    """Pass what the accelerometer senses through its servo and filter.

    Parameters
    ----------
    axial_force : ndarray [sample]
        Sensed specific force [m/s^2].
    rest_force : float
        That of the motionless model [m/s^2], ideally g sin alpha; the filters start settled on it.
    rate_hz : float
        Samples a second [Hz].
    package : InertialPackage, optional
        The filters.

    Returns
    -------
    PackageOutputs
        Of the length of `axial_force`; valid from `InertialPackage.settling_s` on.
    """
    package = package or InertialPackage()
    servo = scipy.signal.butter(2, package.bandwidth, fs=rate_hz, output="sos")
    vibration = scipy.signal.sosfilt(servo, axial_force - rest_force)
    slow = scipy.signal.sosfilt(_low_pass(package.filter, rate_hz), vibration)
    return PackageOutputs(
        unfiltered=(rest_force + vibration) / STANDARD_GRAVITY,
        filtered=(rest_force + slow) / STANDARD_GRAVITY,
    )


def _low_pass(low_pass: InertialFilter, rate_hz: float) -> NDArray[np.float64]:
    if low_pass.kind == "bessel":
        sections = scipy.signal.bessel(
            low_pass.order, low_pass.cutoff, norm="mag", fs=rate_hz, output="sos"
        )
    else:
        sections = scipy.signal.butter(low_pass.order, low_pass.cutoff, fs=rate_hz, output="sos")
    return np.asarray(sections, np.float64)
