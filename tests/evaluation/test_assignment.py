"""The best assignments are the best: beside all there are."""

from itertools import permutations
from random import Random

import pytest
from assignment import least_longest, least_squares, ways_between


@pytest.mark.parametrize("seed", range(20))
def test_the_best_assignment_is_none_worse_than_any(seed):
    rng = Random(seed)
    n = 1 + seed % 6
    starts, places = ([(rng.random(), rng.random()) for _ in range(n)] for _ in range(2))
    ways = ways_between(starts, places)
    chosen = [[ways[i][k] for i, k in enumerate(order)] for order in permutations(range(n))]
    assert least_squares(ways) == pytest.approx(min(sum(way**2 for way in each) for each in chosen))
    assert least_longest(ways) == min(max(each) for each in chosen)


def test_equal_ways_are_no_trouble():
    assert least_squares([[1.0, 1.0], [1.0, 1.0]]) == 2.0
    assert least_longest([[1.0, 1.0], [1.0, 1.0]]) == 1.0
