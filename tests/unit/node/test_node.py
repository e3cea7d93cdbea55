"""A robot without a body, as `rmr eval` hosts it: what it costs, what it says, when it is idle, what it notes."""

import gc
import tracemalloc
from itertools import pairwise

import pytest
from flock import Flock

from rmr.base.arena import NOWHERE
from rmr.base.time import NEVER, seconds
from rmr.base.values import Robot, Symbol
from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_source
from rmr.node.config import NodeConfig
from rmr.node.node import ROUNDS_MAX, Node
from rmr.node.payloads import PAYLOAD_OCTETS_MAX
from rmr.node.ports import Ports
from rmr.node.report import robot_report
from rmr.node.trace import ENTRIES_MAX, EVENTS, TraceLevel

pytestmark = pytest.mark.medium

NODE_OCTETS_MAX = 60_000
"""Of a robot with three rules, so that 10,000 of them fit in 600 MB."""


class Silence:
    """A link on which nobody is."""

    payload_max = PAYLOAD_OCTETS_MAX

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: int = NEVER) -> None:
        raise AssertionError("a robot that has nothing to say has said something")

    def receive(self) -> list:
        return []

    def confirmations(self) -> list:
        return []


def compiled(source: str) -> Program:
    compilation = compile_source(source)
    assert compilation.program is not None, compilation.diagnostics
    return compilation.program


def alone(source: str, **options: object) -> Flock:
    return Flock(source, robots=1, **options)  # type: ignore[arg-type]


# -- what it costs


def test_a_robot_without_a_body_that_has_nothing_to_do_sleeps_for_ever_and_says_nothing():
    node = Node(NodeConfig(1, (1, 2), NOWHERE, 0), compiled("done(R)."), Ports(Silence(), None), {})
    node.start(0)
    node.tick(0)
    assert node.next_wake == NEVER
    assert node.outstanding == ()


def test_a_robot_with_three_rules_takes_little_memory_however_many_others_there_are():
    program = compiled(
        """
        type token(robot, int).
        token(@1, 0).
        token(R, N), edge(R, B) -o token(B, N + 1), visited(R).
        visited(R), visited(R) -o visited(R).
        token(R, N), N > 100 -o 1.
        """
    )
    robots = 1000
    roster = dict.fromkeys(range(1, robots + 1))

    def run(robot: int) -> Node:
        config = NodeConfig(robot, roster, NOWHERE, 0, trace=TraceLevel.NOTHING)
        node = Node(config, program, Ports(Silence(), None), {}, 1)
        node.start(0)
        node.tick(0)
        return node

    run(1)
    gc.collect()
    tracemalloc.start()
    try:
        nodes = [run(robot) for robot in range(1, 101)]
        gc.collect()
        octets = tracemalloc.get_traced_memory()[0] / len(nodes)
    finally:
        tracemalloc.stop()
    assert octets < NODE_OCTETS_MAX


# -- what it knows of the others


def test_peers_are_stated_where_the_program_reads_them_and_nowhere_else():
    reading = Flock("peer(R, B) -o met(R, B).", robots=3).run()
    assert reading.facts(2) == ["met(@2, @1)", "met(@2, @3)"]
    node = Flock("done(R).", robots=3).node(2)
    assert node.senses.of("peer") == []


def test_a_host_that_knows_who_is_near_says_so_itself():
    near: list[tuple[int, float]] = [(2, 1.5)]
    flock = alone("neighbor(R, B) -o near(R, B). range(R, B, D) -o far(R, B, D).", neighbors=lambda: near).run()
    assert flock.facts(1) == ["far(@1, @2, 1.5)", "near(@1, @2)"]
    near = [(2, 1.5), (3, 2.0)]
    flock.insert(1, "near", Robot(9))
    flock.run()
    assert flock.facts(1) == ["far(@1, @2, 1.5)", "far(@1, @3, 2.0)", "near(@1, @2)", "near(@1, @3)", "near(@1, @9)"]


