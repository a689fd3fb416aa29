"""Universal files written with pyuff, and real ones."""

import re
import warnings

import numpy as np
import pytest
import pyuff
from recordings import recording

from glint_aoa.errors import RecordingError
from glint_aoa.records.formats import open_acquisition, uff
from glint_aoa.setup import Inertial

HEADER = {
    "type": 58, "func_type": 1, "func_id": 0, "ver_num": 0, "load_case_id": 0,
    "rsp_node": 1, "rsp_dir": 2, "ref_ent_name": "NONE", "ref_node": 0, "ref_dir": 0,
    "id1": "NONE", "id2": "NONE", "id3": "NONE", "id4": "NONE", "id5": "NONE",
    "z_axis_value": 0, "abscissa_spec_data_type": 17, "ordinate_spec_data_type": 12,
    "orddenom_spec_data_type": 0, "z_axis_spec_data_type": 0,
}  # fmt: skip
TIME = np.arange(400) / 800 - 0.05
SAMPLES = np.sin(2 * np.pi * 9.8 * TIME)


def data_set(samples=SAMPLES, x=TIME, **keys):
    spacing = keys.get("abscissa_spacing", 1)
    return {
        **HEADER, "rsp_ent_name": "ay_face", "data": samples, "x": x, "abscissa_spacing": spacing,
        "abscissa_min": x[0], "abscissa_inc": x[1] - x[0], "num_pts": len(samples), "binary": 0,
        "ordinate_axis_units_lab": "m/s^2", **keys,
    }  # fmt: skip


def write(path, *sets):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # pyuff leaves files open
        pyuff.UFF(str(path)).write_sets(list(sets), "add")  # "overwrite" loses binary headers
    return path


def refused(path, message, inertial=None):
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        open_acquisition(path, inertial)


@pytest.mark.parametrize("suffix", [".uff", ".unv", ".txt"])
@pytest.mark.parametrize("binary", [0, 1])
def test_round_trip(tmp_path, binary, suffix):
    sets = [data_set(binary=binary), data_set(2 * SAMPLES, rsp_ent_name="az", binary=binary)]
    record = open_acquisition(write(tmp_path / f"p{suffix}", *sets))
    assert list(record.channels) == ["ay_face", "az"]
    ay = record["ay_face"]
    assert (ay.rate_hz, ay.start_s, ay.units, len(ay)) == (800.0, -0.05, "m/s^2", 400)
    np.testing.assert_allclose(ay.samples, SAMPLES, rtol=0, atol=0 if binary else 1e-11)
    np.testing.assert_allclose(record["az"].samples, 2 * SAMPLES, atol=1e-11)


@pytest.mark.parametrize(
    ("keys", "names"),
    [
        ([{"rsp_ent_name": "a"}, {"rsp_ent_name": "b"}], ["a", "b"]),
        ([{"id1": "one"}, {"id1": "two"}], ["one", "two"]),
        ([{"rsp_node": 1}, {"rsp_node": 2, "rsp_dir": -3}], ["1+y", "2-z"]),
        ([{}, {}], ["1+y 1", "1+y 2"]),
    ],
)
def test_names_tell_the_channels_apart(tmp_path, keys, names):
    sets = [data_set(**each) for each in keys]
    assert list(open_acquisition(write(tmp_path / "p.uff", *sets)).channels) == names


def test_uneven_times_that_lie_on_a_grid(tmp_path):
    kept = np.delete(np.arange(400), [100, 101])
    path = write(
        tmp_path / "p.uff", data_set(SAMPLES[kept], x=TIME[kept], abscissa_spacing=0, binary=1)
    )
    ay = open_acquisition(path)["ay_face"]
    assert (ay.rate_hz, len(ay)) == (pytest.approx(800), 400)
    assert np.flatnonzero(np.isnan(ay.samples)).tolist() == [100, 101]
    np.testing.assert_allclose(ay.samples[kept], SAMPLES[kept], rtol=1e-7)


def test_frequency_responses_are_left_out(tmp_path):
    path = write(tmp_path / "p.uff", data_set(func_type=4, rsp_ent_name="frf"), data_set())
    assert list(open_acquisition(path).channels) == ["ay_face"]
    path = write(tmp_path / "q.uff", data_set(func_type=4))
    refused(path, "no time records (data set 58, function type 1) among its data sets (58); export")


def test_setup_gives_what_the_file_does_not_say(tmp_path):
    path = write(tmp_path / "p.uff", data_set())
    said = {"name": "ay_face", "quantity": "acceleration", "units": "m/s**2", "axis": "+y"}
    ay = open_acquisition(path, Inertial(channel=[said]))["ay_face"]
    assert (ay.quantity, ay.axis, ay.units) == ("acceleration", "+y", "m/s^2")
    refused(path, "channel ay_face: units is m/s^2 in the record but N in the setup; correct",
            Inertial(channel=[{**said, "units": "N"}]))  # fmt: skip


@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("share", [0.3, 0.9, 0.995])
def test_a_file_cut_short_is_one_sentence(tmp_path, binary, share):
    path = write(tmp_path / "p.uff", data_set(binary=binary), data_set(binary=binary))
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    refused(path, "the last data set has no end; it is cut short, export or copy it again")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            b"    58",
            b"    5x",
            "no time records (data set 58, function type 1) among its data sets",
        ),
        (b"e-01", b"x-01", "not a universal file or damaged ("),
        (b" 400 ", b" 500 ", "channel ay_face: 400 of 500 samples; it is cut short, export it"),
        (b" 1.25000e-03", b"-1.25000e-03", "channel ay_face: abscissa increment is -0.00125; exp"),
    ],
)
def test_a_damaged_file_is_one_sentence(tmp_path, old, new, message):
    path = write(tmp_path / "p.uff", data_set())
    assert old in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(old, new))
    refused(path, message)


def test_complex_samples_and_large_files_are_refused(tmp_path, monkeypatch):
    path = write(tmp_path / "p.uff", data_set(SAMPLES + 1j))
    refused(path, "channel ay_face: complex samples, expected a time record")
    monkeypatch.setattr(uff, "MAX_BYTES", 100)
    refused(path, "0 MiB, more than 0 MiB; export the record as TDMS or HDF5")


def test_real_files_in_text_and_binary_are_one_record():
    plain, binary = (
        open_acquisition(recording(f"das/sample58_{kind}.uff"))["Mic 01"]
        for kind in ("ascii", "binary")
    )
    assert (plain.rate_hz, plain.units, len(plain)) == (binary.rate_hz, "Pa", len(binary))
    assert plain.rate_hz == pytest.approx(65536, rel=1e-6)
    # The text has six digits of the binary's seven.
    np.testing.assert_allclose(plain.samples, binary.samples, rtol=5e-5, atol=1e-9)
