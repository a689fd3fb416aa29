import re
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from glint_aoa.errors import SetupError
from render_sim.excitation import Tones
from render_sim.modes import (
    ModelSystem,
    balance_moment,
    joint_angles,
    load_model_system,
    modal_angles,
    paper_model_system,
)

TABLE_1 = {  # number: plane, Hz, in
    1: ("yaw", 9.8, 31.0),
    2: ("pitch", 9.2, 30.2),
    3: ("yaw", 19.5, 0.18),
    4: ("pitch", 20.3, -1.08),
    5: ("yaw", 29.8, -7.14),
    6: ("pitch", 34.2, -7.65),
}


def _tone(frequency_hz: float, amplitude: complex = 1.0) -> Tones:
    return Tones(np.array([frequency_hz]), np.array([amplitude], complex))


def test_modes_are_those_of_table_1():
    system = paper_model_system()
    found = {m.number: (m.plane, m.frequency, m.radius / 0.0254) for m in system.mode}
    assert found == {
        number: (plane, hz, pytest.approx(inches))
        for number, (plane, hz, inches) in TABLE_1.items()
    }


def test_positive_radius_has_its_fixed_point_aft_of_the_sensor():
    system = paper_model_system()
    for mode in system.mode:
        assert system.fixed_point(mode) == pytest.approx(0.9 - mode.radius)
    first = system.modes_in("yaw")[0]
    assert system.fixed_point(first) < system.sensor_station


def test_modes_rise_in_frequency_whatever_the_file_says():
    system = paper_model_system()
    turned = system.model_dump() | {"mode": [m.model_dump() for m in reversed(system.mode)]}
    units = {"mass": "kg", "center_of_gravity": "m", "sensor_station": "m", "shaker_station": "m"}
    units |= {f"{axis}_inertia": "kg m^2" for axis in ("roll", "pitch", "yaw")}
    content = {key: f"{turned[key]} {unit}" for key, unit in units.items()}
    content["mode"] = [
        each | {"frequency": f"{each['frequency']} Hz", "radius": f"{each['radius']} m"}
        for each in turned["mode"]
    ]
    assert ModelSystem.model_validate(content) == system


def test_inertias_follow_from_the_parallel_axis_theorem():
    system = paper_model_system()
    mode = system.modes_in("pitch")[0]
    arm = system.center_of_gravity - system.fixed_point(mode)
    assert system.modal_inertia(mode) == pytest.approx(10.2 + 75 * arm**2)
    assert system.balance_inertia(mode, "pitch") == pytest.approx(10.2 + 75 * 0.334 * arm)


def _upright(system):
    """The system with each mode in its own plane alone."""
    modes = tuple(mode.model_copy(update={"out_of_plane": 0.0}) for mode in system.mode)
    return system.model_copy(update={"mode": modes})


@pytest.mark.parametrize("plane", ["yaw", "pitch"])
def test_only_modes_of_the_plane_answer(plane):
    answer = modal_angles(_upright(paper_model_system()), _tone(9.5), plane)
    assert [mode.plane for mode, _ in answer] == [plane] * 3


def test_a_mode_that_turns_in_both_planes_counts_both():
    system = paper_model_system()
    mode = system.modes_in("yaw")[0]
    assert mode.out_of_plane == 0.08
    arm = system.center_of_gravity - system.fixed_point(mode)
    both = 10.4 + 75 * arm**2 + 0.08**2 * (10.2 + 75 * arm**2)
    assert system.modal_inertia(mode) == pytest.approx(both)
    assert system.balance_inertia(mode, "pitch") == pytest.approx(0.08 * (10.2 + 75 * 0.334 * arm))


def test_what_a_mode_answers_in_one_plane_it_answers_in_the_other():
    """Reciprocity: force across and motion along equals force along and motion across."""
    system = paper_model_system()
    along = dict(modal_angles(system, _tone(9.5), "yaw"))
    across = dict(modal_angles(system, _tone(9.5), "pitch"))
    for mode in system.modes_in("yaw"):
        turned = mode.out_of_plane * along[mode].amplitude
        np.testing.assert_allclose(across[mode].amplitude, turned, rtol=1e-12)


