"""Correct the inertial package's angle: choose a method, add the bias back, low-pass, sample.

Each method is one file with a function that says what it lacks and one that estimates the bias;
`_METHODS` lists them in order of preference.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from glint_aoa.flags import Flag
from glint_aoa.inertial import modal
from glint_aoa.inertial.channels import PackageOutput, package_output
from glint_aoa.inertial.estimate import BiasEstimate
from glint_aoa.inertial.filters import low_pass, noise_bandwidth_hz, settling_s
from glint_aoa.inertial.modes import Mode, modes_from_setup
from glint_aoa.inertial.sensor import indicated_angle
from glint_aoa.records._files import check_new, make_folder
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.tables import write_csv
from glint_aoa.setup import Inertial
from glint_aoa.units import STANDARD_GRAVITY

__all__ = ["Correction", "correct", "write_correction"]

_Floats = NDArray[np.float64]

UNCERTAIN_DEG = 0.01
"""A correction less certain than this (1 sigma) is flagged [deg]: the static accuracy."""

_NOISE_BAND = (1.5, 10.0)  # times the cutoff: beyond the angle's changes, below the modes
_SEGMENT_S = 8.0


@dataclass(frozen=True)
class _Method:
    missing: Callable[[AcquisitionRecord, PackageOutput, tuple[Mode, ...]], str | None]
    estimate: Callable[..., BiasEstimate]


_METHODS: Mapping[str, _Method] = {"modal": _Method(modal.missing, modal.estimate_bias)}


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
        ``"auto"`` or the name of a method.
    causal : bool
        False: low-pass forward and backward, without delay. True: forward only, as on-line. The
        bias before the low-pass is estimated from the whole record either way.
    rate_hz : float
        Rows a second [Hz]; the first row is at the record's start.
    relative_std : float
        Uncertainty of each mode's bias from its radius and from gains, 1 sigma, relative.

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
    signal just above the cutoff, with the method's own error terms and with clipping. It holds
    for the noise of a row, not for the package's static calibration.
    """
    if not rate_hz > 0:
        raise InputError(f"rate_hz is {rate_hz:g}; give a number of rows a second above zero")
    package = package_output(record)
    modes = modes_from_setup(inertial)
    name, reason = _choose(method, record, package, modes)
    estimate = _METHODS[name].estimate(record, package, modes, relative_std=relative_std)
    run = _Run(package, inertial, causal or package.is_filtered)
    filtered_bias = run.low_pass(estimate.addition)
    raw = run.package_filtered()
    corrected = raw + filtered_bias
    std = run.std(estimate, corrected)
    rows = run.rows(rate_hz)
    angle, raw_angle = (
        np.degrees(indicated_angle(run.at(rows, each))) for each in (corrected, raw)
    )
    angle_std = np.degrees(run.at(rows, std) / _slope(run.at(rows, corrected)))
    settings = {
        "causal": run.causal,
        "filter_kind": inertial.filter.kind,
        "filter_order": inertial.filter.order,
        "filter_cutoff_hz": inertial.filter.cutoff,
        "package_channel": package.channel.name,
        **estimate.settings,
    }
    return Correction(
        time_s=package.channel.start_s + rows,
        angle_deg=angle,
        angle_std_deg=angle_std,
        raw_angle_deg=raw_angle,
        bias_deg=raw_angle - angle,
        flags=run.flags(rows, estimate, angle_std),
        method=name,
        why=f"{reason}{estimate.why}{_FILTERED_ONLY if package.is_filtered else ''}",
        settings=settings,
    )


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


def _choose(
    method: str, record: AcquisitionRecord, package: PackageOutput, modes: tuple[Mode, ...]
) -> tuple[str, str]:
    """Return the method's name and the first half of why it was chosen."""
    if method != "auto" and method not in _METHODS:
        raise InputError(f"method is {method!r}; choose one of {', '.join(['auto', *_METHODS])}")
    names = list(_METHODS) if method == "auto" else [method]
    lacking = {name: _METHODS[name].missing(record, package, modes) for name in names}
    for name, lack in lacking.items():
        if lack is None:
            return name, "chosen automatically: " if method == "auto" else "as asked: "
    needs = "; ".join(f"the {name} correction lacks {lack}" for name, lack in lacking.items())
    raise InputError(f"{record.name}: {needs}")


