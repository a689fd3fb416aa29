import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from render_sim.excitation import Tones
from render_sim.film import attitude
from render_sim.kinematics import body_kinematics
from render_sim.modal_motion import ModalMotion
from render_sim.modes import paper_model_system
from render_sim.motion import StaticMotion
from render_sim.scene import paper_scene

G = 9.80665
SYSTEM = paper_model_system()
MODES = {m.number: m.model_copy(update={"out_of_plane": 0.0}) for m in SYSTEM.mode}
"""Each turning in its own plane alone, so that there are closed forms."""
STATIC = StaticMotion(paper_scene(), np.deg2rad(4.3))


def _tone(frequency_hz, amplitude):
    return Tones(np.array([frequency_hz]), np.array([amplitude], complex))


def _moving(*pairs):
    return ModalMotion(STATIC, SYSTEM, [(MODES[number], angle) for number, angle in pairs])


def _tunnel(pose, station):
    return pose[..., :3, 0] * station + pose[..., :3, 3]


def test_sensor_stays_on_an_arc_about_the_fixed_point():
    time = np.linspace(0, 1, 101)
    for number, mode in MODES.items():
        pose = _moving((number, _tone(mode.frequency, 0.01))).pose(time)
        fixed = _tunnel(pose, SYSTEM.fixed_point(mode))
        np.testing.assert_allclose(fixed, fixed[:1].repeat(101, 0), rtol=0, atol=1e-15)
        reach = np.linalg.norm(_tunnel(pose, 0.9) - fixed, axis=-1)
        np.testing.assert_allclose(reach, abs(mode.radius), rtol=0, atol=1e-14)


@pytest.mark.parametrize("number", [1, 2])
def test_a_mode_may_carry_a_turn_in_the_other_plane_along(number):
    mode = MODES[number].model_copy(update={"out_of_plane": 0.08})
    tone, time = _tone(mode.frequency, 0.005), np.linspace(0, 1, 101)
    level = StaticMotion(paper_scene())
    pose = ModalMotion(level, SYSTEM, [(mode, tone)]).pose(time)
    fixed = _tunnel(pose, SYSTEM.fixed_point(mode))
    np.testing.assert_allclose(fixed, fixed[:1].repeat(101, 0), rtol=0, atol=1e-15)
    pitch, yaw, _ = attitude(paper_scene(), pose)
    own, other = (yaw, pitch) if mode.plane == "yaw" else (pitch, yaw)
    np.testing.assert_allclose(own, tone.at(time), atol=1e-6)
    np.testing.assert_allclose(other, 0.08 * tone.at(time), atol=1e-6)


def test_positive_pitch_lifts_the_nose_and_positive_yaw_turns_it_to_port():
    still, time = STATIC.pose(np.zeros(())), np.zeros(())
    up = _moving((2, _tone(9.2, 0.01))).pose(time)
    slope = np.arcsin(up[2, 0]) - np.arcsin(still[2, 0])
    assert slope == pytest.approx(0.01, rel=1e-12)
    port = _moving((1, _tone(9.8, 0.01))).pose(time)
    assert np.dot(port[:3, 0], still[:3, 1]) == pytest.approx(np.sin(0.01), rel=1e-12)
    assert port[1, 0] < 0  # nose left in the image: port side faces the camera


def test_modes_compose_by_rising_frequency():
    time = np.array([0.0, 0.013, 0.2])
    angles = {1: _tone(9.8, 0.01), 2: _tone(9.2, 0.02j), 5: _tone(29.8, 0.003)}
    expected = STATIC.pose(time)
    for number in (2, 1, 5):
        turn = angles[number].at(time)
        vector = np.outer(turn, [0, 0, 1] if number % 2 else [0, -1, 0])
        matrix = np.tile(np.eye(4), (3, 1, 1))
        matrix[:, :3, :3] = Rotation.from_rotvec(vector).as_matrix()
        fixed = np.array([SYSTEM.fixed_point(MODES[number]), 0, 0])
        matrix[:, :3, 3] = fixed - matrix[:, :3, :3] @ fixed
        expected = expected @ matrix
    pose = _moving(*reversed(angles.items())).pose(time)
    np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-15)


def test_no_vibration_is_the_static_pose_for_any_shape_of_times():
    time = np.zeros((3, 5))
    assert _moving().pose(time).shape == (3, 5, 4, 4)
    np.testing.assert_array_equal(_moving().pose(time), STATIC.pose(time))


