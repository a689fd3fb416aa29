"""Calibration boards, and finding them in a picture.

Chessboards, grids of circles and ChArUco boards are detected by OpenCV, on pixels made square.
Corners and centres are then measured on the pixels as recorded.
"""

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.camera._board import KINDS, Board
from calibration.camera._board_detection import Found, NotFound, detect
from calibration.camera._board_measure import circle_radius, measure_corners
from calibration.camera._board_order import put_in_order
from calibration.photographs import Photograph
from glint_aoa.errors import CalibrationError

__all__ = ["KINDS", "Board", "BoardImage", "find_board", "find_boards"]

Floats = NDArray[np.float64]

_LEAST = 6  # corners; a pose takes three of them


@dataclass(frozen=True, eq=False)
class BoardImage:
    """What was found of the board in one picture.

    Attributes
    ----------
    name, source : str
        The picture's, as of `calibration.photographs.Photograph`.
    corner : ndarray of int [corner]
        Which of the board's corners were found; none where the board was not.
    uv : ndarray [corner, 2]
        Where: sensor column, and line of an even field [pixels].
    radius : float
        Radius of its circles, as measured in the picture [m]; 0 for corners.
    note : str
        What was repaired, or why the board was not found and what to photograph instead.
    """

    name: str
    source: str
    corner: NDArray[np.int64]
    uv: Floats
    radius: float = 0.0
    note: str = ""

    @property
    def found(self) -> bool:
        """Whether the board was found."""
        return self.corner.size > 0


def find_boards(
    pictures: Iterable[Photograph], board: Board, *, aspect: float = 1.0
) -> Iterator[BoardImage]:
    """Find a board in each of many pictures; see `find_board`."""
    for picture in pictures:
        yield find_board(picture, board, aspect=aspect)


def find_board(picture: Photograph, board: Board, *, aspect: float = 1.0) -> BoardImage:
    """Find a board in a picture and measure its corners.

    Parameters
    ----------
    picture : Photograph
        A frame or a field.
    board : Board
        What to look for.
    aspect : float, optional
        Vertical over horizontal pixel pitch, to a tenth; 2.35 for fields of 752 x 240 pixels of
        11.7 x 27.5 um.

    Returns
    -------
    BoardImage
        Without corners where the board is not found, with the reason in `note`. Corners that
        the detector lists in another order than the board's are put right where they still make
        up the board, and left out with their image where they do not.

    Raises
    ------
    CalibrationError
        If `aspect` cannot be, or the board's dictionary is not known.

    Notes
    -----
    Corners are those of a model of the corner that is integrated over the pixels' area
    (`calibration.camera._corner_fit`); their error is some 0.005 pixel where OpenCV's
    `cornerSubPix` makes 0.02 to 0.05 on fields of 752 x 240 pixels, from aliasing. Circles are
    weighted centroids (`calibration.targets`).
    """
    if not 0.1 <= aspect <= 10:
        raise CalibrationError(
            f"pixels {aspect:g} times as high as wide cannot be; check the pixel pitch"
        )
    found = detect(picture.grey, board, aspect)
    if isinstance(found, Found) and found.corner.size >= _LEAST:
        ordered = put_in_order(found.corner, found.points, board, aspect)
        if isinstance(ordered, NotFound):
            found = ordered
        else:
            found = dataclasses.replace(found, corner=ordered.corner, note=ordered.note)
    if isinstance(found, Found) and found.corner.size >= _LEAST and not board.is_circles:
        found = measure_corners(found, picture.grey, board, aspect)
    if isinstance(found, Found) and not _spread(found, board):
        found = NotFound(
            f"only {found.corner.size} of its corners are seen, or all in one row; show more of it"
        )
    if isinstance(found, NotFound):
        nothing = np.empty(0, np.int64), np.empty((0, 2))
        return BoardImage(picture.name, picture.source, *nothing, note=found.reason)
    return BoardImage(
        picture.name,
        picture.source,
        found.corner,
        picture.on_sensor(found.points),
        radius=circle_radius(found, board) if board.is_circles else 0.0,
        note=found.note,
    )


def _spread(found: Found, board: Board) -> bool:
    """Whether there are enough corners, in two rows and two columns at least."""
    if found.corner.size < _LEAST:
        return False
    rows, columns = np.divmod(found.corner, board.shape[0])
    return min(np.unique(rows).size, np.unique(columns).size) > 1
