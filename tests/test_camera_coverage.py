"""A small draw of the Monte Carlo of the camera calibration; `make coverage` runs the large one."""

import numpy as np
import pytest

from benchmarks._draws import BAND
from benchmarks.camera_coverage import STUDIES, coverage, main

DRAWS = 12


@pytest.fixture(scope="module")
def rows():
    names = ["fields", "fields, imperfect board"]
    return {(row.study, row.parameter): row for row in coverage(DRAWS, 3, names)}


@pytest.mark.parametrize("study", ["fields", "fields, imperfect board"])
def test_intervals_hold_the_truth_and_are_no_wider_than_need_be(rows, study):
    """Over all parameters of a study; those of one draw are correlated, so bounds are wide."""
    own = [row for (name, _), row in rows.items() if name == study]
    assert len(own) == 4 + STUDIES[study].order
    inside = np.mean([row.inside for row in own])
    assert BAND[0] - 3 * np.sqrt(0.05 * 0.95 / DRAWS) < inside
    ratio = [row.rms_error / row.median_std for row in own]
    assert 0.6 < np.median(ratio) < 1.6


def test_a_study_is_repeatable(rows):
    (again, *_) = coverage(DRAWS // 4, 3, ["fields"])
    (once_more, *_) = coverage(DRAWS // 4, 3, ["fields"])
    assert again == once_more


def test_the_table_names_the_studies(capsys):
    with pytest.raises(SystemExit):
        main(["unknown"])
    assert "no study unknown; there are fields; square, wide" in capsys.readouterr().err
