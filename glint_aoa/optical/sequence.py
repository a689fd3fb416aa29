"""Checks over the fields of a stack in time: copies, gaps, parity, fading and jumps."""

import numpy as np
from numpy.typing import NDArray

from glint_aoa.flags import Flag
from glint_aoa.optical._parity import Parity, find_parity
from glint_aoa.optical._prediction import outlying
from glint_aoa.optical.summary import FieldSummary
from glint_aoa.records.recording import Recording

__all__ = ["check_sequence"]

_Array = NDArray[np.float64]

_LEAST_DISTINCT = 3  # fields that differ, and
_SHARE_DISTINCT = 1 / 8  # of all: below, a stack has no noise and copies mean nothing
_FADED = 0.5  # of the brightest
_GAP = 1.5  # field periods between two fields, from which one is missing
_LEAST_FIELDS = 8  # below, nothing is said of motion


def check_sequence(
    lines: FieldSummary,
    recording: Recording,
    *,
    times_s: _Array | None = None,
    displaced: NDArray[np.bool_] | None = None,
) -> NDArray[np.int64]:
    """Check what fields of one stack must have in common with their neighbours.

    Parameters
    ----------
    lines : FieldSummary
        What each field comes to, in order.
    recording : Recording
        Rate, and the parity that the fields are said to have.
    times_s : ndarray, shape (field,), optional
        Timestamps [s]. Where they show a gap, flagged `Flag.TIMING` elsewhere, motion is not
        followed across it.
    displaced : ndarray of bool, shape (field,), optional
        Fields that a moved camera shows at another place; they say nothing of the line's motion.

    Returns
    -------
    ndarray of int64, shape (field,)
        Mask of `Flag.REPEATED`, `DROPPED`, `PARITY_ORDER`, `FADING` and `MOVED`.

    Notes
    -----
    Motion is judged by linear prediction from the fields on both sides, which follows steady
    vibration at any frequency; where the motion is random its own unpredictable part sets the
    scale. A field has moved if it lies 8 robust standard deviations of the prediction error and
    1.5 lines off: for Gaussian motion less than one field in 10^12.

    Parity in the wrong order shows as an alternation of one line, or of half a line where fields
    are said to be interlaced and are not, or the other way round. It is told from vibration by
    its size, its phase and its steadiness, and by leaving the slope alone, and must stand out of
    the motion by six standard deviations. A dropped field shows where the order slips. Simulated
    with 24 to 60 fields, vibration of any amplitude up to 3.5 lines at 3 to 29 Hz and noise of
    0.01 to 0.05 line, none of 800 stacks in order was flagged, 97 % of those in the wrong order
    were, and 93 % of the dropped fields were put at the right place. What cannot be told apart is
    a vibration without pitch, within about half a cycle in the record of half the field rate,
    whose amplitude happens to be that of the fault: half a line, or a quarter. Random motion of
    more than some tenths of a line hides the fault.

    Not seen without timestamps: an even number of interlaced fields missing, and any number of
    progressive ones.
    """
    number = np.arange(lines.row.size, dtype=np.int64)
    said = recording.parity_of(number)
    gaps = _gaps(times_s, 1 / recording.rate_hz, number.size)
    copies = _copies(lines)
    flags = np.where(copies, int(Flag.REPEATED), 0)
    flags |= np.where(_faded(lines.mean_height), int(Flag.FADING), 0)
    if np.isfinite(lines.row).sum() < _LEAST_FIELDS:
        return flags
    shown = np.where(copies, np.nan, lines.row)  # a copy shows where the line was before
    noise = float(np.nanmedian(lines.row_std))
    parity = find_parity(
        shown, lines.reach, said, noise=noise, gaps=gaps, interlaced=recording.interlaced
    )
    flags |= np.where(parity.slipped, int(Flag.DROPPED), 0)
    flags |= np.where(parity.wrong, int(Flag.PARITY_ORDER), 0)
    if displaced is not None:
        shown = np.where(displaced, np.nan, shown)
    flags |= np.where(_moved(shown, lines, parity, gaps), int(Flag.MOVED), 0)
    return flags


def _moved(
    row: _Array, lines: FieldSummary, parity: Parity, gaps: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    breaks = gaps | parity.slipped
    moved = outlying(row + parity.offset, lines.row_std, breaks)
    moved |= outlying(np.where(np.isfinite(row), lines.reach, np.nan), lines.row_std, breaks)
    return moved


def _copies(lines: FieldSummary) -> NDArray[np.bool_]:
    """Whether a field is the one before it, or two before it, over again."""
    copies = np.zeros(lines.row.size, np.bool_)
    there = np.isfinite(lines.row)
    distinct = np.unique(lines.fingerprint[there]).size
    if distinct <= max(_LEAST_DISTINCT, _SHARE_DISTINCT * there.sum()):
        return copies
    for back in (1, 2):
        copies[back:] |= lines.fingerprint[back:] == lines.fingerprint[:-back]
    return copies & there


def _gaps(times_s: _Array | None, period: float, size: int) -> NDArray[np.bool_]:
    """Whether timestamps say that fields are missing before this one."""
    gaps = np.zeros(size, np.bool_)
    if times_s is not None:
        gaps[1:] = np.diff(times_s) > _GAP * period
    return gaps


def _faded(height: _Array) -> NDArray[np.bool_]:
    """Whether the glint is less than half as bright as the brightest that lasted."""
    known = np.flatnonzero(np.isfinite(height))
    faded = np.zeros(height.size, np.bool_)
    if known.size < 3:
        return faded
    triples = np.stack([height[known[:-2]], height[known[1:-1]], height[known[2:]]])
    brightest = np.median(triples, axis=0).max()
    faded[known] = height[known] < _FADED * brightest
    return faded
