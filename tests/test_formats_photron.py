"""Photron recordings: a real one, packing by hand, and headers that lie."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mutated import complaint_about, spoil

from glint_aoa.errors import RecordingError
from glint_aoa.records.formats import open_fields
from glint_aoa.records.formats.photron import unpack_12_bits

REAL = Path(__file__).parents[2] / "shared/data/video/vibrating-beam.mraw"

KEYS = {
    "Date": "2024/05/31",
    "Time": "9:05",
    "Record Rate(fps)": "15000",
    "Shutter Speed(s)": "1/20000",
    "Total Frame": "4",
    "Start Frame": "-300",
    "Save Step": "100",
    "Image Width": "6",
    "Image Height": "3",
    "Color Type": "Mono",
    "Color Bit": "8",
    "EffectiveBit Depth": "8",
    "EffectiveBit Side": "Lower",
}

CIHX = """\x01\x02 other bytes <cih>
 <fileInfo><date>2024/05/31</date><time>9:05</time></fileInfo>
 <frameInfo><totalFrame>4</totalFrame><startFrame>-300</startFrame><skipFrame>100</skipFrame>
 </frameInfo>
 <recordInfo><recordRate>15000</recordRate><shutterSpeedNsec>50000</shutterSpeedNsec></recordInfo>
 <imageDataInfo><resolution><width>6</width><height>3</height></resolution>
 <colorInfo><type>Mono</type><bit>8</bit></colorInfo>
 <effectiveBit><depth>8</depth><side>Lower</side></effectiveBit></imageDataInfo>
