"""Modal surveys: known modes back from responses, from records and from universal files."""

import json
import re

import numpy as np
import pytest
import pyuff
import recordings

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial.analyser import frequency_responses
from glint_aoa.inertial.identification import (
    SurveyResponses,
    mode_shapes,
    natural_frequencies,
    real_shape,
)
from glint_aoa.inertial.modes import TABLE_1, Mode, modes_from_setup, rotation_point
from glint_aoa.inertial.survey import read_survey, survey_record, survey_responses
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.formats.modal_survey import is_survey, read_survey_file
from glint_aoa.setup import load_setup

RATE_HZ = 800.0
SENSOR_M, FORCE_M = 0.9, 0.45
STATION = np.array([0.1, 0.35, 0.55, 0.9])
DAMPING = {1: 0.015, 2: 0.014, 3: 0.010, 4: 0.010, 5: 0.008, 6: 0.008}
BINS = np.arange(0, 100, 0.05)


def table(plane):
    return [mode for mode in TABLE_1 if mode.plane == plane]


def responses_at(frequency_hz, modes, power=2):
    """Receptance (power 0) or accelerance (2) of rigid modes of unit modal mass, closed form."""
    circular = 2 * np.pi * frequency_hz
    total = np.zeros((STATION.size, circular.size), complex)
    for mode in modes:
        fixed = SENSOR_M - mode.radius_m
        natural = 2 * np.pi * mode.frequency_hz
        simple = natural**2 - circular**2 + 2j * DAMPING[mode.number] * natural * circular
        total += np.outer((STATION - fixed) * (FORCE_M - fixed), (1j * circular) ** power / simple)
    return total


def a_record(plane, force, *, noise=0.0, seed=0):
    """Record of the accelerometers under a force; the force's spectrum times the closed form."""
    frequency = np.fft.rfftfreq(force.size, 1 / RATE_HZ)
    spectra = np.fft.rfft(force) * responses_at(frequency, table(plane))
    signals = np.fft.irfft(spectra, force.size)
    signals += noise * np.random.default_rng(seed).standard_normal(signals.shape)
    letter = "y" if plane == "yaw" else "z"
    channels = {"force": Channel("force", force, RATE_HZ, quantity="excitation", units="N")}
    for number, (station, signal) in enumerate(zip(STATION, signals, strict=True)):
        turned = number == 1  # one mounted the other way round
        channels[f"a{number}"] = Channel(
            f"a{number}",
            -signal if turned else signal,
            RATE_HZ,
            quantity="acceleration",
            units="m/s^2",
            station_m=float(station),
            axis=f"{'-' if turned else '+'}{letter}",
        )
    return AcquisitionRecord("survey", channels)


def random_force(seed=1, duration_s=96.0):
    return np.random.default_rng(seed).standard_normal(round(duration_s * RATE_HZ))


def sweep(duration_s=128.0):
    """Sine from 5 to 60 Hz at a constant rate, up and down again."""
    time = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    half = duration_s / 2
    rising = np.where(time < half, time, duration_s - time)
    return np.sin(2 * np.pi * np.cumsum(4.0 + 58.0 * rising / half) / RATE_HZ)


@pytest.mark.parametrize("plane", ["yaw", "pitch"])
@pytest.mark.parametrize("form", ["accelerance", "mobility", "receptance"])
def test_exact_responses_give_back_the_modes(plane, form):
    power = ["receptance", "mobility", "accelerance"].index(form)
    responses = SurveyResponses(plane, BINS, responses_at(BINS, table(plane), power), STATION, form)
    shapes = mode_shapes(responses)
    assert len(shapes) == 3
    for shape, mode in zip(shapes, table(plane), strict=True):
        found = rotation_point(shape, SENSOR_M)
        assert shape.frequency_hz == pytest.approx(mode.frequency_hz, abs=0.002)
        assert shape.damping == pytest.approx(DAMPING[mode.number], rel=0.01)
        assert shape.collinearity == pytest.approx(1.0, abs=1e-4)
        assert found.mode.radius_m == pytest.approx(mode.radius_m, abs=2e-4)
        assert found.is_rigid


