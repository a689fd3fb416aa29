"""Video written by FFmpeg's libraries: pixels to the bit, fields in order, frames by time."""

import re
from fractions import Fraction

import av
import numpy as np
import pytest
from films import SCANS, fields_of, film, vibration, write_video

from glint_aoa.errors import RecordingError, SetupError
from glint_aoa.records.formats import open_fields
from glint_aoa.setup import Fields

LEVELS = np.random.default_rng(11).integers(0, 256, (9, 24, 32), np.uint8)
SHAKING = vibration(9.8, 3.0)


def read_all(stack):
    return stack.read(0, len(stack))


def beside(path, text):
    path.with_name(f"{path.name}.toml").write_text(text)


def assert_refused(path, message):
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        read_all(open_fields(path))


# Pixels


@pytest.mark.parametrize("suffix", [".mkv", ".avi", ".mp4"])
@pytest.mark.parametrize(("layout", "bits"), [("gray", 8), ("gray10le", 10), ("gray16le", 16)])
def test_grey_levels_come_as_they_went_in(tmp_path, suffix, layout, bits):
    levels = LEVELS if bits == 8 else LEVELS.astype(np.uint16) << (bits - 8) | 1
    stack = open_fields(write_video(tmp_path / f"a{suffix}", levels, layout=layout))
    np.testing.assert_array_equal(read_all(stack), levels)
    assert stack.dtype == levels.dtype
    assert stack.white_level == 2**bits - 1
    assert (stack.info.rate_hz, stack.info.interlaced, stack.times_s) == (30.0, False, None)
    assert stack.info.start_s is None


def test_twelve_bits_and_blocks(tmp_path):
    levels = LEVELS.astype(np.uint16) * 16 + 3
    stack = open_fields(write_video(tmp_path / "a.mkv", levels, layout="gray12le"))
    blocks = [block for _, block in stack.blocks(4)]
    assert [len(block) for block in blocks] == [4, 4, 1]
    np.testing.assert_array_equal(np.concatenate(blocks), levels)
    assert stack.white_level == 4095


@pytest.mark.parametrize(
    ("codec", "layout", "white", "range_words"),
    [
        ("ffv1", "yuv420p", 235, "limited range by convention: white is 235 of 255"),
        ("ffv1", "yuv420p10le", 940, "limited range by convention: white is 940 of 1023"),
    ],
)
def test_luma_is_taken_as_stored(tmp_path, codec, layout, white, range_words):
    rng = np.random.default_rng(2)
    top = 256 if white < 256 else 1024
    planes = rng.integers(0, top, (5, 36, 32), np.uint16).astype(np.uint8 if top == 256 else "u2")
    path = write_video(tmp_path / "a.mkv", planes, codec=codec, layout=layout)
    stack = open_fields(path)
    np.testing.assert_array_equal(read_all(stack), planes[:, :24])
    assert stack.white_level == white
    assert f"luma was taken, of {range_words}" in stack.notes


def test_packed_luma_is_taken_as_stored(tmp_path):
    pairs = np.random.default_rng(3).integers(0, 256, (4, 24, 32, 2), np.uint8)
    path = write_video(tmp_path / "a.avi", pairs, codec="rawvideo", layout="yuyv422")
    np.testing.assert_array_equal(read_all(open_fields(path)), pairs[..., 0])


def test_colour_becomes_luma_or_the_channel_that_is_told(tmp_path):
    colour = np.random.default_rng(4).integers(0, 256, (4, 24, 32, 3), np.uint8)
    path = write_video(tmp_path / "a.avi", colour, codec="rawvideo", layout="bgr24", given="rgb24")
    luma = np.rint(colour @ np.array([0.299, 0.587, 0.114]))
    np.testing.assert_array_equal(read_all(open_fields(path)), luma)
    assert open_fields(path).notes[0].startswith("colour: grey was made of it as 0.299 red + ")
    for number, name in enumerate(["red", "green", "blue"]):
        beside(path, f'channel = "{name}"')
        np.testing.assert_array_equal(read_all(open_fields(path)), colour[..., number])


def test_grey_stored_in_colour_is_grey_again(tmp_path):
    colour = np.repeat(LEVELS[..., None], 3, axis=-1)
    path = write_video(tmp_path / "a.avi", colour, codec="rawvideo", layout="bgr24", given="rgb24")
    np.testing.assert_array_equal(read_all(open_fields(path)), LEVELS)


def test_a_channel_that_is_not_stored_is_refused(tmp_path):
    path = write_video(tmp_path / "a.mkv", LEVELS)
    beside(path, 'channel = "red"')
    assert_refused(path, "its pixels are gray, of which red cannot be taken as it is stored; ")


# Fields


