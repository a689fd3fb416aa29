"""Estimators whose kernel goes from a field to its line in one pass."""

from abc import abstractmethod
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.coarse import search_settings
from glint_aoa.optical.estimator import ColumnCentres, Estimator
from glint_aoa.optical.summary import FieldSummary, Summariser, room_for

__all__ = ["FusedEstimator"]


class FusedEstimator(Estimator):
    """An estimator with a kernel that offers ``column_centres`` and ``measure_fields``."""

    @property
    @abstractmethod
    def _kernel(self) -> ModuleType:
        """The compiled functions, imported when first used."""

    @property
    @abstractmethod
    def _settings(self) -> tuple[Any, ...]:
        """What the kernel takes besides fields, columns and where the line is."""

    def centres(
        self,
        fields: NDArray[np.integer],
        columns: NDArray[np.int64],
        start: NDArray[np.float64],
    ) -> ColumnCentres:
        """Measure the centres; see `Estimator`."""
        size = (len(fields), columns.size)
        row, height = np.empty(size), np.empty(size)
        cut, clipped = np.empty(size, np.bool_), np.empty(size, np.bool_)
        self._kernel.column_centres(
            fields, columns, start, self._settings, row, height, cut, clipped
        )
        return ColumnCentres(row=row, height=height, cut=cut, clipped=clipped)

    def summary(
        self,
        fields: NDArray[np.integer],
        columns: NDArray[np.int64],
        first_line: NDArray[np.float64],
        summariser: Summariser,
    ) -> FieldSummary:
        """Find the line, measure the centres and sum them up in one pass; see `Estimator`."""
        fields = np.ascontiguousarray(fields)
        search = search_settings(fields, self.shape)
        room = room_for(len(fields))
        self._kernel.measure_fields(
            fields, columns, search, self._settings, first_line, summariser.settings, *room
        )
        return FieldSummary.of_figures(*room)
