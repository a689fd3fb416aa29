import dataclasses
import re
import sys

import numpy as np
import pytest
import rigid_body
from test_inertial_modal import setup_of

from glint_aoa.errors import InputError, OutputError, RecordingError
from glint_aoa.flags import Flag
from glint_aoa.inertial import correct
from glint_aoa.inertial.correct import write_correction
from glint_aoa.inertial.filters import low_pass, settling_s
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.setup import Inertial


@pytest.fixture(scope="module")
def record():
    motion = rigid_body.sine(1, duration_s=12.0, pitch_deg=4.3)
    return rigid_body.record(motion, pitch_deg=4.3, rng=np.random.default_rng(7))


def changed(record, name, **changes):
    channels = {**record.channels, name: dataclasses.replace(record[name], **changes)}
    return AcquisitionRecord(record.name, channels, record.meta)


def without(record, *names):
    channels = {name: each for name, each in record.channels.items() if name not in names}
    return AcquisitionRecord(record.name, channels, record.meta)


def test_rows_start_at_the_records_start_and_come_at_the_rate_asked_for(record):
    later = record
    for name in record.channels:
        later = changed(later, name, start_s=-0.5)
    result = correct(later, setup_of())
    assert result.time_s[0] == -0.5
    np.testing.assert_allclose(np.diff(result.time_s), 0.05)
    assert result.time_s[-1] <= -0.5 + 12.0
    assert len(correct(record, setup_of(), rate_hz=800.0).time_s) == len(record["ay_face"])


def test_raw_is_the_unfiltered_output_through_the_same_low_pass(record):
    result = correct(record, setup_of())
    force = low_pass(record["aoa_unfiltered"].samples, 800.0, setup_of().filter)
    expected = np.degrees(np.arcsin(force / 9.80665))[::40]
    np.testing.assert_allclose(result.raw_angle_deg, expected, atol=1e-12)
    np.testing.assert_allclose(result.bias_deg, result.raw_angle_deg - result.angle_deg)


def test_auto_says_what_it_chose_and_why(record):
    result = correct(record, setup_of())
    assert result.method == "modal"
    assert result.why == (
        "chosen automatically, since the kinematic correction lacks a second accelerometer along "
        "model y (yaw) at least 0.05 m from ay_face and a second accelerometer along model z "
        "(pitch) at least 0.05 m from az_face: modal correction from ay_face and az_face; modes "
        "that stand out: 1"
    )
    assert correct(record, setup_of(), method="modal").why.startswith("as asked: modal")


def test_an_output_in_degrees_gives_the_same_angle(record):
    motion = rigid_body.sine(1, duration_s=8.0)
    one, two = (
        correct(rigid_body.record(motion, pitch_deg=6.0, angle_units=units), setup_of())
        for units in (False, True)
    )
    np.testing.assert_allclose(one.angle_deg, two.angle_deg, atol=1e-10)


def test_the_causal_run_lags_and_settles_on_the_same_angle(record):
    result = correct(record, setup_of(), causal=True)
    settled = (result.flags & Flag.FILTER_SETTLING) == 0
    assert settled[-25]
    assert not settled[20]
    assert (
        np.max(np.abs(result.angle_deg[settled] - 4.3)) < 0.003
    )  # 1 % of what the first sample was off


def test_a_record_with_only_the_filtered_output_is_corrected_and_says_so():
    motion = rigid_body.sine(1, modulation_hz=0.25, duration_s=20.0)
    source = rigid_body.record(motion, rng=np.random.default_rng(8))
    filtered = low_pass(source["aoa_unfiltered"].samples, 800.0, setup_of().filter, causal=True)
    given = changed(source, "aoa_unfiltered", samples=filtered, quantity="aoa_filtered")
    result = correct(given, setup_of())
    settled = (result.flags & Flag.FILTER_SETTLING) == 0
    assert np.max(np.abs(result.angle_deg[settled])) < 0.001
    assert result.settings["causal"] is True
    assert result.why.endswith(
        "; only the filtered output is recorded, so the correction was low-passed alike and "
        "added to it"
    )


