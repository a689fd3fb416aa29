"""Recorded points: what is written is what is read, and a file is whole or not there."""

import re

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glint_aoa.errors import OutputError, RecordingError
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.formats import open_fields
from glint_aoa.records.formats.hdf5 import read_acquisition
from glint_aoa.records.points import RecordedPoint, read_truth, write_point

FIELDS = np.random.default_rng(5).integers(0, 256, (4, 6, 8), np.uint8)
INFO = FieldInfo(
    rate_hz=59.94,
    exposure_s=1e-3,
    first_line=98,
    first_column=0,
    first_parity="odd",
    interlaced=True,
    start_s=-0.1,
    trigger_time="2024-05-31T14:02:11+00:00",
)
CHANNELS = [
    Channel("zeta", np.arange(5, dtype=np.int16), 800.0),
    Channel(
        "ay_face",
        np.linspace(-1, 1, 7),
        800.0,
        -0.25,
        "acceleration",
        "m/s^2",
        0.5,
        0.9,
        "+y",
        (-100.0, 100.0),
    ),
]
META = {"run": "3", "point": "12", "nominal_angle_deg": 2.0, "seed": 7}


def whole_point(fields=FIELDS):
    record = AcquisitionRecord("p", {each.name: each for each in CHANNELS})
    truth = {"pose": np.ones((4, 5, 4, 4)), "pitch_deg": np.arange(4.0)}
    return RecordedPoint(fields, INFO, np.arange(4) / 59.94, record, truth, META)


@pytest.mark.parametrize("compress", [False, True])
def test_what_is_written_is_what_is_read(tmp_path, compress):
    path = tmp_path / "p.h5"
    write_point(path, whole_point(), compress=compress)
    stack = open_fields(path)
    np.testing.assert_array_equal(stack.read(0, 4), FIELDS)
    np.testing.assert_array_equal(stack.times_s, np.arange(4) / 59.94)
    assert stack.info == INFO
    assert dict(stack.meta) == META
    record = read_acquisition(path)
    assert list(record.channels) == ["zeta", "ay_face"]
    assert dict(record.meta) == META
    for channel in CHANNELS:
        back = record[channel.name]
        np.testing.assert_array_equal(back.samples, channel.samples)
        assert {**vars(back), "samples": 0} == {**vars(channel), "samples": 0}
    truth = read_truth(path)
    assert list(truth) == ["pose", "pitch_deg"]
    np.testing.assert_array_equal(truth["pitch_deg"], np.arange(4.0))
    assert [each.name for each in tmp_path.iterdir()] == ["p.h5"]


def test_layout_is_that_of_the_file_contract(tmp_path):
    write_point(tmp_path / "p.h5", whole_point())
    with h5py.File(tmp_path / "p.h5") as file:
        assert set(file) == {"fields", "fields_time", "das", "truth", "meta"}
        assert file["fields"].chunks == (1, 6, 8)
        assert set(file["fields"].attrs) == set(vars(INFO))
        assert set(file["das/ay_face"].attrs) == {
            "rate_hz", "start_s", "quantity", "units", "scale", "station_m", "axis", "range",
        }  # fmt: skip
        assert set(file["das/zeta"].attrs) == {"rate_hz", "start_s", "scale"}
        assert file["meta"].attrs["run"] == "3"


def test_point_without_fields_or_truth(tmp_path):
    path = tmp_path / "p.h5"
    record = AcquisitionRecord("p", {"zeta": CHANNELS[0]})
    write_point(path, RecordedPoint(acquisition=record))
    assert list(read_acquisition(path).channels) == ["zeta"]
    assert read_truth(path) == {}
    with pytest.raises(RecordingError, match="no dataset /fields, found das, meta"):
        open_fields(path)


@settings(max_examples=25)
@given(
    dtype=st.sampled_from(["u1", "u2"]),
    shape=st.tuples(st.integers(1, 4), st.integers(1, 5), st.integers(1, 5)),
    rate_hz=st.floats(1e-3, 1e6),
    parity=st.sampled_from(["even", "odd", None]),
    samples=st.lists(st.floats(allow_nan=True), min_size=1, max_size=5),
)
def test_round_trip(tmp_path_factory, dtype, shape, rate_hz, parity, samples):
    path = tmp_path_factory.mktemp("points") / "p.h5"
    fields = np.random.default_rng(1).integers(0, np.iinfo(dtype).max, shape, dtype)
    info = FieldInfo(rate_hz=rate_hz, first_parity=parity)
    record = AcquisitionRecord("p", {"ä b": Channel("ä b", np.array(samples), rate_hz)})
    write_point(path, RecordedPoint(fields, info, acquisition=record))
    stack = open_fields(path)
    assert stack.info == info
    np.testing.assert_array_equal(stack.read(0, shape[0]), fields)
    np.testing.assert_array_equal(read_acquisition(path)["ä b"].samples, samples)


def test_existing_point_is_not_overwritten(tmp_path):
    path = tmp_path / "p.h5"
    write_point(path, whole_point())
    message = f"{path}: exists already; choose another name or allow overwriting"
    with pytest.raises(OutputError, match="^" + re.escape(message) + "$"):
        write_point(path, whole_point(255 - FIELDS))
    np.testing.assert_array_equal(open_fields(path).read(0, 4), FIELDS)
    write_point(path, whole_point(255 - FIELDS), overwrite=True)
    np.testing.assert_array_equal(open_fields(path).read(0, 4), 255 - FIELDS)


def test_point_that_cannot_be_written_leaves_nothing(tmp_path):
    path = tmp_path / "nowhere" / "p.h5"
    with pytest.raises(OutputError, match="^" + re.escape(f"{path}: cannot be written (")):
        write_point(path, whole_point())


def test_failure_half_way_leaves_the_old_point(tmp_path):
    path = tmp_path / "p.h5"
    write_point(path, whole_point())
    bad = RecordedPoint(255 - FIELDS, INFO, meta={"run": object()})
    with pytest.raises(TypeError):
        write_point(path, bad, overwrite=True)
    np.testing.assert_array_equal(open_fields(path).read(0, 4), FIELDS)
    assert [each.name for each in tmp_path.iterdir()] == ["p.h5"]


@pytest.mark.parametrize(
    ("point", "message"),
    [
        (RecordedPoint(FIELDS.astype(float)), "grey levels are float64, expected uint8 or uint16"),
        (RecordedPoint(FIELDS[0]), "the array has shape [6, 8], expected grey fields"),
        (RecordedPoint(FIELDS, fields_time_s=np.zeros(3)), "fields_time has shape [3]"),
    ],
)
def test_what_could_not_be_read_back_is_not_written(tmp_path, point, message):
    path = tmp_path / "p.h5"
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        write_point(path, point)
    assert list(tmp_path.iterdir()) == []


def test_truth_of_a_missing_file(tmp_path):
    with pytest.raises(RecordingError, match="no such file; check its name and folder"):
        read_truth(tmp_path / "p.h5")
