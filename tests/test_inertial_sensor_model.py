import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.inertial.sensor import SensorModel, indicated_angle
from glint_aoa.setup import Inertial

G = 9.80665
MODEL = SensorModel(
    scale=1.002,
    bias=0.003,
    misalignment=np.radians(0.2),
    scale_per_kelvin=1e-5,
    bias_per_kelvin=2e-5,
    temperature=300.0,
)


@given(st.floats(-1.2, 1.2), st.floats(100.0, 400.0))
def test_the_angle_comes_back(angle, temperature):
    indicated = MODEL.indicated(angle, temperature=temperature)
    assert MODEL.angle(indicated, temperature=temperature) == pytest.approx(angle, abs=1e-9)


def test_terms_are_those_of_the_formula():
    warmer = 320.0
    expected = (1.002 + 20e-5) * G * np.sin(0.1 + np.radians(0.2)) + 0.003 + 20 * 2e-5
    assert MODEL.indicated(0.1, temperature=warmer) == pytest.approx(expected, rel=1e-14)


def test_the_reference_temperature_is_assumed():
    assert MODEL.indicated(0.1) == MODEL.indicated(0.1, temperature=300.0)


def test_a_misaligned_package_reads_high_by_its_angle():
    model = SensorModel(misalignment=np.radians(0.2))
    assert indicated_angle(model.indicated(0.1)) == pytest.approx(0.1 + np.radians(0.2))


def test_an_ideal_package_changes_nothing():
    indicated = np.linspace(-12, 12, 7)
    np.testing.assert_array_equal(SensorModel().specific_force(indicated), indicated)


def test_the_setup_states_it():
    inertial = Inertial.model_validate(
        {
            "sensor": {
                "scale": 1.002,
                "bias": "0.003 m/s^2",
                "misalignment": "0.2 deg",
                "scale_per_kelvin": "1e-5 1/K",
                "bias_per_kelvin": "2e-5 m/s^2/K",
                "temperature": "300 K",
            }
        }
    )
    assert SensorModel.from_setup(inertial) == MODEL
    assert SensorModel.from_setup(Inertial()) == SensorModel()
