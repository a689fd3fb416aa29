"""Acquisition channels and records."""

import re

import numpy as np
import pytest

from glint_aoa.errors import RecordingError
from glint_aoa.records.acquisition import AcquisitionRecord, Channel


def channel(name="ay", samples=(0, 1, -2), **options):
    samples = np.asarray(samples, np.int16)
    return Channel(name, samples, **{"rate_hz": 800.0, "units": "g_0", **options})


def test_values_are_samples_times_scale_in_the_unit_asked_for():
    values = channel(scale=0.5).values("m/s^2")
    np.testing.assert_allclose(values, [0, 4.903325, -9.80665], rtol=1e-15)
    assert values.dtype == np.float64


def test_temperatures_have_a_zero_of_their_own():
    warm = channel("warm", np.array([368, 0], np.int16), units="degC", scale=0.1)
    np.testing.assert_allclose(warm.values("K"), [309.95, 273.15], rtol=1e-12)


def test_times_start_at_start_s():
    np.testing.assert_allclose(channel(start_s=-0.1).time_s, [-0.1, -0.09875, -0.0975])
    assert len(channel()) == 3


def test_clipped_samples_lie_at_or_beyond_the_limits():
    assert channel().clipped.tolist() == [False, False, False]
    limited = channel(scale=2.0, limits=(-4.0, 3.0))
    assert limited.clipped.tolist() == [False, False, True]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"samples": []}, "channel ay: no samples; check that it was recorded"),
        (
            {"samples": [[1]]},
            "channel ay: samples are int16 of shape [1, 1], expected numbers in one dimension",
        ),
        ({"rate_hz": 0.0}, "channel ay: rate_hz is 0.0; expected a number greater than zero [Hz]"),
        ({"rate_hz": float("nan")}, "channel ay: rate_hz is nan; expected a number greater"),
    ],
)
def test_what_is_no_sampled_signal_is_refused(options, message):
    with pytest.raises(RecordingError, match="^" + re.escape(message)):
        channel(**options)


def test_text_samples_are_refused():
    with pytest.raises(RecordingError, match=re.escape("samples are <U1 of shape [1]")):
        Channel("ay", np.array(["a"]), 800.0)


@pytest.mark.parametrize(
    ("units", "message"),
    [
        (
            None,
            "channel ay: the record gives no units; "
            "give them under [[inertial.channel]] in the setup",
        ),
        (
            "N",
            "channel ay: 'N' cannot be turned into 'm/s^2'; "
            "correct units in the record or the setup",
        ),
    ],
)
def test_units_that_do_not_fit_are_refused(units, message):
    with pytest.raises(RecordingError, match="^" + re.escape(message) + "$"):
        channel(units=units).values("m/s^2")


def test_record_finds_channels_by_quantity_and_axis_in_record_order():
    channels = [
        channel("b", quantity="acceleration", axis="+y"),
        channel("a", quantity="acceleration", axis="+z"),
        channel("aoa", quantity="aoa_filtered"),
        channel("c", quantity="acceleration", axis="+y"),
    ]
    record = AcquisitionRecord("p1", {each.name: each for each in channels})
    assert [each.name for each in record.with_quantity("acceleration")] == ["b", "a", "c"]
    assert [each.name for each in record.with_quantity("acceleration", "+y")] == ["b", "c"]
    assert record.with_quantity("moment") == []
    assert record["aoa"] is channels[2]
    with pytest.raises(
        RecordingError, match="^" + re.escape("p1: no channel d; channels here: b, a, aoa, c") + "$"
    ):
        record["d"]