</cih>\xff trailing"""


def pack_12_bits(pixels):
    """Pack through the binary digits of all pixels in a row, independently of the reader."""
    bits = "".join(f"{pixel:012b}" for pixel in np.ravel(pixels))
    return bytes(int(bits[i : i + 8], 2) for i in range(0, len(bits), 8))


def write_recording(folder, content, **changes):
    keys = {**KEYS, **{name.replace("_", " "): value for name, value in changes.items()}}
    lines = [f"{name} : {value}" for name, value in keys.items() if value is not None]
    text = "\n".join(["#Camera Information Header", *lines, "", "END", "Total Frame : 99", ""])
    (folder / "a.cih").write_text(text)
    (folder / "a.mraw").write_bytes(content)
    return folder / "a.mraw"


def fields_8(shape=(4, 3, 6)):
    return np.arange(np.prod(shape)).reshape(shape).astype(np.uint8)


def assert_refused(path, message):
    with pytest.raises(RecordingError, match="^" + re.escape(f"{message}")):
        open_fields(path)


@pytest.mark.skipif(not REAL.exists(), reason=f"no real recording at {REAL.name}")
@pytest.mark.parametrize("suffix", [".mraw", ".cih"])
def test_real_recording(suffix):
    stack = open_fields(REAL.with_suffix(suffix))
    assert (stack.shape, stack.dtype, stack.name) == ((75, 40, 640), np.uint8, "vibrating-beam")
    assert stack.info.rate_hz == 150
    assert stack.info.exposure_s == 1 / 15371
    assert stack.info.interlaced is False
    assert stack.info.start_s == 0
    assert stack.info.trigger_time == "2018-12-17T12:48"
    assert stack.white_level == 255
    expected = np.frombuffer(REAL.read_bytes(), np.uint8).reshape(75, 40, 640)
    np.testing.assert_array_equal(np.concatenate([b for _, b in stack.blocks(11)]), expected)


@pytest.mark.parametrize("name", ["a.mraw", "a.cih"])
def test_8_bits_and_what_the_header_says(tmp_path, name):
    write_recording(tmp_path, fields_8().tobytes())
    stack = open_fields(tmp_path / name)
    np.testing.assert_array_equal(stack.read(1, 3), fields_8()[1:3])
    assert stack.name == "a"
    assert stack.info.rate_hz == 150.0
    assert stack.info.exposure_s == 5e-5
    assert stack.info.start_s == -0.02
    assert stack.info.trigger_time == "2024-05-31T09:05"


def test_header_without_optional_keys(tmp_path):
    names = ("Record Rate(fps)", "Shutter Speed(s)", "Save Step", "Start Frame", "Date")
    path = write_recording(tmp_path, fields_8().tobytes(), **dict.fromkeys(names))
    info = open_fields(path).info
    assert (info.rate_hz, info.exposure_s, info.start_s, info.trigger_time) == (None,) * 4


def test_12_bits_by_hand():
    packed = np.array([0xAB, 0xCD, 0xEF, 0x00, 0x1F, 0xFF], np.uint8)
    assert unpack_12_bits(packed).tolist() == [0xABC, 0xDEF, 0x001, 0xFFF]


@settings(max_examples=30)
@given(seed=st.integers(0, 1000))
def test_12_bits_round_trip(tmp_path_factory, seed):
    folder = tmp_path_factory.mktemp("photron")
    fields = np.random.default_rng(seed).integers(0, 4096, (4, 3, 6), np.uint16)
    stack = open_fields(write_recording(folder, pack_12_bits(fields), Color_Bit="12"))
    assert (stack.dtype, stack.white_level) == (np.uint16, 4095)
    np.testing.assert_array_equal(np.concatenate([b for _, b in stack.blocks(3)]), fields)
    np.testing.assert_array_equal(stack.read(2, 3), fields[2:3])


@pytest.mark.parametrize(
    ("side", "white_level"), [("Lower", 4095), ("Higher", 4095 << 4), (None, 4095)]
)
def test_16_bits_are_little_endian_and_never_scaled(tmp_path, side, white_level):
    fields = np.arange(72, dtype="<u2").reshape(4, 3, 6) * 50
    keys = {"Color Bit": "16", "EffectiveBit Depth": "12", "EffectiveBit Side": side}
    stack = open_fields(write_recording(tmp_path, fields.tobytes(), **keys))
    assert (stack.dtype, stack.white_level) == (np.uint16, white_level)
    np.testing.assert_array_equal(stack.read(0, 4), fields)


@pytest.mark.parametrize("name", ["a.mraw", "a.cihx"])
def test_cihx(tmp_path, name):
    (tmp_path / "a.cihx").write_bytes(CIHX.encode("latin-1"))
    (tmp_path / "a.mraw").write_bytes(fields_8().tobytes())
    stack = open_fields(tmp_path / name)
    np.testing.assert_array_equal(stack.read(0, 4), fields_8())
    assert (stack.info.rate_hz, stack.info.exposure_s, stack.info.start_s) == (150.0, 5e-5, -0.02)


@pytest.mark.parametrize(
    ("cihx", "message"),
    [
        (CIHX.replace("<cih>", '<!DOCTYPE a [<!ENTITY b "c">]><cih>'), None),
        (CIHX.replace("<fileInfo>", "<!ENTITY b><fileInfo>"), "no keys found"),
        (CIHX.replace("<fileInfo>", "<fileInf>"), "its XML cannot be read ("),
        ("nothing here", "no keys found, expected a Photron header"),
    ],
)
def test_damaged_cihx(tmp_path, cihx, message):
    (tmp_path / "a.cihx").write_bytes(cihx.encode("latin-1"))
    (tmp_path / "a.mraw").write_bytes(fields_8().tobytes())
    if message is None:  # what stands before the header is not looked at
        assert len(open_fields(tmp_path / "a.mraw")) == 4
    else:
        assert_refused(tmp_path / "a.mraw", f"{tmp_path / 'a.cihx'}: {message}")


def test_missing_partner_is_named(tmp_path):
    path = write_recording(tmp_path, fields_8().tobytes())
    (tmp_path / "a.cih").rename(tmp_path / "b.cih")
    assert_refused(
        path,
        f"{path}: no header beside it, expected a.cih; "
        "copy both files of the recording into one folder",
    )
    assert_refused(
        tmp_path / "b.cih",
        f"{tmp_path / 'b.cih'}: no pixels beside it, expected b.mraw",
    )


@pytest.mark.parametrize("change", [-1, 1])
def test_sizes_must_agree(tmp_path, change):
    path = write_recording(tmp_path, bytes(72 + change))
    assert_refused(
        path,
        f"{path}: has {72 + change} bytes, but a.cih promises 72 (4 frames of 6 x 3, 8 bits); "
        "the two do not belong together or one is damaged, copy both again",
    )


def test_a_claim_of_a_terabyte_fails_at_once(tmp_path):
    path = write_recording(tmp_path, bytes(72), Total_Frame="999999999999")
    assert_refused(path, f"{path}: has 72 bytes, but a.cih promises 17999999999982")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("Total Frame", None, "Total Frame is missing, expected a whole number from 1"),
        ("Total Frame", "0", "Total Frame is 0, expected a number greater than zero"),
        ("Total Frame", "1.5", "Total Frame is 1.5, expected a whole number from 1"),
        ("Image Width", "wide", "Image Width is wide, expected a number greater than zero"),
        ("Save Step", "0", "Save Step is 0, expected a number greater than zero"),
        ("Record Rate(fps)", "-5", "Record Rate(fps) is -5, expected a number greater than zero"),
        ("Shutter Speed(s)", "1/0", "Shutter Speed(s) is 1/0, expected a number greater"),
        ("Start Frame", "x", "Start Frame is x, expected a number"),
        ("Color Bit", "10", "pixels are Mono, 10 bits, expected Mono of 8, 12 or 16"),
        ("Color Type", "Color", "pixels are Color, 8 bits, expected Mono of 8, 12 or 16"),
        ("Image Width", "9" * 400, "Image Width is 9999"),
        ("Time", "29:05", "trigger_time is '2024-05-31T29:05'; expected a time in ISO 8601"),
    ],
)
def test_wrong_keys_are_named(tmp_path, name, value, message):
    path = write_recording(tmp_path, fields_8().tobytes(), **{name: value})
    assert_refused(path, f"{tmp_path / 'a.cih'}: {message}")


def test_odd_frames_of_12_bits_are_refused(tmp_path):
    keys = {"Image Width": "5", "Color Bit": "12"}
    path = write_recording(tmp_path, bytes(90), **keys)
    assert_refused(path, f"{tmp_path / 'a.cih'}: frames of 5 x 3 pixels cannot be packed in pairs")


def test_empty_header_is_refused(tmp_path):
    path = write_recording(tmp_path, fields_8().tobytes())
    (tmp_path / "a.cih").write_bytes(b"\0\xff\0")
    assert_refused(path, f"{tmp_path / 'a.cih'}: no keys found, expected a Photron header")


@settings(max_examples=80)
@given(data=st.data())
def test_mutated_headers_give_fields_or_our_own_error(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("fuzz")
    path = write_recording(folder, fields_8().tobytes())
    spoil(folder / "a.cih", data, most=6, least=0)
    complaint = complaint_about(path)
    assert complaint is None or str(folder) in complaint
