"""Readings: what is told of each field, and how fields become readings."""

import json
import math
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.sweep.fit import PitchSweep
from glint_aoa.coverage import coverage_factor, effective_freedom
from glint_aoa.flags import REJECTING, Flag
from glint_aoa.live.learning import Learnt
from glint_aoa.optical.measure import FieldAngles, Measurement, angles_of, summed_fields
from glint_aoa.optical.summary import FieldSummary
from glint_aoa.sweep_use import apply_sweep

__all__ = ["Measurer", "Reading"]

_Array = NDArray[np.float64]
_MM = 1e3
_RECENT = 64  # fields before it that one is held against
_LEAST_DISTINCT = 3  # fields that differ, and
_SHARE_DISTINCT = 1 / 8  # of the recent: below, the fields have no noise and copies mean nothing
_FADED = 0.5  # of the brightest that lasted
_TIMING_TOLERANCE = 0.2  # of a field period
_FOLLOWING = 1e-3  # share of a lateness by which the clock follows with each field


@dataclass(frozen=True, slots=True)
class Reading:
    """What is told of one field; NaN where nothing was measured.

    Attributes
    ----------
    index : int
        Number of the field in its source.
    time_s, unix_time_s : float
        Middle of the exposure after the start of field 0's, and as Unix time [s].
    angle_deg, u95_deg : float
        Angle after calibration, and half its 95 % interval: the field's own noise, and all that
        it shares with others as far as the setup states it [deg].
    intercept_mm, slope : float
        The line on the known plane: its Z at X = 0, and dZ/dX.
    slope_px, intercept_px : float
        The line in the recorded window, row = intercept_px + slope_px * column.
    n_columns : int
        Columns used.
    flags : int
        Mask of `glint_aoa.flags.Flag`.
    point : str or None
        Point that is being recorded.
    latency_ms : float
        From the field's arrival to its angle [ms]; NaN for fields from before the glint was learnt.
    """

    index: int
    time_s: float
    unix_time_s: float
    angle_deg: float
    u95_deg: float
    intercept_mm: float
    slope: float
    slope_px: float
    intercept_px: float
    n_columns: int
    flags: int
    point: str | None
    latency_ms: float

    @property
    def is_good(self) -> bool:
        """Whether the field counts in a mean, as it does in ``process``."""
        return math.isfinite(self.angle_deg) and not self.flags & int(REJECTING)

    @property
    def flag_names(self) -> list[str]:
        """Names of its flags, lowest bit first."""
        return [str(flag.name) for flag in Flag if self.flags & flag]

    def plain(self) -> dict[str, Any]:
        """Return it as JSON has it: flags by name, null for what was not measured."""
        values = {name: _plain(getattr(self, name)) for name in self.__slots__}
        return {**values, "flags": self.flag_names}

    def line(self) -> bytes:
        """Return it as one line of JSON."""
        return json.dumps(self.plain(), separators=(",", ":"), allow_nan=False).encode() + b"\n"


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 9) if math.isfinite(value) else None
    return value


class Measurer:
    """Turns fields into readings, in the order in which they come.

    Parameters
    ----------
    learnt : Learnt
        What to measure with; may be replaced at any time.
    sweep : PitchSweep or None
        Calibration to apply.
    temperature_k : float or None
        Tunnel temperature [K].
    """

    def __init__(
        self,
        learnt: Learnt,
        *,
        sweep: PitchSweep | None = None,
        temperature_k: float | None = None,
    ) -> None:
        self.learnt = learnt
        self._sweep, self._temperature_k = sweep, temperature_k
        self._past, self._clock = _Past(), _Clock()

    def measure(
        self,
        block: NDArray[np.integer],
        number: NDArray[np.int64],
        start_s: _Array,
        arrived: _Array,
        *,
        points: Sequence[str | None] = (),
    ) -> list[Reading]:
        """Measure fields that follow each other.

        Parameters
        ----------
        block : ndarray, shape (field, line, column)
            Grey levels.
        number : ndarray, shape (field,)
            Their numbers in the source.
        start_s, arrived : ndarray, shape (field,)
            As for `glint_aoa.live.sources.Arrival`.
        points : sequence of str or None [field], optional
            Names of the points that they belong to.

        Returns
        -------
        list of Reading
            One a field.
        """
        learnt = self.learnt
        measurement = learnt.measurement
        lines = summed_fields(block, number, measurement)
        angles = angles_of(lines, number, measurement)
        angle_deg, u95_deg, flags = self._calibrated(angles, learnt)
        flags = flags | self._past.flags(lines, number, start_s, measurement) | learnt.flags
        slope_px, intercept_px = _pixel_lines(lines, measurement)
        mm = _MM if measurement.setup.camera.pixel_pitch is not None else math.nan
        middle_s = start_s + measurement.recording.exposure_s / 2
        latency_ms = 1e3 * (time.perf_counter() - arrived)
        columns = (
            number,
            middle_s,
            self._clock.unix_start_s(start_s, arrived) + middle_s,
            angle_deg,
            u95_deg,
            angles.intercept * mm,
            lines.slope,
            slope_px,
            intercept_px,
            lines.used,
            flags,
            list(points) or [None] * number.size,
            latency_ms,
        )
        plain = [each.tolist() if isinstance(each, np.ndarray) else each for each in columns]
        return [Reading(*row) for row in zip(*plain, strict=True)]

    def _calibrated(
        self, angles: FieldAngles, learnt: Learnt
    ) -> tuple[_Array, _Array, NDArray[np.int64]]:
        """Angle after the sweep, half its 95 % interval [deg], and flags."""
        angle, noise = np.degrees(angles.angle), np.degrees(angles.angle_std)
        flags = angles.flags
        shared = np.full(angle.size, np.degrees(learnt.measurement.slope_doubt))
        freedom = np.full(angle.size, np.inf)
        if self._sweep is not None:
            swept = apply_sweep(
                angles, learnt.measurement, self._sweep, temperature_k=self._temperature_k
            )
            angle, noise, flags = swept.angle_deg, swept.noise_deg, flags | swept.flags
            shared, freedom = swept.systematic_deg, swept.systematic_freedom
        carried = learnt.carried_to(angles.angle)
        return angle, _expanded(noise, (shared, freedom), carried), flags


