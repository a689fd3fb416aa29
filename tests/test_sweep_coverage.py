"""The simulated sweep of the project's aims, in a few draws; `make coverage` runs 2,000."""

import numpy as np
import pytest

from benchmarks.sweep_coverage import (
    BETWEEN_DEG,
    CASES,
    COLD_K,
    ONBOARD_STD_DEG,
    SPAN_K,
    SWEEP_DEG,
    coverage,
    drawn_sweep,
    optical_angles,
    true_scene,
    warmed,
)

DRAWS = 40


@pytest.fixture(scope="module")
def rows():
    return {row["name"]: row for row in coverage(DRAWS, seed=2, cases=CASES[:3])}


def test_the_scene_is_as_bad_as_it_says():
    scene, raw = true_scene(), optical_angles(SWEEP_DEG)[0]
    assert np.degrees(scene.camera.rotation) == pytest.approx([2, 2, 2])
    assert any(scene.camera.distortion)
    assert np.abs(raw - SWEEP_DEG).min() > 1.9  # the roll alone
    line = np.polynomial.Polynomial.fit(raw, SWEEP_DEG, 1)
    assert np.abs(line(raw) - SWEEP_DEG).max() > 5e-4  # and it is bent
    assert SWEEP_DEG.size == 25
    assert ONBOARD_STD_DEG == 0.002


def test_between_the_sweeps_angles_the_error_is_a_thousandth_of_a_degree(rows):
    assert rows["one temperature"]["rms_deg"] <= 0.001


def test_between_its_temperatures_three_thousandths(rows):
    row = rows["between two temperatures, 10 % bent"]
    # an interpolation that did nothing would be off by 0.02 deg
    assert 0.0007 < row["rms_deg"] <= 0.003


def test_a_law_without_bend_leaves_the_noise_only():
    raw = {key: optical_angles(each)[0] for key, each in (("s", SWEEP_DEG), ("b", BETWEEN_DEG))}
    rng, warm = np.random.default_rng(4), COLD_K + SPAN_K / 2
    sweep = drawn_sweep(CASES[2], raw["s"], 0.0, rng)
    off = sweep.predict(warmed(raw["b"], BETWEEN_DEG, warm, 0.0), temperature_k=warm) - BETWEEN_DEG
    assert np.sqrt(np.mean(off**2)) < 0.001


@pytest.mark.parametrize("case", [0, 1], ids=lambda number: CASES[number].name)
def test_95_percent_intervals_hold_the_truth(rows, case):
    # 24 angles of a draw count as two or three independent ones: 1 sigma of the share is 2.2 %
    assert rows[CASES[case].name]["share"] == pytest.approx(0.95, abs=0.055)


def test_a_law_that_bends_less_than_is_allowed_for_is_covered_all_the_more(rows):
    assert rows["between two temperatures, 10 % bent"]["share"] > 0.95
