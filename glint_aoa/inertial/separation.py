"""Share the vibration of one plane out among its modes, frequency by frequency.

Why not one band-pass a mode: a mode's bias is its velocity squared over its effective radius, so
with a small radius the skirt of a strong neighbour that lies in the mode's band counts many times
over. Mode 3 of the paper's Table 1 has a radius of 5 mm, mode 1 one of 0.79 m: under random
excitation the skirt of mode 1 at 19.5 Hz, divided by 5 mm, exceeds the whole true bias.

The argument used here: away from its resonance, a mode under broadband force answers with the
known skirt of a single degree of freedom, whatever its damping, f^2 / (f^2 - f_r^2) in
acceleration. Between the resonances the measured spectrum is the sum of those skirts and a white
floor, so all skirts of a plane are found together, from bins outside all resonances, by maximum
likelihood for averaged periodograms (Whittle). A mode is then credited

* around its own resonance with the energy in excess of what the others' skirts bring there,
  provided that the excess stands out from its uncertainty;
* elsewhere with its part of the sum of the skirts.

The shares of all modes and of the floor add up to one in every bin, so no energy is counted
twice. Nothing is assumed about the shape of a resonance: a sine, a modulated sine and a free decay
are lines without skirts and are credited whole.

Where it fails: motion far from every resonance (a sine driven between two modes) cannot be
assigned by its frequency; two modes of one plane closer than their resonances are wide are split
half-way between them. Frequencies, damping and excitation are taken as steady over the record.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.inertial.modes import Mode
from glint_aoa.inertial.spectrum import PlaneSpectrum

__all__ = ["Share", "separate"]

_Floats = NDArray[np.float64]
_Mask = NDArray[np.bool_]

_CORE = 0.08  # half-width of a resonance over its frequency: skirts hold beyond for damping < 3 %
_CORE_BINS = 4  # at least, since a line's main lobe is two bins to either side
_SKIRT_STD = 0.15  # of a skirt carried under another resonance, relative: shape, coherence
_QUIET = 1e-12  # of the highest power: stands in for a floor where the signal has none
_EXCESS_STDS = 5.0  # an excess smaller than this many standard deviations is not credited


@dataclass(frozen=True, eq=False)
class Share:
    """What one mode has in the acceleration spectrum of its plane.

    Attributes
    ----------
    mode : Mode
        The mode.
    frequency_hz : float
        Where its resonance was found, or its nominal frequency if no peak stands out [Hz].
    credited : bool
        Whether its resonance stands out from the others' skirts.
    bins_hz : ndarray [bin]
        Frequencies of the shares [Hz].
    power : ndarray [bin]
        Fraction of the power in each bin that is the mode's.
    foreign : ndarray [bin]
        Fraction of the power around its resonance that is somebody else's; zero elsewhere.
    foreign_std : float
        Relative standard deviation of the energy in `foreign`.
    purity : float
        Fraction of the energy around its resonance that is the mode's.
    """

    mode: Mode
    frequency_hz: float
    credited: bool
    bins_hz: _Floats
    power: _Floats
    foreign: _Floats
    foreign_std: float
    purity: float

    def gain(self, frequency_hz: _Floats) -> _Floats:
        """Amplitude response [frequency] that passes the mode's share of the power."""
        return np.sqrt(np.interp(frequency_hz, self.bins_hz, self.power, left=0.0, right=0.0))

    def foreign_gain(self, frequency_hz: _Floats) -> _Floats:
        """Amplitude response [frequency] that passes what is foreign around the resonance."""
        return np.sqrt(np.interp(frequency_hz, self.bins_hz, self.foreign, left=0.0, right=0.0))