def _expanded(noise: _Array, *shared: Any) -> _Array:
    """Half the 95 % interval of noise and what comes with it, (std, degrees of freedom) each."""
    parts = [(noise, np.inf), *(each for each in shared if each is not None)]
    if all(np.all(np.isinf(freedom)) for _, freedom in parts):
        total: _Array = np.sqrt(np.sum([np.square(std) + 0 * noise for std, _ in parts], axis=0))
        return _NORMAL * total
    variances = [np.square(std) + 0 * noise for std, _ in parts]
    freedom = effective_freedom(variances, [each for _, each in parts])
    factor = [coverage_factor(float(each)) for each in np.nan_to_num(freedom, nan=np.inf)]
    return np.asarray(factor * np.sqrt(np.sum(variances, axis=0)))


_NORMAL = coverage_factor()


def _pixel_lines(lines: FieldSummary, measurement: Measurement) -> tuple[_Array, _Array]:
    """Slope and intercept of the lines in the window: rows against columns."""
    first, last = float(measurement.columns[0]), float(measurement.columns[-1])
    slope = lines.reach / max((last - first) / 2, 0.5)
    return slope, lines.row - slope * (first + last) / 2


class _Clock:
    """Unix time of the start of the source, as the fields' arrivals tell it.

    The earliest arrivals count, since a field can come late but not early; a clock that drifts
    against ours is followed slowly.
    """

    def __init__(self) -> None:
        self._late_s = math.inf

    def unix_start_s(self, start_s: _Array, arrived: _Array) -> float:
        """Unix time at which field 0's exposure began [s]."""
        late = float((arrived - start_s).min())
        if late < self._late_s:
            self._late_s = late
        else:
            self._late_s += _FOLLOWING * start_s.size * (late - self._late_s)
        return self._late_s + time.time() - time.perf_counter()


class _Past:
    """The fields before, as far as one shows by them whether it is a copy, late or faded."""

    def __init__(self) -> None:
        self._fingerprint: deque[int] = deque(maxlen=_RECENT)
        self._height: deque[float] = deque(maxlen=3)
        self._lasting: deque[float] = deque(maxlen=_RECENT)  # medians of three heights
        self._number, self._start_s = -1, math.nan

    def flags(
        self,
        lines: FieldSummary,
        number: NDArray[np.int64],
        start_s: _Array,
        measurement: Measurement,
    ) -> NDArray[np.int64]:
        """Return the flags of fields in order, shape (field,)."""
        period = 1 / measurement.recording.rate_hz
        heights, there = lines.mean_height.tolist(), np.isfinite(lines.row).tolist()
        prints, numbers = lines.fingerprint.tolist(), number.tolist()
        flags = np.zeros(number.size, np.int64)
        for k, start in enumerate(start_s.tolist()):
            flags[k] = self._late(numbers[k], start, period)
            if there[k]:
                flags[k] |= self._copied(prints[k]) | self._faded(heights[k])
        return flags

    def _late(self, number: int, start_s: float, period: float) -> int:
        before, step = self._number, start_s - self._start_s
        self._number, self._start_s = number, start_s
        if before < 0:
            return 0
        dropped = int(Flag.DROPPED) if number > before + 1 else 0
        irregular = abs(step - period) > _TIMING_TOLERANCE * period
        return dropped | (int(Flag.TIMING) if irregular else 0)

    def _copied(self, fingerprint: int) -> int:
        past = self._fingerprint
        past.append(fingerprint)
        if fingerprint not in list(past)[-3:-1]:
            return 0
        alive = len(set(past)) > max(_LEAST_DISTINCT, _SHARE_DISTINCT * len(past))
        return int(Flag.REPEATED) if alive else 0

    def _faded(self, height: float) -> int:
        self._height.append(height)
        if len(self._height) == 3:
            self._lasting.append(sorted(self._height)[1])
        brightest = max(self._lasting, default=0.0)
        return int(Flag.FADING) if height < _FADED * brightest else 0
