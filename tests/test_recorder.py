"""What camera, recorder and air do to a film."""

from dataclasses import replace

import numpy as np
import pytest

from render_sim.air import light_in_time
from render_sim.film import film
from render_sim.motion import StaticMotion
from render_sim.recorder import camera_turns, recorded_levels, stored_exposures
from render_sim.scene import Air, Optics, Recorder, Sensor, Shake, paper_scene

QUIET = Sensor(rows=40, columns=30, read_noise=0.0, full_well_e=1e15, bits=16, black_level=100.0)


class Level:
    """A renderer whose picture tells the pose's heave, the parity and the camera's roll."""

    name = "level"

    def __init__(self, scene):
        self.shape = scene.sensor.rows, scene.sensor.columns

    def radiance(self, poses, *, parity=0, turns=None):
        roll = np.zeros(len(poses)) if turns is None else turns[:, 0, 2]
        height = 1e6 * poses[:, 2, 3] + 1000.0 * parity + 1e6 * roll
        return np.broadcast_to(height[:, None, None] + 500.0, (len(poses), *self.shape)).copy()


class Rising:
    def pose(self, time_s):
        pose = np.zeros((*time_s.shape, 4, 4)) + np.eye(4)
        pose[..., 2, 3] = 1e-3 * time_s
        return pose


def scene(**parts):
    return replace(paper_scene(), sensor=QUIET, **parts)


def filmed(seen, n_fields=6, motion=None, **how):
    renderer, rng = Level(seen), np.random.default_rng(3)
    motion = motion or StaticMotion(seen)
    return film(seen, motion, n_fields, renderer=renderer, rng=rng, **how)


def levels(seen, *args, **how):
    return filmed(seen, *args, **how).fields[:, 0, 0].astype(float)


@pytest.mark.parametrize(
    ("how", "stored"),
    [
        ({}, [0, 1, 2, 3, 4]),
        ({"dropped": (2,)}, [0, 1, 3, 4, 5]),
        ({"dropped": (0, 3, 3)}, [1, 2, 4, 5, 6]),
        ({"repeated": (1,)}, [0, 1, 1, 2, 3]),
        ({"dropped": (1,), "repeated": (2, 4)}, [0, 2, 2, 3, 4]),
        ({"dropped": (9,), "repeated": (9,)}, [0, 1, 2, 3, 4]),
    ],
)
def test_exposures_that_are_stored(how, stored):
    assert stored_exposures(Recorder(**how), 5).tolist() == stored


def test_a_dropped_field_shifts_the_parity_of_those_after_it():
    told = filmed(scene(recorder=Recorder(dropped=(2,), timestamps=True)))
    assert (np.diff(told.fields[:, 0, 0].astype(int)) > 0).tolist() == [
        True,
        False,
        False,
        True,
        False,
    ]
    np.testing.assert_allclose(told.times_s, np.array([0, 1, 3, 4, 5, 6]) / 60)


def test_a_repeated_field_is_the_same_to_the_bit():
    noisy = replace(scene(recorder=Recorder(repeated=(1,))), sensor=replace(QUIET, read_noise=9.0))
    fields = filmed(noisy).fields
    np.testing.assert_array_equal(fields[1], fields[2])
    assert not np.array_equal(fields[0], fields[1])


@pytest.mark.parametrize(("wrong", "stated"), [(False, "even"), (True, "odd")])
def test_the_stated_parity_may_be_wrong(wrong, stated):
    told = filmed(scene(recorder=Recorder(parity_is_wrong=wrong)))
    assert told.info.first_parity == stated
    assert told.fields[0, 0, 0] < told.fields[1, 0, 0]


def test_a_recording_that_begins_late_states_what_it_begins_with():
    assert filmed(scene(recorder=Recorder(dropped=(0,)))).info.first_parity == "odd"
    assert filmed(scene()).times_s is None


def test_gain_and_black_drift():
    progressive = paper_scene().fields.model_copy(update={"interlaced": False})
    still = levels(scene(fields=progressive))
    drifting = scene(fields=progressive, recorder=Recorder(gain_drift=0.6, black_drift=120.0))
    time = np.arange(6) / 60 + 0.5e-3
    expected = 100 + 120 * time + (still - 100) * (1 + 0.6 * time)
    np.testing.assert_allclose(levels(drifting), expected, atol=0.51)


