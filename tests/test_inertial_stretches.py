"""Long records are corrected in stretches; the rows are those of the whole."""

import dataclasses
import sys

import numpy as np
import pytest
import rigid_body
from test_inertial_modal import setup_of

from glint_aoa.flags import Flag
from glint_aoa.inertial import correct
from glint_aoa.records.acquisition import AcquisitionRecord, LazySamples

module = sys.modules["glint_aoa.inertial.correct"]


@pytest.fixture(scope="module")
def record():
    from test_inertial_kinematic import recorded

    motion = rigid_body.together(
        rigid_body.sine(1, duration_s=60.0, modulation_hz=0.15),
        rigid_body.sine(2, duration_s=60.0, bias_deg=0.05),
    )
    return recorded(motion)


def in_file(record, read):
    """Leave the samples where they are until asked for; `read` counts what is asked for."""

    def lazy(samples):
        def stretch(start, stop):
            read.append(stop - start)
            return samples[start:stop]

        return LazySamples(samples.size, samples.dtype, stretch)

    channels = {
        name: dataclasses.replace(each, samples=lazy(each.samples))
        for name, each in record.channels.items()
    }
    return AcquisitionRecord(record.name, channels)


@pytest.mark.parametrize("causal", [False, True])
def test_stretches_join_to_the_whole(record, monkeypatch, causal):
    whole = correct(record, setup_of(), causal=causal)
    monkeypatch.setattr(module, "STRETCH_S", 20.0)
    joined = correct(record, setup_of(), causal=causal)
    assert joined.settings["stretches"] == 3
    np.testing.assert_array_equal(joined.time_s, whole.time_s)
    np.testing.assert_allclose(joined.raw_angle_deg, whole.raw_angle_deg, atol=1e-7)
    np.testing.assert_allclose(joined.angle_deg, whole.angle_deg, atol=1e-6)
    np.testing.assert_array_equal(joined.flags, whole.flags)
    assert np.count_nonzero(joined.flags & Flag.FILTER_SETTLING) < 120


def test_samples_are_read_a_stretch_at_a_time(record, monkeypatch):
    monkeypatch.setattr(module, "STRETCH_S", 20.0)
    read = []
    joined = correct(in_file(record, read), setup_of())
    np.testing.assert_array_equal(joined.angle_deg, correct(record, setup_of()).angle_deg)
    assert max(read) <= (20.0 + 2 * 19.2) * 800.0
    assert joined.why.endswith("; in 3 stretches, the first of which this describes")


def test_rows_that_do_not_fall_on_samples_are_neither_lost_nor_doubled(record, monkeypatch):
    monkeypatch.setattr(module, "STRETCH_S", 20.0)
    rows = correct(record, setup_of(), rate_hz=7.3)
    np.testing.assert_allclose(np.diff(rows.time_s), 1 / 7.3)
    assert rows.time_s[-1] <= 60.0 - 1 / 800.0 < rows.time_s[-1] + 1 / 7.3
