"""The regression of a record's low-passed output on its integral-squared motion.

Steps 3 to 9 and 11 of the paper's time and frequency domain analysis, and its coherence test.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial.coherence import CrossSpectra, cross_spectra
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.inertial.filters import low_pass, settling_s
from glint_aoa.inertial.lateral import (
    LateralSignal,
    Resonance,
    SourceKind,
    integral_square,
    lateral_signals,
    resonances,
)
from glint_aoa.inertial.least_squares import INDEPENDENT_HZ, LinearFit, fit_line
from glint_aoa.inertial.modes import PLANES, Plane
from glint_aoa.units import STANDARD_GRAVITY

__all__ = ["LEAST_S", "Regression", "Term", "regress"]

_Floats = NDArray[np.float64]
_Mask = NDArray[np.bool_]

LEAST_S = 10.0
"""Shortest record that shows the slow changes of the bias [s]; the paper's figure."""

_SLOW_RATE = 50.0  # times the cutoff: samples a second that a low-passed signal needs
_STRICT = 10.0  # log-likelihood ratio, twice, that a mode must win beyond the usual criterion
_LONGEST_SEGMENT_S, _LEAST_SEGMENTS = 20.0, 3
_UNCORRELATED = 0.12
"""Share of the predicted bias, rms, below the modulation frequency that must be correlated."""


@dataclass(frozen=True, eq=False)
class Term:
    """One regressor: the integral-squared signal of a source around one mode.

    Attributes
    ----------
    signal : LateralSignal
        The source.
    resonance : Resonance
        Where the mode answers.
    square : ndarray [sample]
        y(t), before the low-pass.
    slow : ndarray [slow sample]
        After it.
    """

    signal: LateralSignal
    resonance: Resonance
    square: _Floats
    slow: _Floats


@dataclass(frozen=True, eq=False)
class Regression:
    """The regression of a record's low-passed output on its integral-squared motion.

    Attributes
    ----------
    terms : tuple of Term
        Those that explain the output, in the order of `fit.coefficient`.
    left_out : tuple of Term
        Resonances that do not.
    fit : LinearFit
        Of the low-passed specific force [m/s^2]; minus a coefficient is 1 / rho for an
        accelerometer on the package.
    time_s : ndarray [slow sample]
        Times after the trigger [s].
    response : ndarray [slow sample]
        The low-passed specific force [m/s^2].
    used : ndarray [slow sample]
        Samples that the fit rests on.
    uncorrelated : ndarray [slow sample]
        Where the predicted bias changes below the modulation frequency and the output does not.
    uncorrelated_share : float
        Rms of those changes over that of the predicted bias; NaN without a prediction.
    modulation_hz : float
        Frequency at which the predicted bias changes most [Hz]; NaN without one.
    spectra : CrossSpectra or None
        Of output and predicted bias.
    """

    terms: tuple[Term, ...]
    left_out: tuple[Term, ...]
    fit: LinearFit
    time_s: _Floats
    response: _Floats
    used: _Mask
    uncorrelated: _Mask
    uncorrelated_share: float = np.nan
    modulation_hz: float = np.nan
    spectra: CrossSpectra | None = None

    @property
    def predicted(self) -> _Floats:
        """Bias that the fit predicts [slow sample, m/s^2]; negative for positive radii."""
        return _predicted(self.terms, self.fit)

    @property
    def is_correlated(self) -> bool:
        """Whether the coherence lets the prediction stand."""
        return not self.uncorrelated_share > _UNCORRELATED

    def figures(self) -> dict[str, float]:
        """Give a row of the paper's Tables 2 and 3, in degrees, over the samples used.

        Returns
        -------
        dict of str to float
            ``mean_deg`` and ``std_deg`` of the filtered angle, ``bias_deg`` estimated,
            ``corrected_deg``, ``standard_error_deg`` of the regression, ``reduction`` of the
            standard deviation (1 - standard error / std).
        """
        used = self.response[self.used]
        ratio = np.clip(np.mean(used) / STANDARD_GRAVITY, -1.0, 1.0)
        per_degree = np.radians(STANDARD_GRAVITY * np.sqrt(1 - ratio**2))
        bias = float(np.mean(self.predicted[self.used]))
        angle = float(np.degrees(np.arcsin(ratio)))
        std = float(np.std(used, ddof=1))
        return {
            "mean_deg": angle,
            "std_deg": std / per_degree,
            "bias_deg": bias / per_degree,
            "corrected_deg": angle - bias / per_degree,
            "standard_error_deg": self.fit.standard_error / per_degree,
            "reduction": 1 - self.fit.standard_error / std,
        }


