"""OpenCV's detectors of boards, on pixels made square, and the finer measurement that follows."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.camera._board import Board
from calibration.targets.find import find_targets
from glint_aoa.errors import CalibrationError

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]

_WIDTH = (500, 1600)  # pixels of the picture that is searched
_LEAST_SIDE = 3  # corners, of a board that OpenCV looks for
_LEAST_CONTRAST = 12.0  # grey levels of 255
_CLIPPED = 0.5  # share of pixels at the top level that says over-exposed
_PERCENT = (1.0, 99.0)
_LEAST_DISC, _MOST_DISC = 4.0, 0.25  # diameter [pixels], and of the picture's width
_MOST_AXIS_RATIO = 3.0  # of a disc on square pixels


@dataclass(frozen=True, eq=False)
class Found:
    """Corners as detected.

    Attributes
    ----------
    corner : ndarray of int [corner]
        Which of the board's corners they are said to be.
    points : ndarray [corner, 2]
        Column and row in the picture [pixels].
    area : ndarray [corner]
        Product of the semi-axes of circles [pixels^2]; none for corners.
    note : str
        What was repaired.
    """

    corner: NDArray[np.int64]
    points: Floats
    area: Floats
    note: str = ""


@dataclass(frozen=True)
class NotFound:
    """Why no board was found, and what to photograph instead."""

    reason: str


@dataclass(frozen=True, eq=False)
class _Square:
    """A picture with pixels made square, and the scales that did it."""

    grey: Bytes
    scale: Floats

    def back(self, points: Floats) -> Floats:
        """Turn its columns and rows into those of the picture."""
        return (points + 0.5) / self.scale - 0.5

    def there(self, points: Floats) -> Floats:
        """Turn columns and rows of the picture into its own."""
        return (points + 0.5) * self.scale - 0.5


def detect(grey: NDArray[np.float32], board: Board, aspect: float) -> Found | NotFound:
    """Detect a board; corners to a pixel, circles as measured.

    Parameters
    ----------
    grey : ndarray [line, column]
        The picture.
    board : Board
        What to look for.
    aspect : float
        Vertical over horizontal pixel pitch.
    """
    dark, light = np.percentile(grey, _PERCENT)
    white = 255.0 if grey.max() <= 255 else float(grey.max())
    if light - dark < _LEAST_CONTRAST / 255 * white:
        return NotFound(
            f"the picture is of one grey, {dark:.0f} to {light:.0f}; light the board and expose "
            "longer"
        )
    if np.mean(grey >= white) > _CLIPPED:
        return NotFound(
            "more than half of the picture is over-exposed; expose for the board's white"
        )
    square = _made_square(grey, (dark, light), aspect)
    if board.kind == "chessboard":
        return _chessboard(square, board)
    if board.kind == "charuco":
        return _charuco(square, board)
    return _circles(grey, square, board, aspect)


def _made_square(grey: NDArray[np.float32], levels: tuple[float, float], aspect: float) -> _Square:
    lines, columns = grey.shape
    across = max(1.0, 1 / aspect)  # neither direction loses pixels
    across *= np.clip(1.0, _WIDTH[0] / (across * columns), _WIDTH[1] / (across * columns))
    size = round(columns * across), round(lines * across * aspect)
    stretched = np.clip((grey - levels[0]) * (255 / (levels[1] - levels[0])), 0, 255)
    how = cv2.INTER_AREA if across < 1 else cv2.INTER_CUBIC
    resized = cv2.resize(stretched.astype(np.uint8), size, interpolation=how)
    return _Square(np.asarray(resized, np.uint8), np.array([size[0] / columns, size[1] / lines]))


def _chessboard(square: _Square, board: Board) -> Found | NotFound:
    corners = _quick_corners(square.grey, board.shape)
    if corners is None:
        corners = _thorough_corners(square.grey, board.shape)
    if corners is not None:
        return _plain(np.arange(len(corners)), square.back(corners))
    columns, rows = board.shape
    fewer = columns - 1, rows - 1
    if min(fewer) >= _LEAST_SIDE and _quick_corners(square.grey, fewer) is not None:
        return NotFound(
            f"a chessboard of {columns - 1} x {rows - 1} inner corners is seen, not of {columns} x "
            f"{rows}: count where squares meet, not the squares; give --board chessboard:"
            f"{columns - 1}x{rows - 1}:..."
        )
    return NotFound(
        f"no chessboard of {columns} x {rows} inner corners is seen; show it whole with a white "
        "margin of a square around it, evenly lit and sharp"
    )


def _quick_corners(grey: Bytes, shape: tuple[int, int]) -> Floats | None:
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(grey, shape, flags=flags)
    return np.asarray(corners, np.float64).reshape(-1, 2) if found else None


def _thorough_corners(grey: Bytes, shape: tuple[int, int]) -> Floats | None:
    """Search harder; it may take texture for a board, which the order of its corners then shows."""
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    found, corners = cv2.findChessboardCornersSB(grey, shape, flags=flags)
    return np.asarray(corners, np.float64).reshape(-1, 2) if found else None


def _charuco(square: _Square, board: Board) -> Found | NotFound:
    dictionary = cv2.aruco.getPredefinedDictionary(_dictionary(board.dictionary or ""))
    needed, there = board.columns * board.rows // 2, len(dictionary.bytesList)
    if needed > there:
        raise CalibrationError(
            f"a board of {board.columns} x {board.rows} squares has {needed} markers, and "
            f"{str(board.dictionary).lower()} only {there}; give the board's own "
            "dictionary and size"
        )
    best, n_markers = _plain(np.empty(0, np.int64), np.empty((0, 2))), 0
    for legacy in (False, True):  # boards drawn before OpenCV 4.6 differ where rows are even
        printed = cv2.aruco.CharucoBoard(
            (board.columns, board.rows), board.spacing, board.marker or 0.0, dictionary
        )
        printed.setLegacyPattern(legacy)
        corners, ids, _, markers = cv2.aruco.CharucoDetector(printed).detectBoard(square.grey)
        n_markers = max(n_markers, 0 if markers is None else len(markers))
        if ids is not None and len(ids) > best.corner.size:
            points = square.back(np.asarray(corners, np.float64).reshape(-1, 2))
            best = _plain(np.asarray(ids, np.int64).ravel(), points)
    if best.corner.size:
        return best
    if n_markers:
        return NotFound(
            f"{n_markers} markers of {board.dictionary} are seen but no corner between them; "
            f"check that the board has {board.columns} x {board.rows} squares, or come nearer"
        )
    return NotFound(
        f"no marker of the dictionary {board.dictionary} is seen; check the board's dictionary, "
        "and show its markers 20 pixels large or more, evenly lit and sharp"
    )


def _dictionary(name: str) -> int:
    known = {each.upper(): each for each in dir(cv2.aruco) if each.startswith("DICT_")}
    found = known.get(f"DICT_{name.upper()}")
    if found is None:
        names = ", ".join(each.removeprefix("DICT_").lower() for each in known)
        raise CalibrationError(
            f'"{name.lower()}" is not a dictionary of markers; give one of {names}'
        )
    return int(getattr(cv2.aruco, found))


def _circles(
    grey: NDArray[np.float32], square: _Square, board: Board, aspect: float
) -> Found | NotFound:
    """Arrange discs, measured on the picture as recorded, by OpenCV's finder of grids."""
    most = 0
    for polarity in ("dark", "bright"):
        discs = find_targets(
            grey,
            polarity=polarity,
            min_diameter=_LEAST_DISC,
            max_diameter=_MOST_DISC * grey.shape[1],
            max_axis_ratio=_MOST_AXIS_RATIO * max(aspect, 1 / aspect),
        )
        most = max(most, len(discs))
        if len(discs) < len(board.places):
            continue
        points = np.column_stack([discs.u, discs.v])
        order = _arranged(square.there(points), board)
        if order is not None:
            area = discs.semi_axes[order].prod(axis=1)
            return Found(np.arange(len(order)), points[order], area)
    columns, rows = board.shape
    wanted = f"{columns} x {rows} ({columns * rows})"
    if most < columns * rows:
        return NotFound(
            f"{most} circles of the {wanted} are seen; show the whole grid, evenly lit and sharp, "
            "its circles 10 pixels or more across"
        )
    return NotFound(
        f"{most} circles are seen, but no grid of {wanted}; count again, and clear the "
        "background of round marks"
    )


def _arranged(points: Floats, board: Board) -> NDArray[np.int64] | None:
    """Return which of the points is which circle of the grid; None where they make no grid."""
    asymmetric = board.kind == "asymmetric-circles"
    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    candidates = points.astype(np.float32).reshape(-1, 1, 2)
    for flags in (kind, kind | cv2.CALIB_CB_CLUSTERING):
        found, centres = cv2.findCirclesGrid(
            candidates, board.shape, flags, None, cv2.CirclesGridFinderParameters()
        )
        if found:
            apart = np.asarray(centres, np.float64).reshape(-1, 1, 2) - points
            return np.asarray(np.argmin(np.sum(apart**2, axis=-1), axis=1), np.int64)
    return None


def _plain(corner: NDArray[np.int64], points: Floats) -> Found:
    return Found(corner, points, np.empty(0))