def test_two_modes_as_close_as_8_8_and_9_8_hz_are_told_apart():
    close = [Mode(1, "yaw", 8.8, 0.9), Mode(2, "yaw", 9.8, 0.3)]
    responses = SurveyResponses("yaw", BINS, responses_at(BINS, close), STATION)
    shapes = mode_shapes(responses, near_hz=[8.8, 9.8])
    radii = [rotation_point(shape, SENSOR_M).mode.radius_m for shape in shapes]
    assert [shape.frequency_hz for shape in shapes] == pytest.approx([8.8, 9.8], abs=0.01)
    assert radii == pytest.approx([0.9, 0.3], rel=0.01)


@pytest.mark.parametrize("plane", ["yaw", "pitch"])
@pytest.mark.parametrize("force", [random_force(), sweep()], ids=["random", "sine sweep"])
def test_a_record_gives_back_table_1(plane, force):
    shapes = survey_record(a_record(plane, force, noise=0.02), "force", plane)
    assert [shape.number for shape in shapes] == [1, 2, 3]
    for shape, mode in zip(shapes, table(plane), strict=True):
        found = rotation_point(shape, SENSOR_M)
        error = found.mode.radius_m - mode.radius_m
        assert shape.frequency_hz == pytest.approx(mode.frequency_hz, abs=0.02)
        assert abs(error) < max(0.01 * abs(mode.radius_m), 1e-3)
        assert abs(error) < 3 * found.radius_std_m
        assert abs(shape.frequency_hz - mode.frequency_hz) < 3 * shape.frequency_std_hz
        assert found.is_rigid


def test_natural_frequencies_come_from_a_sine_sweep():
    responses = frequency_responses(
        a_record("pitch", sweep()), "force", ["a0", "a2", "a3"], segment_s=16.0
    )
    found = natural_frequencies(survey_responses(responses, "pitch"))
    assert found == pytest.approx([9.2, 20.3, 34.2], abs=0.1)


def test_a_shape_keeps_its_signs_when_it_is_turned_real():
    shape = np.array([-0.4, 0.1, 0.8])
    turned, collinearity = real_shape(shape * np.exp(2.1j))
    np.testing.assert_allclose(turned, shape, atol=1e-12)
    assert collinearity == pytest.approx(1.0)
    assert real_shape(np.array([1, 1j]))[1] == pytest.approx(0.0, abs=1e-12)


def nodes_set(positions, kind=15):
    labels = np.arange(1, len(positions) + 1)
    x, y, z = np.asarray(positions, float).T
    zeros = np.zeros(labels.size, int)
    given = {"node_nums": labels, "x": x, "y": y, "z": z}
    return {"type": kind, "def_cs": zeros, "disp_cs": zeros, "color": zeros, **given}


def shape_set(number, frequency_hz, vectors):
    columns = {f"r{i + 1}": np.asarray(vectors)[:, i] for i in range(3)}
    return pyuff.prepare_55(
        model_type=1, id1="NONE", id2="NONE", id3="NONE", id4="NONE", id5="NONE",
        analysis_type=2, data_ch=2, spec_data_type=8, data_type=2, n_data_per_node=3,
        node_nums=list(range(1, len(vectors) + 1)), load_case=1, mode_n=number, modal_m=1.0,
        freq=frequency_hz, modal_damp_vis=0.01, modal_damp_his=0.0, **columns,
    )  # fmt: skip


def response_set(node, direction, frequency_hz, values, *, kind=12):
    return pyuff.prepare_58(
        binary=0, func_type=4, rsp_node=node, rsp_dir=direction, ref_node=9, ref_dir=direction,
        data=values, x=frequency_hz, id1="NONE", rsp_ent_name="NONE", ref_ent_name="NONE",
        abscissa_spacing=1, abscissa_spec_data_type=18, ordinate_spec_data_type=kind,
        orddenom_spec_data_type=13,
    )  # fmt: skip


def write(path, sets):
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    return path


def units_set(length):
    return pyuff.prepare_164(
        units_code=9, units_description="inch", temp_mode=1, length=length, force=1.0, temp=1.0,
        temp_offset=0.0,
    )  # fmt: skip


