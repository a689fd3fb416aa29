"""The written contracts, held from outside: recordings and truths owe the program nothing."""

import csv
import json

import h5py
import numpy as np
import pytest
import tifffile
import xarray as xr
from independent_camera import (
    Camera,
    Light,
    Line,
    Window,
    attributes,
    film,
    window_about,
    write_h5,
)
from independent_package import GRAVITY, MODE_1, RATE_HZ, swinging

import glint_aoa

NO_GLINT, UNCALIBRATED, OUTSIDE, TIMING, CLIPPED, SETTLING = 1, 64, 128, 256, 512, 1024

FIELD_HEADER = (
    "field,time_s,parity,angle_deg,angle_std_deg,intercept_mm,intercept_std_mm,columns_used,"
    "rms_residual_mm,flags"
)
LOG_HEADER = (
    "run,point,trigger_time,n_fields,n_used,mean_angle_deg,std_angle_deg,mean_angle_std_deg,"
    "mean_angle_u95_deg,mean_method,mean_intercept_mm,std_intercept_mm,flags,setup_hash"
)
CORRECT_HEADER = "time_s,angle_deg,angle_std_deg,raw_angle_deg,bias_deg,flags"

# The centroid may scatter by 1.3 times the bound; a mean is believed to 4 standard deviations.
EFFICIENCY, SIGMAS = 1.3, 4.0

TURNED = (2.1, -1.8, 1.6)
LENS = (-0.15, 0.08, 0.002, -0.0015, 0.01)
LEVEL = Line(pitch_deg=2.0)


@pytest.fixture
def rng():
    return np.random.default_rng(20240531)


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def table(path):
    """Columns of numbers; an empty cell is NaN."""
    cells = rows(path)
    return {name: np.array([float(row[name] or "nan") for row in cells]) for name in cells[0]}


def header(path):
    return path.read_text().splitlines()[0]


def written(path, text):
    path.write_text(text)
    return path


def measure(folder, recording, setup_text):
    setup = glint_aoa.load_setup(written(folder / "glint-aoa.toml", setup_text))
    glint_aoa.process_point(recording, setup, folder / "out")
    return table(folder / "out" / f"{recording.stem}.csv")


def tolerance(bound, n_fields):
    return SIGMAS * EFFICIENCY * bound / np.sqrt(n_fields)


# The optical angle


@pytest.mark.parametrize(
    ("camera", "line", "how"),
    [
        pytest.param(Camera(), Line(0.0), {}, id="level"),
        pytest.param(Camera(), Line(5.0), {}, id="nose left, up"),
        pytest.param(Camera(), Line(-5.0), {}, id="nose left, down"),
        pytest.param(Camera(), Line(5.0, nose="right"), {}, id="nose right, up"),
        pytest.param(Camera(), Line(-5.0, nose="right"), {}, id="nose right, down"),
        pytest.param(Camera(), Line(3.0), {"first_parity": "odd"}, id="odd field first"),
        pytest.param(Camera(), Line(3.0), {"interlaced": False}, id="progressive"),
        pytest.param(
            Camera(), Line(-3.0), {"first_column": 200, "n_columns": 400}, id="cropped columns"
        ),
        pytest.param(Camera(), Line(2.0, y=0.06), {}, id="glint beyond the axis"),
        pytest.param(Camera(), Line(4.0, yaw_deg=6.0, y=0.02), {}, id="sideslip"),
        pytest.param(
            Camera(), Line(4.0, nose="right", yaw_deg=-6.0, y=-0.02), {}, id="sideslip, nose right"
        ),
        pytest.param(Camera(distortion=LENS), Line(2.0), {}, id="distortion"),
        pytest.param(Camera(rotation=(2.0, 0.0, 0.0)), Line(2.0), {}, id="omega"),
        pytest.param(Camera(rotation=(0.0, 2.0, 0.0)), Line(2.0), {}, id="phi"),
        pytest.param(Camera(rotation=(0.0, 0.0, 2.0)), Line(2.0), {}, id="kappa"),
        pytest.param(
            Camera(rotation=TURNED, distortion=LENS, position=(0.03, -1.3, 0.08)),
            Line(-2.5, yaw_deg=5.0, y=0.04),
            {"first_parity": "odd", "first_column": 31, "n_columns": 690},
            id="all at once",
        ),
    ],
)
def test_angle_and_intercept_are_the_line_s(camera, line, how, rng, tmp_path):
    filmed = film(camera, line, window_about(camera, line, **how), rng)
    found = measure(tmp_path, write_h5(tmp_path / "p.h5", filmed), camera.toml + line.toml)
    n = len(filmed.fields)
    angle_error = found["angle_deg"] - line.pitch_deg
    intercept_error = found["intercept_mm"] - 1e3 * line.intercept
    assert abs(angle_error.mean()) < tolerance(filmed.angle_bound_deg, n)
    assert abs(intercept_error.mean()) < tolerance(filmed.intercept_bound_mm, n)
    assert not found["flags"].any()
    np.testing.assert_array_equal(found["parity"], filmed.parity)
    np.testing.assert_array_equal(found["field"], np.arange(n))


