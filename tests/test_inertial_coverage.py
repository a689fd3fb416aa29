"""A small draw of the Monte Carlo; `make coverage` runs the large one."""

import numpy as np
import pytest
import rigid_body

from benchmarks.inertial_coverage import STUDIES, run
from benchmarks.rigid_tones import ModeMotion, specific_forces, time_of, tones


@pytest.mark.parametrize("station_m", [0.9, 0.1])
def test_closed_form_kinematics_are_those_of_the_differentiated_position(station_m):
    rng = np.random.default_rng(1)
    fine, coarse = rigid_body.fine_time(2.0), time_of(2.0)
    angles, modes = {}, []
    for number, (plane, frequency, radius) in rigid_body.TABLE.items():
        lines = np.array([1.0, 1.03]) * frequency, np.array([0.002, 0.001])
        phases = rng.uniform(0.0, 6.0, 2)
        angles[number] = tones(fine, *lines, phases)[0]
        modes.append(ModeMotion(number, plane, frequency, radius, *tones(coarse, *lines, phases)))
    motion = rigid_body.Motion(fine, angles)
    expected = rigid_body.specific_force(motion, station_m=station_m, pitch_deg=5.0)
    got = specific_forces(modes, [station_m], pitch_deg=5.0)[0]
    np.testing.assert_allclose(got, expected, atol=3e-8 * np.max(np.abs(expected)))


def test_intervals_of_the_kinematic_correction_cover_the_truth():
    draws = run(STUDIES["kinematic"], 60, seed=3)
    assert draws.known.all()
    assert np.sqrt(np.mean(draws.raw_error_deg**2)) > 0.1
    assert draws.coverage >= 52 / 60  # three standard deviations of 60 draws below 95 %
    ratio = np.sqrt(np.mean((draws.error_deg / draws.std_deg) ** 2))
    assert 0.75 < ratio < 1.25  # nor are they wider than need be
