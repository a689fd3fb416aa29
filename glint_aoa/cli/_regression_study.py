"""The paper's regression study (Tables 2 and 3), repeated on simulated records.

The model is driven in its first yaw or pitch mode, modulated at 0.3 Hz, for 85 s. A loose mass near
the balance, which the balance feels and the package does not, moves throughout and seven times as
far in the last part of the yaw record; the accelerometers' bracket, which it strikes, trembles. A
knock tips the model at 70 s of the pitch record, as in the paper.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from glint_aoa.inertial.channels import package_output
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.inertial.lateral import SourceKind
from glint_aoa.inertial.record_fit import regress
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.setup import Inertial
from glint_aoa.units import STANDARD_GRAVITY
from render_sim.acquisition import Recording, acquire
from render_sim.excitation import Tones, modulated_sine, random_band
from render_sim.modal_motion import ModalMotion
from render_sim.modes import ModelSystem, Plane, modal_angles, paper_model_system
from render_sim.motion import Motion, StaticMotion, rigid, rotation_y
from render_sim.scene import paper_scene

__all__ = ["PAPER_ROWS", "StudyRow", "regression_study", "study_record"]

Floats = NDArray[np.float64]

_DURATION_S = 85.0
_OVERSAMPLING = 4  # of 800 Hz: motion to 40 Hz differentiates to 1e-6
_LOOSE_STATION_M = 0.12
_LOOSE_MASS_KG = 5.0
_LOOSE_HALF_BAND_HZ = 0.6
_RATTLE_S, _RATTLE = 38.0, 7.0
_KNOCK_S, _KNOCK_WIDTH_S = 70.0, 0.5


@dataclass(frozen=True)
class _Case:
    """Excitation of a record; level and depth give the paper's mean and standard deviation."""

    plane: Plane
    frequency_hz: float
    zero_deg: float
    bias_deg: float
    depth: float
    loose_travel_m: float  # of the loose mass, rms
    bracket_travel_m: float  # of the accelerometer on the model, rms
    rattle: float
    knock_deg: float
    modulation_hz: float = 0.3


_CASES = {
    "pitch": _Case("pitch", 9.2, -0.290, 0.060, 0.8, 1.5e-3, 1.0e-4, 1.0, 0.06),
    "yaw": _Case("yaw", 9.75, -0.283, 0.150, 0.47, 2.2e-3, 2.5e-4, _RATTLE, 0.0),
}


_CHANNELS: dict[Plane, tuple[str, str, str]] = {
    "yaw": ("side_force", "yaw_moment", "ay_face"),
    "pitch": ("normal_force", "pitch_moment", "az_face"),
}
"""Force, moment and accelerometer of each plane; a force ahead gives a moment of its sign."""


@dataclass(frozen=True)
class PaperRow:
    """A row of Table 2 or 3 as printed."""

    plane: Plane
    between_s: tuple[float, float]
    source: SourceKind
    mean_deg: float
    std_deg: float
    bias_deg: float
    corrected_deg: float
    standard_error_deg: float


PAPER_ROWS = (
    PaperRow("pitch", (15, 85), "moment", -0.337, 0.048, -0.064, -0.273, 0.014),
    PaperRow("pitch", (20, 40), "moment", -0.332, 0.046, -0.059, -0.273, 0.006),
    PaperRow("pitch", (40, 60), "moment", -0.335, 0.046, -0.067, -0.268, 0.005),
    PaperRow("pitch", (20, 40), "force", -0.332, 0.046, -0.095, -0.237, 0.030),
    PaperRow("pitch", (20, 40), "acceleration", -0.332, 0.046, -0.064, -0.268, 0.011),
    PaperRow("yaw", (10, 30), "moment", -0.433, 0.078, -0.148, -0.285, 0.007),
    PaperRow("yaw", (40, 60), "moment", -0.440, 0.077, -0.161, -0.280, 0.032),
    PaperRow("yaw", (10, 30), "force", -0.433, 0.078, -0.178, -0.254, 0.050),
    PaperRow("yaw", (10, 30), "acceleration", -0.433, 0.078, -0.149, -0.284, 0.021),
)
"""Tables 2 (pitch) and 3 (yaw) of the paper."""


@dataclass(frozen=True)
class StudyRow:
    """A row of the paper's table beside ours.

    Attributes
    ----------
    paper : PaperRow
        As printed.
    figures : dict of str to float
        Ours: see `glint_aoa.inertial.record_fit.Regression.figures`.
    zero_deg : float
        Angle of the motionless model [deg].
    is_correlated : bool
        False where the method warns.
    """

    paper: PaperRow
    figures: dict[str, float]
    zero_deg: float
    is_correlated: bool

    @property
    def paper_reduction(self) -> float:
        """Reduction of the standard deviation in the paper."""
        return 1 - self.paper.standard_error_deg / self.paper.std_deg