# -- actions


def test_an_effect_on_a_sensed_predicate_replaces_what_the_robot_held_of_it():
    flock = alone(
        """
        type sensor at(robot, area).
        type action go(R: robot, A: area) -o at(R, A) else at(R, lost).
        at(R, start).
        trip(R, middle).
        trip(R, A) -o go(R, A) then seen(R).
        at(R, A) -o been(R, A).
        """
    ).run()
    assert flock.facts(1) == ["been(@1, middle)", "been(@1, start)", "seen(@1)"]
    assert [entry["fact"] for entry in flock.noted(1, "removed") if "at(" in entry["fact"]] == ["at(@1, start)"]


def test_an_else_effect_on_a_sensed_predicate_holds_after_a_failure():
    flock = alone(
        """
        type sensor at(robot, area).
        type action go(R: robot, A: area) -o at(R, A) else at(R, lost).
        at(R, start).
        trip(R, middle).
        trip(R, A) -o go(R, A).
        at(R, A), A = lost -o sad(R).
        """,
        failing=["go"],
    ).run()
    assert flock.facts(1) == ["sad(@1)"]


def test_an_effect_on_a_sensed_predicate_without_value_is_counted_and_changes_nothing():
    flock = alone(
        """
        type sensor level(robot, int).
        type action fill(R: robot, N: int) -o level(R, 10 % N).
        level(R, 3).
        pour(R, 0).
        pour(R, N) -o fill(R, N).
        level(R, N) -o saw(R, N).
        """
    ).run()
    assert flock.facts(1) == ["saw(@1, 3)"]
    assert robot_report(flock.node(1), {})["expression_failures"] == 1
    assert len(flock.noted(1, "expression_failed")) == 1


def test_actions_that_take_no_time_and_what_follows_from_them_happen_at_one_instant():
    steps = ROUNDS_MAX - 4
    flock = alone(f"type action hop(R: robot, N: int) -o at(R, N). at(R, 0). at(R, N), N < {steps} -o hop(R, N + 1).")
    flock.run(0.001)
    assert flock.facts(1) == [f"at(@1, {steps})"]
    assert {entry["t"] for entry in flock.noted(1, "action")} == {0.0}


def test_a_program_of_endless_instant_actions_leaves_its_robot_responsive():
    flock = alone("type action hop(R: robot) -o at(R). at(R). at(R) -o hop(R).").wait(1.1)
    assert len(flock.noted(1, "restless")) == 1
    assert 60 * ROUNDS_MAX <= flock.node(1).machine.firings <= 70 * ROUNDS_MAX


@pytest.mark.parametrize("within", ["1.0", "0.999"])
def test_an_action_that_ends_at_the_very_instant_of_a_deadline_is_in_time(within):
    flock = alone(
        f"""
        type action walk(R: robot) -o there(R).
        type action warn(robot).
        watch(go(R), there(R), {within}, warn(R)).
        go(R).
        $go(R) -o walk(R).
        """,
        action_s=1.0,
    ).run()
    (job,) = flock.node(1).machine.jobs
    assert (job.finish, job.missed) == (seconds(1), within != "1.0")


def test_turns_of_robots_without_bodies_follow_each_other_without_overlapping():
    flock = Flock(
        """
        type action pass(R: robot) -o passed(R).
        type action warn(robot).
        crossing: assert(go(R), passed(R), 20, warn(R)).
        go(R).
        go(R) -o pass(R).
        """,
        robots=3,
        action_s=0.5,
    ).run()
    spans = []
    for robot in (1, 2, 3):
        (begun,), (ended,) = flock.noted(robot, "action"), flock.noted(robot, "action_ended")
        assert ended["t"] - begun["t"] == pytest.approx(0.5, abs=0.001)
        spans.append((begun["t"], ended["t"]))
        assert flock.facts(robot) == [f"passed(@{robot})"]
    spans.sort()
    assert all(before[1] <= after[0] for before, after in pairwise(spans))
    assert spans[-1][1] - spans[0][0] < 3 * 0.5 + 1.0, "a turn lasts as long as its action"


