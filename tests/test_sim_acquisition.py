from dataclasses import replace

import numpy as np
import pytest

from render_sim.acquisition import Recording, acquire, balance_loads
from render_sim.excitation import Tones
from render_sim.kinematics import body_kinematics
from render_sim.modal_motion import ModalMotion
from render_sim.modes import balance_moment, modal_angles, paper_model_system
from render_sim.motion import StaticMotion
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
    assert np.ptp(yawing.channels["pitch_moment"].values("in*lbf")) < 30


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
