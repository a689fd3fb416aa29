"""Modal correction against rigid-body kinematics; the bias formula makes no data here."""

import re
from dataclasses import replace

import numpy as np
import pytest
import rigid_body

from glint_aoa.errors import InputError
from glint_aoa.flags import Flag
from glint_aoa.inertial import TABLE_1, correct
from glint_aoa.inertial.filters import low_pass
from glint_aoa.inertial.modes import Mode
from glint_aoa.inertial.receptance import fit_receptances
from glint_aoa.inertial.separation import separate
from glint_aoa.inertial.spectrum import PlaneSpectrum, find_peak
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.setup import Inertial

YAW = tuple(mode for mode in TABLE_1 if mode.plane == "yaw")


def setup_of(modes=TABLE_1):
    return Inertial.model_validate(
        {
            "filter": {"kind": "butterworth", "order": 2, "cutoff": "0.4 Hz"},
            "mode": [
                {
                    "number": mode.number,
                    "plane": mode.plane,
                    "frequency": f"{mode.frequency_hz} Hz",
                    "radius": f"{mode.radius_m} m",
                    "radius_std": f"{mode.radius_std_m} m",
                }
                for mode in modes
            ],
        }
    )


def errors(motion, *, pitch_deg=0.0, seed=1, inertial=None, **options):
    """Residual, raw error and std of the settled rows [deg], and the whole correction."""
    rng = np.random.default_rng(seed)
    record = rigid_body.record(motion, pitch_deg=pitch_deg, rng=rng, **options)
    result = correct(record, inertial or setup_of(), method="modal")
    settled = (result.flags & Flag.FILTER_SETTLING) == 0
    assert np.count_nonzero(settled) > 50
    return (
        result.angle_deg[settled] - pitch_deg,
        result.raw_angle_deg[settled] - pitch_deg,
        result.angle_std_deg[settled],
        result,
    )


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("pitch_deg", [0.0, 4.3, 6.0])
@pytest.mark.parametrize(("number", "bias_deg"), [(1, 0.146), (2, 0.175)])
def test_sine_in_a_first_mode(number, bias_deg, pitch_deg):
    motion = rigid_body.sine(number, bias_deg=bias_deg, pitch_deg=pitch_deg, duration_s=12.0)
    left, raw, std, result = errors(motion, pitch_deg=pitch_deg)
    assert raw.mean() == pytest.approx(-bias_deg, rel=0.02)
    assert np.max(np.abs(left)) < 0.0005
    assert result.settings["modes_credited"] == (number,)
    np.testing.assert_allclose(std, 0.01 * bias_deg, rtol=0.05)


@pytest.mark.parametrize(("number", "sign"), [(3, -1), (4, 1), (5, 1), (6, 1)])
def test_sine_in_a_higher_mode(number, sign):
    left, raw, _, _ = errors(rigid_body.sine(number, bias_deg=0.05, pitch_deg=6.0), pitch_deg=6.0)
    assert raw.mean() == pytest.approx(sign * 0.05, rel=0.02)
    assert np.max(np.abs(left)) < 0.002


@pytest.mark.parametrize("number", [1, 2])
def test_sine_modulated_at_a_quarter_hertz(number):
    motion = rigid_body.sine(number, modulation_hz=0.25, duration_s=24.0, pitch_deg=4.3)
    left, raw, _, _ = errors(motion, pitch_deg=4.3)
    assert np.ptp(raw) > 0.1
    assert np.max(np.abs(left)) < 0.0005


def test_a_resonance_off_its_nominal_frequency_is_found():
    left, _, _, result = errors(rigid_body.sine(1, frequency_hz=8.8))
    assert result.settings["mode_frequencies_hz"][1] == pytest.approx(8.8, abs=0.05)
    assert np.max(np.abs(left)) < 0.0005


def test_sines_in_all_modes_of_a_plane_together():
    motion = rigid_body.together(
        rigid_body.sine(1), rigid_body.sine(3, bias_deg=0.02), rigid_body.sine(5, bias_deg=0.05)
    )
    left, _, _, result = errors(motion, pitch_deg=4.3)
    assert result.settings["modes_credited"] == (1, 3, 5)
    assert np.max(np.abs(left)) < 0.002


NEIGHBOURS = rigid_body.sine(1, frequency_hz=19.5, bias_deg=0.0125)
"""Mode 1's shape driven at mode 3's 19.5 Hz: by mode 3's radius a turning of several deg."""


def test_a_neighbours_motion_at_the_frequency_of_a_small_radius_is_told_by_the_second_harmonic():
    left, raw, std, result = errors(NEIGHBOURS)
    assert raw.mean() == pytest.approx(-0.0125, rel=0.02)
    assert np.max(np.abs(left)) < 0.0005
    assert (np.abs(left) < std).all()
    assert result.settings["shown_fractions"] == {3: pytest.approx(0.18 / 31.0, rel=0.02)}
    assert result.why.endswith(
        "the package's second harmonic denies the radius of mode 3, what it shows was taken"
    )


