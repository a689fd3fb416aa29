"""Applying a pitch sweep to the fields of a point: where the line lies, and how warm it was."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.sweep.fit import PitchSweep
from glint_aoa.coverage import effective_freedom
from glint_aoa.errors import RecordingError
from glint_aoa.flags import Flag
from glint_aoa.optical.measure import FieldAngles, Measurement
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.formats.hdf5 import has_acquisition, read_acquisition
from glint_aoa.records.temperature import tunnel_temperature
from glint_aoa.setup import Inertial

__all__ = ["SweptAngles", "apply_sweep", "line_places", "measured_columns", "stack_temperature"]

_Array = NDArray[np.float64]

_HDF5 = {".h5", ".hdf5"}


@dataclass(frozen=True, eq=False)
class SweptAngles:
    """What a pitch sweep makes of the fields of a point; arrays have shape (field,).

    Attributes
    ----------
    angle_deg, noise_deg : ndarray
        Angle after calibration, and the field's own noise, 1 sigma [deg].
    systematic_deg : ndarray
        What all fields share, 1 sigma [deg]: of the calibration, and of the columns' departures.
    systematic_freedom : ndarray
        Degrees of freedom of that; finite where the scatter of the sweep's points stands for it.
    flags : ndarray
        Flags to add.
    doubts : tuple of str
        What the sweep does not cover, in words.
    """

    angle_deg: _Array
    noise_deg: _Array
    systematic_deg: _Array
    systematic_freedom: _Array
    flags: NDArray[np.int64]
    doubts: tuple[str, ...]


def apply_sweep(
    angles: FieldAngles,
    measurement: Measurement,
    sweep: PitchSweep,
    *,
    temperature_k: float | None = None,
) -> SweptAngles:
    """Calibrate the angles of a point's fields.

    Parameters
    ----------
    angles : FieldAngles
        As measured.
    measurement : Measurement
        How they were measured.
    sweep : PitchSweep
        The calibration.
    temperature_k : float, optional
        Tunnel temperature [K], as from `stack_temperature`.

    Returns
    -------
    SweptAngles
        Fields outside the sweep's angles, temperatures or places of the line, or all of them if
        the setup differs in what may change the angle, are flagged `OUTSIDE_CALIBRATION`.
    """
    raw = np.degrees(angles.angle)
    applied = sweep.apply(raw, temperature_k=temperature_k, line_v=line_places(angles, measurement))
    gain = np.abs(applied.gain)
    other = sweep.setup_doubts(measurement.setup, columns=measured_columns(measurement))
    shared = np.hypot(np.degrees(measurement.slope_doubt) * gain, sweep.onboard_accuracy_deg)
    outside = applied.outside | (bool(other) & np.isfinite(raw))
    return SweptAngles(
        angle_deg=applied.angle_deg,
        noise_deg=np.degrees(angles.angle_std) * gain,
        systematic_deg=np.hypot(applied.fit_std_deg, shared),
        systematic_freedom=effective_freedom(
            [applied.fit_std_deg**2, shared**2], [sweep.scatter_freedom, np.inf]
        ),
        flags=np.where(outside, int(Flag.OUTSIDE_CALIBRATION), 0),
        doubts=applied.doubts + other,
    )


def line_places(angles: FieldAngles, measurement: Measurement) -> _Array:
    """Return where the line lies on the image: field line at the middle of the columns measured.

    Parameters
    ----------
    angles : FieldAngles
        As measured.
    measurement : Measurement
        How they were measured.

    Returns
    -------
    ndarray, shape (field,)
        Sensor field lines, of even fields; NaN where nothing was measured. Within a tenth of a
        line: the middle column is taken to be straight on the known plane.
    """
    first, last = measurement.shape.first_row, measurement.shape.last_row
    v = measurement.recording.first_line + np.array([first, last], np.float64)
    middle = np.full(2, sum(measured_columns(measurement)) / 2)
    (s, s_end), (z, z_end) = measurement.to_plane(middle, v)
    s_rate, z_rate = (s_end - s) / (v[1] - v[0]), (z_end - z) / (v[1] - v[0])
    slope = measurement.setup.glint.nose_sign * np.tan(angles.angle)
    return np.asarray(v[0] + (angles.intercept + slope * s - z) / (z_rate - slope * s_rate))


def measured_columns(measurement: Measurement) -> tuple[float, float]:
    """Return the first and the last sensor column measured."""
    first = measurement.recording.first_column
    return float(first + measurement.columns[0]), float(first + measurement.columns[-1])


def stack_temperature(stack: FieldStack, inertial: Inertial | None = None) -> float | None:
    """Find the tunnel's temperature at a recorded point.

    Parameters
    ----------
    stack : FieldStack
        The point.
    inertial : Inertial, optional
        The setup's section that completes the recorded channels.

    Returns
    -------
    float or None
        The temperature [K], from the point's description or else its channels.

    Raises
    ------
    RecordingError
        If what is stated is no temperature.
    """
    stated = tunnel_temperature(stack.name, stack.meta)
    path = stack.path
    if stated is not None or path is None or path.suffix not in _HDF5:
        return stated
    try:
        record = read_acquisition(path, inertial) if has_acquisition(path) else None
    except RecordingError:  # channels that cannot be used say nothing about the fields
        return None
    return tunnel_temperature(stack.name, stack.meta, record)