def separate(spectrum: PlaneSpectrum, modes: tuple[Mode, ...]) -> list[Share]:
    """Share the acceleration of one plane out among its modes.

    Parameters
    ----------
    spectrum : PlaneSpectrum
        Spectrum of the tangential acceleration at the package.
    modes : tuple of Mode
        All modes of the plane that matter, in order of frequency.

    Returns
    -------
    list of Share
        One a mode, in the order given.
    """
    peaks = spectrum.peaks_hz
    cores = _cores(spectrum, peaks)
    credited = [bool(np.any(core)) for core in cores]
    while True:
        split = _Split.of(spectrum, peaks, cores, credited)
        significance = [split.significance(index) for index in range(len(modes))]
        weakest = int(np.argmin(np.where(credited, significance, np.inf)))
        if not credited[weakest] or significance[weakest] > _EXCESS_STDS:
            break
        credited[weakest] = False
    return [
        Share(
            mode=mode,
            frequency_hz=peaks[index],
            credited=credited[index],
            bins_hz=spectrum.bins_hz,
            power=split.power(index),
            foreign=split.foreign(index),
            foreign_std=split.foreign_std(index),
            purity=split.purity(index),
        )
        for index, mode in enumerate(modes)
    ]


def _cores(spectrum: PlaneSpectrum, peaks: list[float]) -> list[_Mask]:
    """Bins around each resonance, split half-way where two would overlap."""
    cores = []
    for index, peak in enumerate(peaks):
        half = max(_CORE * peak, _CORE_BINS * spectrum.step_hz)
        low, high = peak - half, peak + half
        if index > 0:
            low = max(low, (peaks[index - 1] + peak) / 2)
        if index < len(peaks) - 1:
            high = min(high, (peaks[index + 1] + peak) / 2)
        cores.append((spectrum.bins_hz > low) & (spectrum.bins_hz <= high))
    return cores


