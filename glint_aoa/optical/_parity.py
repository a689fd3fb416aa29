"""Even and odd fields in the wrong order, found in the motion of the line."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical._tones import fit_tones

__all__ = ["Parity", "find_parity"]

_Array = NDArray[np.float64]
_Mask = NDArray[np.bool_]

_WINDOW = 96  # fields looked at together
_LEAST = 12
_BATCH = 64  # stretches at once
_SIGMAS = 6.0  # by which an alternation must stand out
_SIZE_SIGMAS, _SIZE = 5.0, 0.02  # [std, lines]: how near its size must be to what parity makes
_UNCERTAIN = 0.06  # lines: an alternation known no better says nothing
_SLOPE = 0.04  # lines at the line's end: an alternation of the slope that parity cannot make
_EDGE = 3  # fields at the ends within which a slip cannot be seen
_APART = 2.0  # cycles in a stretch that tell a vibration from an alternation
_LEAST_SIGMAS = 3.0
_LEAST_HALF = 32
_LEAST_AMOUNT = 0.2  # lines
_HOPELESS = 0.5  # lines of motion that no tone explains hide a fault
_EXPLAINED = 1.3  # times the line's noise: motion explained that well has no slip in it
_BETTER = 12.0  # by which a slip must lower the Bayesian information criterion
_PLAIN, _ROUGHLY = 60.0, 0.2  # a slip that lowers it by so much may be off by more [lines]


@dataclass(frozen=True)
class Parity:
    """What the fields' parity turns out to be.

    Attributes
    ----------
    wrong : ndarray of bool, shape (field,)
        Whether the field's stated parity is wrong.
    slipped : ndarray of bool, shape (field,)
        Whether the order of parities slips before the field: an odd number is missing.
    offset : ndarray, shape (field,)
        What to add to rows of the window for the true parity [lines].
    """

    wrong: _Mask
    slipped: _Mask
    offset: _Array


def find_parity(
    row: _Array,
    reach: _Array,
    said: NDArray[np.int64],
    *,
    noise: float,
    gaps: _Mask,
    interlaced: bool,
) -> Parity:
    """Find the parity of each field from the row of the line.

    Parameters
    ----------
    row, reach : ndarray, shape (field,)
        Row of the line, and its climb to the last column [lines]; NaN where missing.
    said : ndarray, shape (field,)
        Parity that the recording states.
    noise : float
        Noise of `row`, 1 sigma [lines].
    gaps : ndarray of bool, shape (field,)
        Fields before which some are known to be missing.
    interlaced : bool
        Whether the recording calls its fields interlaced.
    """
    size = row.size
    wrong, slipped = np.zeros(size, np.bool_), np.zeros(size, np.bool_)
    offset = 0.5 * said.astype(np.float64)
    turn = 2.0 * np.asarray(said if interlaced else np.arange(size) % 2, np.float64) - 1.0
    stretches = _stretches(size, gaps)
    for start, stop in _doubtful(row + offset, turn, stretches, noise):
        part = slice(start, stop)
        z = row[part] + offset[part]
        amount, slip = _fault(z, reach[part], turn[part], noise=noise, interlaced=interlaced)
        offset[part] -= amount * turn[part]
        wrong[part] = np.abs(amount) > _LEAST_AMOUNT
        if slip is not None:
            slipped[start + slip] = True
    return Parity(wrong, slipped, offset)


def _stretches(size: int, gaps: _Mask) -> NDArray[np.int64]:
    """First field, and one past the last, of what is looked at together [stretch, 2]."""
    edges = [0, *np.flatnonzero(gaps).tolist(), size]
    stretches = []
    for start, stop in pairwise(edges):
        count = max(1, round((stop - start) / _WINDOW))
        cuts = np.linspace(start, stop, count + 1).astype(int).tolist()
        stretches += [pair for pair in pairwise(cuts) if pair[1] - pair[0] >= _LEAST]
    return np.array(stretches, np.int64).reshape(-1, 2)


def _doubtful(
    z: _Array, turn: _Array, stretches: NDArray[np.int64], noise: float
) -> NDArray[np.int64]:
    """Stretches in which the line alternates, or moves as noise and tones do not explain."""
    scatter, size = _steady(z, turn, stretches)
    doubtful = stretches[(scatter > _EXPLAINED * noise**2) | (size > _LEAST_SIGMAS)]
    # Where a field is missing, half of the stretch at least goes on undisturbed.
    middle = doubtful.mean(axis=1).astype(np.int64)
    first, _ = _steady(z, turn, np.stack([doubtful[:, 0], middle], axis=1))
    last, _ = _steady(z, turn, np.stack([middle, doubtful[:, 1]], axis=1))
    long = doubtful[:, 1] - doubtful[:, 0] >= 2 * _LEAST_HALF
    return doubtful[~(long & (np.fmin(first, last) > _HOPELESS**2))]


def _steady(z: _Array, turn: _Array, stretches: NDArray[np.int64]) -> tuple[_Array, _Array]:
    """Variance about a steady motion, and the alternation in standard deviations; 0 if unknown."""
    scatter, size = np.zeros(len(stretches)), np.zeros(len(stretches))
    lengths = stretches[:, 1] - stretches[:, 0]
    for length in np.unique(lengths):
        same = np.flatnonzero(lengths == length)
        for batch in np.array_split(same, -(-same.size // _BATCH)):
            number = stretches[batch, :1] + np.arange(length)
            here = z[number]
            time = np.tile(np.arange(length), (batch.size, 1))
            fit = fit_tones(here, turn[number][..., None], time, highest=_highest(int(length)))
            enough = np.isfinite(here).sum(axis=1) >= _LEAST
            scatter[batch] = np.where(enough, fit.squares / np.maximum(fit.freedom, 1), 0.0)
            size[batch] = np.where(enough, np.abs(fit.value) / fit.std, 0.0)
    return scatter, size


def _highest(size: int) -> float:
    """Frequency [cycles / field] above which a tone would look like an alternation that slips."""
    return 0.5 - _APART / size


def _fault(
    z: _Array, reach: _Array, turn: _Array, *, noise: float, interlaced: bool
) -> tuple[_Array, int | None]:
    """How much too far along `turn` each field is set down, and where the order slips."""
    sizes = (0.5, 0.25) if interlaced else (0.25, -0.25)
    slip = _slip(z, turn, noise) if interlaced else None
    slipped = np.zeros(z.size)
    if slip is not None:
        slipped[slip.at :] = 0.5 * slip.sign
    amount = _alternation_of(z - slipped * turn, reach, turn, sizes)
    return amount + slipped, None if slip is None else slip.at


def _alternation_of(z: _Array, reach: _Array, turn: _Array, sizes: tuple[float, ...]) -> float:
    """Return the one of `sizes` by which the line alternates beyond doubt, or 0."""
    size, std = _alternation(z, turn)
    if not (abs(size) > _SIGMAS * std and std < _UNCERTAIN):
        return 0.0
    tilt, tilt_std = _alternation(reach, turn)
    change, change_std = _change(z, turn)
    if (
        abs(tilt) > _SIZE_SIGMAS * tilt_std + _SLOPE
        or abs(change) > _SIZE_SIGMAS * change_std + _SIZE
    ):
        return 0.0
    near = [s for s in sizes if abs(size - s) <= _SIZE_SIGMAS * std + _SIZE]
    return near[0] if near else 0.0


@dataclass(frozen=True)
class _Slip:
    at: int
    sign: float


def _slip(z: _Array, turn: _Array, noise: float) -> _Slip | None:
    """Where, if anywhere, even and odd change places because a field is missing."""
    number = np.arange(z.size)[None]
    steady = fit_tones(z[None], turn[None, :, None], number, highest=_highest(z.size))
    if steady.squares[0] < _EXPLAINED * noise**2 * steady.freedom[0]:
        return None
    at = np.arange(_EDGE, z.size - _EDGE + 1)
    after = number >= at[:, None]
    wanted = np.stack([turn * after, np.broadcast_to(turn, after.shape)], axis=-1)
    # One field is missing in time.
    fits = fit_tones(z[None], wanted, number + after, highest=_highest(z.size))
    best = int(np.argmin(fits.criterion))
    value, std = fits.value[best], fits.std[best]
    free = fit_tones(z[None], turn[None, :, None], number)
    without = min(steady.criterion[0], free.criterion[0])
    gain = without - fits.criterion[best]
    sure = gain > _BETTER and abs(value) > _SIGMAS * std and std < _UNCERTAIN
    off = abs(abs(value) - 0.5)
    near = off <= _SIZE_SIGMAS * std + _SIZE or (gain > _PLAIN and off <= _ROUGHLY)
    return _Slip(int(at[best]), float(np.sign(value))) if sure and near else None


def _alternation(z: _Array, turn: _Array) -> tuple[float, float]:
    """By how much a series alternates, and the standard deviation of that."""
    fit = fit_tones(z[None], turn[None, :, None], np.arange(z.size)[None])
    return float(fit.value[0]), float(fit.std[0])


def _change(z: _Array, turn: _Array) -> tuple[float, float]:
    """By how much an alternation grows or fades, which that of parity does not."""
    t = np.linspace(-1, 1, z.size)
    wanted = np.stack([np.stack([t**power * turn, turn], axis=-1) for power in (1, 2)])
    fit = fit_tones(z[None], wanted, np.tile(np.arange(z.size), (2, 1)))
    worst = int(np.argmax(np.abs(fit.value) / fit.std))
    return float(fit.value[worst]), float(fit.std[worst])
