import re
from dataclasses import replace

import numpy as np
import pytest

from render_sim.acquisition import Recording, acquire, balance_loads
from render_sim.excitation import Tones
from render_sim.instruments import SensorErrors
from render_sim.kinematics import body_kinematics
from render_sim.modal_motion import ModalMotion
from render_sim.modes import balance_moment, joint_angles, modal_angles, paper_model_system
from render_sim.motion import StaticMotion, rigid
from render_sim.package import InertialPackage
from render_sim.scene import paper_scene

G = 9.80665
IN_LB = 0.1129848290276167
SYSTEM = paper_model_system()
SHORT = Recording(duration_s=1.0)
DAS = [
    "aoa_unfiltered",
    "aoa_filtered",
    "ay_face",
    "az_face",
    "normal_force",
    "axial_force",
    "pitch_moment",
    "roll_moment",
    "yaw_moment",
    "side_force",
    "shaker",
    "aux_aoa",
]
ALPHA = np.deg2rad(4.3)
STATIC = StaticMotion(paper_scene(), ALPHA)


def _rng():
    return np.random.default_rng(3)


def _driven(plane, frequency_hz, moment_in_lb):
    force = Tones(np.array([frequency_hz]), np.array([1.0 + 0j]))
    moment = balance_moment(SYSTEM, force, modal_angles(SYSTEM, force, plane), plane)
    force = force.scaled(moment_in_lb * IN_LB / (2 * abs(moment.amplitude[0])))
    return force, ModalMotion(STATIC, SYSTEM, modal_angles(SYSTEM, force, plane))


@pytest.fixture(scope="module")
def still():
    return acquire(SYSTEM, STATIC, STATIC, recording=SHORT, rng=_rng())


@pytest.fixture(scope="module")
def yawing():
    force, motion = _driven("yaw", 9.8, 5000)
    return acquire(SYSTEM, motion, STATIC, forces={"yaw": force}, recording=SHORT, rng=_rng())


def test_twelve_channels_then_sixteen_of_the_analyser(still):
    names = list(still.channels)
    assert names[:12] == DAS
    assert len(names) == 28
    assert all(name.startswith("analyser_") for name in names[12:])
    quantities = [still.channels[name].quantity for name in names[12:]]
    assert quantities.count("acceleration") == 6
    assert quantities.count("force") + quantities.count("moment") == 6


def test_each_plane_has_three_accelerometers_at_different_stations(still):
    for axis in ("+y", "+z"):
        stations = {
            c.station_m
            for c in still.channels.values()
            if c.quantity == "acceleration" and c.axis == axis
        }
        assert stations == {0.9, 0.55, 0.1}


def test_channels_are_16_bits_at_800_hz_from_the_trigger_and_describe_themselves(still):
    for name, channel in still.channels.items():
        assert channel.samples.dtype == np.int16
        assert (channel.rate_hz, channel.start_s, len(channel)) == (800.0, 0.0, 800)
        assert channel.units is not None
        assert channel.limits is not None
        if name != "aux_aoa":
            assert channel.quantity is not None
            assert channel.station_m is not None
        if channel.quantity not in ("excitation", None):
            assert channel.axis is not None


def test_filtered_output_resolves_a_thousandth_of_a_degree(still):
    channel = still.channels["aoa_filtered"]
    assert np.rad2deg(channel.scale) < 0.001
    assert channel.limits[1] > np.sin(np.deg2rad(20))


def test_still_model_reads_its_angle_gravity_and_no_load(still):
    values = {name: c.samples * c.scale for name, c in still.channels.items()}
    for name in ("aoa_unfiltered", "aoa_filtered"):
        angle = np.rad2deg(np.arcsin(values[name].mean()))
        assert angle == pytest.approx(4.3, abs=5e-4)
    assert values["az_face"].mean() == pytest.approx(G * np.cos(ALPHA), abs=1e-3)
    assert values["ay_face"].mean() == pytest.approx(0, abs=1e-3)
    assert values["aux_aoa"].mean() == pytest.approx(4.3, abs=2e-3)
    for name in ("normal_force", "axial_force", "pitch_moment", "yaw_moment", "side_force"):
        assert values[name].mean() == pytest.approx(0, abs=0.05)


def test_accelerometer_noise_is_half_a_milli_g(still):
    channel = still.channels["ay_face"]
    expected = np.hypot(0.5e-3 * G, channel.scale / np.sqrt(12))
    assert (channel.samples * channel.scale).std() == pytest.approx(expected, rel=0.1)


