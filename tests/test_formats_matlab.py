"""MATLAB files: version 5 written with SciPy, version 7.3 laid out as MATLAB does with h5py."""

import re

import h5py
import numpy as np
import pytest
import scipy.io

from glint_aoa.errors import RecordingError
from glint_aoa.records.acquisition import LazySamples
from glint_aoa.records.formats import _matlab5, matlab, open_acquisition
from glint_aoa.setup import Inertial

HEADER = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan 12 08:00:00 2026 HDF5 schema"
AY = np.arange(6.0)
TIME = np.arange(6) / 800 - 0.0025


def write_5(path, variables):
    scipy.io.savemat(path, variables)
    return path


def write_7_3(path, variables):
    """Write variables as MATLAB's ``save -v7.3`` does: transposed, text as code points."""
    with h5py.File(path, "w", userblock_size=512) as file:
        cells = file.create_group("#refs#")
        for name, value in variables.items():
            store(file, cells, name, value)
    with path.open("r+b") as file:
        file.write(HEADER.ljust(512, b"\0"))
    return path


def store(group, cells, name, value):
    if isinstance(value, dict):
        inner = group.create_group(name)
        inner.attrs["MATLAB_class"] = np.bytes_("struct")
        for key, each in value.items():
            store(inner, cells, key, each)
    elif isinstance(value, str):
        group[name] = np.frombuffer(value.encode("utf-16-le"), np.uint16)[:, None]
        group[name].attrs["MATLAB_class"] = np.bytes_("char")
    elif isinstance(value, np.ndarray) and value.dtype == object:
        references = []
        for number, each in enumerate(value):
            store(cells, cells, f"{name}{number}", each)
            references.append(cells[f"{name}{number}"].ref)
        group.create_dataset(name, data=np.array(references, h5py.ref_dtype)[:, None])
        group[name].attrs["MATLAB_class"] = np.bytes_("cell")
    else:
        group[name] = np.atleast_2d(value).T
        group[name].attrs["MATLAB_class"] = np.bytes_("double")


both = pytest.mark.parametrize("write", [write_5, write_7_3])


def refused(path, message, inertial=None):
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: {message}")):
        open_acquisition(path, inertial)


@both
@pytest.mark.parametrize(
    "clock",
    [
        {"t": TIME},
        {"time_ms": TIME * 1e3},
        {"fs": 800.0, "t0": -0.0025},
        {"dt": 1 / 800, "start_s": -0.0025},
    ],
)
@pytest.mark.parametrize("shape", [(6,), (6, 1), (1, 6)])
def test_vectors_are_channels(tmp_path, write, clock, shape):
    variables = {**clock, "ay": AY.reshape(shape), "az": np.int16([3, 2, 1, 0, -1, -2]),
                 "remark": "run 3"}  # fmt: skip
    record = open_acquisition(write(tmp_path / "p.mat", variables))
    assert list(record.channels) == ["ay", "az"]
    assert (record["ay"].rate_hz, record["ay"].start_s) == (pytest.approx(800), -0.0025)
    np.testing.assert_array_equal(record["ay"].samples, AY)
    assert record["az"].samples.dtype == np.int16
    assert dict(record.meta) == {"remark": "run 3"}


@both
def test_structures_say_what_they_know(tmp_path, write):
    said = {"samples": AY, "rate_hz": 1000.0, "start_s": 0.5, "units": "g", "axis": "+y",
            "quantity": "acceleration", "station_m": 0.9}  # fmt: skip
    scaled = {"data": AY, "units": "m/s^2", "scale": 0.5, "range": np.array([-2.0, 2.0])}
    path = write(tmp_path / "p.mat", {"ay": said, "az": scaled, "fs": 800.0})
    record = open_acquisition(path)
    ay, az = record["ay"], record["az"]
    assert (ay.rate_hz, ay.start_s, ay.units, ay.axis) == (1000.0, 0.5, "g_0", "+y")
    assert (ay.quantity, ay.station_m) == ("acceleration", 0.9)
    assert (az.rate_hz, az.units, az.scale, az.limits) == (800.0, "m/s^2", 0.5, (-2.0, 2.0))
    inside = write(tmp_path / "q.mat", {"recording": {"ay": said, "az": scaled, "fs": 800.0}})
    assert list(open_acquisition(inside).channels) == ["ay", "az"]
    wrong = write(tmp_path / "w.mat", {"ay": {**said, "axis": "y"}})
    refused(wrong, "channel ay: axis is 'y', expected one of +x, -x, +y, -y, +z, -z; correct it")


@both
@pytest.mark.parametrize("turned", [False, True])
def test_columns_of_a_matrix_are_named_by_a_cell_array(tmp_path, write, turned):
    matrix = np.column_stack([AY, -AY, AY**2])
    variables = {"data": matrix.T if turned else matrix, "fs": 800.0}
    names = np.array(["aoa", "ay", "az"], object)
    record = open_acquisition(write(tmp_path / "p.mat", {**variables, "names": names}))
    assert list(record.channels) == ["aoa", "ay", "az"]
    np.testing.assert_array_equal(record["az"].samples, AY**2)
    path = write(tmp_path / "q.mat", variables)
    refused(path, f"data is a matrix of {list(variables['data'].shape)}, and no cell array names")


@both
def test_rows_missing_by_their_times_are_nan(tmp_path, write):
    kept = [0, 1, 4, 5]
    path = write(tmp_path / "p.mat", {"t": TIME[kept], "ay": AY[kept]})
    np.testing.assert_array_equal(
        open_acquisition(path)["ay"].samples, [0, 1, np.nan, np.nan, 4, 5]
    )