@dataclass(frozen=True, eq=False)
class _Split:
    """Skirts of the credited modes, and what follows from them."""

    spectrum: PlaneSpectrum
    cores: list[_Mask]
    credited: list[bool]
    skirts: _Floats  # [mode, bin]; zero for modes that are not credited
    floor: float

    @classmethod
    def of(
        cls, spectrum: PlaneSpectrum, peaks: list[float], cores: list[_Mask], credited: list[bool]
    ) -> "_Split":
        """Fit the skirts to the bins outside all credited resonances."""
        owned = np.zeros(spectrum.bins_hz.size, bool)
        for core, use in zip(cores, credited, strict=True):
            owned |= core & use
        shapes = np.array([_skirt(spectrum.bins_hz, peak) for peak in peaks])
        basis = np.vstack([shapes[credited], np.ones(owned.size)])
        most = [
            _most(spectrum, shape, core)
            for shape, core, use in zip(shapes, cores, credited, strict=True)
            if use
        ]
        weights = _fit_powers(basis[:, ~owned], spectrum.power[~owned], [*most, np.inf])
        skirts = np.zeros_like(shapes)
        skirts[credited] = weights[:-1, None] * shapes[credited]
        floor = max(float(weights[-1]), _QUIET * float(np.max(spectrum.power)))
        return cls(spectrum, cores, credited, skirts, floor)

    @property
    def _owned(self) -> _Mask:
        """Bins around any credited resonance."""
        owned = np.zeros(self.spectrum.bins_hz.size, bool)
        for core, use in zip(self.cores, self.credited, strict=True):
            owned |= core & use
        return owned

    def significance(self, index: int) -> float:
        """Excess over the others' skirts around a resonance, in standard deviations."""
        background, excess = self._hidden(index)
        return excess / (self._relative_std(index) * background)

    def power(self, index: int) -> _Floats:
        """Fraction of the power in each bin that is a mode's."""
        total = self.skirts.sum(axis=0) + self.floor
        share = self.skirts[index] / total
        for other, core in enumerate(self.cores):
            if not self.credited[other]:
                continue
            own = self._own(other)[core]
            left = np.maximum((total - self.skirts[other])[core], np.finfo(float).tiny)
            share[core] = own if other == index else (1 - own) * self.skirts[index][core] / left
        return np.asarray(share)

    def purity(self, index: int) -> float:
        """Fraction of the energy around a resonance that is its mode's."""
        core, spectrum = self.cores[index], self.spectrum
        if not core.any():
            return 0.0
        own = spectrum.energy(self.power(index) * spectrum.power, core)
        return own / spectrum.energy(spectrum.power, core)

    def foreign(self, index: int) -> _Floats:
        """Fraction of the power around a resonance that is not its mode's."""
        where = self.cores[index] if self.credited[index] else self._inner(index)
        return np.where(where, 1 - self._own(index), 0.0)

    def foreign_std(self, index: int) -> float:
        """Relative uncertainty of that; all that was not credited, if nothing was."""
        relative = self._relative_std(index)
        if self.credited[index]:
            return relative
        background, excess = self._hidden(index)
        return float(np.hypot(relative * background, excess)) / (background + excess)

    def _hidden(self, index: int) -> tuple[float, float]:
        """Energies of the others and in excess of them in the inner half of a resonance."""
        inner, spectrum = self._inner(index), self.spectrum
        background = spectrum.energy(self._background(index), inner)
        return background, spectrum.energy(spectrum.power, inner) - background

    def _inner(self, index: int) -> _Mask:
        """Inner half of a resonance; five sixths of its energy for damping up to 1 %."""
        inside = np.flatnonzero(self.cores[index])
        inner = np.zeros_like(self.cores[index])
        inner[inside[inside.size // 4 : inside.size - inside.size // 4]] = True
        return inner

    def _own(self, index: int) -> _Floats:
        if not self.credited[index]:
            return np.zeros(self.spectrum.bins_hz.size)
        spectrum, core = self.spectrum, self.cores[index]
        background = self._background(index)
        share = np.clip(1 - background / spectrum.power, 0.0, 1.0)
        excess = spectrum.energy(spectrum.power - background, core)
        positive = spectrum.energy(share * spectrum.power, core)  # at least the excess
        if not positive > 0:
            return np.zeros_like(share)
        return np.asarray(share * max(excess, 0.0) / positive)

    def _background(self, index: int) -> _Floats:
        """Power of the others and of the floor, scaled to what is seen beside the resonance."""
        model = self.skirts.sum(axis=0) + self.floor
        others = model - self.skirts[index]
        bins = self.spectrum.bins_hz
        inside = np.flatnonzero(self.cores[index])
        if inside.size == 0:
            return np.asarray(others)
        width = max(inside.size // 2, 2)
        sides = []
        for beside in (
            np.arange(max(inside[0] - width, 0), inside[0]),
            np.arange(inside[-1] + 1, min(inside[-1] + 1 + width, bins.size)),
        ):
            free = beside[~self._owned[beside]]
            ratio = np.sum(self.spectrum.power[free]) / np.sum(model[free]) if free.size > 1 else 1
            sides.append(float(np.log(ratio)))
        scale = np.exp(np.interp(bins, [bins[inside[0]], bins[inside[-1]]], sides))
        return np.asarray(others * scale)

    def _relative_std(self, index: int) -> float:
        independent = max(float(np.count_nonzero(self._inner(index))) / 1.5, 1.0)
        return float(np.hypot(_SKIRT_STD, 1 / np.sqrt(independent * self.spectrum.averages)))


def _skirt(bins_hz: _Floats, peak_hz: float) -> _Floats:
    """Power of the acceleration away from an undamped resonance under white force."""
    distance = bins_hz**2 - peak_hz**2
    step = bins_hz[1] - bins_hz[0]
    return np.asarray(bins_hz**4 / np.maximum(distance**2, (peak_hz * step) ** 2))


def _most(spectrum: PlaneSpectrum, shape: _Floats, core: _Mask) -> float:
    """Highest skirt of a resonance that the power measured around it allows."""
    edge = float(np.min(shape[core]))
    return float(np.sum(spectrum.power[core]) / np.sum(np.minimum(shape[core], 4 * edge)))


def _fit_powers(basis: _Floats, power: _Floats, most: list[float]) -> _Floats:
    """Non-negative weights of spectral shapes by Whittle's likelihood, multiplicative updates.

    Each update raises the likelihood and keeps signs (Fevotte and Idier 2011, eq. for the
    Itakura-Saito divergence).
    """
    weights = np.array([np.exp(np.mean(np.log(power / shape))) for shape in basis])
    for _ in range(300):
        model = weights @ basis
        weights = weights * (basis @ (power / model**2)) / (basis @ (1 / model))
        weights = np.minimum(weights, most)
    return np.asarray(weights)
