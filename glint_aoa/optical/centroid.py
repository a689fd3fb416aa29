"""Column centres: background-subtracted intensity centroid in a window that follows the line."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.shape import GlintShape

__all__ = ["ColumnCentres", "centroid_columns"]


@dataclass(frozen=True)
class ColumnCentres:
    """Centres of the glint in many columns of many fields.

    Attributes
    ----------
    row : ndarray, shape (field, column)
        Centre in rows of the recorded window [field lines]; NaN where not measured.
    height : ndarray, shape (field, column)
        Mean height of the glint's window over its background [grey levels].
    cut : ndarray of bool, shape (field, column)
        Whether the line is expected there but runs out of the window.
    clipped : ndarray of bool, shape (field, column)
        Whether a pixel of the window is at the top of the scale.
    """

    row: NDArray[np.float64]
    height: NDArray[np.float64]
    cut: NDArray[np.bool_]
    clipped: NDArray[np.bool_]


def centroid_columns(
    fields: NDArray[np.integer], columns: NDArray[np.int64], shape: GlintShape
) -> ColumnCentres:
    r"""Measure the glint's centre in the given columns of each field.

    In each field the brightest box of lines of each column votes for a coarse line; a column
    that disagrees starts from the line instead. The centroid's window then settles on its own
    centre c, where

    .. math:: \sum_v w(v - c) (v - c) (I_v - B_v) = 0, \quad w(t) = \cos^2(\pi t / 2h)

    with h the half width and B the background, linear between the lines on both sides. The soft
    edges keep single lines from pulling the centre, and are near the best weights for the noise.

    Parameters
    ----------
    fields : ndarray, shape (field, line, column)
        Grey levels, uint8 or uint16.
    columns : ndarray, shape (column,)
        Columns to measure, 0-based in the recorded window.
    shape : GlintShape
        What is known of the glint, from `glint_aoa.optical.detect.find_glint`.

    Returns
    -------
    ColumnCentres
        Centres, heights and what is wrong with them.

    Notes
    -----
    The method of the paper ("vertical line centroids are computed every 20 columns") with a soft
    window in place of a sharp one. For a Gaussian glint its noise is 1.0 to 1.1 times the
    Cramer-Rao bound and its pixel locking below 0.0002 line (0.001 line for sigma 0.7). It is
    biased where the background is curved across the window, where a second line enters it, and by
    clipping of an asymmetric glint.
    """
    from glint_aoa.optical import _centroid_kernel as kernel  # noqa: PLC0415  compiles

    size = (len(fields), columns.size)
    row, height = np.empty(size), np.empty(size)
    status, clipped = np.empty(size, np.uint8), np.empty(size, np.bool_)
    kernel.column_centres(
        fields,
        columns,
        shape.first_row,
        shape.last_row,
        shape.half_box,
        shape.half_width,
        shape.flank,
        shape.sign,
        shape.threshold,
        shape.saturation,
        row,
        height,
        status,
        clipped,
    )
    return ColumnCentres(row=row, height=height, cut=status == kernel.CUT, clipped=clipped)
