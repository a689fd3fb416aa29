"""Which columns are measured."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["spread_columns", "used_columns"]


def used_columns(n_columns: int, step: int) -> NDArray[np.int64]:
    """Columns at which centres are measured: every `step`, from the middle of the first step."""
    first = min(step // 2, (n_columns - 1) // 2)
    return np.arange(first, n_columns, step, dtype=np.int64)


def spread_columns(n_columns: int, most: int) -> NDArray[np.int64]:
    """At most so many columns, evenly spread and the same from either end."""
    places = np.linspace(0.0, (n_columns - 1) / 2, (min(most, n_columns) + 1) // 2)
    left = np.unique(np.floor(places).astype(np.int64))
    return np.unique(np.concatenate([left, n_columns - 1 - left]))
