"""The shaker's force as a sum of tones: sine, modulated sine, band-limited random, sine sweep.

A sum of tones has exact values, derivatives and modal answers at any time, so video and
acquisition see the same motion, each at its own times.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.fft
from numpy.typing import NDArray

__all__ = [
    "Sum",
    "Tones",
    "modulated_sine",
    "peak_to_peak",
    "period_beyond",
    "random_band",
    "sine",
    "sine_sweep",
]

_SHORTEST_PERIOD_S = 64.0
_FADE = 0.05  # of a sine sweep's time, at each end

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


@dataclass(frozen=True, eq=False)
class Sum:
    """The sum of several signals; attributes and methods as of `Tones`."""

    parts: tuple[Tones, ...]

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the signal at any times; see `Tones.at`."""
        return np.asarray(np.sum([part.at(time_s) for part in self.parts], axis=0))

    def derivative(self, order: int = 1) -> "Sum":
        """Return the time derivative of the given order."""
        return Sum(tuple(part.derivative(order) for part in self.parts))


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
        Depth m; 1 takes the force to zero once a period, beyond that its phase turns over.
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


def period_beyond(duration_s: float) -> float:
    """Return a period [s] longer than a duration [s]: 64 s or twice, four times ... that."""
    period = _SHORTEST_PERIOD_S
    while period <= duration_s:
        period *= 2
    return period


def random_band(
    low_hz: float = 5.0,
    high_hz: float = 60.0,
    *,
    period_s: float = _SHORTEST_PERIOD_S,
    rng: np.random.Generator,
) -> Tones:
    """Return Gaussian noise of a flat spectrum in a band, of unit variance.

    Tones stand every 1/period from `low_hz` to `high_hz`, with independent complex Gaussian
    amplitudes; the signal repeats after the period.

    Parameters
    ----------
    low_hz, high_hz : float
        The band [Hz]; the paper's is 5 to 60 Hz.
    period_s : float
        Period after which the signal repeats [s].
    rng : Generator
        Draws the amplitudes.

    Returns
    -------
    Tones
        The signal.
    """
    bins = np.arange(np.ceil(low_hz * period_s), np.floor(high_hz * period_s) + 1)
    amplitude = (rng.standard_normal(bins.size) + 1j * rng.standard_normal(bins.size)) / np.sqrt(
        bins.size
    )
    return Tones(bins / period_s, amplitude)


def sine_sweep(
    first_hz: float = 5.0,
    last_hz: float = 60.0,
    *,
    law: Literal["linear", "logarithmic"] = "logarithmic",
    time_s: float,
    period_s: float,
    rng: np.random.Generator,
) -> Tones:
    """Return a sine of unit amplitude whose frequency runs from one end of a band to the other.

    It starts at the trigger, fades in and out over a twentieth of its time each, and is a Fourier
    series of the period: with the modes' steady answers to its tones, the motion is exact, whatever
    the rate of the sweep, as long as the modes come to rest before it comes round again. Tones
    beyond the band's upper end, which only shape the fades, stop a quarter above it.

    Parameters
    ----------
    first_hz, last_hz : float
        Frequencies at the start and at the end [Hz]; the first may be the higher.
    law : {"linear", "logarithmic"}
        Whether the frequency runs evenly in hertz or in octaves.
    time_s : float
        How long it takes [s].
    period_s : float
        Period after which the signal repeats [s].
    rng : Generator
        Draws the phase at the start.

    Returns
    -------
    Tones
        The signal.
    """
    highest = 1.25 * max(first_hz, last_hz)
    samples = 2 ** int(np.ceil(np.log2(8 * highest * period_s)))
    time = np.arange(samples) * (period_s / samples)
    time = time[time < time_s]
    phase = _swept_phase(time, first_hz, last_hz, law=law, time_s=time_s)
    edge = np.minimum(time, time_s - time) / (_FADE * time_s)
    fade = np.sin(np.pi / 2 * np.minimum(edge, 1.0)) ** 2
    signal = fade * np.cos(phase + np.angle(_phasors(1, rng)[0]))
    spectrum = scipy.fft.rfft(signal, samples)[1 : int(highest * period_s) + 1]
    bins = np.arange(1, spectrum.size + 1)
    return Tones(bins / period_s, spectrum * (2 / samples))


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


def _swept_phase(
    time: NDArray[np.float64],
    first_hz: float,
    last_hz: float,
    *,
    law: Literal["linear", "logarithmic"],
    time_s: float,
) -> NDArray[np.float64]:
    """Phase of a sine sweep [rad]: 2 pi times the integral of its frequency."""
    if law == "linear":
        turns = first_hz * time + (last_hz - first_hz) / (2 * time_s) * time**2
    else:
        growth = np.log(last_hz / first_hz) / time_s
        turns = first_hz * np.expm1(growth * time) / growth
    return np.asarray(2 * np.pi * turns)


def _phasors(count: int, rng: np.random.Generator) -> NDArray[np.complex128]:
    return np.asarray(np.exp(2j * np.pi * rng.random(count)), np.complex128)