def test_the_ends_are_flagged_for_the_settling_time(record):
    flags = correct(record, setup_of()).flags & Flag.FILTER_SETTLING
    assert np.count_nonzero(flags[:100]) == 53  # 2.63 s at 20 rows a second
    assert flags[53] == 0
    assert flags[-1] != 0


def test_clipped_channels_are_flagged_and_widen_the_uncertainty(record):
    peak = float(np.max(record["ay_face"].samples))
    low, high = -0.9 * peak, 0.9 * peak
    samples = np.clip(record["ay_face"].samples, low, high)
    clipped = correct(changed(record, "ay_face", samples=samples, limits=(low, high)), setup_of())
    assert np.all(clipped.flags & Flag.CLIPPED_CHANNEL)
    assert np.all(clipped.flags & Flag.UNCERTAIN_CORRECTION)
    settled = (clipped.flags & Flag.FILTER_SETTLING) == 0
    error = np.abs(clipped.angle_deg - 4.3)[settled]
    assert np.max(error / clipped.angle_std_deg[settled]) < 1.5


def test_one_clipped_sample_flags_only_its_neighbourhood(record):
    samples = record["ay_face"].samples.copy()
    samples[4800] = 190.0
    result = correct(
        changed(record, "ay_face", samples=samples, limits=(-190.0, 190.0)), setup_of()
    )
    flagged = result.time_s[(result.flags & Flag.CLIPPED_CHANNEL) > 0]
    assert flagged[0] == pytest.approx(6 - 2.63, abs=0.05)
    assert flagged[-1] == pytest.approx(6 + 2.63, abs=0.05)


@pytest.mark.parametrize("method", ["modal", "harmonic"])
@pytest.mark.parametrize("level", [0.9, 0.6])
def test_what_a_clipped_package_lost_is_in_the_uncertainty(method, level):
    """The second harmonic is cut off on one side, which shifts the mean: no method sees that."""
    source = rigid_body.record(rigid_body.sine(1, duration_s=12.0), rng=np.random.default_rng(7))
    samples = source["aoa_unfiltered"].samples
    middle, swing = float(np.mean(samples)), float(np.ptp(samples)) / 2
    limits = (middle - swing * level, 0.5 * 9.80665)
    given = changed(source, "aoa_unfiltered", samples=np.maximum(samples, limits[0]), limits=limits)
    result = correct(given, setup_of(), method=method)
    whole = correct(source, setup_of(), method=method)
    assert np.all(result.flags & Flag.CLIPPED_CHANNEL)
    shift = np.abs(result.raw_angle_deg - whole.raw_angle_deg)[result.settled]
    assert np.min(shift) > 0.001
    error, std = (each[result.settled] for each in (result.angle_deg, result.angle_std_deg))
    assert np.max(np.abs(error) / std) < 1.96
    assert np.all(std < 3 * shift + 2 * whole.angle_std_deg[result.settled])


def test_a_package_clipped_for_long_leaves_its_angle_unknown(record):
    samples = record["aoa_unfiltered"].samples.copy()
    samples[4800:4880] = 2.0
    given = changed(record, "aoa_unfiltered", samples=samples, limits=(-2.0, 2.0))
    result = correct(given, setup_of())
    unknown = np.isnan(result.angle_std_deg)
    assert unknown[np.abs(result.time_s - 6.05) < 0.2].all()
    assert not unknown[np.abs(result.time_s - 6.05) > 2.7].any()
    assert np.all(result.flags[unknown] & Flag.CLIPPED_CHANNEL)
    assert np.all(result.flags[unknown] & Flag.UNCERTAIN_CORRECTION)


def test_noise_of_the_package_is_in_the_uncertainty():
    motion = rigid_body.sine(1, bias_deg=0.0, duration_s=60.0)
    source = rigid_body.record(motion, rng=np.random.default_rng(10), noise=(0.02, 1e-3))
    result = correct(source, setup_of())
    settled = (result.flags & Flag.FILTER_SETTLING) == 0
    assert np.std(result.angle_deg[settled]) == pytest.approx(
        np.mean(result.angle_std_deg), rel=0.4
    )


