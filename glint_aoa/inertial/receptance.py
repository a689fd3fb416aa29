"""Separate the modes of one plane under one broadband force: joint fit of their receptances.

A single shaker drives all modes with the same force, so at every frequency their accelerations
stand in a fixed complex ratio and add up as amplitudes, not as powers:
A(f) = F(f) sum_r c_r f^2 / (f_r^2 - f^2 + 2j z_r f_r f). Where the force is flat over the modes,
frequencies, dampings and signed strengths c_r follow together from the averaged spectrum of one
accelerometer; each mode's part of the signal then is a known complex fraction of the whole.

The model is used only where it explains the spectrum to within the scatter of the spectrum itself.
A sine or independent forces do not pass that test.
"""

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.optimize
import scipy.sparse
import scipy.special
from numpy.typing import NDArray

__all__ = ["Receptances", "fit_receptances"]

_Floats = NDArray[np.float64]
_Complex = NDArray[np.complex128]

_FINE = 4  # points to a bin of the spectrum, for what its window does to sharp resonances
_MOST_MODES = 4  # signs are tried out: 2^(n - 1) fits
_DAMPING, _LOG_DAMPING_STD = 0.01, 0.7  # of structures without air: 0.5 to 2 per cent
_PEAK_STD = 0.02  # of a resonance from its peak, relative
_LEAST_CONTRAST, _MOST_CONTRAST = 10.0, 1e6  # peak over median: noise below, a line beyond
_WORST_FIT = 1.1  # rms deviation of the log spectrum over its expected scatter
_LEAST_DAMPING, _MOST_DAMPING = 0.0015, 0.06  # a line and a hump, no resonances
_FARTHEST = 0.06  # of a resonance from its peak: it has gone to explain another
_STANDS_OUT = 4.0  # standard deviations of the strength of a mode that is credited
_QUIET = 0.01  # of the modes' summed power: keeps fractions finite where modes cancel


@dataclass(frozen=True, eq=False)
class Receptances:
    """Modes of a plane under one force.

    Attributes
    ----------
    frequency_hz, damping, strength, strength_std : ndarray [mode]
        Natural frequencies [Hz], fractions of critical damping, and signed strengths with their
        standard deviations, whose square is the spectrum's unit.
    floor : float
        White floor of the acceleration, in the spectrum's unit.
    misfit : float
        Rms deviation of the log spectrum over its expected scatter; 1 for a perfect model.
    """

    frequency_hz: _Floats
    damping: _Floats
    strength: _Floats
    strength_std: _Floats
    floor: float
    misfit: float

    @property
    def is_plausible(self) -> bool:
        """Whether the model explains the spectrum with resonances, not with lines or humps."""
        narrow, wide = self.damping < _LEAST_DAMPING, self.damping > _MOST_DAMPING
        return self.misfit <= _WORST_FIT and not bool(np.any(narrow | wide))

    @property
    def credited(self) -> NDArray[np.bool_]:
        """Whether each mode's strength stands out from its uncertainty."""
        return np.asarray(np.abs(self.strength) > _STANDS_OUT * self.strength_std)

    def fraction(self, index: int, frequency_hz: _Floats) -> _Complex:
        """Complex fraction [frequency] of the acceleration that is a mode's."""
        parts = self.strength[:, None] * _shapes(self.frequency_hz, self.damping, frequency_hz)
        total = parts.sum(axis=0)
        summed = (np.abs(parts) ** 2).sum(axis=0)
        power = np.abs(total) ** 2 + _QUIET * summed + self.floor
        return np.asarray(parts[index] * total.conj() / power, np.complex128)


def fit_receptances(
    bins_hz: _Floats, power: _Floats, averages: float, peaks_hz: list[float]
) -> Receptances | None:
    """Fit modes under one flat force to an averaged spectrum.

    Parameters
    ----------
    bins_hz : ndarray [bin]
        Frequencies [Hz], evenly spaced.
    power : ndarray [bin]
        Power of the acceleration, averaged periodogram with a Hann window.
    averages : float
        Independent periodograms averaged.
    peaks_hz : list of float [mode]
        Where the resonances are, to a few per cent [Hz].

    Returns
    -------
    Receptances or None
        None if the model does not explain the spectrum.
    """
    contrast = float(np.max(power) / np.median(power))
    if len(peaks_hz) > _MOST_MODES or not _LEAST_CONTRAST < contrast < _MOST_CONTRAST:
        return None
    problem = _Problem.of(bins_hz, power, averages, peaks_hz)
    for signs in itertools.product((1.0, -1.0), repeat=len(peaks_hz) - 1):
        found = problem.solve(np.array([1.0, *signs]))
        stray = np.abs(found.frequency_hz / problem.peaks - 1) > _FARTHEST
        if found.is_plausible and not stray.any():
            return found
    return None