@both
def test_setup_completes_the_record(tmp_path, write):
    path = write(tmp_path / "p.mat", {"ay_face": AY})
    refused(path, "neither times nor a sampling rate are recorded; give rate under [inertial]")
    said = {"name": "ay_face", "quantity": "acceleration", "units": "m/s^2", "axis": "+y"}
    ay = open_acquisition(path, Inertial(rate="800 Hz", channel=[said]))["ay_face"]
    assert (ay.rate_hz, ay.quantity, ay.units) == (800.0, "acceleration", "m/s^2")
    refused(path, "channel ay_fac of the setup is not in the record; did you mean ay_face?",
            Inertial(rate="800 Hz", channel=[{**said, "name": "ay_fac"}]))  # fmt: skip


@both
@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ({"fs": 800.0}, "no vectors of numbers among its variables (fs); save each channel as"),
        ({"fs": -1.0, "ay": AY}, "the sampling rate is -1 Hz; expected more than 0"),
        ({"t": TIME, "ay": AY[:4]}, "channel ay has 4 samples for 6 times; save it with times of"),
        ({"t": TIME[::-1].copy(), "ay": AY}, "variable t: time runs backwards to"),
        ({"t": TIME, "ay": {"samples": AY + 1j}}, "no vectors of numbers among its variables"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(tmp_path, write, variables, message):
    refused(write(tmp_path / "p.mat", variables), message)


def test_a_long_record_stays_in_its_file(tmp_path, monkeypatch):
    monkeypatch.setattr(matlab, "EAGER_BYTES", 0)
    path = write_7_3(tmp_path / "p.mat", {"fs": 800.0, "ay": np.arange(1000.0)})
    ay = open_acquisition(path)["ay"]
    assert isinstance(ay.samples, LazySamples)
    np.testing.assert_array_equal(ay.samples[100:900], np.arange(100.0, 900.0))
    path.write_bytes(path.read_bytes()[:1500])
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: not a MATLAB file or dam")):
        ay.samples[0:10]


@both
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_file_cut_short_is_one_sentence(tmp_path, write, share):
    path = write(tmp_path / "p.mat", {"t": np.arange(500) / 800, "ay": np.arange(500.0) % 7})
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(RecordingError) as caught:
        open_acquisition(path)
    assert str(caught.value).startswith(f"{path}: not a MATLAB file or damaged (")


def test_samples_kept_in_other_files_are_refused(tmp_path):
    path = write_7_3(tmp_path / "p.mat", {"fs": 800.0})
    with h5py.File(path, "a") as file:
        file.create_dataset("ay", (4,), "f8", external=[("elsewhere.bin", 0, 32)])
    refused(path, "/ay keeps its data in other files, which are not followed; store the data in")


def spoilt_5(path, place, content, *, packed=False):
    scipy.io.savemat(path, {"ay_face": AY, "time": TIME}, do_compression=packed)
    whole = bytearray(path.read_bytes())
    whole[place : place + len(content)] = content
    path.write_bytes(whole)
    return path


@pytest.mark.parametrize(
    ("place", "content", "what"),
    [
        (184, b"\0\0\0\0", "an element of unknown type 0"),  # of the samples; SciPy would crash
        (128, b"\x63\0\0\0", "an element of unknown type 99"),
        (132, b"\xff\xff\xff\xff", "an element of 4294967295 bytes ends outside the file"),
        (188, b"\xff\xff\0\0", "an element of 65535 bytes ends outside its variable"),
        (282, b"\x09\0", "a small element of 9 bytes"),
        (136, b"\5", "a variable that does not begin with its class"),
        (156, b"\x18", "a variable of class 6 whose parts do not fit it"),  # takes the name
        (145, b"\xff", "a variable of class 6 whose parts do not fit it"),  # complex
    ],
)
def test_frames_that_lie_are_refused(tmp_path, place, content, what):
    path = spoilt_5(tmp_path / "p.mat", place, content)
    refused(path, f"not a MATLAB file or damaged ({what}); save or copy it again")


def test_a_variable_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(_matlab5, "MAX_UNPACKED_BYTES", 1 << 20)
    path = tmp_path / "p.mat"
    scipy.io.savemat(path, {"ay_face": np.zeros(1 << 18)}, do_compression=True)
    assert path.stat().st_size < 10_000
    refused(
        path,
        "not a MATLAB file or damaged (a variable unpacks to more than 1 MiB); "
        "save or copy it again",
    )


def test_cells_and_structures_are_walked(tmp_path):
    inner = {"ay_face": AY, "time": TIME, "note": "a", "cell": np.array([AY, "b"], dtype=object)}
    path = write_5(tmp_path / "p.mat", {"das": inner, **inner})
    _matlab5.check_frame(path)
    deep = AY
    for _ in range(20):
        deep = {"a": deep}
    write_5(path, {"das": deep})
    with pytest.raises(ValueError, match="variables nested more than 16 deep"):
        _matlab5.check_frame(path)


def test_files_of_matlab_4_are_let_through(tmp_path):
    path = tmp_path / "p.mat"
    scipy.io.savemat(path, {"ay_face": AY, "time": TIME}, format="4")
    _matlab5.check_frame(path)
    assert open_acquisition(path)["ay_face"].rate_hz == pytest.approx(800.0)
