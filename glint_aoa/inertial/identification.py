"""Identify modes from frequency responses: natural frequencies, dampings, shapes.

Poles by the least-squares complex frequency domain method, residues by a least-squares fit, both of
`sdypy-EMA` (Verboven, Frequency-domain system identification for modal analysis, 2002). Which poles
are modes is decided here, without a person at a stabilisation chart: those that the orders of the
model share.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from glint_aoa.inertial.modes import ModeShape, Plane

__all__ = ["Form", "SurveyResponses", "mode_shapes", "natural_frequencies", "real_shape"]

_Floats = NDArray[np.float64]
_Complex = NDArray[np.complex128]
Form = Literal["accelerance", "mobility", "receptance"]

_ORDERS = 24  # pairs of poles of the highest model; physical poles settle well below
_SETTLED = 0.5  # of the orders, from the highest down, over which a pole must stand still
_SAME_POLE = 0.003  # of its size: poles of two orders no farther apart are one
_MOST_DAMPING = 0.1
_PROMINENCE = 4.0  # of a resonance's power over the saddles beside it
_WITHIN = 0.04  # of a frequency given or seen: where its pole is looked for
_MAD_STD = 1.4826  # standard deviation over median absolute deviation, normal distribution


@dataclass(frozen=True, eq=False)
class SurveyResponses:
    """Frequency responses of points along the fuselage to one force, in one plane.

    Attributes
    ----------
    plane : {"yaw", "pitch"}
        Plane of the motion.
    frequency_hz : ndarray [bin]
        Frequencies [Hz], evenly spaced.
    response : ndarray [point, bin]
        Complex responses along +y (yaw) or +z (pitch), per unit of the force.
    station_m : ndarray [point]
        Stations, model x [m].
    form : {"accelerance", "mobility", "receptance"}
        Whether accelerations, velocities or displacements were measured.
    """

    plane: Plane
    frequency_hz: _Floats
    response: _Complex
    station_m: _Floats
    form: Form = "accelerance"


def natural_frequencies(
    responses: SurveyResponses, *, low_hz: float = 5.0, high_hz: float = 60.0
) -> list[float]:
    """See resonances as peaks of the summed power of all points.

    Parameters
    ----------
    responses : SurveyResponses
        From a sine sweep or a random record.
    low_hz, high_hz : float
        Where to look [Hz]; the paper's shaker drove 5 to 60 Hz.

    Returns
    -------
    list of float
        Frequencies of peaks that stand four times over the saddles beside them [Hz], rising,
        refined by a parabola through the logarithms of three bins. Two modes closer than about
        their bandwidths show as one: give both to `mode_shapes`.
    """
    frequency = responses.frequency_hz
    inside = (frequency >= low_hz) & (frequency <= high_hz)
    level = np.log(np.sum(np.abs(responses.response[:, inside]) ** 2, axis=0) + 1e-300)
    peaks, _ = scipy.signal.find_peaks(level, prominence=math.log(_PROMINENCE))
    left, middle, right = level[peaks - 1], level[peaks], level[peaks + 1]
    step = frequency[1] - frequency[0]
    shift = 0.5 * (left - right) / (left - 2 * middle + right)
    return [float(each) for each in frequency[inside][peaks] + shift * step]


def mode_shapes(
    responses: SurveyResponses,
    *,
    near_hz: Sequence[float] | None = None,
    low_hz: float = 5.0,
    high_hz: float = 60.0,
) -> list[ModeShape]:
    """Identify natural frequencies, dampings and mode shapes from frequency responses.

    Parameters
    ----------
    responses : SurveyResponses
        Of one plane; two bins or more to a resonance.
    near_hz : sequence of float, optional
        Where the modes are, to 4 % [Hz]; peaks of the responses if not given.
    low_hz, high_hz : float
        Band of the fit [Hz]; take in a little more than the modes.

    Returns
    -------
    list of ModeShape
        By rising frequency, numbered from 1. Standard deviations are those of the frequency over
        the orders of the model and within a bin, and of the coefficients from what the fit leaves.

    Raises
    ------
    InputError
        If the band is not within the responses, there is no resonance, or no pole settles at a
        frequency given.

    Notes
    -----
    Shapes are the residues turned to the phase in which they are most nearly real; what is left
    out of phase is told by `ModeShape.collinearity`. The standard deviations hold for noise; what
    leakage does to all points alike they need not show.
    """
    frequency = responses.frequency_hz
    if not frequency[0] <= low_hz < high_hz <= frequency[-1]:
        raise InputError(
            f"the band from {low_hz:g} to {high_hz:g} Hz does not lie within the responses, which "
            f"run from {frequency[0]:g} to {frequency[-1]:g} Hz; give low_hz and high_hz"
        )
    seen = natural_frequencies(responses, low_hz=low_hz, high_hz=high_hz)
    model = _Model(responses, low_hz, high_hz)
    settled = _all_settled(model.poles, seen if near_hz is None else near_hz)
    for each in near_hz or ():
        if _settled(model.poles, each) is not None:
            continue
        raise InputError(
            f"no mode settles near {each:g} Hz; look at the responses there, or leave it out of "
            "near_hz"
        )
    if not settled:
        raise InputError(
            f"no resonance stands out between {low_hz:g} and {high_hz:g} Hz; record longer or give "
            "near_hz"
        )
    bins, left, residues = model.fit([(each.order, each.index) for each in settled])
    return [
        _mode_shape(
            number,
            pole,
            responses,
            residue,
            _residue_std(left, bins, residue, pole.pole, responses.form),
        )
        for number, (pole, residue) in enumerate(zip(settled, residues.T, strict=True), 1)
    ]


def real_shape(coefficient: _Complex) -> tuple[_Floats, float]:
    """Turn a complex shape to the phase in which it is most nearly real.

    Parameters
    ----------
    coefficient : ndarray [point]
        Complex coefficients.

    Returns
    -------
    shape : ndarray [point]
        Real part after turning, its largest coefficient positive; its scale is kept.
    collinearity : float
        Modal phase collinearity: 1 for a shape wholly in phase, 0 for one in circles.
    """
    turned = coefficient * np.exp(-0.5j * np.angle(np.sum(coefficient**2)))
    shape = turned.real * np.sign(turned.real[np.argmax(np.abs(turned.real))])
    power = float(np.sum(np.abs(coefficient) ** 2))
    return shape, float(np.abs(np.sum(coefficient**2)) / power) ** 2 if power else 0.0


class _Model:
    """What is used of `sdypy.EMA.Model`, whose module takes a second to load."""

    def __init__(self, responses: SurveyResponses, low_hz: float, high_hz: float) -> None:
        from sdypy import EMA  # noqa: PLC0415  loads matplotlib

        frequency = responses.frequency_hz
        usable = (frequency >= low_hz) & np.isfinite(responses.response).all(axis=0)
        self._model = EMA.Model(
            np.where(usable, responses.response, 0.0),
            frequency,
            lower=low_hz,
            upper=high_hz,
            pol_order_high=_ORDERS,
            frf_form=responses.form,
        )
        self._model.get_poles(method="lscf", show_progress=False)
        self._low_hz, self._high_hz = low_hz, float(self._model.freq[-1])

    @property
    def poles(self) -> list[_Complex]:
        """Poles of each order of the model, rising [rad/s]."""
        return [np.asarray(each, np.complex128) for each in self._model.all_poles]

    def fit(self, places: list[tuple[int, int]]) -> tuple[_Floats, _Complex, _Complex]:
        """Frequencies [Hz, bin], what the fit leaves [point, bin] and residues [point, mode]."""
        model = self._model
        model.pole_ind = np.array(places)
        rebuilt, residues = model.get_constants(f_lower=self._low_hz, f_upper=self._high_hz)
        inside = (model.freq >= self._low_hz) & (model.freq < self._high_hz)
        return model.freq[inside], (model.frf - rebuilt)[:, inside], residues


@dataclass(frozen=True)
class _Settled:
    order: int
    index: int
    pole: complex
    std_hz: float


def _all_settled(poles: list[_Complex], near_hz: Sequence[float]) -> list[_Settled]:
    """Settled poles near frequencies, rising, each once."""
    found: list[_Settled] = []
    for each in sorted(near_hz):
        pole = _settled(poles, each)
        if pole is not None and all(not _is_same(pole.pole, other.pole) for other in found):
            found.append(pole)
    return found


def _settled(poles: list[_Complex], near_hz: float) -> _Settled | None:
    """Find the pole near a frequency that most orders of the model share, if half of them do."""
    first = round(len(poles) * (1 - _SETTLED))
    seen = [
        (order, int(index))
        for order in range(first, len(poles))
        for index in np.flatnonzero(_is_candidate(poles[order], near_hz))
    ]
    values = np.array([poles[order][index] for order, index in seen], np.complex128)
    orders = np.array([order for order, _ in seen])
    close = _is_same(values, values[:, None])
    shared = np.array([np.unique(orders[each]).size for each in close], int)
    if not shared.size or shared.max() < (len(poles) - first) / 2:
        return None
    off = np.abs(np.abs(values) / (2 * np.pi) - near_hz)
    best = int(np.lexsort((off, -shared))[0])
    members = np.abs(values[close[best]]) / (2 * np.pi)
    scatter = _MAD_STD * float(np.median(np.abs(members - np.median(members))))
    return _Settled(*seen[best], pole=complex(values[best]), std_hz=scatter)


def _is_same(one: _Complex | complex, other: _Complex | complex) -> NDArray[np.bool_]:
    return np.asarray(np.abs(one - other) <= _SAME_POLE * np.abs(one))


def _is_candidate(poles: _Complex, near_hz: float) -> NDArray[np.bool_]:
    size = np.maximum(np.abs(poles), np.finfo(float).tiny)
    damping = -poles.real / size
    near = np.abs(size / (2 * np.pi) - near_hz) < _WITHIN * near_hz
    return np.asarray(near & (poles.imag > 0) & (damping > 0) & (damping < _MOST_DAMPING))


def _mode_shape(
    number: int, pole: _Settled, responses: SurveyResponses, residue: _Complex, noise: float
) -> ModeShape:
    coefficient, collinearity = real_shape(residue)
    size = abs(pole.pole)
    step = responses.frequency_hz[1] - responses.frequency_hz[0]
    return ModeShape(
        number=number,
        plane=responses.plane,
        frequency_hz=size / (2 * np.pi),
        station_m=responses.station_m,
        coefficient=coefficient,
        coefficient_std=np.full(coefficient.size, noise),
        frequency_std_hz=float(np.hypot(pole.std_hz, step / np.sqrt(12))),
        damping=-pole.pole.real / size,
        collinearity=collinearity,
    )


def _residue_std(
    left: _Complex, frequency_hz: _Floats, residue: _Complex, pole: complex, form: Form
) -> float:
    """Tell the noise of a mode's residues, 1 sigma, from what the fit leaves around its pole.

    What is left in the mode's own shape changes its scale and damping only, and is taken off.
    """
    circular = 2 * np.pi * frequency_hz
    power = {"accelerance": 2, "mobility": 1, "receptance": 0}[form]
    reach = np.abs(circular**power / (1j * circular - pole)) ** 2
    own = residue / np.sqrt(np.vdot(residue, residue).real)
    across = left - np.outer(own, own.conj() @ left)
    noise = np.mean(np.abs(across) ** 2, axis=0) * left.shape[0] / (left.shape[0] - 1)
    return float(np.sqrt(np.sum(reach * noise) / 2) / np.sum(reach))
