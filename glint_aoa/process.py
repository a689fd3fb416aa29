"""The main job: a recorded point in, its angles out."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calibration.sweep import PitchSweep
from glint_aoa._version import __version__
from glint_aoa.flags import REJECTING, Flag
from glint_aoa.optical.average import MeanAngle, mean_angle
from glint_aoa.optical.measure import FieldAngles, Measurement, measure_stack
from glint_aoa.records.angles import angle_record, check_new_results, write_results
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.formats import open_fields
from glint_aoa.records.recording import resolve_recording
from glint_aoa.setup import Setup

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["PointResult", "load_sweep", "measure_point", "process_point"]

_Array = NDArray[np.float64]
_MM = 1e3


@dataclass(frozen=True)
class PointResult:
    """What was measured of one point.

    Attributes
    ----------
    name : str
        Name of the point's result files.
    record : Dataset
        One entry a field; see `glint_aoa.records.angles`.
    log : dict
        The row of ``log.csv``.
    measurement : Measurement
        How the fields were measured.
    angles : FieldAngles
        Angles and intercepts before calibration, and the centres behind them.
    """

    name: str
    record: "xr.Dataset"
    log: dict[str, Any]
    measurement: Measurement
    angles: FieldAngles

    @property
    def flags(self) -> int:
        """All flags of the point and its fields."""
        return int(self.log["flags"])


def load_sweep(setup: Setup) -> PitchSweep | None:
    """Load the pitch sweep that the setup names, if it names one.

    Raises
    ------
    CalibrationError
        If the file is missing or not a pitch sweep.
    """
    return None if setup.sweep_path is None else PitchSweep.load(setup.sweep_path)


def measure_point(
    stack: FieldStack,
    setup: Setup,
    *,
    sweep: PitchSweep | None = None,
    progress: Callable[[int], None] | None = None,
) -> PointResult:
    """Measure the fields of a point, calibrate their angles and average them.

    Parameters
    ----------
    stack : FieldStack
        The fields, as from `glint_aoa.records.formats.open_fields`.
    setup : Setup
        The setup.
    sweep : PitchSweep, optional
        Calibration to apply, as from `load_sweep`.
    progress : callable, optional
        Called after each block with the number of fields that it held.

    Returns
    -------
    PointResult
        The angles of the fields, and their mean.

    Raises
    ------
    SetupError
        If setup and recording contradict each other.
    RecordingError
        If the recording cannot be read.
    """
    recording = resolve_recording(stack, setup)
    angles, measurement = measure_stack(stack, setup, recording, progress=progress)
    values = _columns(angles, measurement, sweep)
    good = (values["flags"] & int(REJECTING)) == 0
    return PointResult(
        name=stack.name,
        record=angle_record(values, _provenance(stack, setup, measurement, sweep)),
        log=_log_row(stack, setup, values, good),
        measurement=measurement,
        angles=angles,
    )


def process_point(
    path: str | Path,
    setup: Setup,
    out: str | Path,
    *,
    overwrite: bool = False,
    progress: Callable[[int], None] | None = None,
) -> PointResult:
    """Measure a recorded point and write its results.

    Writes ``<point>.csv``, ``<point>.nc`` and a row of ``log.csv`` to `out`.

    Parameters
    ----------
    path : str or Path
        Recording of the point, in any format that `open_fields` reads.
    setup : Setup
        The setup; the sweep that it names is applied.
    out : str or Path
        Folder of the results; made where it is not there.
    overwrite : bool, optional
        Whether results of the same name may be replaced.
    progress : callable, optional
        Called after each block with the number of fields that it held.

    Returns
    -------
    PointResult
        What was written.

    Raises
    ------
    InputError
        If setup, recording or folder cannot be used; nothing that was there is lost.
    """
    stack, out = open_fields(path), Path(out)
    if not overwrite:
        check_new_results(out, stack.name)
    result = measure_point(stack, setup, sweep=load_sweep(setup), progress=progress)
    write_results(out, result.name, result.record, result.log)
    return result


def _columns(
    angles: FieldAngles, measurement: Measurement, sweep: PitchSweep | None
) -> dict[str, NDArray[Any]]:
    raw, noise = np.degrees(angles.angle), np.degrees(angles.angle_std)
    flags, calibrated, systematic = angles.flags, raw, np.zeros_like(raw)
    if sweep is not None:
        applied = sweep.apply(raw)
        calibrated, systematic = applied.angle_deg, applied.systematic_std_deg
        noise = noise * np.abs(sweep.derivative(raw))
        flags = flags | np.where(applied.outside, int(Flag.OUTSIDE_CALIBRATION), 0)
    # Without a pixel pitch nothing has a length.
    mm = _MM if measurement.setup.camera.pixel_pitch is not None else np.nan
    return {
        "field": angles.field,
        "time_s": angles.time_s,
        "parity": angles.parity,
        "angle_deg": calibrated,
        "angle_std_deg": noise,
        "intercept_mm": angles.intercept * mm,
        "intercept_std_mm": angles.intercept_std * mm,
        "columns_used": angles.columns_used,
        "rms_residual_mm": angles.rms_residual * mm,
        "flags": flags,
        "angle_raw_deg": raw,
        "angle_systematic_std_deg": systematic,
    }


def _log_row(
    stack: FieldStack, setup: Setup, values: dict[str, NDArray[Any]], good: NDArray[np.bool_]
) -> dict[str, Any]:
    mean = mean_angle(np.where(good, values["angle_deg"], np.nan), method=setup.glint.mean)
    intercept = np.where(good, values["intercept_mm"], np.nan)
    n_used = int(good.sum())
    flags = int(np.bitwise_or.reduce(values["flags"]))
    if n_used < 0.5 * good.size:
        flags |= int(Flag.FEW_FIELDS)
    return {
        "run": stack.meta.get("run", ""),
        "point": stack.meta.get("point", stack.name),
        "trigger_time": stack.info.trigger_time or "",
        "n_fields": good.size,
        "n_used": n_used,
        "mean_angle_deg": mean.mean,
        "std_angle_deg": _spread(values["angle_deg"][good]),
        "mean_angle_std_deg": mean.std,
        "mean_angle_u95_deg": mean.expanded(_systematic(values, good)),
        "mean_method": mean.method,
        "mean_intercept_mm": _mean_like(mean, intercept),
        "std_intercept_mm": _spread(intercept[good]),
        "flags": flags,
        "setup_hash": setup.hash,
    }


def _systematic(values: dict[str, NDArray[Any]], good: NDArray[np.bool_]) -> float:
    return float(values["angle_systematic_std_deg"][good].mean()) if good.any() else np.nan


def _mean_like(mean: MeanAngle, intercept: _Array) -> float:
    return mean_angle(intercept, method=mean.method).mean


def _spread(values: _Array) -> float:
    return float(values.std(ddof=1)) if values.size > 1 else np.nan


def _provenance(
    stack: FieldStack, setup: Setup, measurement: Measurement, sweep: PitchSweep | None
) -> dict[str, Any]:
    shape = measurement.shape
    return {
        "title": f"glint-aoa angles of {stack.name}",
        "glint_aoa_version": __version__,
        "recording": str(stack.path or ""),
        "run": str(stack.meta.get("run", "")),
        "point": str(stack.meta.get("point", stack.name)),
        "trigger_time": stack.info.trigger_time or "",
        "setup": setup.model_dump_json(),
        "setup_hash": setup.hash,
        "estimator": "centroid",
        "half_width_lines": shape.half_width,
        "background_noise_grey": shape.noise,
        "rate_hz": measurement.recording.rate_hz,
        "exposure_s": measurement.recording.exposure_s,
        "calibration": "none" if sweep is None else str(setup.sweep_path),
    }