def test_stated_noise_is_the_scatter(rng, tmp_path):
    camera, n = Camera(), 150
    filmed = film(camera, LEVEL, window_about(camera, LEVEL), rng, n_fields=n)
    found = measure(tmp_path, write_h5(tmp_path / "p.h5", filmed), camera.toml + LEVEL.toml)
    for name, bound in (
        ("angle", filmed.angle_bound_deg),
        ("intercept", filmed.intercept_bound_mm),
    ):
        unit = {"angle": "deg", "intercept": "mm"}[name]
        scatter = found[f"{name}_{unit}"].std(ddof=1)
        stated = np.sqrt(np.mean(found[f"{name}_std_{unit}"] ** 2))
        relative = SIGMAS / np.sqrt(2 * n)  # of a standard deviation from n fields
        assert scatter < EFFICIENCY * bound * (1 + relative)
        assert stated == pytest.approx(scatter, rel=relative)
    residual = found["rms_residual_mm"].mean() / filmed.centre_bound_mm
    assert 0.95 < residual < EFFICIENCY
    assert set(found["columns_used"]) == {len(range(10, 752, 20))}


def test_every_column_lowers_the_noise(rng, tmp_path):
    camera = Camera()
    filmed = film(camera, LEVEL, window_about(camera, LEVEL), rng, step=1)
    setup = camera.toml + LEVEL.toml + "column_step = 1\n"
    found = measure(tmp_path, write_h5(tmp_path / "p.h5", filmed), setup)
    assert abs(found["angle_deg"].mean() - 2.0) < tolerance(filmed.angle_bound_deg, 24)
    assert found["angle_deg"].std(ddof=1) < EFFICIENCY * filmed.angle_bound_deg * 1.6
    assert set(found["columns_used"]) == {752}


def test_twelve_bits_in_sixteen(rng, tmp_path):
    camera, light = Camera(), Light(scale=16.0, white=4095)
    filmed = film(camera, LEVEL, window_about(camera, LEVEL), rng, light=light, dtype=np.uint16)
    assert filmed.fields.max() > 2 * 255
    found = measure(tmp_path, write_h5(tmp_path / "p.h5", filmed), camera.toml + LEVEL.toml)
    assert abs(found["angle_deg"].mean() - 2.0) < tolerance(filmed.angle_bound_deg, 24)
    assert not found["flags"].any()


def test_search_window_picks_one_of_two_lines(rng, tmp_path):
    camera, other = Camera(), Line(-1.0, intercept=0.078)
    window = Window(first_line=78)
    both = [film(camera, line, window, rng).fields.astype(int) for line in (LEVEL, other)]
    filmed = film(camera, LEVEL, window, rng)
    filmed.fields[:] = np.clip(both[0] + both[1] - 10, 0, 255)
    recording = write_h5(tmp_path / "p.h5", filmed)
    for line, rows_of in ((LEVEL, [32, 65]), (other, [8, 36])):
        setup = camera.toml + line.toml + f"search_window = {rows_of}\n"
        glint_aoa.process_point(
            recording,
            glint_aoa.load_setup(written(tmp_path / "s.toml", setup)),
            tmp_path,
            overwrite=True,
        )
        found = table(tmp_path / "p.csv")
        assert abs(found["angle_deg"].mean() - line.pitch_deg) < 2 * tolerance(
            filmed.angle_bound_deg, 24
        )


