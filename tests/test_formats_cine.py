"""Phantom recordings: a real one held against FFmpeg's reader, and files of every packing."""

import re
import struct

import av
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mutated import complaint_about, spoil
from recordings import recording

from fuzz.cine_files import write_cine
from glint_aoa.errors import RecordingError
from glint_aoa.records.formats import open_fields
from glint_aoa.records.formats.cine import linear_of_10_bits, unpack_10_bits

RNG = np.random.default_rng(21)
BYTES = RNG.integers(0, 256, (5, 6, 8), np.uint8)
TIMES = (np.arange(5) - 2) / 1000 + 2e-4


def read_all(path):
    stack = open_fields(path)
    return stack.read(0, len(stack))


def by_ffmpeg(path):
    """Frames as FFmpeg's own reader of the format gives them."""
    with av.open(str(path)) as container:
        return np.stack([frame.to_ndarray() for frame in container.decode(video=0)])


def assert_refused(path, message):
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        read_all(path)


# The real recording


def test_the_real_recording():
    path = recording("video/small.cine")
    stack = open_fields(path)
    assert (stack.shape, stack.dtype, stack.name) == ((235, 32, 256), np.uint16, "small")
    assert (stack.info.rate_hz, stack.info.exposure_s) == (100.0, 70e-6)
    assert stack.info.trigger_time == "2026-07-24T12:05:04.825645+00:00"
    steps = np.diff(stack.times_s)
    assert stack.info.start_s == stack.times_s[0] == pytest.approx(0.010071, abs=1e-9)
    np.testing.assert_allclose(steps, 0.01, rtol=2e-6)
    assert stack.notes == (
        "companded codes of 10 bits were put on the camera's linear 12-bit scale",
        "1 images have times that cannot be, the first 234 at 2.52806e+07 s; they were counted "
        "from their neighbours",
        "1 images have another exposure than 6.99998e-05 s, the first 234 with 0.065535 s",
    )


def test_the_real_recording_is_what_ffmpeg_reads():
    path = recording("video/small.cine")
    codes = by_ffmpeg(path) >> 6  # it puts 10 bits in the upper ones of 16
    np.testing.assert_array_equal(read_all(path), linear_of_10_bits()[codes])


# Pixels


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_unpacked_images_stand_upright(tmp_path, dtype):
    levels = BYTES.astype(dtype) * (1 if dtype is np.uint8 else 200)
    path = write_cine(tmp_path / "a.cine", levels)
    np.testing.assert_array_equal(read_all(path), levels)
    np.testing.assert_array_equal(by_ffmpeg(path), levels)
    assert open_fields(path).white_level == np.iinfo(dtype).max


@pytest.mark.parametrize(("real_bits", "white", "level"), [(12, 0, 4095), (14, 16064, 16064)])
def test_the_scale_ends_where_the_camera_says(tmp_path, real_bits, white, level):
    levels = BYTES.astype(np.uint16)
    path = write_cine(tmp_path / "a.cine", levels, real_bits=real_bits, white=white)
    assert open_fields(path).white_level == level
    np.testing.assert_array_equal(read_all(path), levels)


@settings(max_examples=25)
@given(seed=st.integers(0, 1000))
def test_twelve_bits_packed(tmp_path_factory, seed):
    path = tmp_path_factory.mktemp("cine") / "a.cine"
    levels = np.random.default_rng(seed).integers(0, 4096, (3, 4, 6), np.uint16)
    stack = open_fields(write_cine(path, levels, packing=1024))
    np.testing.assert_array_equal(stack.read(0, 3), levels)
    np.testing.assert_array_equal(stack.read(2, 3), levels[2:])
    assert stack.white_level == 4095


def test_ten_bits_by_hand():
    packed = np.array([0xFF, 0xC0, 0x10, 0x0A, 0x03], np.uint8)
    # 1111111111 0000000001 0000000010 1000000011
    assert unpack_10_bits(packed).tolist() == [0x3FF, 0x001, 0x002, 0x203]


def test_ten_bits_packed_become_linear(tmp_path):
    codes = RNG.integers(0, 1024, (4, 6, 8), np.uint16)
    path = write_cine(tmp_path / "a.cine", codes, packing=256)
    np.testing.assert_array_equal(read_all(path), linear_of_10_bits()[codes])
    np.testing.assert_array_equal(by_ffmpeg(path) >> 6, codes)
    stack = open_fields(path)
    assert stack.white_level == 4095
    assert stack.notes[0].startswith("companded codes of 10 bits")


def test_the_linear_scale_is_that_of_the_maker_s_table():
    """At codes of which several programs give the same level."""
    level = linear_of_10_bits().astype(int)
    known = {1: 5, 64: 64, 144: 139, 256: 290, 512: 998, 768: 2267, 896: 3130, 1014: 4064}
    assert max(abs(level[code] - value) for code, value in known.items()) <= 1
    assert level[0] <= 4
    assert (level[1015:] == 4095).all()
    assert (np.diff(level) >= 0).all()
    assert np.abs(np.diff(level, 2)[:1010]).max() <= 2


def test_white_of_ten_bits_is_put_on_the_linear_scale_too(tmp_path):
    codes = np.full((2, 4, 8), 900, np.uint16)
    stack = open_fields(write_cine(tmp_path / "a.cine", codes, packing=256, white=960))
    assert stack.white_level == linear_of_10_bits()[960]


def test_annotations_are_skipped(tmp_path):
    path = write_cine(tmp_path / "a.cine", BYTES, annotation=b"some words of the camera")
    np.testing.assert_array_equal(read_all(path), BYTES)


def test_padded_rows(tmp_path):
    levels = BYTES[:, :, :6]
    path = write_cine(tmp_path / "a.cine", levels, row_bytes=8)
    np.testing.assert_array_equal(read_all(path), levels)


