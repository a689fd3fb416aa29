"""Correct the inertial package's angle: choose a method, add the bias back, low-pass, sample.

Each method is one file with a function that says what it lacks and one that estimates the bias;
`_METHODS` lists them in order of preference.
"""

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.flags import Flag
from glint_aoa.inertial import harmonic, kinematic, modal, nlr, regression, spectral
from glint_aoa.inertial.estimate import MISALIGNMENT_STD, BiasEstimate, CorrectionTask
from glint_aoa.inertial.filters import settling_s
from glint_aoa.inertial.modes import modes_from_setup
from glint_aoa.inertial.output import FilteredOutput
from glint_aoa.inertial.package import calibrated_output
from glint_aoa.records._files import check_new, make_folder
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.tables import write_csv
from glint_aoa.setup import Inertial

__all__ = ["Correction", "correct", "write_correction"]

_Floats = NDArray[np.float64]

UNCERTAIN_DEG = 0.01
"""A correction less certain than this (1 sigma) is flagged [deg]: the static accuracy."""

STRETCH_S = 600.0
"""Records longer than one and a half times this are corrected in stretches of about this [s]."""

_OVERLAP_SETTLINGS = 5.0  # of the low-pass: a start is forgotten to one part in 10^9
_OVERLAP_S = 6.0  # besides: mirror images at the ends of a band reach four seconds


@dataclass(frozen=True)
class _Method:
    missing: Callable[[CorrectionTask], str | None]
    estimate: Callable[[CorrectionTask], BiasEstimate]


_METHODS: Mapping[str, _Method] = {
    "kinematic": _Method(kinematic.missing, kinematic.estimate_bias),
    "modal": _Method(modal.missing, modal.estimate_bias),
    "regression": _Method(regression.missing, regression.estimate_bias),
    "nlr": _Method(nlr.missing, nlr.estimate_bias),
    "harmonic": _Method(harmonic.missing, harmonic.estimate_bias),
    "spectral": _Method(spectral.missing, spectral.estimate_bias),
}


@dataclass(frozen=True, eq=False)
class Correction:
    """A corrected record of the inertial package.

    Attributes
    ----------
    time_s : ndarray [row]
        Time after the trigger [s].
    angle_deg : ndarray [row]
        Corrected angle after the low-pass [deg].
    angle_std_deg : ndarray [row]
        Its standard uncertainty, 1 sigma [deg].
    raw_angle_deg : ndarray [row]
        Uncorrected angle after the same low-pass [deg].
    bias_deg : ndarray [row]
        Estimated bias, raw minus corrected [deg].
    flags : ndarray [row]
        Bit mask of `glint_aoa.flags.Flag`; 0 is good.
    method : str
        The method used.
    why : str
        Why this method, and what it used.
    settings : mapping
        Figures behind the result.
    """

    time_s: _Floats
    angle_deg: _Floats
    angle_std_deg: _Floats
    raw_angle_deg: _Floats
    bias_deg: _Floats
    flags: NDArray[np.int64]
    method: str
    why: str
    settings: Mapping[str, object]

    @property
    def settled(self) -> NDArray[np.bool_]:
        """Rows [row] that do not feel the ends of the record; all of them if every row does."""
        free: NDArray[np.bool_] = (self.flags & int(Flag.FILTER_SETTLING)) == 0
        return free if free.any() else ~free


