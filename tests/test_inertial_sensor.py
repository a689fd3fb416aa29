import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.errors import InputError
from glint_aoa.inertial.sensor import (
    axial_specific_force,
    bias_angle,
    bias_from_acceleration,
    bias_from_velocity,
    indicated_angle,
    unfiltered_output,
)

G = 9.80665


def test_indicated_angle_is_the_arcsine_of_gravity():
    assert indicated_angle(G * 0.5) == pytest.approx(np.pi / 6, abs=1e-15)
    assert indicated_angle(0.0) == 0.0


def test_more_than_gravity_is_no_angle():
    assert np.isnan(indicated_angle(-1.0001 * G))


@given(st.floats(-1.5, 1.5))
def test_angle_and_specific_force_are_inverse(angle):
    assert indicated_angle(axial_specific_force(angle)) == pytest.approx(angle, abs=1e-12)


def test_mean_of_the_unfiltered_output_is_equation_7():
    time = np.arange(8000) / 800  # 98 whole cycles
    output = unfiltered_output(0.07, time, velocity=0.2, frequency_hz=9.8, radius_m=0.7874)
    expected = G * np.sin(0.07) - 0.2**2 / (2 * 0.7874)
    assert output.mean() == pytest.approx(expected, abs=1e-14)


def test_second_harmonic_of_the_unfiltered_output_is_as_large_as_the_bias():
    time = np.arange(8000) / 800
    output = unfiltered_output(0.0, time, velocity=0.2, frequency_hz=9.8, radius_m=-0.18)
    line = np.abs(np.fft.rfft(output))[196] / 4000
    assert line == pytest.approx(abs(output.mean()), rel=1e-12)
    assert output.mean() > 0


def test_velocity_and_acceleration_forms_agree():
    velocity, frequency, radius = [0.2, 0.02], [9.8, 29.8], [0.7874, -0.181]
    acceleration = 2 * np.pi * np.array(frequency) * velocity
    expected = -(0.2**2 / (2 * 0.7874)) + 0.02**2 / (2 * 0.181)
    assert bias_from_velocity(velocity, radius) == pytest.approx(expected, rel=1e-14)
    assert bias_from_acceleration(acceleration, frequency, radius) == pytest.approx(
        expected, rel=1e-14
    )


def test_bias_angle_has_the_conventional_sign_and_scale():
    bias = bias_from_velocity(0.2, 0.7874)
    assert bias_angle(bias, 0.1) == pytest.approx(-(0.2**2) / (2 * 0.7874 * G * np.cos(0.1)))


def test_a_radius_of_zero_is_refused():
    message = "radius_m is 0, but a mode has a point of rotation; give its distance"
    with pytest.raises(InputError, match=re.escape(message)):
        bias_from_velocity([0.1, 0.1], [0.5, 0.0])
