"""Tables of wing twist: one row a station, one row a target, and the same for JSON."""

from collections.abc import Sequence
from typing import Any

from calibration.twist.measure import WingTwist

__all__ = ["station_columns", "target_columns", "twist_values"]

_MM = 1e3


def station_columns(results: Sequence[WingTwist]) -> dict[str, list[Any]]:
    """Return the columns of ``twist.csv`` by their headings.

    Parameters
    ----------
    results : sequence of WingTwist
        One for each state with flow.

    Returns
    -------
    dict of str to list [row]
        Rows are the stations of one state after the other; std is 1 sigma, u95 half the 95 %
        interval; None where there is no value.
    """
    rows = [(result.name, one) for result in results for one in result.stations]
    return {
        "flow": [name for name, _ in rows],
        "station": [one.station for _, one in rows],
        "y_mm": [_MM * one.y_m for _, one in rows],
        "twist_deg": [one.twist_deg for _, one in rows],
        "twist_std_deg": [one.twist_std_deg for _, one in rows],
        "twist_u95_deg": [one.twist_u95_deg for _, one in rows],
        "relative_deg": [one.relative_deg for _, one in rows],
        "relative_std_deg": [one.relative_std_deg for _, one in rows],
        "relative_u95_deg": [one.relative_u95_deg for _, one in rows],
        "motion_std_deg": [one.motion_std_deg for _, one in rows],
        "shift_x_mm": [_MM * one.shift_x_m for _, one in rows],
        "shift_z_mm": [_MM * one.shift_z_m for _, one in rows],
        "scale": [one.scale for _, one in rows],
        "targets_used": [len(one.used) for _, one in rows],
        "rms_residual_mm": [_MM * one.rms_m for _, one in rows],
        "reduced_chi_square": [one.reduced_chi_square for _, one in rows],
        "outlying": [" ".join(one.outlying) for _, one in rows],
        "missing": [" ".join(one.missing) for _, one in rows],
    }


def target_columns(results: Sequence[WingTwist]) -> dict[str, list[Any]]:
    """Return the columns of ``twist-targets.csv``; residuals are flow less transformed no-flow."""
    rows = [(result.name, one) for result in results for one in result.targets]
    pairs = {
        "no_flow_u": [one.no_flow_uv[0] for _, one in rows],
        "no_flow_v": [one.no_flow_uv[1] for _, one in rows],
        "flow_u": [one.flow_uv[0] for _, one in rows],
        "flow_v": [one.flow_uv[1] for _, one in rows],
        "no_flow_x_mm": [_MM * one.no_flow_xz_m[0] for _, one in rows],
        "no_flow_z_mm": [_MM * one.no_flow_xz_m[1] for _, one in rows],
        "flow_x_mm": [_MM * one.flow_xz_m[0] for _, one in rows],
        "flow_z_mm": [_MM * one.flow_xz_m[1] for _, one in rows],
        "residual_x_mm": [_MM * one.residual_xz_m[0] for _, one in rows],
        "residual_z_mm": [_MM * one.residual_xz_m[1] for _, one in rows],
    }
    return {
        "flow": [name for name, _ in rows],
        "id": [one.id for _, one in rows],
        "station": [one.station for _, one in rows],
        **pairs,
        "used": ["yes" if one.used else "no" for _, one in rows],
    }


def twist_values(results: Sequence[WingTwist]) -> list[dict[str, Any]]:
    """Return the results as plain values, one entry for each state with flow."""
    return [
        {
            "flow": result.name,
            "reference": result.reference,
            "clipped": result.clipped,
            "stations": [
                {
                    "station": one.station,
                    "y_mm": _MM * one.y_m,
                    "twist_deg": one.twist_deg,
                    "twist_std_deg": one.twist_std_deg,
                    "twist_u95_deg": one.twist_u95_deg,
                    "relative_deg": one.relative_deg,
                    "relative_std_deg": one.relative_std_deg,
                    "relative_u95_deg": one.relative_u95_deg,
                    "motion_std_deg": one.motion_std_deg,
                    "shift_x_mm": _MM * one.shift_x_m,
                    "shift_z_mm": _MM * one.shift_z_m,
                    "scale": one.scale,
                    "rms_residual_mm": _MM * one.rms_m,
                    "reduced_chi_square": one.reduced_chi_square,
                    "excess": one.excess,
                    "used": one.used,
                    "outlying": one.outlying,
                    "missing": one.missing,
                }
                for one in result.stations
            ],
        }
        for result in results
    ]
