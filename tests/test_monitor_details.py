"""What the page shows of one point, held against lines, angles and tones in closed form."""

import re

import numpy as np
import pytest
from synthetic import line_fields

from glint_aoa.errors import OutputError
from glint_aoa.monitor.details import grey_picture, point_details, point_row
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.records.tables import read_csv
from glint_aoa.setup import load_setup

RATE_HZ, SECONDS = 400.0, 8.0
TONE_HZ, TONE = 9.25, 3.0
ONBOARD_DEG, SLOPE, ROW = 1.5, 0.01, 30.0
N_FIELDS = 12


def channels():
    time_s = np.arange(round(RATE_HZ * SECONDS)) / RATE_HZ
    noise = 1e-7 * np.random.default_rng(3).standard_normal(time_s.size)
    gravity = np.full(time_s.size, np.sin(np.radians(ONBOARD_DEG))) + noise
    tone = TONE * np.sin(2 * np.pi * TONE_HZ * time_s)
    made = [
        Channel("aoa", gravity, RATE_HZ, quantity="aoa_unfiltered", units="g_0", axis="+x"),
        Channel("pitch_moment", tone, RATE_HZ, quantity="moment", units="N*m", axis="-y"),
        Channel("again", tone, RATE_HZ, quantity="moment", units="N*m", axis="-y"),
    ]
    return AcquisitionRecord("p", {each.name: each for each in made}, {})


def write(path, *, acquisition=None, seed=1):
    fields = line_fields(
        np.random.default_rng(seed), n_fields=N_FIELDS, shape=(60, 200), slope=SLOPE, row=ROW
    )
    info = FieldInfo(rate_hz=60.0, exposure_s=1e-3, interlaced=False)
    write_point(path, RecordedPoint(fields=fields, info=info, acquisition=acquisition))
    return path


@pytest.fixture
def setup(tmp_path):
    (tmp_path / "glint-aoa.toml").write_text('[glint]\nnose = "right"\n')
    return load_setup(tmp_path / "glint-aoa.toml")


@pytest.fixture
def point(tmp_path):
    return write(tmp_path / "p.h5", acquisition=channels())


@pytest.fixture
def results(tmp_path):
    return tmp_path / "results"


def test_a_point_is_measured_once_and_its_row_is_the_log_s(point, setup, results):
    row = point_row(point, setup, results)
    written = results.joinpath("p.csv").stat().st_mtime_ns
    assert point_row(point, setup, results) == row
    assert results.joinpath("p.csv").stat().st_mtime_ns == written
    assert {name: [cell] for name, cell in row.items()} == read_csv(results / "log.csv")
    assert float(row["mean_angle_deg"]) == pytest.approx(-np.degrees(np.arctan(SLOPE)), abs=0.01)


def test_a_point_that_has_changed_is_measured_again(point, setup, results):
    first = point_row(point, setup, results)
    point.unlink()
    write(point, seed=2)
    again = point_row(point, setup, results, again=True)
    assert again["mean_angle_deg"] != first["mean_angle_deg"]
    assert len(read_csv(results / "log.csv")["point"]) == 2


def test_results_of_another_setup_are_not_shown(point, setup, results, tmp_path):
    point_row(point, setup, results)
    (tmp_path / "other.toml").write_text('[glint]\nnose = "left"\n')
    sentence = (
        f"{results}: p has results of another setup there; "
        "start the monitor with another --results, or move them away"
    )
    with pytest.raises(OutputError, match=re.escape(sentence)):
        point_row(point, load_setup(tmp_path / "other.toml"), results)


def test_the_line_is_drawn_where_the_glint_is(point, setup, results):
    point_row(point, setup, results)
    picture = point_details(point, setup, results).picture
    assert picture.number == N_FIELDS - 1
    assert picture.shape == (60, 200) == picture.levels.shape
    truth = ROW + SLOPE * (np.arange(200) - 99.5)
    np.testing.assert_allclose(picture.line_row, truth, atol=0.1)
    rows = np.argmax(picture.levels, axis=0)
    assert np.abs(rows - picture.line_row).max() < 1.5


def test_angles_and_flags_are_those_of_the_results(point, setup, results):
    point_row(point, setup, results)
    details = point_details(point, setup, results)
    table = read_csv(results / "p.csv")
    np.testing.assert_array_equal(details.angle_deg, np.array(table["angle_deg"], float))
    np.testing.assert_allclose(
        details.u95_deg, 1.959964 * np.array(table["angle_std_deg"], float), rtol=1e-6
    )
    np.testing.assert_array_equal(details.flags, np.array(table["flags"], int))


def test_the_onboard_angle_is_shown_raw_where_it_cannot_be_corrected(point, setup, results):
    point_row(point, setup, results)
    onboard = point_details(point, setup, results).onboard
    assert onboard.raw_mean_deg == pytest.approx(ONBOARD_DEG, abs=1e-5)


def test_a_tone_has_its_power_at_its_frequency(point, setup, results):
    point_row(point, setup, results)
    (spectrum,) = point_details(point, setup, results).spectra
    assert (spectrum.channel, spectrum.units) == ("pitch_moment", "N*m")
    assert spectrum.frequency_hz[np.argmax(spectrum.density)] == TONE_HZ
    power = np.sum(spectrum.density**2) * np.diff(spectrum.frequency_hz)[0]
    assert power == pytest.approx(TONE**2 / 2, rel=1e-6)
    assert spectrum.frequency_hz[-1] == 100.0


def test_a_point_without_channels_has_no_onboard_angle(tmp_path, setup, results):
    point = write(tmp_path / "q.h5")
    point_row(point, setup, results)
    details = point_details(point, setup, results)
    assert details.onboard is None
    assert details.spectra == () == details.notes


def test_what_has_gone_is_named_and_the_rest_is_shown(point, setup, results):
    point_row(point, setup, results)
    point.unlink()
    details = point_details(point, setup, results)
    assert details.picture is None
    assert details.notes == (f"{point}: no such file; check its name and folder",)
    assert details.angle_deg.size == N_FIELDS


def test_large_fields_are_thinned_out_and_keep_their_scale():
    field = np.full((1200, 1600), 4095, np.uint16)
    picture = grey_picture(field, 4095)
    assert picture.size <= 300_000
    assert set(np.unique(picture)) == {255}
