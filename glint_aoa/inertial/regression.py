"""The time and frequency domain regression: radii from the record itself.

The paper's eleven steps: (1, 2) take the package's output q and a lateral signal x without its
mean, (3) integrate and square it to y, (4) compute power and cross spectra and coherence, (5) find
the modal frequencies, (6) estimate the radius of each mode by regression on the low-passed output,
(7) band-pass x around the mode, (8) low-pass q, (9) integrate and square, (10) correct, (11) repeat
for each mode. Several modes and both planes make it a multiple regression. x may be an
accelerometer, a balance moment or a balance force; no modal test is needed.
"""

import numpy as np
import scipy.ndimage
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.flags import Flag
from glint_aoa.inertial.estimate import BiasEstimate, CorrectionTask
from glint_aoa.inertial.filters import integrate_band, noise_bandwidth_hz
from glint_aoa.inertial.lateral import BAND_HZ, SourceKind, lateral_signals
from glint_aoa.inertial.least_squares import fit_line
from glint_aoa.inertial.modes import CREDIBLE_TURN, PLANES
from glint_aoa.inertial.record_fit import LEAST_S, Regression, Term, regress

__all__ = ["estimate_bias", "missing"]

_Floats = NDArray[np.float64]
_Mask = NDArray[np.bool_]

_NOISE_SEGMENT_S = 8.0
_STEADY = 0.1  # rms change of the low-passed square over its mean: less shows no bias


def missing(task: CorrectionTask) -> str | None:
    """Say what the method lacks, or None if it can be used.

    Parameters
    ----------
    task : CorrectionTask
        Record and package output; modes are not needed.

    Returns
    -------
    str or None
        The missing channels, as the end of a sentence.
    """
    channel = task.package.channel
    if len(channel) < LEAST_S * channel.rate_hz:
        return f"a record of {LEAST_S:g} s (this one lasts {len(channel) / channel.rate_hz:.3g} s)"
    if not any(lateral_signals(task, plane) for plane in PLANES):
        return (
            "a signal of lateral motion with its axis, sampled with the package: an accelerometer "
            "along model y or z, a yaw or pitch moment, a side or normal force"
        )
    return None


def estimate_bias(task: CorrectionTask, *, source: SourceKind | None = None) -> BiasEstimate:
    """Estimate the bias by regression on the record itself.

    Parameters
    ----------
    task : CorrectionTask
        A record of at least 10 s whose vibration grows and fades.
    source : {"acceleration", "moment", "force"}, optional
        Kind of channel to use; the one that explains most if not given.

    Returns
    -------
    BiasEstimate
        Sum of y_r / rho_r [m/s^2]. Error terms: the coefficients' covariance, their
        attenuation by what the source feels beside the mode, and what the fit leaves. Samples
        where the prediction is not correlated with the output are marked ``UNCORRELATED``.

    Notes
    -----
    Only changes of the bias show its size. Of a steady vibration the method knows nothing: nothing
    is added and the uncertainty says how large a bias the record cannot exclude. Changes of the
    true angle that happen to follow the vibration are taken for bias.
    """
    found = regress(task, source=source)
    additions = [
        -c * term.square for c, term in zip(found.fit.coefficient, found.terms, strict=True)
    ]
    addition = np.sum(additions, axis=0) if additions else np.zeros(len(task.package.channel))
    terms = _coefficient_terms(found)
    noise = _noise(task, addition)
    terms.append(_attenuation(found, noise) * addition)
    terms += [_excluded(found, each) for each in found.left_out]
    terms += _outside(found)
    terms.append(_on_all_samples(_misfit(found, task, noise), found, task))
    flags = None
    if not found.is_correlated:
        marked = _on_all_samples(found.uncorrelated, found, task) > 0.5
        flags = np.where(marked, int(Flag.UNCORRELATED), 0)
    return BiasEstimate(
        addition=addition,
        std_terms=[term for term in terms if np.any(term)],
        channels=tuple(term.signal.channel for term in found.terms),
        settling_s=1.0,
        why=_why(found),
        settings=_settings(found),
        flags=flags,
    )


def _coefficient_terms(found: Regression) -> list[_Floats]:
    """Independent error terms of the covariance of the coefficients, before the low-pass."""
    if not found.terms:
        return []
    values, vectors = np.linalg.eigh(found.fit.covariance)
    squares = np.stack([term.square for term in found.terms])
    return [
        np.sqrt(max(value, 0.0)) * (vector @ squares)
        for value, vector in zip(values, vectors.T, strict=True)
    ]


def _attenuation(found: Regression, noise: float) -> float:
    """Relative bound on how far noise in the regressors draws the coefficients to zero.

    What is left beyond the package's own noise, over what is explained.
    """
    if not found.terms:
        return 0.0
    explained = max(found.fit.explained, 0.05)
    total = float(np.var(found.response[found.used]))
    own = min(noise / total, 1.0) if total > 0 else 0.0
    return max(1 - found.fit.explained - own, 0.0) / explained