def test_forces_in_both_planes_add_in_a_mode():
    system = paper_model_system()
    forces = {"yaw": _tone(9.5, 2.0), "pitch": _tone(11.0, -3.0)}
    time = np.linspace(0, 1, 9)
    for mode, angle in joint_angles(system, forces):
        parts = [
            dict(modal_angles(system, force, plane)).get(mode) for plane, force in forces.items()
        ]
        expected = sum(part.at(time) for part in parts if part is not None)
        np.testing.assert_allclose(angle.at(time), expected, atol=1e-18)


def test_resonance_and_static_limit_in_closed_form():
    system = paper_model_system()
    mode = system.modes_in("yaw")[0]
    lever = system.shaker_station - system.fixed_point(mode)
    omega = 2 * np.pi * mode.frequency
    at_resonance = modal_angles(system, _tone(mode.frequency), "yaw")[0][1].amplitude[0]
    expected = lever / (2j * mode.damping * omega**2 * system.modal_inertia(mode))
    assert at_resonance == pytest.approx(expected, rel=1e-12)
    slow = modal_angles(system, _tone(1e-4), "yaw")[0][1].amplitude[0]
    assert slow == pytest.approx(lever / (omega**2 * system.modal_inertia(mode)), rel=1e-6)


def test_answer_satisfies_the_equation_of_motion():
    system = paper_model_system()
    force = Tones(np.array([7.0, 12.5, 31.0]), np.array([3 + 1j, -2j, 0.5 - 1j]))
    time = np.linspace(-1.0, 2.0, 301)
    for mode, angle in modal_angles(system, force, "pitch"):
        omega = 2 * np.pi * mode.frequency
        inner = system.modal_inertia(mode) * (
            angle.derivative(2).at(time)
            + 2 * mode.damping * omega * angle.derivative().at(time)
            + omega**2 * angle.at(time)
        )
        lever = mode.share("pitch") * (system.shaker_station - system.fixed_point(mode))
        outer = lever * force.at(time)
        np.testing.assert_allclose(inner, outer, rtol=0, atol=1e-11)


def test_balance_feels_the_shaker_alone_when_nothing_moves():
    moment = balance_moment(paper_model_system(), _tone(9.8, 2.0), [], "yaw")
    assert moment.amplitude[0] == pytest.approx(2.0 * 36 * 0.0254)


def test_largest_first_mode_moment_gives_the_bias_of_the_paper():
    """V^2 / (2 rho g) at 5000 in-lb peak to peak is about 0.2 deg with these mass properties."""
    system = paper_model_system()
    force = _tone(9.8)
    mode, angle = modal_angles(system, force, "yaw")[0]
    moment = balance_moment(system, force, modal_angles(system, force, "yaw"), "yaw")
    level = 5000 * 0.112984829 / (2 * abs(moment.amplitude[0]))
    speed = level * abs(angle.derivative().amplitude[0]) * mode.radius
    assert np.rad2deg(speed**2 / (2 * mode.radius * 9.80665)) == pytest.approx(0.19, abs=0.01)


def test_wrong_key_is_named(tmp_path: Path):
    path = tmp_path / "model.toml"
    path.write_text('maas = "75 kg"\n')
    expected = f"{path}: unknown key maas; did you mean mass?"
    with pytest.raises(SetupError, match=f"^{re.escape(expected)}$"):
        load_model_system(path)


def test_wrong_key_of_a_mode_is_named(tmp_path: Path):
    path = tmp_path / "model.toml"
    text = (files("render_sim") / "data" / "model.toml").read_text()
    path.write_text(text.replace("damping = 0.015", "dampng = 0.015"))
    expected = f"{path}: unknown key mode[0].dampng; did you mean damping?"
    with pytest.raises(SetupError, match=f"^{re.escape(expected)}$"):
        load_model_system(path)


def test_wrong_unit_is_named(tmp_path: Path):
    path = tmp_path / "model.toml"
    text = (files("render_sim") / "data" / "model.toml").read_text()
    path.write_text(text.replace('"75 kg"', '"75 m"'))
    expected = f"{path}: mass: '75 m' is not a quantity in kg"
    with pytest.raises(SetupError, match=f"^{re.escape(expected)}$"):
        load_model_system(path)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "no such file"),
        ("mass = ", "not a TOML file: Invalid value (at end of document)"),
    ],
)
def test_file_that_cannot_be_read(tmp_path: Path, content: str | None, expected: str):
    path = tmp_path / "model.toml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(SetupError, match=re.escape(f"{path}: {expected}")):
        load_model_system(path)
