"""When frames were taken, from the ticks that a video file stores of each."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

__all__ = ["FrameTimes", "frame_times"]

_COARSE = 1.01  # ticks of more than a period cannot tell frames apart
_ROUNDING = 1.001  # ticks: two times that were both rounded to the nearest


@dataclass(frozen=True)
class FrameTimes:
    """When the frames of a file were taken.

    Attributes
    ----------
    rate_hz : float or None
        Frames a second where none is missing [Hz].
    times_s : ndarray [frame] or None
        Times after the first frame [s]; None where every frame follows the last after one period.
    notes : tuple of str
        What is not as it should be.
    """

    rate_hz: float | None
    times_s: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()


def frame_times(
    ticks: NDArray[np.int64], tick_s: Fraction, nominal_hz: Fraction | None
) -> FrameTimes:
    """Find rate, times and missing frames from rounded times of presentation.

    Times that lie on a grid of equal periods, to the rounding of a tick, are put back on it: a
    file that counts in milliseconds says 33, 67, 100 of a camera that never wavered.

    Parameters
    ----------
    ticks : ndarray of int64 [frame]
        Times of presentation in order [ticks].
    tick_s : Fraction
        Length of a tick [s].
    nominal_hz : Fraction or None
        What the file says of its frame rate [Hz].

    Returns
    -------
    FrameTimes
        Times are None where all frames are there; counted periods where some are missing or given
        twice; as recorded where they are on no grid.

    Notes
    -----
    A file whose ticks are longer than a period says nothing but its rate. Frames that were lost
    before the file was written, and not counted, do not show.
    """
    period = _period(ticks, tick_s, nominal_hz)
    if period is None:
        return FrameTimes(None if nominal_hz is None else float(nominal_hz))
    if tick_s > _COARSE * period:
        note = "the file's clock is too coarse for its frame rate: times are counted, not recorded"
        return FrameTimes(float(1 / period), notes=(note,))
    steps = np.rint(np.diff(ticks) * float(tick_s / period)).astype(np.int64)
    number = np.concatenate([[0], np.cumsum(steps)])
    since: NDArray[np.float64] = np.asarray((ticks - ticks[0]) * float(tick_s), np.float64)
    for rate_hz in (float(1 / period), int(number[-1]) / since[-1] if since[-1] else 0.0):
        if rate_hz and np.ptp(since - number / rate_hz) <= 2 * _ROUNDING * float(tick_s):
            return _on_grid(number, rate_hz)
    return FrameTimes(1 / float(np.median(np.diff(since))), since, (_uneven(since),))


def _period(
    ticks: NDArray[np.int64], tick_s: Fraction, nominal_hz: Fraction | None
) -> Fraction | None:
    """Return the file's own period unless the frames' times speak against it [s]."""
    if ticks.size < 2:
        return None
    usual = Fraction(int(np.median(np.diff(ticks)))) * tick_s
    if nominal_hz is None or nominal_hz <= 0:
        return usual or None
    period = 1 / nominal_hz
    near = abs(usual - period) <= max(tick_s, period / 100)
    return period if near or usual == 0 else usual


def _on_grid(number: NDArray[np.int64], rate_hz: float) -> FrameTimes:
    steps = np.diff(number)
    if (steps == 1).all():
        return FrameTimes(rate_hz)
    notes = []
    if (steps > 1).any():
        missing, before = int((steps[steps > 1] - 1).sum()), int(np.argmax(steps > 1)) + 1
        notes.append(f"{missing} frames are missing by their times, the first before {before}")
    if (steps == 0).any():
        twice = int((steps == 0).sum())
        notes.append(
            f"{twice} frames have the time of the one before, the first {int(np.argmin(steps)) + 1}"
        )
    return FrameTimes(rate_hz, np.asarray(number / rate_hz), tuple(notes))


def _uneven(since: NDArray[np.float64]) -> str:
    steps = 1e3 * np.diff(since)
    return f"frames follow each other at uneven times, {steps.min():.4g} to {steps.max():.4g} ms"
