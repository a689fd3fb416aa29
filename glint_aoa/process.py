"""The main job: a recorded point in, its angles out."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from calibration.budget.uncertainty import (
    CarriedUncertainty,
    GeometryCovariance,
    geometry_uncertainty,
    uncertain_geometry,
)
from calibration.sweep.fit import PitchSweep
from glint_aoa._version import __version__
from glint_aoa.aliasing import AliasedMotion, aliased_motion
from glint_aoa.coverage import effective_freedom
from glint_aoa.errors import RecordingError
from glint_aoa.flags import REJECTING, Flag
from glint_aoa.optical.average import MeanAngle, mean_angle
from glint_aoa.optical.measure import FieldAngles, Measurement, measure_stack
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.angles import (
    angle_record,
    check_new_results,
    log_result,
    write_results,
)
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.formats import channels_beside, open_acquisition, open_fields
from glint_aoa.records.provenance import input_hashes
from glint_aoa.records.recording import Recording, resolve_recording
from glint_aoa.setup import Setup
from glint_aoa.sweep_use import SweptAngles, apply_sweep, stack_temperature

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["PointResult", "load_sweep", "measure_point", "point_identity", "process_point"]

_Array = NDArray[np.float64]
_MM = 1e3

Measure = Callable[..., tuple[FieldAngles, Measurement]]


@dataclass(frozen=True)
class PointResult:
    """What was measured of one point.

    Attributes
    ----------
    name : str
        Name of the point's result files.
    values : dict of str to ndarray [field]
        Columns of the results; see `glint_aoa.records.angles`.
    attrs : dict
        All settings, and where the point comes from.
    log : dict
        The row of ``log.csv``.
    measurement : Measurement
        How the fields were measured.
    angles : FieldAngles
        Angles and intercepts before calibration, and the centres behind them.
    """

    name: str
    values: dict[str, NDArray[Any]]
    attrs: dict[str, Any]
    log: dict[str, Any]
    measurement: Measurement
    angles: FieldAngles

    @cached_property
    def record(self) -> "xr.Dataset":
        """Values and attributes as a Dataset over ``field``."""
        return angle_record(self.values, self.attrs)

    @property
    def flags(self) -> int:
        """All flags of the point and its fields."""
        return int(self.log["flags"])


def load_sweep(setup: Setup) -> PitchSweep | None:
    """Load the pitch sweep that the setup names, if it names one.

    Raises
    ------
    CalibrationError
        If the file is missing or not a pitch sweep, or it was measured with another camera, known
        Y, nose or reflection.
    """
    if setup.sweep_path is None:
        return None
    sweep = PitchSweep.load(setup.sweep_path)
    sweep.check_setup(setup, source=setup.sweep_path)
    return sweep


def measure_point(
    stack: FieldStack,
    setup: Setup,
    *,
    sweep: PitchSweep | None = None,
    acquisition: AcquisitionRecord | None = None,
    measure: Measure = measure_stack,
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
    acquisition : AcquisitionRecord, optional
        Channels of the same point, which may show motion too fast for the fields; looked for in
        and beside the recording if not given.
    measure : callable, optional
        What measures the fields: `glint_aoa.optical.measure.measure_stack` with other options, or
        what joins parts that were measured elsewhere.
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
    # The matrices are small: threads of the linear algebra only get into each other's way.
    with threadpool_limits(limits=1, user_api="blas"):
        return _measured(stack, setup, recording, sweep, acquisition, measure, progress)


def _measured(
    stack: FieldStack,
    setup: Setup,
    recording: Recording,
    sweep: PitchSweep | None,
    acquisition: AcquisitionRecord | None,
    measure: Measure,
    progress: Callable[[int], None] | None,
) -> PointResult:
    geometry = uncertain_geometry(setup)
    angles, measurement = measure(stack, setup, recording, progress=progress)
    temperature, swept = None, None
    if sweep is not None:
        temperature = stack_temperature(stack, setup.inertial)
        swept = apply_sweep(angles, measurement, sweep, temperature_k=temperature)
    values = _columns(angles, measurement, swept)
    good = (values["flags"] & int(REJECTING)) == 0
    systematic = _systematic(measurement, good.size, swept)
    if geometry is not None:
        carried = _carried(angles, good, measurement, geometry, sweep, temperature)
        systematic = _joined(systematic, carried)
    values["angle_systematic_std_deg"] = systematic.std_deg
    mean = _mean(setup, recording, values, good)
    aliased = _visible(_aliased(stack, setup, recording, acquisition), mean, values, good)
    attrs = _provenance(stack, setup, measurement, sweep) | _averaging(mean, aliased)
    attrs |= _calibrated(swept, temperature)
    return PointResult(
        name=stack.name,
        values=values,
        attrs=attrs,
        log=_log_row(stack, setup, values, good, mean)
        | {"mean_angle_u95_deg": _expanded(mean, systematic, good)}
        | _point_flags(values, good, aliased),
        measurement=measurement,
        angles=angles,
    )


def process_point(
    path: str | Path,
    setup: Setup,
    out: str | Path,
    *,
    acquisition: AcquisitionRecord | None = None,
    overwrite: bool = False,
    to_log: bool = True,
    measure: Measure = measure_stack,
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
    acquisition, measure
        As for `measure_point`.
    overwrite : bool, optional
        Whether results of the same name may be replaced.
    to_log : bool, optional
        Whether the log's row is written; whoever does it later takes it from the result.
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
    stack, out = open_fields(path, setup.fields), Path(out)
    if not overwrite:
        check_new_results(out, stack.name)
    result = measure_point(
        stack,
        setup,
        sweep=load_sweep(setup),
        acquisition=acquisition,
        measure=measure,
        progress=progress,
    )
    result = replace(result, attrs=result.attrs | input_hashes(stack.path, setup))
    write_results(out, result.name, result.values, result.attrs)
    if to_log:
        log_result(out, result.log)
    return result


def point_identity(stack: FieldStack) -> dict[str, str]:
    """Return what the log calls a point: its run, its name in the run, and its time of day."""
    return {
        "run": str(stack.meta.get("run", "")),
        "point": str(stack.meta.get("point", stack.name)),
        "trigger_time": stack.info.trigger_time or "",
    }


def _columns(
    angles: FieldAngles, measurement: Measurement, swept: SweptAngles | None
) -> dict[str, NDArray[Any]]:
    raw, noise = np.degrees(angles.angle), np.degrees(angles.angle_std)
    flags, calibrated = angles.flags, raw
    if swept is not None:
        calibrated, noise = swept.angle_deg, swept.noise_deg
        flags = flags | swept.flags
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
    }


def _systematic(
    measurement: Measurement, n_fields: int, swept: SweptAngles | None
) -> CarriedUncertainty:
    """Return what all fields share but the geometry: the columns' departures, the sweep."""
    if swept is not None:
        return CarriedUncertainty(swept.systematic_deg, swept.systematic_freedom)
    doubt = np.full(n_fields, np.degrees(measurement.slope_doubt))
    return CarriedUncertainty(doubt, np.full(n_fields, np.inf))


