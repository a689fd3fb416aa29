"""Other people's ways to a column's centre; each returns rows [field, column]."""

import tempfile

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.scene import BLACK

_Rows = NDArray[np.float64]

PYIDI_COLUMNS = 9  # of the window about each point
PYIDI_REFERENCE = 20  # fields
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


def opencv_fit_line(fields: NDArray[np.uint8], columns: NDArray[np.int64]) -> _Rows:
    """Measure by `cv2.threshold` at half the peak and `cv2.fitLine`, in all columns."""
    rows = np.empty((len(fields), columns.size))
    for f, field in enumerate(fields):
        _, inside = cv2.threshold(field, (int(field.max()) + BLACK) / 2, 255, cv2.THRESH_BINARY)
        v, u = np.nonzero(inside)
        pixels = np.stack([u, v], axis=1).astype(np.float32)
        du, dv, u0, v0 = cv2.fitLine(pixels, cv2.DIST_L2, 0, 0.01, 0.01).ravel()
        rows[f] = v0 + (columns - u0) * dv / du
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


def pyidi(fields: NDArray[np.uint8], columns: NDArray[np.int64]) -> _Rows:
    """Measure by the package `pyidi`, displacements since the mean of the first fields.

    Its Lucas-Kanade method along a known direction; windows of 15 lines and 9 columns, the default
    width, about the brightest row of each column. It measures no place, so the displacements are
    added to the centroids of that mean.
    """
    from pyidi import DirectionalLucasKanade, VideoReader  # noqa: PLC0415  only here

    reference = fields[:PYIDI_REFERENCE].mean(axis=0)
    brightest = reference.argmax(axis=0)[columns]
    room = ((0, 0), (0, 0), (PYIDI_COLUMNS, PYIDI_COLUMNS))  # for the windows at the edge
    with tempfile.TemporaryDirectory() as folder:
        method = DirectionalLucasKanade(VideoReader(np.pad(fields, room, "edge"), root=folder))
        method.configure(
            roi_size=(15, PYIDI_COLUMNS),
            dij=(1, 0),
            reference_image=np.pad(reference, room[1:], "edge"),
            verbose=0,
            show_pbar=False,
        )
        method.set_points(np.stack([brightest, columns + PYIDI_COLUMNS], axis=1))
        moved = method.get_displacements(autosave=False)
    at_rest = numpy_centroid(fields[:PYIDI_REFERENCE], columns).mean(axis=0)
    return np.asarray(at_rest + moved[:, :, 0].T, np.float64)


RIVALS = {
    "scipy.ndimage.center_of_mass": (scipy_centre_of_mass, 100),
    "cv2.moments": (opencv_moments, 200),
    "cv2.threshold and cv2.fitLine": (opencv_fit_line, 200),
    "numpy centroid, vectorised": (numpy_centroid, 200),
    "pyidi, 9 columns a window": (pyidi, 200),
    "ridge-detection, 24 lines": (ridge_detection, 3),
}
"""Name, function and how many fields of it are enough."""
