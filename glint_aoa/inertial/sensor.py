"""The inertial package: a servo accelerometer along the model's longitudinal axis.

It senses the specific force along the axis: gravity's component, which is the angle, and
centrifugal acceleration, which is the bias. Equation numbers are those of the paper that the
project grew out of (aoa-dynamics-paper).

Signs: nose up is positive. The point of rotation of a mode with radius rho > 0 lies aft of the
sensor, so its centripetal acceleration points aft and the indicated angle falls.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glint_aoa.errors import InputError
from glint_aoa.setup import Inertial
from glint_aoa.units import STANDARD_GRAVITY

__all__ = [
    "SensorModel",
    "axial_specific_force",
    "bias_angle",
    "bias_from_acceleration",
    "bias_from_velocity",
    "indicated_angle",
    "unfiltered_output",
]

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SensorModel:
    """What the package indicates of the specific force, at rest (eq. 6 without vibration).

    Indicated = (scale + scale_per_kelvin dT) g sin(alpha + misalignment)
    + bias + bias_per_kelvin dT, with dT the temperature less the reference.

    Attributes
    ----------
    scale : float
        Indicated over true specific force at the reference temperature.
    bias : float
        Indicated where nothing is felt, at the reference temperature [m/s^2].
    misalignment : float
        Angle of the sensitive axis above model x [rad]. Its angle to the side is of second order
        for a model that does not roll.
    scale_per_kelvin : float
        Change of `scale` [1/K].
    bias_per_kelvin : float
        Change of `bias` [m/s^2/K].
    temperature : float
        Reference temperature [K]; the paper's package is kept at 160 degF, 344.3 K.
    """

    scale: float = 1.0
    bias: float = 0.0
    misalignment: float = 0.0
    scale_per_kelvin: float = 0.0
    bias_per_kelvin: float = 0.0
    temperature: float = 344.261

    @classmethod
    def from_setup(cls, inertial: Inertial) -> "SensorModel":
        """Take the model that the setup states; an ideal package if it states none."""
        return cls(**inertial.sensor.model_dump())

    def indicated(self, angle: ArrayLike, *, temperature: ArrayLike | None = None) -> _Floats:
        """Give what the package indicates of an angle at rest.

        Parameters
        ----------
        angle : array_like
            Pitch angle alpha [rad].
        temperature : array_like, optional
            Of the package [K]; the reference if not given.

        Returns
        -------
        ndarray
            Indicated specific force [m/s^2].
        """
        scale, bias = self._at(temperature)
        along = axial_specific_force(np.asarray(angle, np.float64) + self.misalignment)
        return np.asarray(scale * along + bias)

    def specific_force(
        self, indicated: ArrayLike, *, temperature: ArrayLike | None = None
    ) -> _Floats:
        """Turn what the package indicates into the specific force along model x.

        The inverse of `indicated`: scale and bias are taken out, and the sensitive axis is turned
        into the model's. Under vibration the turn is exact for what gravity does; of transverse
        accelerations, which a misaligned package senses too, nothing is taken out: they have no
        mean.

        Parameters
        ----------
        indicated : array_like
            Indicated specific force [m/s^2].
        temperature : array_like, optional
            Of the package [K]; the reference if not given.

        Returns
        -------
        ndarray
            Specific force along model +x [m/s^2]; unchanged for an ideal package.
        """
        scale, bias = self._at(temperature)
        along = (np.asarray(indicated, np.float64) - bias) / scale
        if self.misalignment == 0:
            return np.asarray(along)
        across = np.sqrt(np.maximum(STANDARD_GRAVITY**2 - along**2, 0.0))
        turned = along * np.cos(self.misalignment) - across * np.sin(self.misalignment)
        return np.asarray(turned)

    def angle(self, indicated: ArrayLike, *, temperature: ArrayLike | None = None) -> _Floats:
        """Solve for the pitch angle at rest [rad]; NaN beyond the range of gravity."""
        return indicated_angle(self.specific_force(indicated, temperature=temperature))

    def _at(self, temperature: ArrayLike | None) -> tuple[_Floats, _Floats]:
        warmer = np.zeros(())
        if temperature is not None:
            warmer = np.asarray(temperature, np.float64) - self.temperature
        return (
            np.asarray(self.scale + self.scale_per_kelvin * warmer),
            np.asarray(self.bias + self.bias_per_kelvin * warmer),
        )


def indicated_angle(specific_force: ArrayLike) -> _Floats:
    """Turn the axial specific force into the angle that the package indicates.

    alpha = asin(A / g), the static part of eq. 6 solved for the angle. Unbiased at rest only.

    Parameters
    ----------
    specific_force : array_like
        Specific force A along model +x [m/s^2].

    Returns
    -------
    ndarray
        Indicated angle [rad], nose up positive; NaN where abs(A) exceeds g.
    """
    ratio = np.asarray(specific_force, np.float64) / STANDARD_GRAVITY
    return np.arcsin(np.where(np.abs(ratio) <= 1.0, ratio, np.nan))


def axial_specific_force(angle: ArrayLike) -> _Floats:
    """Turn an indicated angle into the axial specific force behind it, A = g sin(alpha).

    Parameters
    ----------
    angle : array_like
        Indicated angle [rad].

    Returns
    -------
    ndarray
        Specific force along model +x [m/s^2].
    """
    return STANDARD_GRAVITY * np.sin(np.asarray(angle, np.float64))


def unfiltered_output(
    angle: float, time_s: ArrayLike, *, velocity: float, frequency_hz: float, radius_m: float
) -> _Floats:
    """Give the package's output before its filter, for one mode in simple harmonic motion.

    Eq. 6 without the longitudinal term, for a displacement that starts through zero (eq. 1):
    A(t) = g sin(alpha) - V^2 / (2 rho) (1 + cos(2 w t)). The second harmonic is as large as the
    bias.

    Parameters
    ----------
    angle : float
        Pitch angle alpha [rad].
    time_s : array_like
        Times [s].
    velocity : float
        Peak velocity V of the sensor [m/s].
    frequency_hz : float
        Frequency of the motion [Hz].
    radius_m : float
        Effective radius rho [m]; positive with the point of rotation aft of the sensor.

    Returns
    -------
    ndarray
        Specific force along model +x [m/s^2].
    """
    phase = 4 * np.pi * frequency_hz * np.asarray(time_s, np.float64)
    centrifugal = velocity**2 / (2 * _nonzero(radius_m)) * (1 + np.cos(phase))
    return np.asarray(STANDARD_GRAVITY * np.sin(angle) - centrifugal)


def bias_from_velocity(velocity: ArrayLike, radius_m: ArrayLike) -> float:
    """Mean bias of the axial specific force from peak velocities, eq. 7 and 8.

    -sum_r V_r^2 / (2 rho_r); exact for modes at different frequencies in steady motion.

    Parameters
    ----------
    velocity : array_like [mode]
        Peak velocity V_r of the sensor in each mode [m/s].
    radius_m : array_like [mode]
        Effective radius rho_r of each mode [m].

    Returns
    -------
    float
        Bias of the filtered output [m/s^2]; negative for positive radii.

    Raises
    ------
    InputError
        If a radius is zero.
    """
    squares = np.atleast_1d(np.asarray(velocity, np.float64)) ** 2
    return -float(np.sum(squares / (2 * _nonzero(radius_m))))


def bias_from_acceleration(
    acceleration: ArrayLike, frequency_hz: ArrayLike, radius_m: ArrayLike
) -> float:
    """Mean bias of the axial specific force from peak tangential accelerations, eq. 9.

    -sum_r A_r^2 / (2 w_r^2 rho_r).

    Parameters
    ----------
    acceleration : array_like [mode]
        Peak tangential acceleration A_r of the sensor in each mode [m/s^2].
    frequency_hz : array_like [mode]
        Frequency of each mode [Hz].
    radius_m : array_like [mode]
        Effective radius rho_r of each mode [m].

    Returns
    -------
    float
        Bias of the filtered output [m/s^2].

    Raises
    ------
    InputError
        If a radius is zero.
    """
    circular = 2 * np.pi * np.asarray(frequency_hz, np.float64)
    return bias_from_velocity(np.asarray(acceleration, np.float64) / circular, radius_m)


def bias_angle(bias: ArrayLike, angle: ArrayLike) -> _Floats:
    """Turn a bias of the specific force into one of the indicated angle, to first order.

    d alpha = dA / (g cos(alpha)): -V^2 / (2 rho g cos(alpha)) for one mode. At 0.2 deg of bias
    and 20 deg of pitch the neglected part is 0.0001 deg.

    Parameters
    ----------
    bias : array_like
        Bias of the axial specific force [m/s^2].
    angle : array_like
        Pitch angle alpha [rad].

    Returns
    -------
    ndarray
        Bias of the indicated angle [rad].
    """
    cosine = np.cos(np.asarray(angle, np.float64))
    return np.asarray(bias, np.float64) / (STANDARD_GRAVITY * cosine)


def _nonzero(radius_m: ArrayLike) -> _Floats:
    radius = np.asarray(radius_m, np.float64)
    if np.any(radius == 0):
        raise InputError("radius_m is 0, but a mode has a point of rotation; give its distance")
    return radius
