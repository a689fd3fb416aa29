"""Kinematic correction against rigid-body kinematics; the bias formula makes no data here."""

import dataclasses
import re

import numpy as np
import pytest
import rigid_body
from hypothesis import given, settings
from hypothesis import strategies as st
from test_inertial_modal import rms, setup_of

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.flags import Flag
from glint_aoa.inertial import TABLE_1, correct
from glint_aoa.inertial.modes import Mode
from glint_aoa.inertial.motion import rigid_weights
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.setup import Inertial

G = rigid_body.GRAVITY
STATIONS = {"face": 0.9, "mid": 0.55, "aft": 0.1}
NOISE = 0.5e-3 * G
SINE_OF_ALL = {1: 0.15, 2: 0.05, 3: 0.008, 4: 0.008, 5: 0.03, 6: 0.03}
RANDOM_OF_ALL = {1: 0.18, 2: 0.1, 3: 0.1, 4: 0.05, 5: 0.05, 6: 0.05}


def accelerometer(name, samples, station_m, *, full_scale=20 * G, axis):
    return Channel(
        name=name,
        samples=rigid_body.quantise(samples, full_scale),
        rate_hz=rigid_body.RATE_HZ,
        quantity="acceleration",
        units="m/s^2",
        station_m=station_m,
        axis=axis,
        limits=(-full_scale, full_scale),
    )


_FORCES = {}


def forces(motion, station_m, pitch_deg):
    """Specific forces, kept: tests that differ in their sensors share a motion."""
    key = id(motion), station_m, pitch_deg
    if key not in _FORCES:
        felt = rigid_body.specific_force(motion, station_m=station_m, pitch_deg=pitch_deg)
        _FORCES[key] = motion, felt  # the motion lives as long as its id
    return _FORCES[key][1]


def recorded(motion, *, pitch_deg=0.0, seed=1, gains=None, tilts=None, full_scale=20 * G):
    """Package and three accelerometers a plane; tilts [rad] are towards the other plane."""
    rng = np.random.default_rng(seed)
    axial = forces(motion, rigid_body.STATION_M, pitch_deg)[:, 0]
    package = Channel(
        name="aoa_unfiltered",
        samples=rigid_body.quantise(axial + rng.normal(0.0, 50e-6 * G, axial.size), G),
        rate_hz=rigid_body.RATE_HZ,
        quantity="aoa_unfiltered",
        units="m/s^2",
        station_m=rigid_body.STATION_M,
        axis="+x",
    )
    channels = {"aoa_unfiltered": package}
    for place, station in STATIONS.items():
        felt = forces(motion, station, pitch_deg)
        for axis, along, across in (("y", 1, 2), ("z", 2, 1)):
            name = f"a{axis}_{place}"
            signal = felt[:, along] + (tilts or {}).get(name, 0.0) * felt[:, across]
            signal = signal * (gains or {}).get(name, 1.0) + rng.normal(0, NOISE, len(felt))
            channels[name] = accelerometer(
                name, signal, station, axis=f"+{axis}", full_scale=full_scale
            )
    return AcquisitionRecord("rigid-body", channels)


def corrected(record, *, pitch_deg=0.0, inertial=None, **options):
    """Residual, raw error and std of the settled rows [deg], and the whole correction."""
    result = correct(record, inertial or setup_of(), **options)
    settled = (result.flags & Flag.FILTER_SETTLING) == 0
    assert np.count_nonzero(settled) > 50
    left, raw = result.angle_deg - pitch_deg, result.raw_angle_deg - pitch_deg
    return left[settled], raw[settled], result.angle_std_deg[settled], result


def without(record, *names):
    kept = {name: each for name, each in record.channels.items() if name not in names}
    return AcquisitionRecord(record.name, kept)


def changed(record, name, **changes):
    channels = {**record.channels, name: dataclasses.replace(record[name], **changes)}
    return AcquisitionRecord(record.name, channels)


def sines(biases, **options):
    motions = (rigid_body.sine(n, bias_deg=bias, **options) for n, bias in biases.items())
    return rigid_body.together(*motions)


@pytest.fixture(scope="module")
def broad():
    """Six modes of both planes under independent forces."""
    rng = np.random.default_rng(5)
    return rigid_body.random(RANDOM_OF_ALL, rng=rng, common_force=False, duration_s=24.0)


@pytest.fixture(scope="module")
def record(broad):
    return recorded(broad)