def test_truth_of_a_still_model_has_no_bias(still):
    np.testing.assert_allclose(still.truth["static_pitch_deg"], np.full(800, 4.3), rtol=1e-12)
    np.testing.assert_allclose(still.truth["bias_deg"], 0, atol=1e-9)


def test_moment_is_the_level_asked_for(yawing):
    moment = yawing.channels["yaw_moment"].values("in*lbf")
    assert np.ptp(moment) == pytest.approx(5000, rel=2e-3)
    nodding = np.ptp(yawing.channels["pitch_moment"].values("in*lbf"))
    assert nodding == pytest.approx(0.08 * 5000, rel=0.05)  # the mode's turn out of its plane


def test_bias_is_the_centrifugal_one_and_the_filtered_output_shows_it(yawing):
    mode = SYSTEM.modes_in("yaw")[0]
    speed = np.ptp(yawing.channels["ay_face"].values("m/s^2")) / 2 / (2 * np.pi * 9.8)
    expected = np.rad2deg(-(speed**2) / (2 * mode.radius * G * np.cos(ALPHA)))
    bias = yawing.truth["bias_deg"]
    assert bias.mean() == pytest.approx(expected, rel=0.01)
    channel = yawing.channels["aoa_filtered"]
    indicated = np.rad2deg(np.arcsin(channel.values("g_0")))
    np.testing.assert_allclose(indicated - 4.3, bias, rtol=0, atol=0.002)


def test_samples_lie_at_their_times(yawing):
    """The band limit's delay is taken out: each sample is the kinematics at its own time."""
    _, motion = _driven("yaw", 9.8, 5000)
    exact = body_kinematics(motion, start_s=0.0, samples=6400, rate_hz=6400)
    channel = yawing.channels["analyser_ay_mid"]
    np.testing.assert_allclose(
        channel.values("m/s^2"), exact.specific_force(0.55)[::8, 1], rtol=0, atol=0.03
    )


def test_record_may_start_before_the_trigger(yawing):
    force, motion = _driven("yaw", 9.8, 5000)
    early = Recording(duration_s=1.0, start_s=-0.5)
    record = acquire(SYSTEM, motion, STATIC, forces={"yaw": force}, recording=early, rng=_rng())
    later = yawing.channels["ay_face"].values("m/s^2")[:400]
    channel = record.channels["ay_face"]
    assert channel.start_s == -0.5
    np.testing.assert_allclose(channel.values("m/s^2")[400:], later, rtol=0, atol=0.04)


def test_bias_has_settled_when_the_record_starts(yawing):
    assert np.ptp(yawing.truth["bias_deg"]) < 1e-3
    assert InertialPackage().settling_s >= 6


def test_accelerations_beyond_the_range_are_clipped_at_the_limits():
    force, motion = _driven("yaw", 9.8, 40_000)
    record = acquire(SYSTEM, motion, STATIC, forces={"yaw": force}, recording=SHORT, rng=_rng())
    channel = record.channels["ay_face"]
    assert channel.clipped.any()
    assert not channel.clipped.all()
    assert channel.values("m/s^2").max() == channel.limits[1]
    assert not record.channels["analyser_ay_mid"].clipped.any()


def test_same_seed_same_counts(still):
    again = acquire(SYSTEM, STATIC, STATIC, recording=SHORT, rng=_rng())
    other = acquire(SYSTEM, STATIC, STATIC, recording=SHORT, rng=np.random.default_rng(4))
    for name, channel in still.channels.items():
        assert np.array_equal(channel.samples, again.channels[name].samples)
    assert not np.array_equal(still.channels["ay_face"].samples, other.channels["ay_face"].samples)


def test_both_systems_hear_the_same_sensor(still):
    das, analyser = still.channels["az_face"], still.channels["analyser_az_face"]
    assert np.array_equal(das.samples, analyser.samples)


