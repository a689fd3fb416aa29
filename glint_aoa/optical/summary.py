"""What the columns of a field come to: its line, and a few figures that tell of its quality."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from glint_aoa.geometry import ColumnsToPlane
from glint_aoa.optical.estimator import ColumnCentres

__all__ = ["FieldSummary", "Summariser"]

_Array = NDArray[np.float64]
_Counts = NDArray[np.int64]


@dataclass(frozen=True)
class FieldSummary:
    """Figures of many fields; attributes have shape (field,) unless said.

    Attributes
    ----------
    slope, intercept, slope_var, intercept_var, covariance
        The robust line on the known plane, see `glint_aoa.optical.line.LineFit`.
    squares
        Sum of squares of the used columns' departures from it [m^2, or pixels^2].
    own_squares
        Weighted sum of squares of their departures from line and usual place [1].
    height, usual_height
        Sums of the used columns' heights, and what they usually come to [grey levels].
    row, reach, row_var
        Row of the line in the recorded window at the middle of the measured columns, what the line
        climbs from there to the last of them [lines], and the variance of `row` [lines^2]; NaN
        where fewer than three columns were used.
    used, dim, cut, clipped
        Numbers of columns that have weight in the line; of those below the least height; that run
        out of the window; and of used ones that are clipped.
    fingerprint
        The same for fields whose centres are the same to the bit, and for no others.
    mark_shift : shape (field, 2)
        How far the reference mark lies from its place [pixels]; NaN without one.
    """

    slope: _Array
    intercept: _Array
    slope_var: _Array
    intercept_var: _Array
    covariance: _Array
    squares: _Array
    own_squares: _Array
    height: _Array
    usual_height: _Array
    row: _Array
    reach: _Array
    row_var: _Array
    used: _Counts
    dim: _Counts
    cut: _Counts
    clipped: _Counts
    fingerprint: NDArray[np.uint64]
    mark_shift: _Array

    @property
    def row_std(self) -> _Array:
        """Noise of `row`, 1 sigma [lines]."""
        return np.sqrt(self.row_var)

    @property
    def mean_height(self) -> _Array:
        """Mean height of the used columns [grey levels]; NaN where there is no line."""
        mean: _Array = self.height / np.maximum(self.used, 1)
        return np.where(np.isfinite(self.row), mean, np.nan)

    @classmethod
    def of_figures(cls, figures: _Array, counts: _Counts, fingerprint: NDArray[np.uint64]) -> Self:
        """Name what the compiled sums have filled, see `room_for`."""
        unknown = np.full((fingerprint.size, 2), np.nan)
        values = [*figures.T, *counts.T, fingerprint, unknown]
        return cls(**dict(zip((f.name for f in fields(cls)), values, strict=True)))

    @classmethod
    def joined(cls, parts: Iterable[Self], n_fields: int) -> Self:
        """Join consecutive blocks as they come; no more than one is held beside the whole."""
        whole: dict[str, Any] = {}
        start = 0
        for part in parts:
            stop = start + part.used.size
            for f in fields(cls):
                block = getattr(part, f.name)
                if not start:
                    whole[f.name] = np.empty((n_fields, *block.shape[1:]), block.dtype)
                whole[f.name][start:stop] = block
            start = stop
        return cls(**whole)


@dataclass(frozen=True, eq=False)
class Summariser:
    """Sums up the centres of certain columns; made by `of_columns`.

    Attributes
    ----------
    middle, half : float
        Of the sensor lines in which the polynomials are [pixels].
    s, z : ndarray, shape (power, column)
        Polynomials from sensor lines to the plane.
    std, usual, height : ndarray, shape (column,)
        A centre's noise and usual departure on the plane, and its usual height.
    place : ndarray, shape (column,)
        Place along the line: -1 at the first column, 1 at the last.
    odd : ndarray of uint64, shape (column,)
        Odd numbers by which the bits of the centres are told apart.
    threshold : float
        Height below which a column counts as dim [grey levels].
    """

    middle: float
    half: float
    s: _Array
    z: _Array
    std: _Array
    usual: _Array
    height: _Array
    place: _Array
    odd: NDArray[np.uint64]
    threshold: float

    @classmethod
    def of_columns(
        cls,
        columns: _Counts,
        to_plane: ColumnsToPlane,
        *,
        departure: _Array | None,
        std: _Array,
        usual: _Array,
        height: _Array,
        threshold: float,
    ) -> Self:
        """Prepare to sum up centres of columns.

        Parameters
        ----------
        columns : ndarray, shape (column,)
            The columns [pixels].
        to_plane : ColumnsToPlane
            From sensor lines to the known plane.
        departure : ndarray, shape (column,), optional
            What the glint itself departs from a straight line on the plane.
        std, usual, height, threshold
            As for the class.
        """
        z = to_plane.z.copy()
        if departure is not None:
            z[0] -= departure
        return cls(
            middle=to_plane.middle,
            half=to_plane.half,
            s=to_plane.s,
            z=z,
            std=std,
            usual=usual,
            height=height,
            place=places(columns),
            odd=odd_numbers(columns.size),
            threshold=threshold,
        )

    def __call__(self, centres: ColumnCentres, first_line: _Array) -> FieldSummary:
        """Sum up a block of fields.

        Parameters
        ----------
        centres : ColumnCentres
            Centres of the columns.
        first_line : ndarray, shape (field,)
            Sensor line of the window's row 0 in each field [pixels].
        """
        from glint_aoa.optical import _summary_kernel as kernel  # noqa: PLC0415  compiles

        figures, counts, fingerprint = room_for(first_line.size)
        kernel.summed_part(
            centres.row,
            centres.height,
            centres.cut,
            centres.clipped,
            first_line,
            self.settings,
            figures,
            counts,
            fingerprint,
        )
        return FieldSummary.of_figures(figures, counts, fingerprint)

    @property
    def settings(self) -> tuple[Any, ...]:
        """What the compiled sums take besides a block of centres."""
        return (
            self.middle,
            self.half,
            self.s,
            self.z,
            self.std,
            self.usual,
            self.height,
            self.place,
            self.odd,
            self.threshold,
        )


def room_for(n_fields: int) -> tuple[_Array, _Counts, NDArray[np.uint64]]:
    """Memory for what the compiled sums fill."""
    from glint_aoa.optical import _summary_kernel as kernel  # noqa: PLC0415  compiles

    counts = np.empty((n_fields, kernel.N_COUNTS), np.int64)
    return np.empty((n_fields, kernel.N_FIGURES)), counts, np.empty(n_fields, np.uint64)


def places(columns: _Counts) -> _Array:
    """Place of columns along the line: -1 at the first and 1 at the last."""
    middle, half = (columns[0] + columns[-1]) / 2, max((columns[-1] - columns[0]) / 2, 0.5)
    place: _Array = (columns - middle) / half
    return place


def odd_numbers(size: int) -> NDArray[np.uint64]:
    """Odd numbers at random, always the same."""
    numbers = np.random.default_rng(size).integers(2**63, size=size).astype(np.uint64)
    return 2 * numbers + np.uint64(1)