@pytest.mark.parametrize("pitch_deg", [0.0, 6.0])
def test_sines_in_all_modes_of_both_planes(pitch_deg):
    motion = sines(SINE_OF_ALL, duration_s=14.0)
    left, raw, _, result = corrected(recorded(motion, pitch_deg=pitch_deg), pitch_deg=pitch_deg)
    assert result.method == "kinematic"
    assert np.max(raw) < -0.1
    assert rms(left) < 0.0003
    assert np.max(np.abs(left)) < 0.001


def test_modulated_sines():
    motion = rigid_body.together(
        rigid_body.sine(1, bias_deg=0.4, modulation_hz=0.25),
        rigid_body.sine(2, bias_deg=0.2, modulation_hz=0.25, phase=1.0),
        rigid_body.sine(5, bias_deg=0.03, modulation_hz=0.25),
    )
    left, raw, _, _ = corrected(recorded(motion))
    assert np.ptp(raw) > 0.3
    assert rms(left) < 0.0003
    assert np.max(np.abs(left)) < 0.001


@pytest.mark.parametrize("seed", [1, 2])
def test_random_excitation_of_all_modes(seed):
    motion = rigid_body.random(
        RANDOM_OF_ALL, rng=np.random.default_rng(seed), common_force=seed == 1, duration_s=24.0
    )
    left, raw, _, _ = corrected(recorded(motion, pitch_deg=3.0, seed=seed), pitch_deg=3.0)
    assert np.mean(raw) < -0.15
    assert rms(left) < 0.0005
    assert np.max(np.abs(left)) < 0.001


@pytest.mark.parametrize("plane", ["yaw", "pitch"])
def test_two_modes_at_8_8_and_9_8_hz(monkeypatch, plane):
    monkeypatch.setitem(rigid_body.TABLE, 7, (plane, 8.8, 0.55))
    motion = sines({1: 0.15, 7: 0.08, 2: 0.05}, duration_s=14.0)
    left, raw, _, _ = corrected(recorded(motion))
    assert np.max(raw) < -0.2
    assert rms(left) < 0.0005
    assert np.max(np.abs(left)) < 0.001


@pytest.mark.parametrize("number", [1, 2, 5, 6])
def test_a_single_sine_is_the_closed_form(number):
    """Equation 7 of the paper, with the amplitude that made the motion."""
    _, frequency, radius = rigid_body.TABLE[number]
    motion = rigid_body.sine(number, bias_deg=0.15, duration_s=12.0)
    amplitude = rigid_body.sine_amplitude(number, 0.15, frequency, 0.0)
    speed = 2 * np.pi * frequency * abs(radius) * amplitude
    result = correct(recorded(motion), setup_of())
    expected = -np.degrees(speed**2 / (2 * radius * G))
    assert np.mean(result.bias_deg[result.settled]) == pytest.approx(expected, rel=1e-3)


def test_no_modal_survey_is_needed(record):
    left, raw, _, _ = corrected(record, inertial=Inertial())
    assert np.mean(raw) < -0.15
    assert rms(left) < 0.0005


def test_two_accelerometers_a_plane_are_enough(record):
    left, _, _, result = corrected(without(record, "ay_mid", "az_mid"))
    assert rms(left) < 0.0005
    assert result.why == (
        "chosen automatically: kinematic correction from ay_face, ay_aft (yaw) and az_face, "
        "az_aft (pitch)"
    )


def test_only_the_planes_that_have_modes_are_needed():
    record = without(recorded(rigid_body.sine(1, duration_s=12.0)), "az_face", "az_mid", "az_aft")
    yaw = tuple(mode for mode in TABLE_1 if mode.plane == "yaw")
    left, _, _, result = corrected(record, inertial=setup_of(yaw))
    assert result.method == "kinematic"
    assert rms(left) < 0.0003


def test_channels_that_sense_backwards_are_turned(record):
    turned = changed(record, "ay_aft", samples=-record["ay_aft"].samples, axis="-y")
    one, two = (correct(each, setup_of()) for each in (record, turned))
    np.testing.assert_allclose(one.angle_deg, two.angle_deg, atol=1e-9)


def test_the_same_sensor_on_a_second_acquisition_counts_once(record):
    again = dataclasses.replace(record["ay_face"], name="analyser_ay_face")
    doubled = AcquisitionRecord("r", {**record.channels, again.name: again})
    one, two = (correct(each, setup_of()) for each in (record, doubled))
    np.testing.assert_array_equal(one.angle_deg, two.angle_deg)
    assert one.why == two.why


