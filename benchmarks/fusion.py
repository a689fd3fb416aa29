"""Fuse the points of a simulated campaign and hold every sample against the true motion.

Beside the optical angle alone at the fields, and beside what the inertial channels give without
fusion over the whole record: the kinematic dynamic pitch (accelerometers, integrated twice over 4
to 60 Hz) on the corrected mean. Run with ``python -m benchmarks.fusion SETUP CAMPAIGN POINT...``,
CAMPAIGN being what the points were simulated from, such as demo, with seed 0.
"""

import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glint_aoa.fusion import FusedAttitude, OpticalAngles, fuse
from glint_aoa.inertial import correct
from glint_aoa.inertial.channels import package_output
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.inertial.filters import integrate_band
from glint_aoa.inertial.motion import plane_motions
from glint_aoa.process import load_sweep, measure_point
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.formats import open_acquisition, open_fields
from glint_aoa.records.formats.hdf5 import read_truth
from glint_aoa.setup import Inertial, Setup, load_setup
from render_sim.campaign import load_campaign, point_motion, point_scene
from render_sim.campaign_file import Campaign, scene_of
from render_sim.film import attitude

Floats = NDArray[np.float64]

_BAND_HZ = (4.0, 60.0)
_FOG_S = (0.75, 3.75)
_SAME = 1e-3  # deg: a field's truth is the mean over its exposure


@dataclass(frozen=True, eq=False)
class Held:
    """A point held against the truth; angles in degrees, errors as rms.

    `in_fog` is the largest error within three seconds whose fields are taken away; NaN where the
    video is shorter than four.
    """

    name: str
    fused: FusedAttitude
    error: Floats
    at_fields: float
    optical: float
    kinematic: float
    seconds: float
    in_fog: float

    @property
    def inside(self) -> float:
        """Share of the samples whose 95 % interval holds the truth."""
        return float(np.mean(np.abs(self.error) <= 1.96 * self.fused.pitch_std_deg))


def rms(values: Floats) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def true_pitch(campaign: Campaign, name: str, time_s: Floats) -> Floats:
    """Pitch of a campaign's point at times after the trigger [deg]."""
    point = next(each for each in campaign.points if each.name == name)
    scene = point_scene(point, scene_of(campaign))
    motion = point_motion(campaign, point, scene=scene).motion
    return np.asarray(np.degrees(attitude(scene, motion.pose(time_s))[0]))


def kinematic_pitch(record: AcquisitionRecord, inertial: Inertial) -> Floats:
    """Corrected mean and dynamic pitch of the inertial channels alone [deg]."""
    package = package_output(record)
    task = CorrectionTask(record, package, (), inertial.filter)
    level = np.zeros(package.specific_force.size)
    rate = plane_motions(task, ["pitch"], level)["pitch"].rate
    low, high = _BAND_HZ
    dynamic = integrate_band(rate, package.channel.rate_hz, low_hz=low, high_hz=high)
    corrected = correct(record, inertial, method="kinematic")
    return np.asarray(corrected.angle_deg[corrected.settled].mean() + np.degrees(dynamic))


def optical_angles(path: Path, setup: Setup) -> OpticalAngles:
    """Measure the fields of a point."""
    result = measure_point(open_fields(path), setup, sweep=load_sweep(setup))
    exposure_s = float(result.attrs["exposure_s"])
    return OpticalAngles.of_fields(result.values, exposure_s=exposure_s, is_swept=True)


def hold(path: Path, setup: Setup, campaign: Campaign) -> Held:
    """Fuse a point and hold it against its truth."""
    record, optical = open_acquisition(path), optical_angles(path, setup)
    started = time.process_time()
    fused = fuse(record, optical, setup)
    seconds = time.process_time() - started
    truth = true_pitch(campaign, path.stem, fused.time_s)
    error, good = fused.pitch_deg - truth, optical.good
    filmed = read_truth(path)["pitch_deg"]
    if not np.allclose(filmed, true_pitch(campaign, path.stem, optical.time_s), rtol=0, atol=_SAME):
        sys.exit(f"{path}: not simulated from this campaign as it is now; simulate it again")
    alone = optical.angle_deg - filmed
    return Held(
        path.stem,
        fused,
        error,
        at_fields=rms(np.interp(optical.time_s[good], fused.time_s, error)),
        optical=rms(alone[good]),
        kinematic=rms(kinematic_pitch(record, setup.inertial) - truth),
        seconds=seconds,
        in_fog=_in_fog(record, optical, setup, truth),
    )


def _in_fog(
    record: AcquisitionRecord, optical: OpticalAngles, setup: Setup, truth: Floats
) -> float:
    since = optical.time_s - optical.time_s[0]
    if since[-1] < _FOG_S[1] + 0.5:
        return np.nan
    lost = (since > _FOG_S[0]) & (since < _FOG_S[1])
    fused = fuse(
        record, replace(optical, angle_deg=np.where(lost, np.nan, optical.angle_deg)), setup
    )
    inside = (fused.time_s > _FOG_S[0]) & (fused.time_s < _FOG_S[1])
    return float(np.abs(fused.pitch_deg - truth)[inside].max())


def _line(held: Held) -> str:
    radii = ", ".join(
        f"{mode.plane} {mode.frequency_hz:.1f} Hz {mode.radius_m / 0.0254:.2f} in"
        for mode in held.fused.modes
    )
    fog = "" if np.isnan(held.in_fog) else f"; largest error in 3 s of fog {held.in_fog:.5f}"
    return (
        f"{held.name:<24}{held.at_fields:>10.5f}{held.optical:>10.5f}{rms(held.error):>10.5f}"
        f"{held.kinematic:>10.5f}{held.fused.pitch_std_deg.mean():>10.5f}{100 * held.inside:>8.1f}"
        f"{held.fused.time_s.size / 800 / held.seconds:>7.0f}  {radii}{fog}"
    )


def main() -> int:
    """Print one line a point and the whole; 1 unless both errors are a third of the others."""
    setup, campaign = load_setup(Path(sys.argv[1])), load_campaign(sys.argv[2])
    print(
        f"{'point':<24}{'at fields':>10}{'optical':>10}{'record':>10}{'kinematic':>10}{'std':>10}"
        f"{'in 95 %':>8}{'speed':>7}  radii"
    )
    points = []
    for name in sys.argv[3:]:
        points.append(hold(Path(name), setup, campaign))
        print(_line(points[-1]), flush=True)
    at_fields, optical = (
        rms(np.array([getattr(each, what) for each in points])) for what in ("at_fields", "optical")
    )
    record = rms(np.array([rms(each.error) for each in points]))
    kinematic = rms(np.array([each.kinematic for each in points]))
    print(
        f"rms over {len(points)} points: {at_fields:.5f} at the fields, optical {optical:.5f}; "
        f"{record:.5f} over the record, kinematic {kinematic:.5f}"
    )
    return 0 if 3 * at_fields <= optical and 3 * record <= kinematic else 1


if __name__ == "__main__":
    sys.exit(main())
