"""The table of escapes: which one is taken, and what it has the robot do."""

from dataclasses import replace

import bench
import pytest

from rmr.base.direction import direction_of
from rmr.base.geometry import Point
from rmr.base.time import seconds
from rmr.node.motion.gate import EntryGate
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.route import leader_route
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.motion.speed_law import HAZARDS
from rmr.node.motion.standoff.escapes import ESCAPES, REVERSE_S, DeadlockCause, Impasse, Manoeuvre
from rmr.node.motion.standoff.policy import EscapePolicy

FLOOR = bench.testbed()
AT, GOAL = Point(0.3, 0.4), Point(0.3, 1.1)
DEADLOCK = Impasse(
    symptom=DeadlockCause.DEADLOCK,
    now=0,
    robot=1,
    arena=FLOOR,
    at=AT,
    goal=GOAL,
    parked=(),
    others=[Point(0.3, 0.57)],
    driving=(),
    route=leader_route(FLOOR, AT, GOAL, (), through_gate=False),
    gate=EntryGate(FLOOR.shape, holding=False),
    tries=1,
    endured=0,
    replan=lambda: False,
)


def within(way: int) -> Impasse:
    """Return a deadlock in a bottleneck with two entrances, entered by the one of index `way`."""
    assert DEADLOCK.route is not None
    gate = EntryGate(FLOOR.shape, holding=False)
    gate.passed = True
    return replace(DEADLOCK, gate=gate, route=replace(DEADLOCK.route, gate_m=0.0, way=way, room_m=0.19))


def chosen(impasse: Impasse, without: frozenset[str] = frozenset()) -> tuple[str, Manoeuvre]:
    switches = RuleSwitches(without)
    manoeuvre = EscapePolicy(switches).choose(impasse)
    assert manoeuvre is not None
    (name,) = switches.firings
    return name, manoeuvre


@pytest.mark.parametrize(
    ("impasse", "name"),
    [
        (DEADLOCK, "reverse"),
        (replace(DEADLOCK, replan=lambda: True), "detour"),
        (replace(DEADLOCK, others=[GOAL], replan=lambda: True), "detour"),
        (replace(DEADLOCK, endured=1, replan=lambda: True), "retreat"),
        (replace(DEADLOCK, at=Point(0.75, 0.75), goal=Point(1.38, 0.9), endured=4, robot=2), "reverse"),
        (replace(DEADLOCK, symptom=DeadlockCause.NO_WAY_BACK, endured=1), "retreat"),
        (within(1), "give_way"),
    ],
)
def test_the_first_escape_of_the_table_that_applies_and_finds_room_is_taken(impasse: Impasse, name: str) -> None:
    assert chosen(impasse)[0] == name


def test_an_escape_that_is_left_out_is_not_taken() -> None:
    jam = replace(DEADLOCK, endured=1, replan=lambda: True)
    assert [chosen(jam, frozenset(names))[0] for names in ((), ("retreat",), ("retreat", "detour"))] == [
        "retreat",
        "detour",
        "reverse",
    ]


def test_without_a_way_back_a_robot_waits_until_the_deadlock_endures() -> None:
    assert EscapePolicy(RuleSwitches()).choose(replace(DEADLOCK, symptom=DeadlockCause.NO_WAY_BACK)) is None


def test_where_there_is_no_way_around_the_reverse_manoeuvre_is_twice_as_long() -> None:
    around = [chosen(replace(DEADLOCK, tries=tries, replan=lambda: True))[1].reverse for tries in (1, 2, 3)]
    assert around == [seconds(REVERSE_S), seconds(REVERSE_S), seconds(2.0 * REVERSE_S)]
    assert chosen(DEADLOCK)[1].reverse == seconds(2.0 * REVERSE_S)


def test_head_to_head_in_a_bottleneck_one_direction_gives_way_ever_farther_and_the_other_stays() -> None:
    ways = [chosen(replace(within(1), tries=tries))[1].reverse for tries in range(1, 9)]
    assert ways == sorted(ways)
    assert ways[0] < ways[3] < ways[-1] == ways[-2]
    assert {chosen(replace(within(0), tries=tries))[1].reverse for tries in range(1, 9)} == {0}


def test_head_to_head_where_corridors_meet_no_two_of_different_entrances_go_back_equally_far() -> None:
    for end in range(4):
        ways = [direction_of(entrance, end, 4) for entrance in range(4) if entrance != end]
        assert len({chosen(within(way))[1].reverse for way in ways}) == len(ways)


def test_every_rule_and_every_escape_has_a_name_of_its_own() -> None:
    names = [rule.name for rule in (*HAZARDS, *ESCAPES)]
    assert len(names) == len({*names})


def test_a_rule_that_does_not_exist_cannot_be_left_out() -> None:
    with pytest.raises(ValueError, match="no rule of motion is called 'retreet'"):
        Navigator(FLOOR, 1, switches=RuleSwitches(frozenset(["retreet"])))