def test_lines_start_anywhere():
    ramp = np.tile(100.0 * np.arange(30), (4000, 1))
    how = {"time_s": 0.0, "rng": np.random.default_rng(1)}
    jittered = recorded_levels(ramp, QUIET, Recorder(line_jitter=0.3), **how)
    shift = jittered[:, 15] - 100.0 - ramp[:, 15]
    np.testing.assert_allclose(jittered[:, 12] - ramp[:, 12], jittered[:, 15] - ramp[:, 15], atol=1)
    assert shift.std() == pytest.approx(30.0, rel=0.04)
    assert abs(shift.mean()) < 2.0


def test_dead_columns_see_nothing():
    dead = filmed(scene(recorder=Recorder(dead_columns=(3, 29)))).fields
    assert (dead[:, :, [3, 29]] == 100).all()
    assert (np.delete(dead, [3, 29], axis=2) > 500).all()


def test_a_rolling_shutter_shows_each_line_later():
    rolling = scene(recorder=Recorder(line_time_s=1e-4))
    fields = filmed(rolling, 3, motion=Rising()).fields[0].astype(float)
    rows = np.arange(40) // 4 * 4 + 1.5
    expected = 600 + 1e3 * (rows * 1e-4 + 0.5e-3)
    np.testing.assert_allclose(fields[:, 7], expected, atol=0.51)


def test_truth_of_a_rolling_shutter_is_the_middle_lines():
    told = filmed(scene(recorder=Recorder(line_time_s=1e-4)), 3, motion=Rising())
    heave = told.truth["pose"][:, :, 2, 3].mean(axis=1)
    np.testing.assert_allclose(heave, 1e-3 * (np.arange(3) / 60 + 0.5e-3 + 20e-4), atol=1e-15)


def test_fog_draws_in_evenly():
    share, airlight = light_in_time(
        Air(fog=(1.0, 0.4), airlight_level=50.0), np.linspace(0, 2, 5), (0, 2)
    )
    np.testing.assert_allclose(share, [1.0, 0.85, 0.7, 0.55, 0.4])
    np.testing.assert_allclose(airlight, 50 * (1 - share))


def test_lamps_flicker_at_twice_the_mains_frequency():
    flickering = levels(scene(air=Air(flicker=0.2, mains_hz=50.0)), sub_exposures=1)
    light = (levels(scene()) - 100) * (
        1 + 0.2 * np.cos(2 * np.pi * 100 * (np.arange(6) / 60 + 0.5e-3))
    )
    np.testing.assert_allclose(flickering - 100, light, atol=0.51)


def test_a_shaking_camera_turns_with_its_phase():
    roll = Shake("roll", amplitude_rad=2e-4, frequency_hz=7.0, phase_rad=0.4)
    shaken = levels(scene(shake=(roll,)), sub_exposures=1)
    angle = 2e-4 * np.sin(2 * np.pi * 7 * (np.arange(6) / 60 + 0.5e-3) + 0.4)
    np.testing.assert_allclose(shaken - levels(scene()), 1e6 * np.sin(angle), atol=1.01)
    assert camera_turns((), np.zeros(2)) is None


@pytest.mark.parametrize(
    ("axis", "about"),
    [("tilt", 0), ("roll", 1), ("pan", 2)],
)
def test_a_turned_camera_is_one_that_stands_so(axis, about):
    from render_sim.raytrace import RaytraceRenderer

    seen = paper_scene().with_window(126, 34)
    pose = StaticMotion(seen, 0.02).pose(np.zeros(1))
    still_shake = Shake(axis, amplitude_rad=2e-3, frequency_hz=1.0, phase_rad=np.pi / 2)
    turned = RaytraceRenderer(seen).radiance(pose, turns=camera_turns((still_shake,), np.zeros(1)))
    rotation = tuple(2e-3 * (k == about) for k in range(3))
    camera = seen.camera.model_copy(update={"rotation": rotation})
    stands = RaytraceRenderer(replace(seen, camera=camera))
    gain = RaytraceRenderer(seen).radiance(pose).max() / stands.radiance(pose).max()
    assert 0.98 < gain < 1.02
    ratio = turned / stands.radiance(pose)
    assert np.ptp(ratio) < 1e-9 * ratio.mean()


def test_light_falls_off_towards_the_edges():
    seen = scene(optics=Optics(vignetting=1.0))
    fields = filmed(seen, 1).fields[0].astype(float) - 100
    bright = filmed(scene(), 1).fields[0].astype(float) - 100
    camera = seen.camera
    across = (np.arange(30) - 375.5) * 11.7e-6
    down = (98 + np.arange(40) - 119.5) * 27.5e-6
    angle = np.arctan2(np.hypot(across, down[:, None]), camera.focal_length)
    np.testing.assert_allclose(fields, bright * np.cos(angle) ** 4, atol=0.51)
