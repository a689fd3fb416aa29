import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import line_fields

from glint_aoa.errors import RecordingError, SetupError
from glint_aoa.flags import Flag
from glint_aoa.optical.measure import measure_fields, measure_stack, prepare
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.recording import resolve_recording
from glint_aoa.setup import Camera, Fields, Glint, Setup

PITCH = (11.7e-6, 27.5e-6)
CAMERA = Camera(
    focal_length="35 mm",
    pixel_pitch=("11.7 um", "27.5 um"),
    sensor=(752, 240),
    principal_point=(375.5, 119.5),
    position=("0 m", "-56 in", "60 mm"),
)
INFO = FieldInfo(
    rate_hz=60.0,
    exposure_s=1e-3,
    first_line=98,
    first_column=0,
    interlaced=True,
    first_parity="even",
)


def measure(fields, setup=None, info=INFO, **stack):
    setup = setup or Setup(camera=CAMERA)
    held = FieldStack.from_array(fields, info, **stack)
    return measure_stack(held, setup, resolve_recording(held, setup))


def angle_of(slope, nose=-1):
    """The aligned camera's angle of a line of `slope` lines a column, v down [deg]."""
    return nose * np.degrees(np.arctan(-slope * PITCH[1] / PITCH[0]))


def test_angle_and_intercept_of_a_known_line():
    fields = line_fields(np.random.default_rng(1), slope=0.021, row=40.3, interlaced=True)
    angles, _ = measure(fields)
    error = np.degrees(angles.angle) - angle_of(0.021)
    assert error.std(ddof=1) < 0.0013
    assert abs(error.mean()) < 4 * error.std(ddof=1) / np.sqrt(60)
    z = (119.5 - (98 + 40.3)) * PITCH[1]
    assert angles.intercept.mean() == pytest.approx(0.06 + z * 1.4224 / 0.035, abs=5e-6)
    assert (angles.flags == 0).all()
    assert (angles.columns_used >= 36).all()


def test_a_lamp_turned_up_between_two_of_the_brightest_quarter():
    rng = np.random.default_rng(8)
    dim = line_fields(rng, n_fields=7, peak=60.0)
    bright = line_fields(rng, n_fields=3, peak=180.0)
    angles, _ = measure(
        np.concatenate([dim, bright]), info=dataclasses.replace(INFO, interlaced=False)
    )
    assert np.abs(np.degrees(angles.angle)).max() < 0.02
    assert (angles.columns_used == 38).all()


def test_time_is_the_middle_of_the_exposure_and_parity_alternates():
    fields = line_fields(n_fields=5, shape=(60, 400), interlaced=True, row=30)
    info = dataclasses.replace(INFO, first_parity="odd", start_s=-0.5)
    angles, _ = measure(fields, info=info)
    np.testing.assert_allclose(angles.time_s, -0.5 + np.arange(5) / 60 + 0.0005)
    assert angles.parity.tolist() == [1, 0, 1, 0, 1]


def test_half_a_line_of_parity_stands_in_the_intercept():
    fields = line_fields(n_fields=2, shape=(60, 400), row=30)
    angles, _ = measure(fields)
    step = angles.intercept[1] - angles.intercept[0]
    assert step == pytest.approx(-0.5 * PITCH[1] * 1.4224 / 0.035, rel=1e-3)


def test_stated_noise_is_the_real_one():
    rng = np.random.default_rng(2)
    for peak in (40.0, 170.0):
        fields = line_fields(rng, n_fields=400, row=40.3, slope=0.003, peak=peak, interlaced=True)
        angles, _ = measure(fields)
        assert angles.angle.std(ddof=1) == pytest.approx(angles.angle_std.mean(), rel=0.12)
        pull = (angles.angle - angles.angle.mean()) / angles.angle_std
        assert 0.62 < (np.abs(pull) < 1).mean() < 0.74
        assert angles.intercept.std(ddof=1) == pytest.approx(angles.intercept_std.mean(), rel=0.15)


