"""The inertial package: a servo-accelerometer along the model axis and its two outputs.

Both outputs are given as A / g, the accelerometer's reading over standard gravity; the indicated
angle is its arcsine. The package is ideal but for its two filters; noise and digits are the
acquisition's.
"""

from dataclasses import dataclass, field

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.setup import InertialFilter
from glint_aoa.units import STANDARD_GRAVITY

__all__ = ["InertialPackage", "PackageOutputs", "package_outputs"]

_SETTLING_CYCLES = 3.2


@dataclass(frozen=True)
class InertialPackage:
    """Filters of the package.

    Attributes
    ----------
    filter : InertialFilter
        Low-pass of the filtered output, causal; the paper's passes 0 to 0.4 Hz.
    bandwidth_hz : float
        -3 dB frequency of the servo (second-order Butterworth) ahead of both outputs [Hz]; the
        paper's unfiltered output passes 0 to 300 Hz.
    """

    filter: InertialFilter = field(default_factory=InertialFilter)
    bandwidth_hz: float = 300.0

    @property
    def settling_s(self) -> float:
        """Time after which the filters have forgotten their start to one part in a million [s]."""
        return _SETTLING_CYCLES / self.filter.cutoff


@dataclass(frozen=True, eq=False)
class PackageOutputs:
    """The package's outputs before sampling, as A / g [sample]."""

    unfiltered: NDArray[np.float64]
    filtered: NDArray[np.float64]


def package_outputs(
    axial_force: NDArray[np.float64],
    *,
    rest_force: float,
    rate_hz: float,
    package: InertialPackage | None = None,
) -> PackageOutputs:
    """Pass the axial specific force at the package through its servo and filter.

    Parameters
    ----------
    axial_force : ndarray [sample]
        Specific force along model +x at the package [m/s^2].
    rest_force : float
        That of the motionless model [m/s^2], g sin alpha; the filters start settled on it.
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
    servo = scipy.signal.butter(2, package.bandwidth_hz, fs=rate_hz, output="sos")
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
