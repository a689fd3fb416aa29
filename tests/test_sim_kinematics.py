"""What the simulated sensors feel, held against positions alone; energy of the modes."""

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from render_sim.campaign import Campaign, load_campaign, point_motion
from render_sim.decay import ShutOff
from render_sim.excitation import Tones
from render_sim.instruments import accelerometer_stations
from render_sim.kinematics import body_kinematics
from render_sim.modal_motion import ModalMotion
from render_sim.modes import joint_angles, paper_model_system
from render_sim.motion import StaticMotion
from render_sim.scene import paper_scene

G = 9.80665
UP = np.array([0.0, 0.0, G])
RATE = 6400.0
SYSTEM = paper_model_system()
STATIONS = dict(accelerometer_stations(SYSTEM))

SINE = {"kind": "sine", "plane": "yaw", "frequency": "9.8 Hz", "moments": ["5000 in*lbf"]}
MODULATED = SINE | {"kind": "modulated sine", "plane": "pitch", "frequency": "9.2 Hz"}
RANDOM = {"kind": "random", "plane": "pitch", "moments": ["5000 in*lbf"]}
SWEEP = {"kind": "sine sweep", "plane": "yaw", "moments": ["3000 in*lbf"]}
BOTH = RANDOM | {"plane": "yaw", "other_plane": {"kind": "random", "moments": ["2000 in*lbf"]}}
MOTIONS: Mapping[str, Mapping[str, object]] = {
    "sine": {"excitation": SINE},
    "modulated": {"excitation": MODULATED},
    "random": {"excitation": RANDOM},
    "sweep": {"excitation": SWEEP},
    "decay": {"excitation": MODULATED | {"shaker_off": "1 s"}},
    "static yaw": {"excitation": SINE, "yaw": "3 deg", "angle": "4.3 deg"},
    "both planes": {"excitation": BOTH, "angle": "-2 deg"},
}


def moved(**record):
    content = {
        "name": "motions",
        "start": "2026-01-12T08:00:00",
        "record": [{"name": "one", "duration": "4 s"} | record],
    }
    campaign = Campaign.model_validate(content)
    return point_motion(campaign, campaign.points[0], seed=6)


def differentiated(motion, time, station):
    """Position's first and second derivative from a polynomial through nearby positions."""
    half, nodes = 3e-3, chebyshev.chebpts1(21)
    near = time[:, None] + half * nodes
    pose = motion.pose(near)
    place = pose[..., :3, 0] * station + pose[..., :3, 3]
    fits = chebyshev.chebfit(nodes, np.moveaxis(place - place[:, 10:11], 1, 0).reshape(21, -1), 20)
    slopes = [
        chebyshev.chebval(0.0, chebyshev.chebder(fits, order)).reshape(-1, 3) / half**order
        for order in (1, 2)
    ]
    return *slopes, motion.pose(time)[:, :3, :3]


@pytest.mark.parametrize("name", MOTIONS)
def test_accelerations_are_the_second_derivative_of_positions(name):
    """To 1e-6 of the vibration, at every sensor, before filters and noise."""
    motion = moved(**MOTIONS[name]).motion
    body = body_kinematics(motion, start_s=1.2, samples=6400, rate_hz=RATE)
    some = np.arange(50, 6400, 331)
    for station in STATIONS.values():
        _, acceleration, rotation = differentiated(motion, body.time_s[some], station)
        felt = np.einsum("nji,nj->ni", rotation, acceleration + UP)
        still = np.einsum("nji,j->ni", rotation, UP)
        vibration = np.linalg.norm(felt - still, axis=1).max()
        assert vibration > 0.1
        found = body.specific_force(station)[some]
        np.testing.assert_allclose(found, felt, rtol=0, atol=1e-6 * vibration)


def test_decay_goes_on_without_a_step_in_angle_and_rate():
    motion = moved(**MOTIONS["decay"]).motion
    before, after = 1.0 - 1e-9, 1.0 + 1e-9
    pose = motion.pose(np.array([before, after]))
    np.testing.assert_allclose(pose[1], pose[0], rtol=0, atol=1e-8)
    step = 1e-5
    left = motion.pose(np.array([1 - 2 * step, 1 - step]))
    right = motion.pose(np.array([1 + step, 1 + 2 * step]))
    rates = [np.diff(each, axis=0)[0] / step for each in (left, right)]
    np.testing.assert_allclose(rates[1], rates[0], rtol=0, atol=5e-3 * np.abs(rates[0]).max())


@pytest.mark.parametrize("yaw_deg", [0.0, 3.0])
@pytest.mark.parametrize("alpha_deg", [-6.0, 0.0, 4.3])
def test_a_still_model_feels_g_sin_alpha_whatever_its_heading(alpha_deg, yaw_deg):
    alpha = np.deg2rad(alpha_deg)
    still = StaticMotion(paper_scene(), alpha, yaw_rad=np.deg2rad(yaw_deg))
    felt = body_kinematics(still, start_s=0.0, samples=3, rate_hz=RATE).specific_force(0.9)
    np.testing.assert_allclose(felt[:, 0], G * np.sin(alpha), rtol=0, atol=1e-13)
    np.testing.assert_allclose(felt[:, 2], G * np.cos(alpha), rtol=0, atol=1e-13)


