"""TDMS written with npTDMS, and real files from LabVIEW."""

import gc
import re

import nptdms
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import recording

from glint_aoa.errors import RecordingError
from glint_aoa.records.acquisition import LazySamples
from glint_aoa.records.formats import open_acquisition, tdms
from glint_aoa.setup import Inertial

CLOCK = {"wf_increment": 1 / 800, "wf_start_offset": 0.0}


def write(path, *channels, pieces=1, root=None):
    """Write (group, name, samples, properties) channels, in so many segments."""
    with nptdms.TdmsWriter(path) as writer:
        for piece in range(pieces):
            objects = [
                nptdms.ChannelObject(group, name, np.array_split(samples, pieces)[piece], keys)
                for group, name, samples, keys in channels
            ]
            writer.write_segment([nptdms.RootObject(root or {}), *objects])
    return path


def refused(path, message, inertial=None):
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        open_acquisition(path, inertial)


@given(
    dtype=st.sampled_from(["i2", "i4", "f4", "f8"]), size=st.integers(1, 50),
    pieces=st.integers(1, 3),
)  # fmt: skip
def test_round_trip(tmp_path_factory, dtype, size, pieces):
    path = tmp_path_factory.mktemp("tdms") / "p.tdms"
    samples = np.random.default_rng(size).integers(-99, 99, size * pieces).astype(dtype)
    write(path, ("g", "ay", samples, {**CLOCK, "unit_string": "g"}), pieces=pieces)
    ay = open_acquisition(path)["ay"]
    assert (ay.rate_hz, ay.start_s, ay.units) == (800.0, 0.0, "g_0")
    assert ay.samples.dtype == np.dtype(dtype)
    np.testing.assert_array_equal(ay.samples, samples)


def test_starts_units_and_names(tmp_path):
    started = np.datetime64("2026-01-12T08:00:00.000000")
    late = {**CLOCK, "wf_start_time": started + np.timedelta64(250_000, "us")}
    path = write(
        tmp_path / "p.tdms",
        ("das", "aoa", np.arange(4.0), {**CLOCK, "wf_start_time": started}),
        ("das", "ay", np.arange(4.0), {**late, "NI_UnitDescription": "Volts"}),
        ("other", "ay", np.arange(4.0), {**CLOCK, "wf_start_offset": -0.5}),
        ("other", "note", np.array(["a", "b"]), {}),
        root={"operator": "Jane", "run": 3},
    )
    record = open_acquisition(path)
    assert [(c.name, c.start_s, c.units) for c in record.channels.values()] == [
        ("aoa", 0.0, None), ("das/ay", 0.25, "V"), ("other/ay", -0.5, None),
    ]  # fmt: skip
    assert dict(record.meta) == {"operator": "Jane"}


def test_times_in_a_channel(tmp_path):
    times = np.array([0.0, 1.0, 2.0, 5.0, 6.0]) / 800 - 0.1
    path = write(
        tmp_path / "p.tdms",
        ("g", "Time", times * 1e3, {"unit_string": "ms"}),
        ("g", "ay", np.arange(5.0), {}),
    )
    ay = open_acquisition(path)["ay"]
    assert (ay.rate_hz, ay.start_s) == (pytest.approx(800, rel=1e-9), pytest.approx(-0.1))
    np.testing.assert_array_equal(ay.samples, [0, 1, 2, np.nan, np.nan, 3, 4])


def test_rate_and_channel_map_of_the_setup(tmp_path):
    path = write(tmp_path / "p.tdms", ("g", "ay_face", np.arange(3.0), {}))
    refused(path, "neither times nor a sampling rate are recorded; give rate under [inertial]")
    said = {"name": "ay_face", "quantity": "acceleration", "units": "m/s^2", "axis": "-y"}
    ay = open_acquisition(path, Inertial(rate="500 Hz", channel=[said]))["ay_face"]
    assert (ay.rate_hz, ay.units, ay.axis) == (500.0, "m/s^2", "-y")
    misspelt = Inertial(rate="500 Hz", channel=[{**said, "name": "ay_fac"}])
    refused(
        path,
        "channel ay_fac of the setup is not in the record; did you mean ay_face? "
        "channels here: ay_face",
        misspelt,
    )


@pytest.mark.parametrize(("dtype", "pieces"), [("f8", 5), ("i2", 1)])
def test_a_long_record_stays_in_its_file(tmp_path, monkeypatch, dtype, pieces):
    monkeypatch.setattr(tdms, "EAGER_BYTES", 0)
    samples = np.arange(1000).astype(dtype)
    path = write(tmp_path / "p.tdms", ("g", "ay", samples, CLOCK), pieces=pieces)
    ay = open_acquisition(path)["ay"]
    gc.collect()  # the file stays open for as long as the samples are there
    assert isinstance(ay.samples, LazySamples)
    for start, stop in ((0, 1000), (195, 405), (999, 1000), (5, 5)):
        found = ay.samples[start:stop]
        assert found.dtype == np.dtype(dtype)
        np.testing.assert_array_equal(found, samples[start:stop])


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.95])
def test_a_file_cut_short_is_one_sentence(tmp_path, capfd, share):
    path = write(tmp_path / "p.tdms", ("g", "ay", np.arange(500.0), CLOCK), pieces=2)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(
        RecordingError, match=r"cut short|damaged|no channels with samples"
    ) as caught:
        open_acquisition(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ([], "no channels with samples; check that they were recorded"),
        ([("g", "ay", np.arange(3.0), {"wf_increment": -1.0})],
         "channel ay: wf_increment is -1; expected seconds above zero"),
        ([("g", "t", np.array([0, 1, 2.7]), {}), ("g", "ay", np.arange(3.0), {})],
         "channel t: times are irregular"),
        ([("g", "t", np.arange(4.0), {}), ("g", "ay", np.arange(3.0), {})],
         "channel t: 4 times for 3 samples; export the record again"),
        ([("g", "note", np.array(["a"]), {})], "no channels; check that they were recorded"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_one_sentence(tmp_path, channels, message):
    refused(write(tmp_path / "p.tdms", *channels), message)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "p.tdms"
    path.write_bytes(b"nothing of the kind")
    refused(path, "not a TDMS file or damaged (")


def test_raw_counts_of_a_real_file_are_scaled():
    path = recording("das/raw1.tdms")
    record = open_acquisition(path)
    assert list(record.channels)[:2] == ["First  Channel", "Second Chan"]
    with nptdms.TdmsFile.open(path) as file:
        for channel in file["Layer Data"].channels():
            found = record[channel.name]
            slope = channel.properties["NI_Scale[1]_Linear_Slope"]
            np.testing.assert_allclose(
                found.samples, channel.read_data(scaled=False)[0] * slope, rtol=1e-12
            )
            assert (found.rate_hz, found.start_s, found.units) == (50000.0, 0.0, "V")


def test_a_real_big_endian_file(monkeypatch):
    path = recording("das/big_endian.tdms")
    record = open_acquisition(path)
    sweep = record["Amplitude sweep"]
    assert (sweep.rate_hz, sweep.start_s, len(sweep)) == (1000.0, 0.0, 3500)
    assert sweep.samples.dtype.isnative
    monkeypatch.setattr(tdms, "EAGER_BYTES", 0)
    again = open_acquisition(path)["Amplitude sweep"].samples
    np.testing.assert_array_equal(again[1200:1900], sweep.samples[1200:1900])
