"""A flat calibration board: what is printed on it, and where."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import CalibrationError
from glint_aoa.units import parse_quantity

Floats = NDArray[np.float64]

Kind = Literal["chessboard", "circles", "asymmetric-circles", "charuco"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""Kinds of board."""

_EXAMPLES = {
    "chessboard": "chessboard:9x6:30mm",
    "circles": "circles:7x6:36mm",
    "asymmetric-circles": "asymmetric-circles:4x11:20mm",
    "charuco": "charuco:11x8:30mm:22mm:5x5_250",
}

_MOST = 100  # corners or circles along a side


@dataclass(frozen=True)
class Board:
    """A flat calibration board.

    Attributes
    ----------
    kind : {"chessboard", "circles", "asymmetric-circles", "charuco"}
        What is printed on it.
    columns, rows : int
        Inner corners of a chessboard, circles of a grid, squares of a ChArUco board. For the
        asymmetric grid: circles in a row, and rows.
    spacing : float
        Side of a square, or distance between neighbouring circles of a row and of a column. For
        the asymmetric grid: distance between rows, half that of circles in a row [m].
    marker : float, optional
        Side of a ChArUco board's markers [m].
    dictionary : str, optional
        Their dictionary, as OpenCV names it without ``DICT_``.
    """

    kind: Kind
    columns: int
    rows: int
    spacing: float
    marker: float | None = None
    dictionary: str | None = None

    def __post_init__(self) -> None:
        """Refuse a board that cannot be."""
        if min(self.shape) < (2 if self.is_circles else 3):
            raise CalibrationError(
                f"a board of {self.shape[0]} x {self.shape[1]} corners or circles is too small; "
                "use one of 3 x 3 at least, better 9 x 6"
            )
        if max(self.shape) > _MOST:
            raise CalibrationError(
                f"a board of {self.shape[0]} x {self.shape[1]} corners or circles is too fine to "
                f"be seen; use one of {_MOST} x {_MOST} at most, better 9 x 6"
            )
        if not 0 < self.spacing < np.inf:
            raise CalibrationError(
                f"a board's spacing of {self.spacing:g} m cannot be; it must be greater than zero"
            )
        if self.kind == "charuco" and not 0 < (self.marker or 0) < self.spacing:
            raise CalibrationError(
                f"a ChArUco board's markers of {self.marker} m must be smaller than its squares "
                f"of {self.spacing:g} m"
            )

    @classmethod
    def parse(cls, text: str) -> "Board":
        """Read a board's description, such as ``chessboard:9x6:30mm``.

        Parameters
        ----------
        text : str
            Kind, columns x rows, spacing with its unit; for ChArUco also the markers' side and
            dictionary (``charuco:11x8:30mm:22mm:5x5_250``).

        Raises
        ------
        CalibrationError
            If it cannot be read; the message gives an example.
        """
        kind, *parts = (part.strip() for part in text.split(":"))
        if kind not in KINDS:
            raise CalibrationError(
                f'board "{text}": "{kind}" is not a kind of board; give one such as '
                f"{', '.join(_EXAMPLES.values())}"
            )
        if len(parts) != _EXAMPLES[kind].count(":"):
            raise _unreadable(text, kind, "it has not as many parts as")
        counts = parts[0].lower().replace("\N{MULTIPLICATION SIGN}", "x").split("x")
        if len(counts) != 2 or not all(each.strip().isdecimal() for each in counts):
            raise _unreadable(text, kind, f'"{parts[0]}" is not columns x rows;')
        try:
            lengths = [parse_quantity(each, "m") for each in parts[1:3]]
        except ValueError as error:
            raise _unreadable(text, kind, f"{error};") from None
        return cls(
            kind,
            int(counts[0]),
            int(counts[1]),
            lengths[0],
            marker=lengths[1] if len(lengths) > 1 else None,
            dictionary=parts[3].upper().removeprefix("DICT_") if len(parts) > 3 else None,
        )

    def __str__(self) -> str:
        """Return the description that `parse` reads."""
        parts = [self.kind, f"{self.columns}x{self.rows}", f"{1e3 * self.spacing:.9g}mm"]
        if self.kind == "charuco":
            parts += [f"{1e3 * (self.marker or 0):.9g}mm", str(self.dictionary).lower()]
        return ":".join(parts)

    @property
    def shape(self) -> tuple[int, int]:
        """Columns and rows of corners or circles."""
        less = 1 if self.kind == "charuco" else 0
        return self.columns - less, self.rows - less

    @property
    def places(self) -> Floats:
        """Where the corners or centres lie, row by row, as [corner, 3] with z = 0 [m]."""
        columns, rows = self.shape
        j, i = (axis.ravel().astype(np.float64) for axis in np.mgrid[:rows, :columns])
        if self.kind == "asymmetric-circles":
            i = 2 * i + j % 2
        return self.spacing * np.column_stack([i, j, np.zeros(i.size)])

    @property
    def is_circles(self) -> bool:
        """Whether its points are centres of circles."""
        return self.kind in {"circles", "asymmetric-circles"}


def _unreadable(text: str, kind: Kind, what: str) -> CalibrationError:
    return CalibrationError(f'board "{text}": {what} {_EXAMPLES[kind]}')
