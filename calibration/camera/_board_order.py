"""Corners in the order of the board: detectors mix up rows, columns and ends now and then."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.camera._board import Board
from calibration.camera._board_detection import NotFound

Floats = NDArray[np.float64]

_TINY = 1e-9  # pixels: corners that all lie in one line
_SURELY = 0.03  # squares: no other order need be tried
_CLEARLY = 0.5  # of the misfit as detected: another order is the board's
_MOST_MISFIT = 0.4  # squares: a fisheye bends a board less
_MOST_BEND = 0.5  # squares by which a corner may miss the middle of its neighbours, times two


class Ordered(NamedTuple):
    """Which of the board's corners each one is, and what was repaired."""

    corner: NDArray[np.int64]
    note: str


def put_in_order(
    corner: NDArray[np.int64], points: Floats, board: Board, aspect: float
) -> Ordered | NotFound:
    """Give each corner its place on the board, or say that the corners make no board.

    A flat board is seen through a homography, bent a little by the lens, and from its front. The
    order that the detector gives is kept unless another one fits clearly better: rows and columns
    exchanged, or either of them reversed. Corners must then lie evenly along the board's rows and
    columns. A board that looks the same when it is turned by 180 degrees may be listed from
    either end: each image has a pose of its own, and the camera comes out the same.

    Parameters
    ----------
    corner : ndarray of int [corner]
        Which of the board's corners they are said to be.
    points : ndarray [corner, 2]
        Columns and lines [pixels].
    board : Board
        The board.
    aspect : float
        Vertical over horizontal pixel pitch.
    """
    places, shape, square = board.places, board.shape, points * [1.0, aspect]
    note, misfit = "", _misfit(places[corner], square)
    if misfit > _SURELY and corner.size == len(places):
        orders = _orders(*shape)
        misfits = {name: _misfit(places[order], square) for name, order in orders.items()}
        best = min(misfits, key=misfits.__getitem__)
        if misfits[best] < _CLEARLY * misfit:
            corner, misfit = orders[best], misfits[best]
            note = f"corner order repaired: {best}"
    period = 1 if board.kind != "asymmetric-circles" else 2  # rows are staggered
    bend = _bend(corner, square, shape, period) / _square(square, places[corner])
    if misfit < _MOST_MISFIT and bend < _MOST_BEND:
        return Ordered(corner, note)
    return NotFound(
        f"its corners are not in the order of a board of {shape[0]} x {shape[1]}; show the whole "
        "board from its front, flat and evenly lit"
    )


def _orders(columns: int, rows: int) -> dict[str, NDArray[np.int64]]:
    """Return places of the corners that a detector may have meant, by what it confused."""
    grid = np.arange(columns * rows).reshape(rows, columns)
    return {
        "turned by 180 degrees": grid[::-1, ::-1].ravel(),
        "rows in reverse": grid[::-1].ravel(),
        "columns in reverse": grid[:, ::-1].ravel(),
        "rows and columns exchanged": grid.T.ravel(),
        "rows and columns exchanged, turned by 180 degrees": grid.T[::-1, ::-1].ravel(),
        "rows and columns exchanged, rows in reverse": grid.T[::-1].ravel(),
        "rows and columns exchanged, columns in reverse": grid.T[:, ::-1].ravel(),
    }


def _misfit(places: Floats, points: Floats) -> float:
    """Rms distance of corners from a flat board's seen from its front, in squares."""
    homography, _ = cv2.findHomography(places[:, :2], points, 0)
    if homography is None or np.linalg.det(homography) <= 0:
        return np.inf
    flat = np.column_stack([places[:, :2], np.ones(len(places))]) @ homography.T
    if not (np.sign(flat[:, 2]) == np.sign(flat[0, 2])).all():
        return np.inf
    off = points - flat[:, :2] / flat[:, 2:]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))) / _square(points, places))


def _bend(corner: NDArray[np.int64], points: Floats, shape: tuple[int, int], period: int) -> float:
    """Return the greatest second difference along rows and columns [pixels]."""
    listed = np.full((shape[0] * shape[1], 2), np.nan)
    listed[corner] = points
    grid = listed.reshape(shape[1], shape[0], 2)
    along = grid[:, 2:] - 2 * grid[:, 1:-1] + grid[:, :-2]
    down = grid[2 * period :] - 2 * grid[period:-period] + grid[: -2 * period]
    both = np.concatenate([np.hypot(*each.reshape(-1, 2).T) for each in (along, down)])
    both = both[np.isfinite(both)]
    return float(both.max(initial=0.0))


def _square(points: Floats, places: Floats) -> float:
    """Side of a square in the picture, from the areas that the corners spread over."""
    on_board = np.min(np.linalg.norm(places[1:] - places[:1], axis=1))
    ratio = np.linalg.det(np.cov(points.T)) / np.linalg.det(np.cov(places[:, :2].T))
    return max(float(on_board * max(ratio, 0.0) ** 0.25), _TINY)
