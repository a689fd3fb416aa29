"""A planned test as plain text, as columns of CSV and as values for JSON."""

import math
from collections.abc import Callable
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from glint_aoa.plan import AngleForecast, LayoutForecast, LayoutMap, TestPlan
from glint_aoa.setup import Plan, Setup

__all__ = ["angle_columns", "assumptions", "format_plan", "map_columns", "plan_values"]

_MM = 1e3
_SAME_M = 5e-4  # lengths that are one
_LIMITS = {
    "window": "the recorded window ends",
    "light": "the lamp's end or too little light",
    "focus": "the depth of field ends",
    "": "as far as was looked",
}


def format_plan(plan: TestPlan) -> str:
    """Return a plan as plain text: the present layout, the suggested one, and what was assumed."""
    parts = ["Present setup\n" + _format_layout(plan.present, plan.setup.plan)]
    if plan.suggestion is not None:
        layout = _format_layout(plan.suggestion, plan.setup.plan)
        parts.append(f"Suggested: {_changes(plan)}\n{layout}\n{_gain(plan)}{_edges(plan)}")
    elif plan.layouts is not None:
        parts.append(_format_nothing(plan.layouts))
    parts.append("Assumed, since [plan] does not say: " + "; ".join(assumptions(plan.setup)))
    return "\n\n".join(parts)


def _format_layout(forecast: LayoutForecast, plan: Plan) -> str:
    layout, visible = forecast.layout, forecast.visible
    y, z = layout.lamp_yz
    header = (
        f"{'pitch':>7} {'glint':>8} {'line, first to last column':>27} {'sigma':>6} {'columns':>8} "
        f"{'field':>9} {'noise':>9} {'vibration':>10} {'calibration':>12} {'u95 mean':>9}"
    )
    lines = [
        f"camera {layout.distance:.3f} m from the plane of the glint, "
        f"{layout.focal_length * _MM:g} mm lens, lamp at Y {y:.3f} m, Z {z:.3f} m, "
        f"window from line {layout.first_line}, {layout.lines} lines",
        header,
        f"{'deg':>7} {'deg':>8} {'':>27} {'lines':>6} {'':>8} {'deg':>9} {'deg':>9} {'deg':>10} "
        f"{'deg':>12} {'deg':>9}",
        *(_format_angle(each) for each in forecast.angles),
        f"The known Y of the glint is {forecast.glint_y_m * _MM:.1f} mm.",
    ]
    if math.isnan(visible.low_deg):
        lines.append(f"The glint is seen at no angle: {_LIMITS[visible.low_limit]}.")
        return "\n".join(lines)
    low, high = np.degrees(plan.angles)
    seen = "all" if visible.holds(low, high) else "NOT all"
    lines.append(
        f"Seen from {visible.low_deg:+.1f} deg ({_LIMITS[visible.low_limit]}) to "
        f"{visible.high_deg:+.1f} deg ({_LIMITS[visible.high_limit]}): {seen} of the wanted "
        f"{low:+.1f} to {high:+.1f} deg."
    )
    return "\n".join(lines)


def _format_angle(each: AngleForecast) -> str:
    glint = round(each.glint_angle_deg, 3) + 0.0  # no -0.000
    rows = "  ".join(_number(v, ".1f") for v in (each.row_left, each.row_middle, each.row_right))
    parts = (
        (each.field_std_deg, 9),
        (each.noise_std_deg, 9),
        (each.vibration_std_deg, 10),
        (each.calibration_std_deg, 12),
        (each.mean_u95_deg, 9),
    )
    return (
        f"{each.angle_deg:>+7.2f} {_number(glint, '+.3f'):>8} {rows:>27} "
        f"{_number(each.sigma_lines, '.2f'):>6} {f'{each.columns}/{each.columns_on_body}':>8} "
        + " ".join(f"{_number(value, '.5f'):>{width}}" for value, width in parts)
    )


def _number(value: float, spec: str) -> str:
    """Format a number; a dash stands for what is not measured."""
    return format(value, spec) if math.isfinite(value) else "-"


def _changes(plan: TestPlan) -> str:
    assert plan.suggestion is not None
    old, new = plan.present.layout, plan.suggestion.layout
    said = []
    if not math.isclose(old.distance, new.distance, abs_tol=_SAME_M):
        way = "back" if new.distance > old.distance else "nearer"
        said.append(f"camera {abs(new.distance - old.distance):.3f} m {way}")
    if new.focal_length != old.focal_length:
        said.append(f"{new.focal_length * _MM:g} mm lens")
    for name, then, now in zip("YZ", old.lamp_yz, new.lamp_yz, strict=True):
        if not math.isclose(then, now, abs_tol=_SAME_M):
            said.append(f"lamp's {name} from {then:.3f} to {now:.3f} m")
    if new.first_line != old.first_line:
        said.append(f"window from line {new.first_line}")
    return ", ".join(said) or "the setup as it is"


def _gain(plan: TestPlan) -> str:
    assert plan.suggestion is not None
    exposure = (
        f"the glint's peak is kept by {plan.suggestion.exposure_ratio:.2g} times the present "
        "exposure, or power of the lamp."
    )
    gain = plan.suggestion.worst_std_deg / plan.present.worst_std_deg
    if not math.isfinite(gain):  # the present setup does not see the glint at some angle
        return exposure.capitalize()
    return f"Uncertainty {gain:.2f} times that of the present setup; {exposure}"


