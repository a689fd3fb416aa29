import csv
import subprocess
import sys

import nptdms
import numpy as np
import pytest
import xarray as xr
from recordings import recording
from synthetic import line_fields

import glint_aoa
from glint_aoa.errors import CalibrationError, OutputError
from glint_aoa.flags import Flag
from glint_aoa.process import measure_point, process_point
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.angles import FIELD_COLUMNS, LOG_COLUMNS
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.formats import open_fields
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.setup import Camera, Glint, Setup, load_setup

INFO = FieldInfo(
    rate_hz=60.0,
    exposure_s=1e-3,
    first_line=98,
    interlaced=True,
    first_parity="even",
    trigger_time="2026-01-12T08:00:00",
)
SETUP = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [375.5, 119.5]
position = ["0 m", "-56 in", "60 mm"]
"""


@pytest.fixture
def point(tmp_path):
    fields = line_fields(np.random.default_rng(1), n_fields=12, slope=0.01, interlaced=True)
    path = tmp_path / "run-01.h5"
    write_point(
        path,
        RecordedPoint(
            fields=fields,
            info=INFO,
            fields_time_s=None,
            acquisition=None,
            truth={},
            meta={"run": "run", "point": "01", "excitation": "off"},
        ),
    )
    return path


@pytest.fixture
def setup(tmp_path):
    path = tmp_path / "glint-aoa.toml"
    path.write_text(SETUP)
    return load_setup(path)


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_csv_netcdf_and_log_say_the_same(point, setup, tmp_path):
    result = process_point(point, setup, tmp_path / "out")
    table = rows(tmp_path / "out" / "run-01.csv")
    assert tuple(table[0]) == FIELD_COLUMNS
    with xr.open_dataset(tmp_path / "out" / "run-01.nc", engine="h5netcdf") as stored:
        np.testing.assert_array_equal(stored["angle_deg"], result.record["angle_deg"])
        assert stored["angle_deg"].attrs["units"] == "deg"
        assert {"angle_raw_deg", "angle_systematic_std_deg"} <= set(stored.data_vars)
        assert stored.attrs["setup_hash"] == setup.hash
        written = np.array([float(row["angle_deg"]) for row in table])
        np.testing.assert_allclose(written, stored["angle_deg"], atol=5.1e-7)
    assert [int(row["parity"]) for row in table[:4]] == [0, 1, 0, 1]
    (logged,) = rows(tmp_path / "out" / "log.csv")
    assert tuple(logged) == LOG_COLUMNS
    assert (logged["run"], logged["point"]) == ("run", "01")
    assert logged["trigger_time"] == "2026-01-12T08:00:00"
    assert (logged["n_fields"], logged["n_used"], logged["flags"]) == ("12", "12", "0")
    assert float(logged["mean_angle_deg"]) == pytest.approx(written.mean(), abs=1e-6)
    assert float(logged["std_angle_deg"]) == pytest.approx(written.std(ddof=1), abs=1e-6)


def test_results_are_not_overwritten_unless_asked(point, setup, tmp_path):
    out = tmp_path / "out"
    process_point(point, setup, out)
    before = (out / "run-01.csv").read_bytes()
    with pytest.raises(OutputError) as caught:
        process_point(point, setup, out)
    assert str(caught.value) == (
        f"{out / 'run-01.csv'} is there already; give another --out, or --overwrite to replace it"
    )
    assert (out / "run-01.csv").read_bytes() == before
    process_point(point, setup, out, overwrite=True)
    assert len(rows(out / "log.csv")) == 2


def test_the_sweep_of_the_setup_is_applied(point, tmp_path):
    from calibration.sweep.fit import fit_sweep

    raw = process_point(point, load_setup_of(tmp_path, ""), tmp_path / "raw")
    angles = np.linspace(-3, 3, 7)
    fit_sweep(angles, 1e-4, 1.02 * angles + 0.1, 1e-4, degree=1).save(tmp_path / "sweep.toml")
    setup = load_setup_of(tmp_path, '[calibration]\nsweep = "sweep.toml"\n')
    result = process_point(point, setup, tmp_path / "out")
    np.testing.assert_allclose(
        result.record["angle_deg"], 1.02 * raw.record["angle_deg"] + 0.1, atol=1e-9
    )
    np.testing.assert_array_equal(result.record["angle_raw_deg"], raw.record["angle_deg"])
    np.testing.assert_allclose(
        result.record["angle_std_deg"], 1.02 * raw.record["angle_std_deg"], rtol=1e-9
    )
    assert (result.record["angle_systematic_std_deg"] > 0).all()
    assert result.log["mean_angle_u95_deg"] > raw.log["mean_angle_u95_deg"]


def test_outside_the_sweep_is_flagged(point, tmp_path):
    from calibration.sweep.fit import fit_sweep

    angles = np.linspace(2, 8, 7)
    fit_sweep(angles, 1e-4, angles, 1e-4, degree=1).save(tmp_path / "sweep.toml")
    setup = load_setup_of(tmp_path, '[calibration]\nsweep = "sweep.toml"\n')
    result = process_point(point, setup, tmp_path / "out")
    assert result.flags & Flag.OUTSIDE_CALIBRATION


def test_a_missing_sweep_is_said_before_anything_is_written(point, tmp_path):
    setup = load_setup_of(tmp_path, '[calibration]\nsweep = "absent.toml"\n')
    with pytest.raises(CalibrationError, match=r"absent\.toml"):
        process_point(point, setup, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def load_setup_of(folder, more):
    path = folder / "setup.toml"
    path.write_text(SETUP + more)
    return load_setup(path)


def test_few_good_fields_are_flagged_and_left_out_of_the_mean():
    fields = line_fields(np.random.default_rng(2), n_fields=10, shape=(60, 400), row=30)
    fields[:6] = 20
    stack = FieldStack.from_array(fields, FieldInfo(rate_hz=60.0))
    log = measure_point(stack, Setup()).log
    assert (log["n_fields"], log["n_used"]) == (10, 4)
    assert log["flags"] & Flag.FEW_FIELDS
    assert np.isfinite(log["mean_angle_deg"])


def swinging(frequency, amplitude_deg):
    """An acquisition record with two accelerometers of a model that turns about its origin."""
    time, turn = np.arange(2400) / 800, 2 * np.pi * frequency
    turning = -np.radians(amplitude_deg) * turn**2 * np.sin(turn * time)
    channels = [
        Channel(name, x * turning, 800.0, 0.0, "acceleration", "m/s^2", station_m=x, axis="+z")
        for name, x in (("az_aft", 0.1), ("az_face", 0.9))
    ]
    return AcquisitionRecord("run-02", {each.name: each for each in channels})


@pytest.mark.parametrize(("frequency", "flagged"), [(34.2, True), (9.2, False)])
def test_motion_that_aliases_is_flagged_where_channels_show_it(frequency, flagged, setup, tmp_path):
    fields = line_fields(np.random.default_rng(4), n_fields=12, slope=0.01, interlaced=True)
    path = tmp_path / "run-02.h5"
    record = swinging(frequency, 0.05)
    write_point(
        path,
        RecordedPoint(
            fields=fields, info=INFO, fields_time_s=None, acquisition=record, truth={}, meta={}
        ),
    )
    result = process_point(path, setup, tmp_path / "out")
    assert bool(result.flags & Flag.ALIASED) is flagged
    assert ("aliased_rms_deg" in result.record.attrs) is flagged
    if flagged:
        assert result.record.attrs["aliased_rms_deg"] == pytest.approx(0.05 / 2**0.5, rel=0.02)
        assert result.record.attrs["aliased_frequency_hz"] == pytest.approx(34.2, abs=0.51)
    (logged,) = rows(tmp_path / "out" / "log.csv")
    assert int(logged["flags"]) == result.flags


CHANNELS = "".join(
    f"""
