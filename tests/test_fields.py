"""Field stacks: what they refuse, and that blocks add up to the whole."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.errors import RecordingError
from glint_aoa.records import fields as fields_module
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.formats import SUFFIXES, open_fields


def counting_fields(n=7, lines=3, columns=5, dtype=np.uint8):
    return np.arange(n * lines * columns).reshape(n, lines, columns).astype(dtype)


def test_stack_says_what_it_holds():
    stack = FieldStack.from_array(counting_fields(), FieldInfo(rate_hz=60), meta={"run": "3"})
    assert (len(stack), stack.n_fields, stack.n_lines, stack.n_columns) == (7, 7, 3, 5)
    assert (stack.name, stack.path, stack.times_s, stack.dtype) == ("fields", None, None, np.uint8)
    assert stack.info.rate_hz == 60
    assert stack.meta["run"] == "3"
    assert repr(stack) == "<FieldStack stack of fields in memory: 7 fields of 5 x 3, uint8>"


def test_white_level_is_the_top_of_the_type_unless_the_camera_has_fewer_bits():
    assert FieldStack.from_array(counting_fields()).white_level == 255
    assert FieldStack.from_array(counting_fields(dtype=np.uint16)).white_level == 65535

    def read(start, stop):
        return counting_fields(dtype=np.uint16)[start:stop]

    stack = FieldStack(None, (7, 3, 5), np.uint16, read, FieldInfo(), white_level=4095)
    assert stack.white_level == 4095


@given(size=st.integers(1, 9), n=st.integers(1, 8))
def test_blocks_add_up_to_the_whole(size, n):
    fields = counting_fields(n)
    blocks = list(FieldStack.from_array(fields).blocks(size))
    assert [start for start, _ in blocks] == list(range(0, n, size))
    np.testing.assert_array_equal(np.concatenate([block for _, block in blocks]), fields)


def test_default_blocks_are_bounded_in_bytes(monkeypatch):
    monkeypatch.setattr(fields_module, "BLOCK_BYTES", 31)
    blocks = [block for _, block in FieldStack.from_array(counting_fields()).blocks()]
    assert [len(block) for block in blocks] == [2, 2, 2, 1]


def test_reading_beyond_the_end_gives_what_there_is():
    stack = FieldStack.from_array(counting_fields())
    assert stack.read(5, 99).shape == (2, 3, 5)
    assert stack.read(7, 9).shape == (0, 3, 5)


def test_other_byte_order_becomes_native():
    stack = FieldStack.from_array(counting_fields(dtype=">u2"))
    assert stack.dtype == np.uint16
    assert stack.read(0, 1).dtype == np.uint16
    np.testing.assert_array_equal(stack.read(0, 7), counting_fields())


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            np.zeros((2, 3), np.uint8),
            "the array has shape [2, 3], expected grey fields [field, line, column]; "
            "convert colour to grey and stack the fields",
        ),
        (
            np.zeros((2, 3, 4, 3), np.uint8),
            "the array has shape [2, 3, 4, 3], expected grey fields [field, line, column]; "
            "convert colour to grey and stack the fields",
        ),
        (
            np.zeros((2, 3, 4)),
            "grey levels are float64, expected uint8 or uint16; "
            "store them as recorded, without scaling",
        ),
        (
            np.zeros((0, 3, 4), np.uint8),
            "the stack is empty (shape [0, 3, 4]), expected at least one field; "
            "check that the recording was saved",
        ),
        (
            np.lib.stride_tricks.as_strided(np.zeros(1, np.uint8), (1, 20_000, 20_000), (0, 0, 0)),
            "a field of 20000 x 20000 pixels is larger than any camera's; "
            "the file is damaged, record or copy it again",
        ),
    ],
)
def test_what_is_no_stack_of_grey_fields_is_refused(fields, message):
    with pytest.raises(
        RecordingError, match="^" + re.escape(f"stack of fields in memory: {message}") + "$"
    ):
        FieldStack.from_array(fields)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (np.zeros(6), "fields_time has shape [6], expected one time for each of the 7 fields"),
        (np.array([0, 1, 2, np.nan, 4, 5, 6.0]), "fields_time is not finite at field 3"),
    ],
)
def test_timestamps_must_match(times, message):
    with pytest.raises(RecordingError, match=re.escape(message)):
        FieldStack.from_array(counting_fields(), times_s=times)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("rate_hz", 0, "a number greater than zero [Hz]"),
        ("rate_hz", float("nan"), "a number greater than zero [Hz]"),
        ("rate_hz", "60", "a number greater than zero [Hz]"),
        ("exposure_s", -1.0, "a number greater than zero [s]"),
        ("first_line", -1, "a whole number from 0"),
        ("first_column", 1.5, "a whole number from 0"),
        ("first_parity", "top", '"even" or "odd"'),
        ("first_parity", [1, 2], '"even" or "odd"'),
        ("interlaced", 2, "true or false"),
        ("start_s", float("inf"), "a finite number [s]"),
        ("trigger_time", "yesterday", "a time in ISO 8601, e.g. 2024-05-31T14:02:11"),
    ],
)
def test_info_refuses_what_cannot_be(name, value, expected):
    with pytest.raises(
        RecordingError, match="^" + re.escape(f"{name} is {value!r}; expected {expected}") + "$"
    ):
        FieldInfo(**{name: value})


def test_info_turns_numpy_scalars_into_plain_values():
    info = FieldInfo(rate_hz=np.float32(50), first_line=np.int64(98), interlaced=np.bool_(True))
    assert info == FieldInfo(rate_hz=50.0, first_line=98, interlaced=True)
    assert type(info.first_line) is int
    assert type(info.interlaced) is bool


def test_a_reader_that_fails_gives_one_sentence(tmp_path):
    def read(start, stop):
        raise OSError("disk gone")

    stack = FieldStack(tmp_path / "a.h5", (7, 3, 5), np.uint8, read, FieldInfo())
    message = "a.h5: fields 2 to 3 cannot be read (disk gone); the file is damaged or has changed"
    with pytest.raises(RecordingError, match=re.escape(message)):
        stack.read(2, 4)


def test_a_reader_that_gives_too_little_is_found_out():
    def read(start, stop):
        return counting_fields()[start : stop - 1]

    stack = FieldStack(None, (7, 3, 5), np.uint8, read, FieldInfo())
    message = "fields 0 to 6 came as uint8 [6, 3, 5], expected uint8 [7, 3, 5]"
    with pytest.raises(RecordingError, match=re.escape(message)):
        stack.read(0, 7)


def test_open_fields_names_what_it_cannot_open(tmp_path):
    cases = {
        "missing.h5": "no such file; check its name and folder",
        "folder.h5": "a folder, expected PNG or TIFF pictures in it, all of one kind, found none; "
        "give the recording inside it, or a folder with the fields of one point",
        "empty.npy": "an empty file; check that the recording was saved",
        "clip.xyz": f"suffix .xyz, expected one of {', '.join(SUFFIXES)}; "
        "convert the recording or correct its name",
        "clip": f"no suffix, expected one of {', '.join(SUFFIXES)}; "
        "convert the recording or correct its name",
    }
    (tmp_path / "folder.h5").mkdir()
    (tmp_path / "empty.npy").touch()
    (tmp_path / "clip.xyz").write_text("?")
    (tmp_path / "clip").write_text("?")
    for name, message in cases.items():
        path = tmp_path / name
        with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}") + "$"):
            open_fields(path)


def test_open_fields_refuses_a_pipe(tmp_path):
    import os

    path = tmp_path / "pipe.npy"
    os.mkfifo(path)
    with pytest.raises(RecordingError, match="not an ordinary file"):
        open_fields(path)
