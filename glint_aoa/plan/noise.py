"""What limits the angle: noise of the pixels, vibration within an exposure and between fields."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from glint_aoa.optical.bound import centre_information, pixel_variance
from glint_aoa.setup import PlanVibration

__all__ = ["LineProfile", "MeanNoise", "mean_noise", "smear_rms"]

_Array = NDArray[np.float64]

_REACH = 5.0  # standard deviations of a glint on either side of its middle
_LEAST_CYCLES = 1.5  # a record; what is seen as slower is taken for a drift
_STANDS_STILL = 1e-12


@dataclass(frozen=True, eq=False)
class LineProfile:
    """Glints that are normal curves across the lines, integrated over the pixels.

    All arrays have one shape.

    Attributes
    ----------
    sigma : ndarray
        Standard deviation [lines].
    flux : ndarray
        Sum over the lines [grey levels * lines].
    background : float
        Grey level beside it, above black.
    """

    sigma: _Array
    flux: _Array
    background: float

    @property
    def peak(self) -> _Array:
        """Grey level of a pixel on its middle, above black."""
        share = 2 * ndtr(0.5 / self.sigma) - 1
        return np.asarray(self.background + self.flux * share)

    def information(self, row: ArrayLike, *, read_noise: float, electrons: float) -> _Array:
        """Return the Fisher information on the centre [1 / line^2].

        Parameters
        ----------
        row : array_like
            Where the centres lie [lines].
        read_noise : float
            Standard deviation of the read noise [grey levels].
        electrons : float
            Electrons behind a grey level.
        """
        reach = int(np.ceil(_REACH * np.nanmax(self.sigma, initial=0.5))) + 1
        line = np.arange(-reach, reach + 1.0).reshape(-1, *(1,) * self.sigma.ndim)
        place = np.asarray(row, np.float64)
        offset = line - (place - np.round(place))
        upper, lower = (offset + 0.5) / self.sigma, (offset - 0.5) / self.sigma
        grey = self.background + self.flux * (ndtr(upper) - ndtr(lower))
        slope = (np.exp(-0.5 * lower**2) - np.exp(-0.5 * upper**2)) / np.sqrt(2 * np.pi)
        variance = pixel_variance(grey, read_noise=read_noise, electrons_per_grey=electrons)
        return centre_information(self.flux * slope / self.sigma, variance)


def smear_rms(vibration: PlanVibration, exposure_s: float) -> float:
    r"""Return how far the pitch strays from its mean over the exposure, root mean square [rad].

    .. math:: \frac{A}{\sqrt 2} \sqrt{1 - \mathrm{sinc}^2(f T)}

    over all phases, for an amplitude A, a frequency f and an exposure T.
    """
    left = float(np.sinc(vibration.frequency * exposure_s))
    return vibration.amplitude * float(np.sqrt((1 - left**2) / 2))


@dataclass(frozen=True)
class MeanNoise:
    """What comes between the noise of one field and that of the mean of several.

    Attributes
    ----------
    from_noise : float
        Noise of the mean over that of one field.
    from_vibration : float
        What the vibration leaves in the mean, root mean square over its phase [rad].
    """

    from_noise: float
    from_vibration: float


def mean_noise(
    fields: int,
    *,
    rate_hz: float,
    exposure_s: float = 0.0,
    vibration: PlanVibration | None = None,
    fitted: bool = True,
) -> MeanNoise:
    r"""Predict the mean of the fields' angles while the model vibrates.

    A plain mean of N fields at a rate R keeps of a sine

    .. math:: \frac{A}{\sqrt 2} \left| \mathrm{sinc}(f T)
              \frac{\sin(\pi N f / R)}{N \sin(\pi f / R)} \right|

    (root mean square over its phase): all of it where f is a multiple of R, which the fields show
    as standing still. Where sine and mean are fitted together nothing of it is left, and the mean
    is noisier by what the two have in common (normal equations). Seen as slower than 1.5 cycles a
    record a sine is not told from the mean, and not fitted.

    Parameters
    ----------
    fields : int
        How many are averaged.
    rate_hz, exposure_s : float
        Field rate [Hz] and integration time [s].
    vibration : PlanVibration, optional
        The vibration.
    fitted : bool, optional
        Whether the sine is fitted with the mean, as the measurement does unless told otherwise.

    Returns
    -------
    MeanNoise
        For one sine of known frequency; a vibration whose amplitude wanders leaves more.
    """
    plain = 1 / np.sqrt(fields)
    if vibration is None:
        return MeanNoise(float(plain), 0.0)
    turn = np.pi * vibration.frequency / rate_hz
    cycles = vibration.frequency / rate_hz
    if fitted and fields * abs(cycles - round(cycles)) >= _LEAST_CYCLES:
        phase = 2 * turn * np.arange(fields)
        design = np.stack([np.ones(fields), np.cos(phase), np.sin(phase)], axis=1)
        return MeanNoise(float(np.sqrt(np.linalg.pinv(design.T @ design)[0, 0])), 0.0)
    kernel = 1.0
    if abs(np.sin(turn)) > _STANDS_STILL:
        kernel = float(np.sin(fields * turn) / (fields * np.sin(turn)))
    left = abs(kernel * np.sinc(vibration.frequency * exposure_s)) * vibration.amplitude
    return MeanNoise(float(plain), float(left / np.sqrt(2)))
