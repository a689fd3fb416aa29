"""Pixel locking: column centres that are drawn to whole field lines."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["PixelLocking", "pixel_locking"]

_Array = NDArray[np.float64]

_STRETCHES = 48  # of columns, at most, whose lasting departures count as independent
_LEAST_STRETCHES = 12
_ROUNDS = 3
_OUTLYING = 4.5  # standard deviations at which a centre does not count
_SURE = 5.0  # standard deviations from which locking is believed
_LINES, _ANGLE = 0.01, np.radians(0.0003)  # of it that matter: centres off, a field's slope off
_WIDEST_GAP = 0.3  # lines
_PHASES = np.arange(64) / 64


@dataclass(frozen=True)
class PixelLocking:
    """How much centres are drawn to whole or half lines.

    Attributes
    ----------
    amplitude, amplitude_std : float
        Greatest departure over the phases of a line and its standard deviation [field lines]; NaN
        and infinite where the sample's phases do not tell.
    slope : float
        What it adds to a field's slope, rms over the fields [field lines / column].
    """

    amplitude: float
    amplitude_std: float
    slope: float

    def matters(self, line_per_column: float) -> bool:
        """Say whether locking is both beyond doubt and large enough to matter.

        Parameters
        ----------
        line_per_column : float
            Slope on the plane of a line that falls by one field line a column [1].

        Returns
        -------
        bool
            Whether it is at least 5 standard deviations, and 0.01 line or 0.0003 deg of slope.
        """
        if not self.amplitude > _SURE * self.amplitude_std:
            return False
        return self.amplitude > _LINES or self.slope * line_per_column > _ANGLE


_UNKNOWN = PixelLocking(np.nan, np.inf, np.nan)


def pixel_locking(
    row: _Array, expected: _Array, columns: NDArray[np.int64], weight: _Array
) -> PixelLocking:
    r"""Look for a departure of the centres that goes with the phase of the line.

    Parameters
    ----------
    row : ndarray, shape (field, column)
        Measured centres [rows]; NaN where there is none.
    expected : ndarray, shape (field, column)
        Where the line is, whose fraction is the phase: fitted lines with the columns' usual
        departures [rows].
    columns : ndarray, shape (column,)
        The columns [pixels].
    weight : ndarray, shape (column,)
        Inverse variance of the centres in each column; 0 leaves it out.

    Returns
    -------
    PixelLocking
        Amplitude and its effect.

    Notes
    -----
    The departure :math:`\sum_k a_k \sin 2 \pi k p + b_k \cos 2 \pi k p`, k = 1, 2, of phase p is
    fitted by weighted least squares, every field's own parabola taken from both sides first, since
    a bend is no locking. The covariance is that of departures which last over the fields and are
    shared within stretches of columns (White, Econometrica 48, 1980, 817; clustered), so texture
    does not pass for locking. Where the centres do not cover the phases of a line nothing is told.
    A line that stands still and sweeps less than two lines or so tells little, and texture that
    repeats with the line's phase cannot be told from locking there.
    """
    there = np.isfinite(row) & np.isfinite(expected) & (weight > 0)
    if not _all_phases(expected[there]):
        return _UNKNOWN
    share = np.where(there, weight, 0.0)
    for _ in range(_ROUNDS):
        fit = _fitted(row, expected, columns, share)
        if fit is None:
            return _UNKNOWN
        figures, covariance, left = fit
        inside = _within(left, share)
        if (inside | (share == 0)).all():
            break
        share = np.where(inside, share, 0.0)
    curve = _harmonics(_PHASES) @ figures
    worst = int(np.argmax(np.abs(curve)))
    pull = _harmonics(_PHASES)[worst]
    return PixelLocking(
        amplitude=float(abs(curve[worst])),
        amplitude_std=float(np.sqrt(pull @ covariance @ pull)),
        slope=_slope_of(_harmonics(expected) @ figures, columns, share),
    )


def _all_phases(row: _Array) -> bool:
    """Whether no gap between the phases of the centres is wider than the harmonics bridge."""
    phase = np.sort(np.mod(row, 1.0))
    return bool(phase.size and np.diff(phase, append=phase[0] + 1.0).max() <= _WIDEST_GAP)


def _harmonics(phase: _Array) -> _Array:
    angle = 2 * np.pi * phase
    return np.stack([np.sin(angle), np.cos(angle), np.sin(2 * angle), np.cos(2 * angle)], axis=-1)


def _fitted(
    row: _Array, expected: _Array, columns: NDArray[np.int64], share: _Array
) -> tuple[_Array, _Array, _Array] | None:
    """Figures of the harmonics, their covariance, and what they leave of the departures."""
    used = share > 0
    fields = used.sum(axis=1) > 3
    share, used = share[fields], used[fields]
    stretches = np.array_split(np.arange(columns.size), min(_STRETCHES, columns.size))
    if not fields.any() or len(stretches) < _LEAST_STRETCHES:
        return None
    design = np.where(used[..., None], _harmonics(expected[fields]), 0.0)
    both = np.concatenate([np.where(used, row[fields], 0.0)[..., None], design], axis=2)
    both = _without_parabola(both, columns, share)
    departure, design = both[..., 0], both[..., 1:]
    weighted = share[..., None] * design
    normal = np.einsum("fci,fcj->ij", weighted, design)
    scale = np.einsum("fc->", share)
    if not np.linalg.eigvalsh(normal)[0] > 1e-6 * scale:
        return None
    inverse = np.linalg.inv(normal)
    figures = inverse @ np.einsum("fci,fc->i", weighted, departure)
    left = departure - design @ figures
    score = np.einsum("fci,fc->ci", weighted, left)
    sums = np.stack([score[part].sum(axis=0) for part in stretches])
    covariance = inverse @ (sums.T @ sums) @ inverse * len(sums) / (len(sums) - 1)
    whole = np.full(row.shape, np.nan)
    whole[fields] = np.where(used, left, np.nan)
    return figures, covariance, whole


def _without_parabola(values: _Array, columns: NDArray[np.int64], share: _Array) -> _Array:
    """Take each field's weighted parabola from values [field, column, kind]."""
    u = columns - columns.mean()
    x = u / max(float(np.abs(u).max()), 1.0)
    powers = np.stack([np.ones_like(x), x, x**2], axis=1)
    normal = np.einsum("fc,ci,cj->fij", share, powers, powers)
    right = np.einsum("fc,ci,fck->fik", share, powers, values)
    left: _Array = values - powers @ (np.linalg.pinv(normal) @ right)
    return left


def _within(left: _Array, share: _Array) -> NDArray[np.bool_]:
    """Which centres lie within reach of what is expected, in units of their own noise."""
    distance = np.abs(left) * np.sqrt(share)
    known = distance[share > 0]
    return distance <= _OUTLYING * 1.4826 * float(np.median(known))


def _slope_of(departure: _Array, columns: NDArray[np.int64], share: _Array) -> float:
    """Slope that departures add to each field's line, rms over the fields."""
    used = share > 0
    total = share.sum(axis=1)
    fields = (used.sum(axis=1) > 1) & (total > 0)
    share, departure = share[fields], np.where(used, departure, 0.0)[fields]
    u = columns - (share @ columns / total[fields])[:, None]
    slope = (share * u * departure).sum(axis=1) / (share * u**2).sum(axis=1)
    return float(np.sqrt(np.mean(slope**2)))
