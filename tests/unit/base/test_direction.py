"""Directions of turns: one number for each pair of ends, and which of them may follow each other."""

from itertools import permutations, product

import pytest

from rmr.base.direction import DIRECTION_MAX, ENDS_MAX, EXCLUSIVE, direction_of, ends_of, leads_together, may_follow

PAIRS = list(permutations(range(ENDS_MAX), 2))


@pytest.mark.parametrize("ends", range(2, ENDS_MAX + 1))
def test_each_pair_of_ends_has_a_direction_of_its_own_beside_the_one_that_excludes_all(ends):
    of = {pair: direction_of(*pair, ends) for pair in permutations(range(ends), 2)}
    assert len(set(of.values())) == len(of)
    assert all(0 <= direction < EXCLUSIVE <= DIRECTION_MAX for direction in of.values())
    assert all(ends_of(direction) == pair for pair, direction in of.items())


@pytest.mark.parametrize(("one", "other"), list(product(PAIRS, PAIRS)))
def test_where_corridors_meet_only_those_follow_each_other_that_share_an_end_in_the_same_sense(one, other):
    a, b = direction_of(*one, ENDS_MAX), direction_of(*other, ENDS_MAX)
    assert may_follow(a, b) is (one[0] == other[0] or one[1] == other[1])
    assert leads_together(a, b) is (one[1] == other[1])
    assert not may_follow(a, EXCLUSIVE)
    assert leads_together(a, EXCLUSIVE)


def test_at_two_ends_only_equal_directions_follow_each_other_and_no_two_exclusive_turns_do():
    assert [may_follow(*pair) for pair in ((0, 0), (0, 1), (1, 0), (1, 1))] == [True, False, False, True]
    assert not may_follow(EXCLUSIVE, EXCLUSIVE)