def _joined(*parts: CarriedUncertainty) -> CarriedUncertainty:
    """Add independent uncertainties."""
    variances = [part.std_deg**2 for part in parts]
    freedom = effective_freedom(variances, [part.degrees_of_freedom for part in parts])
    return CarriedUncertainty(np.sqrt(np.sum(variances, axis=0)), freedom)


def _carried(
    angles: FieldAngles,
    good: NDArray[np.bool_],
    measurement: Measurement,
    geometry: GeometryCovariance,
    sweep: PitchSweep | None,
    temperature_k: float | None,
) -> CarriedUncertainty:
    """Return what the geometry leaves uncertain of each angle after the sweep."""
    return geometry_uncertainty(
        measurement.setup,
        geometry,
        np.where(good, angles.angle, np.nan),
        angles.intercept,
        u=measurement.recording.first_column + measurement.columns.astype(np.float64),
        std=measurement.column_std,
        sweep=sweep,
        temperature_k=temperature_k,
    )


def _mean(
    setup: Setup, recording: Recording, values: dict[str, NDArray[Any]], good: NDArray[np.bool_]
) -> MeanAngle:
    noise = _median(values["angle_std_deg"][good])
    return mean_angle(
        np.where(good, values["angle_deg"], np.nan),
        method=setup.glint.mean,
        rate_hz=recording.rate_hz,
        vibration_hz=setup.glint.vibration,
        candidates_hz=[mode.frequency for mode in setup.inertial.mode],
        noise=noise if noise > 0 else None,
    )


def _aliased(
    stack: FieldStack,
    setup: Setup,
    recording: Recording,
    acquisition: AcquisitionRecord | None,
) -> AliasedMotion | None:
    """Motion too fast for the fields, where channels in or beside the recording show it."""
    try:
        acquisition = acquisition or _channels(stack, setup)
        if acquisition is None:
            return None
        return aliased_motion(
            acquisition,
            rate_hz=recording.rate_hz,
            exposure_s=recording.exposure_s,
            start_s=recording.start_s,
            n_fields=stack.n_fields,
            radii_m={
                mode.frequency: mode.radius for mode in setup.inertial.mode if mode.plane == "pitch"
            },
        )
    except RecordingError:  # channels that cannot be used say nothing about the fields
        return None


def _channels(stack: FieldStack, setup: Setup) -> AcquisitionRecord | None:
    beside = None if stack.path is None else channels_beside(stack.path)
    return None if beside is None else open_acquisition(beside, setup.inertial)


