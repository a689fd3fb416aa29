"""What goes into the fusion beside the acquisition record."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.flags import REJECTING
from glint_aoa.inertial.estimate import MISALIGNMENT_STD

__all__ = ["Assumed", "OpticalAngles"]

_Floats = NDArray[np.float64]

_UNSWEPT_STD_DEG = 0.05  # of an optical angle that nothing ties to the onboard sensor
_SWEPT_SCALE_STD = 1e-3
_UNSWEPT_SCALE_STD = 0.02  # the glint's walk along the body alone is a hundredth


@dataclass(frozen=True, eq=False)
class OpticalAngles:
    """Angles of the fields of a point.

    Attributes
    ----------
    time_s : ndarray [field]
        Middles of the exposures after the trigger [s].
    angle_deg : ndarray [field]
        Pitch, nose up positive [deg]; NaN where it was not measured.
    std_deg : ndarray [field]
        Noise of each, 1 sigma [deg].
    flags : ndarray [field]
        Bit mask of `glint_aoa.flags.Flag`; what rejects a field from its point's mean rejects it
        here.
    exposure_s : float
        Length of the exposures [s].
    systematic_std_deg : float
        What all fields share, such as the calibration's uncertainty, 1 sigma [deg].
    scale_std : float
        Of the scale of their changes, relative, 1 sigma.
    """

    time_s: _Floats
    angle_deg: _Floats
    std_deg: _Floats
    flags: NDArray[np.int64]
    exposure_s: float = 0.0
    systematic_std_deg: float = 0.0
    scale_std: float = _SWEPT_SCALE_STD

    @classmethod
    def of_fields(
        cls, values: Mapping[str, NDArray[Any]], *, exposure_s: float, is_swept: bool
    ) -> "OpticalAngles":
        """Take the angles from a point's results.

        Parameters
        ----------
        values : mapping of str to ndarray [field]
            Columns of the results, as `glint_aoa.process.PointResult.values`.
        exposure_s : float
            Length of the exposures [s].
        is_swept : bool
            Whether a pitch sweep ties the angles to the onboard sensor. Without one they are taken
            to be uncertain by 0.05 deg and, in scale, by 2 %.
        """
        systematic = values["angle_systematic_std_deg"]
        shared = float(np.nanmean(systematic)) if np.isfinite(systematic).any() else 0.0
        return cls(
            time_s=values["time_s"],
            angle_deg=values["angle_deg"],
            std_deg=values["angle_std_deg"],
            flags=values["flags"],
            exposure_s=exposure_s,
            systematic_std_deg=shared if is_swept else math.hypot(shared, _UNSWEPT_STD_DEG),
            scale_std=_SWEPT_SCALE_STD if is_swept else _UNSWEPT_SCALE_STD,
        )

    @property
    def good(self) -> NDArray[np.bool_]:
        """Fields that may be used [field]."""
        measured = np.isfinite(self.angle_deg) & (self.std_deg > 0)
        return np.asarray(measured & ((self.flags & int(REJECTING)) == 0))


@dataclass(frozen=True)
class Assumed:
    """What is assumed of the sensors where the record cannot tell, 1 sigma.

    Attributes
    ----------
    gain_std : float
        Of an accelerometer's gain, relative.
    misalignment_std : float
        Of the direction in which an accelerometer senses [rad].
    package_std_deg : float
        Of the package's static angle [deg].
    """

    gain_std: float = 0.01
    misalignment_std: float = MISALIGNMENT_STD
    package_std_deg: float = 0.01
