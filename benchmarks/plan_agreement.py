"""A plan against what simulation then measures: noise, range of angle, place of the glint.

The plan knows camera, body and lamp from a setup, and the body's brightness beside the glint in one
layout, as an engineer would read it off one picture. Everything else it predicts; the simulator
renders the same layouts by ray casting and the measurement runs on them.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.flags import Flag
from glint_aoa.optical.measure import fit_fields, measure_stack
from glint_aoa.plan import Layout, Prediction, forecast, predict
from glint_aoa.plan.predict import matte_radiance
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.recording import resolve_recording
from glint_aoa.setup import Setup
from render_sim.film import film
from render_sim.motion import Motion, StaticMotion
from render_sim.renderer import make_renderer
from render_sim.scene import Lamp, Scene, paper_scene

__all__ = ["Case", "measured_range", "noise", "planned", "predicted_range", "scene_of"]

_Array = NDArray[np.float64]

_FIELDS = 1600  # the noise is then known to 1.8 %
_LINES = 92
_STEP_DEG = 0.1


@dataclass(frozen=True)
class Case:
    """A layout, and at what pitch it is looked at."""

    name: str
    distance_m: float = 1.3734
    focal_length_mm: float = 35.0
    lamp_y_m: float = -0.6
    lamp_z_m: float = 1.5
    pitch_deg: float = 2.0
    lamp_length_m: float = 3.0
    lines: int = _LINES
    exposure_ms: float = 1.0
    vibration_deg: float = 0.0
    vibration_hz: float = 0.0


NOISE_CASES = (
    Case("the paper's"),
    Case("steeper", pitch_deg=-7.0),
    Case("camera near", distance_m=0.9),
    Case("camera far", distance_m=2.5),
    Case("16 mm lens", focal_length_mm=16.0),
    Case("75 mm lens", focal_length_mm=75.0),
    Case("lamp high", lamp_z_m=2.5),
    Case("lamp in front", lamp_y_m=-1.2, lamp_z_m=1.0),
    Case("lamp above", lamp_y_m=0.0),
    Case("far, 25 mm, lamp low", 2.747, 25.0, 0.0, 1.125),
    Case("short lamp", lamp_length_m=0.8),
    Case("shaken, long exposure", exposure_ms=10.0, vibration_deg=0.5, vibration_hz=20.0),
)
RANGE_CASES = (
    Case("window of 40 lines", lines=40),
    Case("60 lines, 75 mm lens", focal_length_mm=75.0, lines=60),
    Case("near, 16 mm, 40 lines", 0.9, 16.0, lines=40),
    Case("lamp of 1.6 m", lamp_length_m=1.6),
    Case("lamp of 1.0 m", lamp_length_m=1.0),
)


class _Shaken:
    """The scene's model, pitching by a sine about the point that the support keeps."""

    def __init__(self, scene: Scene, case: Case) -> None:
        self._scene, self._case = scene, case

    def pose(self, time_s: _Array) -> _Array:
        """Return the poses at the times; see `Motion.pose`."""
        case = self._case
        swing = case.vibration_deg * np.cos(2 * np.pi * case.vibration_hz * np.asarray(time_s))
        pitch = np.radians(case.pitch_deg + swing)
        poses = [StaticMotion(self._scene, float(p)).pose(np.zeros(())) for p in pitch.ravel()]
        return np.reshape(poses, (*pitch.shape, 4, 4))