def test_without_a_second_harmonic_such_a_motion_is_not_believed():
    record = rigid_body.record(NEIGHBOURS, rng=np.random.default_rng(1))
    low_passed = low_pass(record["aoa_unfiltered"].samples, 800.0, setup_of().filter, causal=True)
    package = replace(record["aoa_unfiltered"], samples=low_passed, quantity="aoa_filtered")
    whole = AcquisitionRecord("record", {**record.channels, "aoa_unfiltered": package})
    result = correct(whole, setup_of(), method="modal")
    np.testing.assert_allclose(result.angle_deg, result.raw_angle_deg, atol=1e-5)
    assert result.settings["modes_credited"] == ()
    assert (result.flags[result.settled] & Flag.UNCERTAIN_CORRECTION).all()


@pytest.mark.parametrize("number", [3, 5])
def test_a_sine_that_the_survey_does_not_explain_is_never_made_worse(number):
    """The shapes of modes 1 and 5 (or 3) together, in quadrature, at the frequency of one."""
    frequency = rigid_body.TABLE[number][1]
    motion = rigid_body.together(
        rigid_body.sine(1, frequency_hz=frequency, bias_deg=0.006),
        rigid_body.sine(number, bias_deg=0.003, phase=0.4 + np.pi / 2),
    )
    left, raw, std, _ = errors(motion)
    assert rms(left) <= rms(raw)
    assert rms(left) < 2 * rms(std)


