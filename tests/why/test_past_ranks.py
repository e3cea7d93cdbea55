"""Ranks of the past: those of a run's firings, and those of the matches beside them, against breadth-first search."""

from collections import deque
from itertools import pairwise
from random import Random

import pytest
from observed_runs import written

from rmr.base.values import Symbol
from rmr.why.absence import why_not
from rmr.why.past_ranks import OpenGoal, PastRanks, RankSource
from rmr.why.question import question

ROOMS = "abcdefgh"


def steps_to(doors, goal):
    """Return the number of doors from each room to the goal."""
    far = {goal: 0}
    queue = deque([goal])
    while queue:
        room = queue.popleft()
        for one, other in doors:
            if other == room and one not in far:
                far[one] = far[room] + 1
                queue.append(one)
    return far


def map_text(doors):
    facts = "  ".join(f"door(R, {one}, {other})." for one, other in doors)
    return f"""\
type at(robot, area).
type !door(robot, area, area).
at(R, a).
{facts}
?at(R, h).

at(R, A), door(R, A, B) -o at(R, B).
"""


def moment(observed, mind, record):
    """Return the ranks just before a firing."""
    held = [fact for predicate in list(mind.by_predicate) for fact in mind.held_before(predicate, record.number)]
    goals = [OpenGoal(*goal) for goal in record.goals]
    return held, PastRanks(observed.program, mind.robot, record.at, held, goals)


@pytest.mark.parametrize("seed", range(6))
def test_ranks_of_all_matches_at_each_firing_are_the_shortest_ways_over_the_doors(seed, tmp_path, monkeypatch):
    draw = Random(f"past ranks {seed}")
    doors = draw.sample([(one, other) for one in ROOMS for other in ROOMS if one != other], 14)
    observed = written(map_text(doors), "--robots 1 --until 0.01", tmp_path, monkeypatch)
    far = steps_to(doors, "h")
    mind = observed.past.minds(1)[0]
    ranked = list(mind.firings.values())[:20]
    compared = 0
    for record in ranked:
        held, ranks = moment(observed, mind, record)
        assert ranks.of(record.rule, record.matched) == ranks.of_firing(record)
        here = next(fact for fact in held if fact.args and len(fact.args) == 1)
        for door in held:
            if len(door.args) != 2 or door.args[0] != here.args[0]:
                continue
            found = ranks.of(record.rule, (here.serial, door.serial))
            wanted = far.get(str(door.args[1]))
            if not record.goals:
                assert found.source is RankSource.NONE
            elif wanted is None:
                assert found.source is RankSource.ESTIMATE
            else:
                assert (found.rank, found.source) == (wanted, RankSource.FACTS)
                assert len(found.way) == wanted
                rooms = [str(door.args[1]), *[str(step.args[0]) for step in found.way]]
                assert all(pair in doors for pair in pairwise(rooms))
                assert not found.way or found.way[-1].args == (Symbol("h"),)
            compared += 1
    assert compared >= bool(ranked)


def test_json_of_a_match_that_was_passed_over_has_its_rank_and_its_source(tmp_path, monkeypatch):
    text = map_text([("a", "b"), ("b", "d"), ("d", "h"), ("a", "c"), ("c", "h")])
    observed = written(text, "--robots 1", tmp_path, monkeypatch)
    past = observed.past
    data = why_not(past, question("at(@1, b)", past.program, [1])).as_data()
    passed = next(each for each in data["absent"][0]["children"][0]["children"] if each["kind"] == "passed over")
    assert [(each["kind"], each["rank"], each["ranked_by"]) for each in passed["children"]] == [
        ("match", 2, "facts"),
        ("match", 1, "facts"),
    ]
    assert "rank" not in passed


def test_match_before_which_nothing_came_is_not_passed_over(tmp_path, monkeypatch):
    observed = written(map_text([("a", "h")]), "--robots 1", tmp_path, monkeypatch)
    assert "came first" not in observed.why_not("at(@1, b)")


def test_rule_that_is_satisfied_all_along_is_passed_over_by_the_newest_firing(tmp_path, monkeypatch):
    # Nobody knows a door to h: the robot walks to and fro, and a rule that leads to no goal never has its turn.
    text = map_text([("a", "b"), ("b", "a")]) + "lamp(R).\nlamp(R) -o light(R).\n"
    observed = written(text, "--robots 1 --until 0.01", tmp_path, monkeypatch)
    newest = max(observed.past.minds(1)[0].firings)
    answer = observed.why_not("light(@1)")
    assert "its body is satisfied" in answer
    assert f"and firing {newest}, rule a.rmr:7, came first" in answer
    assert "this match of lamp(@1): no rank: no open goal follows" in answer
    assert "rank 1 by estimate: there was no way over the facts that held" in answer