@given(
    st.lists(st.floats(-1.5, 1.5), min_size=2, max_size=5, unique_by=lambda d: round(d, 1)),
    st.floats(-10, 10),
    st.floats(-10, 10),
    st.integers(0, 99),
)
@settings(max_examples=30)
def test_any_weights_reproduce_a_rigid_body(ahead, value, slope, seed):
    std = np.random.default_rng(seed).uniform(0.1, 3.0, len(ahead))
    weights = rigid_weights(np.array(ahead), std)
    got = weights @ (value + slope * np.array(ahead))
    np.testing.assert_allclose(got, [value, slope], atol=1e-9)


def test_weights_are_those_of_weighted_least_squares():
    ahead, std = np.array([0.0, -0.35, -0.8, 0.2]), np.array([1.0, 0.5, 2.0, 1.5])
    signal = np.array([1.0, 3.0, -2.0, 0.3])
    slope, value = np.polyfit(ahead, signal, 1, w=1 / std)
    np.testing.assert_allclose(rigid_weights(ahead, std) @ signal, [value, slope], rtol=1e-12)


@pytest.mark.parametrize("name", ["ay_face", "az_face", "ay_mid", "ay_aft"])
@pytest.mark.parametrize("error", [-0.01, 0.01])
def test_one_per_cent_of_gain_is_covered(broad, name, error):
    left, _, std, _ = corrected(recorded(broad, gains={name: 1 + error}))
    assert rms(left / std) < 1.1


def test_half_a_degree_of_misalignment_is_covered(monkeypatch):
    """Both planes at one frequency in phase: each senses the other with a mean."""
    monkeypatch.setitem(rigid_body.TABLE, 2, ("pitch", 9.8, 0.767))
    motion = sines({1: 0.15, 2: 0.15}, duration_s=12.0)
    tilts = {"ay_face": np.radians(0.5), "az_face": np.radians(0.5)}
    record = recorded(motion, tilts=tilts)
    left, _, std, _ = corrected(record, relative_std=1e-5)
    assert rms(left) > 0.002  # what is to be covered
    assert rms(left / std) < 1.6
    _, _, unaware, _ = corrected(record, relative_std=1e-5, misalignment_std=0.0)
    assert rms(left / unaware) > 10


def test_noise_of_the_accelerometers_is_in_the_uncertainty():
    """Four hundred times the usual: the scatter of the residual is what the rows say."""
    motion = rigid_body.sine(1, bias_deg=0.3, duration_s=40.0)
    record, rng = recorded(motion), np.random.default_rng(3)
    for name in ("ay_face", "ay_mid", "ay_aft"):
        samples = record[name].samples + rng.normal(0.0, 2.0, len(record[name]))
        record = changed(record, name, samples=samples)
    left, _, std, _ = corrected(record, relative_std=0.0, misalignment_std=0.0)
    assert rms(left) > 0.001
    assert rms(left) == pytest.approx(float(np.mean(std)), rel=0.3)


def test_clipped_peaks_are_bridged_and_flagged(broad):
    record = recorded(broad, full_scale=2.0 * G)
    clipped = [name for name in record.channels if record[name].clipped.any()]
    assert {"ay_face", "az_face"} <= set(clipped)
    left, _, std, result = corrected(record)
    assert np.all((result.flags & Flag.CLIPPED_CHANNEL)[result.settled] > 0)
    assert rms(left) < 0.001
    assert rms(left / std) < 1.1
    cut = {
        name: dataclasses.replace(each, limits=None) if name != "aoa_unfiltered" else each
        for name, each in record.channels.items()
    }
    unaware, _, _, _ = corrected(AcquisitionRecord("unaware", cut))
    assert rms(unaware) > 5 * rms(left)


def test_missing_samples_are_bridged_and_flagged(record):
    samples = record["ay_face"].samples.copy()
    samples[9600:9610] = np.nan
    left, _, _, result = corrected(changed(record, "ay_face", samples=samples))
    assert rms(left) < 0.0005
    near = np.abs(result.time_s - 12.0) < 2.0
    assert np.all(result.flags[near] & Flag.GAP)
    assert not np.any(result.flags[np.abs(result.time_s - 12.0) > 3.0] & Flag.GAP)


