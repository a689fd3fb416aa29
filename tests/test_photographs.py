"""Pictures of a board: frames, fields, recordings, windows of the sensor, and what is refused."""

import re

import cv2
import numpy as np
import pytest
import tifffile

from calibration.photographs import Photograph, photographs
from glint_aoa.errors import CalibrationError, RecordingError
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.setup import Fields


@pytest.fixture
def grey():
    return np.random.default_rng(6).integers(0, 256, (80, 60), dtype=np.uint8)


def written(path, image):
    assert cv2.imwrite(str(path), image)
    return path


def recording(path, fields, **said):
    point = RecordedPoint(
        fields=fields,
        info=FieldInfo(**said),
        fields_time_s=None,
        acquisition=None,
        truth={},
        meta={},
    )
    write_point(path, point)
    return path


def taken(paths, **how):
    return list(photographs(paths, **how))


class TestScan:
    @pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".PNG"])
    def test_a_frame_is_one_picture(self, suffix, grey, tmp_path):
        path = written(tmp_path / f"a{suffix}", grey)
        (one,) = taken([path])
        np.testing.assert_array_equal(one.grey, grey)
        assert (one.name, one.source, one.parity) == (path.name, str(path), 0)

    def test_colour_becomes_grey_and_sixteen_bits_stay(self, grey, tmp_path):
        colour = written(tmp_path / "c.png", np.repeat(grey[..., None], 3, axis=2))
        deep = written(tmp_path / "d.png", grey.astype(np.uint16) * 16)
        one, other = taken([colour, deep])
        np.testing.assert_allclose(one.grey, grey, atol=1)
        np.testing.assert_array_equal(other.grey, grey * 16.0)

    def test_an_interlaced_frame_is_two_fields(self, grey, tmp_path):
        """Even is the field with lines 0, 2, 4 ...; the odd one lies half a field line lower."""
        path = written(tmp_path / "a.png", grey)
        even, odd = taken([path], scan="interlaced")
        np.testing.assert_array_equal(even.grey, grey[::2])
        np.testing.assert_array_equal(odd.grey, grey[1::2])
        assert (even.parity, odd.parity) == (0, 1)
        assert (even.name, odd.name) == ("a.png (even field)", "a.png (odd field)")
        assert even.source == odd.source
        at = np.array([[7.0, 10.0]])
        np.testing.assert_array_equal(even.on_sensor(at), [[7.0, 10.0]])
        np.testing.assert_array_equal(odd.on_sensor(at), [[7.0, 10.5]])

    @pytest.mark.parametrize(("scan", "parity"), [("even", 0), ("odd", 1)])
    def test_a_single_field(self, scan, parity, grey, tmp_path):
        (one,) = taken([written(tmp_path / "a.png", grey)], scan=scan)
        assert one.parity == parity
        assert one.grey.shape == grey.shape

    def test_half_a_pair_of_fields_is_refused(self, grey, tmp_path):
        path = written(tmp_path / "a.png", grey[:-1])
        message = (
            f"{path}: 79 lines cannot be two fields; give frames as they were captured, not cut or "
            'scaled, or another scan than "interlaced"'
        )
        with pytest.raises(CalibrationError, match=re.escape(message)):
            taken([path], scan="interlaced")

    def test_an_unknown_scan_is_refused(self):
        message = 'scan is "both"; give one of progressive, interlaced, even, odd'
        with pytest.raises(CalibrationError, match=re.escape(message)):
            taken([], scan="both")


class TestRecordings:
    FIELDS = np.random.default_rng(5).integers(0, 256, (6, 40, 50), dtype=np.uint8)

    def test_a_board_at_rest_is_averaged_by_parity(self, tmp_path):
        path = recording(
            tmp_path / "p.h5", self.FIELDS, first_parity="odd", first_line=98, first_column=10
        )
        even, odd = taken([path])
        np.testing.assert_allclose(even.grey, self.FIELDS[1::2].mean(axis=0), rtol=1e-6)
        np.testing.assert_allclose(odd.grey, self.FIELDS[::2].mean(axis=0), rtol=1e-6)
        assert even.name == "p.h5 (mean even field)"
        assert even.source == odd.source == str(path)
        np.testing.assert_array_equal(odd.on_sensor(np.zeros((1, 2))), [[10.0, 98.5]])

    def test_progressive_frames_are_one_picture(self, tmp_path):
        path = recording(tmp_path / "p.h5", self.FIELDS, interlaced=False)
        (one,) = taken([path])
        np.testing.assert_allclose(one.grey, self.FIELDS.mean(axis=0), rtol=1e-6)
        assert (one.name, one.parity) == ("p.h5 (mean frame)", 0)

    def test_a_moving_board_is_taken_field_by_field(self, tmp_path):
        path = recording(tmp_path / "p.h5", self.FIELDS, first_parity="even")
        found = taken([path], every=3)
        assert [one.name for one in found] == ["p.h5 (field 0)", "p.h5 (field 3)"]
        assert [one.parity for one in found] == [0, 1]
        assert found[0].source != found[1].source
        np.testing.assert_array_equal(found[1].grey, self.FIELDS[3])

    def test_what_the_file_does_not_say_the_setup_or_the_scan_does(self, tmp_path):
        path = tmp_path / "p.npy"
        np.save(path, self.FIELDS)
        assert [one.parity for one in taken([path])] == [0]
        assert [one.parity for one in taken([path], scan="interlaced")] == [0, 1]
        assert [one.parity for one in taken([path], scan="odd")] == [1]
        said = Fields(interlaced=True, first_parity="odd", first_line=7)
        found = taken([path], fields=said, every=2)
        assert {one.parity for one in found} == {1}
        assert {one.first_line for one in found} == {7}

    def test_a_tiff_of_many_pages_is_a_recording(self, tmp_path):
        path = tmp_path / "stack.tif"
        tifffile.imwrite(path, self.FIELDS, photometric="minisblack")
        assert len(taken([path], every=1)) == 6

    def test_every_below_one_is_refused(self):
        message = "every is 0; give 1 to take each field, or more"
        with pytest.raises(CalibrationError, match=re.escape(message)):
            taken([], every=0)


