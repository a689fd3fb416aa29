"""An uncertainty budget as plain text, CSV and JSON."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from calibration.budget.uncertainty import AngleBudget, BudgetRow, UncertaintyBudget
from glint_aoa.records._files import replacing
from glint_aoa.records.tables import write_csv

__all__ = [
    "budget_values",
    "format_budget",
    "format_exact",
    "format_summary",
    "write_budget_csv",
    "write_budget_json",
]

_INDEPENDENT = "taped"
_WIDTHS = (28, 20, 22, 12, 9, 12)


def format_budget(budget: AngleBudget, *, swept: bool) -> str:
    """Return the table of one angle as plain text, at most 103 columns wide.

    Parameters
    ----------
    budget : AngleBudget
        The angle.
    swept : bool
        Whether a pitch sweep is applied: a last column then says what it takes out.

    Returns
    -------
    str
        One line for each input that is uncertain: its standard uncertainty, the angle's
        sensitivity to it, what it makes of the angle's standard uncertainty u [deg], and its
        share of the variance. Calibrations, whose inputs correlate, have a line of their sum.
    """
    lines = [
        f"{budget.angle_deg:+.2f} deg, glint at {budget.intercept_mm:.1f} mm "
        f"(sensor line {budget.line:.1f})",
        _line(["", "1 sigma", "sensitivity", "u [deg]", "share", "unswept"], swept=swept),
    ]
    for block in budget.blocks:
        rows = [row for row in budget.rows if row.block == block.name and row.std > 0]
        correlated = len(rows) > 1 and block.name != _INDEPENDENT
        if correlated:
            figures = _figures(
                block.contribution_deg, sum(row.share for row in rows), block.before_sweep_deg
            )
            name = block.name + _freedom(block.degrees_of_freedom)
            lines.append(_line([name, "", "", *figures], swept=swept))
        lines += [_line(_cells(row, indented=correlated), swept=swept) for row in rows]
    before = math.sqrt(math.fsum(block.before_sweep_deg**2 for block in budget.blocks))
    lines.append(_line(["combined", "", "", *_figures(budget.std_deg, 1.0, before)], swept=swept))
    return "\n".join([*lines, *_results(budget)])


def format_summary(budget: UncertaintyBudget) -> str:
    """Return one line for each angle and place as plain text."""
    header = f"{'angle [deg]':>11} {'glint [mm]':>11} {'line':>7} {'u95 [deg]':>10}"
    lines = [f"{header} {'Monte Carlo':>12} {'shift':>9}  most from"]
    for each in budget.angles:
        drawn = each.monte_carlo
        shift = drawn.mean_deg - each.angle_deg
        lines.append(
            f"{each.angle_deg:>+11.2f} {each.intercept_mm:>11.1f} {each.line:>7.1f} "
            f"{each.u95_deg:>10.5f} {drawn.u95_deg:>12.5f} {shift:>+9.5f}  {_largest(each)}"
            f"{_remarks(each)}"
        )
    return "\n".join(lines)


def format_exact(budget: UncertaintyBudget) -> str:
    """Return as plain text which inputs count as exact, and why; empty if there are none.

    Inputs stand between semicolons, since some have commas in their names.
    """
    said = {
        "Held by a calibration, so taken as exact": budget.held,
        "Taken as exact, since nothing is said of them": budget.exact,
    }
    return "".join(f"\n{why}: {'; '.join(inputs)}" for why, inputs in said.items() if inputs)


def budget_values(budget: UncertaintyBudget) -> dict[str, Any]:
    """Return a budget as plain values for JSON; what is infinite becomes None."""
    values = asdict(budget)
    for plain, each in zip(values["angles"], budget.angles, strict=True):
        plain["monte_carlo"] |= {
            "u95_deg": each.monte_carlo.u95_deg,
            "converged": each.monte_carlo.converged,
            "confirms_first_order": each.confirmed,
            "departure_of_u95": each.departure,
        }
    finite: dict[str, Any] = _finite(values)
    return finite


def write_budget_json(path: str | Path, budget: UncertaintyBudget, *, overwrite: bool) -> None:
    """Write a budget as JSON.

    Raises
    ------
    OutputError
        If the file exists and `overwrite` is False, or it cannot be written.
    """
    text = json.dumps(budget_values(budget), indent=2, allow_nan=False)
    with replacing(Path(path), overwrite=overwrite) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def write_budget_csv(path: str | Path, budget: UncertaintyBudget, *, overwrite: bool) -> None:
    """Write a budget as CSV: one row for each angle, place and input.

    Raises
    ------
    OutputError
        If the file exists and `overwrite` is False, or it cannot be written.
    """
    rows = [
        {
            "angle_deg": each.angle_deg,
            "intercept_mm": each.intercept_mm,
            "line": each.line,
            **asdict(row),
            "combined_std_deg": each.std_deg,
            "u95_deg": each.u95_deg,
            "monte_carlo_u95_deg": each.monte_carlo.u95_deg,
        }
        for each in budget.angles
        for row in each.rows
    ]
    write_csv(path, {key: [row[key] for row in rows] for key in rows[0]}, overwrite=overwrite)


def _line(cells: Sequence[str], *, swept: bool) -> str:
    widths = _WIDTHS if swept else _WIDTHS[:-1]
    first, *others = (
        cell.ljust(width) if number == 0 else cell.rjust(width)
        for number, (cell, width) in enumerate(zip(cells, widths, strict=False))
    )
    return "".join([first, *others]).rstrip()


def _cells(row: BudgetRow, *, indented: bool) -> list[str]:
    return [
        f"  {row.source}" if indented else row.source,
        f"{row.std:.3g} {row.unit}".removesuffix(" 1"),
        f"{row.sensitivity:+.3g} deg/{row.unit.removesuffix('s')}".removesuffix("/1"),
        *_figures(row.contribution_deg, row.share, row.before_sweep_deg),
    ]


def _figures(contribution: float, share: float, before: float) -> list[str]:
    return [f"{contribution:.5f}", f"{round(100 * share, 1) + 0.0:.1f} %", f"{before:.5f}"]


def _freedom(degrees_of_freedom: float) -> str:
    return "" if math.isinf(degrees_of_freedom) else f", {degrees_of_freedom:.0f} d.o.f."


def _results(budget: AngleBudget) -> list[str]:
    drawn = budget.monte_carlo
    freedom = budget.degrees_of_freedom
    student = "" if math.isinf(freedom) else f" ({freedom:.0f} effective degrees of freedom)"
    verdict = "as to first order"
    if not budget.confirmed:
        verdict = f"off the first order's by {100 * budget.departure:.0f} % of u95; take these"
    elif not drawn.converged:
        verdict = "too few draws to tell within 5 %"
    low, high = drawn.low_deg - budget.angle_deg, drawn.high_deg - budget.angle_deg
    return [
        f"95 %: +- {budget.u95_deg:.5f} deg{student}",
        f"Monte Carlo: {low:+.5f} to {high:+.5f} deg; {verdict}",
    ]


def _largest(budget: AngleBudget) -> str:
    row = max(budget.rows, key=lambda row: row.share)
    return f"{row.source}, {100 * row.share:.0f} %" if row.share > 0 else "nothing"


def _remarks(budget: AngleBudget) -> str:
    remarks = {
        "not in all columns": not budget.in_view,
        "outside the sweep": budget.outside_sweep,
        "Monte Carlo disagrees": not budget.confirmed,
    }
    return "".join(f"; {words}" for words, true in remarks.items() if true)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
