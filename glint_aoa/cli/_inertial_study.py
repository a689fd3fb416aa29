"""Simulated records of the paper's inertial tests: its excitations, planes and levels."""

import numpy as np

from glint_aoa.inertial.modes import ModeShape, Plane
from glint_aoa.inertial.survey import survey_record
from glint_aoa.inertial_benchmark import StudyRecord
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.units import convert
from render_sim.acquisition import Recording, acquire
from render_sim.campaign import load_campaign, point_acquisition
from render_sim.excitation import Tones, peak_to_peak, random_band, sine
from render_sim.modal_motion import ModalMotion
from render_sim.modes import ModelSystem, balance_moment, modal_angles, paper_model_system
from render_sim.motion import StaticMotion
from render_sim.scene import paper_scene

__all__ = ["DAS_CHANNELS", "study_records", "survey_shapes"]

DAS_CHANNELS = ("aoa_unfiltered", "aoa_filtered", "ay_face", "az_face")
"""What the modal correction had: one accelerometer a plane, on the package's face."""

_IN_LB = convert("in*lbf", "N*m")
_LEVELS = 6  # of figures 14 and 15
_OVERSAMPLING = 4  # of 800 Hz: motion to 60 Hz differentiates to 1e-6
_RECORD_S = 12.0  # 8 s are left when the low-pass has settled
_RECORDS = {
    11: "yaw-9.8hz-shaker-off",
    12: "yaw-19.5hz-shaker-off",
    13: "yaw-29.8hz-shaker-off",
    16: "pitch-9.2hz-modulated",
    17: "pitch-5-60hz-random",
}
"""Records of the paper's campaign, by figure."""

_LARGEST = {"yaw": 0.146, "pitch": 0.175}  # bias of figures 14 and 15 [deg]
_SURVEY_STATION_M = 0.45  # of the shaker; ahead, it drives modes 3 and 4 next to their rest points
_SURVEY_S = 96.0
_SURVEY_FORCE_N = 20.0


def study_records(figure: int, *, seed: int = 0) -> list[StudyRecord]:
    """Simulate the records of one of the paper's Figures 11 to 17.

    Parameters
    ----------
    figure : int
        Its number.
    seed : int
        Of noise and phases.

    Returns
    -------
    list of StudyRecord
        One for each level, rising.
    """
    if figure in _RECORDS:
        return [_of_campaign(_RECORDS[figure], seed)]
    rng = np.random.default_rng([seed, figure])
    plane: Plane = "yaw" if figure == 14 else "pitch"
    shape = sine(9.8 if plane == "yaw" else 9.2, rng=rng)
    top = _moment_of_bias(plane, shape, rng)
    levels = np.arange(1, _LEVELS + 1) / _LEVELS * top
    return [_recorded(plane, shape, float(level), rng) for level in levels]


def _of_campaign(name: str, seed: int) -> StudyRecord:
    """Simulate the channels of one of the paper's campaign's records."""
    campaign = load_campaign("paper")
    point = next(point for point in campaign.points if point.name == name)
    acquired = point_acquisition(campaign, point, seed=seed)
    return StudyRecord(
        AcquisitionRecord(name, acquired.channels),
        static_deg=float(acquired.truth["static_pitch_deg"][0]),
        off_s=None if point.series is None else point.series.shaker_off,
    )


def survey_shapes(*, seed: int = 0) -> list[ModeShape]:
    """Simulate a modal survey with random excitation in both planes and identify its modes.

    Parameters
    ----------
    seed : int
        Of noise and excitation.

    Returns
    -------
    list of ModeShape
        Of both planes.
    """
    system = paper_model_system().model_copy(update={"shaker_station": _SURVEY_STATION_M})
    shapes: list[ModeShape] = []
    for plane in ("yaw", "pitch"):
        rng = np.random.default_rng([seed, ord(plane[0])])
        force = random_band(rng=rng).scaled(_SURVEY_FORCE_N)
        record = _acquired(system, plane, force, rng, duration_s=_SURVEY_S, name=f"survey-{plane}")
        reference = "analyser_force_y" if plane == "yaw" else "analyser_force_z"
        shapes += survey_record(record, reference, plane)
    return shapes


def _moment_of_bias(plane: Plane, shape: Tones, rng: np.random.Generator) -> float:
    """Peak-to-peak moment [in lbf] that gives the figure's largest bias, from a trial."""
    trial = 4000.0
    one = _recorded(plane, shape, trial, rng)
    package = one.record["aoa_filtered"]
    late = package.time_s > package.time_s[-1] / 2
    bias = np.degrees(np.arcsin(package.values("g_0")[late])).mean() - one.static_deg
    return float(trial * np.sqrt(_LARGEST[plane] / abs(bias)))


def _recorded(
    plane: Plane, shape: Tones, moment_in_lb: float, rng: np.random.Generator
) -> StudyRecord:
    """Scale a shaker signal to a balance moment, peak to peak, and record it."""
    system = paper_model_system()
    moment = balance_moment(system, shape, modal_angles(system, shape, plane), plane)
    level = moment_in_lb * _IN_LB / peak_to_peak(moment, duration_s=_RECORD_S)
    name = f"{plane}-{moment_in_lb:.0f}"
    record = _acquired(system, plane, shape.scaled(level), rng, duration_s=_RECORD_S, name=name)
    return StudyRecord(record, static_deg=0.0)


def _acquired(
    system: ModelSystem,
    plane: Plane,
    force: Tones,
    rng: np.random.Generator,
    *,
    duration_s: float,
    name: str,
) -> AcquisitionRecord:
    static = StaticMotion(paper_scene(), 0.0)
    acquired = acquire(
        system,
        ModalMotion(static, system, modal_angles(system, force, plane)),
        static,
        forces={plane: force},
        recording=Recording(duration_s=duration_s, oversampling=_OVERSAMPLING),
        rng=rng,
    )
    return AcquisitionRecord(name, acquired.channels)
