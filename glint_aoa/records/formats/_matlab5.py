"""The frame of MATLAB 5 files, checked before SciPy reads them: it trusts what a tag says.

A file is a header of 128 bytes and a row of elements, each a type, a size and so many bytes.
Compressed elements hold another, matrices a row of them (MathWorks, "MAT-File Format", R2024b).
"""

import struct
import zlib
from pathlib import Path

__all__ = ["MAX_UNPACKED_BYTES", "check_frame"]

MAX_UNPACKED_BYTES = 1 << 29
"""Most that a compressed variable may take: more than an hour of 28 channels at 800 samples/s."""

_HEADER = 128
_MATRIX, _PACKED = 14, 15
_UINT32, _TEXT, _NUMBERS, _COMPLEX = 6, 4, range(6, 16), 0x0800
_HEAD = [5, 1]  # after the class: int32 dimensions, int8 name
_KNOWN = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, _MATRIX, 16, 17, 18}
_DEEPEST = 16
_CHUNK = 1 << 20


def check_frame(path: Path) -> None:
    """Walk all elements of a file; files of MATLAB 4 have none and are let through.

    Raises
    ------
    ValueError
        If an element is of no known type, leaves what it is in, or unpacks to too much.
    """
    left = path.stat().st_size - _HEADER
    with path.open("rb") as file:
        head = file.read(_HEADER)
        if len(head) < _HEADER or 0 in head[:4]:
            return
        order = "<" if head[126:128] == b"IM" else ">"
        while tag := file.read(8):
            kind, size = _tag(order, tag)
            left -= 8 + size
            if left < 0:
                raise ValueError(f"an element of {size} bytes ends outside the file")
            content = file.read(size)
            if kind == _PACKED:
                content = _unpacked(content)
                kind, size = _tag(order, content[:8])
                content = content[8:]
            if kind == _MATRIX:
                _check_inside(order, content[:size], depth=1)
            elif kind not in _KNOWN:
                raise ValueError(f"an element of unknown type {kind}")


def _tag(order: str, tag: bytes) -> tuple[int, int]:
    if len(tag) < 8:
        raise ValueError("an element is cut off within its tag")
    kind, size = struct.unpack(order + "II", tag)
    return kind, size


def _unpacked(content: bytes) -> bytes:
    unpack = zlib.decompressobj()
    parts = []
    for start in range(0, len(content), _CHUNK):
        parts.append(unpack.decompress(content[start : start + _CHUNK], MAX_UNPACKED_BYTES))
        if sum(map(len, parts)) >= MAX_UNPACKED_BYTES or unpack.unconsumed_tail:
            raise ValueError(f"a variable unpacks to more than {MAX_UNPACKED_BYTES >> 20} MiB")
    return b"".join(parts)


def _check_inside(order: str, content: bytes, *, depth: int) -> None:
    """Check the elements of a matrix; nested ones are those of cells and structures."""
    if depth > _DEEPEST:
        raise ValueError(f"variables nested more than {_DEEPEST} deep")
    if not content:  # how an empty field of a structure is stored
        return
    kinds, place = [], 0
    while place < len(content):
        kind, size, start, place = _element(order, content, place)
        kinds.append(kind)
        if len(kinds) == 1:
            _check_flags(kind, size)
        if kind == _MATRIX:
            _check_inside(order, content[start : start + size], depth=depth + 1)
    (flags,) = struct.unpack_from(order + "I", content, 8)
    own, is_complex = flags & 0xFF, bool(flags & _COMPLEX)
    is_plain = own == _TEXT or own in _NUMBERS
    if kinds[1:3] != _HEAD or (is_plain and len(kinds) != 4 + is_complex):
        raise ValueError(f"a variable of class {own} whose parts do not fit it")


def _element(order: str, content: bytes, place: int) -> tuple[int, int, int, int]:
    """Return an element's type and size, where its bytes are, and where the next one begins."""
    kind, size = _tag(order, content[place : place + 8])
    if kind >> 16:  # a small one holds its bytes within the tag
        kind, size, start, after = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        if size > 4:
            raise ValueError(f"a small element of {size} bytes")
    else:
        start = place + 8
        after = start + size + -size % 8
    if kind not in _KNOWN:
        raise ValueError(f"an element of unknown type {kind}")
    if start + size > len(content):
        raise ValueError(f"an element of {size} bytes ends outside its variable")
    return kind, size, start, after


def _check_flags(kind: int, size: int) -> None:
    if (kind, size) != (_UINT32, 8):
        raise ValueError("a variable that does not begin with its class")
