"""Pictures of a calibration board: image files and recordings, as frames or as single fields."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import CalibrationError, RecordingError
from glint_aoa.records._files import size_of
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.formats import SUFFIXES, open_fields
from glint_aoa.setup import Fields

__all__ = ["SCANS", "Photograph", "Scan", "photographs"]

Scan = Literal["progressive", "interlaced", "even", "odd"]
SCANS: tuple[Scan, ...] = get_args(Scan)
"""How an image was scanned: whole, as two fields in one frame, or as a single field."""

_IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff")
_PARITY_NAMES = ("even field", "odd field")
_LEAST_SIDE = 32  # pixels


@dataclass(frozen=True, eq=False)
class Photograph:
    """One frame or field in which a board may be seen.

    Attributes
    ----------
    name : str
        What to call it in reports.
    source : str
        The file; photographs of one source are not independent of each other.
    grey : ndarray [line, column]
        Grey levels, float32.
    parity : int
        0 for a frame or an even field, 1 for an odd one.
    first_line, first_column : int
        Sensor line and column of the first pixel.
    """

    name: str
    source: str
    grey: NDArray[np.float32]
    parity: int = 0
    first_line: int = 0
    first_column: int = 0

    def on_sensor(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn columns and rows of the picture [point, 2] into sensor columns and field lines."""
        origin = np.array([self.first_column, self.first_line + 0.5 * self.parity])
        placed: NDArray[np.float64] = points + origin
        return placed


def photographs(
    paths: Sequence[Path],
    *,
    scan: Scan = "progressive",
    every: int | None = None,
    fields: Fields | None = None,
    sensor: tuple[int, int] | None = None,
) -> Iterator[Photograph]:
    """Read pictures of a board, file by file.

    Parameters
    ----------
    paths : sequence of Path
        Image files (PNG, JPEG, BMP, PGM, TIFF of one page), or recordings that
        `glint_aoa.records.formats.open_fields` reads.
    scan : {"progressive", "interlaced", "even", "odd"}, optional
        How image files were scanned: frames; full frames of two fields, the even field in lines
        0, 2, 4 ... ; or single fields of that parity. It also holds for recordings that do not
        say whether they are interlaced.
    every : int, optional
        Take every so many fields of a recording, of a board that is moved, as a picture of its
        own. By default a recording shows a board at rest: its even and its odd fields are averaged.
    fields : Fields, optional
        What recordings and windows do not say themselves.
    sensor : tuple of int, optional
        Columns and lines per field of the sensor. A picture of that size is of the whole sensor;
        a smaller one begins at `first_column`, `first_line` of `fields`.

    Yields
    ------
    Photograph
        All of one size.

    Raises
    ------
    RecordingError
        If a file is missing, damaged, or of a kind that is not known.
    CalibrationError
        If pictures differ in size or do not fit the sensor, or two files are the same.
    """
    if scan not in SCANS:
        raise CalibrationError(f'scan is "{scan}"; give one of {", ".join(SCANS)}')
    if every is not None and every < 1:
        raise CalibrationError(f"every is {every}; give 1 to take each field, or more")
    _refuse_twins(paths)
    first: Photograph | None = None
    for path in paths:
        for each in _of_file(Path(path), scan, every, fields or Fields()):
            placed = _placed(each, sensor, fields or Fields())
            first = first or placed
            _check_size(placed, first)
            yield placed


def _refuse_twins(paths: Iterable[Path]) -> None:
    """Refuse a file that is given twice, or a copy of one: it would count as two witnesses."""
    seen: dict[str, Path] = {}
    for path in paths:
        size_of(Path(path))
        with Path(path).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        other = seen.setdefault(digest, path)
        if other is not path:
            raise CalibrationError(
                f"{path} holds the same as {other}; give each picture of the board once"
            )


def _of_file(path: Path, scan: Scan, every: int | None, fields: Fields) -> Iterator[Photograph]:
    suffix = path.suffix.lower()
    if suffix not in _IMAGES + SUFFIXES:
        raise RecordingError(
            f"{path}: not an image or recording that can be read here; expected one of "
            f"{', '.join(dict.fromkeys(_IMAGES + SUFFIXES))}"
        )
    image = _image(path) if suffix in _IMAGES else None
    if image is None:
        yield from _of_recording(path, open_fields(path, fields), scan, every, fields)
    elif scan == "interlaced":
        if len(image) % 2:
            raise CalibrationError(
                f"{path}: {len(image)} lines cannot be two fields; give frames as they were "
                'captured, not cut or scaled, or another scan than "interlaced"'
            )
        for parity in (0, 1):
            yield Photograph(
                f"{path.name} ({_PARITY_NAMES[parity]})", str(path), image[parity::2], parity
            )
    else:
        yield Photograph(path.name, str(path), image, int(scan == "odd"))


