"""Whether frames are interlaced, and in which order, by what moves in them."""

import numpy as np
import pytest
from films import SCANS, film, vibration

from glint_aoa.records.formats._field_order import find_field_order


def order_of(frames):
    return find_field_order([frames[:24], frames[24:48], frames[48:]])


@pytest.mark.parametrize("scan", SCANS)
@pytest.mark.parametrize("hertz", [4.0, 9.8, 17.0, 20.0, 25.0, 36.0])
@pytest.mark.parametrize("amplitude", [0.2, 3.0])
def test_vibration_tells_the_scan(scan, hertz, amplitude):
    order = order_of(film(72, row=vibration(hertz, amplitude), scan=scan))
    assert order.scan == scan
    assert order.sigmas > 5


@pytest.mark.parametrize("scan", SCANS)
def test_a_picture_at_rest_tells_nothing(scan):
    frames = film(72, shape=(24, 40), row=lambda time: 12.0, scan=scan)
    assert order_of(frames).scan is None


@pytest.mark.parametrize("scan", ["even first", "odd first"])
@pytest.mark.parametrize("hertz", [14.5, 30.0])
def test_what_moves_alike_in_every_lag_tells_nothing(scan, hertz):
    """A vibration at half the frame rate moves as far in half a frame as in one and a half."""
    assert order_of(film(72, row=vibration(hertz, 3.0), scan=scan)).scan is None


def test_noise_alone_is_never_taken_for_motion():
    rng = np.random.default_rng(7)
    decided = [
        order_of(rng.integers(10, 30, (72, 16, 24)).astype(np.uint8)).scan for _ in range(100)
    ]
    assert decided == [None] * 100


@pytest.mark.parametrize("shape", [(3, 48, 60), (72, 3, 60), (72, 48, 60)])
def test_too_little_or_nothing_at_all_tells_nothing(shape):
    order = find_field_order([np.zeros(shape, np.uint8)])
    assert (order.scan, order.sigmas) == (None, 0.0)
