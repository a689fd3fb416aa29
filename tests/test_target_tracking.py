"""Which circle is which target."""

import numpy as np
import pytest

from calibration.twist._tracking import track

RNG = np.random.default_rng(1)
TARGETS = np.stack(np.meshgrid(np.arange(6) * 1e-3, np.arange(4) * 1.2e-3), axis=-1).reshape(-1, 2)
TARGETS = TARGETS + RNG.uniform(-2e-4, 2e-4, TARGETS.shape)


def moved(places, turn_deg=0.0, scale=1.0, shift=(0.0, 0.0)):
    turn = scale * np.exp(1j * np.radians(turn_deg))
    there = places @ np.array([1, 1j]) * turn
    return np.stack([there.real, there.imag], axis=-1) + np.asarray(shift)


@pytest.mark.parametrize(
    ("turn_deg", "scale", "shift"),
    [(0, 1, (0, 0)), (3, 1, (2e-3, -1e-3)), (-20, 1.1, (5e-3, 5e-3)), (8, 0.9, (-4e-3, 0))],
)
def test_a_common_motion_is_undone(turn_deg, scale, shift):
    order = np.random.default_rng(2).permutation(len(TARGETS))
    circles = moved(TARGETS, turn_deg, scale, shift)[order]
    assert order[track(TARGETS, circles)].tolist() == list(range(len(TARGETS)))


def test_rows_may_move_by_themselves():
    """A wing's stations: each row turned and raised more than the one before."""
    row = np.repeat(np.arange(4), 6)
    circles = np.concatenate(
        [moved(TARGETS[row == k], -1.0 * k, 1.0, (0, 1.5e-4 * k**2)) for k in range(4)]
    )
    assert track(TARGETS, circles).tolist() == list(range(len(TARGETS)))


def test_circles_that_are_no_targets_and_targets_without_a_circle():
    rng = np.random.default_rng(3)
    others = rng.uniform(-3e-3, -1e-3, (7, 2))
    there = np.delete(np.arange(len(TARGETS)), [4, 11])
    circles = np.concatenate([others, moved(TARGETS[there], 2.0, 1.0, (1e-3, 1e-3))])
    found = track(TARGETS, circles)
    assert found[[4, 11]].tolist() == [-1, -1]
    assert found[there].tolist() == list(range(7, 7 + len(there)))


def test_a_regular_row_with_a_hidden_end_moves_least():
    row = np.stack([np.arange(6) * 1e-3, np.zeros(6)], axis=-1)
    assert track(row, row[1:]).tolist() == [-1, 0, 1, 2, 3, 4]


def test_two_targets():
    assert track(TARGETS[[0, 5]], moved(TARGETS[[0, 5]], 5.0)[::-1]).tolist() == [1, 0]


def test_nothing_there():
    assert track(TARGETS, np.empty((0, 2))).tolist() == [-1] * len(TARGETS)
    assert track(np.empty((0, 2)), TARGETS).tolist() == []