def regress(
    task: CorrectionTask,
    *,
    source: SourceKind | None = None,
    planes: Sequence[Plane] = PLANES,
    between_s: tuple[float, float] | None = None,
) -> Regression:
    """Regress the low-passed output on the integral-squared motion.

    Parameters
    ----------
    task : CorrectionTask
        Record and package output.
    source : {"acceleration", "moment", "force"}, optional
        Kind of channel to use; the one that explains most if not given.
    planes : sequence of {"yaw", "pitch"}
        Planes to look in.
    between_s : (float, float), optional
        First and last time of the stretch to use [s]; all but the filter's settling by default.

    Returns
    -------
    Regression
        Its coefficients, and whether coherence lets them stand.

    Raises
    ------
    RecordingError
        If the stretch holds less than 10 s of settled record.
    InputError
        If no channel of that kind is recorded.

    Notes
    -----
    Modes are found as resonances of the source and taken in as long as each explains more than
    chance would; the best one of a source that is asked for is taken in any case. A stretch that
    is not correlated is left out of a second fit where enough of the record remains.
    """
    slow = _Slow.of(task, between_s)
    candidates = _candidates(task, slow, source, planes)
    terms, fit = _select(candidates, slow, at_least=0 if source is None else 1)
    result = _checked(_result(candidates, terms, fit, slow), slow)
    if not result.is_correlated:
        kept = slow.settled & ~result.uncorrelated
        if np.count_nonzero(kept) >= LEAST_S * slow.rate_hz:
            refit = fit_line(slow.response, [term.slow for term in terms], slow.rate_hz, use=kept)
            result = _checked(replace(result, fit=refit, used=kept), slow)
    return result


@dataclass(frozen=True, eq=False)
class _Slow:
    """The output behind the low-pass, at a rate that suits it."""

    response: _Floats
    rate_hz: float
    time_s: _Floats
    settled: _Mask
    task: CorrectionTask
    step: int

    @classmethod
    def of(cls, task: CorrectionTask, between_s: tuple[float, float] | None) -> "_Slow":
        channel, filter_ = task.package.channel, task.filter
        step = max(1, int(channel.rate_hz / (_SLOW_RATE * filter_.cutoff)))
        rate_hz = channel.rate_hz / step
        response = task.package.specific_force
        if not task.package.is_filtered:
            response = low_pass(response, channel.rate_hz, filter_)
        time_s = channel.time_s[::step]
        settling = settling_s(filter_)
        first, last = between_s or (time_s[0] + settling, time_s[-1] - settling)
        settled = (time_s >= first) & (time_s <= last)
        if np.count_nonzero(settled) < 0.6 * LEAST_S * rate_hz:
            raise RecordingError(
                f"{task.record.name}: {np.count_nonzero(settled) / rate_hz:.3g} s of settled "
                f"record are too short for the regression; record {LEAST_S:g} s or more"
            )
        return cls(response[::step], rate_hz, time_s, settled, task, step)

    def low_passed(self, square: _Floats) -> _Floats:
        """Pass a regressor through the filter that the output has been through."""
        package = self.task.package
        rate_hz, causal = package.channel.rate_hz, package.is_filtered
        return low_pass(square, rate_hz, self.task.filter, causal=causal)[:: self.step]

    def term(self, signal: LateralSignal, resonance: Resonance) -> Term:
        square = integral_square(signal.samples, signal.channel.rate_hz, resonance)
        return Term(signal, resonance, square, self.low_passed(square))


def _candidates(
    task: CorrectionTask, slow: _Slow, source: SourceKind | None, planes: Sequence[Plane]
) -> list[Term]:
    """Terms of the best source of each plane."""
    found = []
    for plane in planes:
        choices = []
        for signal in lateral_signals(task, plane):
            if source in (None, signal.kind):
                bands = resonances(signal.samples, signal.channel.rate_hz)
                choices.append([slow.term(signal, band) for band in bands])
        found.append(max(choices, key=lambda terms: _select(terms, slow)[1].explained, default=[]))
        if source is not None and not choices and len(planes) == 1:
            raise InputError(
                f"{task.record.name}: no {source} shows the motion in {plane}; choose another "
                "source or give the channel's axis and units"
            )
    return list(chain.from_iterable(found))


