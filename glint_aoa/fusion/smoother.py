"""A linear smoother with constant unknowns: measurements in, smoothed states and constants out.

    y = H x + Z beta + noise,    x(t + 1) = A x(t) + process noise

with beta constant and of known prior. Filter and smoother run on y and on each column of Z alike;
what the innovations then say of beta is least squares, and the smoothed states follow as
x = x_y - X_Z beta, with the covariance of both.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.fusion import _kernel
from glint_aoa.fusion.oscillators import Oscillators

__all__ = ["Beliefs", "Measurements", "Smoothed", "smooth"]

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Measurements:
    """Scalar measurements of one source.

    Attributes
    ----------
    source : str
        What it is called in the test of consistency.
    sample : ndarray [measurement]
        Step at which each is taken.
    rows : ndarray [kind, state]
        What they measure of the states.
    kind : ndarray [measurement]
        Which of `rows` holds.
    value : ndarray [measurement]
        What was measured.
    regressors : ndarray [measurement, unknown]
        What one unit of each constant unknown adds.
    variance : ndarray [measurement]
        Of the noise.
    informs : ndarray [unknown] of bool
        Which unknowns may be learnt from it.
    """

    source: str
    sample: _Ints
    rows: _Floats
    kind: _Ints
    value: _Floats
    regressors: _Floats
    variance: _Floats
    informs: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Beliefs:
    """What is known of the constant unknowns: mean [unknown] and covariance."""

    mean: _Floats
    covariance: _Floats

    @property
    def std(self) -> _Floats:
        """Standard deviations [unknown]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def after(self, information: _Floats, pull: _Floats) -> "Beliefs":
        """Join with independent normal equations, information times unknown = pull."""
        prior = np.linalg.inv(self.covariance)
        covariance = np.linalg.inv(prior + information)
        covariance = (covariance + covariance.T) / 2
        return Beliefs(covariance @ (prior @ self.mean + pull), covariance)


@dataclass(frozen=True, eq=False)
class Smoothed:
    """What the smoother found.

    Attributes
    ----------
    columns : ndarray [sample, seen, 1 + unknown]
        The combinations of states asked for, with all unknowns zero, then what to take off for one
        unit of each.
    spread : ndarray [sample, seen, seen]
        Their covariance, given the unknowns.
    unknowns : Beliefs
        The constant unknowns.
    consistency : dict of str to float
        Mean squared innovation over its variance, by source; 1 for a model that holds.
    normal : (ndarray [unknown, unknown], ndarray [unknown])
        Normal equations of the unknowns from all measurements.
    """

    columns: _Floats
    spread: _Floats
    unknowns: Beliefs
    consistency: dict[str, float]
    normal: tuple[_Floats, _Floats]


def smooth(
    model: Oscillators,
    measurements: Sequence[Measurements],
    beliefs: Beliefs,
    *,
    samples: int,
    seen: _Floats,
    told: tuple[_Floats, _Floats] | None = None,
) -> Smoothed:
    """Smooth a record.

    Parameters
    ----------
    model : Oscillators
        Dynamics.
    measurements : sequence of Measurements
        All of them; they may stand in any order of time.
    beliefs : Beliefs
        Of the unknowns, before.
    samples : int
        Steps.
    seen : ndarray [seen, state]
        Combinations of the states that are wanted.
    told : (ndarray [unknown, unknown], ndarray [unknown]), optional
        Normal equations to leave out of what the unknowns are learnt from: those of the same
        accelerometers by themselves leave what the other sources say, given all of these.

    Returns
    -------
    Smoothed
        Combinations, unknowns and how consistent the sources are.
    """
    transition, process, start = model.matrices
    starts = np.cumsum([0, *(len(each.rows) for each in measurements)])
    row = np.concatenate([s + each.kind for s, each in zip(starts, measurements, strict=False)])
    values = np.concatenate([np.column_stack([m.value, m.regressors]) for m in measurements])
    origin = np.repeat(np.arange(len(measurements)), [each.sample.size for each in measurements])
    sample = np.concatenate([each.sample for each in measurements])
    order = np.argsort(sample, kind="stable")
    sample, row, origin = sample[order], row[order], origin[order]
    rows = np.concatenate([each.rows for each in measurements])
    variance = np.concatenate([each.variance for each in measurements])[order]
    predicted, spread, gain, innovation, expected = _kernel.filtered(
        transition,
        process,
        np.zeros((model.size, values.shape[1])),
        start,
        sample,
        row,
        rows,
        np.ascontiguousarray(values[order]),
        variance,
        samples,
    )
    may = np.array([each.informs for each in measurements])[origin]
    sensitive = innovation[:, 1:]
    weighted = (sensitive / expected[:, None]).T
    normal = weighted @ sensitive, weighted @ innovation[:, 0]
    learnt = np.where(may, sensitive, 0.0)
    weighted = (learnt / expected[:, None]).T
    information, pull = weighted @ learnt, weighted @ innovation[:, 0]
    if told is not None:
        information, pull = information - told[0], pull - told[1]
    unknowns = beliefs.after(information, pull)
    columns, shown = _kernel.smoothed(
        transition, sample, row, rows, predicted, spread, gain, innovation, expected, seen
    )
    left = innovation[:, 0] - innovation[:, 1:] @ unknowns.mean
    squares = left**2 / expected
    consistency = {
        each.source: float(squares[origin == number].mean())
        for number, each in enumerate(measurements)
        if each.sample.size
    }
    return Smoothed(columns, shown, unknowns, consistency, normal)
