"""The shaker's force as a sum of tones: sine, modulated sine and band-limited random.

A sum of tones has exact values, derivatives and modal answers at any time, so video and
acquisition see the same motion, each at its own times.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.fft
from numpy.typing import NDArray

__all__ = ["Tones", "modulated_sine", "peak_to_peak", "random_band", "sine"]

RANDOM_PERIOD_S = 64.0
"""Period after which a random excitation repeats [s]; longer than any record and its lead-in."""

_DIRECT_BLOCK = 2_000_000
_FEW_TONES = 8


@dataclass(frozen=True, eq=False)
class Tones:
    """A signal that is a sum of tones, Re sum a_k exp(2 pi i f_k t).

    Attributes
    ----------
    frequency_hz : ndarray [tone]
        Frequencies f_k [Hz].
    amplitude : ndarray [tone]
        Complex amplitudes a_k, in the signal's unit; the angle is the phase at the trigger.
    """

    frequency_hz: NDArray[np.float64]
    amplitude: NDArray[np.complex128]

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the signal at any times.

        Many tones on a common grid of frequencies, asked for at many regular times, are summed by
        one inverse FFT; the result is the same to rounding.

        Parameters
        ----------
        time_s : ndarray
            Times after the trigger [s], of any shape.

        Returns
        -------
        ndarray
            The signal, of the shape of `time_s`.
        """
        time_s = np.asarray(time_s, np.float64)
        grid = self._fft_grid(time_s)
        return self._direct(time_s) if grid is None else self._by_fft(time_s, *grid)

    def derivative(self, order: int = 1) -> "Tones":
        """Return the time derivative of the given order, in the signal's unit per s^order."""
        factor = (2j * np.pi * self.frequency_hz) ** order
        return replace(self, amplitude=self.amplitude * factor)

    def scaled(self, factor: float) -> "Tones":
        """Return the signal times a real factor."""
        return replace(self, amplitude=self.amplitude * factor)

    def _direct(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        flat = time_s.ravel()
        value = np.zeros(flat.size)
        block = max(1, _DIRECT_BLOCK // max(1, self.frequency_hz.size))
        for first in range(0, flat.size, block):
            part = slice(first, first + block)
            phase = np.outer(flat[part], 2 * np.pi * self.frequency_hz)
            value[part] = np.cos(phase) @ self.amplitude.real - np.sin(phase) @ self.amplitude.imag
        return value.reshape(time_s.shape)

    def _fft_grid(self, time_s: NDArray[np.float64]) -> tuple[int, float] | None:
        """Return samples a period and the tones' spacing [Hz] where one inverse FFT serves."""
        few = self.frequency_hz.size <= _FEW_TONES
        if few or time_s.ndim != 1 or time_s.size < self.frequency_hz.size:
            return None
        spacing = float(np.min(np.diff(self.frequency_hz)))
        step = (time_s[-1] - time_s[0]) / (time_s.size - 1)
        if spacing <= 0 or step <= 0:
            return None
        samples = round(1 / (spacing * step))
        bins = self.frequency_hz / spacing
        on_grid = np.allclose(bins, np.rint(bins), rtol=0, atol=1e-9)
        regular = np.allclose(
            time_s, time_s[0] + np.arange(time_s.size) / (spacing * samples), rtol=0, atol=1e-11
        )
        enough = samples > 2 * self.frequency_hz[-1] / spacing
        return (samples, spacing) if on_grid and regular and enough else None

    def _by_fft(
        self, time_s: NDArray[np.float64], samples: int, spacing: float
    ) -> NDArray[np.float64]:
        spectrum = np.zeros(samples // 2 + 1, np.complex128)
        bins = np.rint(self.frequency_hz / spacing).astype(int)
        turned = self.amplitude * np.exp(2j * np.pi * self.frequency_hz * time_s[0])
        np.add.at(spectrum, bins, turned * (samples / 2))
        period = scipy.fft.irfft(spectrum, samples)
        return np.resize(period, time_s.size)


def sine(frequency_hz: float, *, rng: np.random.Generator) -> Tones:
    """Return a sine of unit amplitude and random phase."""
    return Tones(np.array([frequency_hz]), _phasors(1, rng))


def modulated_sine(
    frequency_hz: float,
    *,
    modulation_hz: float = 0.25,
    depth: float = 1.0,
    rng: np.random.Generator,
) -> Tones:
    """Return an amplitude-modulated sine, (1 + m cos(2 pi f_m t + b)) cos(2 pi f t + a).

    A lightly damped mode follows less deeply than the force: its sidebands lie off resonance.

    Parameters
    ----------
    frequency_hz : float
        Carrier f [Hz].
    modulation_hz : float
        Modulation f_m [Hz]; the paper's is 0.25 Hz.
    depth : float
        Depth m; 1 takes the force to zero once a period.
    rng : Generator
        Draws both phases a and b.

    Returns
    -------
    Tones
        Carrier and two sidebands; the carrier has unit amplitude.
    """
    carrier, envelope = _phasors(2, rng)
    frequency = np.array([frequency_hz - modulation_hz, frequency_hz, frequency_hz + modulation_hz])
    side = depth / 2 * carrier
    return Tones(frequency, np.array([side * envelope.conjugate(), carrier, side * envelope]))


def random_band(low_hz: float = 5.0, high_hz: float = 60.0, *, rng: np.random.Generator) -> Tones:
    """Return Gaussian noise of a flat spectrum in a band, of unit variance.

    Tones stand every 1/64 Hz from `low_hz` to `high_hz`, with independent complex Gaussian
    amplitudes; the signal repeats after 64 s.

    Parameters
    ----------
    low_hz, high_hz : float
        The band [Hz]; the paper's is 5 to 60 Hz.
    rng : Generator
        Draws the amplitudes.

    Returns
    -------
    Tones
        The signal.
    """
    bins = np.arange(np.ceil(low_hz * RANDOM_PERIOD_S), np.floor(high_hz * RANDOM_PERIOD_S) + 1)
    amplitude = (rng.standard_normal(bins.size) + 1j * rng.standard_normal(bins.size)) / np.sqrt(
        bins.size
    )
    return Tones(bins / RANDOM_PERIOD_S, amplitude)


def peak_to_peak(
    signal: Tones, *, start_s: float = 0.0, duration_s: float, rate_hz: float = 6400.0
) -> float:
    """Return greatest less least value of a signal over a record, in the signal's unit.

    Parameters
    ----------
    signal : Tones
        The signal.
    start_s, duration_s : float
        The record [s].
    rate_hz : float
        How finely the peaks are looked for [Hz].

    Returns
    -------
    float
        Peak to peak.
    """
    value = signal.at(start_s + np.arange(round(duration_s * rate_hz)) / rate_hz)
    return float(np.ptp(value))


def _phasors(count: int, rng: np.random.Generator) -> NDArray[np.complex128]:
    return np.asarray(np.exp(2j * np.pi * rng.random(count)), np.complex128)
