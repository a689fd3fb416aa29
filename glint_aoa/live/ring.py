"""The ring: the newest fields of a source, by their numbers."""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from glint_aoa.live.sources import Arrival

__all__ = ["FieldRing"]

_EMPTY = -1


class FieldRing:
    """The newest fields; one thread puts, any may read, none waits for another.

    A reader that is overtaken is told so rather than given a field of two halves: the number of a
    place is taken away before its field is written over, and looked at again after reading.

    Parameters
    ----------
    capacity : int
        How many fields.
    shape : (int, int)
        Lines and columns of each.
    dtype : dtype
        uint8 or uint16.
    """

    def __init__(self, capacity: int, shape: tuple[int, int], dtype: DTypeLike) -> None:
        self.capacity = capacity
        self._fields = np.empty((capacity, *shape), dtype)
        self._fields.fill(0)  # takes the memory now rather than field by field
        self._numbers = np.full(capacity, _EMPTY, np.int64)
        self._starts = np.zeros(capacity)
        self._arrived = np.zeros(capacity)
        self.newest = _EMPTY

    @property
    def shape(self) -> tuple[int, int]:
        """Lines and columns of a field."""
        return self._fields.shape[1], self._fields.shape[2]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Grey levels: uint8 or uint16."""
        return self._fields.dtype

    @property
    def oldest(self) -> int:
        """Least number that may be here still."""
        return max(0, self.newest + 1 - self.capacity)

    def put(self, arrival: Arrival) -> None:
        """Keep a field, in place of the one `capacity` numbers before."""
        place = arrival.number % self.capacity
        self._numbers[place] = _EMPTY
        self._fields[place] = arrival.field
        self._starts[place] = arrival.start_s
        self._arrived[place] = arrival.arrived
        self._numbers[place] = arrival.number
        self.newest = arrival.number

    def holds(self, first: int, stop: int) -> NDArray[np.bool_]:
        """Say which of the fields `first` to `stop`, the last one excluded, are here [field]."""
        numbers = np.arange(first, stop)
        here: NDArray[np.bool_] = self._numbers[numbers % self.capacity] == numbers
        return here

    def view(self, first: int, stop: int) -> NDArray[Any]:
        """Fields in the ring's own memory, which ask `holds` afterwards; up to the ring's seam."""
        place = first % self.capacity
        return self._fields[place : min(place + stop - first, self.capacity)]

    def clocks(self, first: int, stop: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return starts of the exposures and arrivals of fields, [field] each [s]."""
        places = np.arange(first, stop) % self.capacity
        return self._starts[places], self._arrived[places]

    def copy_to(self, out: NDArray[Any], first: int, stop: int) -> NDArray[np.bool_]:
        """Copy fields `first` to `stop`, the last one excluded, and return which are whole [field].

        Parameters
        ----------
        out : ndarray, shape (field, line, column)
            Filled with them.
        first, stop : int
            Their numbers.
        """
        before = self.holds(first, stop)
        done = first
        while done < stop:  # once, or twice where the ring's seam lies between
            piece = self.view(done, stop)
            out[done - first : done - first + len(piece)] = piece
            done += len(piece)
        return before & self.holds(first, stop)

    def copy(self, numbers: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Return fields [field, line, column] in memory of their own, and which of them are whole.

        Parameters
        ----------
        numbers : ndarray, shape (field,)
            Of the fields asked for.
        """
        fields = np.empty((numbers.size, *self._fields.shape[1:]), self._fields.dtype)
        here = [
            self.copy_to(fields[k : k + 1], n, n + 1)[0] for k, n in enumerate(numbers.tolist())
        ]
        return fields, np.array(here, np.bool_)
