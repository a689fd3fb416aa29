"""A small campaign with its results, as the commands write them, for the tests of the report."""

import numpy as np
from synthetic import line_fields

from calibration.sweep.fit import fit_sweep
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point

SETUP = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [200, 240]
principal_point = [99.5, 118]
position = ["0 m", "-56 in", "0 mm"]

[[inertial.mode]]
number = 1
plane = "yaw"
frequency = "9.8 Hz"
radius = "31 in"

[calibration]
sweep = "sweep.toml"

[uncertainty]
y = "1 mm"
"""
NAMES = ("run-0", "run-<script>1", "run-$2$")
NASTY = '<script>alert("run")</script> & $\\frac'
RATE_HZ, SECONDS, ARM_M = 200.0, 16.0, 31 * 0.0254


def channels(rng, shake):
    """A package and one accelerometer on a level model that yaws about a point 31 in behind it."""
    time_s = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    pulse = 2 * np.pi * 9.8
    rate = shake * pulse * np.cos(pulse * time_s)
    aoa = -ARM_M * rate**2 / 9.80665 + rng.normal(0, 1e-5, time_s.size)
    ay = -ARM_M * shake * pulse**2 * np.sin(pulse * time_s) + rng.normal(0, 1e-3, time_s.size)
    package = Channel("aoa", aoa, RATE_HZ, quantity="aoa_unfiltered", units="g_0")
    face = Channel(
        "ay_face", ay, RATE_HZ, quantity="acceleration", units="m/s^2", station_m=0.9, axis="+y"
    )
    return AcquisitionRecord("das", {each.name: each for each in (package, face)})


def record(path, number, *, shake, run=NASTY, n_fields=12):
    rng = np.random.default_rng(number)
    fields = line_fields(rng, n_fields=n_fields, shape=(40, 200), row=20.0)
    meta = {
        "run": run,
        "point": path.stem,
        "excitation": "yaw sine 9.8 Hz" if shake else "off",
        "nominal_angle_deg": 0.0,
    }
    info = FieldInfo(
        rate_hz=60.0,
        exposure_s=1e-3,
        first_line=98,
        interlaced=False,
        trigger_time=f"2026-01-12T08:0{number}:00",
    )
    write_point(path, RecordedPoint(fields, info, acquisition=channels(rng, shake), meta=meta))


def write_campaign(folder):
    """Write a setup, a pitch sweep, and a run of three points whose names are hard to take."""
    (folder / "points").mkdir()
    (folder / "glint-aoa.toml").write_text(SETUP)
    angles = np.linspace(-6.0, 6.0, 7)
    noise = np.random.default_rng(5).normal(0, 1e-4, angles.size)
    fit_sweep(angles, 1e-4, 1.01 * angles + noise, 1e-4, degree=1).save(folder / "sweep.toml")
    paths = [folder / "points" / f"{name}.h5" for name in NAMES]
    for number, (path, shake) in enumerate(zip(paths, (0.0, 0.002, 0.0), strict=True)):
        record(path, number, shake=shake)
    return paths