def test_a_window_of_twenty_lines_is_enough(rng, tmp_path):
    camera, line = Camera(), Line(0.1)
    first_line = round(np.mean(line.lines_on(camera))) - 10
    filmed = film(camera, line, Window(first_line, n_lines=20), rng)
    found = measure(tmp_path, write_h5(tmp_path / "p.h5", filmed), camera.toml + line.toml)
    assert abs(found["angle_deg"].mean() - 0.1) < tolerance(filmed.angle_bound_deg, 24)
    assert not found["flags"].any()


# Time


@pytest.mark.parametrize("start_s", [0.0, -0.25, 1.5])
def test_time_is_the_middle_of_the_exposure(start_s, rng, tmp_path):
    camera = Camera()
    filmed = film(camera, LEVEL, window_about(camera, LEVEL), rng, n_fields=9)
    said = attributes(filmed.window, rate_hz=59.94, exposure_s=4e-3, start_s=start_s)
    recording = write_h5(tmp_path / "p.h5", filmed, attrs=said)
    found = measure(tmp_path, recording, camera.toml + LEVEL.toml)
    np.testing.assert_allclose(found["time_s"], start_s + np.arange(9) / 59.94 + 2e-3, atol=5.1e-7)


def test_recorded_timestamps_are_starts_of_exposures(rng, tmp_path):
    camera = Camera()
    filmed = film(camera, LEVEL, window_about(camera, LEVEL), rng, n_fields=9)
    times = 0.1 + np.arange(9) / 60
    times[6:] += 1 / 60  # a field is lost before field 6
    recording = write_h5(tmp_path / "p.h5", filmed, fields_time=times)
    found = measure(tmp_path, recording, camera.toml + LEVEL.toml)
    np.testing.assert_allclose(found["time_s"], times + 0.5e-3, atol=5.1e-7)
    np.testing.assert_array_equal(found["flags"], np.where(np.arange(9) == 6, TIMING, 0))


# Where the fields come from


def as_bytes_and_scalars(said):
    """The same attributes as other writers of HDF5 store them."""
    kinds = {str: np.bytes_, bool: np.uint8, int: np.int32, float: np.float32}
    return {name: kinds[type(value)](value) for name, value in said.items()}


def fields_section(window):
    return f"""
[fields]
rate = "60 Hz"
exposure = "1 ms"
first_line = {window.first_line}
first_column = {window.first_column}
interlaced = {str(window.interlaced).lower()}
first_parity = "{window.first_parity}"
"""


@pytest.mark.parametrize("kind", ["bytes", "npz", "npz packed", "npy", "tiff", "silent h5"])
def test_other_carriers_of_the_same_fields_give_the_same_angles(kind, rng, tmp_path):
    camera = Camera()
    window = window_about(camera, LEVEL, first_parity="odd", first_column=20, n_columns=700)
    filmed = film(camera, LEVEL, window, rng, n_fields=10)
    setup = camera.toml + LEVEL.toml
    expected = measure(tmp_path, write_h5(tmp_path / "p.h5", filmed), setup)
    other = tmp_path / "other"
    other.mkdir()
    if kind == "bytes":
        said = as_bytes_and_scalars(attributes(window))
        found = measure(other, write_h5(other / "p.h5", filmed, attrs=said), setup)
    else:
        setup += fields_section(window)
        found = measure(other, carrier(kind, other, filmed), setup)
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, atol=1e-6, err_msg=name)


def test_a_file_that_states_a_parity_is_interlaced(rng, tmp_path):
    camera = Camera()
    filmed = film(camera, LEVEL, window_about(camera, LEVEL, first_parity="odd"), rng, n_fields=8)
    said = {k: v for k, v in attributes(filmed.window).items() if k != "interlaced"}
    recording = write_h5(tmp_path / "p.h5", filmed, attrs=said)
    found = measure(tmp_path, recording, camera.toml + LEVEL.toml)
    np.testing.assert_array_equal(found["parity"], filmed.parity)
    error = found["intercept_mm"].mean() - 1e3 * LEVEL.intercept
    assert abs(error) < tolerance(filmed.intercept_bound_mm, 8)


def carrier(kind, folder, filmed):
    if kind == "silent h5":
        return write_h5(folder / "p.h5", filmed, attrs={})
    path = folder / {"npz": "p.npz", "npz packed": "p.npz", "npy": "p.npy", "tiff": "p.tif"}[kind]
    if kind == "npz":
        np.savez(path, fields=filmed.fields)
    elif kind == "npz packed":
        np.savez_compressed(path, fields=filmed.fields)
    elif kind == "npy":
        np.save(path, filmed.fields)
    else:
        tifffile.imwrite(path, filmed.fields, photometric="minisblack")
    return path


