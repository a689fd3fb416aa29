from dataclasses import replace

import numpy as np
import pytest

from glint_aoa.errors import InputError
from render_sim.film import attitude, exposure_times, film
from render_sim.motion import StaticMotion, rigid, rotation_x, rotation_y, rotation_z
from render_sim.raytrace import RaytraceRenderer
from render_sim.scene import Scene, paper_scene


class Nodding:
    """Pitch that grows evenly with time."""

    def __init__(self, scene: Scene, rate_deg_s: float) -> None:
        self._scene, self._rate = scene, np.radians(rate_deg_s)

    def pose(self, time_s: np.ndarray) -> np.ndarray:
        poses = [StaticMotion(self._scene, self._rate * t).pose(np.zeros(())) for t in time_s.flat]
        return np.array(poses).reshape(*time_s.shape, 4, 4)


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = paper_scene().with_window(126, 34)
    fields = scene.fields.model_copy(update={"first_column": 340})
    return replace(scene, fields=fields, sensor=replace(scene.sensor, columns=72))


@pytest.fixture(scope="module")
def renderer(scene) -> RaytraceRenderer:
    return RaytraceRenderer(scene)


def row_of_glint(fields: np.ndarray) -> np.ndarray:
    rows = np.arange(fields.shape[1])[:, None]
    light = np.maximum(fields - 40.0, 0.0)
    return ((light * rows).sum(axis=1) / light.sum(axis=1)).mean(axis=-1)


def test_static_film_repeats_the_truth(scene, renderer):
    motion = StaticMotion(scene, np.radians(2.0), yaw_rad=np.radians(0.5), heave_m=2e-3)
    filmed = film(scene, motion, 6, renderer=renderer, rng=np.random.default_rng(1))
    assert filmed.fields.shape == (6, 34, 72)
    assert filmed.fields.dtype == np.uint8
    assert filmed.truth["pitch_deg"] == pytest.approx(np.full(6, 2.0), abs=1e-12)
    assert filmed.truth["yaw_deg"] == pytest.approx(np.full(6, 0.5), abs=1e-12)
    assert filmed.truth["axis_intercept_mm"] == pytest.approx(np.full(6, 2.0), abs=1e-12)
    assert np.ptp(filmed.truth["glint_angle_deg"]) < 1e-12
    assert filmed.truth["pose"].shape == (6, 5, 4, 4)


def test_info_says_how_it_was_filmed(scene, renderer):
    filmed = film(
        scene,
        StaticMotion(scene),
        1,
        renderer=renderer,
        rng=np.random.default_rng(1),
        start_s=-0.05,
        first_parity="odd",
    )
    info = filmed.info
    assert (info.rate_hz, info.exposure_s, info.start_s) == (60.0, 1e-3, -0.05)
    assert (info.first_line, info.first_column) == (126, 340)
    assert (info.first_parity, info.interlaced) == ("odd", True)


def test_odd_fields_show_the_glint_half_a_line_higher_in_the_window(scene, renderer):
    filmed = film(scene, StaticMotion(scene), 4, renderer=renderer, rng=np.random.default_rng(1))
    rows = row_of_glint(filmed.fields)
    assert np.diff(rows) == pytest.approx([-0.5, 0.5, -0.5], abs=0.02)


def test_progressive_frames_have_one_parity(scene, renderer):
    scene = replace(scene, fields=scene.fields.model_copy(update={"interlaced": False}))
    filmed = film(scene, StaticMotion(scene), 3, renderer=renderer, rng=np.random.default_rng(1))
    assert np.ptp(row_of_glint(filmed.fields)) < 0.02
    assert filmed.info.first_parity == "even"


def test_truth_is_the_mean_over_the_exposure(scene, renderer):
    filmed = film(scene, Nodding(scene, 20.0), 3, renderer=renderer, rng=np.random.default_rng(1))
    middles = np.arange(3) / 60 + 0.5e-3
    assert filmed.truth["pitch_deg"] == pytest.approx(20.0 * middles, abs=1e-9)
    pitch, _, intercept = attitude(scene, filmed.truth["pose"])
    assert np.degrees(pitch).mean(axis=1) == pytest.approx(filmed.truth["pitch_deg"], abs=1e-9)
    assert intercept.mean(axis=1) * 1e3 == pytest.approx(filmed.truth["axis_intercept_mm"])


def test_motion_smears_the_glint(scene, renderer):
    class Heaving:
        def pose(self, time_s):
            poses = [StaticMotion(scene, heave_m=6.0 * t).pose(np.zeros(())) for t in time_s.flat]
            return np.array(poses).reshape(*time_s.shape, 4, 4)

    def peak(motion):
        filmed = film(scene, motion, 1, renderer=renderer, rng=np.random.default_rng(1))
        return filmed.fields.max()

    assert peak(Heaving()) < 0.8 * peak(StaticMotion(scene))


def test_same_seed_same_film(scene, renderer):
    def fields():
        rng = np.random.default_rng(11)
        return film(scene, Nodding(scene, 5.0), 3, renderer=renderer, rng=rng).fields

    assert np.array_equal(fields(), fields())


def test_sub_exposures_spread_over_the_exposure(scene):
    times = exposure_times(scene, 2, start_s=1.0, sub_exposures=4)
    assert times[0] == pytest.approx(1.0 + np.array([0.125, 0.375, 0.625, 0.875]) * 1e-3)
    assert times[1] - times[0] == pytest.approx(np.full(4, 1 / 60))


@pytest.mark.parametrize("nose", ["left", "right"])
def test_nose_up_is_positive_pitch(nose):
    scene = replace(paper_scene(), nose=nose)
    pose = StaticMotion(scene, np.radians(3.0)).pose(np.zeros(()))
    nose_tip = pose @ [1.25, 0, 0, 1]
    held = pose @ [scene.view_station_m, 0, 0, 1]
    assert nose_tip[2] == pytest.approx(0.8 * np.sin(np.radians(3.0)))
    assert np.sign(nose_tip[0]) == (-1 if nose == "left" else 1)
    assert held[:3] == pytest.approx(np.zeros(3), abs=1e-15)


def test_yaw_is_right_handed_about_up():
    scene = paper_scene()
    ahead = StaticMotion(scene, yaw_rad=0.1).pose(np.zeros(()))[:3, 0]
    np.testing.assert_allclose(ahead, [-np.cos(0.1), -np.sin(0.1), 0.0], atol=1e-15)


def test_rotations_are_right_handed():
    quarter = np.pi / 2
    np.testing.assert_allclose(rotation_x(quarter) @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(rotation_y(quarter) @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(rotation_z(quarter) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    many = rigid(rotation_z(np.zeros(3)), np.ones(3))
    assert many.shape == (3, 4, 4)
    assert many[1, :, 3].tolist() == [1, 1, 1, 1]


def test_a_film_needs_fields(scene, renderer):
    with pytest.raises(InputError, match=r"^0 fields of 5 sub-exposures; give one of each"):
        film(scene, StaticMotion(scene), 0, renderer=renderer, rng=np.random.default_rng(1))


def test_a_film_needs_rate_and_exposure(scene, renderer):
    silent = replace(scene, fields=scene.fields.model_copy(update={"rate": None}))
    with pytest.raises(InputError, match=r"^fields\.rate and fields\.exposure are missing"):
        film(silent, StaticMotion(scene), 1, renderer=renderer, rng=np.random.default_rng(1))
