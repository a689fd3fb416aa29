"""Folders of pictures, and raw dumps that are told their shape."""

import re
import struct
import zlib

import cv2
import numpy as np
import pytest
import tifffile

from glint_aoa.errors import RecordingError, SetupError
from glint_aoa.records.formats import open_fields

LEVELS = np.random.default_rng(8).integers(0, 256, (12, 6, 9), np.uint8)
WORDS = LEVELS.astype(np.uint16) * 257


def read_all(path):
    stack = open_fields(path)
    return stack.read(0, len(stack))


def write_pictures(folder, levels, names=None, suffix=".png"):
    folder.mkdir(exist_ok=True)
    names = names or [f"shot_{number}" for number in range(len(levels))]
    for name, picture in zip(names, levels, strict=True):
        path = folder / f"{name}{suffix}"
        if suffix == ".png":
            cv2.imwrite(str(path), picture)
        else:
            tifffile.imwrite(path, picture, photometric="minisblack")
    return folder


def assert_refused(path, message, error=RecordingError):
    with pytest.raises(error, match="^" + re.escape(message)):
        read_all(path)


# Pictures


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("levels", [LEVELS, WORDS], ids=["8 bits", "16 bits"])
def test_pictures_come_in_the_order_of_their_numbers(tmp_path, suffix, levels):
    """Number 10 after 9, not after 1; other files do not matter."""
    folder = write_pictures(tmp_path / "run", levels, suffix=suffix)
    (folder / "notes.txt").write_text("words")
    (folder / f"._shot_3{suffix}").write_bytes(b"of another system")
    stack = open_fields(folder)
    assert (stack.name, stack.dtype, stack.notes) == ("run", levels.dtype, ())
    np.testing.assert_array_equal(np.concatenate([b for _, b in stack.blocks(5)]), levels)


def test_what_else_a_picture_holds_has_no_say(tmp_path):
    """A gamma, and a level that is to be transparent."""
    folder = write_pictures(tmp_path / "run", LEVELS[:2])
    path = folder / "shot_1.png"
    content = path.read_bytes()
    extra = b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in ((b"gAMA", struct.pack(">I", 45455)), (b"tRNS", b"\0\x80"))
    )
    path.write_bytes(content[:33] + extra + content[33:])
    np.testing.assert_array_equal(read_all(folder), LEVELS[:2])


def test_a_picture_in_colour_becomes_luma_or_a_channel(tmp_path):
    colour = np.random.default_rng(4).integers(0, 65536, (3, 6, 9, 3), np.uint16)
    folder = write_pictures(tmp_path / "run", colour[..., ::-1])  # OpenCV has blue first
    luma = np.rint(colour @ np.array([0.299, 0.587, 0.114], np.float32))
    np.testing.assert_array_equal(read_all(folder), luma)
    (tmp_path / "run.toml").write_text('channel = "green"')
    np.testing.assert_array_equal(read_all(folder), colour[..., 1])


def test_numbers_that_are_missing_show(tmp_path):
    numbers = [20, 30, 40, 70, 80]
    folder = write_pictures(tmp_path / "run", LEVELS[:5], [f"a1_{n:04}" for n in numbers])
    stack = open_fields(folder)
    assert stack.times_s is None
    assert stack.notes == ("2 numbers are missing in the names, the first before a1_0070.png",)
    (tmp_path / "run.toml").write_text('rate = "50 Hz"')
    stack = open_fields(folder)
    np.testing.assert_allclose(stack.times_s, np.array([0, 1, 2, 5, 6]) / 50)
    assert stack.info.rate_hz == 50.0


def test_what_is_told_of_pictures(tmp_path):
    folder = write_pictures(tmp_path / "run", WORDS)
    (tmp_path / "run.toml").write_text(
        'rate = "60 Hz"\nexposure = "1 ms"\nfirst_line = 98\nfirst_parity = "odd"\n'
        'interlaced = true\nwhite_level = 4095\ntrigger_time = "2024-05-31T14:02:11"'
    )
    stack = open_fields(folder)
    info = stack.info
    assert (info.rate_hz, info.exposure_s, info.first_line) == (60.0, 1e-3, 98)
    assert (info.first_parity, info.interlaced) == ("odd", True)
    assert (info.trigger_time, stack.white_level) == ("2024-05-31T14:02:11", 4095)


def test_a_folder_without_pictures_or_with_both_kinds_is_refused(tmp_path):
    said = "a folder, expected PNG or TIFF pictures in it, all of one kind, found "
    assert_refused(tmp_path, f"{tmp_path}: {said}none; ")
    folder = write_pictures(tmp_path / "run", LEVELS)
    write_pictures(folder, LEVELS[:2], suffix=".tif")
    assert_refused(folder, f"{folder}: {said}12 PNG and 2 TIFF; ")


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_a_picture_unlike_the_first_is_named(tmp_path, suffix):
    folder = write_pictures(tmp_path / "run", [*LEVELS, LEVELS[0, :, :5]], suffix=suffix)
    assert_refused(folder, f"{folder / f'shot_12{suffix}'}: ")