def test_mode_shapes_are_read_from_data_set_55(tmp_path):
    """In inches, with the file's -x to the nose and +y up: model y is the file's z."""
    inches = [[-39.3700787 * station, 0.0, 0.0] for station in STATION]
    sets = [units_set(39.3700787), nodes_set(inches)]
    for mode in reversed(TABLE_1):
        along = STATION - (SENSOR_M - mode.radius_m)
        vectors = np.zeros((STATION.size, 3))
        vectors[:, 2 if mode.plane == "yaw" else 1] = along
        sets.append(shape_set(mode.number, mode.frequency_hz, vectors))
    path = write(tmp_path / "survey.uff", sets)
    assert is_survey(path)
    shapes = read_survey(path, forward="-x", up="+y")
    assert [shape.number for shape in shapes] == [2, 1, 3, 4, 5, 6]
    for shape in shapes:
        mode = TABLE_1[shape.number - 1]
        assert (shape.plane, shape.frequency_hz) == (mode.plane, mode.frequency_hz)
        assert shape.damping == 0.01
        found = rotation_point(shape, SENSOR_M)
        assert found.mode.radius_m == pytest.approx(mode.radius_m, abs=2e-5)


def test_only_the_nodes_asked_for_count_and_unmeasured_ones_do_not(tmp_path):
    positions = [*([s, 0, 0] for s in STATION), [0.2, 0.4, 0.0], [0.3, 0.0, 0.0]]
    vectors = np.zeros((6, 3))
    vectors[:4, 1] = STATION - 0.113
    vectors[4, 1] = 5.0  # a wing's tip
    path = write(tmp_path / "s.unv", [nodes_set(positions, 2411), shape_set(1, 9.8, vectors)])
    (shape,) = read_survey(path, nodes=[1, 2, 3, 4, 6], origin_m=0.02)
    np.testing.assert_allclose(shape.station_m, STATION + 0.02)
    assert rotation_point(shape, 0.92).mode.radius_m == pytest.approx(0.787, abs=1e-4)


def test_modes_are_identified_from_data_set_58(tmp_path):
    sets = [nodes_set([[s, 0, 0] for s in STATION])]
    for plane, direction in (("yaw", 2), ("pitch", -3)):
        values = responses_at(BINS, table(plane)) * np.sign(direction)
        sets += [response_set(i + 1, direction, BINS, row) for i, row in enumerate(values)]
    path = write(tmp_path / "frf.uff", sets)
    assert is_survey(path)
    shapes = read_survey(path)
    expected = sorted(TABLE_1, key=lambda mode: mode.frequency_hz)
    assert [shape.number for shape in shapes] == [1, 2, 3, 4, 5, 6]
    assert [shape.plane for shape in shapes] == [mode.plane for mode in expected]
    for shape, mode in zip(shapes, expected, strict=True):
        found = rotation_point(shape, SENSOR_M)
        assert found.mode.radius_m == pytest.approx(mode.radius_m, abs=5e-4)


def test_files_that_are_no_surveys_say_what_they_lack(tmp_path):
    shape = shape_set(1, 9.8, np.ones((4, 3)))
    nodes = nodes_set([[s, 0, 0] for s in STATION])
    flat = write(tmp_path / "flat.uff", [shape])
    with pytest.raises(RecordingError, match=re.escape("holds no nodes (data set 15 or 2411)")):
        read_survey_file(flat)
    empty = write(tmp_path / "empty.uff", [nodes])
    assert not is_survey(empty)
    with pytest.raises(RecordingError, match=re.escape("holds no mode shapes (data set 55)")):
        read_survey_file(empty)
    strain = response_set(1, 2, BINS, np.ones(BINS.size, complex), kind=3)
    with pytest.raises(RecordingError, match=re.escape("node 1 measures data type 3, expected 8")):
        read_survey_file(write(tmp_path / "strain.uff", [nodes, strain]))
    with pytest.raises(RecordingError, match=re.escape("none.uff: no such file")):
        read_survey_file(tmp_path / "none.uff")
    good = write(tmp_path / "good.uff", [nodes, shape])
    for options, message in (
        ({"low_hz": 20.0}, "no mode between 20 and 60 Hz; widen the band"),
        ({"forward": "x"}, "forward is 'x'; choose one of +x, -x, +y, -y, +z, -z"),
        ({"up": "-x"}, "forward +x and up -x lie along one axis; give two axes"),
        ({"nodes": [7]}, "mode 1 does not move the nodes chosen"),
    ):
        with pytest.raises(InputError, match=re.escape(message)):
            read_survey(good, **options)
    lost = write(tmp_path / "lost.uff", [nodes_set([[0, 0, 0]]), shape])
    with pytest.raises(RecordingError, match=re.escape("node 2 has no position")):
        read_survey(lost, nodes=[1, 2])


