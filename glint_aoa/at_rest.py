"""A point of the model at rest: optical and onboard angle, and under what conditions."""

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from calibration.sweep.fit import DEFAULT_ONBOARD_STD_DEG, SweepPoint, SweepSetup
from glint_aoa.errors import CalibrationError, InputError
from glint_aoa.flags import REJECTING
from glint_aoa.inertial.correct import correct
from glint_aoa.inertial.static import static_angle
from glint_aoa.optical.measure import Measurement
from glint_aoa.process import PointResult, measure_point
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.conditioning import prepared
from glint_aoa.records.formats import open_acquisition, open_fields
from glint_aoa.setup import Glint, Setup
from glint_aoa.sweep_use import line_places, measured_columns, stack_temperature

__all__ = ["PointAtRest", "measure_at_rest"]

_PACKAGE = ("aoa_unfiltered", "aoa_filtered", "temperature")
_SHAKES = 3.0  # standard deviations of the correction, from which a bias counts
_BUZZES_DEG = 0.02  # rms of the unfiltered output of a model that is not at rest


class PointAtRest(NamedTuple):
    """A point for a pitch sweep, or to check one, and what it was measured with."""

    point: SweepPoint
    setup: SweepSetup


def measure_at_rest(path: str | Path, setup: Setup) -> PointAtRest:
    """Measure the optical and the onboard angle of a recorded point without flow.

    Parameters
    ----------
    path : str or Path
        Recorded point with fields and the package's output.
    setup : Setup
        The setup; a sweep that it names is not applied.

    Returns
    -------
    PointAtRest
        Both angles with their uncertainties, and where, when and how warm it was. The onboard
        angle is corrected for the bias of vibration where the model shakes: where the correction
        is three of its standard deviations or more. `onboard_note` says so, and says if it shakes
        and cannot be corrected.

    Raises
    ------
    CalibrationError
        If no field could be measured.
    InputError
        If the recording or the setup cannot be used.
    """
    stack = open_fields(path, setup.fields)
    result = measure_point(stack, _without_mark_place(setup))
    if not result.log["n_used"]:
        raise CalibrationError(f"{path}: no field could be measured; leave the point out")
    angle, std, note = _onboard(path, setup)
    point = SweepPoint(
        name=stack.name,
        optical_deg=result.log["mean_angle_deg"],
        optical_std_deg=result.log["mean_angle_std_deg"],
        onboard_deg=angle,
        onboard_std_deg=std if std > 0 else DEFAULT_ONBOARD_STD_DEG,
        onboard_note=note,
        time=stack.info.trigger_time or "",
        temperature_k=stack_temperature(stack, setup.inertial),
        nominal_deg=_number(stack.meta.get("nominal_angle_deg")),
        **_places(result),
    )
    columns = measured_columns(result.measurement)
    return PointAtRest(point, SweepSetup.of(setup, columns=columns, lines=stack.n_lines))


def _without_mark_place(setup: Setup) -> Setup:
    """Let each point say itself where the mark lies: a camera that moved must not hide fields."""
    reference = setup.glint.reference
    if reference is None:
        return setup
    anywhere = reference.model_copy(update={"row": None, "column": None})
    glint: Glint = setup.glint.model_copy(update={"reference": anywhere})
    return setup.model_copy(update={"glint": glint})


def _places(result: PointResult) -> dict[str, Any]:
    """Where line and mark lie, as means over the fields used."""
    good = (result.values["flags"] & int(REJECTING)) == 0
    noise = result.values["intercept_std_mm"][good]
    spread = result.log["std_intercept_mm"] if good.sum() > 1 else noise.max()
    return {
        "intercept_mm": result.log["mean_intercept_mm"],
        "intercept_std_mm": float(spread / np.sqrt(good.sum())),
        "line_v": float(line_places(result.angles, result.measurement)[good].mean()),
        **_mark(result.measurement),
    }


def _mark(measurement: Measurement) -> dict[str, Any]:
    """Where the mark and its box lie on the sensor; nothing without one."""
    mark, recording = measurement.mark, measurement.recording
    if mark is None:
        return {}
    box = mark.reference
    return {
        "mark_row": recording.first_line + mark.row,
        "mark_column": recording.first_column + mark.column,
        "mark_at": (
            recording.first_line + (sum(box.rows) - 1) / 2,
            recording.first_column + (sum(box.columns) - 1) / 2,
        ),
    }


def _onboard(path: str | Path, setup: Setup) -> tuple[float, float, str]:
    """Mean onboard angle, its uncertainty [deg], and what was done to it."""
    record = open_acquisition(path, setup.inertial)
    package = prepared(_package_alone(record))
    angle, std = static_angle(package, setup.inertial)
    try:
        rows = correct(prepared(record), setup.inertial)
    except InputError:
        noise = _buzz(package)
        shakes = f"it shakes by {noise:.3f} deg rms and cannot be corrected for that"
        return angle, std, shakes if noise > _BUZZES_DEG else ""
    bias, doubt = rows.bias_deg[rows.settled].mean(), rows.angle_std_deg[rows.settled].mean()
    if not abs(bias) > _SHAKES * doubt:
        return angle, std, ""
    note = f"a bias of {bias:+.4f} deg by vibration was taken out ({rows.method})"
    return float(rows.angle_deg[rows.settled].mean()), float(doubt), note


def _package_alone(record: AcquisitionRecord) -> AcquisitionRecord:
    """Take what a model at rest needs; what else was recorded may have gaps of any length."""
    channels = {name: each for name, each in record.channels.items() if each.quantity in _PACKAGE}
    return replace(record, channels=channels)


def _buzz(record: AcquisitionRecord) -> float:
    """Rms of the unfiltered output about its mean, as an angle [deg]; 0 without that output."""
    outputs = record.with_quantity("aoa_unfiltered")
    if not outputs:
        return 0.0
    return float(np.degrees(outputs[0].values("g_0").std()))


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None
