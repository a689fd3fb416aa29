"""Monte Carlo of the fusion: do its intervals cover the true attitude and the true radii.

Each draw is a record of its own, felt through the simulator's rigid-body kinematics (positions
differentiated; no formula of a bias): modes of Table 1 under a sine, a modulated sine or random
forces in one plane or both, yaw modes that nod, gains, directions and noise of every accelerometer,
the package's bias and noise, and optical angles with noise, an offset, a scale and a part of yaw.
One instant of each record, anywhere in it, is held against the truth, and the radii of modes 1
and 2. Run with ``python -m benchmarks.fusion_coverage [STUDY ...] [--draws N] [--seed N]``.
"""

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks._draws import BAND, WITHIN, chosen
from glint_aoa.fusion import Assumed, FusedAttitude, OpticalAngles, fuse
from glint_aoa.inertial.estimate import MISALIGNMENT_STD
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.setup import Setup
from glint_aoa.units import STANDARD_GRAVITY
from render_sim.excitation import Tones, modulated_sine, random_band, sine
from render_sim.film import attitude
from render_sim.kinematics import BodyKinematics, body_kinematics
from render_sim.modal_motion import ModalMotion
from render_sim.modes import ModelSystem, Plane, joint_angles, paper_model_system
from render_sim.motion import Motion, StaticMotion
from render_sim.scene import Scene, paper_scene

Floats = NDArray[np.float64]

RATE_HZ = 800.0
OVERSAMPLING = 2  # motion to 60 Hz, differentiated at 1600 Hz by the eighth order
STATIONS_M = {"face": 0.9, "mid": 0.55, "aft": 0.1}
FIELD_HZ, EXPOSURE_S = 60.0, 1e-3
FIELD_STD_DEG = 0.0009
OFFSET_STD_DEG = 1e-4
YAW_STD, SCALE_STD = 0.03, 1e-3  # of the optical angle
ACCELEROMETER_NOISE = 0.5e-3 * STANDARD_GRAVITY
PACKAGE_NOISE = 50e-6 * STANDARD_GRAVITY
ASSUMED = Assumed()


@dataclass(frozen=True)
class Study:
    """What is drawn.

    Attributes
    ----------
    duration_s : float
        Length of each record [s].
    video_s : float
        Length of the video, which starts anywhere in it [s]; 0 for none.
    places : tuple of str
        Where accelerometers sit, one a plane at each.
    """

    duration_s: float = 3.0
    video_s: float = 1.0
    places: tuple[str, ...] = ("face", "mid", "aft")


STUDIES = {
    "video": Study(),
    "no-video": Study(video_s=0.0),
    "two-stations": Study(places=("face", "mid")),
}


@dataclass(frozen=True, eq=False)
class Draws:
    """Errors and standard uncertainties [draw] of one quantity of a study."""

    quantity: str
    error: Floats
    std: Floats

    @property
    def known(self) -> NDArray[np.bool_]:
        """Draws that gave the quantity."""
        return np.isfinite(self.error) & np.isfinite(self.std)

    @property
    def coverage(self) -> float:
        """Share of the 95 % intervals that hold the truth."""
        inside = np.abs(self.error) <= WITHIN * self.std
        return float(np.mean(inside[self.known]))


def run(study: Study, draws: int, *, seed: int = 1) -> list[Draws]:
    """Fuse that many independent records and hold one instant of each against the truth."""
    rows = np.array([one(study, np.random.default_rng([seed, n])) for n in range(draws)])
    names = ("pitch", "yaw", "radius of mode 1", "radius of mode 2")
    return [Draws(name, rows[:, 2 * i], rows[:, 2 * i + 1]) for i, name in enumerate(names)]


def one(study: Study, rng: np.random.Generator) -> list[float]:
    """Errors and standard uncertainties of pitch, yaw [deg] and two radii [relative] of a draw."""
    system, scene = paper_model_system(), paper_scene()
    pitch_deg = rng.uniform(-5.0, 10.0)
    static = StaticMotion(scene, np.radians(pitch_deg))
    forces = _forces(system, rng)
    motion = ModalMotion(static, system, joint_angles(system, forces))
    record = _record(study, motion, rng)
    found = fuse(record, _optical(study, scene, motion, rng), Setup(), assumed=ASSUMED)
    at = int(rng.integers(found.time_s.size))
    truth = [np.degrees(float(x[0])) for x in attitude(scene, motion.pose(found.time_s[[at]]))[:2]]
    rest = np.degrees(float(attitude(scene, static.pose(np.zeros(1)))[1][0]))
    return [
        found.pitch_deg[at] - truth[0],
        found.pitch_std_deg[at],
        found.yaw_deg[at] - (truth[1] - rest),
        found.yaw_std_deg[at],
        *_radius(found, system, "yaw", forces),
        *_radius(found, system, "pitch", forces),
    ]


def _forces(system: ModelSystem, rng: np.random.Generator) -> dict[Plane, Tones]:
    """Drive one plane or both near the first resonance, or at random; forces in newtons."""
    planes: Sequence[Sequence[Plane]] = [("yaw",), ("pitch",), ("yaw", "pitch")]
    kind = rng.choice(["sine", "modulated", "random"])
    forces = {}
    for plane in planes[rng.integers(3)]:
        at = system.modes_in(plane)[0].frequency * (1 + rng.uniform(-0.01, 0.01))
        if kind == "sine":
            force = sine(at, rng=rng).scaled(10 ** rng.uniform(0.0, 1.0))
        elif kind == "modulated":
            force = modulated_sine(at, rng=rng).scaled(10 ** rng.uniform(0.0, 1.0))
        else:
            force = random_band(period_s=16.0, rng=rng).scaled(10 ** rng.uniform(1.0, 1.8))
        forces[plane] = force
    return forces