[[inertial.channel]]
name = "{name}"
quantity = "acceleration"
units = "m/s^2"
station = "{station} m"
axis = "+z"
"""
    for name, station in (("az_aft", 0.1), ("az_face", 0.9))
)


def test_channels_may_lie_in_a_file_beside_the_recording(tmp_path):
    (tmp_path / "glint-aoa.toml").write_text(SETUP + '[fields]\nrate = "60 Hz"\n' + CHANNELS)
    setup = load_setup(tmp_path / "glint-aoa.toml")
    fields = line_fields(np.random.default_rng(4), n_fields=12, slope=0.01, interlaced=True)
    np.savez(tmp_path / "run-02.npz", fields=fields)
    alone = process_point(tmp_path / "run-02.npz", setup, tmp_path / "alone")
    with nptdms.TdmsWriter(tmp_path / "run-02.tdms") as writer:
        for each in swinging(34.2, 0.05).channels.values():
            waveform = {"wf_increment": 1 / 800}
            writer.write_segment([nptdms.ChannelObject("das", each.name, each.samples, waveform)])
    beside = process_point(tmp_path / "run-02.npz", setup, tmp_path / "beside")
    assert not alone.flags & Flag.ALIASED
    assert beside.flags & Flag.ALIASED
    assert beside.record.attrs["aliased_frequency_hz"] == pytest.approx(34.2, abs=0.51)


def test_how_the_mean_was_taken_stands_in_the_record(point, setup, tmp_path):
    process_point(point, setup, tmp_path / "out")
    (logged,) = rows(tmp_path / "out" / "log.csv")
    with xr.open_dataset(tmp_path / "out" / "run-01.nc", engine="h5netcdf") as stored:
        assert stored.attrs["mean_method"] == logged["mean_method"]
        assert stored.attrs["mean_angle_std_deg"] == pytest.approx(
            float(logged["mean_angle_std_deg"]), rel=1e-9
        )
        assert np.size(stored.attrs["vibration_frequency_hz"]) == 0


def test_without_a_pixel_pitch_nothing_has_a_length(tmp_path):
    path = tmp_path / "clip.npy"
    np.save(path, line_fields(np.random.default_rng(3), n_fields=4, shape=(60, 400), row=30))
    setup_path = tmp_path / "s.toml"
    setup_path.write_text('[fields]\nrate = "100 Hz"\n')
    process_point(path, load_setup(setup_path), tmp_path / "out")
    for row in rows(tmp_path / "out" / "clip.csv"):
        assert row["intercept_mm"] == row["intercept_std_mm"] == row["rms_residual_mm"] == ""
        assert row["angle_deg"] != ""
    (logged,) = rows(tmp_path / "out" / "log.csv")
    assert logged["mean_intercept_mm"] == ""
    assert logged["flags"] == str(int(Flag.UNCALIBRATED))


def test_public_names_load_when_used():
    assert glint_aoa.process_point is process_point
    for name in glint_aoa.__all__:
        assert getattr(glint_aoa, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        glint_aoa.nothing  # noqa: B018


@pytest.mark.parametrize(("step", "limit"), [(20, 0.0020), (1, 0.0013)])
def test_two_bands_of_one_real_beam_agree(step, limit):
    stack = open_fields(recording("video/vibrating-beam.mraw"))
    angles = []
    for window in ((0, 21), (21, 40)):
        setup = Setup(camera=Camera(), glint=Glint(search_window=window, column_step=step))
        record = measure_point(stack, setup).record
        assert record.sizes["field"] == 75
        # The beam is no straight line: its columns lie off for good, which is said.
        assert (record["flags"] | Flag.UNEVEN == Flag.UNCALIBRATED | Flag.UNEVEN).all()
        angles.append(record["angle_deg"].to_numpy())
    assert np.std(angles[0] - angles[1], ddof=1) < limit
    assert np.corrcoef(*angles)[0, 1] > 0.9


def test_the_import_is_light():
    code = (
        "import sys, glint_aoa\n"
        "heavy = {'numpy', 'numba', 'matplotlib', 'xarray', 'h5py', 'OpenGL'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
