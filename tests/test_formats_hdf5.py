"""HDF5 points written with h5py: attributes of every spelling, links, lies and setups."""

import re
import tracemalloc

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mutated import complaint_about, spoil

from glint_aoa.errors import RecordingError
from glint_aoa.records.acquisition import LazySamples
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.formats import open_fields
from glint_aoa.records.formats.hdf5 import has_acquisition, has_fields, read_acquisition, read_truth
from glint_aoa.setup import Inertial


def noisy_fields(shape=(5, 4, 6), dtype=np.uint8):
    return np.random.default_rng(3).integers(0, 200, shape, dtype)


@pytest.fixture
def point(tmp_path):
    """Return a point with fields and two channels, open for more."""
    with h5py.File(tmp_path / "p.h5", "w", track_order=True) as file:
        file["fields"] = noisy_fields()
        das = file.create_group("das", track_order=True)
        for name in ("zeta", "alpha"):
            das[name] = np.arange(8, dtype=np.int16)
            das[name].attrs["rate_hz"] = 800.0
        yield file


def reopen(point):
    path = point.filename
    point.close()
    return open_fields(path)


def assert_refused(point, message):
    path = point.filename
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        reopen(point)


def record_of(point, *channels):
    path = point.filename
    point.close()
    return read_acquisition(path, Inertial(channel=channels) if channels else None)


def assert_record_refused(point, message, *channels):
    path = point.filename
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        record_of(point, *channels)


def said(name="alpha", **keys):
    return {"name": name, "quantity": "acceleration", "units": "m/s^2", **keys}


@settings(max_examples=30)
@given(
    dtype=st.sampled_from(["u1", "<u2", ">u2"]),
    shape=st.tuples(st.integers(1, 5), st.integers(1, 5), st.integers(1, 5)),
    compression=st.sampled_from([None, "gzip", "lzf"]),
    chunked=st.booleans(),
)
def test_round_trip_block_by_block(tmp_path_factory, dtype, shape, compression, chunked):
    path = tmp_path_factory.mktemp("hdf5") / "p.hdf5"
    fields = noisy_fields(shape, np.dtype(dtype).newbyteorder("=")).astype(dtype)
    chunks = (1, *shape[1:]) if chunked or compression else None
    with h5py.File(path, "w") as file:
        file.create_dataset("fields", data=fields, chunks=chunks, compression=compression)
    stack = open_fields(path)
    assert stack.dtype == np.dtype(dtype).newbyteorder("=")
    for start, block in stack.blocks(2):
        np.testing.assert_array_equal(block, fields[start : start + 2])


@pytest.mark.parametrize(
    "attributes",
    [
        {"rate_hz": 60.0, "first_line": 98, "first_parity": "odd", "interlaced": True},
        {"rate_hz": np.float32(60), "first_line": np.uint8(98), "first_parity": np.bytes_("odd"),
         "interlaced": np.int8(1)},
        {"rate_hz": np.array([60]), "first_line": np.array([[98.0]]),
         "first_parity": np.array(["odd"], "S"), "interlaced": np.array(True)},
    ],
)  # fmt: skip
def test_attributes_of_every_spelling(point, attributes):
    point["fields"].attrs.update(attributes)
    expected = FieldInfo(rate_hz=60.0, first_line=98, first_parity="odd", interlaced=True)
    assert reopen(point).info == expected


def test_missing_attributes_are_none(point):
    stack = reopen(point)
    assert stack.info == FieldInfo()
    assert stack.times_s is None
    assert dict(stack.meta) == {}


def test_times_and_meta(point):
    point["fields_time"] = np.arange(5) / 60
    point.create_group("meta").attrs.update(
        {"run": "3", "point": np.bytes_("12"), "seed": np.int64(7), "range": [1.5, 2.5]}
    )
    stack = reopen(point)
    np.testing.assert_array_equal(stack.times_s, np.arange(5) / 60)
    assert dict(stack.meta) == {"run": "3", "point": "12", "seed": 7, "range": [1.5, 2.5]}
    assert type(stack.meta["seed"]) is int


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("rate_hz", -60.0, "rate_hz is -60.0; expected a number greater than zero [Hz]"),
        ("rate_hz", "fast", "rate_hz is 'fast'; expected a number greater than zero [Hz]"),
        ("rate_hz", [50.0, 60.0], "rate_hz is [50.0, 60.0]; expected a number greater"),
        ("first_parity", "top", 'first_parity is \'top\'; expected "even" or "odd"'),
        ("first_line", -1, "first_line is -1; expected a whole number from 0"),
        ("trigger_time", "noon", "trigger_time is 'noon'; expected a time in ISO 8601"),
    ],
)
def test_wrong_attributes_are_named(point, name, value, message):
    point["fields"].attrs[name] = value
    assert_refused(point, f"/fields attribute {message}")


