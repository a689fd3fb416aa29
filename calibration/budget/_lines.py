"""The lines that a budget is made for, in the picture of the setup's camera."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from calibration.budget._chain import Chain, middle_of
from glint_aoa.errors import CalibrationError, SetupError
from glint_aoa.optical.columns import used_columns
from glint_aoa.setup import Setup

__all__ = ["Lines", "sensor_columns"]

Floats = NDArray[np.float64]

_HEIGHTS = (0.25, 0.5, 0.75)  # of the picture, where no intercepts are given


@dataclass(frozen=True, eq=False)
class Lines:
    """Glints, each at an angle and a place; arrays have shape (line,) unless said.

    Attributes
    ----------
    intercept : ndarray
        Z at X = 0 [m].
    v : ndarray [line, column]
        Sensor lines at which they cross the columns [pixels].
    in_view : ndarray of bool
        Whether all columns see it.
    """

    intercept: Floats
    v: Floats
    in_view: NDArray[np.bool_]

    @property
    def middle(self) -> Floats:
        """Sensor line in the middle of the columns [pixels]."""
        return middle_of(self.v)

    @classmethod
    def in_picture(
        cls, setup: Setup, chain: Chain, raw_deg: Floats, intercepts_m: Sequence[float] | None
    ) -> Self:
        """Place glints of given angles in the picture.

        Parameters
        ----------
        setup : Setup
            The setup; its search window, where it says on what sensor lines that lies, is the
            picture, else the whole sensor.
        chain : Chain
            From pixels to angles.
        raw_deg : ndarray [angle]
            Angles before calibration [deg].
        intercepts_m : sequence of float or None
            Z at X = 0 [m]; None takes a quarter, a half and three quarters of the picture.

        Raises
        ------
        CalibrationError
            If a glint is not in the picture.
        """
        top, bottom = _picture(setup)
        if intercepts_m is None:
            rows = [top + share * (bottom - top) for share in _HEIGHTS]
            each = [chain.intercepts(np.radians(raw_deg), row) for row in rows]
            intercept = np.stack(each, axis=1).ravel()
        else:
            given = np.array(intercepts_m, np.float64)
            if given.ndim != 1 or not given.size or not np.isfinite(given).all():
                raise CalibrationError("the intercepts are none, or not all numbers; give mm")
            intercept = np.tile(given, raw_deg.size)
        angle_deg = np.repeat(raw_deg, intercept.size // raw_deg.size)
        v = chain.check_seen(chain.pixels(np.radians(angle_deg), intercept))
        seen = (v >= top - 0.5) & (v <= bottom + 0.5)
        for hidden in np.flatnonzero(~seen.any(axis=1)):
            raise CalibrationError(
                f"a glint at {angle_deg[hidden]:.3g} deg and {intercept[hidden] * 1e3:.4g} mm is "
                "not in the picture; give another angle or intercept"
            )
        return cls(intercept, v, np.asarray(seen.all(axis=1)))


def sensor_columns(setup: Setup) -> Floats:
    """Return the sensor columns that the setup measures [pixels].

    Raises
    ------
    SetupError
        If the setup does not say how many the sensor has.
    """
    if setup.camera.sensor is None:
        raise SetupError(
            "camera.sensor is missing, so nobody knows which columns see the glint; "
            "give it in [camera], columns and lines per field"
        )
    return used_columns(setup.camera.sensor[0], setup.glint.column_step).astype(np.float64)


def _picture(setup: Setup) -> tuple[float, float]:
    """First and last sensor line in which the glint may lie."""
    window, first = setup.glint.search_window, setup.fields.first_line
    if window is not None and first is not None:
        return float(first + window[0]), float(first + window[1] - 1)
    assert setup.camera.sensor is not None
    return 0.0, float(setup.camera.sensor[1] - 1)