def test_a_real_recording_of_a_microphone_is_no_survey():
    for name in ("sample58_ascii.uff", "sample58_binary.uff"):
        path = recordings.recording(f"das/{name}")
        assert not is_survey(path)
        with pytest.raises(RecordingError, match="holds no mode shapes"):
            read_survey_file(path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"near_hz": [14.0]}, "no mode settles near 14 Hz"),
        ({"high_hz": 120.0}, "the band from 5 to 120 Hz does not lie within the responses"),
        ({"low_hz": 45.0}, "no resonance stands out between 45 and 60 Hz"),
    ],
)
def test_modes_that_are_not_there_are_not_made_up(options, message):
    responses = SurveyResponses("yaw", BINS, responses_at(BINS, table("yaw")), STATION)
    with pytest.raises(InputError, match=re.escape(message)):
        mode_shapes(responses, **options)


def test_a_record_without_accelerometers_of_the_plane_is_refused():
    record = a_record("yaw", random_force(duration_s=20.0))
    with pytest.raises(
        InputError, match=re.escape("no accelerometer along model z with a station")
    ):
        survey_record(record, "force", "pitch")
    with pytest.raises(InputError, match=re.escape("at two stations or more, but 1 was given")):
        survey_responses(frequency_responses(record, "force", ["a0"], segment_s=4.0), "yaw")


@pytest.fixture
def program(program, monkeypatch, tmp_path):
    """Run the program in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return program


def a_survey_file(tmp_path, *, bend=0.0):
    sets = [nodes_set([[s, 0, 0] for s in STATION])]
    for mode in TABLE_1[:2]:
        vectors = np.zeros((STATION.size, 3))
        along = STATION - (SENSOR_M - mode.radius_m) + bend * (STATION - 0.5) ** 2
        vectors[:, 1 if mode.plane == "yaw" else 2] = along
        sets.append(shape_set(mode.number, mode.frequency_hz, vectors))
    setup = tmp_path / "setup.toml"
    setup.write_text(
        '[[inertial.channel]]\nname = "aoa"\nquantity = "aoa_unfiltered"\nunits = "g_0"\n'
        'station = "0.9 m"\n'
    )
    return write(tmp_path / "survey.uff", sets), setup


def test_inspect_prints_table_1_and_modes_that_a_setup_takes(program, tmp_path):
    survey, setup = a_survey_file(tmp_path)
    code, out, err = program("inspect", survey, "--setup", setup)
    assert (code, err) == (0, "")
    printed, blocks = out.split("\n\n", 1)
    assert re.search(r"^2 +pitch +9.20 +0.0100 +30.20 +0.00 +aft +0.0% +yes$", printed, re.M)
    setup.write_text(setup.read_text() + blocks)
    modes = modes_from_setup(load_setup(setup).inertial)
    assert [mode.number for mode in modes] == [2, 1]
    assert modes[1].radius_m == pytest.approx(31.0 * 0.0254, abs=2e-5)


def test_inspect_says_of_a_fuselage_that_bends_that_it_does(program, tmp_path):
    survey, setup = a_survey_file(tmp_path, bend=1.5)
    code, out, err = program("inspect", survey, "--setup", setup, "--json")
    assert (code, err) == (0, "")
    assert [mode["is_rigid"] for mode in json.loads(out)["modes"]] == [False, False]
    _, _, err = program("inspect", survey, "--setup", setup)
    assert "mode 1: the fuselage bends, so its radius is that of the best straight line only" in err


def test_inspect_of_a_survey_asks_where_the_package_is(program, tmp_path):
    survey, _ = a_survey_file(tmp_path)
    assert program("inspect", survey) == (
        2,
        "",
        f"glint-aoa: {survey}: effective radii start at the inertial package; give --setup with "
        "its station under [[inertial.channel]]\n",
    )
