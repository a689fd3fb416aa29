"""Figures of one point: its angle and intercept, their spectra, and the inertial angle."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.signal
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator
from numpy.typing import NDArray

from glint_aoa.coverage import coverage_factor
from glint_aoa.flags import REJECTING, Flag
from glint_aoa.inertial.bias_coherence import BiasCoherence

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "AmplitudeSpectrum",
    "amplitude_spectrum",
    "coherence_panel",
    "inertial_figure",
    "optical_figure",
]

_Floats = NDArray[np.float64]

# Okabe and Ito's colours, told apart with any colour vision; dashes and shapes tell them apart in
# grey
_BLUE, _ORANGE, _GREEN, _GREY = "#0072B2", "#D55E00", "#009E73", "#7F7F7F"
_MANY = 300  # fields, beyond which they are not drawn one by one
_LEAST_FIELDS = 8  # of a spectrum
_HIGHEST_HZ = 80.0  # of the coherence: twice the modes' frequencies, and a little more
_PLAIN = FormatStrFormatter("%g")  # the usual one writes formulas
# Shares of the figure: a layout that measures every text takes longer than all the rest.
_MARGINS = {"left": 0.09, "right": 0.985, "wspace": 0.27}
_ONE, _TWO = {"top": 0.82, "bottom": 0.15}, {"top": 0.93, "bottom": 0.09, "hspace": 0.1}
_HANN = 1.5  # equivalent noise bandwidth [bins]


class AmplitudeSpectrum(NamedTuple):
    """Amplitudes of sines in a signal, and what its noise makes of them.

    Attributes
    ----------
    frequency_hz, amplitude : ndarray [bin]
        Frequencies above zero [Hz] and amplitudes [unit of the signal].
    noise : float
        Amplitude that white noise alone gives, rms [unit of the signal].
    bridged : int
        Fields that were not good and were replaced by a straight line between their neighbours.
    """

    frequency_hz: _Floats
    amplitude: _Floats
    noise: float
    bridged: int


def amplitude_spectrum(
    values: _Floats, good: NDArray[np.bool_], *, rate_hz: float, noise: float
) -> AmplitudeSpectrum | None:
    """Return the amplitudes in field after field, through one Hann window.

    Parameters
    ----------
    values : ndarray [field]
        Angle or intercept.
    good : ndarray of bool [field]
        Which of them count.
    rate_hz : float
        Fields a second [Hz].
    noise : float
        Noise of one field, 1 sigma [unit of the values].

    Returns
    -------
    AmplitudeSpectrum or None
        None for less than eight good fields. A sine between two bins shows up to 15 % low.
    """
    number = np.arange(values.size)
    if good.sum() < _LEAST_FIELDS:
        return None
    whole = np.interp(number, number[good], values[good])
    frequency, power = scipy.signal.periodogram(whole, rate_hz, window="hann", scaling="spectrum")
    level = float(noise * np.sqrt(4 * _HANN / values.size))
    return AmplitudeSpectrum(
        frequency[1:], np.sqrt(2 * power[1:]), level, int(values.size - good.sum())
    )


def optical_figure(
    values: Mapping[str, NDArray[Any]], attrs: Mapping[str, Any], log: Mapping[str, str]
) -> Figure:
    """Draw angle and intercept of field after field, and their spectra.

    Parameters
    ----------
    values, attrs, log : mapping
        As of `glint_aoa.report.results_folder.MeasuredPoint`.

    Returns
    -------
    Figure
        Left, angle [deg] and intercept [mm] against time [s], even and odd fields told apart,
        fields that do not count crossed out, the mean with its 95 % interval. Right, the
        amplitudes in them against frequency [Hz].
    """
    figure = Figure(figsize=(10, 5.4))
    grid = figure.subplots(2, 2, width_ratios=(3, 2), sharex="col", gridspec_kw=_MARGINS | _TWO)
    good = (values["flags"].astype(np.int64) & int(REJECTING)) == 0
    rate_hz = float(attrs.get("rate_hz") or _rate_of(values["time_s"]))
    for (time, spectrum), (name, unit) in zip(
        grid, (("angle", "deg"), ("intercept", "mm")), strict=True
    ):
        signal = np.asarray(values[f"{name}_{unit}"], np.float64)
        counts = good & np.isfinite(signal)
        _draw_fields(time, values, signal, counts)
        time.set_ylabel(f"{name} [{unit}]")
        noise = np.asarray(values[f"{name}_std_{unit}"], np.float64)
        level = float(np.median(noise[counts])) if counts.any() else np.nan
        found = amplitude_spectrum(signal, counts, rate_hz=rate_hz, noise=level)
        _draw_spectrum(spectrum, found, attrs if name == "angle" else {}, name)
        spectrum.set_ylabel(f"{name} amplitude [{unit}]")
    _draw_mean(grid[0, 0], log)
    _legend(grid[0, 0], columns=3)
    _legend(grid[0, 1], columns=2)
    grid[1, 0].set_xlabel("time after the trigger [s]")
    grid[1, 1].set_xlabel("frequency [Hz]")
    return figure


def inertial_figure(
    rows: Mapping[str, NDArray[Any]],
    coherence: BiasCoherence | None,
    *,
    optical: tuple[float, float, float] | None = None,
) -> Figure:
    """Draw the onboard sensor's angle, raw and corrected, and whether it follows the motion.

    Parameters
    ----------
    rows : mapping of str to ndarray [row]
        As `correct` writes them.
    coherence : BiasCoherence or None
        Of the same record; the panel is left out without it.
    optical : (float, float, float), optional
        First and last time of the fields [s], and their mean angle [deg].

    Returns
    -------
    Figure
        Angles [deg] against time [s] with the corrected one's 95 % interval; beside it coherence
        against frequency [Hz], with what chance exceeds one time in twenty.
    """
    figure = Figure(figsize=(10, 3.5))
    if coherence is None:
        time = figure.subplots(gridspec_kw=_MARGINS | _ONE)
    else:
        time, beside = figure.subplots(1, 2, width_ratios=(3, 2), gridspec_kw=_MARGINS | _ONE)
        coherence_panel(beside, coherence)
    _draw_inertial(time, rows)
    if optical is not None:
        first, last, mean = optical
        time.plot([first, last], [mean, mean], color="black", linewidth=2.5, label="video, mean")
    time.set_xlabel("time after the trigger [s]")
    time.set_ylabel("onboard angle [deg]")
    _legend(time, columns=3)
    time.grid(alpha=0.25)
    return figure


def coherence_panel(axes: "Axes", found: BiasCoherence) -> None:
    """Draw the coherence of the package's output with squared velocity against frequency [Hz]."""
    spectra = found.spectra
    shown = (spectra.frequency_hz > 0) & (spectra.frequency_hz <= _HIGHEST_HZ)
    axes.semilogx(
        spectra.frequency_hz[shown],
        spectra.coherence[shown],
        color=_BLUE,
        linewidth=1,
        label="coherence",
    )
    axes.axhline(
        spectra.by_chance(), color=_ORANGE, linestyle="--", linewidth=1, label="by chance, 5 %"
    )
    axes.xaxis.set_major_formatter(_PLAIN)
    axes.set_ylim(0, 1.02)
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel("coherence [1]")
    axes.grid(alpha=0.25)
    _legend(axes, columns=2)