# Without a camera


@pytest.mark.parametrize("nose", ["left", "right"])
@pytest.mark.parametrize("pitch", [None, (11.7e-6, 27.5e-6)])
def test_without_a_camera_the_angle_is_that_of_the_image_plane(pitch, nose, rng, tmp_path):
    camera, line = Camera(), Line(1.5, nose=nose)
    filmed = film(camera, line, window_about(camera, line), rng)
    setup = f'[glint]\nnose = "{nose}"\n'
    if pitch:
        setup += '[camera]\npixel_pitch = ["11.7 um", "27.5 um"]\n'
    found = measure(tmp_path, write_h5(tmp_path / "p.h5", filmed), setup)
    ratio = 1.0 if pitch else camera.pitch[0] / camera.pitch[1]
    expected = np.degrees(np.arctan(np.tan(np.radians(1.5)) * ratio))
    assert abs(found["angle_deg"].mean() - expected) < ratio * tolerance(filmed.angle_bound_deg, 24)
    assert set(found["flags"]) == {UNCALIBRATED}
    if pitch is None:  # nothing has a length
        assert np.isnan(found["intercept_mm"]).all()


# What is written


def test_results_are_as_the_contract_says(program, rng, tmp_path):
    camera = Camera()
    filmed = film(camera, LEVEL, window_about(camera, LEVEL), rng, n_fields=12)
    filmed.fields[4] = 10  # lamp off
    setup = written(tmp_path / "glint-aoa.toml", camera.toml + LEVEL.toml)
    points = [write_h5(tmp_path / f"p-{k}.h5", filmed) for k in (1, 2)]
    out = tmp_path / "out"
    for point in points:
        assert program("process", point, "--setup", setup, "--out", out)[0] == 0

    found = rows(out / "p-1.csv")
    assert header(out / "p-1.csv") == FIELD_HEADER
    assert len(found) == 12
    empty = {name for name, cell in found[4].items() if cell == ""}
    measured = "angle_deg,angle_std_deg,intercept_mm,intercept_std_mm,rms_residual_mm"
    assert empty == set(measured.split(","))
    assert int(found[4]["flags"]) & NO_GLINT
    assert found[4]["columns_used"] == "0"
    assert all(row["flags"] == "0" for k, row in enumerate(found) if k != 4)

    log = rows(out / "log.csv")
    assert header(out / "log.csv") == LOG_HEADER
    assert [(row["run"], row["point"]) for row in log] == [("7", "3")] * 2
    assert log[0]["trigger_time"] == "2024-05-31T14:02:11"
    assert (log[0]["n_fields"], log[0]["n_used"]) == ("12", "11")
    mean = float(log[0]["mean_angle_deg"])
    assert abs(mean - 2.0) < 2 * tolerance(filmed.angle_bound_deg, 11)
    # Student's t: 1.96 if the noise were known, 2.14 from eleven fields and their trend alone.
    factor = float(log[0]["mean_angle_u95_deg"]) / float(log[0]["mean_angle_std_deg"])
    assert 1.97 < factor < 2.14

    with xr.open_dataset(out / "p-1.nc", engine="h5netcdf") as stored:
        more = {"angle_raw_deg", "angle_systematic_std_deg"}
        assert set(stored.variables) >= more | set(FIELD_HEADER.split(","))
        assert stored["angle_deg"].attrs["units"] == "deg"
        assert stored["intercept_mm"].attrs["units"] == "mm"
        assert stored["time_s"].attrs["units"] == "s"
        assert json.loads(stored.attrs["setup"])["glint"]["column_step"] == 20
        np.testing.assert_allclose(
            stored["angle_deg"], table(out / "p-1.csv")["angle_deg"], atol=5.1e-7
        )


def test_strict_and_json(program, rng, tmp_path):
    filmed = film(Camera(), LEVEL, window_about(Camera(), LEVEL), rng, n_fields=8)
    point = write_h5(tmp_path / "p.h5", filmed)
    setup = written(tmp_path / "s.toml", "")
    code, out, _ = program(
        "process", point, "--setup", setup, "--out", tmp_path / "out", "--strict", "--json"
    )
    assert code == 3
    assert json.loads(out)[0]["flags"] == UNCALIBRATED