def _excluded(found: Regression, term: Term) -> _Floats:
    """Bias that a resonance may cause without the record showing it, 1 sigma, before the low-pass.

    Only changes show it. Of a steady vibration nothing is known but that the model turns by less
    than a sting allows, and not even that of a moment or force.
    """
    slow = term.slow[found.used]
    if np.std(slow) < _STEADY * np.mean(slow):
        circular = 2 * np.pi * term.resonance.frequency_hz
        known = term.signal.kind == "acceleration"
        return np.sqrt(term.square) * (CREDIBLE_TURN * circular if known else np.inf)
    rate_hz = 1 / (found.time_s[1] - found.time_s[0])
    regressors = [each.slow for each in (*found.terms, term)]
    fit = fit_line(found.response, regressors, rate_hz, use=found.used)
    return float(np.hypot(fit.coefficient[-1], fit.coefficient_std[-1])) * term.square


def _outside(found: Regression) -> list[_Floats]:
    """Error terms of motion between the bands of the modes used."""
    errors = []
    for signal in {id(term.signal): term.signal for term in found.terms}.values():
        rate_hz = signal.channel.rate_hz
        low, high = BAND_HZ[0], min(BAND_HZ[1], 0.4 * rate_hz)
        between = integrate_band(signal.samples, rate_hz, low_hz=low, high_hz=high) ** 2
        own = [
            (abs(coefficient), term.square)
            for coefficient, term in zip(found.fit.coefficient, found.terms, strict=True)
            if term.signal is signal
        ]
        others = [term.square for term in found.left_out if term.signal is signal]
        between = between - np.sum([square for _, square in own] + others, axis=0)
        errors.append(max(coefficient for coefficient, _ in own) * between)
    return errors


def _misfit(found: Regression, task: CorrectionTask, noise: float) -> _Floats:
    """Rms around each slow sample of what the fit leaves beyond the package's noise."""
    rate_hz = 1 / (found.time_s[1] - found.time_s[0])
    period = 1 / found.modulation_hz if found.terms else 1 / task.filter.cutoff
    size = min(round(2 * rate_hz * period), found.time_s.size)
    squares = np.where(found.used | found.uncorrelated, found.fit.residual, 0.0) ** 2
    mean = scipy.ndimage.uniform_filter1d(squares, size, mode="nearest")
    return np.asarray(np.sqrt(np.maximum(mean - noise, 0.0)))


def _noise(task: CorrectionTask, addition: _Floats) -> float:
    """Variance of the package's noise behind the low-pass, from its density above the cutoff."""
    if task.package.is_filtered:
        return 0.0
    rate_hz, cutoff = task.package.channel.rate_hz, task.filter.cutoff
    signal = task.package.specific_force + addition
    bins, density = scipy.signal.welch(
        signal, rate_hz, nperseg=min(signal.size, round(_NOISE_SEGMENT_S * rate_hz))
    )
    between = (bins >= 1.5 * cutoff) & (bins <= 10 * cutoff)
    return float(np.median(density[between])) * noise_bandwidth_hz(task.filter)


def _on_all_samples(
    values: NDArray[np.generic], found: Regression, task: CorrectionTask
) -> _Floats:
    every = task.package.channel.time_s
    return np.asarray(np.interp(every, found.time_s, values.astype(float)))


def _why(found: Regression) -> str:
    if not found.terms:
        return "regression: no resonance explains a change of the output"
    parts = ", ".join(
        f"{term.resonance.frequency_hz:.3g} Hz in {term.signal.channel.name}"
        for term in found.terms
    )
    sentence = f"regression on {parts} ({found.fit.explained:.1%} of the changes explained)"
    if found.is_correlated:
        return sentence
    return (
        f"{sentence}; below {found.modulation_hz:.2g} Hz {found.uncorrelated_share:.0%} of the "
        "predicted bias is not correlated with the output: use another source, or the stretches "
        "that are not flagged"
    )


def _settings(found: Regression) -> dict[str, object]:
    radii = {
        f"{term.signal.plane} {term.resonance.frequency_hz:.3g} Hz": -1 / coefficient
        for term, coefficient in zip(found.terms, found.fit.coefficient, strict=True)
        if term.signal.kind == "acceleration" and coefficient
    }
    return {
        "sources": tuple(term.signal.channel.name for term in found.terms),
        "mode_frequencies_hz": tuple(term.resonance.frequency_hz for term in found.terms),
        "coefficients": tuple(map(float, found.fit.coefficient)),
        "coefficient_stds": tuple(map(float, found.fit.coefficient_std)),
        "radii_m": radii,
        "explained": found.fit.explained,
        "standard_error_m_s2": found.fit.standard_error,
        "modulation_hz": found.modulation_hz,
        "uncorrelated_share": found.uncorrelated_share,
    }
