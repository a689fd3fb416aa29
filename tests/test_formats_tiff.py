"""TIFF stacks written by tifffile: round trips, damage, and what is no grey stack."""

import re
import struct

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from mutated import complaint_about, spoil

from glint_aoa.errors import RecordingError
from glint_aoa.records.formats import open_fields

FIELDS = arrays(
    st.sampled_from(["u1", "u2"]), array_shapes(min_dims=3, max_dims=3, min_side=1, max_side=6)
)


def noisy_fields(shape=(5, 12, 20), dtype=np.uint8):
    return np.random.default_rng(3).integers(0, 200, shape, dtype)


def write_pages(path, fields, **options):
    with tifffile.TiffWriter(path, **options.pop("writer", {})) as tiff:
        for field in fields:
            tiff.write(field, contiguous=False, photometric="minisblack", **options)


def read_all(path):
    stack = open_fields(path)
    return stack.read(0, len(stack))


def assert_refused(path, message):
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        read_all(path)


@settings(max_examples=40)
@given(
    fields=FIELDS,
    compression=st.sampled_from([None, "zlib"]),
    byteorder=st.sampled_from("<>"),
    bigtiff=st.booleans(),
)
def test_round_trip_page_by_page(tmp_path_factory, fields, compression, byteorder, bigtiff):
    path = tmp_path_factory.mktemp("tiff") / "a.tif"
    writer = {"byteorder": byteorder, "bigtiff": bigtiff}
    write_pages(path, fields, compression=compression, writer=writer)
    stack = open_fields(path)
    assert (stack.shape, stack.dtype) == (fields.shape, fields.dtype)
    for start, block in stack.blocks(2):
        np.testing.assert_array_equal(block, fields[start : start + 2])
    np.testing.assert_array_equal(stack.read(0, 1), fields[:1])


@pytest.mark.parametrize("name", ["a.tif", "a.TIFF"])
def test_stack_written_in_one_call(tmp_path, name):
    fields = noisy_fields(dtype=np.uint16)
    tifffile.imwrite(tmp_path / name, fields, photometric="minisblack")
    np.testing.assert_array_equal(open_fields(tmp_path / name).read(0, 5), fields)


def test_large_stack_of_imagej_describes_its_first_page_only(tmp_path):
    path = tmp_path / "a.tif"
    fields = noisy_fields(dtype=np.uint16)
    with tifffile.TiffWriter(path, imagej=True) as tiff:
        tiff.write(fields, photometric="minisblack", metadata={"axes": "TYX"})
    content = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as tiff:
        assert len(tiff.pages) == 5
        first = tiff.pages[0]
        (n_tags,) = struct.unpack(">H", content[first.offset : first.offset + 2])
        after = first.offset + 2 + 12 * n_tags
    content[after : after + 4] = bytes(4)  # as ImageJ ends the chain beyond 4 GB
    path.write_bytes(content)
    stack = open_fields(path)
    assert stack.shape == fields.shape
    np.testing.assert_array_equal(stack.read(1, 4), fields[1:4])


def test_tiled_pages(tmp_path):
    fields = noisy_fields((2, 40, 50))
    write_pages(tmp_path / "a.tif", fields, tile=(16, 16))
    np.testing.assert_array_equal(open_fields(tmp_path / "a.tif").read(0, 2), fields)


def test_colour_becomes_luma_or_the_channel_that_is_told(tmp_path):
    path = tmp_path / "a.tif"
    colour = np.random.default_rng(4).integers(0, 65536, (4, 8, 9, 3), np.uint16)
    tifffile.imwrite(path, colour, photometric="rgb")
    luma = np.rint(colour @ np.array([0.299, 0.587, 0.114], np.float32))
    np.testing.assert_array_equal(read_all(path), luma)
    for number, name in enumerate(["red", "green", "blue"]):
        (tmp_path / "a.tif.toml").write_text(f'channel = "{name}"')
        np.testing.assert_array_equal(read_all(path), colour[..., number])
    assert open_fields(path).notes == ("colour: the blue channel was taken",)


def test_colour_in_planes_is_refused(tmp_path):
    path = tmp_path / "a.tif"
    fields = np.zeros((4, 3, 8, 9), np.uint8)
    tifffile.imwrite(path, fields, photometric="rgb", planarconfig="separate")
    assert_refused(
        path,
        "page 0 is RGB with 3 samples a pixel, expected grey (MINISBLACK) or RGB; "
        "export the recording again as grey",
    )


def test_imagej_states_the_rate(tmp_path):
    path, fields = tmp_path / "a.tif", noisy_fields()
    words = {"axes": "TYX", "finterval": 20.0, "tunit": "ms"}
    tifffile.imwrite(path, fields, imagej=True, metadata=words)
    assert open_fields(path).info.rate_hz == 50.0
    np.testing.assert_array_equal(read_all(path), fields)


def test_ome_states_rate_and_bits(tmp_path):
    path, fields = tmp_path / "a.ome.tif", noisy_fields(dtype=np.uint16)
    words = {
        "axes": "TYX",
        "TimeIncrement": 0.5,
        "TimeIncrementUnit": "ms",
        "SignificantBits": 12,
    }
    tifffile.imwrite(path, fields, ome=True, photometric="minisblack", metadata=words)
    stack = open_fields(path)
    assert (stack.info.rate_hz, stack.white_level) == (2000.0, 4095)
    np.testing.assert_array_equal(read_all(path), fields)