@settings(max_examples=15, deadline=None)
@given(slope=st.floats(-0.04, 0.04), seed=st.integers(0, 2**32 - 1))
def test_a_mirrored_image_negates_the_angle(slope, seed):
    fields = line_fields(np.random.default_rng(seed), n_fields=3, row=45.2, slope=slope)
    ahead, _ = measure(fields)
    mirrored, _ = measure(fields[:, :, ::-1].copy(), Setup(camera=CAMERA))
    # Columns 10 ... 750 mirror onto 1 ... 741: other pixels, so only the noise is shared.
    np.testing.assert_allclose(mirrored.angle, -ahead.angle, atol=np.radians(0.008))
    every = Setup(camera=CAMERA, glint=Glint(column_step=1))
    ahead, _ = measure(fields, every)
    mirrored, _ = measure(fields[:, :, ::-1].copy(), every)
    np.testing.assert_allclose(mirrored.angle, -ahead.angle, atol=1e-7)


def test_nose_right_negates_the_angle():
    fields = line_fields(np.random.default_rng(3), n_fields=3, slope=0.01)
    left, _ = measure(fields)
    right, _ = measure(fields, Setup(camera=CAMERA, glint=Glint(nose="right")))
    np.testing.assert_array_equal(right.angle, -left.angle)
    assert np.degrees(right.angle).mean() == pytest.approx(angle_of(0.01, nose=1), abs=0.003)


def test_blocks_give_what_the_whole_stack_gives():
    fields = line_fields(np.random.default_rng(4), n_fields=23, shape=(60, 400), row=30)
    stack, setup = FieldStack.from_array(fields, INFO), Setup(camera=CAMERA)
    recording = resolve_recording(stack, setup)
    how = prepare(stack, setup, recording)
    whole = measure_fields(fields, np.arange(23), how)
    for start, block in stack.blocks(5):
        part = measure_fields(block, np.arange(start, start + len(block)), how)
        np.testing.assert_array_equal(part.angle, whole.angle[start : start + len(block)])


def test_fields_without_a_glint_are_flagged_and_the_others_kept():
    fields = line_fields(
        np.random.default_rng(5), n_fields=20, shape=(60, 400), row=30, interlaced=True
    )
    fields[7] = np.random.default_rng(6).integers(8, 13, (60, 400))
    angles, _ = measure(fields)
    assert angles.flags[7] == Flag.NO_GLINT | Flag.FEW_COLUMNS
    assert np.isnan(angles.angle[7])
    assert np.isfinite(np.delete(angles.angle, 7)).all()
    assert (np.delete(angles.flags, 7) == 0).all()


def test_a_stack_without_a_glint_measures_nothing():
    fields = np.random.default_rng(7).integers(90, 110, (12, 60, 400), dtype=np.uint8)
    angles, how = measure(fields)
    assert not how.shape.found
    assert np.isnan(angles.angle).all()
    assert (angles.flags & Flag.NO_GLINT).all()


def test_paint_and_dead_columns_do_not_pull():
    rng = np.random.default_rng(8)
    fields = line_fields(rng, slope=0.01, row=40.3, n_fields=40, interlaced=True)
    fields[:, 20:60, 100:135] = 200  # a painted patch over two of the measured columns
    fields[:, :, 590] = 0
    fields[:, :, 710] = 255
    angles, _ = measure(fields)
    error = np.degrees(angles.angle) - angle_of(0.01)
    assert abs(error.mean()) < 0.0006
    assert angles.columns_used.min() >= 33
    assert (angles.flags == 0).all()


def test_bright_clipping_and_truncation_are_flagged():
    clipped, _ = measure(line_fields(n_fields=9, shape=(60, 400), row=30, peak=400))
    assert (clipped.flags & Flag.SATURATED).all()
    cut, _ = measure(line_fields(n_fields=9, shape=(40, 752), row=20, slope=0.08))
    assert (cut.flags & Flag.TRUNCATED).all()
    assert np.degrees(cut.angle[0]) == pytest.approx(angle_of(0.08), abs=0.05)