def correct(
    record: AcquisitionRecord,
    inertial: Inertial,
    *,
    method: str = "auto",
    causal: bool = False,
    rate_hz: float = 20.0,
    relative_std: float = 0.01,
    misalignment_std: float = MISALIGNMENT_STD,
) -> Correction:
    """Correct the inertial angle for the bias of vibration.

    The estimated centripetal acceleration is added to the package's unfiltered output, the sum
    runs through the low-pass of the setup and is turned into an angle.

    Parameters
    ----------
    record : AcquisitionRecord
        Package output and accelerometers, sampled together.
    inertial : Inertial
        The setup's inertial section: low-pass and modes.
    method : str
        The name of a method, or ``"auto"``: the first of kinematic, modal ... that the record has
        the channels for and that is certain to 0.01 deg (1 sigma), else the most certain one.
    causal : bool
        False: low-pass forward and backward, without delay. True: forward only, as on-line. The
        bias before the low-pass is estimated from the whole record either way.
    rate_hz : float
        Rows a second [Hz]; the first row is at the record's start.
    relative_std : float
        Relative uncertainty, 1 sigma, of an accelerometer's gain (kinematic) or of the bias of
        a mode from its radius and from gains (modal).
    misalignment_std : float
        Uncertainty of the direction in which an accelerometer senses, 1 sigma [rad].

    Returns
    -------
    Correction
        One row every 1 / `rate_hz` seconds.

    Raises
    ------
    InputError
        If the method is unknown, lacks channels or modes, or `rate_hz` is not above zero.
    RecordingError
        If channels are not finite, differ in rate, start or length, or are too short.

    Notes
    -----
    If the record holds the package's filtered output only, the estimate runs through the same
    low-pass once forward, which is what the package did to its bias, and is added; angle and
    raw angle then keep the package's delay.

    `angle_std_deg` combines the package's noise after the low-pass, read from the corrected
    signal just above the cutoff, with the method's own error terms and with clipping; it is NaN
    where the method cannot know. It holds for the noise of a row, not for the package's static
    calibration.

    A record of more than 15 minutes is read and corrected in overlapping stretches of about ten,
    so its length costs time but no memory. The method is chosen on the first one.
    """
    if not rate_hz > 0:
        raise InputError(f"rate_hz is {rate_hz:g}; give a number of rows a second above zero")
    job = _Job(inertial, method, causal, rate_hz, relative_std, misalignment_std)
    stretches = _stretches(record, inertial)
    parts = [_correct_stretch(record, job, stretches[0])]
    for stretch in stretches[1:]:
        parts.append(_correct_stretch(record, replace(job, method=parts[0].method), stretch))
    return parts[0] if len(parts) == 1 else _joined(parts)


def write_correction(
    folder: str | Path, name: str, correction: Correction, *, overwrite: bool = False
) -> Path:
    """Write ``<name>.csv`` with one row for each row of the correction.

    Parameters
    ----------
    folder : str or Path
        Where to; it is made if it is not there.
    name : str
        Name of the record.
    correction : Correction
        What to write: time_s, angle_deg, angle_std_deg, raw_angle_deg, bias_deg, flags.
    overwrite : bool
        Whether a file of that name may be replaced.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        If the file exists and `overwrite` is False, or it cannot be written.
    """
    path = Path(folder) / f"{name}.csv"
    if not overwrite:
        check_new([path])
    make_folder(path.parent)
    columns = {column: getattr(correction, column) for column in _FORMATS}
    write_csv(path, columns, formats=_FORMATS)
    return path


_FORMATS = {
    "time_s": ".6f",
    "angle_deg": ".6f",
    "angle_std_deg": ".6f",
    "raw_angle_deg": ".6f",
    "bias_deg": ".6f",
    "flags": "d",
}

_FILTERED_ONLY = (
    "; only the filtered output is recorded, so the correction was low-passed alike and added to it"
)


@dataclass(frozen=True)
class _Job:
    """What `correct` was asked for."""

    inertial: Inertial
    method: str
    causal: bool
    rate_hz: float
    relative_std: float
    misalignment_std: float


@dataclass(frozen=True)
class _Stretch:
    """Samples of the package's output to read, and those of them whose rows are kept."""

    start: int
    stop: int
    keep_start: int
    keep_stop: int
    is_whole: bool


@dataclass(frozen=True, eq=False)
class _Candidate:
    """One method's correction of a stretch, before the low-passed output is sampled."""

    name: str
    estimate: BiasEstimate
    corrected: _Floats
    std: _Floats
    typical_std_deg: float


def _stretches(record: AcquisitionRecord, inertial: Inertial) -> list[_Stretch]:
    clock = record.package_clock()
    count = max(int(clock.size / clock.rate_hz / STRETCH_S + 0.5), 1)
    overlap = _OVERLAP_SETTLINGS * settling_s(inertial.filter) + _OVERLAP_S
    margin = math.ceil(overlap * clock.rate_hz)
    edges = [round(clock.size * part / count) for part in range(count + 1)]
    return [
        _Stretch(max(start - margin, 0), min(stop + margin, clock.size), start, stop, count == 1)
        for start, stop in itertools.pairwise(edges)
    ]