def test_times_must_match(point):
    point["fields_time"] = np.arange(4) / 60
    assert_refused(point, "fields_time has shape [4], expected one time for each of the 5 fields")


def test_file_without_fields_names_what_it_has(point):
    del point["fields"]
    assert_refused(
        point,
        "no dataset /fields, found das; store the fields as /fields [field, line, column]",
    )


def test_fields_that_are_a_group(point):
    del point["fields"]
    point.create_group("fields")
    assert_refused(point, "/fields is no array; store it as a dataset")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (np.zeros((2, 3, 4)), "grey levels are float64, expected uint8 or uint16"),
        (np.zeros((3, 4), np.uint8), "the array has shape [3, 4], expected grey fields"),
        (np.zeros((0, 3, 4), np.uint8), "the stack is empty (shape [0, 3, 4])"),
        (h5py.Empty("u1"), "/fields is no array; store it as a dataset"),
        ("text", "the array has shape [], expected grey fields"),
    ],
)
def test_other_fields_are_refused(point, data, message):
    del point["fields"]
    point["fields"] = data
    assert_refused(point, message)


@pytest.mark.parametrize(
    "link", [h5py.ExternalLink("other.h5", "/fields"), h5py.SoftLink("/elsewhere/fields")]
)
def test_links_are_not_followed(point, link):
    with h5py.File(point.filename.replace("p.h5", "other.h5"), "w") as other:
        other["fields"] = noisy_fields()
    del point["fields"]
    point["fields"] = link
    assert_refused(
        point,
        "/fields is a link, and links are not followed; store the data in the file itself",
    )


def test_linked_channel_and_group_are_refused(point):
    point["das"]["beta"] = h5py.ExternalLink("other.h5", "/x")
    assert_record_refused(point, "/das/beta is a link, and links are not followed")


def test_data_in_other_files_is_refused(point, tmp_path):
    del point["fields"]
    (tmp_path / "secret").write_bytes(bytes(60))
    point.create_dataset(
        "fields", (2, 5, 6), np.uint8, external=[(str(tmp_path / "secret"), 0, 60)]
    )
    assert_refused(point, "/fields keeps its data in other files, which are not followed")


def test_virtual_dataset_is_refused(point):
    del point["fields"]
    layout = h5py.VirtualLayout((5, 4, 6), np.uint8)
    layout[:] = h5py.VirtualSource("other.h5", "fields", (5, 4, 6), np.uint8)
    point.create_virtual_dataset("fields", layout)
    assert_refused(point, "/fields keeps its data in other files, which are not followed")


@pytest.mark.parametrize("chunks", [None, (1, 1000, 1000)])
def test_a_claim_of_a_terabyte_fails_at_once(point, chunks):
    del point["fields"]
    point.create_dataset("fields", (10**6, 1000, 1000), np.uint8, chunks=chunks)
    tracemalloc.start()
    try:
        assert_refused(
            point,
            "/fields promises [1000000, 1000, 1000] of uint8, but the file stores less; "
            "it is cut short, record or copy it again",
        )
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_huge_chunks_are_refused(point):
    del point["fields"]
    fields = point.create_dataset(
        "fields", (1, 100, 100), np.uint8, chunks=(1000, 1000, 1000), maxshape=(None,) * 3,
        compression="gzip",
    )  # fmt: skip
    fields.id.write_direct_chunk((0, 0, 0), b"damaged")
    assert_refused(
        point, "/fields is stored in chunks of [1000, 1000, 1000], too large to read piece by piece"
    )