def test_without_a_camera_the_angle_is_that_of_the_image_plane():
    fields = line_fields(np.random.default_rng(9), n_fields=9, shape=(60, 400), slope=0.02, row=30)
    info = FieldInfo(rate_hz=150.0)
    square, _ = measure(fields, Setup(), info)
    assert (square.flags == Flag.UNCALIBRATED).all()
    assert np.degrees(square.angle.mean()) == pytest.approx(np.degrees(np.arctan(0.02)), abs=2e-3)
    pitch_only = Setup(camera=Camera(pixel_pitch=("11.7 um", "27.5 um")))
    oblong, _ = measure(fields, pitch_only, info)
    assert np.degrees(oblong.angle.mean()) == pytest.approx(angle_of(0.02), abs=4e-3)
    assert (oblong.flags == Flag.UNCALIBRATED).all()


def test_one_field_is_enough():
    angles, how = measure(line_fields(np.random.default_rng(10), n_fields=1, slope=0.01))
    assert not how.knows_noise
    assert np.degrees(angles.angle[0]) == pytest.approx(angle_of(0.01), abs=0.005)
    assert 0 < np.degrees(angles.angle_std[0]) < 0.005


def test_irregular_timestamps_are_used_and_flagged():
    fields = line_fields(n_fields=6, shape=(60, 400), row=30)
    times = np.arange(6) / 60
    times[4:] += 0.5 / 60
    angles, _ = measure(fields, times_s=times)
    np.testing.assert_allclose(angles.time_s, times + 0.0005)
    assert [bool(f & Flag.TIMING) for f in angles.flags] == [False] * 4 + [True, False]


def test_timestamps_give_the_rate_where_nothing_else_does():
    fields = line_fields(n_fields=4, shape=(60, 400), row=30)
    times = np.arange(4) / 250
    angles, how = measure(fields, Setup(), FieldInfo(), times_s=times)
    assert how.recording.rate_hz == pytest.approx(250)
    np.testing.assert_allclose(angles.time_s, times)


def test_too_few_columns_are_refused():
    fields = line_fields(n_fields=2, shape=(60, 45), row=30)
    with pytest.raises(RecordingError) as caught:
        measure(fields)
    assert str(caught.value) == (
        "fields: 45 columns at a step of 20 leave 2 to measure; "
        "a line needs three, so lower glint.column_step"
    )


@pytest.mark.parametrize(
    ("setup", "info", "message"),
    [
        (
            Setup(),
            FieldInfo(),
            "fields: the file does not say its field rate; give fields.rate in the setup",
        ),
        (
            Setup(fields=Fields(rate="50 Hz")),
            INFO,
            "fields: the file says rate 60.0, the setup fields.rate 50.0; "
            "take it out of the setup or correct it",
        ),
        (
            Setup(camera=CAMERA),
            dataclasses.replace(INFO, first_line=200),
            "fields: a window of 400 x 60 at column 0, line 200 does not fit the sensor of "
            "752 x 240; correct camera.sensor, fields.first_line or first_column",
        ),
        (
            Setup(glint=Glint(search_window=(10, 70))),
            INFO,
            "glint.search_window [10, 70] ends outside the 60 recorded rows of fields; "
            "its last row is excluded and may be 60 at most",
        ),
    ],
)
def test_setup_and_recording_that_contradict_each_other(setup, info, message):
    with pytest.raises(SetupError) as caught:
        measure(line_fields(n_fields=2, shape=(60, 400), row=30), setup, info)
    assert str(caught.value) == message


def test_setup_fills_what_the_file_does_not_say():
    setup = Setup(
        camera=CAMERA,
        fields=Fields(
            rate="60 Hz", exposure="1 ms", first_line=98, interlaced=True, first_parity="odd"
        ),
    )
    fields = line_fields(n_fields=4, shape=(60, 400), row=30)
    silent, _ = measure(fields, setup, FieldInfo())
    spoken, _ = measure(fields, info=dataclasses.replace(INFO, first_parity="odd"))
    np.testing.assert_array_equal(silent.intercept, spoken.intercept)
    np.testing.assert_array_equal(silent.parity, [1, 0, 1, 0])