# Setup against file


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ('[fields]\nrate = "50 Hz"\n', "rate"),
        ('[fields]\nexposure = "2 ms"\n', "exposure"),
        ("[fields]\nfirst_line = 1\n", "first_line"),
        ("[fields]\nfirst_column = 1\n", "first_column"),
        ('[fields]\nfirst_parity = "odd"\n', "first_parity"),
        ("[fields]\ninterlaced = false\n", "interlaced"),
        ("[fields]\nfirst_lines = 1\n", "first_line?"),
        ("[glint]\ncolum_step = 1\n", "column_step"),
        ('[glnt]\ny = "0 mm"\n', "glint"),
        ('[glint]\ny = "0 deg"\n', "glint.y"),
        ("[glint]\ny = 0\n", "glint.y"),
        ('[camera]\nfocal_lenght = "35 mm"\n', "focal_length"),
        ('[[inertial.mode]]\nnumbr = 1\nplane = "yaw"\n', "number"),
    ],
)
def test_contradictions_and_unknown_keys_are_errors(section, words, program, rng, tmp_path):
    filmed = film(Camera(), LEVEL, window_about(Camera(), LEVEL), rng, n_fields=3)
    point = write_h5(tmp_path / "p.h5", filmed)
    setup = written(tmp_path / "s.toml", section)
    code, _, said = program("process", point, "--setup", setup, "--out", tmp_path / "out")
    assert code == 2
    assert words in said
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out" / "log.csv").exists()


def test_agreement_of_setup_and_file_is_no_error(program, rng, tmp_path):
    filmed = film(Camera(), LEVEL, window_about(Camera(), LEVEL), rng, n_fields=3)
    point = write_h5(
        tmp_path / "p.h5", filmed, attrs=as_bytes_and_scalars(attributes(filmed.window))
    )
    setup = written(tmp_path / "s.toml", Camera().toml + fields_section(filmed.window))
    assert program("process", point, "--setup", setup, "--out", tmp_path / "out")[0] == 0


# The inertial angle

FILTER = '[inertial.filter]\nkind = "butterworth"\norder = 2\ncutoff = "0.4 Hz"\n'
MODE = '[[inertial.mode]]\nnumber = 1\nplane = "yaw"\nfrequency = "9.8 Hz"\nradius = "31 in"\n'
CLOCK = {"rate_hz": RATE_HZ, "start_s": -2.0}
ACCELEROMETER = {"quantity": "acceleration", "units": "m/s^2", "station_m": 0.9, "axis": "+y"}
PACKAGE = {"quantity": "aoa_unfiltered", "units": "g_0", "station_m": 0.9, "axis": "+x"}
IN_SETUP = """
[[inertial.channel]]
name = "package"
quantity = "aoa_unfiltered"
units = "g_0"
station = "900 mm"
axis = "+x"

[[inertial.channel]]
name = "ay_face"
quantity = "acceleration"
units = "m/s^2"
scale = 1.0
station = "0.9 m"
axis = "+y"
range = ["-100 m/s^2", "100 m/s^2"]
"""


def vibration(rng, *, pitch_deg=0.0, seconds=24.0, ahead=0.0, mode=MODE_1):
    """Package output [g_0] and tangential acceleration [m/s^2] of a model that swings in a mode."""
    time = CLOCK["start_s"] + np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    force = swinging(time, pitch_deg=pitch_deg, **mode)
    felt = swinging(time, pitch_deg=pitch_deg, ahead=ahead, **mode)
    package = force[0] + rng.normal(0, 2e-3, time.size)
    tangential = felt[{"yaw": 1, "pitch": 2}[mode["plane"]]] + rng.normal(0, 5e-3, time.size)
    return package / GRAVITY, tangential


def corrected(program, folder, channels, setup, *options):
    """Run `correct`; return the rows, and which of them carry no flag of settling."""
    record = write_h5(folder / "record.h5", channels=channels)
    setup = written(folder / "s.toml", setup)
    code, _, said = program("correct", record, "--setup", setup, "--out", folder, *options)
    assert code == 0, said
    found = table(folder / "record.csv")
    return found, (found["flags"].astype(int) & SETTLING) == 0