def test_garbage_and_cut_files_are_refused(point, tmp_path):
    path = point.filename
    point.close()
    content = (tmp_path / "p.h5").read_bytes()
    for damaged in (b"no HDF5 at all", content[: len(content) // 2]):
        (tmp_path / "p.h5").write_bytes(damaged)
        with pytest.raises(
            RecordingError, match="^" + re.escape(f"{path}: not an HDF5 file or damaged (")
        ):
            open_fields(path)


def test_acquisition_keeps_the_order_of_the_file(point):
    point["das/alpha"].attrs.update(
        start_s=-0.5, quantity="acceleration", units=np.bytes_("g_0"), scale=0.001,
        station_m=0.9, axis="+y", range=[-5.0, 5.0],
    )  # fmt: skip
    path = point.filename
    record = record_of(point)
    assert has_acquisition(path)
    assert (record.name, list(record.channels)) == ("p", ["zeta", "alpha"])
    alpha = record["alpha"]
    assert (alpha.rate_hz, alpha.start_s, alpha.quantity) == (800.0, -0.5, "acceleration")
    assert (alpha.units, alpha.scale, alpha.station_m) == ("g_0", 0.001, 0.9)
    assert (alpha.axis, alpha.limits) == ("+y", (-5.0, 5.0))
    np.testing.assert_array_equal(alpha.samples, np.arange(8))
    assert alpha.samples.dtype == np.int16
    zeta = record["zeta"]
    assert (zeta.start_s, zeta.quantity, zeta.units, zeta.scale) == (0.0, None, None, 1.0)
    assert (zeta.station_m, zeta.axis, zeta.limits) == (None, None, None)


def test_setup_completes_what_the_record_does_not_say(point):
    point["das/alpha"].attrs["scale"] = 0.5
    alpha = record_of(point, said(station="900 mm", axis="+y", range=("-100 m/s^2", "100 m/s^2")))[
        "alpha"
    ]
    assert (alpha.quantity, alpha.units, alpha.scale) == ("acceleration", "m/s^2", 0.5)
    assert (alpha.station_m, alpha.axis, alpha.limits) == (0.9, "+y", (-100.0, 100.0))


def test_record_and_setup_may_say_the_same(point):
    point["das/alpha"].attrs.update(units="m/s**2", station_m=0.9, quantity="acceleration")
    assert record_of(point, said(station="0.9 m"))["alpha"].units == "m/s**2"


@pytest.mark.parametrize(
    ("key", "value", "spoken", "message"),
    [
        ("units", "g_0", {}, "units is g_0 in the record but m/s^2 in the setup"),
        ("units", "N", {}, "units is N in the record but m/s^2 in the setup"),
        ("quantity", "force", {}, "quantity is force in the record but acceleration in the setup"),
        ("scale", 2.0, {"scale": 1.0}, "scale is 2.0 in the record but 1.0 in the setup"),
        ("axis", "+z", {"axis": "-z"}, "axis is +z in the record but -z in the setup"),
        ("station_m", 0.9, {"station": "90 mm"}, "station_m is 0.9 in the record but 0.09 in"),
        ("range", [-1.0, 1.0], {"range": ("-1 m/s^2", "2 m/s^2")},
         "range is (-1.0, 1.0) in the record but (-1.0, 2.0) in the setup"),
    ],
)  # fmt: skip
def test_record_and_setup_that_differ_are_an_error(point, key, value, spoken, message):
    point["das/alpha"].attrs[key] = value
    assert_record_refused(point, f"channel alpha: {message}", said(**spoken))


def test_channel_of_the_setup_that_is_not_recorded(point):
    assert_record_refused(
        point,
        "channel ay_face of the setup is not in the record; channels here: zeta, alpha",
        said("ay_face"),
    )


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("rate_hz", 0.0, "a number greater than zero"),
        ("rate_hz", None, "a number greater than zero"),
        ("start_s", "now", "a finite number"),
        ("scale", float("nan"), "a finite number"),
        ("station_m", "0.9 m", "a finite number"),
        ("axis", "y", "one of +x, -x, +y, -y, +z, -z"),
        ("units", "parsnip", "a unit as pint names it"),
        ("range", [1.0, -1.0], "least and greatest value"),
        ("range", 1.0, "least and greatest value"),
    ],
)
def test_wrong_channel_attributes_are_named(point, key, value, expected):
    attributes = point["das/alpha"].attrs
    attributes.pop(key, None)
    if value is not None:
        attributes[key] = value
    assert_record_refused(
        point,
        f"channel alpha: attribute {key} is {value!r}, expected {expected}; "
        "correct it in the record",
    )


def test_a_channel_of_another_quantity_is_carried_along(point):
    point["das/alpha"].attrs["quantity"] = "voltage"
    record = record_of(point)
    assert record["alpha"].quantity == "voltage"
    assert record.with_quantity("acceleration") == []


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (np.zeros((2, 2)), "channel beta: samples are float64 of shape [2, 2]"),
        (np.zeros(0), "channel beta: no samples; check that it was recorded"),
        (np.array([b"a"]), "/das/beta holds |S1, expected numbers"),
    ],
)
def test_channels_that_are_no_signals_are_refused(point, data, message):
    point["das/beta"] = data
    point["das/beta"].attrs["rate_hz"] = 800.0
    assert_record_refused(point, message)


def test_channel_that_claims_a_terabyte_fails_at_once(point):
    point["das"].create_dataset("beta", (10**11,), "f8")
    assert_record_refused(point, "/das/beta promises [100000000000] of float64, but the file")


def test_samples_of_a_long_record_stay_in_the_file(point, monkeypatch):
    monkeypatch.setattr("glint_aoa.records.formats.hdf5.EAGER_BYTES", 31)
    path = point.filename
    alpha = record_of(point)["alpha"]
    assert isinstance(alpha.samples, LazySamples)
    assert (len(alpha), alpha.samples.dtype) == (8, np.dtype(np.int16))
    np.testing.assert_array_equal(alpha.samples[2:5], [2, 3, 4])
    with h5py.File(path, "a") as file:
        del file["das/alpha"]
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: ")):
        alpha.samples[0:1]


