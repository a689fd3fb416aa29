"""Other people's ways to a column's centre; each returns rows [field, column]."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.scene import BLACK

_Rows = NDArray[np.float64]

RIDGE_LINES = 24  # around the line: the package takes 0.2 ms for each pixel


def _above_background(fields: NDArray[np.uint8], columns: NDArray[np.int64]) -> NDArray[np.float32]:
    return np.clip(fields[:, :, columns].astype(np.float32) - 2 * BLACK, 0, None)


def scipy_centre_of_mass(fields: NDArray[np.uint8], columns: NDArray[np.int64]) -> _Rows:
    """Measure by `scipy.ndimage.center_of_mass`, column by column."""
    return np.array(
        [
            [ndimage.center_of_mass(field[:, i])[0] for i in range(columns.size)]
            for field in _above_background(fields, columns)
        ]
    )


def opencv_moments(fields: NDArray[np.uint8], columns: NDArray[np.int64]) -> _Rows:
    """Measure by `cv2.moments`, column by column."""
    rows = np.empty((len(fields), columns.size))
    for f, field in enumerate(_above_background(fields, columns)):
        for i in range(columns.size):
            moments = cv2.moments(np.ascontiguousarray(field[:, i : i + 1]))
            rows[f, i] = moments["m01"] / moments["m00"]
    return rows


def numpy_centroid(fields: NDArray[np.uint8], columns: NDArray[np.int64]) -> _Rows:
    """Measure all columns of all fields at once in numpy."""
    above = _above_background(fields, columns)
    row = np.arange(fields.shape[1], dtype=np.float32)
    return np.einsum("flc,l->fc", above, row).astype(np.float64) / above.sum(axis=1)


def ridge_detection(fields: NDArray[np.uint8], columns: NDArray[np.int64]) -> _Rows:
    """Measure by the package `ridge-detection`, a translation of Steger's program.

    Called at `detect_lines`: its `LineDetector` rounds the points to whole pixels, takes height
    for width, and stops with an IndexError where a field has no junctions.
    """
    from ridge_detection.linesUtil import MODE_LIGHT  # noqa: PLC0415  only here
    from ridge_detection.position import detect_lines  # noqa: PLC0415

    rows = np.empty((len(fields), columns.size))
    for f, field in enumerate(fields):
        profile = field.sum(axis=1, dtype=np.int64)
        first = max(int(profile.argmax()) - RIDGE_LINES // 2, 0)
        part = field[first : first + RIDGE_LINES].astype(float)
        lines: list[object] = []
        detect_lines(
            image=part.ravel().tolist(),
            width=part.shape[1],
            height=part.shape[0],
            contours=lines,
            sigma=1.5,
            low=3.0,
            high=8.0,
            mode=MODE_LIGHT,
            compute_width=True,
            correct_pos=True,
            extend_lines=False,
            junctions=[],
        )
        longest = max(lines, key=lambda line: len(line.col))  # type: ignore[attr-defined]
        u, v = np.asarray(longest.col), np.asarray(longest.row)  # type: ignore[attr-defined]
        order = np.argsort(u)
        rows[f] = first + np.interp(columns, u[order], v[order])
    return rows


RIVALS = {
    "scipy.ndimage.center_of_mass": (scipy_centre_of_mass, 100),
    "cv2.moments": (opencv_moments, 200),
    "numpy centroid, vectorised": (numpy_centroid, 200),
    "ridge-detection, 24 lines": (ridge_detection, 3),
}
"""Name, function and how many fields of it are enough."""
