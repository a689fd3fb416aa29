"""Fine measurement of a detected board: corners fitted, circles' radius from their areas."""

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.camera._board import Board
from calibration.camera._board_detection import Found, NotFound
from calibration.camera._corner_fit import fit_corners

Floats = NDArray[np.float64]

_HALF = 0.5  # window to either side, of the distance to the next edge
_HALF_OF_MARGIN = 0.8  # likewise, of the margin between a marker and its square's edge
_WIDEST = 15.0  # columns to either side: more adds pixels, not information
_LEAST_HALF = (3, 1)  # columns and rows


def measure_corners(
    found: Found, grey: NDArray[np.float32], board: Board, aspect: float
) -> Found | NotFound:
    """Fit each detected corner on the picture as recorded.

    Parameters
    ----------
    found : Found
        Corners in the board's order.
    grey : ndarray [line, column]
        The picture.
    board : Board
        The board.
    aspect : float
        Vertical over horizontal pixel pitch.
    """
    across = _derivatives(board.places[found.corner], found.points * [1.0, aspect])
    half = _half_window(across, board, aspect)
    if half[0] < _LEAST_HALF[0] or half[1] < _LEAST_HALF[1]:
        side = np.sqrt(np.abs(np.linalg.det(across)).min()) * _room(board)
        what = "squares" if board.marker is None else "margins between markers and squares"
        return NotFound(
            f"its {what} are only {side:.1f} pixels wide and {side / aspect:.1f} high; come "
            "nearer, or use a board with larger ones"
        )
    edges = np.arctan2(across[:, 1], across[:, 0])
    fitted = fit_corners(grey, found.points, edges, half, aspect)
    lost = int(np.sum(~fitted.good))
    notes = [found.note] if found.note else []
    if lost:
        notes.append(
            f"{lost} of its corners left out: cut by the edge, covered, or not like a corner's"
        )
    return Found(
        found.corner[fitted.good], fitted.points[fitted.good], np.empty(0), "; ".join(notes)
    )


def circle_radius(found: Found, board: Board) -> float:
    """Return the radius of the circles [m], from their areas in the picture and the grid's."""
    across = _derivatives(board.places[found.corner], found.points)
    return float(np.median(np.sqrt(found.area / np.abs(np.linalg.det(across)))))


def _derivatives(places: Floats, points: Floats) -> Floats:
    """Return how pixels change with the place on the board, [corner, 2, 2] in pixels/m."""
    homography, _ = cv2.findHomography(places[:, :2], points, 0)
    flat = np.column_stack([places[:, :2], np.ones(len(places))]) @ homography.T
    seen = flat[:, :2] / flat[:, 2:]
    by_place = homography[None, :2, :2] - seen[:, :, None] * homography[None, 2:, :2]
    derivatives: Floats = by_place / flat[:, 2, None, None]
    return derivatives


def _half_window(across: Floats, board: Board, aspect: float) -> tuple[int, int]:
    """Return columns and rows to either side that hold no edge but the corner's own two."""
    longer = np.linalg.norm(across, axis=1).max(axis=1)
    to_edge = float(np.min(np.abs(np.linalg.det(across)) / longer))
    share = _HALF if board.marker is None else _HALF_OF_MARGIN
    half = min(share * _room(board) * to_edge, _WIDEST)
    return int(half), int(half / aspect)


def _room(board: Board) -> float:
    """Return the distance from a corner to what is printed next to it [m]."""
    return board.spacing if board.marker is None else (board.spacing - board.marker) / 2