def test_a_dead_accelerometer_moves_nothing():
    record = rigid_body.record(rigid_body.sine(1), pitch_deg=0.0, rng=np.random.default_rng(3))
    dead = {
        name: replace(channel, samples=np.zeros(len(channel)))
        for name, channel in record.channels.items()
        if channel.axis in {"+z", "-z"}
    }
    assert dead
    whole = AcquisitionRecord("record", {**record.channels, **dead})
    result = correct(whole, setup_of(), method="modal")
    assert result.settings["modes_credited"] == (1,)
    assert np.abs(result.angle_deg[len(result.angle_deg) // 2]) < 0.001


def test_shaker_off_credits_nothing():
    left, _, std, result = errors(rigid_body.sine(1, bias_deg=0.0), pitch_deg=4.3)
    assert result.settings["modes_credited"] == ()
    assert np.max(np.abs(left)) < 0.0003
    assert np.max(std) < 0.0003
    assert result.why.endswith("no mode stands out")


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("common_force", [True, False])
@pytest.mark.parametrize(
    "rates", [{2: 0.18, 4: 0.18, 6: 0.18}, {1: 0.18, 3: 0.18, 5: 0.18}, {1: 0.25, 3: 0.1, 5: 0.05}]
)
def test_random_excitation_is_improved_and_covered(rates, common_force, seed):
    motion = rigid_body.random(
        rates, rng=np.random.default_rng(seed), common_force=common_force, duration_s=40.0
    )
    left, raw, std, _ = errors(motion, seed=9)
    assert abs(raw.mean()) > 0.08
    assert abs(left.mean()) < 0.1 * abs(raw.mean())
    assert rms(left) < 0.008
    assert rms(left / std) < 1.5


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_small_radius_under_one_force_does_not_let_its_neighbour_leak(seed):
    motion = rigid_body.random(
        {1: 0.15, 3: 0.6, 5: 0.2}, rng=np.random.default_rng(seed), duration_s=40.0
    )
    left, raw, std, result = errors(motion, seed=9)
    assert "receptances" in result.settings["separation"]
    assert rms(left) < 0.1 * rms(raw)
    assert rms(left / std) < 1.5


def test_a_modes_share_of_the_skirt_of_another_is_bounded():
    """An ordinary band-pass around mode 3 would credit it with all the power there."""
    motion = rigid_body.random({1: 0.18}, rng=np.random.default_rng(4), duration_s=40.0)
    record = rigid_body.record(motion, rng=np.random.default_rng(4))
    spectrum = PlaneSpectrum.of(record["ay_face"].samples, 800.0, YAW)
    shares = separate(spectrum, YAW)
    assert [share.credited for share in shares] == [True, False, False]
    assert np.max(shares[1].power) == 0.0
    assert np.all(sum(share.power for share in shares) <= 1 + 1e-9)


def test_shares_of_all_modes_and_the_floor_add_up_to_one():
    motion = rigid_body.random({1: 0.2, 5: 0.2}, rng=np.random.default_rng(5), common_force=False)
    record = rigid_body.record(motion, rng=np.random.default_rng(5))
    shares = separate(PlaneSpectrum.of(record["ay_face"].samples, 800.0, YAW), YAW)
    total = sum(share.power for share in shares)
    assert np.all(total <= 1 + 1e-9)
    assert np.median(total) > 0.99


def test_receptances_of_one_force_are_found():
    rates = {2: 0.2, 4: 0.3, 6: 0.2}
    motion = rigid_body.random(rates, rng=np.random.default_rng(6), duration_s=60.0, damping=0.015)
    record = rigid_body.record(motion, rng=np.random.default_rng(6))
    modes = tuple(mode for mode in TABLE_1 if mode.plane == "pitch")
    spectrum = PlaneSpectrum.of(record["az_face"].samples, 800.0, modes)
    inside = (spectrum.bins_hz > 6.5) & (spectrum.bins_hz < 51)
    found = fit_receptances(
        spectrum.bins_hz[inside], spectrum.power[inside], spectrum.averages, spectrum.peaks_hz
    )
    assert found is not None
    np.testing.assert_allclose(found.frequency_hz, [9.2, 20.3, 34.2], rtol=0.01)
    np.testing.assert_allclose(found.damping, 0.015, atol=0.006)
    assert len(set(np.sign(found.strength[1:]))) == 1  # both radii are negative
    assert np.sign(found.strength[0]) != np.sign(found.strength[1])
    whole = sum(found.fraction(i, np.array([9.2, 34.2])) for i in range(3))
    np.testing.assert_allclose(np.abs(whole), 1.0, atol=0.05)


def a_draw(seed):
    """All six modes in both planes, levels over a decade, one force a plane or one a mode."""
    rng = np.random.default_rng([20, seed])
    rates = {n: 0.18 * 10 ** rng.uniform(-1.0, 0.1) for n in (1, 2)}
    rates |= {n: rates[2 - n % 2] * 10 ** rng.uniform(-1.0, 0.3) for n in (3, 4, 5, 6)}
    motion = rigid_body.random(
        rates,
        rng=rng,
        duration_s=16.0,
        damping=float(rng.uniform(0.005, 0.025)),
        common_force=bool(seed % 2),
    )
    return motion, float(rng.choice([0.0, 4.3, 6.0]))


@pytest.mark.parametrize("seed", range(6))
def test_six_modes_under_random_excitation_are_improved_never_worsened(seed):
    motion, pitch_deg = a_draw(seed)
    left, raw, std, result = errors(motion, pitch_deg=pitch_deg, seed=seed)
    assert rms(left) < 0.5 * rms(raw)
    assert rms(left / std) < 1.5
    assert result.settings["unlisted_hz"] == ()


@pytest.mark.parametrize("seed", [1, 2])
def test_a_resonance_that_the_survey_does_not_list_is_named_and_counts(seed, monkeypatch):
    monkeypatch.setitem(rigid_body.TABLE, 7, ("pitch", 14.0, 0.5))
    rng = np.random.default_rng(seed)
    motion = rigid_body.random({2: 0.15, 6: 0.03, 7: 0.12}, rng=rng, common_force=False)
    left, raw, std, result = errors(motion, seed=seed)
    assert rms(left) < rms(raw)
    assert rms(left / std) < 2
    assert result.settings["unlisted_hz"] == pytest.approx([14.0], abs=0.5)
    assert re.search(r"; no mode lists 1[34]\.?\d* Hz$", result.why)


def test_the_uncertainty_of_a_radius_is_that_of_its_bias():
    uncertain = replace(TABLE_1[0], radius_std_m=0.02 * TABLE_1[0].radius_m)
    _, raw, std, _ = errors(rigid_body.sine(1, duration_s=8.0), inertial=setup_of([uncertain]))
    np.testing.assert_allclose(std, np.hypot(0.01, 0.02) * abs(raw.mean()), rtol=0.05)


def test_an_accelerometer_ahead_of_the_package_is_carried_back():
    left, _, _, _ = errors(rigid_body.sine(1), station_m=1.0)
    assert np.max(np.abs(left)) < 0.0005


def test_an_accelerometer_on_the_point_of_rotation_is_refused():
    record = rigid_body.record(
        rigid_body.sine(3, bias_deg=0.02, duration_s=8.0), station_m=0.9 - 0.18 * 0.0254
    )
    message = (
        "inertial.mode 3: its point of rotation lies within 1 mm of the accelerometer, "
        "which cannot see it; use another station or leave the mode out"
    )
    with pytest.raises(InputError, match=re.escape(message)):
        correct(record, setup_of())


def test_a_mode_beyond_the_sampling_rate_is_refused():
    record = rigid_body.record(rigid_body.sine(1, duration_s=8.0))
    message = (
        "inertial.mode 9: 390 Hz is too high for 800 samples a second; "
        "leave the mode out or record faster"
    )
    with pytest.raises(InputError, match=re.escape(message)):
        correct(record, setup_of((Mode(9, "yaw", 390.0, 0.5),)))


def test_a_peak_is_refined_between_bins():
    bins = np.arange(100) * 0.25
    power = np.exp(-(((bins - 9.61) / 0.3) ** 2)) + 1e-6
    assert find_peak(bins, power, 9.8, low_hz=8.3, high_hz=11.3) == pytest.approx(9.61, abs=1e-3)


@pytest.mark.parametrize("power", [np.arange(100, 0, -1.0), np.ones(100)])
def test_without_a_peak_the_nominal_frequency_stands(power):
    bins = np.arange(100) * 0.25
    assert find_peak(bins, power, 9.8, low_hz=8.3, high_hz=11.3) == 9.8
    assert find_peak(bins, power, 9.8, low_hz=9.81, high_hz=9.82) == 9.8