def _visible(
    aliased: AliasedMotion | None,
    mean: MeanAngle,
    values: dict[str, NDArray[Any]],
    good: NDArray[np.bool_],
) -> AliasedMotion | None:
    """Keep the motion if the fields show it over their noise or it may move the mean."""
    if aliased is None:
        return None
    over_noise = aliased.rms_deg > _median(values["angle_std_deg"][good])
    return aliased if over_noise or aliased.on_mean_deg > mean.std else None


def _point_flags(
    values: dict[str, NDArray[Any]], good: NDArray[np.bool_], aliased: AliasedMotion | None
) -> dict[str, Any]:
    flags = int(np.bitwise_or.reduce(values["flags"]))
    if good.sum() < 0.5 * good.size:
        flags |= int(Flag.FEW_FIELDS)
    if aliased is not None:
        flags |= int(Flag.ALIASED)
    return {"flags": flags}


def _log_row(
    stack: FieldStack,
    setup: Setup,
    values: dict[str, NDArray[Any]],
    good: NDArray[np.bool_],
    mean: MeanAngle,
) -> dict[str, Any]:
    intercept = np.where(good, values["intercept_mm"], np.nan)
    return point_identity(stack) | {
        "n_fields": good.size,
        "n_used": int(good.sum()),
        "mean_angle_deg": mean.mean,
        "std_angle_deg": _spread(values["angle_deg"][good]),
        "mean_angle_std_deg": mean.std,
        "mean_method": mean.method,
        "mean_intercept_mm": mean.of(intercept),
        "std_intercept_mm": _spread(intercept[good]),
        "setup_hash": setup.hash,
    }


def _averaging(mean: MeanAngle, aliased: AliasedMotion | None) -> dict[str, Any]:
    """How the mean was taken, as attributes; lists by frequency of the vibration."""
    attrs: dict[str, Any] = {
        "mean_angle_deg": mean.mean,
        "mean_angle_std_deg": mean.std,
        "mean_method": mean.method,
        "vibration_frequency_hz": [line.frequency for line in mean.lines],
        "vibration_amplitude_deg": [line.amplitude for line in mean.lines],
        "vibration_bandwidth_hz": [line.bandwidth for line in mean.lines],
    }
    if aliased is not None:
        attrs["aliased_rms_deg"] = aliased.rms_deg
        attrs["aliased_frequency_hz"] = aliased.frequency_hz
        attrs["aliased_seen_at_hz"] = aliased.seen_at_hz
    return attrs


def _calibrated(swept: SweptAngles | None, temperature_k: float | None) -> dict[str, Any]:
    """Whether the pitch sweep covers the point, as attributes; no words if it does."""
    if swept is None:
        return {}
    warm = {} if temperature_k is None else {"tunnel_temperature_K": temperature_k}
    return {"calibration_doubts": "; ".join(swept.doubts), **warm}


def _expanded(mean: MeanAngle, systematic: CarriedUncertainty, good: NDArray[np.bool_]) -> float:
    """Half the 95 % interval of the mean [deg]."""
    if not good.any():
        return np.nan
    return mean.expanded(
        float(systematic.std_deg[good].mean()),
        systematic_dof=float(np.median(systematic.degrees_of_freedom[good])),
    )


def _median(values: _Array) -> float:
    return float(np.median(values)) if values.size else np.nan


def _spread(values: _Array) -> float:
    return float(values.std(ddof=1)) if values.size > 1 else np.nan


def _locking(measurement: Measurement) -> dict[str, float]:
    locking = measurement.locking
    return {} if locking is None else {"pixel_locking_lines": locking.amplitude}


def _mark(measurement: Measurement) -> dict[str, float]:
    mark = measurement.mark
    return {} if mark is None else {"reference_row": mark.row, "reference_column": mark.column}


def _provenance(
    stack: FieldStack, setup: Setup, measurement: Measurement, sweep: PitchSweep | None
) -> dict[str, Any]:
    noise = measurement.noise
    return {
        "title": f"glint-aoa angles of {stack.name}",
        "glint_aoa_version": __version__,
        "recording": str(stack.path or ""),
        "recording_notes": "; ".join(stack.notes),
        **point_identity(stack),
        "setup": setup.model_dump_json(),
        "setup_hash": setup.hash,
        "estimator": measurement.estimator.name,
        **measurement.estimator.settings,
        "glint_half_width_lines": measurement.shape.half_width,
        "noise_source": noise.source,
        "noise_read_variance_grey2": noise.read_variance,
        "noise_variance_per_grey": noise.variance_per_grey,
        "line_sagitta_mm": measurement.sagitta * _MM,
        "line_sagitta_std_mm": measurement.sagitta_std * _MM,
        "column_departures_std_deg": np.degrees(measurement.slope_doubt),
        **_locking(measurement),
        **_mark(measurement),
        "rate_hz": measurement.recording.rate_hz,
        "exposure_s": measurement.recording.exposure_s,
        "calibration": "none" if sweep is None else str(setup.sweep_path),
    }