def _legend(axes: "Axes", *, columns: int) -> None:
    """Put the legend above the axes; where there is nothing to tell apart, none."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize="small", ncols=columns, loc="lower left", bbox_to_anchor=(0, 1))


def _draw_fields(
    axes: "Axes", values: Mapping[str, NDArray[Any]], signal: _Floats, counts: NDArray[np.bool_]
) -> None:
    axes.ticklabel_format(useOffset=False)
    time = np.asarray(values["time_s"], np.float64)
    many = signal.size > _MANY
    axes.plot(time, np.where(counts, signal, np.nan), color=_GREY, linewidth=0.7 if many else 0.5)
    odd = values["parity"] == 1
    for each, marker, colour, label in (
        (~odd, "o", _BLUE, "even fields" if odd.any() else "fields"),
        (odd, "^", _ORANGE, "odd fields"),
    ):
        use = each & counts
        if use.any():
            axes.plot(
                time[use],
                signal[use],
                linestyle="none",
                marker="." if many else marker,
                markersize=1.5 if many else 3.5,
                markerfacecolor="none",
                color=colour,
                label=label,
            )
    out = ~counts & np.isfinite(signal)
    if out.any():
        axes.plot(time[out], signal[out], "x", color="black", markersize=5, label="left out")
    axes.grid(alpha=0.25)


def _draw_mean(axes: "Axes", log: Mapping[str, str]) -> None:
    if not log.get("mean_angle_deg"):
        return
    mean, u95 = float(log["mean_angle_deg"]), float(log.get("mean_angle_u95_deg") or "nan")
    axes.axhline(mean, color="black", linestyle="--", linewidth=1, label="mean, 95 %")
    if np.isfinite(u95):
        axes.axhspan(mean - u95, mean + u95, color=_GREEN, alpha=0.3, linewidth=0)


def _draw_spectrum(
    axes: "Axes", found: AmplitudeSpectrum | None, attrs: Mapping[str, Any], name: str
) -> None:
    if found is None:
        words = f"too few fields with {name}"
        axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center")
        return
    axes.semilogy(found.frequency_hz, found.amplitude, color=_BLUE, linewidth=1)
    axes.yaxis.set_major_formatter(_PLAIN)
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.minorticks_off()
    if found.noise > 0:
        label = "noise of the fields"
        axes.axhline(found.noise, color=_ORANGE, linestyle="--", linewidth=1, label=label)
    for number, frequency in enumerate(np.atleast_1d(attrs.get("vibration_frequency_hz", []))):
        label = "vibration fitted" if number == 0 else "_"
        axes.axvline(float(frequency), color="black", linestyle=":", linewidth=1, label=label)
    axes.set_xlim(left=0)
    axes.grid(alpha=0.25)


def _draw_inertial(axes: "Axes", rows: Mapping[str, NDArray[Any]]) -> None:
    time, half = rows["time_s"], coverage_factor() * rows["angle_std_deg"]
    settling = (rows["flags"].astype(np.int64) & int(Flag.FILTER_SETTLING)) != 0
    axes.ticklabel_format(useOffset=False)
    axes.plot(time, rows["raw_angle_deg"], color=_ORANGE, linestyle="--", label="raw")
    axes.plot(time, rows["angle_deg"], color=_BLUE, label="corrected")
    axes.fill_between(
        time,
        rows["angle_deg"] - half,
        rows["angle_deg"] + half,
        color=_BLUE,
        alpha=0.2,
        linewidth=0,
        label="its 95 %",
    )
    if settling.any() and not settling.all():
        edges = np.flatnonzero(np.diff(settling.astype(int), prepend=0, append=0))
        for number, (first, end) in enumerate(edges.reshape(-1, 2)):
            label = "low-pass settles" if number == 0 else "_"
            axes.axvspan(
                time[first], time[end - 1], color=_GREY, alpha=0.15, linewidth=0, label=label
            )


def _rate_of(time_s: NDArray[Any]) -> float:
    """Fields a second, from their times; 1 where there is a single field."""
    return float(1 / np.median(np.diff(time_s))) if time_s.size > 1 else 1.0