def test_balance_loads_are_the_rate_of_momentum_in_the_tunnel():
    """Independent route: differentiate linear and angular momentum of the model's mass points."""
    system = SYSTEM.model_copy(update={"roll_inertia": 0.0, "yaw_inertia": 10.2})
    motion = ModalMotion(STATIC, system, modal_angles(system, _tones(), "yaw"))
    rate, samples = 6400, 641
    body = body_kinematics(motion, start_s=0.0, samples=samples, rate_hz=rate)
    up = STATIC.pose(np.zeros(()))[2, :3]
    loads = balance_loads(system, body, rest_up=up, push=np.zeros((samples, 3)))
    # a dumb-bell on the axis has the same mass, centre and transverse inertia
    arm = np.sqrt(10.2 / 75)
    pose = motion.pose((np.arange(-2, samples + 2)) / rate)
    masses = [
        (37.5, pose[:, :3, 0] * station + pose[:, :3, 3]) for station in (0.334 - arm, 0.334 + arm)
    ]
    forces, moments = np.zeros((2, samples, 3))
    center = pose[2:-2, :3, 3]
    for mass, point in masses:
        fourth = -point[4:] + 16 * point[3:-1] - 30 * point[2:-2] + 16 * point[1:-3] - point[:-4]
        force = -mass * (fourth * rate**2 / 12 + [0, 0, G])
        forces += force
        moments += np.cross(point[2:-2] - center, force)
    forces, moments = (np.einsum("nji,nj->ni", body.rotation, each) for each in (forces, moments))
    tare = 75 * G * up
    np.testing.assert_allclose(loads["side_force"], (forces + tare)[:, 1], rtol=0, atol=1e-3)
    np.testing.assert_allclose(loads["normal_force"], (forces + tare)[:, 2], rtol=0, atol=1e-3)
    np.testing.assert_allclose(loads["axial_force"], -(forces + tare)[:, 0], rtol=0, atol=1e-3)
    tared = moments + np.cross([0.334, 0, 0], tare)
    np.testing.assert_allclose(loads["yaw_moment"], tared[:, 2], rtol=0, atol=1e-3)
    np.testing.assert_allclose(loads["pitch_moment"], -tared[:, 1], rtol=0, atol=1e-3)
    assert np.abs(loads["yaw_moment"]).max() > 100


def _tones():
    return Tones(np.array([9.8, 19.5]), np.array([8.0, 50.0j]))


def test_shaker_channel_tells_the_plane():
    force, motion = _driven("pitch", 9.2, 2000)
    brief = replace(SHORT, duration_s=0.5)
    record = acquire(SYSTEM, motion, STATIC, forces={"pitch": force}, recording=brief, rng=_rng())
    channels = record.channels
    assert channels["shaker"].axis == "+z"
    drive = np.ptp(channels["analyser_force_z"].values("N"))
    assert drive == pytest.approx(2 * abs(force.amplitude[0]), rel=0.05)
    assert np.ptp(channels["analyser_force_y"].values("N")) < 2
    up, push = channels["pitch_moment"].values("N*m"), channels["az_face"].values("m/s^2")
    assert np.corrcoef(up, push)[0, 1] < -0.99  # inertia: the balance feels the model lag


class _Shaken:
    """A level model that moves to and fro along its axes, `sway` [axis] m at `hertz`."""

    def __init__(self, sway, hertz):
        self.sway, self.hertz = np.asarray(sway), hertz

    def pose(self, time_s):
        moved = STATIC.pose(time_s)
        to_fro = np.sin(2 * np.pi * self.hertz * np.asarray(time_s))
        return moved @ rigid(np.eye(3), to_fro[..., None] * self.sway)


def _felt(hertz, acceleration):
    """Record of a tone along all axes [m/s^2]."""
    sway = acceleration / (2 * np.pi * hertz) ** 2
    motion = _Shaken([sway, sway, sway], hertz)
    return acquire(SYSTEM, motion, STATIC, recording=SHORT, rng=_rng()).channels


@pytest.mark.parametrize("hertz", [500.0, 510.0, 790.0, 1200.0])
def test_what_lies_above_the_band_does_not_alias(still, hertz):
    """120 m/s^2 beyond 500 Hz leave each channel as quiet as it is at rest."""
    channels = _felt(hertz, 120.0)
    for name in ("analyser_ay_mid", "analyser_az_aft", "aoa_unfiltered"):
        quiet, heard = (
            (each[name].samples * each[name].scale).std() for each in (still.channels, channels)
        )
        assert heard < 1.2 * quiet


@pytest.mark.parametrize("hertz", [410.0, 450.0, 490.0])
def test_between_400_and_500_hz_it_is_folded_to_above_300(still, hertz):
    values = _felt(hertz, 120.0)["analyser_ay_mid"].values("m/s^2")
    spectrum = np.abs(np.fft.rfft(values * np.hanning(values.size)))
    frequency = np.fft.rfftfreq(values.size, 1 / 800)
    quiet = still.channels["analyser_ay_mid"].values("m/s^2")
    floor = np.abs(np.fft.rfft((quiet - quiet.mean()) * np.hanning(quiet.size)))
    within = (frequency > 5) & (frequency < 300)
    assert spectrum[within].max() < 1.5 * floor[within].max()


@pytest.mark.parametrize("hertz", [20.0, 150.0, 290.0])
def test_the_band_is_passed_whole(hertz):
    values = _felt(hertz, 50.0)["analyser_ay_mid"].values("m/s^2")
    assert values.std() * np.sqrt(2) == pytest.approx(50.0, rel=1e-3)