@pytest.mark.parametrize("pitch_deg", [0.0, 4.3, -5.0])
@pytest.mark.parametrize("unit", ["g_0", "m/s^2", "deg"])
def test_bias_of_a_yaw_sine_is_removed(unit, pitch_deg, program, rng, tmp_path):
    package, lateral = vibration(rng, pitch_deg=pitch_deg)
    package = {
        "g_0": package,
        "m/s^2": package * GRAVITY,
        "deg": np.degrees(np.arcsin(package)),
    }[unit]
    channels = {
        "ay_face": (lateral, CLOCK | ACCELEROMETER),
        "package": (package, CLOCK | PACKAGE | {"units": unit}),
    }
    found, settled = corrected(program, tmp_path, channels, FILTER + MODE)
    assert header(tmp_path / "record.csv") == CORRECT_HEADER
    assert settled.sum() > 0.7 * settled.size
    assert not found["flags"][settled].any()
    bias = -0.15 / np.cos(np.radians(pitch_deg))
    assert found["raw_angle_deg"][settled].mean() - pitch_deg == pytest.approx(bias, abs=1e-3)
    assert abs(found["angle_deg"][settled] - pitch_deg).max() < 0.003
    assert found["bias_deg"][settled].mean() == pytest.approx(bias, abs=1e-3)
    np.testing.assert_allclose(
        found["raw_angle_deg"] - found["angle_deg"], found["bias_deg"], atol=2e-6
    )
    error = np.std(found["angle_deg"][settled] - pitch_deg)
    assert error < found["angle_std_deg"][settled].mean() < 0.003


@pytest.mark.parametrize(
    ("plane", "hz", "inches"),
    [("pitch", 9.2, 30.2), ("yaw", 29.8, -7.14), ("pitch", 34.2, -7.65), ("pitch", 20.3, -1.08)],
)
def test_other_modes_and_points_of_rotation_ahead(plane, hz, inches, program, rng, tmp_path):
    mode = {"plane": plane, "hz": hz, "radius": 0.0254 * inches}
    package, tangential = vibration(rng, pitch_deg=4.3, mode=mode)
    axis = {"yaw": "+y", "pitch": "+z"}[plane]
    channels = {
        "package": (package, CLOCK | PACKAGE),
        "face": (tangential, CLOCK | ACCELEROMETER | {"axis": axis}),
    }
    setup = MODE.replace("9.8", f"{hz}").replace("31", f"{inches}").replace("yaw", plane)
    found, settled = corrected(program, tmp_path, channels, FILTER + setup)
    bias = found["raw_angle_deg"][settled].mean() - 4.3
    assert bias == pytest.approx(-np.sign(inches) * 0.15, abs=2e-3)
    assert abs(found["angle_deg"][settled] - 4.3).max() < 0.003
    assert not found["flags"][settled].any()


@pytest.mark.parametrize(
    ("attrs", "setup"),
    [
        pytest.param((PACKAGE, ACCELEROMETER), "", id="record only"),
        pytest.param(({}, {}), IN_SETUP, id="setup only"),
        pytest.param(({"units": "g_0"}, {"axis": "+y", "units": "m/s**2"}), IN_SETUP, id="mixed"),
        pytest.param((PACKAGE, ACCELEROMETER), IN_SETUP, id="both"),
    ],
)
def test_channels_are_described_by_record_or_setup(attrs, setup, program, rng, tmp_path):
    package, lateral = vibration(rng)
    channels = {
        "ay_face": (lateral.astype(np.float32), CLOCK | attrs[1]),
        "package": (package, as_bytes_and_scalars(CLOCK | attrs[0])),
        "unused": (lateral, CLOCK),
    }
    found, settled = corrected(program, tmp_path, channels, FILTER + MODE + setup)
    assert abs(found["angle_deg"][settled]).max() < 0.003
    assert found["raw_angle_deg"][settled].mean() == pytest.approx(-0.15, abs=1e-3)


