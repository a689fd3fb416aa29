"""What comes out of the fusion."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glint_aoa.fusion.modal_radii import FusedMode

__all__ = ["FusedAttitude"]

_Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FusedAttitude:
    """Attitude of the model at the samples of the acquisition.

    Attributes
    ----------
    time_s : ndarray [sample]
        Time after the trigger [s].
    pitch_deg, pitch_std_deg : ndarray [sample]
        Instantaneous pitch, nose up positive, and its standard deviation [deg].
    yaw_deg, yaw_std_deg : ndarray [sample]
        Heading about the setup's and its standard deviation [deg]; slow changes of heading are not
        seen. NaN without accelerometers along y.
    pitch_yaw_covariance_deg2 : ndarray [sample]
        Of pitch and yaw [deg^2].
    flags : ndarray [sample]
        Bit mask of `glint_aoa.flags.Flag`; 0 is good.
    modes : list of FusedMode
        Those that moved, with their effective radii.
    unknowns : dict of str to (float, float)
        Gains, directions, biases: value and standard deviation, in SI units and radians.
    consistency : dict of str to float
        Mean squared innovation over its variance, by source; near 1, or below, the model holds.
    notes : list of str
        What is not as it should be.
    settings : dict
        Figures behind the result.
    """

    time_s: _Floats
    pitch_deg: _Floats
    pitch_std_deg: _Floats
    yaw_deg: _Floats
    yaw_std_deg: _Floats
    pitch_yaw_covariance_deg2: _Floats
    flags: NDArray[np.int64]
    modes: list[FusedMode]
    unknowns: dict[str, tuple[float, float]]
    consistency: dict[str, float]
    notes: list[str] = field(default_factory=list)
    settings: Mapping[str, object] = field(default_factory=dict)
