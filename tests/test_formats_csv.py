"""Acquisition records in text: delimiters, headings, units, times, and what is wrong with them."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.errors import RecordingError
from glint_aoa.records.acquisition import LazySamples
from glint_aoa.records.formats import csv_text, open_acquisition
from glint_aoa.setup import Inertial

ROWS = [(0.0, 1.5, -2.0), (0.00125, 2.5, -3.0), (0.0025, 3.5, -4.25)]


def write(path, text, encoding="utf-8"):
    path.write_bytes(text.encode(encoding))
    return path


def rows(delimiter=",", decimal=".", end="\n"):
    lines = [delimiter.join(str(each).replace(".", decimal) for each in row) for row in ROWS]
    return end.join([*lines, ""])


def assert_is_the_record(record):
    assert list(record.channels) == ["aoa", "ay"]
    assert [each.rate_hz for each in record.channels.values()] == [800.0, 800.0]
    np.testing.assert_array_equal(record["aoa"].samples, [1.5, 2.5, 3.5])
    np.testing.assert_array_equal(record["ay"].samples, [-2.0, -3.0, -4.25])


def refused(path, message, inertial=None):
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        open_acquisition(path, inertial)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("name", ["p.csv", "p.txt", "p.TSV"])
@pytest.mark.parametrize(
    ("delimiter", "decimal"),
    [(",", "."), (";", "."), ("\t", "."), (" ", "."), ("   ", "."), (";", ","), ("\t", ","),
     (" ", ",")],
)  # fmt: skip
def test_delimiters_and_decimal_signs(tmp_path, delimiter, decimal, name, end):
    text = delimiter.join(["time", "aoa", "ay"]) + end + rows(delimiter, decimal, end)
    assert_is_the_record(open_acquisition(write(tmp_path / name, text)))


@pytest.mark.parametrize(
    "heading",
    [
        "time_s,aoa,ay",
        "Time [s],aoa [g],ay [m/s^2]",
        '"Time (s)","aoa (g_0)","ay (m/s²)"',
        "t,aoa,ay\ns,g,m/s2",
        "# t,aoa [g],ay [m/s^2]",
        "% run 3 of Tuesday\n\nt, aoa, ay",
        "Operator,Jane\nSample rate,800\n\ntime,aoa,ay",
        "\ufefftime,aoa,ay",
    ],
)
def test_headings(tmp_path, heading):
    record = open_acquisition(write(tmp_path / "p.csv", f"{heading}\n{rows()}"))
    assert_is_the_record(record)
    if "g" in heading and "Jane" not in heading and "%" not in heading:
        assert (record["aoa"].units, record["ay"].units) == ("g_0", "m/s^2")
    else:
        assert record["aoa"].units is None


def test_units_in_blank_separated_headings(tmp_path):
    path = write(tmp_path / "p.txt", "time [s]  ay [m/s^2]\n0.000 1\n0.001 2\n0.002 3\n")
    record = open_acquisition(path)
    assert (record["ay"].units, record["ay"].rate_hz) == ("m/s^2", 1000.0)


def test_times_in_milliseconds_and_before_the_trigger(tmp_path):
    path = write(tmp_path / "p.csv", "time [ms],ay\n-2.5,1\n-1.25,2\n0,3\n1.25,4\n")
    ay = open_acquisition(path)["ay"]
    assert (ay.rate_hz, ay.start_s) == (800.0, -0.0025)


@pytest.mark.parametrize(
    "above", ["# rate_hz: 800\n", "Sampling Rate [Hz] = 800\n", "fs,0.8 kHz\n"]
)
def test_rate_above_the_names(tmp_path, above):
    path = write(tmp_path / "p.csv", f"{above}# start = -5 ms\nay,az\n1,2\n3,4\n")
    ay = open_acquisition(path)["ay"]
    assert (ay.rate_hz, ay.start_s) == (800.0, -0.005)


def test_rate_from_the_setup(tmp_path):
    path = write(tmp_path / "p.csv", "ay\n1\n2\n3\n")
    refused(path, "neither times nor a sampling rate are recorded; give rate under [inertial]")
    ay = open_acquisition(path, Inertial(rate="800 Hz", start="-1 s"))["ay"]
    assert (ay.rate_hz, ay.start_s, ay.samples.tolist()) == (800.0, -1.0, [1, 2, 3])
    timed = write(tmp_path / "t.csv", f"time,aoa,ay\n{rows()}")
    refused(timed, "rate is 800 Hz in the record but 400 Hz in the setup", Inertial(rate="400 Hz"))


def test_setup_completes_the_channels(tmp_path):
    path = write(tmp_path / "p.csv", f"time,aoa,ay [V]\n{rows()}")
    said = {"name": "ay", "quantity": "acceleration", "units": "m/s^2", "axis": "+y"}
    scaled = {**said, "scale": 98.1, "station": "0.9 m", "range": ["-300 m/s^2", "300 m/s^2"]}
    ay = open_acquisition(path, Inertial(channel=[scaled]))["ay"]
    assert (ay.quantity, ay.axis, ay.station_m) == ("acceleration", "+y", 0.9)
    np.testing.assert_allclose(ay.values("m/s^2"), [-196.2, -294.3, -416.925])
    assert ay.clipped.tolist() == [False, False, True]
    refused(path, "channel ay: units is V in the record but m/s^2 in the setup; correct the setup",
            Inertial(channel=[said]))  # fmt: skip
    refused(path, "channel ay_ of the setup is not in the record; did you mean ay? channels here: "
            "aoa, ay", Inertial(channel=[{**said, "name": "ay_"}]))  # fmt: skip


def test_rows_missing_by_their_times_and_empty_cells_are_nan(tmp_path):
    text = "time,ay,az\n0,1,5\n0.001,2,\n0.004,3,6\n0.005,4,NaN\n0.006,5,7\n0.007,6,8\n"
    record = open_acquisition(write(tmp_path / "p.csv", text))
    np.testing.assert_array_equal(record["ay"].samples, [1, 2, np.nan, np.nan, 3, 4, 5, 6])
    np.testing.assert_array_equal(
        record["az"].samples, [5, np.nan, np.nan, np.nan, 6, np.nan, 7, 8]
    )


@pytest.mark.parametrize(
    ("rate_hz", "rel"), [(800.0, 0), (640.0, 0), (51.2, 0), (900.0, 2e-5), (851.063829787234, 2e-5)]
)
def test_times_rounded_to_milliseconds_are_regular(tmp_path, rate_hz, rel):
    times = np.arange(4000) / rate_hz - 1
    text = "time,ay\n" + "".join(f"{t:.3f},{k}\n" for k, t in enumerate(times))
    ay = open_acquisition(write(tmp_path / "p.csv", text))["ay"]
    assert (ay.rate_hz, len(ay)) == (pytest.approx(rate_hz, rel=rel, abs=0), 4000)
    assert ay.start_s == pytest.approx(-1.0, abs=1e-4)


@pytest.mark.parametrize("block", [8000, 1 << 22])
@pytest.mark.parametrize("start_s", [0.0004, 0.00049, -0.99951, 3.00125])
def test_rounded_times_of_long_files_with_gaps_keep_their_places(
    tmp_path, monkeypatch, start_s, block
):
    monkeypatch.setattr(csv_text, "_BLOCK_BYTES", block)
    kept = np.delete(np.arange(3000), [1500, 1501, 2200])
    text = "time,ay\n" + "".join(f"{start_s + k / 800:.4f},{k}\n" for k in kept)
    ay = open_acquisition(write(tmp_path / "p.csv", text))["ay"]
    assert (ay.rate_hz, len(ay)) == (800.0, 3000)
    np.testing.assert_array_equal(ay.samples[kept], kept)
    coarse = "time,ay\n" + "".join(f"{start_s + k / 800:.3f},{k}\n" for k in range(3000))
    ay = open_acquisition(write(tmp_path / "p.csv", coarse))["ay"]
    assert (len(ay), ay.start_s) == (3000, pytest.approx(start_s, abs=1e-4))
    np.testing.assert_array_equal(ay.samples, np.arange(3000))


def test_times_too_coarse_for_the_rate_are_refused(tmp_path):
    times = np.arange(4000) / 1400
    path = write(tmp_path / "p.csv", "time,ay\n" + "".join(f"{t:.3f},1\n" for t in times))
    refused(path, "times are irregular: the sample at ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,ay\n0,1\n0.001,2\n0.002,3\n0.0025,4\n0.004,5\n", "times are irregular: the sample"),
        ("time,ay\n0,1\n0.001,2\n0.0005,3\n", "time runs backwards to 0.0005 s"),
        ("time,ay\n0,1\n0.001,2\n0.001,3\n0.002,4\n0.003,5\n", "times are irregular: the sample at "
         "0.001 s is too near or far from the one before where most follow at 1000 Hz"),
        ("time,ay\n0,1\n0,2\n0,3\n", "most times repeat, the first 0 s"),
        ("time,ay\n0,1\n,2\n0.002,3\n", "a time is missing after 0 s"),
        ("time,ay\n0,1\n1,2\n2,3\n1e9,4\n", "most samples are missing, the most before 1e+09 s"),
        ("time [V],ay\n0,1\n1,2\n", "times in time are in V, expected one of s, "),
        ("time,ay\n0,1\n", "fewer than two times"),
        ("ay,az\n1,2\nx,4\n5,6\n7,8\n", "the line above the first whole row of numbers reads 'x"),
        ("ay,az\n1,2\n3,4\n5,x\n7,8\n", "line 4, column az: 'x' is no number; correct it or leave"),
        ("ay,az\n1,2\n3,4\n5\n", "line 4 has 1 values where 2 columns have names; it is cut short"),
        ("ay,az\n1,2\n3,4\n5,6,7\n", "line 4 has 3 values where 2 columns have names"),
        ("1,2\n3,4\n", "no names stand over 2 columns of numbers"),
        ("ay\n1,2\n3,4\n", "1 names stand over 2 columns, so the comma seems to be the decimal"),
        ("a,b,c\n1,2\n3,4\n", "3 names stand over 2 columns of numbers"),
        ("fs: 8\nay,ay\n1,2\n3,4\n", "two channels are called ay; give each a name of its own"),
        ("some words\nand no more\n", "no rows of numbers found"),
        ("# rate_hz: fast\nay,az\n1,2\n3,4\n", "rate_hz above the names: 'fast"),
        ("# rate_hz: 0\nay,az\n1,2\n3,4\n", "rate above the names is 0; expected more than 0"),
        ("time\n0\n1\n2\n", "no channels; check that they were recorded"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_one_sentence(tmp_path, text, message):
    refused(write(tmp_path / "p.csv", text), message, None)


def test_text_in_two_bytes_and_binary_are_refused(tmp_path):
    path = write(tmp_path / "p.csv", f"time,aoa,ay\n{rows()}", "utf-16")
    refused(path, "no text of single bytes; save it as CSV in UTF-8, or correct its suffix")
    (tmp_path / "b.csv").write_bytes(bytes(range(256)))
    refused(tmp_path / "b.csv", "no text of single bytes")


@pytest.mark.parametrize("timed", [True, False])
def test_a_long_file_is_read_block_by_block(tmp_path, monkeypatch, timed):
    rng = np.random.default_rng(5)
    size = 900
    values = rng.normal(size=(size, 2)).round(6)
    kept = np.ones(size, bool)
    if timed:
        kept[[100, 101, 500]] = False
    lines = [f"{k / 800:.6f},{a},{b}" for k, (a, b) in enumerate(values) if kept[k]]
    heading = "time,ay,az" if timed else "# rate_hz: 800\nnumber,ay,az"
    path = write(tmp_path / "p.csv", "\n".join([heading, *lines]))
    whole = open_acquisition(path)
    monkeypatch.setattr(csv_text, "EAGER_BYTES", 0)
    monkeypatch.setattr(csv_text, "_BLOCK_BYTES", 1000)
    record = open_acquisition(path)
    for k, name in enumerate(("ay", "az")):
        channel = record[name]
        assert isinstance(channel.samples, LazySamples)
        expected = np.where(kept, values[:, k], np.nan)
        np.testing.assert_array_equal(whole[name].samples, expected)
        for start, stop in ((0, size), (95, 110), (890, size), (40, 41), (300, 300)):
            np.testing.assert_array_equal(channel.samples[start:stop], expected[start:stop])


def test_comments_between_rows_are_skipped(tmp_path):
    path = write(tmp_path / "p.csv", "time,ay\n0,1\n0.001,2\n# a pause\n\n0.002,3\n")
    assert open_acquisition(path)["ay"].samples.tolist() == [1, 2, 3]


@given(
    values=st.lists(
        st.floats(-1e9, 1e9, allow_nan=False, allow_subnormal=False), min_size=2, max_size=20
    ),
    delimiter=st.sampled_from([",", ";", "\t", " "]),
)
def test_numbers_come_back_as_written(tmp_path_factory, values, delimiter):
    path = tmp_path_factory.mktemp("csv") / "p.csv"
    text = "".join(f"{k}{delimiter}{value!r}\n" for k, value in enumerate(values))
    write(path, f"t{delimiter}ay\n{text}")
    found = open_acquisition(path)["ay"]
    assert found.rate_hz == 1.0
    np.testing.assert_allclose(found.samples, values, rtol=1e-15)
