import re
from dataclasses import replace

import closed_form
import numpy as np
import pytest
import rigid_body

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial import nlr
from glint_aoa.inertial.channels import package_output
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.inertial.filters import low_pass
from glint_aoa.inertial.modes import TABLE_1
from glint_aoa.setup import InertialFilter

MODE_1, MODE_2 = TABLE_1[:2]


def task_of(record, modes=()):
    return CorrectionTask(record, package_output(record), modes, InertialFilter())


def shaken(number, *, pitch_deg=0.0, station_m=0.9, seed=1, noise=(2e-4, 5e-3)):
    motion = rigid_body.sine(number, modulation_hz=0.25, duration_s=20.0, pitch_deg=pitch_deg)
    rng = np.random.default_rng(seed)
    return rigid_body.record(motion, pitch_deg=pitch_deg, station_m=station_m, rng=rng, noise=noise)


@pytest.mark.parametrize(("number", "pitch_deg"), [(1, 0.0), (2, 6.0), (5, 0.0), (6, 4.3)])
def test_the_radius_is_tuned_within_its_standard_error(number, pitch_deg):
    plane, frequency, radius = rigid_body.TABLE[number]
    tuned = nlr.tune(task_of(shaken(number, pitch_deg=pitch_deg)), plane)
    assert tuned.plane == plane
    assert tuned.frequency_hz == pytest.approx(frequency, abs=0.02)
    assert abs(tuned.radius_m - radius) < 4 * tuned.radius_std_m + 1e-3 * abs(radius)
    assert tuned.radius_std_m < 0.01 * abs(radius)
    assert tuned.explained > 0.99


def test_an_accelerometer_ahead_of_the_package_tunes_the_same_radius():
    tuned = nlr.tune(task_of(shaken(1, station_m=1.0)), "yaw")
    assert tuned.radius_m == pytest.approx(rigid_body.TABLE[1][2], rel=2e-3)


def test_the_standard_error_of_the_radius_covers_noise():
    """A noisy package: the tuned radius scatters as its standard error says."""
    records = [shaken(1, seed=seed, noise=(0.1, 5e-3)) for seed in range(8)]
    found = [nlr.tune(task_of(record), "yaw") for record in records]
    errors = np.array([each.radius_m - rigid_body.TABLE[1][2] for each in found])
    stds = np.array([each.radius_std_m for each in found])
    assert np.mean(stds) > 2e-3 * rigid_body.TABLE[1][2]
    assert 0.5 < np.sqrt(np.mean((errors / stds) ** 2)) < 1.6


def test_a_model_at_rest_has_no_radius():
    record = rigid_body.record(
        rigid_body.sine(1, bias_deg=0.0, duration_s=12.0), rng=np.random.default_rng(1)
    )
    message = (
        "rigid-body: the output does not follow the motion in yaw; shake the model harder, "
        "several times, and let it come to rest between"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        nlr.tune(task_of(record), "yaw")


def test_a_plane_without_accelerometer_cannot_be_tuned():
    record = shaken(1)
    only = {k: v for k, v in record.channels.items() if k != "az_face"}
    message = (
        "rigid-body: no acceleration shows the motion in pitch; choose another source or give the "
        "channel's axis and units"
    )
    with pytest.raises(InputError, match=re.escape(message)):
        nlr.tune(task_of(replace(record, channels=only)), "pitch")


def test_both_planes_are_corrected():
    motion = rigid_body.together(
        rigid_body.sine(1, duration_s=16.0), rigid_body.sine(2, duration_s=16.0, bias_deg=0.1)
    )
    record = rigid_body.record(motion)
    estimate = nlr.estimate_bias(task_of(record, (MODE_2, MODE_1)))
    left = low_pass(record["aoa_unfiltered"].samples + estimate.addition, 800.0, InertialFilter())
    degrees = np.degrees(left / 9.80665)[3200:-3200]
    assert np.max(np.abs(degrees)) < 0.0002
    assert estimate.why == (
        "NLR's correction, one mode a plane: mode 1 in ay_face and mode 2 in az_face"
    )


@pytest.mark.parametrize("modes", [TABLE_1, (MODE_1, MODE_2)])
def test_another_mode_spoils_it_and_the_uncertainty_says_so(modes):
    motion = rigid_body.together(
        rigid_body.sine(1, duration_s=12.0), rigid_body.sine(5, duration_s=12.0, bias_deg=0.05)
    )
    record = rigid_body.record(motion)
    estimate = nlr.estimate_bias(task_of(record, modes))
    left = low_pass(record["aoa_unfiltered"].samples + estimate.addition, 800.0, InertialFilter())[
        1600:-1600
    ]
    std = np.sqrt(sum(low_pass(t, 800.0, InertialFilter()) ** 2 for t in estimate.std_terms))
    assert np.degrees(np.mean(left) / 9.80665) > 0.04
    assert (np.abs(left) < 2 * std[1600:-1600]).all()


def test_what_it_lacks_is_said():
    task, _ = closed_form.task(MODE_1, duration_s=2.0, modes=())
    assert nlr.missing(task) == (
        "the mode of each plane: list it as [[inertial.mode]] in the setup"
    )
    task, _ = closed_form.task(MODE_1, duration_s=2.0, modes=(MODE_1, MODE_2))
    only = {k: v for k, v in task.record.channels.items() if k == "aoa"}
    bare = replace(task, record=replace(task.record, channels=only))
    assert nlr.missing(bare) == (
        "an accelerometer at the package along model y (yaw) and model z (pitch)"
    )
