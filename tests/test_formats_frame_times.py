"""Rate, times and missing frames from rounded times of presentation."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glint_aoa.records.formats._frame_times import frame_times

MS = Fraction(1, 1000)
NTSC = Fraction(30000, 1001)


def rounded(number, rate, tick=MS):
    return np.array([round(Fraction(int(n)) / rate / tick) for n in number], np.int64)


@pytest.mark.parametrize("rate", [Fraction(25), NTSC, Fraction(60), Fraction(240), Fraction(500)])
def test_times_rounded_to_milliseconds_are_even(rate):
    found = frame_times(rounded(range(2000), rate), MS, rate)
    assert (found.times_s, found.notes) == (None, ())
    assert found.rate_hz == float(rate)


def test_a_rate_that_is_not_said_is_found():
    found = frame_times(rounded(range(2000), NTSC), MS, None)
    assert found.times_s is None
    assert found.rate_hz == pytest.approx(float(NTSC), rel=2e-5)


@settings(max_examples=60)
@given(gone=st.sets(st.integers(1, 198), min_size=1, max_size=20))
def test_missing_frames_are_counted_and_the_others_stay_on_the_grid(gone):
    number = np.array([n for n in range(200) if n not in gone])
    found = frame_times(rounded(number, NTSC), MS, NTSC)
    np.testing.assert_allclose(found.times_s, number / float(NTSC), rtol=0, atol=1e-12)
    before = int(np.argmax(np.diff(number) > 1)) + 1
    assert found.notes == (
        f"{len(gone)} frames are missing by their times, the first before {before}",
    )


def test_a_time_given_twice_is_named():
    found = frame_times(np.array([0, 1, 2, 2, 3, 4]), Fraction(1, 30), Fraction(30))
    assert found.notes == ("1 frames have the time of the one before, the first 3",)
    np.testing.assert_allclose(found.times_s, np.array([0, 1, 2, 2, 3, 4]) / 30)


def test_uneven_times_are_used_as_they_are():
    ticks = np.array([0, 31, 70, 98, 140, 160, 205])
    found = frame_times(ticks, MS, Fraction(30))
    np.testing.assert_allclose(found.times_s, ticks / 1000)
    assert found.notes == ("frames follow each other at uneven times, 20 to 45 ms",)


def test_a_clock_too_coarse_for_the_rate_counts():
    found = frame_times(rounded(range(100), Fraction(2000)), MS, Fraction(2000))
    assert (found.rate_hz, found.times_s) == (2000.0, None)
    assert found.notes[0].startswith("the file's clock is too coarse for its frame rate")


def test_a_stated_rate_that_the_times_belie_is_not_believed():
    found = frame_times(rounded(range(100), Fraction(50)), MS, Fraction(25))
    assert (found.rate_hz, found.times_s) == (50.0, None)


@pytest.mark.parametrize("nominal", [None, Fraction(30)])
def test_one_frame_has_no_period(nominal):
    found = frame_times(np.array([7]), MS, nominal)
    assert found == frame_times(np.array([0]), MS, nominal)
    assert found.rate_hz == (None if nominal is None else 30.0)


def test_frames_all_at_one_time_have_no_period():
    assert frame_times(np.zeros(5, np.int64), MS, None).rate_hz is None