def _correct_stretch(record: AcquisitionRecord, job: _Job, stretch: _Stretch) -> Correction:
    start_s = record.package_clock().start_s
    part = record if stretch.is_whole else record.segment(stretch.start, stretch.stop)
    package = calibrated_output(part, job.inertial)
    modes = modes_from_setup(job.inertial)
    task = CorrectionTask(
        part, package, modes, job.inertial.filter, job.relative_std, job.misalignment_std
    )
    output = FilteredOutput(package, job.inertial.filter, job.causal or package.is_filtered)
    chosen, reason = _choose(job.method, task, output)
    rows = _rows(stretch, package.channel.rate_hz, job.rate_hz)
    within = rows - stretch.start / package.channel.rate_hz
    raw_angle = output.angle_deg(within, output.uncorrected)
    angle = output.angle_deg(within, chosen.corrected)
    angle_std = output.angle_std_deg(within, chosen.corrected, chosen.std)
    flags = output.flags(within, chosen.estimate)
    flags[~(angle_std <= UNCERTAIN_DEG)] |= Flag.UNCERTAIN_CORRECTION
    return Correction(
        time_s=start_s + rows,
        angle_deg=angle,
        angle_std_deg=angle_std,
        raw_angle_deg=raw_angle,
        bias_deg=raw_angle - angle,
        flags=flags,
        method=chosen.name,
        why=f"{reason}{chosen.estimate.why}{_FILTERED_ONLY if package.is_filtered else ''}",
        settings={
            "causal": output.causal,
            "filter_kind": job.inertial.filter.kind,
            "filter_order": job.inertial.filter.order,
            "filter_cutoff_hz": job.inertial.filter.cutoff,
            "package_channel": package.channel.name,
            **chosen.estimate.settings,
        },
    )


def _rows(stretch: _Stretch, sampling_hz: float, rate_hz: float) -> _Floats:
    """Return times of the rows to keep, after the record's start [s]."""
    first, last = stretch.keep_start / sampling_hz, stretch.keep_stop / sampling_hz
    end = (stretch.keep_stop - 1) / sampling_hz if stretch.keep_stop == stretch.stop else last
    numbers = np.arange(math.floor(first * rate_hz), int(end * rate_hz * (1 + 1e-12)) + 1)
    rows = numbers / rate_hz
    beyond = np.inf if stretch.keep_stop == stretch.stop else last
    return np.asarray(rows[(rows >= first) & (rows < beyond)])


def _joined(parts: list[Correction]) -> Correction:
    columns = ("time_s", "angle_deg", "angle_std_deg", "raw_angle_deg", "bias_deg", "flags")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in columns}
    first = parts[0]
    return Correction(
        **joined,
        method=first.method,
        why=f"{first.why}; in {len(parts)} stretches, the first of which this describes",
        settings={**first.settings, "stretches": len(parts)},
    )


def _choose(method: str, task: CorrectionTask, output: FilteredOutput) -> tuple[_Candidate, str]:
    """Return the correction and the first half of why its method was chosen."""
    if method == "auto":
        return _most_certain(task, output)
    if method not in _METHODS:
        raise InputError(f"method is {method!r}; choose one of {', '.join(['auto', *_METHODS])}")
    lack = _METHODS[method].missing(task)
    if lack is not None:
        raise InputError(f"{task.record.name}: the {method} correction lacks {lack}")
    return _candidate(method, task, output), "as asked: "


def _most_certain(task: CorrectionTask, output: FilteredOutput) -> tuple[_Candidate, str]:
    """Take the first method that is certain enough, else the most certain, and say why."""
    candidates: list[_Candidate] = []
    lacking: dict[str, str] = {}
    failures: dict[str, RecordingError] = {}
    for name, method in _METHODS.items():
        lack = method.missing(task)
        if lack is not None:
            lacking[name] = f"the {name} correction lacks {lack}"
            continue
        try:
            candidates.append(_candidate(name, task, output))
        except RecordingError as error:
            failures[name] = error
            continue
        if candidates[-1].typical_std_deg <= UNCERTAIN_DEG:
            break
    if not candidates:
        raise next(iter(failures.values()), None) or InputError(
            f"{task.record.name}: {'; '.join(lacking.values())}"
        )
    chosen = min(candidates, key=lambda each: each.typical_std_deg)
    doubts = [lacking[name] for name in list(_METHODS)[:1] if name in lacking]
    doubts += [
        f"the {each.name} correction is {_certain(each.typical_std_deg)} here"
        for each in candidates
        if each is not chosen
    ]
    doubts += [f"the {name} correction cannot be made" for name in failures]
    since = f", since {' and '.join(doubts)}" if doubts else ""
    return chosen, f"chosen automatically{since}: "


def _certain(std_deg: float) -> str:
    return f"certain to {std_deg:.3f} deg only" if np.isfinite(std_deg) else "of unknown certainty"


def _candidate(name: str, task: CorrectionTask, output: FilteredOutput) -> _Candidate:
    estimate = _METHODS[name].estimate(task)
    corrected = output.uncorrected + output.low_pass(estimate.addition)
    std = output.std(estimate, corrected)
    typical = output.typical_std_deg(corrected, std)
    return _Candidate(name, estimate, corrected, std, typical)
