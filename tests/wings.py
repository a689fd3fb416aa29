"""A small wing to film: two stations with targets, seen by a turned camera of paper's kind."""

from dataclasses import replace

import cv2
import numpy as np

from calibration.photographs import Photograph
from calibration.twist.wing_targets import WingTargets
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.setup import Camera, Glint, Setup
from render_sim.projection import Pinhole
from render_sim.scene import Sensor, paper_scene
from render_sim.wing import WingSection, render_wing

Y_MM = {"body": -50.0, "tip": 150.0}
RADIUS = 0.0055
CAMERA = Camera.model_validate(
    {
        "focal_length": "35 mm",
        "pixel_pitch": ["11.7 um", "27.5 um"],
        "sensor": [752, 240],
        "principal_point": [375.5, 119.5],
        "position": ["0 m", "-56 in", "60 mm"],
        "rotation": ["2 deg", "-1 deg", "1.5 deg"],
        "distortion": [-0.1, 0.02, 1e-3, -5e-4, 0.0],
    }
)
FIRST_LINE, ROWS = 60, 170
SCENE = replace(
    paper_scene(),
    camera=CAMERA,
    sensor=Sensor(rows=ROWS, columns=752),
    fields=paper_scene().fields.model_copy(update={"first_line": FIRST_LINE}),
)
SETUP = Setup(camera=CAMERA, glint=Glint(nose="left"))
TOML = f"""
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [375.5, 119.5]
position = ["0 m", "-56 in", "60 mm"]
rotation = ["2 deg", "-1 deg", "1.5 deg"]
distortion = [-0.1, 0.02, 1e-3, -5e-4, 0.0]

[fields]
first_line = {FIRST_LINE}

[glint]
nose = "left"
"""


def sections(count=6):
    """Two rows of targets along the chord, the tip's shorter and lower in the picture."""
    rows = []
    for number, y in enumerate(Y_MM.values()):
        x = np.linspace(-0.11, 0.12 - 0.03 * number, count)
        z = 0.10 - 0.06 * number + 0.006 * np.sin(2.0 * np.arange(count))
        rows.append(WingSection(np.stack([x, np.full(count, y / 1e3), z], axis=1), RADIUS))
    return rows


def flown(rows, twists_deg, nose="left"):
    """The same with flow: turned about axes off the middle, and bent up."""
    axes, shifts = ((0.03, 0.2), (-0.05, 0.1)), ((0.0, 0.0, 0.001), (0.002, 0.0, 0.008))
    return [
        row.twisted(np.radians(twist), axis_m=axis, nose=nose, shift_m=shift)
        for row, twist, axis, shift in zip(rows, twists_deg, axes, shifts, strict=True)
    ]


def pixels(rows):
    """Sensor columns and lines of all targets, by the simulator's camera."""
    centres = np.concatenate([row.centres_m for row in rows])
    return np.stack(Pinhole.of(SCENE).project(centres), axis=-1)


def targets(rows, **changes):
    """The list of targets, start places rounded and off by some pixels."""
    count = len(rows[0].centres_m)
    values = {
        "ids": tuple(f"{name}-{k}" for name in Y_MM for k in range(count)),
        "station": tuple(np.repeat(list(Y_MM), count).tolist()),
        "y": np.repeat(np.array(list(Y_MM.values())) / 1e3, count),
        "start": np.round(pixels(rows)) + np.array([9, -3]),
        "radius": np.full(2 * count, RADIUS),
        "normal": np.tile([0.0, 1.0, 0.0], (2 * count, 1)),
    }
    return WingTargets(**{**values, **changes})


def photographs(rows, fields, rng, **light):
    """Fields of alternating parity."""
    return [
        Photograph(
            name=f"field {k}",
            source="drawn",
            grey=render_wing(SCENE, rows, parity=k % 2, rng=rng, **light).astype(np.float32),
            parity=k % 2,
            first_line=FIRST_LINE,
        )
        for k in range(fields)
    ]


def write_recording(path, rows, fields, rng):
    stack = np.stack([render_wing(SCENE, rows, parity=k % 2, rng=rng) for k in range(fields)])
    info = FieldInfo(
        rate_hz=60.0,
        exposure_s=1e-3,
        interlaced=True,
        first_parity="even",
        first_line=FIRST_LINE,
        first_column=0,
    )
    write_point(
        path,
        RecordedPoint(
            fields=stack, info=info, fields_time_s=None, acquisition=None, truth={}, meta={}
        ),
    )


def write_image(path, rows, rng):
    """An even field as a PNG."""
    cv2.imwrite(str(path), render_wing(SCENE, rows, rng=rng))


def write_table(path, wing):
    rows = [
        f"{name},{station},{1e3 * y:.6g},{u:.0f},{v:.0f},{1e3 * radius:.6g}"
        for name, station, y, (u, v), radius in zip(
            wing.ids, wing.station, wing.y, wing.start, wing.radius, strict=True
        )
    ]
    path.write_text("\n".join(["id,station,y [mm],u,v,radius [mm]", *rows]) + "\n")
