"""Tables 2 and 3 of the paper on simulated records."""

from dataclasses import replace

import numpy as np
import pytest

from glint_aoa.cli._regression_study import PAPER_ROWS, regression_study, study_record
from glint_aoa.flags import Flag
from glint_aoa.inertial import regression
from glint_aoa.inertial.channels import package_output
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.setup import Inertial


@pytest.fixture(scope="module")
def rows():
    return regression_study(seed=1)


def chosen(rows, plane, source, between_s):
    (row,) = (
        row
        for row in rows
        if (row.paper.plane, row.paper.source, row.paper.between_s) == (plane, source, between_s)
    )
    return row


def test_every_row_of_both_tables_is_there(rows):
    assert [row.paper for row in rows] == list(PAPER_ROWS)


def test_the_excitation_is_the_papers(rows):
    for row in rows:
        assert row.figures["std_deg"] == pytest.approx(row.paper.std_deg, rel=0.1)
        assert row.figures["mean_deg"] == pytest.approx(row.paper.mean_deg, abs=0.025)


@pytest.mark.parametrize(
    ("plane", "between_s", "reduction"),
    [("pitch", (15, 85), 0.71), ("pitch", (20, 40), 0.88), ("yaw", (10, 30), 0.91)],
)
def test_correlated_stretches_are_reduced_by_what_the_paper_reached(
    rows, plane, between_s, reduction
):
    row = chosen(rows, plane, "moment", between_s)
    assert row.is_correlated
    assert row.figures["reduction"] >= reduction
    assert row.figures["corrected_deg"] == pytest.approx(row.zero_deg, abs=0.003)


def test_the_uncorrelated_stretch_fails_and_is_warned_of(rows):
    row = chosen(rows, "yaw", "moment", (40, 60))
    assert not row.is_correlated
    assert row.figures["reduction"] < 0.8
    assert row.figures["standard_error_deg"] > 0.015


def test_forces_correct_less_than_moments(rows):
    for plane, between_s in (("pitch", (20, 40)), ("yaw", (10, 30))):
        force = chosen(rows, plane, "force", between_s)
        moment = chosen(rows, plane, "moment", between_s)
        assert not force.is_correlated
        assert force.figures["reduction"] < moment.figures["reduction"]


def test_the_whole_yaw_record_is_flagged_in_its_latter_part():
    record = study_record("yaw", seed=1)
    yaw = {name: each for name, each in record.channels.items() if name != "pitch_moment"}
    record = replace(record, channels=yaw)
    task = CorrectionTask(record, package_output(record), (), Inertial().filter)
    estimate = regression.estimate_bias(task, source="moment")
    flagged = (estimate.flags & Flag.UNCORRELATED) != 0
    time = task.package.channel.time_s
    assert np.mean(flagged[(time > 42) & (time < 80)]) > 0.6
    assert not flagged[time < 34].any()
    assert "not correlated with the output" in estimate.why


def test_the_moment_across_helps_where_the_moment_along_is_disturbed():
    """The yaw mode's turn in pitch is in the pitch moment, which the loose mass does not reach."""
    record = study_record("yaw", seed=1)
    task = CorrectionTask(record, package_output(record), (), Inertial().filter)
    estimate = regression.estimate_bias(task, source="moment")
    assert estimate.flags is None
    assert "pitch_moment" in estimate.why
