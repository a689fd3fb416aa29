"""Setups of which an uncertainty budget is made, and a measurement with numpy's line fit."""

import tomllib

import numpy as np

from benchmarks.budget_coverage import COLUMNS
from calibration.budget.uncertainty import uncertainty_budget
from calibration.sweep.fit import fit_sweep
from glint_aoa.geometry import PixelToPlane
from glint_aoa.setup import Setup

ALIGNED = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [375.5, 119.5]
position = ["0 m", "-1.4 m", "60 mm"]
[glint]
"""
TURNED = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [370.5, 117.5]
position = ["20 mm", "-1.4 m", "60 mm"]
rotation = ["1 deg", "-0.5 deg", "2 deg"]
distortion = [-0.15, 0.1, 0.001, -0.001, 0.05]
[glint]
y = "-20 mm"
yaw = "1.5 deg"
"""
EVERYTHING = """
[uncertainty]
focal_length = "0.1 mm"
pixel_pitch = ["0.01 um", "0.05 um"]
principal_point = [4, 3]
distortion = [0.03, 0.05, 0.0005, 0.0005, 0.1]
position = ["5 mm", "4 mm", "3 mm"]
rotation = ["0.3 deg", "0.1 deg", "0.3 deg"]
y = "2 mm"
yaw = "0.2 deg"
"""
NAMES = (
    "principal distance",
    "pixel pitch, horizontal",
    "pixel pitch, vertical",
    "principal point u",
    "principal point v",
    *(f"distortion {name}" for name in ("k1", "k2", "p1", "p2", "k3")),
    *(f"position {name}" for name in "XYZ"),
    *(f"rotation {name}" for name in ("omega", "phi", "kappa")),
    "known Y",
    "yaw",
)
STEPS = [1e-5, 1e-9, 1e-9, *[0.02] * 2, 1e-3, 1e-2, 1e-4, 1e-4, 0.1, *[1e-4] * 3, *[1e-4] * 5]
PER_SI = [1e3, 1e6, 1e6, 1, 1, *[1] * 5, *[1e3] * 3, *[np.degrees(1)] * 3, 1e3, np.degrees(1)]


def setup_of(text):
    return Setup.model_validate(tomllib.loads(text))


def budget_of(text, angles=(3.0,), **how):
    how = {"draws": 1000, "intercepts_m": [0.1]} | how
    return uncertainty_budget(setup_of(text), angles, **how)


def rows_of(budget):
    return {row.source: row for row in budget.rows}


def nominal_angle(setup, rows):
    """Measure with the setup, by numpy's line fit."""
    to_plane = PixelToPlane.of_camera(setup.camera, y=setup.glint.y, yaw=setup.glint.yaw)
    slope, intercept = np.polyfit(*to_plane(COLUMNS, rows), 1)
    return np.degrees(-np.arctan(slope)), intercept


def swept(setup, coefficients=(0.05, 1.0), *, degree=1, **how):
    """A sweep of which the nominal camera is the truth: onboard is a polynomial of optical."""
    optical = np.arange(-7.0, 7.1, 1.0)
    onboard = np.polynomial.polynomial.polyval(optical, coefficients)
    return fit_sweep(optical, 4e-4, onboard, 1e-3, degree=degree, **how)