def _errors(**said):
    return SensorErrors.model_validate(said)


def test_errors_of_one_sensor_stay_its_own(yawing):
    force, motion = _driven("yaw", 9.8, 5000)
    recording = replace(
        SHORT,
        errors=(
            _errors(name="ay_face", scale_error=0.01, offset="0.5 m/s^2"),
            _errors(name="yaw_moment", noise="3 N*m"),
            _errors(name="az_mid", range="10 m/s^2"),
        ),
    )
    record = acquire(
        SYSTEM, motion, STATIC, forces={"yaw": force}, recording=recording, rng=_rng()
    ).channels
    changed = {
        name
        for name, channel in record.items()
        if not np.array_equal(channel.samples, yawing.channels[name].samples)
    }
    touched = {"ay_face", "yaw_moment"}
    assert changed == touched | {f"analyser_{each}" for each in (*touched, "az_mid")}
    usual = yawing.channels["ay_face"].values("m/s^2")
    np.testing.assert_allclose(
        record["ay_face"].values("m/s^2"), 1.01 * usual + 0.5, rtol=0, atol=0.01
    )
    noisier, usual = (each["yaw_moment"].values("N*m") for each in (record, yawing.channels))
    added = noisier - usual
    assert added.std() == pytest.approx(3, rel=0.1)
    assert record["analyser_az_mid"].limits == pytest.approx((-10, 10))


def test_a_channel_clips_at_both_limits_that_it_states():
    force, motion = _driven("yaw", 9.8, 5000)
    recording = replace(SHORT, errors=(_errors(name="ay_face", range="8 m/s^2"),))
    channel = acquire(
        SYSTEM, motion, STATIC, forces={"yaw": force}, recording=recording, rng=_rng()
    ).channels["ay_face"]
    values = channel.values("m/s^2")
    assert (values.min(), values.max()) == channel.limits == pytest.approx((-8, 8))
    at_limit = np.isclose(np.abs(values), 8)
    np.testing.assert_array_equal(channel.clipped, at_limit)


def test_the_packages_errors_change_its_outputs_and_nothing_else(yawing):
    force, motion = _driven("yaw", 9.8, 5000)
    package = InertialPackage.model_validate({"scale": 1.01, "temperature": "344.261 K"})
    acquired = acquire(
        SYSTEM,
        motion,
        STATIC,
        forces={"yaw": force},
        recording=replace(SHORT, package=package),
        rng=_rng(),
    )
    for name, usual in yawing.channels.items():
        samples = acquired.channels[name].samples
        assert np.array_equal(samples, usual.samples) == ("aoa" not in name or name == "aux_aoa")
    for name, usual in yawing.truth.items():
        np.testing.assert_array_equal(acquired.truth[name], usual)
    scaled, usual = (
        each.channels["aoa_filtered"].values("g_0").mean() for each in (acquired, yawing)
    )
    assert scaled / usual == pytest.approx(1.01, abs=1e-5)
    temperature = acquired.channels["package_temperature"]
    assert (temperature.quantity, temperature.units) == ("temperature", "K")
    assert temperature.values("K").mean() == pytest.approx(344.261, abs=0.005)
    assert list(acquired.channels)[:28] == list(yawing.channels)


def test_two_shakers_have_a_force_channel_each_and_the_first_the_shakers():
    forces = {"pitch": Tones(np.array([9.2]), np.array([30.0])), "yaw": _tones()}
    motion = ModalMotion(STATIC, SYSTEM, joint_angles(SYSTEM, forces))
    record = acquire(SYSTEM, motion, STATIC, forces=forces, recording=SHORT, rng=_rng()).channels
    time = record["shaker"].time_s
    for name, force in (("force_z", forces["pitch"]), ("force_y", forces["yaw"])):
        np.testing.assert_allclose(
            record[f"analyser_{name}"].values("N"), force.at(time), rtol=0, atol=0.15
        )
    assert record["shaker"].axis == "+z"
    np.testing.assert_allclose(
        record["shaker"].values("V"), forces["pitch"].at(time) / 100, rtol=0, atol=0.01
    )


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"name": "az_nose"}, "no sensor is called az_nose; choose one of aoa_unfiltered, "),
        ({"name": "ay_face", "range": "0 g_0"}, "range of 0 g_0 must be greater than zero"),
        ({"name": "ay_face", "noise": "5 N"}, "'5 N' is not a quantity in m/s^2"),
        ({"name": "ay_face", "offset": "inf g_0"}, "offset of inf g_0 is not a finite value"),
    ],
)
def test_errors_of_what_is_not_there(said, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        _errors(**said)