def planned(case: Case) -> Setup:
    """Return the paper's setup with body, lamp and plan; its layout is not yet the case's."""
    plan: dict[str, Any] = {
        "angles": ["-6 deg", "6 deg"],
        "lines": case.lines,
        "lamp_length": f"{case.lamp_length_m} m",
        "background": 14.7,
    }
    if case.vibration_deg:
        plan["vibration"] = {
            "amplitude": f"{case.vibration_deg} deg",
            "frequency": f"{case.vibration_hz} Hz",
        }
    return Setup.model_validate(
        {
            "camera": {
                "focal_length": "35 mm",
                "pixel_pitch": ["11.7 um", "27.5 um"],
                "sensor": [752, 240],
                "position": ["0 m", "-56 in", "60 mm"],
            },
            "fields": {"first_line": 98, "rate": "60 Hz", "exposure": f"{case.exposure_ms} ms"},
            "glint": {
                "y": "-49 mm",
                "reflection": {"radius": "60 mm", "lamp": ["0 m", "-0.6 m", "1.5 m"]},
            },
            "plan": plan,
        }
    )


def predicted(setup: Setup, case: Case, angles_deg: _Array) -> tuple[Prediction, float]:
    """Return what a case's layout will show, and the radiance beside the glint."""
    present = Layout.of_setup(setup)
    ambient = matte_radiance(setup.plan, predict(setup, present, [0.0]))
    layout = present.moved(
        distance=case.distance_m, lamp_y=case.lamp_y_m, lamp_z=case.lamp_z_m
    ).with_lens(case.focal_length_mm / 1e3)
    level = predict(setup, layout, [0.0], ambient=ambient)
    layout = layout.with_window_about(float(np.nanmean(level.row[level.at(0.0)])))
    return predict(setup, layout, np.radians(angles_deg), ambient=ambient), ambient


def scene_of(layout: Layout, case: Case) -> Scene:
    """Return the simulator's scene of a layout: an endless tube, the paper's metal and sensor."""
    paper = paper_scene()
    lamp = Lamp(centre_m=layout.reflection.lamp, length_m=case.lamp_length_m, aim_m=(0.0, 0.0, 0.0))
    body = replace(paper.body, base_station_m=-10.0, shoulder_station_m=10.0, nose_station_m=11.0)
    exposure = {"exposure": case.exposure_ms / 1e3}
    return replace(
        paper,
        camera=layout.camera,
        lamp=lamp,
        body=body,
        fields=paper.fields.model_copy(update=exposure),
    ).with_window(layout.first_line, layout.lines)


def _measured_setup(setup: Setup, layout: Layout) -> Setup:
    """Return the setup with the camera, lamp and window of a layout."""
    fields = setup.fields.model_copy(update={"first_line": layout.first_line})
    glint = setup.glint.model_copy(update={"reflection": layout.reflection})
    return setup.model_copy(update={"camera": layout.camera, "fields": fields, "glint": glint})


@dataclass(frozen=True)
class Noise:
    """Predicted and measured noise of one field [deg], and places of the glint [lines]."""

    predicted_deg: float
    measured_deg: float
    place_error: float
    sigma: float
    error_deg: float

    @property
    def ratio(self) -> float:
        """Measured over predicted noise."""
        return self.measured_deg / self.predicted_deg


