"""Phantom recordings written from the published layout, independently of the reader."""

import struct
from fractions import Fraction

import numpy as np

SETUP_LENGTH = 5740
"""Of SETUP up to its white level, as software 671 of May 2009 wrote it."""


def packed_bits(levels, bits):
    """Pack through the binary digits of all pixels in a row."""
    digits = "".join(f"{level:0{bits}b}" for level in np.ravel(levels))
    return int(digits, 2).to_bytes(len(digits) // 8, "big")


def time64(seconds):
    """Pack a time as 1 / 2^32 s and whole seconds."""
    whole = int(seconds // 1)
    return struct.pack("<II", round((seconds - whole) * 2**32) & ~3, whole)


def after(trigger, seconds):
    """Add without losing the digits of a fraction of a second."""
    return Fraction(trigger) + Fraction(float(seconds))


def setup_of(keys, length=SETUP_LENGTH):
    """Make a SETUP of so many bytes with numbers at places."""
    content = bytearray(length)
    content[140:144] = b"ST" + struct.pack("<H", length)
    for place, value in keys.items():
        if place + 4 <= length:
            content[place : place + 4] = struct.pack("<i", value)
    return bytes(content)


def write_cine(
    path,
    levels,
    *,
    packing=0,
    first=-2,
    rate=1000,
    shutter_ns=70_000,
    trigger=1.7e9,
    times=None,
    exposures=None,
    real_bits=None,
    white=0,
    annotation=b"",
    row_bytes=None,
    length=SETUP_LENGTH,
    compression=0,
    flips=(0, 0),
    cfa=0,
):
    """Write `levels` [image, line, column]; packed ones as codes of 10 or 12 bits."""
    n, lines, columns = levels.shape
    bits = {256: 16, 1024: 16}.get(packing, 8 * levels.dtype.itemsize)
    keys = {
        756: flips[0],
        760: flips[1],
        768: rate,
        772: shutter_ns // 1000,
        808: cfa,
        896: real_bits or {256: 10, 1024: 12}.get(packing, bits),
        1568: shutter_ns,
        5736: white,
    }
    blocks = b""
    if times is not None:
        stamps = b"".join(time64(after(trigger, each)) for each in times)
        blocks += struct.pack("<IHH", 8 + len(stamps), 1002, 0) + stamps
    blocks += struct.pack("<IHH", 12, 1004, 0) + b"next"
    if exposures is not None:
        values = b"".join(struct.pack("<I", round(each * 2**32)) for each in exposures)
        blocks += struct.pack("<IHH", 8 + len(values), 1003, 0) + values
    images = [_image(each, packing, annotation, row_bytes) for each in levels]
    offsets_at = 84 + length + len(blocks)
    starts = offsets_at + 8 * n + np.cumsum([0, *map(len, images[:-1])])
    size = len(images[0]) - 8 - len(annotation)
    seconds = time64(trigger)
    header = struct.pack(
        "<2sHHHiIiIIII", b"CI", 44, compression, 1, first, n, first, n, 44, 84, offsets_at
    )
    bitmap = struct.pack("<IiiHHIIiiII", 40, columns, lines, 1, bits, packing, size, 0, 0, 0, 0)
    content = header + seconds + bitmap + setup_of(keys, length) + blocks
    path.write_bytes(content + starts.astype("<i8").tobytes() + b"".join(images))
    return path


def _image(levels, packing, annotation, row_bytes):
    if packing:
        pixels = packed_bits(levels, {256: 10, 1024: 12}[packing])
    else:  # a bitmap's lowest line comes first
        rows = [row.astype(row.dtype.newbyteorder("<")).tobytes() for row in levels[::-1]]
        pixels = b"".join(row.ljust(row_bytes or 0, b"\0") for row in rows)
    head = struct.pack("<I", 8 + len(annotation)) + annotation
    return head + struct.pack("<I", len(pixels)) + pixels
