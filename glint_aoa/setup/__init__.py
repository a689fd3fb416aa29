"""The setup file ``glint-aoa.toml``: camera, fields, glint, inertial package, calibration.

Every model is frozen and holds SI units and radians; units stand in the file's strings only.
"""

from glint_aoa.setup.calibration import Calibration, ReflectionUncertainty, Uncertainty
from glint_aoa.setup.camera import Camera, Fields
from glint_aoa.setup.glint import Glint, Reference, Reflection
from glint_aoa.setup.inertial import (
    Axis,
    Inertial,
    InertialChannel,
    InertialFilter,
    InertialMode,
    InertialSensor,
    Quantity,
)
from glint_aoa.setup.plan import Plan, PlanVibration
from glint_aoa.setup.section import Section, load_section, positive, quantity, read_toml
from glint_aoa.setup.whole import Setup, load_setup

__all__ = [
    "Axis",
    "Calibration",
    "Camera",
    "Fields",
    "Glint",
    "Inertial",
    "InertialChannel",
    "InertialFilter",
    "InertialMode",
    "InertialSensor",
    "Plan",
    "PlanVibration",
    "Quantity",
    "Reference",
    "Reflection",
    "ReflectionUncertainty",
    "Section",
    "Setup",
    "Uncertainty",
    "load_section",
    "load_setup",
    "positive",
    "quantity",
    "read_toml",
]
