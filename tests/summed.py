"""Centres that are given, summed up as those of measured fields are."""

import numpy as np

from glint_aoa.geometry import ColumnsToPlane
from glint_aoa.optical.estimator import ColumnCentres
from glint_aoa.optical.summary import Summariser


def summed(centre_row, columns, *, height=80.0, cut=False, clipped=False, **column):
    """Sum up centres [field, column] on a plane of which a pixel is the unit, v downwards.

    Columns have a noise of a line, no usual departure and the usual height, unless said.
    """
    n = columns.size
    plane = ColumnsToPlane(
        0.0, 1.0, columns[None].astype(float), np.stack([np.zeros(n), -np.ones(n)])
    )
    known = {"std": np.ones(n), "usual": np.zeros(n), "height": np.full(n, 80.0), **column}
    known.setdefault("departure", None)
    known.setdefault("threshold", 0.0)
    size = centre_row.shape
    centres = ColumnCentres(
        np.ascontiguousarray(centre_row),
        *(np.array(np.broadcast_to(each, size)) for each in (height, cut, clipped)),
    )
    return Summariser.of_columns(columns, plane, **known)(centres, np.zeros(len(centre_row)))
