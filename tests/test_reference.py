import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from glint_aoa.errors import SetupError
from glint_aoa.optical.reference import (
    FIRST_FIELDS,
    has_moved,
    learn_mark,
    mark_shift,
    moved_fields,
)
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.recording import resolve_recording
from glint_aoa.setup import Reference, Setup

ROW, COLUMN, NOISE = 52.3, 40.7, 1.5
BOX = Reference(rows=(40, 66), columns=(20, 62))


def views(shift, *, kind="cross", light=1.0, interlaced=True, seed=0, noise=NOISE):
    """Fields [field, 80, 100] of a static mark that is seen `shift` [field, 2] from its place."""
    rng = np.random.default_rng(seed)
    v, u = np.arange(80)[:, None], np.arange(100)
    fields = np.empty((len(shift), 80, 100), np.uint8)
    for k, (down, right) in enumerate(shift):
        y, x = v - (ROW + down - 0.5 * (k % 2) * interlaced), u - (COLUMN + right)
        if kind == "edge":
            image = 20 + 100 * ndtr(y / 0.9) * (1 + 0 * x)
        else:
            bars = np.diff(ndtr(np.stack([y - 0.5, y + 0.5]) / 1.2), axis=0)[0], ndtr(-x / 1.5)
            image = 20 + 250 * bars[0] + 60 * bars[1]
        image = light * image + noise * rng.standard_normal(image.shape)
        fields[k] = np.clip(np.rint(image), 0, 255)
    return fields


def parity(n_fields, interlaced=True):
    return np.arange(n_fields) % 2 * interlaced


def shifts(fields, reference=BOX, interlaced=True):
    number = parity(len(fields), interlaced)
    mark = learn_mark(fields[:FIRST_FIELDS], number[:FIRST_FIELDS], reference)
    return mark, mark_shift(fields, number, mark)


@pytest.mark.parametrize("interlaced", [True, False])
def test_shifts_are_measured_to_a_twentieth_of_a_line(interlaced):
    true = np.zeros((40, 2))
    true[FIRST_FIELDS:] = np.random.default_rng(1).uniform(-4, 4, (40 - FIRST_FIELDS, 2))
    mark, found = shifts(views(true, interlaced=interlaced), interlaced=interlaced)
    assert np.abs(found - true).max() < 0.05
    assert mark.row == pytest.approx(ROW, abs=0.1)
    assert mark.column == pytest.approx(COLUMN, abs=0.1)
    np.testing.assert_array_equal(has_moved(found, mark), (np.abs(found) > 0.25).any(axis=1))


def test_brightness_does_not_look_like_motion():
    _, before = shifts(views(np.zeros((6, 2))))
    still = np.concatenate(
        [views(np.zeros((6, 2))), views(np.zeros((6, 2)), light=0.6), views(np.zeros((6, 2)))]
    )
    _, found = shifts(still)
    assert np.abs(found).max() < 0.05
    assert np.abs(before).max() < 0.05


@pytest.mark.parametrize("fields", [24, 60])
@pytest.mark.parametrize("step", [0.03, -0.15])
def test_a_step_far_below_a_pixel_is_seen_where_it_lasts(fields, step):
    true = np.zeros((fields, 2))
    true[15:, 0] = step
    mark, found = shifts(views(true))
    assert not has_moved(found, mark).any()
    assert moved_fields(found, mark).tolist() == [False] * 15 + [True] * (fields - 15)


def test_a_knock_that_passes_is_seen_while_it_lasts():
    true = np.zeros((60, 2))
    true[30:34, 1] = 0.2
    mark, found = shifts(views(true))
    assert np.flatnonzero(moved_fields(found, mark)).tolist() == [30, 31, 32, 33]


def test_a_stated_tolerance_is_kept():
    true = np.zeros((40, 2))
    true[20:30], true[30:] = 0.15, 0.35
    mark, found = shifts(views(true), BOX.model_copy(update={"tolerance": 0.25}))
    assert moved_fields(found, mark).tolist() == [False] * 30 + [True] * 10
    sharper, found = shifts(views(true))
    assert moved_fields(found, sharper).tolist() == [False] * 20 + [True] * 20


