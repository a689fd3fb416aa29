"""Spoiling a file: cut short, flipped bits, numbers that lie, pieces moved about."""

import struct
from collections.abc import Callable

import numpy as np

__all__ = ["spoilt"]

_HEADER = 512  # bytes in which most of what matters stands
_LIES = (
    0, 1, 2, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1,
    2**64 - 1,
)  # fmt: skip
_WORDS = (
    b"nan", b"inf", b"-1", b"1e400", b"99999999999999", b"1099511627776", b"", b"\0", b"../../x",
    b"O8", b"object", b"\xff\xfe", b"</", b"&e;", b",", b"\n",
)  # fmt: skip


def spoilt(content: bytes, rng: np.random.Generator) -> bytes:
    """Spoil a file's content in one to four ways.

    Parameters
    ----------
    content : bytes
        What a whole file holds.
    rng : Generator
        Chooses what happens, and where.
    """
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 5))):
        _WAYS[int(rng.integers(len(_WAYS)))](data, rng)
    return bytes(data)


def _place(data: bytearray, rng: np.random.Generator) -> int:
    """Choose a place; every other time in the header."""
    end = min(len(data), _HEADER) if rng.random() < 0.5 else len(data)
    return int(rng.integers(max(end, 1)))


def _cut(data: bytearray, rng: np.random.Generator) -> None:
    del data[_place(data, rng) :]


def _flip(data: bytearray, rng: np.random.Generator) -> None:
    for _ in range(int(rng.integers(1, 9))):
        if data:
            data[_place(data, rng)] ^= 1 << int(rng.integers(8))


def _byte(data: bytearray, rng: np.random.Generator) -> None:
    if data:
        data[_place(data, rng)] = int(rng.choice([0, 1, 127, 128, 255, rng.integers(256)]))


def _lie(data: bytearray, rng: np.random.Generator) -> None:
    size = int(rng.choice([2, 4, 8]))
    value = int(_LIES[int(rng.integers(len(_LIES)))]) % 2 ** (8 * size)
    number = struct.pack(("<", ">")[int(rng.integers(2))] + {2: "H", 4: "I", 8: "Q"}[size], value)
    place = _place(data, rng)
    data[place : place + size] = number


def _word(data: bytearray, rng: np.random.Generator) -> None:
    place = _place(data, rng)
    data[place : place + int(rng.integers(9))] = _WORDS[int(rng.integers(len(_WORDS)))]


def _remove(data: bytearray, rng: np.random.Generator) -> None:
    place = _place(data, rng)
    del data[place : place + int(rng.integers(1, 33))]


def _repeat(data: bytearray, rng: np.random.Generator) -> None:
    start, place = _place(data, rng), _place(data, rng)
    data[place:place] = data[start : start + int(rng.integers(1, 65))]


def _blank(data: bytearray, rng: np.random.Generator) -> None:
    place, size = _place(data, rng), int(rng.integers(1, 65))
    data[place : place + size] = bytes([int(rng.choice([0, 255]))]) * len(
        data[place : place + size]
    )


_WAYS: tuple[Callable[[bytearray, np.random.Generator], None], ...] = (
    _cut, _flip, _byte, _lie, _lie, _word, _remove, _repeat, _blank,
)  # fmt: skip
