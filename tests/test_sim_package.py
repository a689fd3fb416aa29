import numpy as np
import pytest

from glint_aoa.setup import InertialFilter
from render_sim.package import InertialPackage, package_outputs

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
