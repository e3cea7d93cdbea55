"""Rules that an open goal ranks take their matches in turn, as a rotor-router walk goes through the doors of a room."""

from collections import Counter
from itertools import pairwise
from random import Random

import pytest
from vm_hand import actions, machine_of

from rmr.base.values import Symbol
from rmr.lang.compiler import compile_source
from rmr.vm import rotor
from rmr.vm.machine import Machine
from rmr.vm.machine_events import BoundReached, FactInserted, RuleFired, RuleRepeats

pytestmark = pytest.mark.usefixtures("each_engine")

MAP = """
type location(robot, area).
type !door(robot, area, area).
location(R, a).
?location(R, {goal}).
"""
WALK = "location(R, A), door(R, A, B) -o location(R, B).\n"


def doors(*pairs: str) -> str:
    """Doors that can be used both ways."""
    return "".join(f"door(R, {a}, {b}). door(R, {b}, {a}).\n" for a, b in pairs)


LINE = doors("ab", "bc", "cd", "de")


def machine(text: str, firings: int, **more: object) -> Machine:
    """A machine that has started and fired so often."""
    program = compile_source(text).program
    assert program is not None
    made = machine_of(program, firing_budget=firings, trace=True, **more)
    made.start(0)
    made.run(0)
    return made


def places(made: Machine, name: str = "location") -> str:
    """Where the robot has been."""
    index = made.program.index(name)
    found = [event.args[0] for event in made.drain() if isinstance(event, FactInserted) and event.predicate == index]
    return "".join(map(str, found))


@pytest.mark.parametrize(
    "rule",
    [
        WALK,
        "type !shut(robot, area, area). location(R, A), door(R, A, B), not shut(R, A, B) -o location(R, B).",
        "door(R, A, B), location(R, A) -o location(R, B).",
        "location(R, A), door(R, A, B), D = B -o location(R, D).",
        "type sensor pose(robot, float). location(R, A), door(R, A, B), not pose(R, 1.0) -o location(R, B).",
    ],
)
def test_map_search_does_not_oscillate_forever(rule):
    found = places(machine(MAP.format(goal="e") + LINE + rule, 10))
    assert found == "ababcbabcde" or found.index("e") <= 20


def test_every_door_of_a_random_strongly_connected_map_is_used_within_the_bound_of_a_rotor_router_walk():
    rng = Random(4)
    for _ in range(20):
        rooms = [f"r{number}" for number in range(rng.randint(3, 9))]
        pairs = {tuple(sorted((room, rng.choice(rooms[:index])))) for index, room in enumerate(rooms) if index}
        pairs |= {tuple(sorted(rng.sample(rooms, 2))) for _ in range(rng.randint(0, 6))}
        facts = "".join(f"door(R, {a}, {b}). door(R, {b}, {a}).\n" for a, b in rng.sample(sorted(pairs), len(pairs)))
        text = MAP.format(goal="nowhere").replace("location(R, a)", "location(R, r0)") + facts + WALK
        bound = 2 * (2 * len(pairs)) * len(rooms)
        made = machine(text, bound)
        index = made.program.index("location")
        walked = [e.args[0] for e in made.drain() if isinstance(e, FactInserted) and e.predicate == index]
        used = set(pairwise(walked))
        assert len(used) == 2 * len(pairs)


def test_the_oldest_match_goes_first_until_a_match_repeats():
    text = "".join(f"task(R, {each}). tool(R, {each}).\n" for each in (1, 2, 3)) + "type !tool(robot, int). ?all(R).\n"
    text += "task(R, N), tool(R, T) -o log(R, N, T), done(R, N).\ndone(R, N), never(R) -o all(R)."
    made = machine(text, 3)
    assert [fact for fact in made.facts() if fact.startswith("log")] == [f"log(@1, {n}, {n})" for n in (1, 2, 3)]
    unwanted = machine(text.replace("?all(R).", ""), 3)
    assert [fact for fact in unwanted.facts() if fact.startswith("log")] == [f"log(@1, {n}, 1)" for n in (1, 2, 3)]


def test_without_an_open_goal_the_oldest_facts_go_first_as_ever():
    text = MAP.format(goal="a") + LINE + WALK
    assert places(machine(text, 6)) == "abababa"


def test_matches_of_a_better_rank_fire_first_regardless_of_earlier_firings():
    text = "type action push(R: robot, W: way) -o open(R, W) else at(R).\ntype !door(robot, way).\n"
    text += "at(R). door(R, a). door(R, e). ?open(R, e).\nat(R), door(R, W) -o push(R, W)."
    made = machine(text, 1)
    pushed = []
    for _ in range(3):
        (action,) = actions(made.drain())
        pushed.append(action.args)
        made.complete(0, action.serial, ok=False)
        made.run(0)
    assert pushed == [(Symbol("e"),)] * 3


def test_a_sensed_fact_that_comes_back_is_the_same():
    text = MAP.format(goal="e") + LINE + "type sensor free(robot, area, float).\n"
    text += "location(R, A), door(R, A, B), free(R, B, _) -o location(R, B).\n"
    made = machine(text, 1)
    free = made.program.index("free")
    walked = ""
    for time in range(1, 13):
        for room in "abcde":
            made.insert(time, free, (Symbol(room), time / 8))
        made.run(time)
        walked += places(made)
        for room in "abcde":
            made.withdraw(time, free, (Symbol(room), time / 8))
    assert "e" in walked


def test_more_matches_than_are_compared_leave_the_oldest_of_them_in_turn(monkeypatch):
    monkeypatch.setattr("rmr.vm.interpreter.ROTOR_MATCHES_MAX", 2)
    monkeypatch.setattr("rmr.vm.generated.ROTOR_MATCHES_MAX", 2)
    text = MAP.format(goal="e") + "".join(f"door(R, a, {room}).\n" for room in "bcd")
    made = machine(text + WALK + "location(R, b) -o location(R, a). location(R, c) -o location(R, a).", 10)
    assert Counter(places(made)) == {"a": 6, "b": 3, "c": 2}


def test_least_recent_firings_are_evicted_beyond_the_bound_and_reported(monkeypatch):
    monkeypatch.setattr(rotor, "ROTOR_MEMORY_MAX", 2)
    made = machine(MAP.format(goal="e") + LINE + WALK, 4)
    assert BoundReached("rotor", 2, 0) in made.drain()
    assert made.dropped["rotor"] >= 1


def test_rule_repeating_while_its_goal_is_open_is_reported_once():
    events = machine(MAP.format(goal="nowhere") + LINE + WALK, 500).drain()
    assert [event for event in events if isinstance(event, RuleRepeats)] == [RuleRepeats(0, 20, 0)]
    assert sum(isinstance(event, RuleFired) for event in events) == 500


@pytest.mark.parametrize(
    "text",
    [
        "n(R, 0). limit(R, 400). ?n(R, 401). type !limit(robot, int). n(R, N), limit(R, L), N < L -o n(R, N + 1).",
        "tick(R). ?tock(R). tick(R) -o tock(R). tock(R) -o tick(R), ?tock(R).",
        "tick(R). !lamp(R, 1). tick(R), lamp(R, N) -o tick(R).",
    ],
    ids=["counts", "achieves its goals", "has no goal"],
)
def test_rule_that_makes_progress_is_not_reported_as_repeating(text):
    events = machine(text, 300).drain()
    assert not [event for event in events if isinstance(event, RuleRepeats)]
    assert sum(isinstance(event, RuleFired) for event in events) == 300