def test_without_modes_the_table_of_the_paper_is_not_assumed(record):
    message = (
        "rigid-body: the modal correction lacks modes: list each vibration mode as "
        "[[inertial.mode]] in the setup"
    )
    with pytest.raises(InputError, match=re.escape(message)):
        correct(record, Inertial(), method="modal")
    assert correct(record, Inertial()).method not in {"kinematic", "modal", "nlr", "spectral"}


def test_missing_accelerometers_are_named(record):
    message = (
        "rigid-body: the kinematic correction lacks two accelerometers along model y (yaw) at "
        "least 0.05 m apart and two accelerometers along model z (pitch) at least 0.05 m apart; "
        "the modal correction lacks an accelerometer at the package along model y (yaw) and "
        "model z (pitch)"
    )
    with pytest.raises(InputError, match=re.escape(message)):
        correct(without(record, "ay_face", "az_face"), setup_of())


def test_an_unknown_method_is_refused(record):
    message = "method is 'kinetic'; choose one of auto, kinematic, modal"
    with pytest.raises(InputError, match=re.escape(message)):
        correct(record, setup_of(), method="kinetic")


def test_a_record_without_the_package_is_refused(record):
    message = (
        "rigid-body: no channel of quantity aoa_unfiltered or aoa_filtered; record the "
        "package's output, or name it under [[inertial.channel]] in the setup"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        correct(without(record, "aoa_unfiltered"), setup_of())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rate_hz": 400.0}, "rate (800 Hz and 400 Hz)"),
        ({"start_s": 0.1}, "start (0 s and 0.1 s)"),
        ({"samples": np.zeros(9000)}, "length (9600 samples and 9000 samples)"),
    ],
)
def test_channels_on_different_clocks_are_refused(record, changes, words):
    message = (
        f"rigid-body: channels aoa_unfiltered and ay_face differ in {words}; "
        "resample them to one clock"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        correct(changed(record, "ay_face", **changes), setup_of())


@pytest.mark.parametrize("name", ["aoa_unfiltered", "ay_face"])
def test_samples_that_are_not_finite_are_refused(record, name):
    samples = record[name].samples.copy()
    samples[800:803] = np.nan
    message = (
        f"rigid-body: channel {name} has 3 samples that are not finite, the first at 1.000 s; "
        "cut the record to a stretch without them"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        correct(changed(record, name, samples=samples), setup_of())


def test_an_output_in_volts_is_refused(record):
    message = (
        "rigid-body: channel aoa_unfiltered is in V, expected an acceleration (g_0, m/s^2) or an "
        "angle (deg, rad); correct units in the record or the setup"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        correct(changed(record, "aoa_unfiltered", units="V"), setup_of())


def test_too_short_a_record_is_refused():
    source = rigid_body.record(rigid_body.sine(1, duration_s=1.0))
    message = "the record lasts 1 s, but the 0.4 Hz low-pass needs 2.62 s to settle"
    with pytest.raises(RecordingError, match=re.escape(message)):
        correct(source, setup_of())


def test_a_rate_of_zero_is_refused(record):
    message = "rate_hz is 0; give a number of rows a second above zero"
    with pytest.raises(InputError, match=re.escape(message)):
        correct(record, setup_of(), rate_hz=0.0)


def test_the_nearest_accelerometer_is_taken(record):
    far = dataclasses.replace(record["ay_face"], name="ay_tail", station_m=-0.3)
    channels = {"ay_tail": far, **record.channels}
    result = correct(AcquisitionRecord("rigid-body", channels), setup_of())
    assert "from ay_face and az_face" in result.why


def test_the_table_holds_every_row_and_is_not_replaced_unasked(record, tmp_path):
    result = correct(record, setup_of())
    path = write_correction(tmp_path / "out", "point", result)
    table = np.genfromtxt(path, delimiter=",", names=True)
    assert table.dtype.names == (
        "time_s",
        "angle_deg",
        "angle_std_deg",
        "raw_angle_deg",
        "bias_deg",
        "flags",
    )
    np.testing.assert_allclose(table["angle_deg"], result.angle_deg, atol=1e-6)
    np.testing.assert_array_equal(table["flags"], result.flags)
    message = f"{path} is there already; give another --out, or --overwrite to replace it"
    with pytest.raises(OutputError, match=re.escape(message)):
        write_correction(tmp_path / "out", "point", result)
    assert write_correction(tmp_path / "out", "point", result, overwrite=True) == path


def test_where_a_method_cannot_know_the_uncertainty_is_empty_and_flagged(
    record, monkeypatch, tmp_path
):
    module = sys.modules["glint_aoa.inertial.correct"]
    known = module._METHODS["modal"]

    def estimate(task):
        found = known.estimate(task)
        unknown = np.where(np.arange(len(record["ay_face"])) < 1600, np.inf, 0.0)
        flags = np.where(np.isinf(unknown), int(Flag.UNCORRELATED), 0)
        return dataclasses.replace(found, std_terms=[*found.std_terms, unknown], flags=flags)

    monkeypatch.setattr(
        module, "_METHODS", {"modal": dataclasses.replace(known, estimate=estimate)}
    )
    result = correct(record, setup_of())
    unknown = np.isnan(result.angle_std_deg)
    assert unknown[result.time_s < 2.0].all()
    assert not unknown[result.time_s > 5.0].any()
    np.testing.assert_array_equal(unknown, (result.flags & Flag.UNCERTAIN_CORRECTION) > 0)
    near = result.time_s < 2.0 + settling_s(setup_of().filter)
    np.testing.assert_array_equal(near, (result.flags & Flag.UNCORRELATED) > 0)
    rows = write_correction(tmp_path, "point", result).read_text().splitlines()
    assert rows[1].split(",")[2] == ""


def test_auto_takes_the_most_certain_method_and_says_of_what_it_could_not_be(record, monkeypatch):
    module = sys.modules["glint_aoa.inertial.correct"]
    modal = module._METHODS["modal"]

    def doubtful(task):
        found = modal.estimate(task)
        return dataclasses.replace(found, std_terms=[np.full(found.addition.size, 0.01)])

    def fails(task):
        raise RecordingError("nothing to be had")

    monkeypatch.setattr(
        module,
        "_METHODS",
        {
            "broken": dataclasses.replace(modal, estimate=fails),
            "doubtful": dataclasses.replace(modal, estimate=doubtful),
            "sound": modal,
        },
    )
    result = correct(record, setup_of())
    assert result.method == "sound"
    assert result.why.startswith(
        "chosen automatically, since the doubtful correction is certain to 0.059 deg only here and "
        "the broken correction cannot be made: modal correction from "
    )
    monkeypatch.setattr(module, "_METHODS", {"broken": module._METHODS["broken"]})
    with pytest.raises(RecordingError, match=r"^nothing to be had$"):
        correct(record, setup_of())


def test_no_method_wins_by_overlooking_a_resonance_that_no_mode_lists(monkeypatch):
    monkeypatch.setitem(rigid_body.TABLE, 7, ("yaw", 14.5, 0.3))
    motion = rigid_body.together(
        rigid_body.sine(1, duration_s=12.0), rigid_body.sine(7, duration_s=12.0, bias_deg=0.05)
    )
    record = rigid_body.record(motion, rng=np.random.default_rng(3))
    result = correct(record, setup_of())
    assert result.method == "harmonic"  # measures it
    assert np.max(np.abs(result.angle_deg[result.settled])) < 0.002
    assert "the modal correction is certain to 0.0" in result.why
    modal = correct(record, setup_of(), method="modal")
    assert abs(modal.angle_deg[modal.settled].mean()) > 0.02
