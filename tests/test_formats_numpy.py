"""NumPy files: round trips, and headers that lie."""

import io
import pickle
import re
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from mutated import complaint_about, spoil

from glint_aoa.errors import RecordingError
from glint_aoa.records.formats import numpy_files, open_fields

FIELDS = arrays(
    st.sampled_from(["u1", "<u2", ">u2"]), array_shapes(min_dims=3, max_dims=3, max_side=5)
)


def npy_bytes(array, **options):
    buffer = io.BytesIO()
    np.save(buffer, array, **options)
    return buffer.getvalue()


def header_only(shape, descr="|u1"):
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        buffer, {"descr": descr, "fortran_order": False, "shape": shape}
    )
    return buffer.getvalue()


def assert_refused(path, message):
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        open_fields(path)


@settings(max_examples=40)
@given(fields=FIELDS, fortran=st.booleans(), kind=st.sampled_from(["npy", "npz", "packed"]))
def test_round_trip_block_by_block(tmp_path_factory, fields, fortran, kind):
    path = tmp_path_factory.mktemp("numpy") / ("a.npy" if kind == "npy" else "a.npz")
    if fortran and kind != "packed":
        fields = np.asfortranarray(fields)
    if kind == "npy":
        np.save(path, fields)
    elif kind == "npz":
        np.savez(path, other=np.arange(9), fields=fields)
    else:
        np.savez_compressed(path, other=np.arange(9), fields=np.ascontiguousarray(fields))
    stack = open_fields(path)
    assert stack.shape == fields.shape
    assert stack.dtype == fields.dtype.newbyteorder("=")
    for start, block in stack.blocks(2):
        np.testing.assert_array_equal(block, fields[start : start + 2])
    np.testing.assert_array_equal(stack.read(0, 1), fields[:1])  # back to the front


def test_file_says_nothing_of_rate_and_window(tmp_path):
    np.save(tmp_path / "a.npy", np.ones((2, 3, 4), np.uint8))
    stack = open_fields(str(tmp_path / "a.npy"))
    assert (stack.name, stack.info.rate_hz, stack.info.interlaced) == ("a", None, None)


def test_a_claim_of_a_terabyte_fails_at_once(tmp_path):
    path = tmp_path / "a.npy"
    content = header_only((10**6, 1000, 1000))
    path.write_bytes(content + b"\0" * 100)
    assert_refused(
        path,
        f"its header promises fields [1000000, 1000, 1000] of uint8, {10**12 + len(content)} "
        f"bytes, but the file has {len(content) + 100}; it is cut short, record or copy it again",
    )


def test_a_stack_cut_short_is_refused(tmp_path):
    path = tmp_path / "a.npy"
    path.write_bytes(npy_bytes(np.ones((5, 4, 3), np.uint16))[:-1])
    assert_refused(path, "its header promises fields [5, 4, 3] of uint16")


def test_a_file_that_shrinks_after_opening_is_noticed(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.ones((5, 4, 3), np.uint8))
    stack = open_fields(path)
    path.write_bytes(path.read_bytes()[:-12])
    with pytest.raises(RecordingError, match=re.escape("fields 0 to 4 came as uint8 [4, 4, 3]")):
        stack.read(0, 5)


class _Bomb:
    def __reduce__(self):
        return (pytest.fail, ("unpickled",))