@dataclass(frozen=True, eq=False)
class _Problem:
    log_power: _Floats
    scatter: float
    fine_hz: _Floats
    window: Any  # sparse [bin, fine]
    peaks: _Floats
    scale: _Floats  # typical strength of each mode

    @classmethod
    def of(
        cls, bins_hz: _Floats, power: _Floats, averages: float, peaks_hz: list[float]
    ) -> "_Problem":
        step = bins_hz[1] - bins_hz[0]
        low, high = bins_hz[0] - 2 * step, bins_hz[-1] + 2 * step
        fine = np.linspace(low, high, _FINE * (bins_hz.size + 3) + 1)
        away = (bins_hz[:, None] - fine) / step
        dense = np.where(np.abs(away) < 2, _hann_power(away), 0.0)
        window = scipy.sparse.csr_array(dense / dense.sum(axis=1, keepdims=True))
        peaks = np.asarray(peaks_hz)
        at_peak = np.interp(peaks, bins_hz, power)
        expected = scipy.special.digamma(averages) - np.log(averages)
        return cls(
            log_power=np.log(power) - float(expected),
            scatter=float(np.sqrt(scipy.special.polygamma(1, averages))),
            fine_hz=fine,
            window=window,
            peaks=peaks,
            scale=np.sqrt(at_peak) * 0.04,
        )

    def solve(self, signs: _Floats) -> Receptances:
        n = self.peaks.size
        start = self._start.copy()
        start[2 * n : 3 * n] = signs
        found = scipy.optimize.least_squares(
            self.residual, start, jac=self.jacobian, method="lm", ftol=1e-4, xtol=1e-4, max_nfev=40
        )
        x = found.x
        slopes = np.asarray(found.jac)
        covariance = np.linalg.pinv(slopes.T @ slopes)
        strengths = slice(2 * n, 3 * n)
        natural, damping = self._resonances(x)
        return Receptances(
            frequency_hz=natural,
            damping=damping,
            strength=x[strengths] * self.scale,
            strength_std=np.sqrt(np.diag(covariance)[strengths]) * self.scale,
            floor=float(np.exp(x[-1])),
            misfit=float(np.sqrt(np.mean(found.fun[: self.log_power.size] ** 2))),
        )

    def residual(self, x: _Floats) -> _Floats:
        fit = (np.log(self._model(x)[0]) - self.log_power) / self.scatter
        return np.concatenate([fit, self._prior @ (x - self._start)])

    def jacobian(self, x: _Floats) -> _Floats:
        model, total, parts, shapes = self._model(x)
        natural, damping = self._resonances(x)
        f, fr, z = self.fine_hz, natural[:, None], damping[:, None]
        cross = 2j * z * fr * f
        denominator = fr**2 - f**2 + cross
        slopes = np.vstack(
            [
                -parts * (2 * fr**2 + cross) / denominator,
                -parts * cross / denominator,
                shapes * self.scale[:, None],
            ]
        )
        fine = np.vstack(
            [2 * (slopes * total.conj()).real, np.full(f.size, np.exp(min(x[-1], 100.0)))]
        )
        fit = (self.window @ fine.T) / model[:, None] / self.scatter
        return np.vstack([fit, self._prior])

    def _resonances(self, x: _Floats) -> tuple[_Floats, _Floats]:
        """Natural frequencies [Hz] and dampings; a step of the search too far is cut short."""
        n = self.peaks.size
        return self.peaks * np.exp(np.clip(x[:n], -1, 1)), np.exp(np.clip(x[n : 2 * n], -14, 2))

    @cached_property
    def _start(self) -> _Floats:
        """Parameters: log frequency over peak, log damping, strength over scale; log floor."""
        n = self.peaks.size
        floor = float(np.min(self.log_power))
        return np.concatenate([np.zeros(n), np.full(n, np.log(_DAMPING)), np.zeros(n), [floor]])

    @cached_property
    def _prior(self) -> _Floats:
        """Tell what is known before of frequencies and dampings, over its standard deviation."""
        n = self.peaks.size
        rows = np.zeros((2 * n, 3 * n + 1))
        rows[:n, :n] = np.eye(n) / _PEAK_STD
        rows[n:, n : 2 * n] = np.eye(n) / _LOG_DAMPING_STD
        return rows

    def _model(self, x: _Floats) -> tuple[_Floats, _Complex, _Complex, _Complex]:
        n = self.peaks.size
        shapes = _shapes(*self._resonances(x), self.fine_hz)
        parts = (x[2 * n : 3 * n] * self.scale)[:, None] * shapes
        total = parts.sum(axis=0)
        return self.window @ (np.abs(total) ** 2 + np.exp(min(x[-1], 100.0))), total, parts, shapes


def _shapes(natural_hz: _Floats, damping: _Floats, frequency_hz: _Floats) -> _Complex:
    """Acceleration per unit of force [mode, frequency] of single degrees of freedom."""
    fr, z, f = natural_hz[:, None], damping[:, None], np.asarray(frequency_hz)
    return np.asarray(f**2 / (fr**2 - f**2 + 2j * z * fr * f), np.complex128)


def _hann_power(bins_away: _Floats) -> _Floats:
    """Power response of the Hann window to a line so many bins away."""
    near = np.abs(np.abs(bins_away) - 1) < 1e-6
    safe = np.where(near, 0.5, bins_away)
    response = np.sinc(safe) / (1 - safe**2)
    return np.asarray(np.where(near, 0.5, response) ** 2)