@settings(max_examples=15, deadline=None)
@given(cycles=st.floats(0.04, 0.5), phase=st.floats(0, 6.2), amplitude=st.floats(0.0, 0.2))
def test_a_camera_that_sways_is_no_alarm(cycles, phase, amplitude):
    """From 2.4 Hz at 60 fields a second."""
    sway = amplitude * np.sin(2 * np.pi * cycles * np.arange(60) + phase)
    shift = np.stack([sway, -0.5 * sway], axis=1)
    shift += 0.003 * np.random.default_rng(4).standard_normal(shift.shape)
    mark, _ = shifts(views(np.zeros((6, 2))))
    assert not moved_fields(shift, mark).any()


def test_no_alarm_of_noise_or_light():
    mark, _ = shifts(views(np.zeros((6, 2))))
    noise = 0.003 * np.random.default_rng(5).standard_normal((500, 60, 2))
    assert not any(moved_fields(each, mark).any() for each in noise)
    lights = [views(np.zeros((20, 2)), light=light, seed=6) for light in (1.0, 0.6, 0.8)]
    _, found = shifts(np.concatenate(lights))
    assert not moved_fields(found, mark).any()


def test_a_level_edge_says_nothing_of_columns():
    true = np.zeros((12, 2))
    true[6:] = [1.3, 5.0]
    mark, found = shifts(views(true, kind="edge"))
    assert np.isnan(mark.column)
    assert np.isnan(found[:, 1]).all()
    assert np.abs(found[:, 0] - true[:, 0]).max() < 0.05
    assert has_moved(found, mark).tolist() == [False] * 6 + [True] * 6


def test_a_still_mark_is_not_flagged():
    mark, found = shifts(views(np.zeros((60, 2))))
    assert found[FIRST_FIELDS:].std(axis=0).max() < 0.02
    assert not has_moved(found, mark).any()


def test_a_mark_that_cannot_be_recognised_has_moved():
    fields = views(np.zeros((12, 2)))
    fields[8:] = np.random.default_rng(2).integers(15, 25, fields[8:].shape)
    mark, found = shifts(fields)
    assert np.isinf(found[8:]).any(axis=1).all()
    assert has_moved(found, mark).tolist() == [False] * 8 + [True] * 4


def test_a_stated_place_is_what_counts():
    fields = views(np.zeros((12, 2)))
    mark, _ = shifts(fields)
    stated = BOX.model_copy(update={"row": mark.row - 1.0, "column": mark.column})
    again, found = shifts(fields, stated)
    assert np.median(found[:, 0]) == pytest.approx(1.0, abs=0.02)
    assert has_moved(found, again).all()


def test_a_box_without_a_mark_says_nothing():
    flat = np.full((12, 80, 100), 90, np.uint8)
    mark, found = shifts(flat)
    assert np.isnan(found).all()
    assert not has_moved(found, mark).any()


@settings(max_examples=20, deadline=None)
@given(down=st.floats(-3, 3), right=st.floats(-3, 3), seed=st.integers(0, 2**32 - 1))
def test_upside_down_the_shift_is_negated(down, right, seed):
    true = np.zeros((8, 2))
    true[6:] = [down, right]
    fields = views(true, interlaced=False, seed=seed)
    _, found = shifts(fields, interlaced=False)
    flipped = BOX.model_copy(update={"rows": (80 - 66, 80 - 40), "columns": (100 - 62, 100 - 20)})
    _, turned = shifts(fields[:, ::-1, ::-1].copy(), flipped, interlaced=False)
    np.testing.assert_allclose(turned, -found, atol=1e-6)


def test_a_box_outside_the_window_or_too_small_is_refused():
    stack = FieldStack.from_array(views(np.zeros((2, 2))), FieldInfo(rate_hz=60.0))
    setup = Setup.model_validate({"glint": {"reference": {"rows": [70, 90], "columns": [0, 40]}}})
    message = (
        "glint.reference rows [70, 90], columns [0, 40] lie outside the 100 x 80 recorded window "
        "of fields; the last of each is excluded"
    )
    with pytest.raises(SetupError, match=re.escape(message)):
        resolve_recording(stack, setup)
    with pytest.raises(ValueError, match=re.escape("rows [3, 8] holds fewer than 6 pixels")):
        Reference(rows=(3, 8), columns=(0, 40))