def regression_study(*, seed: int = 1) -> list[StudyRow]:
    """Repeat every row of the paper's Tables 2 and 3.

    Parameters
    ----------
    seed : int
        Of noise and phases.

    Returns
    -------
    list of StudyRow
        In the order of `PAPER_ROWS`.
    """
    rows = []
    for plane in ("pitch", "yaw"):
        record = study_record(plane, seed=seed)
        # the paper's regression was on the filtered output
        filtered = {k: v for k, v in record.channels.items() if v.quantity != "aoa_unfiltered"}
        record = replace(record, channels=filtered)
        task = CorrectionTask(record, package_output(record), (), Inertial().filter)
        for row in PAPER_ROWS:
            if row.plane == plane:
                found = regress(task, source=row.source, planes=(plane,), between_s=row.between_s)
                rows.append(
                    StudyRow(row, found.figures(), _CASES[plane].zero_deg, found.is_correlated)
                )
    return rows


def study_record(
    plane: Plane, *, seed: int = 1, duration_s: float = _DURATION_S
) -> AcquisitionRecord:
    """Simulate the 12-channel record of one of the two tables.

    Parameters
    ----------
    plane : {"yaw", "pitch"}
        Plane of the excitation.
    seed : int
        Of noise and phases.
    duration_s : float
        Length of the record [s].

    Returns
    -------
    AcquisitionRecord
        From rigid-body kinematics, 800 samples/s, 16 bits.
    """
    case, system = _CASES[plane], paper_model_system()
    rng = np.random.default_rng([seed, ord(plane[0])])
    force = _drive(case, system, rng)
    static = StaticMotion(paper_scene(), np.radians(case.zero_deg))
    motion = _Knocked(ModalMotion(static, system, modal_angles(system, force, plane)), case)
    acquired = acquire(
        system,
        motion,
        static,
        forces={plane: force},
        recording=Recording(duration_s=duration_s, oversampling=_OVERSAMPLING),
        rng=rng,
    )
    channels = {k: v for k, v in acquired.channels.items() if not k.startswith("analyser_")}
    strays = _strays(case, channels["ay_face"].time_s, rng)
    channels |= {name: _added(channels[name], stray) for name, stray in strays.items()}
    return AcquisitionRecord(name=f"regression-{plane}", channels=channels)


def _drive(case: _Case, system: ModelSystem, rng: np.random.Generator) -> Tones:
    """Return the force that gives the first mode the envelope asked for."""
    shape = modulated_sine(
        case.frequency_hz, modulation_hz=case.modulation_hz, depth=case.depth, rng=rng
    )
    mode = system.modes_in(case.plane)[0]
    speed = np.sqrt(2 * STANDARD_GRAVITY * np.radians(case.bias_deg) / (1 + case.depth**2 / 2))
    amplitude = speed / np.sqrt(mode.radius) / (2 * np.pi * case.frequency_hz)
    angle = shape.scaled(float(amplitude))
    answer = modal_angles(system, replace(shape, amplitude=np.ones(3, complex)), case.plane)[0][1]
    return replace(angle, amplitude=angle.amplitude / answer.amplitude)


@dataclass(frozen=True, eq=False)
class _Knocked:
    """A motion with a short nod about the balance, if the case has one."""

    motion: Motion
    case: _Case

    def pose(self, time_s: Floats) -> Floats:
        shape = np.exp(-(((time_s - _KNOCK_S) / _KNOCK_WIDTH_S) ** 2))
        nod = rotation_y(-np.radians(self.case.knock_deg) * shape)
        return np.asarray(self.motion.pose(time_s) @ rigid(nod, np.zeros(3)))


def _strays(case: _Case, time_s: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    """Return what the loose mass adds to the balance, and its knocks to the accelerometer."""
    low, high = (case.frequency_hz + side * _LOOSE_HALF_BAND_HZ for side in (-1, 1))
    louder = 1 + (case.rattle - 1) / (1 + np.exp(-2 * (time_s - _RATTLE_S)))
    shaken = random_band(low, high, rng=rng).derivative(2).at(time_s)
    trembling = random_band(low, high, rng=rng).derivative(2).at(time_s)
    reaction = -_LOOSE_MASS_KG * case.loose_travel_m * louder * shaken
    side, moment, felt = _CHANNELS[case.plane]
    return {
        side: reaction,
        moment: _LOOSE_STATION_M * reaction,
        felt: case.bracket_travel_m * trembling,
    }


def _added(channel: Channel, stray: Floats) -> Channel:
    """Add a signal in the channel's units before its converter."""
    counts = np.rint(channel.samples + stray / channel.scale)
    return replace(channel, samples=np.clip(counts, -32767, 32767).astype(np.int16))
