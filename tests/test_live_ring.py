"""The ring of newest fields: who is where, and what was overtaken."""

import numpy as np

from glint_aoa.live.ring import FieldRing
from glint_aoa.live.sources import Arrival


def filled(numbers, capacity=8):
    ring = FieldRing(capacity, (2, 3), np.uint8)
    for number in numbers:
        ring.put(Arrival(number, np.full((2, 3), number, np.uint8), number / 10, 100.0 + number))
    return ring


def test_an_empty_ring_holds_nothing():
    ring = filled([])
    assert (ring.newest, ring.oldest) == (-1, 0)
    assert not ring.holds(0, 8).any()


def test_the_newest_fields_are_there_by_their_numbers():
    ring = filled(range(21))
    assert (ring.newest, ring.oldest) == (20, 13)
    assert ring.holds(12, 22).tolist() == [False, *[True] * 8, False]
    fields, here = ring.copy(np.array([13, 17, 20]))
    assert here.all()
    assert fields[:, 0, 0].tolist() == [13, 17, 20]
    starts, arrived = ring.clocks(15, 18)
    assert starts.tolist() == [1.5, 1.6, 1.7]
    assert arrived.tolist() == [115.0, 116.0, 117.0]


def test_a_lost_field_leaves_its_place_to_nobody():
    ring = filled([0, 1, 2, 5, 6])
    assert ring.holds(0, 7).tolist() == [True, True, True, False, False, True, True]
    # Field 3 of the round before is not taken for field 11.
    ring = filled([*range(11), 12])
    assert ring.holds(9, 13).tolist() == [True, True, False, True]


def test_a_view_ends_at_the_seam_and_is_no_copy():
    ring = filled(range(10))
    assert ring.view(6, 10).shape[0] == 2
    assert np.shares_memory(ring.view(6, 8), ring.view(6, 8))
    assert ring.view(8, 10)[:, 1, 2].tolist() == [8, 9]


def test_copies_go_across_the_seam():
    ring = filled(range(11))
    out = np.zeros((6, 2, 3), np.uint8)
    assert ring.copy_to(out, 5, 11).all()
    assert out[:, 0, 0].tolist() == [5, 6, 7, 8, 9, 10]


def test_a_reader_that_was_overtaken_is_told():
    ring = filled(range(8))
    fields = np.zeros((4, 2, 3), np.uint8)
    before = ring.holds(0, 4)
    for number in (8, 9):
        ring.put(Arrival(number, np.full((2, 3), number, np.uint8), 0.0, 0.0))
    assert before.all()
    assert ring.copy_to(fields, 0, 4).tolist() == [False, False, True, True]