def test_a_flip_for_the_eye_is_not_done_but_said(tmp_path):
    path = write_cine(tmp_path / "a.cine", BYTES, flips=(0, 1))
    np.testing.assert_array_equal(read_all(path), BYTES)
    assert open_fields(path).notes == (
        "the camera's software shows it flipped; here it is as the sensor saw it",
    )


# Times


def test_times_count_from_the_trigger(tmp_path):
    path = write_cine(tmp_path / "a.cine", BYTES, times=TIMES, exposures=[7e-5] * 5)
    stack = open_fields(path)
    np.testing.assert_allclose(stack.times_s, TIMES, rtol=0, atol=1e-9)
    assert stack.info.start_s == stack.times_s[0]
    assert (stack.info.rate_hz, stack.info.exposure_s) == (1000.0, 7e-5)
    assert stack.info.trigger_time == "2023-11-14T22:13:20+00:00"
    assert stack.notes == ()


def test_without_times_the_images_are_counted(tmp_path):
    stack = open_fields(write_cine(tmp_path / "a.cine", BYTES))
    assert stack.times_s is None
    assert stack.info.start_s == -0.002


def test_a_time_that_cannot_be_is_counted_from_its_neighbours(tmp_path):
    times = TIMES.copy()
    times[3] = 1e6
    stack = open_fields(write_cine(tmp_path / "a.cine", BYTES, times=times))
    np.testing.assert_allclose(stack.times_s, TIMES, rtol=0, atol=1e-9)
    assert stack.notes == (
        "1 images have times that cannot be, the first 3 at 1e+06 s; they were counted from their "
        "neighbours",
    )


def test_missing_images_show_in_the_times(tmp_path):
    times = TIMES + np.array([0, 0, 0, 2e-3, 2e-3])
    stack = open_fields(write_cine(tmp_path / "a.cine", BYTES, times=times))
    np.testing.assert_allclose(stack.times_s, times, rtol=0, atol=1e-9)


def test_unequal_exposures_are_said(tmp_path):
    exposures = [2**-14, 2**-14, 2**-13, 2**-14, 2**-14]
    stack = open_fields(write_cine(tmp_path / "a.cine", BYTES, exposures=exposures))
    assert stack.notes == (
        "1 images have another exposure than 6.10352e-05 s, the first 2 with 0.00012207 s",
    )


def test_an_old_setup_without_nanoseconds(tmp_path):
    path = write_cine(tmp_path / "a.cine", BYTES, length=900)
    assert open_fields(path).info.exposure_s == pytest.approx(7e-5)


# What cannot be


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"compression": 1}, "its images are JPEG of 8 bits, expected grey of 8 or 16"),
        ({"compression": 2, "cfa": 3}, "its images are a colour mosaic of 8 bits"),
        ({"cfa": 3}, "its images are colour of 8 bits"),
        ({"row_bytes": 20}, "image 0 at byte 5876 cannot be read: it has 120 bytes, expected 48"),
        ({"rate": 0, "times": None, "first": 0}, None),
    ],
)
def test_what_is_no_grey_recording_is_refused(tmp_path, how, message):
    path = write_cine(tmp_path / "a.cine", BYTES, **how)
    if message is None:
        assert open_fields(path).info.rate_hz is None
    else:
        assert_refused(path, message)


def test_ten_bits_that_end_within_a_byte_are_refused(tmp_path):
    path = write_cine(tmp_path / "a.cine", np.zeros((2, 4, 8), np.uint16), packing=256)
    content = bytearray(path.read_bytes())
    content[48:52] = struct.pack("<i", 7)
    path.write_bytes(content)
    assert_refused(path, "7 columns in packing 256 are not known here; save it again unpacked")


@pytest.mark.parametrize(
    ("place", "kind", "value", "message"),
    [
        (0, "<2s", b"XX", "begins with b'XX', expected 'CI'; it is no Phantom recording"),
        (20, "<I", 0, "holds no images; check that it was saved"),
        (20, "<I", 2**31, "the offsets of the images should lie at bytes 5836 to "),
        (28, "<I", 2**31, "the setup should lie at bytes 2147483648 to 2147483792, but the file"),
        (48, "<i", 2**30, "image 0 at byte 5876 cannot be read: it has 48 bytes, expected 644245"),
        (84 + 140, "<2s", b"XX", "the setup at byte 84 has no mark 'ST'; the file is damaged"),
        (5836, "<q", 2**60, "image 0 at byte 1152921504606846976 cannot be read: "),
        (5836, "<q", -8, "image 0 at byte -8 cannot be read: "),
    ],
)
def test_a_header_that_lies_is_refused(tmp_path, place, kind, value, message):
    path = write_cine(tmp_path / "a.cine", BYTES)
    content = bytearray(path.read_bytes())
    assert struct.unpack_from("<q", content, 5836)[0] == 5876
    struct.pack_into(kind, content, place, value)
    path.write_bytes(content)
    assert_refused(path, message)


def test_a_recording_cut_short_is_refused(tmp_path):
    path = write_cine(tmp_path / "a.cine", BYTES, times=TIMES)
    content = path.read_bytes()
    for length in range(1, len(content), 331):
        path.write_bytes(content[:length])
        with pytest.raises(RecordingError, match=r"cut short or damaged"):
            read_all(path)


@settings(max_examples=80)
@given(data=st.data())
def test_mutated_files_give_fields_or_our_own_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("fuzz") / "a.cine"
    write_cine(path, BYTES, times=TIMES, exposures=[7e-5] * 5, length=900)
    spoil(path, data, most=6)
    complaint = complaint_about(path)
    assert complaint is None or str(path) in complaint
