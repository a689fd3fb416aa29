import re
from dataclasses import replace

import numpy as np
import pytest
import rigid_body

from glint_aoa.errors import RecordingError
from glint_aoa.inertial import correct
from glint_aoa.inertial.channels import package_output
from glint_aoa.inertial.package import calibrated_output
from glint_aoa.inertial.sensor import SensorModel
from glint_aoa.inertial.static import static_angle
from glint_aoa.records.acquisition import Channel
from glint_aoa.setup import Inertial

SENSOR = {
    "scale": 1.01,
    "bias": "0.02 m/s^2",
    "misalignment": "0.3 deg",
    "scale_per_kelvin": "1e-4 1/K",
    "bias_per_kelvin": "1e-4 m/s^2/K",
    "temperature": "300 K",
}
INERTIAL = Inertial.model_validate({"sensor": SENSOR})


def record(angle_deg=4.3, *, kelvin=310.0, units="K", readings=None):
    time = np.arange(8000) / 800.0
    force = SensorModel.from_setup(INERTIAL).indicated(np.radians(angle_deg), temperature=kelvin)
    made = rigid_body.record(rigid_body.sine(1, bias_deg=0.0, duration_s=10.0))
    package = replace(made["aoa_unfiltered"], samples=np.full(time.size, float(force)))
    readings = [kelvin] if readings is None else readings
    thermometer = Channel("warm", np.array(readings), 1.0, quantity="temperature", units=units)
    return replace(made, channels={**made.channels, "aoa_unfiltered": package, "warm": thermometer})


@pytest.mark.parametrize(
    ("units", "readings"),
    [("K", [309.0, 311.0]), ("degC", [36.85]), ("degF", [98.33, np.nan])],
)
def test_the_package_of_the_setup_gives_the_true_angle(units, readings):
    angle, _ = static_angle(record(units=units, readings=readings), INERTIAL)
    assert angle == pytest.approx(4.3, abs=1e-6)


def test_without_a_thermometer_the_reference_holds():
    made = record(kelvin=300.0)
    made = replace(made, channels={k: v for k, v in made.channels.items() if k != "warm"})
    assert static_angle(made, INERTIAL)[0] == pytest.approx(4.3, abs=1e-9)


def test_an_ideal_package_is_left_as_recorded():
    made = record()
    package = calibrated_output(made, Inertial())
    np.testing.assert_array_equal(package.specific_force, package_output(made).specific_force)


def test_corrections_start_from_it():
    result = correct(record(), INERTIAL, method="harmonic")
    np.testing.assert_allclose(result.angle_deg, 4.3, atol=1e-6)


def test_a_temperature_in_volts_is_refused():
    message = (
        "channel warm: 'V' cannot be turned into 'K'; correct units in the record or the setup"
    )
    with pytest.raises(RecordingError, match=re.escape(message)):
        calibrated_output(record(units="V"), INERTIAL)
