"""What a setup says of its geometry's uncertainty reaches the measured angle."""

import re

import numpy as np
import pytest
from synthetic import line_fields

from calibration.sweep.fit import fit_sweep
from glint_aoa.errors import CalibrationError
from glint_aoa.process import load_sweep, measure_point, process_point
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.setup import load_setup

CAMERA = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [375.5, 119.5]
position = ["0 m", "-56 in", "60 mm"]
"""
INFO = FieldInfo(rate_hz=60.0, exposure_s=1e-3, first_line=98, interlaced=False)


@pytest.fixture(scope="module")
def stack():
    fields = line_fields(np.random.default_rng(1), n_fields=12, slope=0.01, row=30.0)
    return FieldStack.from_array(fields, INFO)


@pytest.fixture
def measured(stack, tmp_path):
    def measure(text=""):
        path = tmp_path / "glint-aoa.toml"
        path.write_text(CAMERA + text)
        setup = load_setup(path)
        return measure_point(stack, setup, sweep=load_sweep(setup))

    return measure


def test_roll_of_the_camera_is_that_of_the_angle(measured):
    plain = measured()
    rolled = measured('[uncertainty]\nrotation = ["0 deg", "0.02 deg", "0 deg"]\n')
    before, after = (each.record["angle_systematic_std_deg"].to_numpy() for each in (plain, rolled))
    np.testing.assert_allclose(after, np.hypot(before, 0.02), rtol=1e-6)
    np.testing.assert_array_equal(rolled.record["angle_deg"], plain.record["angle_deg"])
    np.testing.assert_array_equal(rolled.record["angle_std_deg"], plain.record["angle_std_deg"])
    # What is left over is Student's: the noise is known from the record alone.
    added = rolled.log["mean_angle_u95_deg"] ** 2 - plain.log["mean_angle_u95_deg"] ** 2
    assert np.sqrt(added) == pytest.approx(1.959964 * 0.02, rel=1e-4)


def test_height_over_the_camera_counts_with_a_turned_one(measured):
    turned = measured('[uncertainty]\nrotation = ["0 deg", "0 deg", "1 deg"]\n')
    alpha = np.radians(turned.record["angle_deg"].to_numpy())
    above = (turned.record["intercept_mm"].to_numpy() - 60) / 1422.4
    expected = np.abs(above * np.cos(alpha) ** 2)
    got = turned.record["angle_systematic_std_deg"].to_numpy()
    doubt = measured().record["angle_systematic_std_deg"].to_numpy()
    np.testing.assert_allclose(got, np.hypot(expected, doubt), rtol=1e-4)


def test_what_a_sweep_takes_out_is_not_counted(measured, tmp_path):
    angles = np.arange(-4.0, 4.1, 1.0)
    fit_sweep(angles, 1e-4, angles, 1e-4, degree=2).save(tmp_path / "sweep.toml")
    swept = '[calibration]\nsweep = "sweep.toml"\n'
    plain = measured(swept)
    rolled = measured(swept + '[uncertainty]\nrotation = ["0 deg", "1 deg", "0 deg"]\n')
    np.testing.assert_allclose(
        rolled.record["angle_systematic_std_deg"],
        plain.record["angle_systematic_std_deg"],
        rtol=1e-3,
    )


def test_a_sweep_that_scatters_widens_the_mean_by_its_degrees_of_freedom(measured, tmp_path):
    angles = np.arange(-4.0, 4.1, 2.0)
    onboard = angles + 0.05 * np.array([1, -1, 0.5, -1, 1])
    sweep = fit_sweep(angles, 1e-4, onboard, 1e-4, degree=1)
    sweep.save(tmp_path / "sweep.toml")
    log = measured('[calibration]\nsweep = "sweep.toml"\n').log
    assert sweep.scatter_freedom == pytest.approx(3, rel=1e-3)
    systematic = float(sweep.apply(log["mean_angle_deg"]).systematic_std_deg)
    assert systematic > 20 * log["mean_angle_std_deg"]
    assert log["mean_angle_u95_deg"] == pytest.approx(3.182 * systematic, rel=5e-3)


def test_a_calibration_that_cannot_be_used_is_said_before_anything_is_measured(tmp_path):
    fields = np.zeros((4, 40, 200), np.uint8)
    recorded = RecordedPoint(
        fields=fields, info=INFO, fields_time_s=None, acquisition=None, truth={}, meta={}
    )
    write_point(tmp_path / "point.h5", recorded)
    camera = tmp_path / "camera.toml"
    camera.write_text(f'kind = "camera calibration"\n{CAMERA}')
    path = tmp_path / "glint-aoa.toml"
    path.write_text('[calibration]\ncamera = "camera.toml"\n')
    message = f"{camera}: not a camera calibration that can be used ("
    with pytest.raises(CalibrationError, match=re.escape(message)):
        process_point(tmp_path / "point.h5", load_setup(path), tmp_path / "out")
    assert not (tmp_path / "out").exists()
