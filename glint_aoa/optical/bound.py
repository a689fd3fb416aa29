"""The Cramer-Rao bound: the least noise that any unbiased estimator of the line can have."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["centre_information", "pixel_variance", "slope_std_bound"]


def pixel_variance(
    grey: ArrayLike, *, read_noise: float, electrons_per_grey: float
) -> NDArray[np.float64]:
    """Variance of a pixel: shot noise, read noise and rounding to whole grey levels.

    Parameters
    ----------
    grey : array_like
        Expected grey level above black.
    read_noise : float
        Standard deviation of the read noise [grey levels].
    electrons_per_grey : float
        Electrons behind one grey level.

    Returns
    -------
    ndarray
        Variance [grey levels^2], in the shape of `grey`.
    """
    shot = np.asarray(grey, np.float64) / electrons_per_grey
    return shot + read_noise**2 + 1 / 12


def centre_information(gradient: ArrayLike, variance: ArrayLike) -> NDArray[np.float64]:
    """Fisher information on the line's centre in each column.

    Parameters
    ----------
    gradient : array_like, shape (line, column)
        Change of the expected grey level as the centre moves by one line [grey levels / line].
    variance : array_like, shape (line, column)
        Variance of each pixel [grey levels^2].

    Returns
    -------
    ndarray, shape (column,)
        J = sum over lines of gradient^2 / variance [1 / line^2].
    """
    gradient = np.asarray(gradient, np.float64)
    information: NDArray[np.float64] = (gradient**2 / np.asarray(variance)).sum(axis=0)
    return information


def slope_std_bound(information: ArrayLike, u: ArrayLike) -> float:
    """Least standard deviation of the slope of a line fitted to the columns' centres.

    Parameters
    ----------
    information : array_like, shape (column,)
        From `centre_information`.
    u : array_like, shape (column,)
        Columns that are used [pixels].

    Returns
    -------
    float
        1 / sqrt(sum J (u - u_mean)^2), u_mean weighted by J [lines / column].
    """
    information, u = np.asarray(information, np.float64), np.asarray(u, np.float64)
    mean = (information * u).sum() / information.sum()
    return float(1 / np.sqrt((information * (u - mean) ** 2).sum()))