def _slope(specific_force: _Floats) -> _Floats:
    """Change of the specific force with the angle, g cos(alpha) [m/s^2 per rad]."""
    ratio = np.clip(specific_force / STANDARD_GRAVITY, -0.999, 0.999)
    return np.asarray(STANDARD_GRAVITY * np.sqrt(1 - ratio**2))


@dataclass(frozen=True, eq=False)
class _Run:
    """One package output on its way through the low-pass."""

    package: PackageOutput
    inertial: Inertial
    causal: bool

    @property
    def rate_hz(self) -> float:
        return self.package.channel.rate_hz

    @property
    def time_s(self) -> _Floats:
        return np.asarray(np.arange(self.package.specific_force.size) / self.rate_hz)

    def low_pass(self, samples: _Floats) -> _Floats:
        return low_pass(samples, self.rate_hz, self.inertial.filter, causal=self.causal)

    def package_filtered(self) -> _Floats:
        if self.package.is_filtered:
            return self.package.specific_force
        return self.low_pass(self.package.specific_force)

    def rows(self, rate_hz: float) -> _Floats:
        """Return times of the rows after the record's start [s]."""
        last = self.time_s[-1]
        return np.asarray(np.arange(int(last * rate_hz * (1 + 1e-12)) + 1) / rate_hz)

    def at(self, rows: _Floats, samples: _Floats) -> _Floats:
        return np.interp(rows, self.time_s, samples)

    def std(self, estimate: BiasEstimate, corrected: _Floats) -> _Floats:
        """Return the standard uncertainty of the corrected specific force [sample, m/s^2]."""
        terms = [self.low_pass(term) for term in estimate.std_terms]
        variance = np.sum([term**2 for term in terms], axis=0) + self._noise(estimate, corrected)
        if np.any(estimate.clipped):
            clipped = np.clip(self.low_pass(estimate.clipped.astype(float)), 0.0, 0.9)
            variance = variance + (clipped / (1 - clipped) * self.low_pass(estimate.addition)) ** 2
        return np.asarray(np.sqrt(variance))

    def _noise(self, estimate: BiasEstimate, corrected: _Floats) -> float:
        """Variance of the noise after the low-pass, from its density above the cutoff."""
        filter_ = self.inertial.filter
        if self.package.is_filtered:
            return float(np.var(np.diff(corrected)) / 2)
        signal = self.package.specific_force + estimate.addition
        segment = min(signal.size, round(_SEGMENT_S * self.rate_hz))
        bins, density = scipy.signal.welch(signal, self.rate_hz, nperseg=segment)
        low, high = (edge * filter_.cutoff for edge in _NOISE_BAND)
        level = float(np.median(density[(bins >= low) & (bins <= high)]))
        return level * noise_bandwidth_hz(filter_, causal=self.causal)

    def flags(self, rows: _Floats, estimate: BiasEstimate, angle_std: _Floats) -> NDArray[np.int64]:
        settling = settling_s(self.inertial.filter)
        mask = np.zeros(rows.size, np.int64)
        at_end = estimate.settling_s if self.causal else settling
        unsettled = (rows < settling) | (rows > self.time_s[-1] - at_end)
        mask[unsettled] |= Flag.FILTER_SETTLING
        mask[self._near_clipping(rows, estimate, settling)] |= Flag.CLIPPED_CHANNEL
        mask[~(angle_std <= UNCERTAIN_DEG)] |= Flag.UNCERTAIN_CORRECTION
        return mask

    def _near_clipping(
        self, rows: _Floats, estimate: BiasEstimate, settling: float
    ) -> NDArray[np.bool_]:
        """Rows whose low-pass still remembers a clipped sample."""
        count = np.concatenate([[0], np.cumsum(estimate.clipped)])
        first = np.searchsorted(self.time_s, rows - settling)
        ahead = 0.0 if self.causal else settling
        last = np.searchsorted(self.time_s, rows + ahead, side="right")
        return np.asarray(count[last] > count[first])
