"""Attitude of a wind-tunnel model from video of a glint, held against its inertial sensor.

Examples
--------
>>> import glint_aoa
>>> setup = glint_aoa.load_setup("glint-aoa.toml")
>>> point = glint_aoa.process_point("point-01.h5", setup, "results")
>>> point.log["mean_angle_deg"], point.log["mean_angle_u95_deg"]
"""

from typing import Any

__all__ = [
    "__version__",
    "load_setup",
    "measure_point",
    "open_fields",
    "process_point",
]

_HOMES = {
    "__version__": "glint_aoa._version",
    "load_setup": "glint_aoa.setup",
    "measure_point": "glint_aoa.process",
    "open_fields": "glint_aoa.records.formats",
    "process_point": "glint_aoa.process",
}


def __getattr__(name: str) -> Any:
    """Load a public function when it is first used, so that the import itself stays light."""
    if name not in _HOMES:
        raise AttributeError(f"module 'glint_aoa' has no attribute {name!r}")
    import importlib  # noqa: PLC0415

    return getattr(importlib.import_module(_HOMES[name]), name)