def _select(
    candidates: Sequence[Term], slow: _Slow, *, at_least: int = 0
) -> tuple[list[Term], LinearFit]:
    """Take terms in, the best one or two first, as long as they explain more than chance would.

    Of two planes shaken at once, either alone leaves so much that it may seem to explain nothing.
    """
    count = INDEPENDENT_HZ * np.count_nonzero(slow.settled) / slow.rate_hz

    response = slow.response[slow.settled]
    columns = {id(term): _standard(term.slow[slow.settled]) for term in candidates}

    def cost(terms: Sequence[Term]) -> float:
        design = np.stack([np.ones(response.size), *(columns[id(term)] for term in terms)], axis=1)
        left = response - design @ np.linalg.lstsq(design, response, rcond=1e-9)[0]
        price = len(terms) * (np.log(count) + _STRICT)
        return float(count * np.log(np.sum(left**2) + np.finfo(float).tiny) + price)

    chosen: list[Term] = []
    while left := [term for term in candidates if term not in chosen]:
        additions = [*combinations(left, 1), *combinations(left, 2)]
        best = min(([*chosen, *terms] for terms in additions), key=cost)
        if cost(best) >= cost(chosen):
            if len(chosen) >= at_least:
                break
            best = [*chosen, *min(combinations(left, 1), key=lambda terms: cost([*chosen, *terms]))]
        chosen = best
    return chosen, _fit(chosen, slow)


def _standard(values: _Floats) -> _Floats:
    spread = float(np.std(values))
    return np.asarray((values - values.mean()) / (spread if spread > 0 else 1.0))


def _fit(terms: Sequence[Term], slow: _Slow) -> LinearFit:
    return fit_line(slow.response, [term.slow for term in terms], slow.rate_hz, use=slow.settled)


def _result(
    candidates: Sequence[Term], terms: Sequence[Term], fit: LinearFit, slow: _Slow
) -> Regression:
    return Regression(
        terms=tuple(terms),
        left_out=tuple(term for term in candidates if term not in terms),
        fit=fit,
        time_s=slow.time_s,
        response=slow.response,
        used=slow.settled,
        uncorrelated=np.zeros(slow.time_s.size, bool),
    )


def _predicted(terms: Sequence[Term], fit: LinearFit) -> _Floats:
    parts = [c * term.slow for c, term in zip(fit.coefficient, terms, strict=True)]
    return np.sum(parts, axis=0) if parts else np.zeros(fit.residual.size)


def _checked(result: Regression, slow: _Slow) -> Regression:
    """Look below the modulation frequency for changes that the output does not share."""
    if not result.terms:
        return result
    predicted = result.predicted
    length = np.count_nonzero(slow.settled) / slow.rate_hz
    spectra = cross_spectra(
        slow.response[slow.settled],
        predicted[slow.settled],
        slow.rate_hz,
        segment_s=min(_LONGEST_SEGMENT_S, length / _LEAST_SEGMENTS),
    )
    bins, power = spectra.frequency_hz, spectra.second_power
    step = bins[1]
    passed = (bins > 0) & (bins <= slow.task.filter.cutoff)
    modulation = float(bins[passed][np.argmax(power[passed])])
    below = modulation - 2 * step if modulation > 3 * step else slow.task.filter.cutoff
    whole = float(np.sqrt(np.sum(power[passed]) * step))
    share = spectra.uncorrelated_rms(step, below) / whole
    period = round(slow.rate_hz / modulation)
    drift = _mean_over(predicted - predicted[slow.settled].mean(), period)
    left = _mean_over(result.fit.residual, period)
    least = _UNCORRELATED * whole
    uncorrelated = (_rms_over(drift, 2 * period) > least) & (_rms_over(left, 2 * period) > least)
    return replace(
        result,
        uncorrelated=uncorrelated & slow.settled,
        uncorrelated_share=share,
        modulation_hz=modulation,
        spectra=spectra,
    )


def _mean_over(samples: _Floats, size: int) -> _Floats:
    return np.asarray(scipy.ndimage.uniform_filter1d(samples, size, mode="nearest"))


def _rms_over(samples: _Floats, size: int) -> _Floats:
    return np.asarray(np.sqrt(np.maximum(_mean_over(samples**2, size), 0.0)))
