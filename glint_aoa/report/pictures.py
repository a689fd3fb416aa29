"""Figures inside a page and as files: the same bytes for the same figure."""

import base64
import io
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
from matplotlib.figure import Figure

from glint_aoa.records._files import make_folder, replacing

__all__ = ["FigureFiles", "Picture", "PictureFormat", "drawing", "embedded", "picture"]

PictureFormat = Literal["png", "svg", "pdf"]

_DPI = 100  # of what is pictured inside an SVG
_FILE_DPI = 200
_COORDINATE = re.compile(rb"""(\.\d\d)\d+(?=[^"<>]*"[^"<>]*>)""")
_UNDATED: Mapping[str, Mapping[str, Any]] = {
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
    "png": {"Software": None},
}


@dataclass(frozen=True)
class FigureFiles:
    """Where figures are written as files, besides the page, and in which format."""

    folder: Path
    format: PictureFormat


@dataclass(frozen=True)
class Picture:
    """A picture on a page.

    Attributes
    ----------
    name : str
        What it shows, for its class on the page and the name of its file.
    alt : str
        What is to be seen in it, for who cannot see it.
    caption : str
        What stands below it.
    source : str
        The picture itself as a data URI.
    """

    name: str
    alt: str
    caption: str
    source: str


@contextmanager
def drawing() -> Iterator[None]:
    """Draw figures that repeat to the byte, and take names as they are: no formulas in them."""
    with mpl.rc_context({"svg.hashsalt": "glint-aoa", "text.parse_math": False}):
        yield


def picture(
    figure: Figure, name: str, *, alt: str, caption: str, files: FigureFiles | None, stem: str
) -> Picture:
    """Put a figure on a page, and into a file where files are wanted.

    Parameters
    ----------
    figure : Figure
        Drawn within `drawing`.
    name, alt, caption : str
        As for `Picture`.
    files : FigureFiles or None
        Where it is also written, replacing what is there.
    stem : str
        Name of that file.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with mpl.rc_context({"svg.fonttype": "none"}):  # letters as letters: a third of the size
        data = _COORDINATE.sub(rb"\1", _bytes(figure, "svg", _DPI))
    if files is not None:
        make_folder(files.folder)
        with replacing(files.folder / f"{stem}.{files.format}") as temporary:
            temporary.write_bytes(_bytes(figure, files.format, _FILE_DPI))
    return Picture(name, alt, caption, embedded(data, "image/svg+xml"))


def embedded(data: bytes, kind: str) -> str:
    """Return a data URI."""
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _bytes(figure: Figure, kind: PictureFormat, dpi: int) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, dpi=dpi, metadata=_UNDATED[kind])
    return buffer.getvalue()
