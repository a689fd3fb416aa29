"""Sampling rate, start and missing samples from recorded times."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError

__all__ = ["TimeAxis", "is_time_name", "on_grid", "time_unit_s"]

MOST_JITTER = 0.1
"""How far a sample may lie from its regular place [sample]; at 35 Hz and 800/s, 0.03 rad."""

_TIME_NAMES = {"time", "t", "times", "timestamp", "time_s", "t_s", "seconds", "x_value", "zeit"}
_SCALED_NAMES = {"time_ms": "ms", "t_ms": "ms", "time_us": "us", "time_ns": "ns"}
_SECONDS = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_FINEST_DIGIT = 9
_SHORT = 1000  # samples; of a record this short, more may be missing than there are
_ROUNDED = 1.05  # the straight line through rounded times is itself a little off
_MOST_GAPS = 0.05  # of the times that a gap may follow; with more, the rate is misjudged


def is_time_name(name: str) -> bool:
    """Whether a channel of that name holds times, such as ``time_s``."""
    return name.strip().casefold() in _TIME_NAMES | set(_SCALED_NAMES)


def time_unit_s(where: str, name: str, unit: str | None) -> float:
    """Return the unit of a time channel in seconds; RecordingError where it is no time."""
    text = (unit or _SCALED_NAMES.get(name.strip().casefold(), "s")).strip()
    seconds = _SECONDS.get(text.casefold())
    if seconds is None:
        raise RecordingError(
            f"{where}: times in {name} are in {text}, expected one of {', '.join(_SECONDS)}; "
            "correct the unit in the record"
        )
    return seconds


@dataclass(eq=False)
class TimeAxis:
    """Regular grid that recorded times lie on, found block by block.

    Times that were rounded when they were written lie within half of their last digit of the
    grid; others may jitter by 0.1 sample. Whole samples that are missing are found and counted.

    Attributes
    ----------
    where : str
        File, and channel if there are several axes, for messages.
    """

    where: str
    _period: float = 0.0
    _quantum: float = 0.0
    _sums: NDArray[np.float64] = field(default_factory=lambda: np.zeros(5))
    _origin: float = 0.0
    _last: tuple[int, float] = (-1, 0.0)
    _checks: list[tuple[int, float]] = field(default_factory=list)

    def add(self, times_s: NDArray[np.float64]) -> NDArray[np.int64]:
        """Take the next block of times [sample, s]; return their places on the grid [sample].

        Raises
        ------
        RecordingError
            If times are missing, repeat, run backwards or are irregular; the message says where.
        """
        self._check_forward(times_s)
        if self._last[0] < 0:
            self._origin = float(times_s[0])
            self._quantum = _quantum(times_s)
            self._period, start = self._first_line(times_s - self._origin)
        else:
            self._period, start = self._line()
        away = (times_s - self._origin - start) / self._period
        places: NDArray[np.int64] = np.rint(away).astype(np.int64)
        steps = np.diff(places, prepend=self._last[0])
        if steps.min() < 1:
            self._refuse(times_s, int(np.argmin(steps)))
        gaps = int(np.count_nonzero(steps > 1))
        if gaps > max(3, _MOST_GAPS * times_s.size):
            self._refuse(times_s, int(np.argmax(steps > 1)))
        if places[-1] + 1 > 2 * (self._sums[0] + times_s.size) + _SHORT:
            self._refuse_pause(times_s, int(np.argmax(steps)))
        self._check_regular(places, times_s)
        self._take(places, times_s)
        return places

    def finish(self) -> tuple[float, float, int]:
        """Return rate [Hz], start [s] and number of places of the grid.

        Raises
        ------
        RecordingError
            If the blocks lie on grids of different rate, or there are fewer than two times.
        """
        size = self._last[0] + 1
        if size < 2:
            raise RecordingError(f"{self.where}: fewer than two times; check that it was recorded")
        slope, start = self._line()
        resolution = max(self._quantum / 2, 1e-9)
        # A line through n rounded times is known to about quantum / n^1.5 a sample.
        known = self._quantum * min(8 / size**1.5, 0.5 / size)
        rate = _roundest(slope, max(known, 1e-9 * slope))
        slope = 1 / rate
        for number, first in self._checks:
            if abs(self._origin + start + slope * number - first) > self._tolerance(slope):
                raise RecordingError(
                    f"{self.where}: the sampling rate drifts: the sample at {first:.6g} s lies "
                    f"{abs(self._origin + start + slope * number - first):.2g} s from its place "
                    f"at {rate:.6g} Hz; record with a steady clock or export at one rate"
                )
        begin = self._origin + start
        digits = max(0, round(-math.log10(resolution)) + 1)
        return rate, round(begin, digits), size

    def _check_forward(self, times_s: NDArray[np.float64]) -> None:
        bad = np.flatnonzero(~np.isfinite(times_s))
        if bad.size:
            before = float(times_s[bad[0] - 1]) if bad[0] else self._last[1]
            raise RecordingError(
                f"{self.where}: a time is missing after {before:.6g} s; "
                "delete its row or give every sample its time"
            )
        ahead = np.diff(times_s, prepend=self._last[1] if self._last[0] >= 0 else -np.inf)
        if times_s.size and not (ahead >= 0).all():
            place = int(np.argmin(ahead >= 0))
            raise RecordingError(
                f"{self.where}: time runs backwards to {times_s[place]:.6g} s; "
                "sort the record or cut it where a new one begins"
            )

    def _first_line(self, times_s: NDArray[np.float64]) -> tuple[float, float]:
        """Find period and start [s] of the first block: of evenly spread times, else of most."""
        if times_s.size < 2:
            raise RecordingError(f"{self.where}: fewer than two times; check that it was recorded")
        numbers = np.arange(times_s.size, dtype=np.float64)
        even, start = _straight(numbers, times_s)
        if even > 0 and np.ptp(times_s - even * numbers) <= 2 * self._tolerance(even):
            return even, start
        usual = float(np.median(np.diff(times_s)))
        if usual <= 0:
            raise RecordingError(
                f"{self.where}: most times repeat, the first {self._origin:.6g} s; write them with "
                "more digits, or leave them out and give rate under [inertial] in the setup"
            )
        steps = np.rint(np.diff(times_s, prepend=times_s[0]) / usual)
        return _straight(np.cumsum(steps), times_s)

    def _tolerance(self, period: float) -> float:
        rounded = 0.5 * self._quantum * _ROUNDED
        jitter = MOST_JITTER * period
        return max(rounded, jitter) if rounded < 0.5 * period else jitter

    def _check_regular(self, places: NDArray[np.int64], times_s: NDArray[np.float64]) -> None:
        """Hold one block against its own straight line."""
        numbers = (places - places[0]).astype(np.float64)
        slope = _straight(numbers, times_s)[0] if times_s.size > 1 else self._period
        off = times_s - times_s.mean() - slope * (numbers - numbers.mean())
        if np.ptp(off) > 2 * self._tolerance(self._period):
            self._refuse(times_s, int(np.argmax(np.abs(off))), float(np.abs(off).max()))

    def _refuse(self, times_s: NDArray[np.float64], place: int, off_s: float | None = None) -> None:
        how = "is too near or far from the one before"
        if off_s is not None:
            how = f"is off by {off_s:.2g} s"
        raise RecordingError(
            f"{self.where}: times are irregular: the sample at {times_s[place]:.6g} s {how} where "
            f"most follow at {1 / self._period:.6g} Hz; export the record at regular times"
        )

    def _refuse_pause(self, times_s: NDArray[np.float64], place: int) -> None:
        raise RecordingError(
            f"{self.where}: most samples are missing, the most before {times_s[place]:.6g} s; "
            "cut the record there"
        )

    def _take(self, places: NDArray[np.int64], times_s: NDArray[np.float64]) -> None:
        number, time = places.astype(np.float64), times_s - self._origin
        products = number, time, number**2, number * time
        self._sums += [number.size, *(float(each.sum()) for each in products)]
        self._checks.append((int(places[0]), float(times_s[0])))
        self._checks.append((int(places[-1]), float(times_s[-1])))
        self._last = int(places[-1]), float(times_s[-1])

    def _line(self) -> tuple[float, float]:
        """Slope [s] and intercept [s] of time over place, by least squares."""
        count, number, time, squares, product = self._sums
        slope = (count * product - number * time) / (count * squares - number**2)
        return float(slope), float((time - slope * number) / count)


def on_grid(
    places: NDArray[np.int64], size: int, samples: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Put samples [sample] or [sample, channel] in their places; NaN where none was recorded."""
    if places.size == size:
        return samples
    full = np.full((size, *samples.shape[1:]), np.nan)
    full[places] = samples
    return full


def _roundest(period: float, tolerance: float) -> float:
    """Return the rate of the fewest digits whose period is within `tolerance` of `period`."""
    candidates = (float(f"{1 / period:.{digits}g}") for digits in range(1, 8))
    return next((rate for rate in candidates if abs(1 / rate - period) <= tolerance), 1 / period)


def _straight(numbers: NDArray[np.float64], times_s: NDArray[np.float64]) -> tuple[float, float]:
    """Slope and intercept of times over numbers by least squares."""
    away = numbers - numbers.mean()
    slope = float((away * (times_s - times_s.mean())).sum() / (away**2).sum())
    return slope, float(times_s.mean() - slope * numbers.mean())


def _quantum(times_s: NDArray[np.float64]) -> float:
    """Coarsest power of ten that all times are multiples of [s]; 0 where there is none."""
    for digits in range(_FINEST_DIGIT + 1):
        scaled = times_s * 10.0**digits
        if np.abs(scaled - np.rint(scaled)).max() <= 1e-6 * max(1.0, np.abs(scaled).max() * 1e-9):
            return 10.0**-digits
    return 0.0