def test_pickles_are_never_opened(tmp_path):
    objects = np.empty((1, 1, 1), object)
    objects[0, 0, 0] = _Bomb()
    npy, npz, bare = tmp_path / "a.npy", tmp_path / "a.npz", tmp_path / "b.npy"
    np.save(npy, objects, allow_pickle=True)
    np.savez(npz, fields=objects)
    bare.write_bytes(pickle.dumps(_Bomb()))
    assert_refused(npy, "grey levels are object, expected uint8 or uint16")
    assert_refused(npz, "grey levels are object, expected uint8 or uint16")
    assert_refused(bare, "not a NumPy array (ValueError: the magic string is not correct")


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((2, 3, 4)), "grey levels are float64, expected uint8 or uint16"),
        (np.zeros((3, 4), np.uint8), "the array has shape [3, 4], expected grey fields"),
        (np.zeros((0, 3, 4), np.uint8), "the stack is empty (shape [0, 3, 4])"),
        (np.zeros((2, 3, 4), "u1,u1"), "grey levels are "),
    ],
)
@pytest.mark.parametrize("suffix", ["npy", "npz"])
def test_other_arrays_are_refused(tmp_path, array, message, suffix):
    path = tmp_path / f"a.{suffix}"
    np.save(path, array) if suffix == "npy" else np.savez(path, fields=array)
    assert_refused(path, message)


def test_garbage_is_refused(tmp_path):
    for name in ("a.npy", "a.npz"):
        (tmp_path / name).write_bytes(b"no array at all")
    assert_refused(tmp_path / "a.npy", "not a NumPy array (")
    assert_refused(
        tmp_path / "a.npz",
        "not a .npz file (File is not a zip file); save the fields with numpy.savez",
    )


def test_negative_shape_is_refused(tmp_path):
    path = tmp_path / "a.npy"
    path.write_bytes(header_only((-1, 3, 4)) + b"\0" * 99)
    assert_refused(path, "the stack is empty (shape [-1, 3, 4])")


def test_archive_without_fields_names_its_arrays(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, frames=np.zeros(3), time=np.zeros(2))
    assert_refused(
        path, "no array fields, found frames, time; save with numpy.savez(file, fields=...)"
    )


def write_member(path, content, compression=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", compression) as archive:
        archive.writestr("fields.npy", content)


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_archive_whose_array_claims_more_than_is_there_is_refused(tmp_path, compression):
    path = tmp_path / "a.npz"
    content = header_only((10**6, 1000, 1000)) + b"\0" * 1000
    write_member(path, content, compression)
    assert_refused(
        path,
        f"array fields promises {10**12 + len(content) - 1000} bytes but the archive gives "
        f"{len(content)}; the file is damaged, save it again",
    )


def test_zip_bomb_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(numpy_files, "_LARGE", 1 << 24)
    path = tmp_path / "a.npz"
    np.savez_compressed(path, fields=np.zeros((17, 1024, 1024), np.uint8))
    assert path.stat().st_size < 1 << 17
    assert_refused(path, "array fields claims to unpack from ")


def test_unusual_packing_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    write_member(path, npy_bytes(np.ones((2, 3, 4), np.uint8)), zipfile.ZIP_BZIP2)
    assert_refused(path, "array fields is encrypted or packed in a way that NumPy does not use")


def test_packed_fortran_order_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, fields=np.asfortranarray(np.ones((2, 3, 4), np.uint8)))
    assert_refused(
        path,
        "array fields is compressed in Fortran order, expected C order; "
        "save numpy.ascontiguousarray(fields)",
    )


def test_damaged_archive_says_so(tmp_path):
    path = tmp_path / "a.npz"
    fields = np.random.default_rng(1).integers(0, 256, (20, 30, 40), np.uint8)
    np.savez_compressed(path, fields=fields)
    content = bytearray(path.read_bytes())
    content[5000:5100] = bytes(100)
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="the file is damaged"):
        open_fields(path).read(0, 20)


@settings(max_examples=80)
@given(data=st.data(), suffix=st.sampled_from(["npy", "npz"]))
def test_mutated_files_give_fields_or_our_own_error(tmp_path_factory, data, suffix):
    path = tmp_path_factory.mktemp("fuzz") / f"a.{suffix}"
    fields = np.arange(60, dtype=np.uint8).reshape(3, 4, 5)
    np.save(path, fields) if suffix == "npy" else np.savez_compressed(path, fields=fields)
    spoil(path, data)
    complaint = complaint_about(path)
    assert complaint is None or str(path) in complaint
