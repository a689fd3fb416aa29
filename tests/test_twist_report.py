"""Table and picture of the wing twist."""

import dataclasses

import pytest

from calibration.twist.measure import StationTwist, TargetMotion, WingTwist
from glint_aoa.report.twist_figures import twist_figure
from glint_aoa.report.twist_tables import station_columns, target_columns, twist_values

BODY = StationTwist(
    station="body",
    y_m=-0.05,
    twist_deg=3.0,
    twist_std_deg=0.001,
    twist_u95_deg=0.00196,
    relative_deg=0.0,
    relative_std_deg=0.0,
    relative_u95_deg=0.0,
    motion_std_deg=0.0002,
    shift_x_m=0.001,
    shift_z_m=0.002,
    scale=1.0,
    rms_m=3e-6,
    reduced_chi_square=1.1,
    excess=1.0,
    used=("a", "b"),
    outlying=(),
    missing=(),
)
TIP = dataclasses.replace(
    BODY,
    station="tip",
    y_m=0.45,
    twist_deg=0.5,
    relative_deg=-2.5,
    relative_u95_deg=0.004,
    shift_z_m=0.012,
    reduced_chi_square=None,
    used=("c", "d"),
    outlying=("e", "f"),
)
MOTION = TargetMotion(
    "a", "body", (1.0, 2.0), (3.0, 4.0), (0.1, 0.2), (0.3, 0.4), (1e-6, 2e-6), True
)
RESULT = WingTwist("on", "body", (BODY, TIP), (MOTION,), ())


def test_a_row_for_each_station():
    columns = station_columns([RESULT, dataclasses.replace(RESULT, name="again")])
    assert columns["flow"] == ["on", "on", "again", "again"]
    assert columns["y_mm"] == pytest.approx([-50, 450, -50, 450])
    assert columns["relative_deg"][:2] == [0.0, -2.5]
    assert columns["outlying"][:2] == ["", "e f"]
    assert columns["reduced_chi_square"][:2] == [1.1, None]
    assert {len(each) for each in columns.values()} == {4}


def test_a_row_for_each_target():
    columns = target_columns([RESULT])
    assert [columns[name] for name in ("id", "flow_u", "no_flow_v", "used")] == [
        ["a"],
        [3.0],
        [2.0],
        ["yes"],
    ]
    assert columns["flow_z_mm"] == pytest.approx([400])
    assert columns["residual_z_mm"] == pytest.approx([0.002])


def test_values_are_those_of_the_table():
    (values,) = twist_values([RESULT])
    columns = station_columns([RESULT])
    for number, station in enumerate(values["stations"]):
        for name in set(station) & set(columns) - {"outlying", "missing"}:
            assert station[name] == columns[name][number]


@pytest.mark.parametrize(
    ("reference", "label", "twist"),
    [("body", "twist less body's [deg]", [0.0, -2.5]), (None, "twist [deg]", [3.0, 0.5])],
)
def test_the_picture(reference, label, twist):
    figure = twist_figure([dataclasses.replace(RESULT, reference=reference)])
    above, between, below = figure.axes
    assert above.get_ylabel() == label
    assert below.get_xlabel() == "Y of the station [mm]"
    assert above.lines[0].get_xdata() == pytest.approx([-50, 450])
    assert above.lines[0].get_ydata() == pytest.approx(twist)
    half = (0.0, 0.004) if reference else (0.00196, 0.00196)
    assert between.lines[0].get_ydata() == pytest.approx(half)
    assert below.lines[0].get_ydata() == pytest.approx([2, 12])