def test_an_accelerometer_that_cannot_be_bridged_is_left_out(record):
    dead = changed(record, "ay_mid", samples=np.full(len(record["ay_mid"]), np.nan))
    left, _, _, result = corrected(dead)
    assert rms(left) < 0.0005
    assert result.why.endswith("; ay_mid left out: too many samples clipped or missing")


def test_too_few_whole_accelerometers_are_refused(record):
    for name in ("ay_mid", "ay_face"):
        record = changed(record, name, samples=np.full(len(record[name]), np.nan))
    message = (
        "rigid-body: too many samples of ay_face and ay_mid are clipped or missing to correct yaw "
        "by kinematics; use another method, or record with a wider range"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        correct(record, setup_of(), method="kinematic")


def test_points_of_rotation_are_measured(broad):
    _, _, _, result = corrected(recorded(sines(SINE_OF_ALL, duration_s=14.0)))
    measured, std = result.settings["measured_radii_m"], result.settings["measured_radii_std_m"]
    for mode in TABLE_1:
        assert measured[mode.number] == pytest.approx(mode.radius_m, abs=0.2 * std[mode.number])
    assert "the model turns" not in result.why


def test_a_radius_that_the_accelerometers_contradict_is_named():
    wrong = (Mode(1, "yaw", 9.8, 0.5), *TABLE_1[1:])
    record = recorded(rigid_body.sine(1, duration_s=12.0))
    left, _, _, result = corrected(record, inertial=setup_of(wrong))
    assert rms(left) < 0.0003
    assert result.why.endswith(
        "; at 9.8 Hz the model turns about a point 0.787 m aft of the package, where mode 1 of "
        "the setup has 0.5 m"
    )


def test_a_plane_that_only_senses_the_other_through_misalignment_is_no_contradiction():
    motion = rigid_body.sine(2, bias_deg=0.2, duration_s=12.0)
    tilts = {"ay_face": 0.01, "ay_mid": -0.01, "ay_aft": 0.01}
    left, _, std, result = corrected(recorded(motion, tilts=tilts))
    assert "contradict" not in result.why
    assert rms(left) < 0.0003
    assert np.mean(std) < 0.005


def test_accelerometers_that_contradict_a_rigid_body_are_named(record):
    wrong = changed(record, "ay_mid", samples=1.5 * record["ay_mid"].samples)
    left, _, std, result = corrected(wrong, method="kinematic")
    assert re.search(r"the yaw accelerometers contradict a rigid body by \d+ times", result.why)
    assert rms(left / std) < 1.5
    left, _, std, result = corrected(wrong)
    assert result.method == "modal"
    assert rms(left / std) < 1.5
    assert re.match(
        r"chosen automatically, since the kinematic correction is certain to 0\.\d+ deg only",
        result.why,
    )


NEEDS_SECOND = (
    "rigid-body: the kinematic correction lacks a second accelerometer along model y (yaw) at "
    "least 0.05 m from ay_face and a second accelerometer along model z (pitch) at least 0.05 m "
    "from az_face"
)


def test_one_accelerometer_a_plane_is_not_enough_and_the_channels_needed_are_named(record):
    lone = without(record, "ay_mid", "ay_aft", "az_mid", "az_aft")
    with pytest.raises(InputError, match=f"^{re.escape(NEEDS_SECOND)}$"):
        correct(lone, setup_of(), method="kinematic")
    assert correct(lone, setup_of()).method == "modal"


def test_two_accelerometers_side_by_side_are_one_station(record):
    close = changed(record, "ay_mid", station_m=0.88)
    close = without(close, "ay_aft")
    message = (
        "rigid-body: the kinematic correction lacks a second accelerometer along model y (yaw) at "
        "least 0.05 m from ay_face"
    )
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        correct(close, setup_of(), method="kinematic")


def test_stations_that_are_not_stated_are_asked_for(record):
    unplaced = changed(changed(record, "ay_mid", station_m=None), "ay_aft", station_m=None)
    message = "rigid-body: the kinematic correction lacks the station of ay_mid and ay_aft"
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        correct(unplaced, setup_of(), method="kinematic")


def test_an_accelerometer_on_another_clock_is_named(record):
    late = changed(without(record, "ay_mid"), "ay_aft", start_s=0.1)
    message = "rigid-body: the kinematic correction lacks ay_aft on the clock of aoa_unfiltered"
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        correct(late, setup_of(), method="kinematic")