# -- idleness


def test_a_robot_says_what_it_waits_for():
    flock = Flock(
        """
        type action walk(R: robot) -o there(R).
        type action warn(robot).
        watch(go(R), there(R), 3, warn(R)).
        go(@1).
        $go(R) -o walk(R).
        there(R), go(R) -o told(@2).
        """,
        action_s=1.0,
    )
    node = flock.node(1)
    assert node.outstanding == ("a satisfied rule",)
    flock.wait(0.5)
    assert node.outstanding == ("an action", "a deadline")
    flock.wait(1.001)
    assert node.outstanding == ("a fact under way",)
    flock.wait(1.1)
    assert node.outstanding == ()


# -- what it notes


def test_a_firing_is_noted_by_its_place_or_by_its_number():
    source = "go(R).\n\ngo(R) -o done(R)."
    assert [entry["rule"] for entry in alone(source).run().noted(1, "fired")] == ["flock.rmr:3"]
    assert [entry["rule"] for entry in alone(source, debug=False).run().noted(1, "fired")] == ["rule 0"]


def test_facts_and_goals_are_noted_in_program_syntax():
    flock = alone('?done(R, _). go(R, 1.0, "x"). go(R, N, _) -o !done(R, [N, 2.5]).').run()
    assert [entry["fact"] for entry in flock.noted(1, "inserted")] == ['go(@1, 1.0, "x")', "!done(@1, [1.0, 2.5])"]
    assert [entry["fact"] for entry in flock.noted(1, "removed")] == ['go(@1, 1.0, "x")']
    assert [entry["goal"] for entry in flock.noted(1, "achieved")] == ["done(@1, _)"]


def test_an_expression_without_value_is_noted_and_counted_in_the_report():
    flock = alone("go(R, 0).\ngo(R, N) -o done(R, 1 / N).").run()
    (entry,) = flock.noted(1, "expression_failed")
    assert "flock.rmr:2" in entry["where"]
    assert robot_report(flock.node(1), {})["expression_failures"] == 1


@pytest.mark.parametrize(
    ("level", "noted"),
    [(TraceLevel.NOTHING, set()), (TraceLevel.NOTES, {"fired"}), (TraceLevel.FACTS, {"fired", "inserted"})],
)
def test_a_robot_notes_as_much_as_it_is_told(level, noted):
    flock = alone("go(R). $go(R), not done(R) -o done(R).", trace=level).run()
    assert flock.facts(1) == ["done(@1)", "go(@1)"]
    assert {entry["what"] for entry in flock.node(1).trace_log} == noted


def test_notes_that_nobody_takes_away_do_not_pile_up():
    flock = alone("go(R, 0). go(R, N), N < 9000 -o go(R, N + 1).").run()
    assert flock.node(1).machine.firings == 9000
    log = flock.node(1).trace_log
    assert ENTRIES_MAX // 2 <= len(log) <= ENTRIES_MAX
    assert log[-1]["fact"] == "go(@1, 9000)"


def test_a_note_holds_what_the_vocabulary_says():
    node = alone("done(R).").node(1)
    with pytest.raises(AssertionError):
        node.notes.note(0, "fired", rule="x", more=1)
    with pytest.raises(KeyError):
        node.notes.note(0, "invented")
    for what, event in EVENTS.items():
        node.notes.note(0, what, **dict.fromkeys(event.fields))
    assert {entry["what"] for entry in node.trace_log} >= set(EVENTS)


def test_a_fact_from_outside_must_be_known_to_the_program():
    flock = alone("type mark(robot, area).")
    flock.insert(1, "mark", Symbol("middle"))
    assert flock.run().facts(1) == ["mark(@1, middle)"]
    with pytest.raises(ValueError, match="knows no predicate missing"):
        flock.insert(1, "missing")