def _edges(plan: TestPlan) -> str:
    """Say where the suggestion lies at an end of the map: beyond it may be better."""
    assert plan.suggestion is not None
    assert plan.layouts is not None
    layout, layouts = plan.suggestion.layout, plan.layouts
    places = {
        "distances": (layout.distance, layouts.distances),
        "focal_lengths": (layout.focal_length, layouts.focal_lengths),
        "lamp_y": (layout.lamp_yz[0], layouts.lamp_y),
        "lamp_z": (layout.lamp_yz[1], layouts.lamp_z),
    }
    ends = [
        name
        for name, (place, axis) in places.items()
        if axis.size > 2 and min(abs(place - axis[0]), abs(place - axis[-1])) < _SAME_M
    ]
    if not ends:
        return ""
    return f"\nIt lies at an end of {', '.join(ends)}: a wider map in [plan] may show a better one."


def _format_nothing(layouts: LayoutMap) -> str:
    return (
        f"None of the {layouts.std_deg.size} layouts of the map sees the whole wanted range; widen "
        "distances, focal_lengths, lamp_y or lamp_z in [plan], record more lines, or want less."
    )


def assumptions(setup: Setup) -> list[str]:
    """Return in words what a plan took as given that the setup does not say."""
    plan, given = setup.plan, setup.plan.model_fields_set
    said = [text(plan) for key, text in _ASSUMED.items() if key not in given]
    if setup.glint.read_noise is None and "read_noise" not in given:
        said.append(f"read noise {plan.read_noise:g} grey levels")
    if setup.glint.electrons_per_grey is None and "full_well" not in given:
        said.append(f"full well {plan.full_well:g} electrons")
    if not {"lamp_length", "lamp_width"} & given:
        long = setup.glint.reflection is None or setup.glint.reflection.lamp_shape == "long"
        said.append("an endless lamp" if long else f"a lamp {plan.lamp_width * _MM:g} mm across")
    if "body" not in given:
        said.append("a body that reaches as far as the present camera sees it")
    if setup.calibration.sweep is not None and plan.sweep_std is None:
        said.append("the pitch sweep of the setup is not counted, see plan.sweep_std")
    stated = any(np.any(v) for v in setup.uncertainty.model_dump(exclude={"reflection"}).values())
    stated |= setup.uncertainty.reflection is not None
    if plan.sweep_std is None and not (stated or setup.camera_path or setup.pose_path):
        said.append("an exact geometry, since [uncertainty] is empty")
    return said


_ASSUMED: dict[str, Callable[[Plan], str]] = {
    "angles": lambda p: "pitch {:+g} to {:+g} deg".format(*np.degrees(p.angles).round(6)),
    "pivot": lambda _: "a support that turns the body about a point of its axis at X = Z = 0",
    "fields": lambda p: f"{p.fields} fields a point",
    "roughness": lambda p: f"roughness {p.roughness:g}",
    "peak_level": lambda p: f"exposure to a peak of {p.peak_level:g} of {p.top_level:g}",
    "black_level": lambda p: f"black at {p.black_level:g}",
    "background": lambda p: f"the body {p.background:g} grey levels above black",
    "blur": lambda p: f"a blur of {p.blur:g} line",
    "f_number": lambda _: "everything in focus",
    "vibration": lambda _: "no vibration",
}


def angle_columns(plan: TestPlan) -> dict[str, list[Any]]:
    """Return the columns of ``plan-angles.csv`` by their headings, one row a layout and angle."""
    rows = [
        (name, each)
        for name, one in (("present", plan.present), ("suggested", plan.suggestion))
        if one is not None
        for each in one.angles
    ]
    columns: dict[str, list[Any]] = {"layout": [name for name, _ in rows]}
    for field in fields(AngleForecast):
        columns[field.name] = [getattr(each, field.name) for _, each in rows]
    return columns


def map_columns(layouts: LayoutMap) -> dict[str, Any]:
    """Return the columns of ``plan-map.csv`` by their headings, one row a layout."""
    axes = (layouts.distances, layouts.focal_lengths, layouts.lamp_y, layouts.lamp_z)
    distance, lens, y, z = (each.ravel() for each in np.meshgrid(*axes, indexing="ij"))
    return {
        "distance_m": distance,
        "focal_length_mm": lens * _MM,
        "lamp_y_m": y,
        "lamp_z_m": z,
        "first_line": layouts.first_line.ravel(),
        "visible": layouts.visible.ravel().astype(int),
        "field_std_deg": layouts.field_std_deg.ravel(),
        "mean_std_deg": layouts.std_deg.ravel(),
        "exposure_ratio": layouts.exposure_ratio.ravel(),
    }


def plan_values(plan: TestPlan) -> dict[str, Any]:
    """Return a plan as plain values for JSON; the map is in ``plan-map.csv``."""
    values: dict[str, Any] = {
        "present": _layout_values(plan.present),
        "suggested": None if plan.suggestion is None else _layout_values(plan.suggestion),
        "assumed": assumptions(plan.setup),
    }
    if plan.layouts is not None:
        values["layouts"] = plan.layouts.std_deg.size
        values["layouts_that_see_all"] = int(plan.layouts.visible.sum())
    return values


def _layout_values(forecast: LayoutForecast) -> dict[str, Any]:
    layout = forecast.layout
    return {
        "camera_position_m": list(layout.camera.position or ()),
        "distance_m": layout.distance,
        "focal_length_mm": layout.focal_length * _MM,
        "lamp_m": list(layout.reflection.lamp),
        "first_line": layout.first_line,
        "lines": layout.lines,
        "glint_y_mm": forecast.glint_y_m * _MM,
        "exposure_ratio": forecast.exposure_ratio,
        "visible": asdict(forecast.visible),
        "mean_std_deg": forecast.worst_std_deg,
        "angles": [asdict(each) for each in forecast.angles],
    }
