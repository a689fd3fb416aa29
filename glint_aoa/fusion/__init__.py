"""Video and inertial channels of a point in one estimate: attitude at every sample.

`fuse` takes an acquisition record and the angles of the fields of the same point; `write_fused`
writes what it returns.
"""

from glint_aoa.fusion.attitude import fuse
from glint_aoa.fusion.inputs import Assumed, OpticalAngles
from glint_aoa.fusion.modal_radii import FusedMode
from glint_aoa.fusion.output import fused_files, write_fused
from glint_aoa.fusion.result import FusedAttitude

__all__ = [
    "Assumed",
    "FusedAttitude",
    "FusedMode",
    "OpticalAngles",
    "fuse",
    "fused_files",
    "write_fused",
]
