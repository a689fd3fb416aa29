import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic import FULL_WELL, line_fields

from glint_aoa.optical.columns import used_columns
from glint_aoa.optical.detect import find_glint
from glint_aoa.optical.estimator import Sample
from glint_aoa.optical.noise import NoiseModel, photon_transfer, sample_noise
from glint_aoa.setup import Glint

ROUNDING = 1 / 12
PER_GREY = 255 / FULL_WELL
"""Variance for each grey level of the camera of `line_fields`."""


def readings(rng, *, read_noise, per_grey, size=60_000, rounded=True):
    """Two readings of pixels whose light is known: shot and read noise, then whole levels."""
    grey = rng.uniform(5, 220, size)
    pairs = rng.poisson(grey / per_grey, (2, size)) * per_grey if per_grey else np.stack([grey] * 2)
    pairs = pairs + rng.normal(0, read_noise, (2, size))
    return grey, np.diff(np.round(pairs) if rounded else pairs, axis=0)[0]


@pytest.mark.parametrize("read_noise", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("per_grey", [PER_GREY, 0.05])
def test_gain_and_read_noise_are_found(read_noise, per_grey):
    """Each pixel tells its variance to sqrt(2); the line at zero is known half as well."""
    grey, difference = readings(np.random.default_rng(1), read_noise=read_noise, per_grey=per_grey)
    noise = photon_transfer(grey, difference, saturation=255.0)
    assert noise.source == "stack"
    truth = read_noise**2 + ROUNDING + per_grey * grey.mean()
    known_to = truth * np.sqrt(2 / grey.size)
    assert noise.variance(grey.mean()) == pytest.approx(truth, abs=4 * known_to)
    assert noise.read_variance == pytest.approx(read_noise**2 + ROUNDING, abs=8 * known_to)
    assert noise.variance_per_grey == pytest.approx(per_grey, abs=4 * known_to / grey.std())


def test_black_is_where_the_shot_noise_begins():
    rng = np.random.default_rng(2)
    grey, difference = readings(rng, read_noise=1.0, per_grey=0.05)
    noise = photon_transfer(grey + 30, difference, saturation=300.0, black=30.0)
    plain = photon_transfer(grey, difference, saturation=270.0)
    assert noise.read_variance == pytest.approx(plain.read_variance, rel=1e-6)
    assert noise.variance(20.0) == pytest.approx(noise.read_variance)


def test_clipped_levels_do_not_count():
    rng = np.random.default_rng(3)
    grey, difference = readings(rng, read_noise=1.0, per_grey=0.05)
    difference[grey > 180] = 0.0
    noise = photon_transfer(grey, difference, saturation=200.0)
    assert noise.variance_per_grey == pytest.approx(0.05, rel=0.06)


def test_the_noise_of_a_perfect_camera_is_that_of_whole_levels():
    """Rounding two equal readings shows no difference at all; what is left is the floor."""
    grey = np.linspace(5, 200, 5000)
    noise = photon_transfer(grey, np.zeros(grey.size), saturation=255.0)
    assert (noise.read_variance, noise.variance_per_grey) == (ROUNDING, 0.0)
    assert noise.source == "stack, no gain seen"


def test_one_level_shows_no_gain():
    rng = np.random.default_rng(4)
    noise = photon_transfer(np.full(4000, 80.0), rng.normal(0, 2, 4000), saturation=255.0)
    assert noise.source == "stack, no gain seen"
    assert noise.read_variance == pytest.approx(2.0, rel=0.1)


def test_a_few_pixels_give_what_they_have():
    assert photon_transfer([], [], saturation=255.0).read_variance == ROUNDING
    few = photon_transfer([1.0, 2, 3], [4.0, -4, 4], saturation=255.0)
    assert few.read_variance == pytest.approx(np.var([4.0, -4, 4]) / 2)


def test_a_flicker_in_a_few_pixels_does_not_count():
    rng = np.random.default_rng(5)
    grey, difference = readings(rng, read_noise=1.0, per_grey=PER_GREY)
    plain = photon_transfer(grey, difference, saturation=255.0)
    difference[:: grey.size // 200] = 90.0
    spoilt = photon_transfer(grey, difference, saturation=255.0)
    np.testing.assert_allclose(spoilt.variance(100.0), plain.variance(100.0), rtol=0.03)


@given(
    size=st.integers(0, 600),
    scale=st.floats(0, 50),
    saturation=st.floats(20, 300),
    seed=st.integers(0, 1000),
)
def test_variances_are_never_below_rounding(size, scale, saturation, seed):
    rng = np.random.default_rng(seed)
    noise = photon_transfer(
        rng.uniform(0, 255, size), rng.normal(0, scale, size), saturation=saturation
    )
    assert noise.variance_per_grey >= 0
    assert (noise.variance(np.linspace(-50, 300, 50)) >= ROUNDING).all()


def sample_of(rng, *, row, n_fields=64, slope=0.003, **kwargs):
    columns = used_columns(752, 20)
    fields = line_fields(rng, n_fields=n_fields, shape=(60, 752), row=row, slope=slope, **kwargs)
    rows = np.broadcast_to(np.asarray(row, float), n_fields)[:, None] + slope * (columns - 375.5)
    return Sample(fields, columns, rows)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("read_noise", [0.7, 2.0])
def test_a_line_shows_the_noise_whether_it_moves_or_not(moving, read_noise):
    """Over a hundred times the read noise, the line itself must not count as noise."""
    rng = np.random.default_rng(6)
    row = 30 + (rng.uniform(-2, 2, 64) if moving else 0.3)
    sample = sample_of(rng, row=row, read_noise=read_noise)
    noise = sample_noise(sample, find_glint(sample.fields, Glint()), Glint())
    # `line_fields` counts the ten grey levels of its black as light.
    read = read_noise**2 + ROUNDING + PER_GREY * noise.black
    assert noise.black == pytest.approx(10, abs=4 * read_noise)
    levels = np.array([10.0, 60.0, 150.0])
    np.testing.assert_allclose(
        noise.variance(levels), read + PER_GREY * (levels - noise.black), rtol=0.12
    )
    assert noise.source == "stack"


def test_texture_and_pixel_gain_that_stand_still_are_not_noise():
    rng = np.random.default_rng(7)
    sample = sample_of(rng, row=30.3, peak=120)
    texture = rng.integers(0, 40, (60, 752), dtype=np.uint8)
    textured = dataclasses.replace(sample, fields=sample.fields + texture)
    shape = find_glint(sample.fields, Glint())
    plain, noise = (sample_noise(each, shape, Glint()) for each in (sample, textured))
    assert noise.variance(80.0) == pytest.approx(float(plain.variance(80.0)), rel=0.2)


def test_setup_goes_before_the_stack():
    sample = sample_of(np.random.default_rng(8), row=30.3, n_fields=16)
    shape = find_glint(sample.fields, Glint())
    both = sample_noise(sample, shape, Glint(read_noise=2.5, electrons_per_grey=100))
    assert both.source == "setup"
    assert both.read_variance == pytest.approx(2.5**2 + ROUNDING)
    assert both.variance_per_grey == pytest.approx(0.01)
    assert both.saturation == shape.saturation
    stack = sample_noise(sample, shape, Glint())
    read = sample_noise(sample, shape, Glint(read_noise=2.5))
    assert read == dataclasses.replace(stack, read_variance=2.5**2 + ROUNDING)
    gain = sample_noise(sample, shape, Glint(electrons_per_grey=100))
    assert gain == dataclasses.replace(stack, variance_per_grey=0.01)


def test_too_few_fields_leave_the_noise_of_the_background():
    sample = sample_of(np.random.default_rng(9), row=30.3, n_fields=4, read_noise=3.0)
    shape = find_glint(sample.fields, Glint())
    noise = sample_noise(sample, shape, Glint())
    assert noise.source == "background"
    assert noise.read_variance == shape.noise**2
    assert noise.variance_per_grey == 0.0


def test_variance_grows_with_the_light_only():
    noise = NoiseModel(read_variance=2.0, variance_per_grey=0.5, black=10.0, saturation=255.0)
    np.testing.assert_allclose(noise.variance([0.0, 10.0, 30.0]), [2.0, 2.0, 12.0])