def test_counts_of_a_converter_with_scale_and_an_axis_turned_round(program, rng, tmp_path):
    package, lateral = vibration(rng)
    steps = {"package": 20 / 2**16, "ay_face": 200 / 2**16}
    channels = {
        "package": (
            np.rint(-package / steps["package"]).astype(np.int16),
            CLOCK | PACKAGE | {"scale": steps["package"], "axis": "-x"},
        ),
        "ay_face": (
            np.rint(-lateral / steps["ay_face"]).astype(np.int16),
            CLOCK | ACCELEROMETER | {"scale": steps["ay_face"], "axis": "-y"},
        ),
    }
    found, settled = corrected(program, tmp_path, channels, FILTER + MODE)
    assert found["raw_angle_deg"][settled].mean() == pytest.approx(-0.15, abs=1e-3)
    assert abs(found["angle_deg"][settled]).max() < 0.003


def test_an_accelerometer_ahead_of_the_package_is_brought_to_it(program, rng, tmp_path):
    package, lateral = vibration(rng, ahead=0.25)
    channels = {
        "package": (package, CLOCK | PACKAGE),
        "ay_nose": (lateral, CLOCK | ACCELEROMETER | {"station_m": 1.15}),
    }
    found, settled = corrected(program, tmp_path, channels, FILTER + MODE)
    assert abs(found["angle_deg"][settled]).max() < 0.003


@pytest.mark.parametrize(("options", "rate"), [((), 20.0), (("--rate", "50"), 50.0)])
def test_rows_start_with_the_record(options, rate, program, rng, tmp_path):
    package, lateral = vibration(rng)
    channels = {
        "package": (package, CLOCK | PACKAGE),
        "ay_face": (lateral, CLOCK | ACCELEROMETER),
    }
    found, _ = corrected(program, tmp_path, channels, FILTER + MODE, *options)
    expected = np.arange(round(24 * rate)) / rate - 2.0
    np.testing.assert_allclose(found["time_s"], expected, atol=5.1e-7)


def test_causal_filter_lags_and_the_other_does_not(program, rng, tmp_path):
    """A ramp of pitch: a forward filter shows it late by its delay, 2 zeta / omega."""
    speed, seconds = 0.05, 24.0
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    package = np.sin(np.radians(speed * time)) + rng.normal(0, 2e-4, time.size)
    channels = {
        "package": (package, CLOCK | PACKAGE),
        "ay_face": (rng.normal(0, 5e-3, time.size), CLOCK | ACCELEROMETER),
    }
    delay = np.sqrt(2) / (2 * np.pi * 0.4)
    for options, lag in (((), 0.0), (("--causal", "--overwrite"), delay)):
        found, settled = corrected(program, tmp_path, channels, FILTER + MODE, *options)
        late = (found["time_s"] + 2.0) * speed - found["angle_deg"]
        assert late[settled].mean() == pytest.approx(lag * speed, abs=5e-4)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("stored", [np.float64, np.float32, np.int16])
def test_a_clipped_channel_is_flagged(stored, side, program, rng, tmp_path):
    """Also where a converter's highest code lies one step below the top of its range."""
    package, lateral = vibration(rng)
    limit = 0.9 * np.abs(lateral).max()
    step = limit / 2**15
    middle = np.arange(lateral.size) // RATE_HZ == 12  # one second
    cut = np.where(middle, side * np.clip(side * lateral, -0.5 * limit, limit), 0.5 * lateral)
    if stored is np.int16:
        samples = np.clip(np.rint(cut / step), -(2**15), 2**15 - 1).astype(np.int16)
    else:
        samples, step = cut.astype(stored), 1.0
    channels = {
        "package": (package, CLOCK | PACKAGE),
        "ay_face": (samples, CLOCK | ACCELEROMETER | {"range": [-limit, limit], "scale": step}),
    }
    found, _ = corrected(program, tmp_path, channels, FILTER + MODE)
    flagged = (found["flags"].astype(int) & CLIPPED) > 0
    at = (found["time_s"] + 2.0 >= 12) & (found["time_s"] + 2.0 <= 13)
    assert flagged[at].all()
    assert not flagged[found["time_s"] + 2.0 < 8].any()


def test_attributes_that_say_nothing_are_left_to_the_setup(program, rng, tmp_path):
    """Some writers fill in every attribute, also where there is nothing to say."""
    package, lateral = vibration(rng)
    nothing = {"station_m": np.nan, "axis": "", "range": [np.nan, np.nan]}
    channels = {
        "package": (package, CLOCK | PACKAGE | nothing),
        "ay_face": (lateral, CLOCK | ACCELEROMETER | nothing),
        "yaw_moment": (lateral, CLOCK | {"quantity": "moment", "units": "lbf*in"} | nothing),
    }
    found, settled = corrected(program, tmp_path, channels, FILTER + MODE + IN_SETUP)
    assert abs(found["angle_deg"][settled]).max() < 0.003