def test_truth_larger_than_memory_should_be_is_refused(point, monkeypatch):
    monkeypatch.setattr("glint_aoa.records.formats.hdf5.MAX_TRUTH_BYTES", 15)
    point["truth/pitch_deg"] = np.zeros(2)
    path = point.filename
    point.close()
    with pytest.raises(RecordingError, match=re.escape("/truth/pitch_deg and what stands before")):
        read_truth(path)


def test_rate_and_start_of_the_setup_where_the_record_is_silent(point):
    del point["das/alpha"].attrs["rate_hz"]
    point["das/zeta"].attrs["start_s"] = -1.0
    path = point.filename
    point.close()
    record = read_acquisition(path, Inertial(rate="800 Hz", start="-1 s"))
    assert (record["alpha"].rate_hz, record["alpha"].start_s) == (800.0, -1.0)
    with pytest.raises(RecordingError, match=re.escape("start is -1 s in the record but 0 s in")):
        read_acquisition(path, Inertial(rate="800 Hz", start="0 s"))
    with pytest.raises(RecordingError, match=re.escape("rate is 800 Hz in the record but 500 Hz")):
        read_acquisition(path, Inertial(rate="500 Hz", start="-1 s"))


def test_a_misspelt_channel_of_the_setup_is_told_the_nearest(point):
    assert_record_refused(
        point,
        "channel alhpa of the setup is not in the record; did you mean alpha? "
        "channels here: zeta, alpha",
        said("alhpa"),
    )


def test_file_without_acquisition(point):
    del point["das"]
    path = point.filename
    assert_record_refused(point, "no group /das; record the acquisition channels with the fields")
    assert not has_acquisition(path)
    assert has_fields(path)


def test_das_that_is_no_group(point):
    del point["das"]
    point["das"] = 1
    assert_record_refused(point, "/das is no group; store each channel as a dataset in it")


@settings(max_examples=80)
@given(data=st.data())
def test_mutated_files_give_fields_or_our_own_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("fuzz") / "p.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("fields", data=noisy_fields(), chunks=(1, 4, 6), compression="gzip")
        file["fields"].attrs["rate_hz"] = 60.0
        file["das/alpha"] = np.arange(8, dtype=np.int16)
        file["das/alpha"].attrs["rate_hz"] = 800.0
    spoil(path, data, least=path.stat().st_size // 2)
    complaints = [complaint_about(path)]
    try:
        read_acquisition(path)
    except RecordingError as error:
        complaints.append(str(error))
    assert all(str(path) in complaint for complaint in complaints if complaint is not None)


def heap_of(path):
    """Place of the heap, and of each of its objects with the bytes that it takes."""
    content = path.read_bytes()
    place = content.index(b"GCOL")
    at, objects = place + 16, []
    while int.from_bytes(content[at : at + 2], "little"):
        taken = int.from_bytes(content[at + 8 : at + 16], "little")
        objects.append((at, taken))
        at += 16 + -(-taken // 8) * 8
    return place, [*objects, (at, int.from_bytes(content[at + 8 : at + 16], "little"))]


def test_heaps_that_hdf5_would_follow_without_end_are_refused(tmp_path):
    path = tmp_path / "p.h5"
    with h5py.File(path, "w") as file:
        file["fields"] = noisy_fields()
        file["fields"].attrs.update({"first_parity": "even", "trigger_time": "2026-01-12T08:00:00"})
    whole = path.read_bytes()
    place, objects = heap_of(path)
    assert [taken for _, taken in objects[:-1]] == [4, 19]
    damaged = f"not an HDF5 file or damaged (the heap at byte {place} does not add up); "
    changes = [(at, taken + 8 * k) for at, taken in objects for k in (1000, 2**40)]
    changes += [(objects[-1][0], 0), (objects[-1][0], 16), (place, 0), (place, 2**50)]
    for number, (at, size) in enumerate(changes):
        content = bytearray(whole)
        content[at + 8 : at + 16] = size.to_bytes(8, "little")
        spoilt = tmp_path / f"p{number}.h5"
        spoilt.write_bytes(content)
        with pytest.raises(RecordingError, match=re.escape(f"{spoilt}: {damaged}")):
            open_fields(spoilt)
    assert open_fields(path).info.first_parity == "even"


def test_attributes_that_are_neither_numbers_nor_text_are_refused(point):
    rates = np.empty(1, h5py.vlen_dtype(np.float64))
    rates[0] = np.array([60.0, 60.0])
    point["fields"].attrs["rate_hz"] = rates
    assert_refused(
        point,
        "not an HDF5 file or damaged (attribute rate_hz of /fields is neither numbers nor text); "
        "record or copy it again",
    )
