"""What every estimator of the columns' centres takes and gives."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.coarse import find_lines
from glint_aoa.optical.columns import spread_columns
from glint_aoa.optical.shape import GlintShape

if TYPE_CHECKING:
    from glint_aoa.optical.summary import FieldSummary, Summariser

__all__ = ["ColumnCentres", "Estimator", "Sample"]


@dataclass(frozen=True)
class ColumnCentres:
    """Centres of the glint in many columns of many fields.

    Attributes
    ----------
    row : ndarray, shape (field, column)
        Centre in rows of the recorded window [field lines]; NaN where not measured.
    height : ndarray, shape (field, column)
        Height of the glint over its background, on the estimator's own scale [grey levels].
    cut : ndarray of bool, shape (field, column)
        Whether the line is expected there but runs out of the window.
    clipped : ndarray of bool, shape (field, column)
        Whether a pixel of the window is at the top of the scale.
    """

    row: NDArray[np.float64]
    height: NDArray[np.float64]
    cut: NDArray[np.bool_]
    clipped: NDArray[np.bool_]

    @classmethod
    def joined(cls, parts: list[Self]) -> Self:
        """Join the centres of consecutive fields."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)}
        )


@dataclass(frozen=True)
class Sample:
    """A few fields of a stack in which the line is already known well.

    Attributes
    ----------
    fields : ndarray, shape (field, line, column)
        Grey levels.
    columns : ndarray, shape (column,)
        Columns measured, 0-based in the recorded window.
    row : ndarray, shape (field, column)
        Where the line is: the field's fitted line and the column's usual departure from it, in
        rows of the recorded window; NaN where unknown.
    """

    fields: NDArray[np.integer]
    columns: NDArray[np.int64]
    row: NDArray[np.float64]

    def thinned(self, most: int) -> Self:
        """Keep at most so many columns, evenly spread and the same from either end."""
        kept = spread_columns(self.columns.size, most)
        return type(self)(self.fields, self.columns[kept], self.row[:, kept])


class Estimator(ABC):
    """Measures the centre of the glint in each column, starting from the coarse line.

    Each estimator's file offers ``learn(sample, shape, noise)``, which returns one.

    Attributes
    ----------
    shape : GlintShape
        What is known of the glint.
    """

    shape: GlintShape

    @property
    @abstractmethod
    def name(self) -> str:
        """Name in the setup."""

    @property
    @abstractmethod
    def settings(self) -> Mapping[str, object]:
        """Figures behind the estimator, for the record's attributes."""

    @abstractmethod
    def centres(
        self,
        fields: NDArray[np.integer],
        columns: NDArray[np.int64],
        start: NDArray[np.float64],
    ) -> ColumnCentres:
        """Measure the centres.

        Parameters
        ----------
        fields : ndarray, shape (field, line, column)
            Grey levels, uint8 or uint16.
        columns : ndarray, shape (column,)
            Columns to measure, 0-based in the recorded window.
        start : ndarray, shape (field, column)
            Row at which the line is expected, good to a line or two; NaN where there is none.

        Returns
        -------
        ColumnCentres
            The centres.
        """

    def summary(
        self,
        fields: NDArray[np.integer],
        columns: NDArray[np.int64],
        first_line: NDArray[np.float64],
        summariser: "Summariser",
    ) -> "FieldSummary":
        """Find the line in each field, measure its centres and sum them up.

        Parameters
        ----------
        fields : ndarray, shape (field, line, column)
            Grey levels, uint8 or uint16.
        columns : ndarray, shape (column,)
            Columns to measure, 0-based in the recorded window.
        first_line : ndarray, shape (field,)
            Sensor line of the window's row 0 in each field [pixels].
        summariser : Summariser
            From the columns' centres to the field's line.

        Returns
        -------
        FieldSummary
            What the columns come to.
        """
        start = find_lines(fields, self.shape).rows(columns, self.shape)
        return summariser(self.centres(fields, columns, start), first_line)