def test_a_record_too_short_is_one_sentence(program, rng, tmp_path):
    package, lateral = vibration(rng, seconds=0.5)
    channels = {
        "package": (package, CLOCK | PACKAGE),
        "ay_face": (lateral, CLOCK | ACCELEROMETER),
    }
    record = write_h5(tmp_path / "record.h5", channels=channels)
    setup = written(tmp_path / "s.toml", FILTER + MODE)
    code, _, said = program("correct", record, "--setup", setup, "--out", tmp_path / "out")
    assert code == 2
    assert said.startswith("glint-aoa: ")
    assert "lasts 0.5 s" in said
    assert said.count("\n") == 1


def test_setup_that_contradicts_a_channel_is_an_error(program, rng, tmp_path):
    package, lateral = vibration(rng, seconds=4)
    record = write_h5(
        tmp_path / "record.h5",
        channels={
            "package": (package, CLOCK | PACKAGE),
            "ay_face": (lateral, CLOCK | ACCELEROMETER | {"station_m": 0.8}),
        },
    )
    setup = written(tmp_path / "s.toml", FILTER + MODE + IN_SETUP)
    code, _, said = program("correct", record, "--setup", setup, "--out", tmp_path / "out")
    assert code == 2
    assert "ay_face" in said
    assert "station_m" in said
    assert not (tmp_path / "out").exists()


# Calibration


def static_point(path, rng, pitch_deg):
    """A model at rest whose glint shows 0.99 times the angle, and 0.02 deg more."""
    line = Line(0.99 * pitch_deg + 0.02)
    filmed = film(Camera(), line, Window(first_line=78), rng, n_fields=12)
    package = np.sin(np.radians(pitch_deg)) + rng.normal(0, 2e-4, 1600)
    channels = {"package": (package, {"rate_hz": RATE_HZ, "start_s": -1.0} | PACKAGE)}
    write_h5(path, filmed, channels=channels)
    return filmed


def test_sweep_takes_out_what_the_glint_adds(program, rng, tmp_path):
    pitches = (-4.0, -2.0, 0.0, 2.0, 4.0, 5.0)
    points = [tmp_path / f"sweep-{k}.h5" for k in range(len(pitches))]
    for point, pitch in zip(points, pitches, strict=True):
        static_point(point, rng, pitch)
    plain = written(tmp_path / "plain.toml", Camera().toml + LEVEL.toml)
    sweep = tmp_path / "sweep.toml"
    code, _, said = program("calibrate", "sweep", *points, "--setup", plain, "--out", sweep)
    assert code == 0, said

    filmed = static_point(tmp_path / "inside.h5", rng, 3.1)
    static_point(tmp_path / "outside.h5", rng, 6.0)
    setup = written(
        tmp_path / "s.toml",
        Camera().toml + LEVEL.toml + '[calibration]\nsweep = "sweep.toml"\n',
    )
    out = tmp_path / "out"
    names = [tmp_path / "inside.h5", tmp_path / "outside.h5"]
    assert program("process", *names, "--setup", setup, "--out", out)[0] == 0
    with xr.open_dataset(out / "inside.nc", engine="h5netcdf") as found:
        # The sweep's own points add about as much noise again.
        limit = 2 * tolerance(filmed.angle_bound_deg, 12)
        assert abs(found["angle_deg"].mean() - 3.1) < limit
        assert abs(found["angle_raw_deg"].mean() - (0.99 * 3.1 + 0.02)) < limit
        assert (found["angle_systematic_std_deg"] > 0).all()
        assert (found["angle_systematic_std_deg"] < limit).all()
        assert not found["flags"].any()
    assert set(table(out / "outside.csv")["flags"]) == {OUTSIDE}


def test_points_are_only_read(program, rng, tmp_path):
    path = tmp_path / "p.h5"
    static_point(path, rng, 1.0)
    before = path.read_bytes()
    setup = written(tmp_path / "s.toml", Camera().toml + LEVEL.toml)
    program("process", path, "--setup", setup, "--out", tmp_path / "out")
    assert path.read_bytes() == before
    with h5py.File(path) as file:
        assert set(file) == {"das", "fields", "meta"}
