"""A field's measured line as a curve over its picture."""

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.line import LineFit
from glint_aoa.optical.measurement import Measurement

__all__ = ["drawn_line"]


def drawn_line(
    fit: LineFit, number: int, measurement: Measurement, shape: tuple[int, int]
) -> NDArray[np.float64]:
    """Map a field's line from the known plane back to the rows of its recorded window.

    Points along the line, spaced as the columns are, go back through perspective, distortion
    and interlace. Where a reflection model is used, what it took off the glint's line is put back,
    so that the curve lies on the glint.

    Parameters
    ----------
    fit : LineFit
        From `glint_aoa.optical.measure.fit_fields` of this one field.
    number : int
        Number of the field in its stack.
    measurement : Measurement
        How it was measured.
    shape : (int, int)
        Lines and columns of the recorded window.

    Returns
    -------
    ndarray [column]
        Row of the window, 0-based, at each of its columns; NaN without a line.
    """
    n_lines, n_columns = shape
    plane, recording = measurement.to_plane, measurement.recording
    first_line = float(recording.line_of(np.zeros(1), np.array([number]))[0])
    columns = recording.first_column + np.arange(n_columns, dtype=np.float64)
    along, _ = plane(columns, np.full(n_columns, first_line + n_lines / 2))
    height = fit.intercept[0] + fit.slope[0] * along
    if measurement.reflection is not None:
        measured = recording.first_column + measurement.columns.astype(np.float64)
        height = height + np.interp(columns, measured, measurement.reflection.departure)
    u, v = plane.to_pixels(along, height)
    rows: NDArray[np.float64] = np.interp(columns, u, v) - first_line
    return rows
