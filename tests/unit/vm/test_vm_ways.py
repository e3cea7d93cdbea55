"""Ranks over facts: the shortest way to a goal, its upkeep, its bounds; goals that bodies read and heads withdraw."""

import pytest
from vm_hand import machine_of

from rmr.base.values import Symbol
from rmr.bytecode.program import ANY
from rmr.lang.compiler import compile_source
from rmr.vm import goal_ways, ranks
from rmr.vm.machine import Machine
from rmr.vm.machine_events import BoundReached, FactInserted, GoalSent, GoalWithdrawn

pytestmark = pytest.mark.usefixtures("each_engine")

MAP = """
type at(robot, area).
type sensor door(robot, area, area).
type call_off(robot, area).
at(R, a).
?at(R, {goal}).
?at(R, _), at(R, A), door(R, A, B) -o at(R, B).
call_off(R, A) -o not ?at(R, A).
"""
DOORS = "ab bc cd ax xd da"


def machine(text: str, **more: object) -> Machine:
    program = compile_source(text).program
    assert program is not None
    return machine_of(program, trace=True, **more)


def on_map(doors: str = DOORS, goal: str = "d", **more: object) -> Machine:
    """A robot in room a, with its doors."""
    made = machine(MAP.format(goal=goal), **more)
    for pair in doors.split():
        change(made, "insert", pair)
    made.start(0)
    return made


def change(made: Machine, call: str, pair: str) -> None:
    index = made.program.index("door")
    assert index is not None
    getattr(made, call)(0, index, tuple(map(Symbol, pair)))


def walked(made: Machine, runs: int = 1) -> str:
    """Where the robot goes in some runs."""
    found = ""
    for _ in range(runs):
        made.run(0)
        at = made.program.index("at")
        found += "".join(str(e.args[0]) for e in made.drain() if isinstance(e, FactInserted) and e.predicate == at)
    return found


def test_the_shortest_way_to_the_goal_is_taken_and_ends_there() -> None:
    made = on_map()
    assert walked(made) == "axd"
    assert not made.busy


def test_a_door_that_shuts_on_the_way_changes_the_way() -> None:
    made = on_map("ab bc cd ax xd xa", firing_budget=1)
    assert walked(made) == "ax"
    change(made, "withdraw", "xd")
    assert walked(made, 6) == "abcd"


def test_a_door_that_opens_on_the_way_is_used() -> None:
    made = on_map("ab bc ce ed", firing_budget=1)
    assert walked(made) == "ab"
    change(made, "insert", "bd")
    assert walked(made, 3) == "d"


def test_ways_have_precedence_over_estimates_and_these_over_no_rank() -> None:
    text = "?g(R). a(R). a(R) -o n(R). a(R) -o e(R). a(R) -o w(R). e(R), never(R) -o g(R). w(R) -o v(R). v(R) -o g(R)."
    text += "n(R) -o 1. type never(robot)."
    for ban, expected in (("", "w"), ("a(R) -o w(R).", "e")):
        made = machine(text.replace(ban, "") if ban else text)
        made.start(0)
        made.run(0)
        names = [made.program.predicates[e.predicate].name for e in made.drain() if isinstance(e, FactInserted)]
        assert names[1] == expected


def test_a_ranking_beyond_the_budget_of_a_run_is_resumed_in_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranks, "RANKING_STEPS", 3)
    made = on_map()
    made.run(0)
    assert made.firings == 0
    assert made.busy
    assert walked(made, 30) == "axd"


def test_a_robot_that_has_waited_too_long_for_its_ranks_says_so_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranks, "RANKING_STEPS", 1)
    for module in (ranks, __import__("rmr.vm.goals", fromlist=["goals"])):
        monkeypatch.setattr(module, "RANKING_RUNS_MAX", 2)
    made = on_map(firing_budget=1)
    events = []
    for _ in range(4):
        made.run(0)
        events += made.drain()
    assert made.firings > 0
    assert [(e.what, e.bound) for e in events if isinstance(e, BoundReached)] == [("ranking", 2)]