@pytest.mark.parametrize(("option", "scan"), [("tt", "even first"), ("bb", "odd first")])
@pytest.mark.parametrize("suffix", [".mkv", ".mp4"])
def test_fields_come_in_the_order_of_the_stream(tmp_path, option, scan, suffix):
    path = write_video(tmp_path / f"a{suffix}", LEVELS, field_order=option)
    stack = open_fields(path)
    np.testing.assert_array_equal(read_all(stack), fields_of(LEVELS, scan))
    assert stack.info.rate_hz == 60.0
    assert (stack.info.interlaced, stack.info.first_parity) == (True, scan.split()[0])
    assert stack.notes == (f"interlaced, {scan.split()[0]} field first, by the stream",)


@pytest.mark.parametrize("size", [1, 2, 3, 5, 18])
def test_fields_do_not_depend_on_the_blocks(tmp_path, size):
    stack = open_fields(write_video(tmp_path / "a.mkv", LEVELS, field_order="bb"))
    blocks = np.concatenate([block for _, block in stack.blocks(size)])
    np.testing.assert_array_equal(blocks, fields_of(LEVELS, "odd first"))
    for start in (17, 4, 9, 0, 9):
        np.testing.assert_array_equal(stack.read(start, start + 3), blocks[start : start + 3])


@pytest.mark.parametrize("scan", SCANS)
def test_the_order_of_a_silent_file_is_found(tmp_path, scan):
    frames = film(80, row=SHAKING, scan=scan)
    stack = open_fields(write_video(tmp_path / "a.avi", frames))
    np.testing.assert_array_equal(read_all(stack), fields_of(frames, scan))
    words = scan if scan == "progressive" else f"interlaced, {scan.split()[0]} field first"
    assert re.fullmatch(f"{words}, found from what moves, \\d+ standard deviations", stack.notes[0])


ASSUMED = "assumed: the file does not say, and too little moves to tell"


@pytest.mark.parametrize(
    ("shape", "stated", "interlaced", "note"),
    [
        ((48, 60), Fields(), False, f"progressive, {ASSUMED}"),
        ((480, 720), Fields(), True, f"interlaced, even field first, {ASSUMED}"),
        ((48, 60), Fields(interlaced=True), True, f"interlaced, even field first, {ASSUMED}"),
        ((480, 720), Fields(interlaced=False), False, "progressive, as the setup says"),
        (
            (48, 60),
            Fields(first_parity="odd"),
            True,
            "interlaced, odd field first, as the setup says",
        ),
    ],
)
def test_a_silent_picture_at_rest_is_not_guessed_at(tmp_path, shape, stated, interlaced, note):
    frames = film(20, shape=shape, row=lambda time: 20.0, noise=0)
    stack = open_fields(write_video(tmp_path / "a.avi", frames), stated)
    assert stack.info.interlaced is interlaced
    assert stack.notes == (note,)


def test_what_is_told_beside_counts_more_than_the_stream(tmp_path):
    path = write_video(tmp_path / "a.mkv", LEVELS, field_order="tt")
    beside(path, 'first_parity = "odd"\nrate = "120 Hz"\nstart = "-0.5 s"\nwhite_level = 250')
    stack = open_fields(path, Fields(first_parity="even"))
    np.testing.assert_array_equal(read_all(stack), fields_of(LEVELS, "odd first"))
    assert (stack.info.rate_hz, stack.info.start_s, stack.white_level) == (120.0, -0.5, 250)
    assert stack.notes == (
        "interlaced, odd field first, as told beside it",
        "rate_hz is 120.0 as told beside it, the file says 60.0",
    )


def test_a_wrong_key_beside_is_named(tmp_path):
    path = write_video(tmp_path / "a.mkv", LEVELS)
    beside(path, 'first_partiy = "odd"')
    message = f"{path}.toml: unknown key first_partiy; did you mean first_parity?"
    with pytest.raises(SetupError, match="^" + re.escape(message) + "$"):
        open_fields(path)


# Times


NUMBERS = [0, 1, 2, 4, 5, 8, 9, 10, 11]


@pytest.mark.parametrize(
    ("suffix", "numbers", "tick"),
    [
        (".mkv", [round(1000 * n / 30) for n in NUMBERS], Fraction(1, 1000)),
        (".mp4", NUMBERS, None),
        (".avi", NUMBERS, None),
    ],
)
def test_missing_frames_show_in_the_times(tmp_path, suffix, numbers, tick):
    stack = open_fields(write_video(tmp_path / f"a{suffix}", LEVELS, numbers=numbers, tick=tick))
    np.testing.assert_allclose(stack.times_s, np.array(NUMBERS) / 30, rtol=0, atol=1e-12)
    assert stack.info.rate_hz == 30.0
    assert "3 frames are missing by their times, the first before 3" in stack.notes
    np.testing.assert_array_equal(read_all(stack), LEVELS)