def _image(path: Path) -> NDArray[np.float32] | None:
    """Read an image as grey levels; None for a TIFF of more pages than one."""
    size_of(path)
    data = np.fromfile(path, np.uint8)
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    if path.suffix.lower() in {".tif", ".tiff"} and cv2.imcount(str(path)) > 1:
        return None
    image = cv2.imdecode(data, flags)
    if image is None:
        raise RecordingError(f"{path}: not an image that can be read; export it again as PNG")
    return np.asarray(image, np.float32)


def _of_recording(
    path: Path, stack: FieldStack, scan: Scan, every: int | None, fields: Fields
) -> Iterator[Photograph]:
    info = stack.info
    interlaced = _first(info.interlaced, fields.interlaced)
    start = _first(info.first_parity, fields.first_parity)
    if interlaced is None:
        interlaced = scan == "interlaced" or start is not None
    parity = (np.arange(stack.n_fields) + (start == "odd")) % 2 * int(interlaced)
    if scan in {"even", "odd"}:
        parity[:] = int(scan == "odd")
    where = {
        "first_line": _first(info.first_line, fields.first_line) or 0,
        "first_column": _first(info.first_column, fields.first_column) or 0,
    }
    if every is not None:
        for number in range(0, stack.n_fields, every):
            grey = stack.read(number, number + 1)[0].astype(np.float32)
            name = f"{path.name} (field {number})"
            yield Photograph(name, name, grey, int(parity[number]), **where)
        return
    for value in np.unique(parity):
        which = _PARITY_NAMES[value] if interlaced else "frame"
        name = f"{path.name} (mean {which})"
        yield Photograph(name, str(path), _mean(stack, parity == value), int(value), **where)


def _mean(stack: FieldStack, chosen: NDArray[np.bool_]) -> NDArray[np.float32]:
    total = np.zeros(stack.shape[1:])
    for start, block in stack.blocks():
        total += block[chosen[start : start + len(block)]].sum(axis=0, dtype=np.float64)
    return np.asarray(total / chosen.sum(), np.float32)


def _first(*values: Any) -> Any:
    return next((value for value in values if value is not None), None)


def _placed(one: Photograph, sensor: tuple[int, int] | None, fields: Fields) -> Photograph:
    lines, columns = one.grey.shape
    if min(lines, columns) < _LEAST_SIDE:
        raise CalibrationError(
            f"{one.name}: {columns} x {lines} pixels are too few; "
            f"give pictures of {_LEAST_SIDE} x {_LEAST_SIDE} pixels or more"
        )
    if sensor is None:
        return one
    whole = (columns, lines) == sensor
    said = one.first_line or one.first_column
    if not whole and not said:
        one = Photograph(
            one.name,
            one.source,
            one.grey,
            one.parity,
            fields.first_line or 0,
            fields.first_column or 0,
        )
    if one.first_column + columns > sensor[0] or one.first_line + lines > sensor[1]:
        raise CalibrationError(
            f"{one.name}: {columns} x {lines} pixels from column {one.first_column}, line "
            f"{one.first_line} do not fit a sensor of {sensor[0]} x {sensor[1]}; "
            f"{_size_advice(columns, lines, sensor)}"
        )
    return one


def _size_advice(columns: int, lines: int, sensor: tuple[int, int]) -> str:
    if (columns, lines) == (sensor[0], 2 * sensor[1]):
        return "these are frames of two fields: give --scan interlaced"
    return "give pictures as the camera captured them, not scaled, or correct camera.sensor"


def _check_size(one: Photograph, first: Photograph) -> None:
    if one.grey.shape != first.grey.shape:
        sizes = [f"{each.grey.shape[1]} x {each.grey.shape[0]}" for each in (one, first)]
        raise CalibrationError(
            f"{one.name} has {sizes[0]} pixels, {first.name} {sizes[1]}; give pictures of one "
            "camera in one mode, as it captured them"
        )
