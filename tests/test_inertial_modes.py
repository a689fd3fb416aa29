import re
import tomllib

import numpy as np
import pytest

from glint_aoa.errors import InputError
from glint_aoa.inertial.modes import (
    TABLE_1,
    Mode,
    ModeShape,
    modes_from_setup,
    modes_toml,
    rotation_point,
)
from glint_aoa.setup import Inertial


def a_mode(number, frequency, plane="yaw"):
    return {"number": number, "plane": plane, "frequency": f"{frequency} Hz", "radius": "31 in"}


def test_table_1_is_the_papers():
    inches = {mode.number: mode.radius_m / 0.0254 for mode in TABLE_1}
    expected = {1: 31.0, 2: 30.2, 3: 0.18, 4: -1.08, 5: -7.14, 6: -7.65}
    assert inches == pytest.approx(expected)
    assert [mode.plane for mode in TABLE_1] == ["yaw", "pitch"] * 3
    assert [mode.frequency_hz for mode in TABLE_1] == [9.8, 9.2, 19.5, 20.3, 29.8, 34.2]


def test_modes_of_the_setup_come_in_order_of_frequency():
    inertial = Inertial.model_validate({"mode": [a_mode(5, 29.8), a_mode(1, 9.8)]})
    assert modes_from_setup(inertial) == (
        Mode(1, "yaw", 9.8, pytest.approx(0.7874)),
        Mode(5, "yaw", 29.8, pytest.approx(0.7874)),
    )


def test_no_modes_are_no_modes():
    assert modes_from_setup(Inertial()) == ()


def test_a_number_listed_twice_is_refused():
    inertial = Inertial.model_validate({"mode": [a_mode(1, 9.8), a_mode(1, 19.5)]})
    message = "inertial.mode: number 1 is listed twice; number modes apart"
    with pytest.raises(InputError, match=re.escape(message)):
        modes_from_setup(inertial)


def a_shape(station, coefficient, **more):
    given = {"number": 1, "plane": "yaw", "frequency_hz": 9.8, **more}
    return ModeShape(
        station_m=np.asarray(station, float), coefficient=np.asarray(coefficient, float), **given
    )


@pytest.mark.parametrize("mode", TABLE_1)
def test_a_rigid_shape_gives_back_the_radius_of_table_1(mode):
    station = np.array([0.1, 0.3, 0.55, 0.9])
    fixed = 0.9 - mode.radius_m
    shape = a_shape(station, -3.0 * (station - fixed), number=mode.number, plane=mode.plane)
    found = rotation_point(shape, 0.9)
    assert found.mode.radius_m == pytest.approx(mode.radius_m, rel=1e-9)
    assert found.station_m == pytest.approx(fixed, rel=1e-9)
    assert found.residual < 1e-12
    assert found.is_rigid


def test_the_line_is_that_of_an_independent_fit():
    rng = np.random.default_rng(1)
    station = np.linspace(0.0, 1.0, 7)
    noise = rng.uniform(0.005, 0.02, 7)
    shape = a_shape(station, 0.3 + station + noise * rng.standard_normal(7), coefficient_std=noise)
    found = rotation_point(shape, 0.9, sensor_std_m=0.001)
    line, covariance = np.polyfit(station, shape.coefficient, 1, w=1 / noise, cov="unscaled")
    left = (shape.coefficient - np.polyval(line, station)) / noise
    covariance = covariance * max(1.0, left @ left / 5)
    gradient = np.array([line[1] / line[0] ** 2, -1 / line[0]])
    assert found.station_m == pytest.approx(-line[1] / line[0], rel=1e-9)
    variance = gradient @ covariance @ gradient
    expected = [[variance, -variance], [-variance, variance + 1e-6]]
    np.testing.assert_allclose(found.covariance[1:, 1:], expected, rtol=1e-6)


def test_the_standard_deviation_of_the_radius_covers_its_scatter():
    rng = np.random.default_rng(2)
    station = np.array([0.1, 0.55, 0.9, 1.1])
    noise = np.full(4, 0.01)
    errors = []
    for _ in range(1000):
        measured = (station - 0.113) + noise * rng.standard_normal(4)
        found = rotation_point(a_shape(station, measured, coefficient_std=noise), 0.9)
        errors.append((found.mode.radius_m - 0.787) / found.radius_std_m)
    inside = np.mean(np.abs(errors) < 1.96)
    assert 0.93 < inside < 0.985  # wider than nominal where the scatter is above the noise


def test_a_fuselage_that_bends_is_told_from_a_rigid_one():
    station = np.linspace(0.0, 1.2, 6)
    bent = a_shape(station, (station - 0.1) + 0.4 * station**2)
    found = rotation_point(bent, 0.9)
    assert found.residual > 0.01
    assert found.is_rigid
    worse = rotation_point(a_shape(station, (station - 0.5) + 0.9 * (station - 0.6) ** 2), 0.9)
    assert not worse.is_rigid


def test_noise_alone_is_not_taken_for_bending():
    noise = np.full(5, 0.1)
    shape = a_shape(np.linspace(0, 1, 5), [0.0, 0.35, 0.4, 0.85, 0.95], coefficient_std=noise)
    found = rotation_point(shape, 0.9)
    assert found.residual > 0.05
    assert found.is_rigid


def test_two_points_cannot_check_themselves():
    found = rotation_point(a_shape([0.1, 0.9], [0.0, 1.0], frequency_std_hz=0.02), 0.9)
    assert found.mode.radius_m == pytest.approx(0.8)
    assert found.is_rigid is None
    assert np.isnan(found.radius_std_m)
    assert found.covariance[0, 0] == pytest.approx(4e-4)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (a_shape([0.5, 0.5], [1, 1]), "its shape has 1 stations, but a line takes two"),
        (a_shape([0, 0.5, 1], [1, 1, 1]), "the fuselage does not turn beyond the scatter"),
        (a_shape([0, 0.5, 1], [1.0, 1.1, 1.02]), "the fuselage does not turn beyond the scatter"),
        (a_shape([0, 1.8], [-1, 1]), "it turns about the sensor itself"),
        (a_shape([0, np.nan, 1], [-1, 0, 1]), "its shape holds values that are not finite"),
        (
            a_shape([0, 1], [-1, 1], coefficient_std=np.zeros(2)),
            "coefficient_std must be above zero",
        ),
    ],
)
def test_a_shape_that_gives_no_radius_is_refused(shape, message):
    with pytest.raises(InputError, match=re.escape(f"mode 1: {message}")):
        rotation_point(shape, 0.9)


def test_modes_are_written_as_the_setup_reads_them():
    text = modes_toml(TABLE_1)
    assert text.startswith('[[inertial.mode]]\nnumber = 1\nplane = "yaw"\n')
    inertial = Inertial.model_validate(tomllib.loads(text)["inertial"])
    by_number = sorted(modes_from_setup(inertial), key=lambda mode: mode.number)
    for got, mode in zip(by_number, TABLE_1, strict=True):
        assert (got.number, got.plane) == (mode.number, mode.plane)
        assert got.frequency_hz == pytest.approx(mode.frequency_hz, abs=5e-4)
        assert got.radius_m == pytest.approx(mode.radius_m, abs=5e-6)
