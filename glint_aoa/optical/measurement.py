"""How the fields of one stack are measured: what `prepare` learnt, and what it is good for."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glint_aoa.geometry import ColumnsToPlane, PixelToPlane
from glint_aoa.geometry.reflection import GlintReflection
from glint_aoa.optical.coarse import find_lines
from glint_aoa.optical.estimator import ColumnCentres, Estimator
from glint_aoa.optical.locking import PixelLocking
from glint_aoa.optical.noise import NoiseModel
from glint_aoa.optical.reference import Mark
from glint_aoa.optical.shape import GlintShape
from glint_aoa.optical.summary import FieldSummary, Summariser
from glint_aoa.records.recording import Recording
from glint_aoa.setup import Setup

__all__ = ["Measurement"]

_Array = NDArray[np.float64]

_LEAST_SAMPLE = 8  # fields below which a column's own offset cannot be told from its noise


@dataclass(frozen=True)
class Measurement:
    """How the fields of one stack are measured; made by `prepare`.

    Attributes
    ----------
    setup, recording
        What is known of camera, glint and recording.
    shape : GlintShape
        What the sample showed of the glint.
    columns : ndarray, shape (column,)
        Columns measured, 0-based in the recorded window.
    to_plane : PixelToPlane
        From sensor pixels to the known plane.
    columns_to_plane : ColumnsToPlane
        The same for the rows of the columns measured.
    estimator : Estimator
        Measures the columns' centres.
    noise : NoiseModel
        The camera's noise.
    column_std, column_offset : ndarray, shape (column,)
        Noise of a column's centre, 1 sigma, and its usual departure from the line; both as
        height on the plane [m, or pixels without a pixel pitch].
    column_height : ndarray, shape (column,)
        Usual height of the glint, on the estimator's scale [grey levels].
    slope_doubt : float
        What the columns' usual departures leave in doubt of every field's slope, 1 sigma [1].
    sagitta, sagitta_std : float
        How far the line's middle lies above its ends, usually [m, or pixels].
    locking : PixelLocking or None
        Whether centres are drawn to whole field lines, where the sample can tell.
    sample_size : int
        Fields in the sample; the noise is unknown below 8.
    mark : Mark or None
        The reference mark, where the setup names one.
    reflection : GlintReflection or None
        From the glint's line to the body's axis, where the setup describes body and lamp.
    """

    setup: Setup
    recording: Recording
    shape: GlintShape
    columns: NDArray[np.int64]
    to_plane: PixelToPlane
    columns_to_plane: ColumnsToPlane
    estimator: Estimator
    noise: NoiseModel
    column_std: _Array
    column_offset: _Array
    column_height: _Array
    slope_doubt: float
    sagitta: float
    sagitta_std: float
    locking: PixelLocking | None
    sample_size: int
    mark: Mark | None
    reflection: GlintReflection | None

    @property
    def is_calibrated(self) -> bool:
        """Whether angles are in the tunnel frame rather than in the image plane."""
        return self.to_plane.position is not None

    @property
    def knows_noise(self) -> bool:
        """Whether the sample was large enough to tell noise from departure."""
        return self.sample_size >= _LEAST_SAMPLE

    @cached_property
    def locks(self) -> bool:
        """Whether pixel locking shows and matters to the angle."""
        if self.locking is None:
            return False
        columns = float(self.columns[-1] - self.columns[0])
        return bool(self.locking.matters(self.line_height * columns / self.span))

    @cached_property
    def line_height(self) -> float:
        """Height of a field line on the plane, at the window's middle [m, or pixels]."""
        middle = self.columns[self.columns.size // 2]
        row = (self.shape.first_row + self.shape.last_row) / 2
        v = self.recording.first_line + row + np.array([0.0, 1.0])
        _, z = self.to_plane(np.full(2, self.recording.first_column + middle), v)
        return float(abs(z[1] - z[0]))

    def centres(self, fields: NDArray[np.integer]) -> ColumnCentres:
        """Find the line in each field and measure the centre of each column."""
        rows = find_lines(fields, self.shape).rows(self.columns, self.shape)
        return self.estimator.centres(fields, self.columns, rows)

    def on_plane(self, row: _Array, number: NDArray[np.int64]) -> tuple[_Array, _Array]:
        """Map centres [field, column], in rows of the window, to the plane: distance and height."""
        s, z = self.columns_to_plane(self.recording.line_of(row, number))
        return s, z if self.reflection is None else z - self.reflection.departure

    def summary(self, fields: NDArray[np.integer], number: NDArray[np.int64]) -> FieldSummary:
        """Measure fields and sum up what their columns tell of the line.

        Parameters
        ----------
        fields : ndarray, shape (field, line, column)
            Grey levels.
        number : ndarray, shape (field,)
            Number of each field in its stack.
        """
        first_line = self.recording.line_of(np.zeros(number.size), number)
        return self.estimator.summary(fields, self.columns, first_line, self._summariser)

    @cached_property
    def _summariser(self) -> Summariser:
        return Summariser.of_columns(
            self.columns,
            self.columns_to_plane,
            departure=None if self.reflection is None else self.reflection.departure,
            std=self.column_std,
            usual=self.column_offset,
            height=self.column_height,
            threshold=self.shape.threshold,
        )

    def brightness(self, height: _Array, used: NDArray[np.bool_]) -> _Array:
        """Height of the glint in each field over the usual, from the used [field, column]."""
        usual = np.where(used, self.column_height, 0.0).sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio: _Array = np.where(used, height, 0.0).sum(axis=1) / usual
        return ratio

    def growth(self, brightness: _Array) -> _Array:
        """Variance of centres over that at the usual height, for a height `brightness` times it.

        Read noise grows with the inverse square of the height, shot noise with its inverse.
        """
        ratio = np.where(np.isfinite(brightness), np.clip(brightness, 0.05, 20.0), 1.0)
        growth: _Array = self._read_share / ratio**2 + (1 - self._read_share) / ratio
        return growth

    @cached_property
    def _read_share(self) -> float:
        """Share of the read noise in the variance on the flanks of the usual glint."""
        shot = self.noise.variance_per_grey * 0.5 * float(np.median(self.column_height))
        return self.noise.read_variance / (self.noise.read_variance + max(shot, 0.0))

    @cached_property
    def span(self) -> float:
        """Length of the measured line on the plane [m, or pixels]."""
        u = self.recording.first_column + self.columns[[0, -1]].astype(np.float64)
        row = (self.shape.first_row + self.shape.last_row) / 2
        s, _ = self.to_plane(u, np.full(2, self.recording.first_line + row))
        return float(abs(s[1] - s[0]))