def kinetic(motion, time):
    """Kinetic energy of the rigid fuselage from positions [J]; it does not roll."""
    speed, _, _ = differentiated(motion, time, SYSTEM.center_of_gravity)
    ahead, _, rotation = differentiated(motion, time, SYSTEM.center_of_gravity + 1.0)
    turn = np.einsum("nji,nj->ni", rotation, ahead - speed)  # r, -q in y, z of model axes
    inertia = np.array([0.0, SYSTEM.yaw_inertia, SYSTEM.pitch_inertia])
    return (SYSTEM.mass * (speed**2).sum(axis=1) + (inertia * turn**2).sum(axis=1)) / 2


@pytest.mark.parametrize(
    ("number", "out_of_plane", "tolerance"),
    [(1, 0.0, 1e-9), (2, 0.0, 1e-9), (5, 0.0, 1e-9), (1, 0.08, 1e-6), (6, -0.3, 1e-5)],
)
def test_energy_of_a_mode_without_damping_stays(number, out_of_plane, tolerance):
    """With a turn in the other plane to second order in the angle, which is 0.005."""
    found = next(mode for mode in SYSTEM.mode if mode.number == number)
    mode = found.model_copy(update={"out_of_plane": out_of_plane, "damping": 1e-15})
    steady = Tones(np.array([mode.frequency]), np.array([0.005 * np.exp(0.7j)]))
    angle = ShutOff(mode, steady, 0.0)
    time = np.linspace(0.01, 0.5, 60)
    motion = ModalMotion(StaticMotion(paper_scene(), 0.05), SYSTEM, [(mode, angle)])
    stiffness = SYSTEM.modal_inertia(mode) * (2 * np.pi * mode.frequency) ** 2
    energy = kinetic(motion, time) + stiffness * angle.at(time) ** 2 / 2
    np.testing.assert_allclose(energy, energy[0], rtol=tolerance)


def test_a_damped_mode_loses_energy_at_twice_its_damping():
    mode = SYSTEM.modes_in("pitch")[0]
    steady = Tones(np.array([mode.frequency]), np.array([0.005 + 0j]))
    motion = ModalMotion(StaticMotion(paper_scene()), SYSTEM, [(mode, ShutOff(mode, steady, 0.0))])
    omega = 2 * np.pi * mode.frequency
    damped = omega * np.sqrt(1 - mode.damping**2)
    cycles = np.arange(1, 12) * 2 * np.pi / damped
    lost = np.log(kinetic(motion, cycles + 0.01))
    np.testing.assert_allclose(
        np.diff(lost), -2 * mode.damping * omega * 2 * np.pi / damped, rtol=1e-6
    )


@pytest.mark.parametrize("frequency", [9.5, 20.0])
def test_what_the_shaker_feeds_is_what_damping_takes(frequency):
    """Both planes driven, all modes with their turns in the other plane; over whole cycles."""
    forces = {
        "yaw": Tones(np.array([frequency]), np.array([6.0 + 2j])),
        "pitch": Tones(np.array([frequency]), np.array([-3.0 + 4j])),
    }
    angles = joint_angles(SYSTEM, forces)
    motion = ModalMotion(StaticMotion(paper_scene(), 0.05), SYSTEM, angles)
    time = np.arange(64) / 64 / frequency
    speed, _, rotation = differentiated(motion, time, SYSTEM.shaker_station)
    speed = np.einsum("nji,nj->ni", rotation, speed)
    fed = sum((forces[p].at(time) * speed[:, k]).mean() for p, k in (("yaw", 1), ("pitch", 2)))
    taken = sum(
        2 * mode.damping * 2 * np.pi * mode.frequency
        * SYSTEM.modal_inertia(mode)
        * (angle.derivative().at(time) ** 2).mean()
        for mode, angle in angles
    )  # fmt: skip
    assert len(angles) == 6
    assert fed == pytest.approx(taken, rel=1e-4)


def test_the_papers_modes_need_more_mass_than_the_fuselage():
    """A rigid body has two modes a plane: by its mass alone the third is almost the second."""
    for plane in ("yaw", "pitch"):
        first, second, third = (
            np.array([SYSTEM.center_of_gravity - SYSTEM.fixed_point(mode), 1.0])
            for mode in SYSTEM.modes_in(plane)
        )
        mass = np.diag([SYSTEM.mass, SYSTEM.inertia(plane)])

        def alike(a, b, mass=mass):
            return a @ mass @ b / np.sqrt((a @ mass @ a) * (b @ mass @ b))

        assert abs(alike(first, second)) < 0.06
        assert abs(alike(first, third)) < 0.08
        assert alike(second, third) > 0.99


def test_yaw_modes_nod_as_figures_31_and_32_show():
    """At 4000 in-lb: up to 0.04 deg and 0.01 in; yaw alone gives about a tenth of the angle."""
    from render_sim.mirror import glint_line

    scene, time = paper_scene(), np.linspace(0, 1, 400, endpoint=False)
    campaign = load_campaign("paper")
    point = next(p for p in campaign.points if p.name == "yaw-0deg-sine-07")
    pure = campaign.model.model_copy(
        update={
            "mode": tuple(m.model_copy(update={"out_of_plane": 0.0}) for m in campaign.model.mode)
        }
    )
    swing = {}
    for name, model in (("paper", campaign.model), ("pure", pure)):
        plan = campaign.model_copy(update={"model": model})
        line = glint_line(scene, point_motion(plan, point, scene=scene).motion.pose(time))
        swing[name] = np.rad2deg(np.ptp(line[0])), np.ptp(line[1]) / 0.0254
    assert swing["paper"] == (pytest.approx(0.04, abs=0.005), pytest.approx(0.01, abs=0.004))
    assert swing["pure"][0] < 0.15 * swing["paper"][0]
    assert swing["pure"][1] < 0.1 * swing["paper"][1]