def png_of(lines, columns, bits, colour, content):
    def chunk(name, body):
        check = struct.pack(">I", zlib.crc32(name + body))
        return struct.pack(">I", len(body)) + name + body + check

    head = struct.pack(">IIBBBBB", columns, lines, bits, colour, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", content) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"no picture", "ends after 10 bytes; copy or save it again"),
        (b"no picture at all, however long it may be", "no PNG file; copy or save it again"),
        (
            png_of(4, 4, 4, 0, zlib.compress(bytes(12))),
            "PNG of 4 bits, colour type 0, expected grey or RGB of 8 or 16 bits; ",
        ),
        (
            png_of(10_000, 10_000, 8, 0, zlib.compress(bytes(100))),
            "promises 10000 x 10000 pixels in 69 bytes, more than can be packed in it; ",
        ),
        (png_of(6, 9, 8, 0, b"damaged pixels" * 9), "its pixels cannot be unpacked; "),
        (
            png_of(6, 9, 8, 0, bytes(40)).replace(b"\0\0\0\x28IDAT", b"\xff\0\0\x28IDAT"),
            "its part at byte 33 does not end within the file's 97 bytes or is out of order; ",
        ),
        (
            png_of(6, 9, 8, 0, bytes(40)).replace(b"\0\0\0\x0dIHDR", b"\0\0\0\x00IHDR"),
            "its part at byte 8 does not end within the file's 97 bytes or is out of order; ",
        ),
    ],
    ids=["short", "no PNG", "4 bits", "bomb", "damaged", "long part", "short header"],
)
def test_a_picture_that_is_damaged_is_named(tmp_path, content, message):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "a.png").write_bytes(content)
    assert_refused(folder, f"{folder / 'a.png'}: {message}")


def test_a_picture_larger_than_any_is_not_read(tmp_path):
    folder = write_pictures(tmp_path / "run", LEVELS[:1])
    path = folder / "shot_0.png"
    with path.open("r+b") as file:
        file.truncate(1 << 30)
    assert_refused(folder, f"{path}: 1073741824 bytes, more than any field takes; ")


# Raw dumps


@pytest.mark.parametrize(
    ("name", "dtype"), [("uint8", "u1"), ("uint16", "<u2"), ("uint16-be", ">u2")]
)
@pytest.mark.parametrize("offset", [0, 100])
def test_a_raw_dump_is_told_its_shape(tmp_path, name, dtype, offset):
    path = tmp_path / "a.raw"
    levels = (WORDS if "16" in name else LEVELS).astype(dtype)
    path.write_bytes(bytes(offset) + levels.tobytes())
    (tmp_path / "a.raw.toml").write_text(
        f'shape = [12, 6, 9]\ndata_type = "{name}"\noffset = {offset}\nrate = "60 Hz"'
    )
    np.testing.assert_array_equal(read_all(path), levels)
    assert open_fields(path).info.rate_hz == 60.0


@pytest.mark.parametrize(
    ("told", "message"),
    [
        (
            None,
            "a raw dump does not say its shape; write a.raw.toml beside it with shape = [fields, "
            'lines, columns] and data_type = "uint8" or "uint16" (shape is missing)',
        ),
        ("shape = [12, 6, 9]", "a raw dump does not say its shape; "),
        (
            'shape = [12, 6, 10]\ndata_type = "uint8"',
            "has 648 bytes, but a.raw.toml promises 720 (offset 0, fields [12, 6, 10] of uint8); "
            "correct it",
        ),
        (
            'shape = [999999999999, 6, 9]\ndata_type = "uint8"',
            "has 648 bytes, but a.raw.toml promises 53999999999946 (offset 0, ",
        ),
    ],
)
def test_a_raw_dump_that_is_told_wrong_is_refused(tmp_path, told, message):
    path = tmp_path / "a.raw"
    path.write_bytes(LEVELS.tobytes())
    if told is not None:
        (tmp_path / "a.raw.toml").write_text(told)
    assert_refused(path, f"{path}: {message}")


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ('data_type = "float"', "data_type: Input should be 'uint8', 'uint16' or 'uint16-be'"),
        ('rate = "60 m"', "rate: '60 m' is not a quantity in Hz"),
        ("shape = [1, 2", "not a TOML file: "),
    ],
)
def test_what_is_told_wrong_is_named(tmp_path, told, message):
    path = tmp_path / "a.raw"
    path.write_bytes(LEVELS.tobytes())
    (tmp_path / "a.raw.toml").write_text(told)
    assert_refused(path, f"{path}.toml: {message}", SetupError)


def test_a_long_file_beside_is_not_read(tmp_path):
    path = tmp_path / "a.raw"
    path.write_bytes(LEVELS.tobytes())
    (tmp_path / "a.raw.toml").write_bytes(bytes(1 << 21))
    assert_refused(path, f"{path}.toml: 2097152 bytes, expected a few lines about a.raw; ")


def test_a_time_told_that_cannot_be_is_refused(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, LEVELS)
    (tmp_path / "a.npy.toml").write_text('trigger_time = "noon"')
    assert_refused(path, f"{path}.toml: trigger_time is 'noon'; expected a time in ISO 8601")