def _record(study: Study, motion: Motion, rng: np.random.Generator) -> AcquisitionRecord:
    samples = round(study.duration_s * RATE_HZ)
    fine = body_kinematics(
        motion, start_s=0.0, samples=samples * OVERSAMPLING, rate_hz=RATE_HZ * OVERSAMPLING
    )
    bias = STANDARD_GRAVITY * np.radians(rng.normal(0.0, ASSUMED.package_std_deg))
    axial = _felt(fine, STATIONS_M["face"])[:, 0] + bias
    channels = [_channel("aoa_unfiltered", axial, PACKAGE_NOISE, "face", "+x", rng)]
    for place in study.places:
        felt = _felt(fine, STATIONS_M[place])
        for axis, along, across in (("y", 1, 2), ("z", 2, 1)):
            gain = 1 + rng.normal(0.0, ASSUMED.gain_std)
            to_side, to_nose = rng.normal(0.0, MISALIGNMENT_STD, 2)
            signal = gain * (felt[:, along] + to_side * felt[:, across] + to_nose * felt[:, 0])
            name = f"a{axis}_{place}"
            channels.append(_channel(name, signal, ACCELEROMETER_NOISE, place, f"+{axis}", rng))
    return AcquisitionRecord("draw", {channel.name: channel for channel in channels})


def _felt(body: BodyKinematics, station_m: float) -> Floats:
    return body.specific_force(station_m)[::OVERSAMPLING]


def _channel(
    name: str, values: Floats, noise: float, place: str, axis: str, rng: np.random.Generator
) -> Channel:
    return Channel(
        name=name,
        samples=values + rng.normal(0.0, noise, values.size),
        rate_hz=RATE_HZ,
        quantity="aoa_unfiltered" if axis == "+x" else "acceleration",
        units="m/s^2",
        station_m=STATIONS_M[place],
        axis=axis,
    )


def _optical(
    study: Study, scene: Scene, motion: Motion, rng: np.random.Generator
) -> OpticalAngles | None:
    """Angles of fields with noise, offset, scale and a part of yaw."""
    if not study.video_s:
        return None
    start = rng.uniform(0.0, study.duration_s - study.video_s)
    middle = start + np.arange(round(study.video_s * FIELD_HZ)) / FIELD_HZ + EXPOSURE_S / 2
    within = (np.arange(5) - 2) / 5 * EXPOSURE_S
    pitch, yaw, _ = attitude(scene, motion.pose(middle[:, None] + within))
    pitch, yaw = np.degrees(pitch.mean(axis=1)), np.degrees(yaw.mean(axis=1))
    rest = np.median(pitch)
    shown = (
        rest + (1 + rng.normal(0.0, SCALE_STD)) * (pitch - rest) + rng.normal(0.0, YAW_STD) * yaw
    )
    shown += rng.normal(0.0, OFFSET_STD_DEG) + rng.normal(0.0, FIELD_STD_DEG, shown.size)
    return OpticalAngles(
        time_s=middle,
        angle_deg=shown,
        std_deg=np.full(shown.size, FIELD_STD_DEG),
        flags=np.zeros(shown.size, np.int64),
        exposure_s=EXPOSURE_S,
        systematic_std_deg=OFFSET_STD_DEG,
    )


def _radius(
    found: FusedAttitude, system: ModelSystem, plane: Plane, driven: Mapping[Plane, Tones]
) -> tuple[float, float]:
    """Relative error and uncertainty of the radius of a driven plane's first mode."""
    mode = system.modes_in(plane)[0]
    if plane not in driven:
        return np.nan, np.nan
    for each in found.modes:
        if each.plane == plane and abs(each.frequency_hz - mode.frequency) < 0.3:
            return each.radius_m / mode.radius - 1, each.radius_std_m / mode.radius
    return np.nan, np.nan


def _line(study: str, result: Draws, seconds: float) -> str:
    known = result.known
    error, std = result.error[known], result.std[known]
    verdict = "covers" if result.coverage >= BAND[0] else "DOES NOT COVER"
    if result.coverage > BAND[1]:
        verdict = "covers, wider than need be"
    return (
        f"{study:<14}{result.quantity:<18}{known.sum():>6}{100 * result.coverage:>9.1f}"
        f"{np.sqrt(np.mean(error**2)):>11.6f}{np.median(std):>11.6f}"
        f"{np.sqrt(np.mean((error / std) ** 2)):>9.2f}{seconds:>7.0f}  {verdict}"
    )


def main() -> int:
    """Print one line a quantity; 1 if an interval of pitch covers too little."""
    options = chosen(__doc__, STUDIES)
    print(
        f"{'study':<14}{'quantity':<18}{'draws':>6}{'in 95 %':>9}{'rms':>11}{'std':>11}"
        f"{'err/std':>9}{'s':>7}"
    )
    good = True
    for study in options.studies:
        started = time.perf_counter()
        found = run(STUDIES[study], options.draws, seed=options.seed)
        for result in found:
            print(_line(study, result, time.perf_counter() - started), flush=True)
        good &= found[0].coverage >= BAND[0]
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
