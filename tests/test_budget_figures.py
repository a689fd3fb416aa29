"""The bars of an uncertainty budget."""

import re
from dataclasses import replace

import pytest

from calibration.budget.uncertainty import (
    AngleBudget,
    BudgetBlock,
    BudgetRow,
    Distribution,
    UncertaintyBudget,
)
from glint_aoa.report.budget_figures import budget_figure
from glint_aoa.report.budget_tables import format_budget, format_summary


def row(block, source, contribution, *, before=0.0, std=1.0):
    share = contribution**2 / 0.05**2
    return BudgetRow(block, source, "deg", std, contribution, contribution, share, before)


ROWS = (
    row("camera calibration", "principal distance", 0.04, before=0.2),
    row("camera calibration", "distortion k1", 0.0, before=0.1),
    row("taped", "rotation phi", 0.04, before=0.5),
    row("taped", "known Y", 0.0, std=0.0),
    row("centroids", "centroids", 1e-5, before=1e-5),
)
BLOCKS = (
    BudgetBlock("camera calibration", 0.03, 0.25, 7.0),
    BudgetBlock("taped", 0.04, 0.5, float("inf")),
    BudgetBlock("centroids", 1e-5, 1e-5, float("inf")),
)


def budget(angles=(0.0,), *, degree=None):
    drawn = Distribution(0.001, 0.05, -0.1, 0.1, 0.001)
    each = AngleBudget(
        angle_deg=0.0,
        raw_angle_deg=0.0,
        intercept_mm=60.0,
        line=119.5,
        in_view=True,
        outside_sweep=False,
        rows=ROWS,
        blocks=BLOCKS,
        std_deg=0.05,
        degrees_of_freedom=54.0,
        u95_deg=0.1,
        monte_carlo=drawn,
    )
    places = tuple(
        replace(each, angle_deg=angle, u95_deg=u95, line=line)
        for angle in angles
        for u95, line in ((0.1, 119.5), (0.09, 60.0))
    )
    return UncertaintyBudget(places, 0.01, 60, 38, 1000, 1, True, degree)


def bars(axes):
    """Length of each bar by its source, one list for each angle."""
    sources = [label.get_text() for label in axes.get_yticklabels()]
    lengths = [[bar.get_width() for bar in drawn] for drawn in axes.containers]
    return [dict(zip(sources, each, strict=True)) for each in lengths]


def test_bars_are_the_contributions_the_longest_first():
    (axes,) = budget_figure(budget()).axes
    (drawn,) = bars(axes)
    assert list(drawn) == ["combined", "rotation phi", "camera calibration"]
    assert drawn == pytest.approx(
        {"combined": 0.05, "rotation phi": 0.04, "camera calibration": 0.03}, rel=1e-6
    )
    assert axes.get_xlabel() == "contribution to the angle, 1 sigma [deg]"
    (label,) = axes.figure.legends[0].get_texts()
    assert label.get_text() == "0 deg, line 120"  # the place where u95 is largest


def test_a_sweep_shows_what_it_takes_out():
    swept, unswept = budget_figure(budget(degree=2)).axes
    assert (swept.get_title(), unswept.get_title()) == ("with the pitch sweep", "without it")
    assert bars(swept)[0]["rotation phi"] == 0.04
    assert bars(unswept)[0]["rotation phi"] == 0.5


def test_of_many_angles_three_are_drawn():
    (axes,) = budget_figure(budget((-6.0, -3.0, 0.0, 3.0, 6.0))).axes
    labels = [text.get_text() for text in axes.figure.legends[0].get_texts()]
    assert labels == ["-6 deg, line 120", "0 deg, line 120", "+6 deg, line 120"]


def test_table_of_an_angle():
    text = format_budget(budget(degree=2).angles[0], swept=True)
    assert [re.split(r" {2,}", line.strip()) for line in text.splitlines()] == [
        ["+0.00 deg, glint at 60.0 mm (sensor line 119.5)"],
        ["1 sigma", "sensitivity", "u [deg]", "share", "unswept"],
        ["camera calibration, 7 d.o.f.", "0.03000", "64.0 %", "0.25000"],
        ["principal distance", "1 deg", "+0.04 deg/deg", "0.04000", "64.0 %", "0.20000"],
        ["distortion k1", "1 deg", "+0 deg/deg", "0.00000", "0.0 %", "0.10000"],
        ["rotation phi", "1 deg", "+0.04 deg/deg", "0.04000", "64.0 %", "0.50000"],
        ["centroids", "1 deg", "+1e-05 deg/deg", "0.00001", "0.0 %", "0.00001"],
        ["combined", "0.05000", "100.0 %", "0.55902"],
        ["95 %: +- 0.10000 deg (54 effective degrees of freedom)"],
        ["Monte Carlo: -0.10000 to +0.10000 deg; as to first order"],
    ]
    columns = {line.rindex(" ") for line in text.splitlines()[1:8]}
    assert len(columns) == 1  # the last one is aligned
    assert max(map(len, text.splitlines())) <= 103


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"high_deg": 0.2}, "off the first order's by 100 % of u95; take these"),
        ({"standard_error_deg": 0.01}, "too few draws to tell within 5 %"),
    ],
)
def test_disagreement_and_too_few_draws_are_said(changes, said):
    one = budget().angles[0]
    one = replace(one, monte_carlo=replace(one.monte_carlo, **changes))
    assert format_budget(one, swept=False).splitlines()[-1].endswith(said)


def test_summary_marks_what_is_not_as_it_should_be():
    whole = budget()
    marked = replace(whole.angles[0], in_view=False, outside_sweep=True)
    line = format_summary(replace(whole, angles=(marked,))).splitlines()[1]
    assert line.split(maxsplit=6) == [
        "+0.00",
        "60.0",
        "119.5",
        "0.10000",
        "0.10000",
        "+0.00100",
        "principal distance, 64 %; not in all columns; outside the sweep",
    ]