def test_a_map_too_large_for_the_search_is_reported_and_the_robot_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (goal_ways, __import__("rmr.vm.goals", fromlist=["goals"])):
        monkeypatch.setattr(module, "EDGES_MAX", 3)
    made = on_map(firing_budget=3)
    made.run(0)
    assert made.firings == 3
    assert made.dropped["ways"] == 1


def test_a_map_with_many_cycles_is_ranked_within_budgets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranks, "RANKING_STEPS", 200)
    rooms = [f"r{number}" for number in range(200)]
    text = "type at(robot, area). type !door(robot, area, area). at(R, r0). ?at(R, r100).\n"
    text += "?at(R, _), at(R, A), door(R, A, B) -o at(R, B).\n"
    text += "".join(f"door(R, {a}, {b}). door(R, {b}, {a})." for a, b in zip(rooms, rooms[1:] + rooms[:1], strict=True))
    made = machine(text)
    made.start(0)
    runs = 0
    while made.busy:
        made.run(0)
        runs += 1
        assert runs < 100
    assert made.firings == 100


def test_a_withdrawn_goal_ends_what_was_done_for_it() -> None:
    made = on_map("ab ba", "nowhere", firing_budget=5)
    assert walked(made) == "ababab"
    at = made.program.index("call_off")
    assert at is not None
    made.insert(0, at, (Symbol("nowhere"),))
    made.run(0)
    made.run(0)
    assert GoalWithdrawn(0, (Symbol("nowhere"),), 0) in made.drain()
    assert not made.busy
    assert made.goals() == {"achieved": [], "open": []}


def test_a_goal_with_a_variable_is_not_read_but_withdrawn_by_what_it_matches() -> None:
    made = machine("type p(robot, int). type t(robot). t(R). ?p(R, _). t(R), ?p(R, X) -o q(R, X). q(R, _) -o 1.")
    made.start(0)
    made.run(0)
    assert made.firings == 0
    gone = machine("type p(robot, int). type t(robot). t(R). ?p(R, _). t(R) -o not ?p(R, 7).")
    gone.start(0)
    gone.run(0)
    assert [event.args for event in gone.drain() if isinstance(event, GoalWithdrawn)] == [(ANY,)]


def test_a_goal_of_another_robot_is_withdrawn_by_a_message() -> None:
    text = "type p(robot, int). t(@1). ?p(@2, 3). t(R) -o not ?p(@2, 3). p(R, X), ?p(R, X) -o 1."
    one, other = machine(text), machine(text, robot=2)
    one.start(0)
    one.run(0)
    (sent,) = [event for event in one.drain() if isinstance(event, GoalSent)]
    other.start(0)
    assert other.goals()["open"] == ["p(@2, 3)"]
    other.want(0, sent.predicate, sent.args)
    assert other.goals() == {"achieved": [], "open": []}


def test_facts_that_stand_for_goals_come_from_no_one_else() -> None:
    made = on_map()
    table = made.program.index("?at")
    assert table is not None
    with pytest.raises(ValueError, match="stands for goals"):
        made.insert(0, table, (Symbol("a"),))
    with pytest.raises(ValueError, match="not sensed"):
        made.withdraw(0, table, (Symbol("d"),))


def test_not_of_a_goal_holds_when_no_goal_is_open() -> None:
    made = machine(
        "type p(robot, int). s(R, 0). ?p(R, 2). s(R, N), ?p(R, _) -o s(R, N + 1), p(R, N). "
        "s(R, N), not ?p(R, _) -o done(R, N). p(R, _), never(R) -o 1. done(R, N), never(R) -o 1. "
        "type never(robot)."
    )
    made.start(0)
    made.run(0)
    assert "done(@1, 3)" in made.facts()