class TestWindow:
    def test_a_picture_of_the_whole_sensor_begins_at_its_corner(self, grey, tmp_path):
        path = written(tmp_path / "a.png", grey)
        (one,) = taken([path], sensor=(60, 80), fields=Fields(first_line=5))
        assert (one.first_column, one.first_line) == (0, 0)

    def test_a_smaller_one_begins_where_the_setup_says(self, grey, tmp_path):
        path = written(tmp_path / "a.png", grey)
        (one,) = taken([path], sensor=(100, 90), fields=Fields(first_line=5, first_column=30))
        assert (one.first_column, one.first_line) == (30, 5)

    @pytest.mark.parametrize(
        ("sensor", "advice"),
        [
            ((60, 40), "these are frames of two fields: give --scan interlaced"),
            (
                (50, 80),
                "give pictures as the camera captured them, not scaled, or correct camera.sensor",
            ),
        ],
    )
    def test_one_that_does_not_fit_is_refused(self, sensor, advice, grey, tmp_path):
        path = written(tmp_path / "a.png", grey)
        message = (
            f"a.png: 60 x 80 pixels from column 0, line 0 do not fit a sensor of {sensor[0]} x "
            f"{sensor[1]}; {advice}"
        )
        with pytest.raises(CalibrationError, match=re.escape(message)):
            taken([path], sensor=sensor)


class TestRefusals:
    def test_pictures_of_two_sizes(self, grey, tmp_path):
        paths = [written(tmp_path / "a.png", grey), written(tmp_path / "b.png", grey[:, :50])]
        message = (
            "b.png has 50 x 80 pixels, a.png 60 x 80; give pictures of one camera in one mode, as "
            "it captured them"
        )
        with pytest.raises(CalibrationError, match=re.escape(message)):
            taken(paths)

    def test_the_same_picture_twice(self, grey, tmp_path):
        paths = [written(tmp_path / "a.png", grey), written(tmp_path / "b.png", grey)]
        message = f"{paths[1]} holds the same as {paths[0]}; give each picture of the board once"
        with pytest.raises(CalibrationError, match=re.escape(message)):
            taken(paths)

    def test_a_thumbnail(self, grey, tmp_path):
        path = written(tmp_path / "a.png", grey[:20, :20])
        message = "a.png: 20 x 20 pixels are too few; give pictures of 32 x 32 pixels or more"
        with pytest.raises(CalibrationError, match=re.escape(message)):
            taken([path])

    def test_a_file_that_is_no_picture(self, tmp_path):
        path = tmp_path / "a.png"
        path.write_bytes(b"\x89PNG\r\n\x1a\n and no more")
        message = f"{path}: not an image that can be read; export it again as PNG"
        with pytest.raises(RecordingError, match=re.escape(message)):
            taken([path])

    def test_a_file_of_another_kind(self, tmp_path):
        path = tmp_path / "a.docx"
        path.write_bytes(b"text")
        with pytest.raises(
            RecordingError,
            match=re.escape(f"{path}: not an image or recording that can be read here; expected "),
        ):
            taken([path])

    def test_a_file_that_is_not_there(self, tmp_path):
        with pytest.raises(RecordingError, match="no such file"):
            taken([tmp_path / "a.png"])


def test_a_photograph_stands_at_the_sensors_corner_unless_it_says_otherwise():
    one = Photograph("a", "a", np.zeros((2, 2), np.float32))
    np.testing.assert_array_equal(one.on_sensor(np.array([[1.0, 1.0]])), [[1.0, 1.0]])
