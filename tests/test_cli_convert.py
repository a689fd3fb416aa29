"""``convert`` to recorded points and ``inspect`` of what cameras wrote."""

import json
import re

import h5py
import nptdms
import numpy as np
import pytest
import tifffile
from films import film, vibration, write_video

from fuzz.cine_files import write_cine
from glint_aoa.records.formats import open_acquisition, open_fields
from glint_aoa.records.points import RecordedPoint, write_point

SETUP = """
[glint]
nose = "right"
"""
FRAMES = film(24, (48, 80), row=vibration(3.0, 2.0))


@pytest.fixture
def program(program, monkeypatch, tmp_path):
    """Run the command line beside a setup file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "glint-aoa.toml").write_text(SETUP)
    return program


def write_mraw(folder):
    keys = {
        "Record Rate(fps)": 60,
        "Total Frame": len(FRAMES),
        "Image Width": FRAMES.shape[2],
        "Image Height": FRAMES.shape[1],
        "Color Type": "Mono",
        "Color Bit": 8,
    }
    (folder / "p.cih").write_text("\n".join(f"{key} : {value}" for key, value in keys.items()))
    (folder / "p.mraw").write_bytes(FRAMES.tobytes())
    return folder / "p.mraw"


def write_raw(folder):
    (folder / "p.raw").write_bytes(FRAMES.tobytes())
    (folder / "p.raw.toml").write_text(
        f'shape = {list(FRAMES.shape)}\ndata_type = "uint8"\nrate = "60 Hz"\nwhite_level = 160'
    )
    return folder / "p.raw"


def write_tiff(folder):
    words = {"axes": "TYX", "finterval": 1 / 60}
    tifffile.imwrite(folder / "p.tif", FRAMES, imagej=True, metadata=words)
    return folder / "p.tif"


NUMBERS = [*range(10), *range(12, 26)]
WRITERS = {
    "interlaced video": lambda folder: write_video(folder / "p.mkv", FRAMES, field_order="bb"),
    "video with gaps": lambda folder: write_video(folder / "p.avi", FRAMES, numbers=NUMBERS),
    "twelve bits": lambda folder: write_video(
        folder / "p.mkv", FRAMES.astype(np.uint16) * 16, layout="gray12le"
    ),
    "cine": lambda folder: write_cine(
        folder / "p.cine",
        FRAMES.astype(np.uint16) * 4,
        packing=256,
        times=(np.arange(len(FRAMES)) - 2.5) / 1000,
    ),
    "mraw": write_mraw,
    "raw": write_raw,
    "tiff": write_tiff,
}


@pytest.mark.parametrize("kind", WRITERS)
def test_process_makes_the_same_of_a_converted_recording(program, tmp_path, kind):
    """To the last bit: angles, times and flags."""
    path = WRITERS[kind](tmp_path)
    code, out, err = program("convert", path, "-o", "points")
    assert code == 0, err
    assert out.startswith("Wrote points/p.h5: ")
    for recording, results in ((path, "before"), ("points/p.h5", "after")):
        code, _, err = program("process", recording, "-o", results)
        assert code == 0, err
    before, after = ((tmp_path / each / "p.csv").read_bytes() for each in ("before", "after"))
    assert before == after
    log = [(tmp_path / each / "log.csv").read_text() for each in ("before", "after")]
    assert log[0] == log[1]
    assert not np.isnan(np.genfromtxt(tmp_path / "after/p.csv", delimiter=",", skip_header=1)).all()
    one, other = open_fields(path), open_fields(tmp_path / "points/p.h5")
    assert (one.info, one.white_level) == (other.info, other.white_level)
    with h5py.File(tmp_path / "points/p.h5") as file:
        assert file["meta"].attrs["source"] == path.name


@pytest.fixture
def joined(program, tmp_path):
    """A video converted with a TDMS record that a trigger 12.5 ms late started."""
    write_video(tmp_path / "p.avi", FRAMES)
    samples = np.arange(5000, dtype=np.int16)
    with nptdms.TdmsWriter(tmp_path / "das.tdms") as writer:
        for name, start in (("aoa", 0.0), ("ay", -0.25)):
            keys = {"wf_increment": 1 / 800, "wf_start_offset": start, "unit_string": "V"}
            writer.write_segment([nptdms.ChannelObject("das", name, samples, keys)])
    code, out, err = program(
        "convert", "p.avi", "--channels", "das.tdms", "--offset", "12.5 ms", "-o", "points"
    )
    assert code == 0, err
    return out


def test_channels_are_joined_on_the_common_trigger(joined, tmp_path):
    assert joined == "Wrote points/p.h5: 24 fields of 80 x 48, uint8, 2 channels\n"
    before = open_acquisition(tmp_path / "das.tdms")
    after = open_acquisition(tmp_path / "points/p.h5")
    assert list(after.channels) == ["aoa", "ay"]
    for name, channel in after.channels.items():
        assert channel.start_s == pytest.approx(before[name].start_s + 0.0125)
        assert (channel.rate_hz, channel.units) == (800.0, before[name].units)
        np.testing.assert_array_equal(channel.samples, before[name].samples)
        assert channel.samples.dtype == np.int16


def test_a_point_keeps_its_channels_and_truth(joined, program, tmp_path):
    record = open_acquisition(tmp_path / "points/p.h5")
    truth = {"pitch_deg": np.arange(24.0)}
    write_point(tmp_path / "q.h5", RecordedPoint(FRAMES, acquisition=record, truth=truth))
    assert program("convert", "q.h5", "-o", "again")[0] == 0
    with h5py.File(tmp_path / "again/q.h5") as file:
        assert list(file["das"]) == ["aoa", "ay"]
        np.testing.assert_array_equal(file["truth/pitch_deg"][:], truth["pitch_deg"])
        np.testing.assert_array_equal(file["fields"][:], FRAMES)


def test_channels_of_one_name_in_two_groups_get_names_of_their_own(program, tmp_path):
    write_video(tmp_path / "p.avi", FRAMES)
    with nptdms.TdmsWriter(tmp_path / "das.tdms") as writer:
        for group in ("a", "b"):
            channel = nptdms.ChannelObject(group, "x", np.arange(9.0), {"wf_increment": 0.01})
            writer.write_segment([channel])
    code, _, err = program("convert", "p.avi", "--channels", "das.tdms", "-o", "points")
    assert code == 0
    assert "p: channel a/x was written as a_x\n" in err
    assert list(open_acquisition(tmp_path / "points/p.h5").channels) == ["a_x", "b_x"]


def test_the_setup_completes_what_the_file_does_not_say(program, tmp_path):
    np.save(tmp_path / "p.npy", FRAMES)
    (tmp_path / "s.toml").write_text(
        '[fields]\nrate = "60 Hz"\nfirst_parity = "odd"\ninterlaced = true\nfirst_line = 98'
    )
    assert program("convert", "p.npy", "-s", "s.toml", "-o", "points")[0] == 0
    info = open_fields(tmp_path / "points/p.h5").info
    assert (info.rate_hz, info.first_parity, info.first_line) == (60.0, "odd", 98)


def test_convert_as_json(program, tmp_path):
    write_video(tmp_path / "p.avi", FRAMES, numbers=NUMBERS)
    code, out, err = program("convert", "p.avi", "-o", "points", "--json")
    (said,) = json.loads(out)
    assert code == 0
    assert (said["point"], said["fields"], said["channels"]) == ("points/p.h5", 24, [])
    assert said["notes"][-1] == "2 frames are missing by their times, the first before 10"
    assert f"p: {said['notes'][-1]}\n" in err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["p.npy", "-o", "out"],
            "out/p.h5 is there already; give another --out, or --overwrite to replace it",
        ),
        (["q.h5", "-o", ".", "--overwrite"], "q.h5 is the recording itself; give another --out"),
        (
            ["p.npy", "q.h5", "--channels", "das.tdms", "-o", "new"],
            "das.tdms: one record for 2 recordings; convert them singly",
        ),
        (
            ["p.npy", "--offset", "12", "-o", "new"],
            "--offset: '12' is not a quantity in s; give a time with its unit, e.g. \"12.5 ms\"",
        ),
        (
            ["p.npy", "--offset", "12 ms", "-o", "new"],
            "p.npy: an offset is given, but no acquisition record to shift; give --channels",
        ),
        (
            ["gone.npy", "-o", "new"],
            "gone.npy: no such file; check its name and folder",
        ),
        (
            ["p.npy", "other/p.npy", "-o", "new"],
            "p.npy and other/p.npy are both called p, and so would be their results; give one of "
            "them, or each another --out",
        ),
    ],
)
def test_convert_refuses_in_one_sentence(program, tmp_path, arguments, sentence):
    np.save(tmp_path / "p.npy", FRAMES)
    (tmp_path / "out").mkdir()
    (tmp_path / "out/p.h5").write_text("what was there")
    write_point(tmp_path / "q.h5", RecordedPoint(FRAMES))
    before = (tmp_path / "q.h5").read_bytes()
    code, out, err = program("convert", *arguments)
    assert (code, out, err) == (2, "", f"glint-aoa: {sentence}\n")
    assert (tmp_path / "out/p.h5").read_text() == "what was there"
    assert (tmp_path / "q.h5").read_bytes() == before


def test_a_recording_that_breaks_off_leaves_nothing_behind(program, tmp_path):
    path = write_video(tmp_path / "p.avi", FRAMES, codec="png")
    content = bytearray(path.read_bytes())
    at = [match.start() for match in re.finditer(b"IDAT", content)][20]
    content[at + 20 : at + 400] = bytes(380)
    path.write_bytes(content)
    (tmp_path / "p.avi.toml").write_text("interlaced = false")
    np.save(tmp_path / "q.npy", FRAMES)
    code, out, err = program("convert", "p.avi", "q.npy", "-o", "points")
    assert code == 2
    assert out == "Wrote points/q.h5: 24 fields of 80 x 48, uint8\n"
    assert err.startswith("glint-aoa: p.avi: frame 20 of 24 cannot be read: ")
    assert [each.name for each in (tmp_path / "points").iterdir()] == ["q.h5"]


# Inspect


def said_of(out):
    return dict(re.findall(r"^(\S.*?)  +(.*)$", out, re.MULTILINE))


def test_inspect_says_what_a_video_is_and_what_is_suspicious(program, tmp_path):
    frames = film(24, (48, 80), row=vibration(3.0, 2.0))
    frames[:, :4] = 255
    frames[7] = frames[6]
    write_video(tmp_path / "p.avi", frames, numbers=NUMBERS)
    code, out, err = program("inspect", "p.avi", "--png", "p.png")
    assert (code, err) == (0, "")
    said = said_of(out)
    assert (said["format"], said["fields"], said["rate [Hz]"]) == ("avi", "24", "30")
    assert "  2 frames are missing by their times, the first before 10\n" in out
    assert re.search(r"TIMING: timestamps are irregular \(1 of 24 fields, first 10\)", out)
    assert re.search(r"REPEATED: .* \(1 of 24 fields, first 7\)", out)
    assert said["suspicious"] == "8.33% of the pixels looked at are clipped at 255"
    assert (
        "fields do not follow the one before after 33.33 ms, the first is 10, after 100 ms" in out
    )
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("levels", "words"),
    [
        (
            np.minimum(FRAMES.astype(np.uint16) * 30, 4095),
            "the brightest level is 4095, the top of 12 bits: if the camera has as many, tell "
            "white_level = 4095",
        ),
        (
            FRAMES.astype(np.uint16) << 8,
            "levels are multiples of 256: stored in the upper 8 of 16 bits",
        ),
        (FRAMES // 12, "very dark: the brightest level is 14 of 255"),
        (np.full_like(FRAMES, 90), "all pixels looked at are 90"),
    ],
)
def test_inspect_says_what_is_wrong_with_the_levels(program, tmp_path, levels, words):
    np.save(tmp_path / "p.npy", levels)
    code, out, _ = program("inspect", "p.npy", "--json")
    assert code == 0
    assert json.loads(out)["suspicious"] == [words]


def test_a_rate_of_showing_is_overruled_beside_the_file(program, tmp_path):
    write_video(tmp_path / "p.avi", FRAMES)
    (tmp_path / "s.toml").write_text('[fields]\nrate = "1000 Hz"')
    assert program("process", "p.avi", "-s", "s.toml", "-o", "res") == (
        2,
        "",
        "glint-aoa: p: the file says rate 30.0, the setup fields.rate 1000.0; take it out of the "
        "setup or correct it; where the file is wrong, tell p.avi.toml beside it\n",
    )
    (tmp_path / "p.avi.toml").write_text('rate = "1000 Hz"')
    code, _, err = program("process", "p.avi", "-s", "s.toml", "-o", "res")
    assert code == 0
    assert "p: rate_hz is 1000.0 as told beside it, the file says 30.0\n" in err
    times = np.genfromtxt(tmp_path / "res/p.csv", delimiter=",", names=True)["time_s"]
    np.testing.assert_allclose(times, np.arange(24) / 1000, atol=5e-7)


def test_inspect_follows_the_setup_where_a_video_is_silent(program, tmp_path):
    write_video(tmp_path / "p.avi", film(24, (48, 80), row=lambda time: 24.0))
    (tmp_path / "s.toml").write_text('[fields]\nfirst_parity = "odd"')
    found = json.loads(program("inspect", "p.avi", "-s", "s.toml", "--json")[1])
    assert (found["fields"], found["first_parity"], found["rate_hz"]) == (48, "odd", 60.0)
    assert found["notes"] == ["interlaced, odd field first, as the setup says"]
