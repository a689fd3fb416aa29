"""The vibration modes of the model system, and how they answer a force.

Each mode turns the rigid fuselage about its own fixed point on the model axis, `radius` aft of the
inertial sensor (paper, Figures 3 and 4): in yaw about model z, nose to port positive; in pitch
nose up positive. A mode's angle is the rotation of the fuselage [rad], its generalised force the
force's moment about the fixed point, its inertia the fuselage's about the same point:

    J (theta'' + 2 zeta omega_r theta' + omega_r^2 theta) = (x_shaker - x_fixed) (F + s F_other)

A real sting is not quite symmetric: a mode may carry along a turn in the other plane, about the
same point and in phase, the share s of its own. Then a force in the other plane drives it as well,
by the same share (the law of reciprocity), and J counts both turns.

The sting's part in the modal inertia is not known and left out: it would change the force that a
level needs and nothing else, since levels are set by the balance moment.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from glint_aoa.setup import Section, load_section, positive, quantity
from render_sim.excitation import Sum, Tones

__all__ = [
    "ModelSystem",
    "Plane",
    "VibrationMode",
    "balance_moment",
    "joint_angles",
    "load_model_system",
    "modal_angles",
    "paper_model_system",
]

Plane = Literal["yaw", "pitch"]

_PLANES: tuple[Plane, Plane] = ("yaw", "pitch")

_Inertia = Annotated[float, quantity("kg m^2"), positive]
_Station = Annotated[float, quantity("m"), Field(allow_inf_nan=False)]


class VibrationMode(Section):
    """One vibration mode (a row of the paper's Table 1); hertz and metres."""

    number: Annotated[int, Field(strict=True, ge=1)] = Field(description="mode number")
    plane: Plane = Field(description="plane of the motion")
    frequency: Annotated[float, quantity("Hz"), positive] = Field(description="natural frequency")
    radius: _Station = Field(description="effective radius, from the fixed point to the sensor")
    damping: Annotated[float, Field(strict=True, gt=0, lt=1)] = Field(description="damping ratio")
    out_of_plane: Annotated[float, Field(strict=True, gt=-1, lt=1)] = Field(
        0.0, description="turn in the other plane, nose up or to port, over that in its own"
    )

    def share(self, plane: Plane) -> float:
        """Return how far the mode turns in a plane, over its turn in its own."""
        return 1.0 if plane == self.plane else self.out_of_plane


def _by_frequency(modes: tuple[VibrationMode, ...]) -> tuple[VibrationMode, ...]:
    return tuple(sorted(modes, key=lambda mode: mode.frequency))


class ModelSystem(Section):
    """Mass properties, stations and modes of the model on its sting; SI units.

    Stations are model x; inertias are about the centre of gravity, which lies on the model axis.
    """

    mass: Annotated[float, quantity("kg"), positive] = Field(description="mass on the balance")
    center_of_gravity: _Station = Field(description="station of the centre of gravity")
    roll_inertia: _Inertia = Field(description="about model x")
    pitch_inertia: _Inertia = Field(description="about model y")
    yaw_inertia: _Inertia = Field(description="about model z")
    sensor_station: _Station = Field(description="station of the inertial package")
    shaker_station: _Station = Field(description="station of the shaker's force linkage")
    mode: Annotated[tuple[VibrationMode, ...], AfterValidator(_by_frequency)] = Field(
        description="the vibration modes, held by rising frequency"
    )

    def modes_in(self, plane: Plane) -> tuple[VibrationMode, ...]:
        """Return the modes of one plane, by rising frequency."""
        return tuple(mode for mode in self.mode if mode.plane == plane)

    def fixed_point(self, mode: VibrationMode) -> float:
        """Return the station about which `mode` turns the model [m]."""
        return self.sensor_station - mode.radius

    def inertia(self, plane: Plane) -> float:
        """Return the inertia about the centre of gravity for turning in `plane` [kg m^2]."""
        return self.yaw_inertia if plane == "yaw" else self.pitch_inertia

    def modal_inertia(self, mode: VibrationMode) -> float:
        """Return the fuselage's inertia about the mode's fixed point, both turns [kg m^2]."""
        arm = self.center_of_gravity - self.fixed_point(mode)
        return sum(
            mode.share(plane) ** 2 * (self.inertia(plane) + self.mass * arm**2) for plane in _PLANES
        )

    def balance_inertia(self, mode: VibrationMode, plane: Plane) -> float:
        """Return the balance moment in `plane` per angular acceleration of `mode` [kg m^2].

        Angular momentum of the fuselage about the balance moment centre, per angular rate of the
        mode: s (I + m x_cg (x_cg - x_fixed)), s being 1 in the mode's own plane.
        """
        arm = self.center_of_gravity - self.fixed_point(mode)
        inertia = self.inertia(plane) + self.mass * self.center_of_gravity * arm
        return mode.share(plane) * inertia


def load_model_system(path: Path) -> ModelSystem:
    """Read a model system from a TOML file; raise SetupError if it cannot be used."""
    return load_section(path, ModelSystem)


def paper_model_system() -> ModelSystem:
    """Return the model system of the paper's test (Table 1, mass properties our own)."""
    with as_file(files("render_sim") / "data" / "model.toml") as path:
        return load_model_system(path)


def modal_angles(
    system: ModelSystem, force: Tones, plane: Plane
) -> list[tuple[VibrationMode, Tones]]:
    """Return each mode's steady-state answer to the shaker.

    Parameters
    ----------
    system : ModelSystem
        The modes and mass properties.
    force : Tones
        Force at the shaker's station along model +y ("yaw") or +z ("pitch") [N].
    plane : "yaw" or "pitch"
        Plane of the force; only modes that turn in this plane answer.

    Returns
    -------
    list of (VibrationMode, Tones)
        These modes by rising frequency, with their angles [rad].
    """
    omega = 2 * np.pi * force.frequency_hz
    return [
        (mode, replace(force, amplitude=force.amplitude * _receptance(system, mode, omega, plane)))
        for mode in system.mode
        if mode.share(plane)
    ]


def joint_angles(
    system: ModelSystem, forces: Mapping[Plane, Tones]
) -> list[tuple[VibrationMode, Tones | Sum]]:
    """Return each mode's steady-state answer to forces in one plane or both.

    Parameters
    ----------
    system : ModelSystem
        The modes and mass properties.
    forces : mapping of "yaw" or "pitch" to Tones
        Force at the shaker's station in each plane [N].

    Returns
    -------
    list of (VibrationMode, Tones or Sum)
        The modes that answer by rising frequency, with their angles [rad].
    """
    answers: dict[VibrationMode, list[Tones]] = {}
    for plane, force in forces.items():
        for mode, angle in modal_angles(system, force, plane):
            answers.setdefault(mode, []).append(angle)
    return [
        (mode, answers[mode][0] if len(answers[mode]) == 1 else Sum(tuple(answers[mode])))
        for mode in system.mode
        if mode in answers
    ]


def _receptance(
    system: ModelSystem, mode: VibrationMode, omega: NDArray[np.float64], plane: Plane
) -> NDArray[np.complex128]:
    omega_r = 2 * np.pi * mode.frequency
    lever = mode.share(plane) * (system.shaker_station - system.fixed_point(mode))
    stiffness = omega_r**2 - omega**2 + 2j * mode.damping * omega_r * omega
    return np.asarray(lever / (system.modal_inertia(mode) * stiffness), np.complex128)


def balance_moment(
    system: ModelSystem,
    force: Tones,
    angles: Sequence[tuple[VibrationMode, Tones]],
    plane: Plane,
) -> Tones:
    """Return the balance moment about its centre, to first order in the motion.

    The moment that the model puts on the balance is the shaker's less what turns and moves the
    model's own mass. It sets levels; the recorded moment comes from the full kinematics.

    Parameters
    ----------
    system : ModelSystem
        Mass properties and stations.
    force : Tones
        Force at the shaker's station [N].
    angles : sequence of (VibrationMode, Tones)
        Modal angles [rad] at the force's frequencies.
    plane : "yaw" or "pitch"
        Plane of the force and the moment.

    Returns
    -------
    Tones
        Yaw or pitch moment [N m], positive as the angles are.
    """
    moment = system.shaker_station * force.amplitude
    for mode, angle in angles:
        moment = moment - system.balance_inertia(mode, plane) * angle.derivative(2).amplitude
    return replace(force, amplitude=moment)
