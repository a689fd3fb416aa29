import numpy as np
import pytest

from glint_aoa.inertial.sensor import SensorModel
from glint_aoa.setup import InertialFilter
from render_sim.package import InertialPackage, package_outputs, sensed_force

G = 9.80665
RATE = 6400.0


def test_still_model_indicates_its_angle_at_both_outputs():
    rest = G * np.sin(np.deg2rad(4.3))
    outputs = package_outputs(np.full(100, rest), rest_force=rest, rate_hz=RATE)
    for output in (outputs.unfiltered, outputs.filtered):
        np.testing.assert_allclose(np.rad2deg(np.arcsin(output)), 4.3, rtol=1e-14)


@pytest.mark.parametrize("kind", ["butterworth", "bessel"])
def test_filtered_output_is_3_db_down_at_its_cutoff(kind):
    low_pass = InertialFilter.model_validate({"kind": kind, "order": 2, "cutoff": "0.4 Hz"})
    time = np.arange(round(40 * RATE)) / RATE
    tone = np.sin(2 * np.pi * 0.4 * time)
    package = InertialPackage(filter=low_pass)
    outputs = package_outputs(G * tone, rest_force=0.0, rate_hz=RATE, package=package)
    settled = outputs.filtered[round(20 * RATE) :]
    assert np.ptp(settled) / 2 == pytest.approx(np.sqrt(0.5), rel=1e-3)


def test_unfiltered_output_passes_to_300_hz():
    time = np.arange(round(2 * RATE)) / RATE
    for hertz, gain in ((20.0, 1.0), (300.0, np.sqrt(0.5))):
        tone = G * np.sin(2 * np.pi * hertz * time)
        outputs = package_outputs(tone, rest_force=0.0, rate_hz=RATE)
        assert np.sqrt(2) * outputs.unfiltered[6400:].std() == pytest.approx(gain, rel=1e-3)


@pytest.mark.parametrize("cutoff", ["0.4 Hz", "1 Hz"])
def test_filter_forgets_its_start_within_the_settling_time(cutoff):
    package = InertialPackage(filter=InertialFilter.model_validate({"cutoff": cutoff}))
    samples = round(package.settling_s * RATE)
    outputs = package_outputs(np.ones(samples + 1), rest_force=0.0, rate_hz=RATE, package=package)
    assert outputs.filtered[-1] * G == pytest.approx(1.0, abs=2e-6)


def test_filter_is_causal():
    pulse = np.zeros(2000)
    pulse[1000] = 1.0
    outputs = package_outputs(pulse, rest_force=0.0, rate_hz=RATE)
    assert not outputs.filtered[:1000].any()
    assert not outputs.unfiltered[:1000].any()


WRONG = InertialPackage.model_validate(
    {
        "scale": 1.003,
        "bias": "-2e-3 g_0",
        "misalignment": "0.2 deg",
        "scale_per_kelvin": "2e-5 / K",
        "bias_per_kelvin": "1e-5 g_0 / K",
        "reference_temperature": "344 K",
        "temperature": "350 K",
    }
)


def _at_rest(pitch_rad):
    return G * np.stack([np.sin(pitch_rad), np.zeros_like(pitch_rad), np.cos(pitch_rad)], axis=-1)


def test_an_ideal_package_senses_the_axial_force_to_the_bit():
    force = np.random.default_rng(4).normal(0, 20, (100, 3))
    sensed = sensed_force(force, InertialPackage(), temperature_k=300.0)
    np.testing.assert_array_equal(sensed, force[:, 0])


def test_errors_at_rest_follow_the_closed_form():
    pitch = np.deg2rad(np.linspace(-6, 6, 13))
    sensed = sensed_force(_at_rest(pitch), WRONG, temperature_k=350.0)
    scale, bias = 1.003 + 6 * 2e-5, (-2e-3 + 6 * 1e-5) * G
    expected = scale * G * np.sin(pitch + np.deg2rad(0.2)) + bias
    np.testing.assert_allclose(sensed, expected, rtol=0, atol=1e-12)


def test_the_setups_sensor_takes_these_errors_out():
    """Two programs that know nothing of each other: the simulated errors, and the correction."""
    model = SensorModel(
        scale=1.003,
        bias=-2e-3 * G,
        misalignment=np.deg2rad(0.2),
        scale_per_kelvin=2e-5,
        bias_per_kelvin=1e-5 * G,
        temperature=344.0,
    )
    pitch = np.deg2rad(np.linspace(-6, 6, 13))
    sensed = sensed_force(_at_rest(pitch), WRONG, temperature_k=350.0)
    np.testing.assert_allclose(model.angle(sensed, temperature=350.0), pitch, rtol=0, atol=1e-12)


def test_a_turned_axis_and_crosstalk_sense_across():
    turned = InertialPackage.model_validate({"side_misalignment": "1 deg"})
    leaky = InertialPackage(cross_axis=(0.01, -0.02))
    across = np.eye(3)
    one, sine = 1.0, np.sin(np.deg2rad(1))
    for package, expected in (
        (turned, [np.cos(np.deg2rad(1)), sine, 0.0]),
        (leaky, [one, 0.01, -0.02]),
    ):
        sensed = sensed_force(across, package, temperature_k=300.0)
        np.testing.assert_allclose(sensed, expected, rtol=0, atol=1e-15)


def test_a_package_warms_with_the_campaign_and_within_a_record():
    package = InertialPackage.model_validate({"temperature": "340 K", "warming": "3 K / minute"})
    later = package.later(120.0)
    np.testing.assert_allclose(later.temperature_at(np.array([0.0, 20.0])), [346.0, 347.0])
    steady = InertialPackage.model_validate({"warming": "3 K / minute"}).later(120.0)
    np.testing.assert_allclose(steady.temperature_at(np.array([0.0, 20.0])), 344.261)
