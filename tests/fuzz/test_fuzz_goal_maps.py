"""Robots on random maps take shortest ways."""

import pytest
from goal_maps import drawn, fault_of

from rmr.vm.goal_ways import GoalWays
from rmr.vm.ranks import Ranks

pytestmark = pytest.mark.medium


def test_robots_take_shortest_ways_on_random_maps_with_doors_that_shut() -> None:
    assert {number: fault for number in range(100) if (fault := fault_of(drawn(7, number)))} == {}


@pytest.mark.parametrize("wrong", ["estimates", "no changes"])
def test_robots_that_do_not_take_shortest_ways_are_found(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if wrong == "estimates":
        monkeypatch.setattr(Ranks, "of", lambda self, rule, facts: self.estimated(facts))
    else:
        monkeypatch.setattr(GoalWays, "changed", lambda self, predicate, args, holds: True)
    assert sum(fault_of(drawn(7, number)) is not None for number in range(100)) > 2
