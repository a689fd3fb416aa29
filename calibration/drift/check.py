"""Whether a calibration still holds: points taken later, and what has moved if it does not.

A sweep is a state of camera, lamp, model and onboard sensor. Points at rest taken later (at the
start and end of a run, two days on) show its drift in two ways at once, in the angle between
optical and onboard system and in the intercept, and each cause leaves its own pattern of both over
the angles:

====================================  ===========================  ===========================
what has changed                      calibrated less onboard       intercept
====================================  ===========================  ===========================
camera rolled (phi)                   constant                      in proportion to its X
camera tilted (omega), rose, sank     hardly                        constant
camera panned (kappa), moved along    hardly                        in proportion to the slope
model moved up or down                hardly                        constant
lamp moved across or up               in proportion to the angle    constant
onboard sensor's zero                 constant                      none
onboard sensor's scale                in proportion to the angle    none
====================================  ===========================  ===========================

A tilted camera and a model that moved up or down look alike, and so do a rolled camera and an
onboard zero. A reference mark in view (``[glint.reference]``) tells the camera from the rest, the
nominal angle of the points a model that sagged, and turned with it, or an onboard sensor that
drifted; without them the verdict names both.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, special

from calibration.drift._model import Cause, Observations, Trial, observe, trials
from calibration.drift._reference import SweepReference
from calibration.sweep.pitch_sweep import PitchSweep
from calibration.sweep.point import SweepPoint, check_no_duplicates, in_order_of_time
from glint_aoa.errors import CalibrationError
from glint_aoa.setup import Setup

__all__ = ["Change", "CheckedPoint", "Drift", "Hypothesis", "check_drift"]

Floats = NDArray[np.float64]
Mover = Literal["camera", "lamp", "model", "onboard sensor"]
Verdict = Literal["unchanged", Mover, "undecided", "unknown"]

_DRIFTED = 0.05  # probability that nothing has changed, below which something has
_CERTAIN = 0.95  # probability of a cause among those that are left
_WORTH_NAMING = 0.05
_UNEXPLAINED = 1e-4  # p-value of the best hypothesis, below which it is none
_DIFFERS = 0.01  # p-value below which calibrated and onboard angles differ
_PRIOR = 0.5  # that nothing has changed; the causes share the rest


@dataclass(frozen=True)
class Change:
    """An estimated change, with its uncertainty, 1 sigma, in the same unit."""

    name: str
    value: float
    std: float
    unit: str

    def __str__(self) -> str:
        """Return it as it is printed, the uncertainty with two digits."""
        digits = max(0, 1 - int(np.floor(np.log10(self.std)))) if self.std > 0 else 6
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name} {self.value:+.{digits}f} +/- {self.std:.{digits}f}{unit}"


@dataclass(frozen=True)
class Hypothesis:
    """What may have happened, and how well it explains the check points.

    Attributes
    ----------
    name : str
        In words.
    cause : str
        ``"nothing"``, ``"camera"``, ``"lamp"``, ``"model"`` or ``"onboard sensor"``.
    changes : tuple of Change
        What of the sweep's state would have changed, and by how much.
    chi_square : float
        What the best fit leaves, in units of uncertainty squared.
    degrees_of_freedom : int
        Observations less parameters that they determine.
    probability : float
        Among all hypotheses, with the check points known.
    """

    name: str
    cause: Cause
    changes: tuple[Change, ...]
    chi_square: float
    degrees_of_freedom: int
    probability: float

    @property
    def p_value(self) -> float:
        """Chance of so large a chi-square if the hypothesis is true."""
        return float(special.chdtrc(self.degrees_of_freedom, self.chi_square))


@dataclass(frozen=True)
class CheckedPoint:
    """A check point against the sweep; standard deviations, 1 sigma, include the sweep's own.

    Attributes
    ----------
    point : SweepPoint
        The point.
    angle_deg, angle_std_deg : float
        Calibrated optical less onboard angle [deg].
    intercept_mm, intercept_std_mm : float or None
        Intercept less the sweep's at that angle [mm].
    hours : float or None
        Time since the sweep's last point [h].
    """

    point: SweepPoint
    angle_deg: float
    angle_std_deg: float
    intercept_mm: float | None
    intercept_std_mm: float | None
    hours: float | None


@dataclass(frozen=True, eq=False)
class Drift:
    """The verdict on a calibration, with its evidence.

    Attributes
    ----------
    verdict : str
        ``"unchanged"``; the cause, ``"camera"``, ``"lamp"``, ``"model"`` or ``"onboard sensor"``;
        ``"undecided"`` where two causes or more remain; ``"unknown"`` where none explains it.
    sentence : str
        The verdict in words, and the next step.
    hypotheses : tuple of Hypothesis
        The most probable first.
    signatures : tuple of Change
        Offset and scale of the angle, offset of the intercept and its change with the angle:
        weighted straight lines through the check points, whatever the cause.
    points : tuple of CheckedPoint
        In the order of time.
    angle_p_value : float
        Chance that calibrated and onboard angles differ as much as they do if they agree.
    """

    verdict: Verdict
    sentence: str
    hypotheses: tuple[Hypothesis, ...]
    signatures: tuple[Change, ...]
    points: tuple[CheckedPoint, ...]
    angle_p_value: float

    @property
    def has_drifted(self) -> bool:
        """Whether anything has changed, even if the angle does not feel it."""
        return self.verdict != "unchanged"

    @property
    def angle_holds(self) -> bool:
        """Whether calibrated and onboard angle agree as far as the check points can tell."""
        return not self.has_drifted or self.angle_p_value >= _DIFFERS


def check_drift(sweep: PitchSweep, points: Sequence[SweepPoint], setup: Setup) -> Drift:
    r"""Hold points at rest against a sweep taken earlier, and name what has changed.

    Each hypothesis predicts the observations y up to a few parameters x, y = A x + e with e of the
    covariance C of points and sweep together. The columns of A come from the geometry, see
    `calibration.drift._signatures`. With plausible sizes P of the parameters the evidence of a
    hypothesis is the density of y under :math:`N(0, C + A P A^T)`: it rewards a small chi-square
    and punishes parameters that are not needed (MacKay, Neural Computation 4, 415, 1992).

    Parameters
    ----------
    sweep : PitchSweep
        The calibration.
    points : sequence of SweepPoint
        Points at rest taken later, at several angles if possible: at one angle, a change of scale
        cannot be told from an offset.
    setup : Setup
        The setup of both; with ``[glint.reflection]`` the lamp's pattern is worked out, without it
        a change of scale together with the glint's height stands for it.

    Returns
    -------
    Drift
        Unchanged unless the probability of that falls below 5 %. Probabilities start from one half
        for no change, and the causes share the rest.

    Raises
    ------
    CalibrationError
        If there is no point, one is given twice, the camera has no place in the tunnel, or the
        setup is another than the sweep's.

    Notes
    -----
    One cause at a time is tried. Points that drift while they are taken fit none; give those of
    one hour at a time then. A camera nearer or farther changes next to nothing in the angle, and
    a little in the intercept; it is not tried for itself.
    """
    _check(sweep, points, setup)
    ordered = in_order_of_time(points)
    reference = SweepReference.of(sweep)
    seen = observe(sweep, reference, ordered)
    columns = sweep.setup.columns if sweep.setup is not None else None
    tried = trials(seen, sweep, ordered, setup, columns or _all_columns(setup))
    hypotheses = _weighed(tried, seen)
    verdict, words = _judged(hypotheses)
    angle_p_value = _agreement(seen)
    return Drift(
        verdict=verdict,
        sentence=f"{words}; {_next_step(verdict, angle_p_value)}",
        hypotheses=hypotheses,
        signatures=_signatures(seen, ordered),
        points=_checked_points(sweep, seen, ordered),
        angle_p_value=angle_p_value,
    )


def _check(sweep: PitchSweep, points: Sequence[SweepPoint], setup: Setup) -> None:
    if not points:
        raise CalibrationError("no check points; give at least one point at rest")
    check_no_duplicates(points)
    names = {point.time for point in sweep.points if point.time}
    again = next((point for point in points if point.time and point.time in names), None)
    if again is not None:
        raise CalibrationError(
            f"{again.name}: taken at {again.time}, as a point of the sweep itself; "
            "give points that were taken later"
        )
    if not setup.camera.is_oriented:
        raise CalibrationError(
            "a drift is told by the camera's geometry; give focal_length, pixel_pitch and position "
            "in [camera]"
        )
    sweep.check_setup(setup)


def _all_columns(setup: Setup) -> tuple[float, float]:
    point, sensor = setup.camera.principal_point, setup.camera.sensor
    if sensor is not None:
        return 0.0, sensor[0] - 1.0
    return 0.0, 2 * (point[0] if point is not None else 0.0)


def _weighed(tried: Sequence[Trial], seen: Observations) -> tuple[Hypothesis, ...]:
    """Fit each hypothesis and share the probability among them by their evidence."""
    of_cause = {cause: sum(each.cause == cause for each in tried) for cause in _causes(tried)}
    n_causes = len(of_cause) - 1
    log = np.array([_log_evidence(each, seen) for each in tried])
    for number, each in enumerate(tried):
        share = _PRIOR if each.cause == "nothing" else (1 - _PRIOR) / n_causes
        log[number] += np.log(share / of_cause[each.cause])
    probability = np.exp(log - log.max())
    probability /= probability.sum()
    fitted = [_fitted(each, seen, float(p)) for each, p in zip(tried, probability, strict=True)]
    return tuple(sorted(fitted, key=lambda each: -each.probability))


def _causes(tried: Sequence[Trial]) -> list[Cause]:
    return list(dict.fromkeys(each.cause for each in tried))


def _design(trial: Trial, seen: Observations) -> Floats:
    columns = [each.effect for each in trial.parameters]
    return np.array(columns).reshape(-1, seen.values.size).T


def _log_evidence(trial: Trial, seen: Observations) -> float:
    """Log density of the observations, up to what all hypotheses share."""
    whiten = np.linalg.inv(np.linalg.cholesky(seen.covariance))
    sizes = np.array([each.plausible for each in trial.parameters])
    spread, values = whiten @ (_design(trial, seen) * sizes), whiten @ seen.values
    root = np.linalg.cholesky(np.eye(values.size) + spread @ spread.T)
    standard = linalg.solve_triangular(root, values, lower=True)
    return float(-np.log(np.diag(root)).sum() - 0.5 * standard @ standard)


def _fitted(trial: Trial, seen: Observations, probability: float) -> Hypothesis:
    """Estimate the parameters, their plausible sizes taken as known, and chi-square without."""
    whiten = np.linalg.inv(np.linalg.cholesky(seen.covariance))
    design, values = whiten @ _design(trial, seen), whiten @ seen.values
    sizes = np.array([each.plausible for each in trial.parameters])
    covariance = np.linalg.inv(design.T @ design + np.diag(1 / sizes**2))
    estimate = covariance @ design.T @ values
    least, _, rank, _ = np.linalg.lstsq(design, values, rcond=None)
    return Hypothesis(
        name=trial.name,
        cause=trial.cause,
        changes=tuple(
            Change(each.name, float(value), float(std), each.unit)
            for each, value, std in zip(
                trial.parameters, estimate, np.sqrt(np.diag(covariance)), strict=True
            )
        ),
        chi_square=float(np.sum((values - design @ least) ** 2)),
        degrees_of_freedom=int(values.size - rank),
        probability=probability,
    )


def _judged(hypotheses: Sequence[Hypothesis]) -> tuple[Verdict, str]:
    same = sum(each.probability for each in hypotheses if each.cause == "nothing")
    share: dict[Mover, float] = {}
    for each in hypotheses:
        if each.cause != "nothing":
            share[each.cause] = share.get(each.cause, 0.0) + each.probability
    if same >= _DRIFTED:
        return "unchanged", "Nothing has changed that these points could show"
    best = next(each for each in hypotheses if each.cause != "nothing")
    if best.degrees_of_freedom > 0 and best.p_value < _UNEXPLAINED:
        return "unknown", (
            "Something has changed that no single cause explains: several did, or they changed "
            "while the points were taken"
        )
    left = {cause: part / (1 - same) for cause, part in share.items()}
    cause = max(left, key=lambda each: left[each])
    if left[cause] >= _CERTAIN:
        changes = "; ".join(map(str, best.changes))
        return cause, f"{best.name[0].upper()}{best.name[1:]} ({changes})"
    named = [
        each.name
        for each in hypotheses
        if each.cause != "nothing" and each.probability >= _WORTH_NAMING * best.probability
    ]
    return "undecided", f"One of these, and the points cannot tell which: {'; '.join(named)}"


def _next_step(verdict: Verdict, angle_p_value: float) -> str:
    if verdict == "unchanged":
        return "the calibration holds"
    if angle_p_value >= _DIFFERS:
        return "the calibration still holds for the angle"
    return "the calibrated angle has changed: repeat the sweep"


def _agreement(seen: Observations) -> float:
    where = seen.of("angle")
    values = seen.values[where]
    chi_square = values @ np.linalg.solve(seen.covariance[where, where], values)
    return float(special.chdtrc(values.size, chi_square))


def _signatures(seen: Observations, points: Sequence[SweepPoint]) -> tuple[Change, ...]:
    """Fit straight lines over the angle to the shifts of angle and intercept."""
    angle = np.array([point.onboard_deg for point in points])
    several = np.ptp(angle) > 1.0
    found: list[Change] = []
    for kind, unit in (("angle", "deg"), ("intercept", "mm")):
        if kind not in seen.kinds:
            continue
        where = seen.of(kind)
        powers = np.vander(angle, 2 if several else 1, increasing=True)
        whiten = np.linalg.inv(np.linalg.cholesky(seen.covariance[where, where]))
        design = whiten @ powers
        covariance = np.linalg.inv(design.T @ design)
        values = covariance @ design.T @ (whiten @ seen.values[where])
        stds = np.sqrt(np.diag(covariance))
        names = (f"{kind} offset", f"{kind} per deg")
        found += [
            Change(name, float(value), float(std), unit)
            for name, value, std in zip(names, values, stds, strict=False)
        ]
    return tuple(found)


def _checked_points(
    sweep: PitchSweep, seen: Observations, points: Sequence[SweepPoint]
) -> tuple[CheckedPoint, ...]:
    n = len(points)
    none: list[float | None] = [None] * n
    has = "intercept" in seen.kinds
    shift = seen.values[seen.of("intercept")].tolist() if has else none
    shift_std = seen.std("intercept").tolist() if has else none
    moments = [point.moment for point in sweep.points]
    ends = [moment for moment in moments if moment is not None]
    angle, angle_std = seen.values[seen.of("angle")], seen.std("angle")
    return tuple(
        CheckedPoint(
            point=point,
            angle_deg=float(angle[k]),
            angle_std_deg=float(angle_std[k]),
            intercept_mm=shift[k],
            intercept_std_mm=shift_std[k],
            hours=(point.moment - max(ends)).total_seconds() / 3600
            if ends and point.moment is not None
            else None,
        )
        for k, point in enumerate(points)
    )