def noise(case: Case, *, fields: int = _FIELDS, seed: int = 1) -> Noise:
    """Predict and measure the noise of one field and the place of the glint.

    The place is compared in the first, the middle and the last measured column, over all fields
    of a model at rest; the largest difference counts.
    """
    setup = planned(case)
    prediction, _ = predicted(setup, case, np.array([-6.0, 0.0, case.pitch_deg, 6.0]))
    k = int(prediction.at(np.radians(case.pitch_deg))[0])
    scene = scene_of(prediction.layout, case)
    motion: Motion = StaticMotion(scene, float(np.radians(case.pitch_deg)))
    if case.vibration_deg:
        motion = _Shaken(scene, case)
    filmed = film(
        scene,
        motion,
        fields,
        renderer=make_renderer(scene),
        rng=np.random.default_rng(seed),
        sub_exposures=9 if case.vibration_deg else 1,
    )
    stack = FieldStack.from_array(filmed.fields, filmed.info)
    using = _measured_setup(setup, prediction.layout)
    angles, how = measure_stack(stack, using, resolve_recording(stack, using))
    error = np.degrees(angles.angle) - filmed.truth["pitch_deg"]
    columns = np.searchsorted(how.columns, prediction.layout.columns)
    centres, _ = fit_fields(stack.read(0, min(fields, 50)), angles.field[:50], how)
    lines = how.recording.line_of(centres.row, angles.field[: len(centres.row)])
    rows = np.nanmean(lines, axis=0)[columns]
    seen = np.flatnonzero(prediction.sees[k])[[0, prediction.sees[k].sum() // 2, -1]]
    return Noise(
        predicted_deg=float(np.degrees(prediction.std[k])),
        measured_deg=float(np.nanstd(error, ddof=1)),
        place_error=float(np.abs(rows - prediction.row[k])[seen].max()),
        sigma=float(prediction.sigma[k, seen[1]]),
        error_deg=float(np.nanmean(error)),
    )


def predicted_range(case: Case) -> tuple[float, float]:
    """Return the angles between which a plan says the glint is seen [deg]."""
    setup = planned(case)
    prediction, ambient = predicted(setup, case, np.array([0.0]))
    said = forecast(setup, prediction.layout, ambient=ambient, present_gain=prediction.gain)
    return said.visible.low_deg, said.visible.high_deg


def measured_range(
    case: Case, near: tuple[float, float], *, start: float = 0.8
) -> tuple[float, float]:
    """Find in rendered fields the angles between which enough columns are measured [deg].

    It is walked outward from `start` times the range `near`, until an angle is not measured.
    """
    setup = planned(case)
    prediction, _ = predicted(setup, case, np.array([0.0]))
    scene = scene_of(prediction.layout, case)
    using = _measured_setup(setup, prediction.layout)
    renderer = make_renderer(scene)
    least = setup.plan.least_columns * prediction.layout.columns.size

    def is_seen(pitch_deg: float) -> bool:
        filmed = film(
            scene,
            StaticMotion(scene, float(np.radians(pitch_deg))),
            4,
            renderer=renderer,
            rng=np.random.default_rng(1),
            sub_exposures=1,
        )
        stack = FieldStack.from_array(filmed.fields, filmed.info)
        angles, _ = measure_stack(stack, using, resolve_recording(stack, using))
        lost = (angles.flags & int(Flag.NO_GLINT)) != 0
        return bool(np.median(np.where(lost, 0, angles.columns_used)) >= least)

    ends = []
    for edge in near:
        pitch = start * edge
        while is_seen(pitch) and abs(pitch) < 20.0:
            pitch += np.copysign(_STEP_DEG, edge)
        ends.append(float(pitch - np.copysign(_STEP_DEG, edge)))
    return ends[0], ends[1]


def run() -> None:
    """Print the tables."""
    print(f"Noise of one field and place of the glint, {_FIELDS} fields at rest or shaken")
    header = ("", "sigma", "predicted", "measured", "ratio", "place off", "mean error")
    for cells in (header, ("", "lines", "deg", "deg", "", "lines", "deg")):
        print("{:24}{:>8}{:>12}{:>12}{:>8}{:>12}{:>12}".format(*cells))
    for number, case in enumerate(NOISE_CASES):
        got = noise(case, seed=number)
        print(
            f"{case.name:24}{got.sigma:8.2f}{got.predicted_deg:12.6f}{got.measured_deg:12.6f}"
            f"{got.ratio:8.3f}{got.place_error:12.3f}{got.error_deg:12.5f}",
            flush=True,
        )
    print("\nRange of angle that is seen [deg]")
    print("{:24}{:>20}{:>20}{:>8}".format("", "predicted", "measured", "ratio"))
    for case in RANGE_CASES:
        said = predicted_range(case)
        found = measured_range(case, said)
        ratio = (found[1] - found[0]) / (said[1] - said[0])
        cells = [f"{low:+.2f} to {high:+.2f}" for low, high in (said, found)]
        print(f"{case.name:24}{cells[0]:>20}{cells[1]:>20}{ratio:8.3f}", flush=True)


if __name__ == "__main__":
    run()
