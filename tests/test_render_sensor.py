import numpy as np
import pytest

from render_sim.scene import Sensor
from render_sim.sensor import expected_noise, record


def noise_free() -> Sensor:
    return Sensor(full_well_e=1e12, read_noise=0.0)


def test_light_lands_on_the_black_level():
    levels = record(np.array([0.0, 20.0, 160.4]), noise_free(), rng=np.random.default_rng(0))
    assert levels.dtype == np.uint8
    assert levels.tolist() == [10, 30, 170]


def test_clips_at_both_ends():
    levels = record(np.array([-50.0, 300.0]), noise_free(), rng=np.random.default_rng(0))
    assert levels.tolist() == [0, 255]


@pytest.mark.parametrize("light", [0.0, 20.0, 160.0])
def test_noise_is_shot_read_and_rounding(light):
    sensor = Sensor()
    levels = record(np.full(200_000, light), sensor, rng=np.random.default_rng(7))
    variance = light * 245 / 40_000 + 0.7**2 + 1 / 12
    assert levels.var() == pytest.approx(variance, rel=0.02)
    assert levels.mean() == pytest.approx(light + 10, abs=0.01)
    assert expected_noise(np.array(light), sensor) ** 2 == pytest.approx(variance - 1 / 12)


def test_same_seed_same_noise():
    light = np.full((4, 5), 50.0)
    once = record(light, Sensor(), rng=np.random.default_rng(3))
    assert np.array_equal(once, record(light, Sensor(), rng=np.random.default_rng(3)))
    assert not np.array_equal(once, record(light, Sensor(), rng=np.random.default_rng(4)))


def test_more_bits_make_wider_numbers():
    sensor = Sensor(bits=12, black_level=100.0, peak_level=3000.0, read_noise=0.0, full_well_e=1e15)
    levels = record(np.array([2900.0, 5000.0]), sensor, rng=np.random.default_rng(0))
    assert levels.dtype == np.uint16
    assert levels.tolist() == [3000, 4095]