def test_fields_of_a_frame_are_half_a_frame_apart(tmp_path):
    stack = open_fields(
        write_video(tmp_path / "a.avi", LEVELS, numbers=NUMBERS), Fields(first_parity="even")
    )
    expected = np.repeat(np.array(NUMBERS) / 30, 2) + np.tile([0, 1 / 60], 9)
    np.testing.assert_allclose(stack.times_s, expected, rtol=0, atol=1e-12)


def test_uneven_times_are_taken_from_the_file(tmp_path):
    ticks = [0, 31, 70, 98, 140, 160, 205, 240, 270]
    path = write_video(tmp_path / "a.mkv", LEVELS, numbers=ticks, tick=Fraction(1, 1000))
    stack = open_fields(path)
    np.testing.assert_allclose(stack.times_s, np.array(ticks) / 1000, rtol=0, atol=1e-12)


def test_a_slowed_video_is_brought_to_the_rate_that_is_told(tmp_path):
    path = write_video(tmp_path / "a.avi", LEVELS, numbers=NUMBERS)
    beside(path, 'rate = "3000 Hz"\nstart = "2 s"')
    stack = open_fields(path)
    np.testing.assert_allclose(stack.times_s, 2 + np.array(NUMBERS) / 3000, rtol=0, atol=1e-12)


# Going back and forth


@pytest.mark.parametrize("suffix", [".mkv", ".avi", ".mp4"])
@pytest.mark.parametrize("codec", ["mpeg4", "mpeg2video"])
def test_frames_by_number_are_those_in_a_row(tmp_path, suffix, codec):
    """With frames that are predicted from later ones, in groups of five."""
    frames = film(40, row=SHAKING)
    planes = np.concatenate([frames, np.full((40, 24, 60), 128, np.uint8)], axis=1)
    path = write_video(
        tmp_path / f"a{suffix}", planes, codec=codec, layout="yuv420p", g="5", bf="2"
    )
    stack = open_fields(path)
    whole = read_all(open_fields(path))
    assert np.abs(whole.astype(int) - frames).mean() < 5
    for number in np.random.default_rng(1).permutation(40):
        np.testing.assert_array_equal(stack.read(number, number + 1)[0], whole[number])


# Damage


@pytest.mark.parametrize("suffix", [".avi", ".mkv", ".mp4"])
def test_what_is_no_video_is_refused(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"no video at all" * 40)
    kind = {".avi": "avi", ".mkv": "matroska", ".mp4": "mov"}[suffix]
    assert_refused(path, f"not a video of this kind ({kind}) or damaged (")


def test_a_list_of_other_files_is_no_video(tmp_path):
    write_video(tmp_path / "real.mkv", LEVELS)
    path = tmp_path / "a.mkv"
    path.write_text("ffconcat version 1.0\nfile real.mkv\n")
    assert_refused(path, "not a video of this kind (matroska) or damaged (")


def test_sound_alone_is_refused(tmp_path):
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), layout="mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
    assert_refused(path, "holds no pictures; give the file with the video")


def test_a_codec_that_is_not_known_is_refused(tmp_path):
    path = write_video(tmp_path / "a.avi", LEVELS)
    path.write_bytes(path.read_bytes().replace(b"FFV1", b"QQQQ"))
    assert_refused(path, "its codec is not known here; convert the video to FFV1 in Matroska ")


@pytest.mark.parametrize("suffix", [".avi", ".mkv", ".mp4"])
def test_a_video_cut_short_is_refused_or_says_so(tmp_path, suffix):
    path = write_video(tmp_path / f"a{suffix}", LEVELS)
    content = path.read_bytes()
    for length in range(60, len(content), len(content) // 25):
        path.write_bytes(content[:length])
        try:
            stack = open_fields(path)
            fields = read_all(stack)
        except RecordingError:
            continue
        np.testing.assert_array_equal(fields, LEVELS[: len(fields)])
        said = stack.notes[-1].endswith("it may have been cut short")
        assert said or len(fields) >= len(LEVELS) - 1


def test_a_frame_that_is_damaged_is_named(tmp_path):
    path = write_video(tmp_path / "a.avi", LEVELS, codec="png", layout="gray")
    content = bytearray(path.read_bytes())
    at = [match.start() for match in re.finditer(b"IDAT", content)][4]
    content[at + 20 : at + 200] = bytes(180)
    path.write_bytes(content)
    stack = open_fields(path, Fields(interlaced=False))
    np.testing.assert_array_equal(stack.read(0, 4), LEVELS[:4])
    message = f"{path}: frame 4 of 9 cannot be read: "
    with pytest.raises(RecordingError, match="^" + re.escape(message)):
        stack.read(4, 5)