@pytest.mark.parametrize("axes", ["CYX", "ZYX", "TYX"])
@pytest.mark.parametrize("kind", ["imagej", "ome"])
def test_a_sequence_by_any_name_is_one(tmp_path, axes, kind):
    """Programs that do not ask call the images of a stack channels."""
    path, fields = tmp_path / "a.tif", noisy_fields()
    options = {kind: True, "metadata": {"axes": axes}}
    tifffile.imwrite(path, fields, photometric="minisblack", **options)
    np.testing.assert_array_equal(read_all(path), fields)


@pytest.mark.parametrize(
    ("shape", "axes", "sizes"),
    [
        ((5, 2, 6, 7), "TCYX", "2 channels, 1 depths and 5 times"),
        ((5, 2, 6, 7), "TZYX", "1 channels, 2 depths and 5 times"),
    ],
)
@pytest.mark.parametrize("who", ["ImageJ", "OME"])
def test_what_is_no_single_sequence_is_refused(tmp_path, shape, axes, sizes, who):
    path = tmp_path / "a.tif"
    kind = {"imagej": True} if who == "ImageJ" else {"ome": True}
    fields = np.zeros(shape, np.uint8)
    tifffile.imwrite(path, fields, photometric="minisblack", metadata={"axes": axes}, **kind)
    assert_refused(path, f"{who} says {sizes}, expected one sequence; ")


def test_pages_in_other_files_are_not_followed(tmp_path):
    path = tmp_path / "a.ome.tif"
    words = {"axes": "TYX"}
    tifffile.imwrite(path, noisy_fields(), ome=True, photometric="minisblack", metadata=words)
    content = path.read_bytes()
    path.write_bytes(
        content.replace(b'SizeT="5"', b'SizeT="9"').replace(b'SizeZ="5"', b'SizeZ="9"')
    )
    assert_refused(path, "its description speaks of 9 images, the file has 5; others may lie in ")


@pytest.mark.parametrize("text", ["<!DOCTYPE a>", '<!DOCTYPE a [<!ENTITY b "c">]>'])
def test_a_description_with_entities_is_refused(tmp_path, text):
    path = tmp_path / "a.ome.tif"
    ome = f'<?xml version="1.0"?>{text}<OME><Image><Pixels SizeT="5"/></Image></OME>'
    tifffile.imwrite(path, noisy_fields(), photometric="minisblack", description=ome, metadata=None)
    assert_refused(path, "its OME description is not one (too long, or with entities); ")


def test_inverted_grey_is_refused(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, noisy_fields(), photometric="miniswhite")
    assert_refused(path, "page 0 is MINISWHITE with 1 samples a pixel")


def test_floats_are_refused(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.zeros((4, 8, 9), np.float32), photometric="minisblack")
    assert_refused(path, "grey levels are float32, expected uint8 or uint16")


def test_pages_of_other_size_are_named(tmp_path):
    path = tmp_path / "a.tif"
    write_pages(
        path, [np.zeros((4, 6), np.uint8), np.zeros((4, 6), np.uint8), np.zeros((4, 7), np.uint8)]
    )
    assert_refused(path, "page 2 cannot be read: it is uint8 [4, 7], unlike the ones before")


def test_garbage_is_refused(tmp_path):
    path = tmp_path / "a.tif"
    path.write_bytes(b"no image at all")
    assert_refused(path, "not a TIFF file or damaged (")


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_a_stack_cut_short_is_refused_not_shortened(tmp_path, compression):
    path = tmp_path / "a.tif"
    write_pages(path, noisy_fields(), compression=compression)
    content = path.read_bytes()
    for length in range(100, len(content) - 1, 97):
        path.write_bytes(content[:length])
        with pytest.raises(RecordingError, match=r"cannot be read|cannot be unpacked|damaged"):
            read_all(path)


def test_pages_in_a_circle_are_refused(tmp_path):
    path = tmp_path / "a.tif"
    write_pages(path, noisy_fields())
    with tifffile.TiffFile(path) as tiff:
        order, first, last = tiff.byteorder, tiff.pages[0].offset, tiff.pages[4].offset
    content = bytearray(path.read_bytes())
    (n_tags,) = struct.unpack(order + "H", content[last : last + 2])
    after = last + 2 + 12 * n_tags
    content[after : after + 4] = struct.pack(order + "I", first)
    path.write_bytes(content)
    assert_refused(path, "page 5 cannot be read: the chain of pages runs in a circle")


def test_a_page_that_claims_a_terabyte_fails_at_once(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.zeros((2, 20, 30), np.uint8), photometric="minisblack")
    with tifffile.TiffFile(path, mode="r+") as tiff:
        tiff.pages[0].tags["ImageWidth"].overwrite(1_000_000)
        tiff.pages[0].tags["ImageLength"].overwrite(1_000_000)
    assert_refused(path, "a field of 1000000 x 1000000 pixels is larger than any camera's")


def test_a_page_that_claims_more_than_the_file_holds_is_refused(tmp_path):
    path = tmp_path / "a.tif"
    write_pages(path, noisy_fields())
    with tifffile.TiffFile(path, mode="r+") as tiff:
        tiff.pages[0].tags["ImageWidth"].overwrite(5000)
    size = path.stat().st_size
    assert_refused(
        path, f"page 0 cannot be read: its pixels do not lie within the file's {size} bytes"
    )


@settings(max_examples=80)
@given(data=st.data())
def test_mutated_files_give_fields_or_our_own_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("fuzz") / "a.tif"
    compression = data.draw(st.sampled_from([None, "zlib"]))
    write_pages(path, np.arange(60, dtype=np.uint8).reshape(3, 4, 5), compression=compression)
    spoil(path, data)
    complaint = complaint_about(path)
    assert complaint is None or str(path) in complaint