def _chain_forces(pairs, time, station):
    """Specific force on the axis by Newton-Euler recursion along the chain of rotations."""
    rotation = STATIC.pose(np.zeros(()))[:3, :3]
    force = np.tile(rotation.T @ [0, 0, G], (time.size, 1))  # at the origin of the outer frame
    rate, acceleration = np.zeros((2, time.size, 3))
    for number, angle in pairs:
        axis = np.array([0, 0, 1.0] if number % 2 else [0, -1.0, 0])
        fixed = np.array([SYSTEM.fixed_point(MODES[number]), 0, 0])
        at_fixed = force + np.cross(acceleration, fixed) + np.cross(rate, np.cross(rate, fixed))
        back = Rotation.from_rotvec(np.outer(angle.at(time), axis)).inv()
        spin = np.outer(angle.derivative().at(time), axis)
        spin_up = np.outer(angle.derivative(2).at(time), axis)
        outer_rate = back.apply(rate)
        rate = outer_rate + spin
        acceleration = back.apply(acceleration) + np.cross(outer_rate, spin) + spin_up
        force = (
            back.apply(at_fixed)
            - np.cross(acceleration, fixed)
            - np.cross(rate, np.cross(rate, fixed))
        )
    point = np.array([station, 0, 0])
    felt = force + np.cross(acceleration, point) + np.cross(rate, np.cross(rate, point))
    return felt, rate, acceleration


def test_differences_agree_with_the_exact_chain():
    pairs = [
        (2, _tone(9.2, 0.005)),
        (1, _tone(9.8, 0.004j)),
        (3, _tone(19.5, 0.001)),
        (4, _tone(20.3, 0.001j)),
        (5, _tone(29.8, 0.0005)),
        (6, _tone(60.0, 0.0004)),
    ]
    body = body_kinematics(_moving(*pairs), start_s=-0.3, samples=1600, rate_hz=6400)
    for station in (0.1, 0.9):
        felt, rate, acceleration = _chain_forces(pairs, body.time_s, station)
        np.testing.assert_allclose(
            body.specific_force(station), felt, rtol=0, atol=1e-6 * np.abs(felt).max(0).min()
        )
        np.testing.assert_allclose(body.angular_rate, rate, rtol=0, atol=1e-8)
        np.testing.assert_allclose(body.angular_acceleration, acceleration, rtol=0, atol=1e-6)


@pytest.mark.parametrize("alpha_deg", [-6.0, 0.0, 4.3])
def test_still_model_feels_gravity(alpha_deg):
    alpha = np.deg2rad(alpha_deg)
    body = body_kinematics(
        StaticMotion(paper_scene(), alpha), start_s=0.0, samples=10, rate_hz=6400
    )
    expected = np.tile([G * np.sin(alpha), 0, G * np.cos(alpha)], (10, 1))
    np.testing.assert_allclose(body.specific_force(0.9), expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(body.angular_rate, 0, atol=1e-9)


@pytest.mark.parametrize("number", [1, 5])
def test_axial_force_of_one_yaw_mode_is_centrifugal_with_its_second_harmonic(number):
    mode, angle = MODES[number], 0.005
    level = StaticMotion(paper_scene())
    motion = ModalMotion(level, SYSTEM, [(mode, _tone(mode.frequency, angle))])
    samples = round(49 * 6400 / mode.frequency)  # whole cycles, to a thousandth
    body = body_kinematics(motion, start_s=0.0, samples=samples, rate_hz=6400)
    axial = body.specific_force(0.9)[:, 0]
    phase = 2 * np.pi * mode.frequency * body.time_s
    mean = -((angle * mode.radius * 2 * np.pi * mode.frequency) ** 2) / (2 * mode.radius)
    assert axial.mean() == pytest.approx(mean, rel=1e-3)
    np.testing.assert_allclose(axial, mean * (1 - np.cos(2 * phase)), rtol=0, atol=1e-3 * abs(mean))


def test_gravity_turns_with_the_pitching_model():
    angle = _tone(9.2, 0.005)
    body = body_kinematics(_moving((2, angle)), start_s=0.0, samples=700, rate_hz=6400)
    pitch = np.deg2rad(4.3) + angle.at(body.time_s)
    fixed = body.specific_force(SYSTEM.fixed_point(MODES[2]))
    np.testing.assert_allclose(fixed[:, 0], G * np.sin(pitch), rtol=0, atol=1e-6)
    np.testing.assert_allclose(fixed[:, 2], G * np.cos(pitch), rtol=0, atol=1e-6)
