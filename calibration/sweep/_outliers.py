"""Points of a sweep that do not lie on the curve of the others."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibration.sweep._polynomial import fit_polynomial

__all__ = ["ScaledPoints", "find_outliers"]

Floats = NDArray[np.float64]

_SIGNIFICANCE = 0.01  # chance that a sweep without an outlier is said to have one
_SUSPECT = 2.5  # standard deviations off the resistant curve
_MOST = 0.2  # of the points
_LEAST_POINTS = 6  # of fewer, all but one lie on some curve by chance too often
_RESISTANT = 0.3  # standard deviations beyond which a point counts by its distance only
_MAD_TO_STD = 1.4826


class ScaledPoints(NamedTuple):
    """Points whose optical angle is scaled to -1 ... 1; arrays [point].

    The first four are what `calibration.sweep._polynomial.fit_polynomial` takes.
    """

    t: Floats
    st: Floats
    y: Floats
    sy: Floats
    centre_deg: float
    half_deg: float


def find_outliers(points: ScaledPoints, degree: int) -> dict[int, str]:
    """Find points that lie off the curve through the others by more than chance explains.

    A curve that few wrong points hardly move (nearly least absolute deviations) makes some
    suspects, a fifth of the points at most. Then each suspect is held against the least-squares
    curve of all points that are not suspect: its distance over the standard deviation of that
    distance, the curve's included. The one that fits best is taken back if it fits, and the rest
    are held against the new curve, until all that are left out are significant.

    Parameters
    ----------
    points : ScaledPoints
        The points.
    degree : int
        Degree of the curve, the highest that leaves points to spare; below 1 nothing is tested.

    Returns
    -------
    dict of int to str
        Number of each outlying point, and how far it lies off.

    Notes
    -----
    The limit is that of the largest of all points at 1 % (Bonferroni), from the normal
    distribution where the stated uncertainties explain the scatter of the others, from Student's
    where their scatter is taken instead (Cook and Weisberg, *Residuals and Influence in
    Regression*, 1982, section 2.2). Fewer than six points are not tested.
    """
    if degree < 1 or points.t.size < _LEAST_POINTS:
        return {}
    out = _suspects(points, degree)
    while out:
        tested = {number: _Test.of(points, degree, out, number) for number in out}
        best = min(out, key=lambda number: tested[number].ratio)
        if tested[best].ratio >= 1:
            return {number: tested[number].words for number in sorted(out)}
        out.remove(best)
    return {}


def _suspects(points: ScaledPoints, degree: int) -> list[int]:
    """Points that lie off the resistant curve, the worst ones first."""
    t, st, y, sy, *_ = points
    fit = fit_polynomial(t, st, y, sy, degree, loss="soft_l1", loss_scale=_RESISTANT)
    distance = np.abs(_off(fit.coefficients, points)) / _noise(fit.coefficients, points)
    share = np.sqrt(t.size / (t.size - degree - 1))
    scale = max(1.0, _MAD_TO_STD * float(np.median(distance)) * share)
    worst = np.argsort(-distance)[: int(_MOST * t.size)]
    return [int(number) for number in worst if distance[number] > _SUSPECT * scale]


class _Test(NamedTuple):
    """A point held against the curve of others: its distance over the limit, and the words."""

    ratio: float
    words: str

    @classmethod
    def of(cls, points: ScaledPoints, degree: int, out: list[int], number: int) -> "_Test":
        t, st, y, sy, *_ = points
        others = np.setdiff1d(np.arange(t.size), out)
        fit = fit_polynomial(t[others], st[others], y[others], sy[others], degree)
        freedom = others.size - degree - 1
        explained = special.chdtrc(freedom, fit.chi_square) >= _SIGNIFICANCE
        tail = _SIGNIFICANCE / (2 * t.size)
        limit = -(special.ndtri(tail) if explained else special.stdtrit(freedom, tail))
        scale = 1.0 if explained else np.sqrt(fit.chi_square / freedom)
        powers = t[number] ** np.arange(degree + 1)
        curve = np.sqrt(powers @ fit.covariance @ powers)
        noise = scale * np.hypot(_noise(fit.coefficients, points)[number], curve)
        off = _off(fit.coefficients, points)[number]
        return cls(
            float(abs(off) / (limit * noise)),
            f"{abs(off):.4f} deg off the curve of the other points, {abs(off) / noise:.1f} times "
            f"what noise explains (limit {limit:.1f})",
        )


def _off(coefficients: Floats, points: ScaledPoints) -> Floats:
    return points.y - np.polynomial.polynomial.polyval(points.t, coefficients)


def _noise(coefficients: Floats, points: ScaledPoints) -> Floats:
    slopes = np.polynomial.polynomial.polyder(coefficients)
    slope = np.polynomial.polynomial.polyval(points.t, slopes)
    return np.hypot(points.sy, slope * points.st)
