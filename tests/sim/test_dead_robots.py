"""Robots that die for good, or are silent for long: the others pass where the floor allows it, and else are told why.

Faults are scripted: a robot is killed at an instant at which it stands in the queue, before the gate, inside or beyond.
"""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from rmr.base.time import TICK_S, in_seconds, seconds
from rmr_sim.run_setup import Options, load, report_of
from rmr_world.lab import Fault, Kill, Restart, Stall

LABS = Path(__file__).parents[2] / "deploy" / "labs"
TOLD_S = 37.0 + TICK_S
"""A drive that the dead bar fails within this after their last word (docs/coordination.md)."""

LONG = """
lab: long
program: long.rmr
duration: 120s
finish: across(R)
quorum: living
arena: {size: [5.6, 1.0]}
obstacles: [{box: [1.0, 0.0, 4.6, 0.35]}, {box: [1.0, 0.65, 4.6, 1.0]}]
areas:
  west: {at: [1.0, 0.5]}
  east: {at: [4.6, 0.5]}
  left: {slots: [[0.2, 0.8], [0.5, 0.8]]}
  right: {slots: [[5.4, 0.2], [5.1, 0.2]]}
bottleneck: {mouths: [west, east]}
robots: [{id: 1, pose: [0.5, 0.2, 0deg]}, {id: 2, pose: [5.1, 0.8, 180deg]}]
facts: ["goes(@1, right)", "goes(@2, left)", "due(@1, 40)", "due(@2, 60)"]
"""


def ran(lab, *faults: Fault, seed=7, duration_s=100.0):
    """Run a lab with these faults, finished by its living; return the simulation, its report and its trace."""
    loaded = load(lab, Options())
    changed = replace(loaded.lab, faults=faults, quorum="living", duration=seconds(duration_s))
    simulation = replace(loaded, lab=changed).simulation(seed)
    report = report_of(simulation, simulation.run())
    return simulation, report, simulation.trace()


def kill(at_s: float, robot: int) -> Kill:
    return Kill(seconds(at_s), robot)


def failures(trace, action="moveto"):
    """Return when and why each robot's drive failed."""
    return {
        entry["robot"]: (entry["t"], entry["failure"])
        for entry in trace
        if entry["what"] == "action_ended" and entry["action"].startswith(action) and entry["failure"]
    }


@pytest.fixture
def long(tmp_path):
    """Return a lab with a corridor of 3.6 m, one robot wide, and a robot on each side."""
    (tmp_path / "lab.yaml").write_text(LONG)
    (tmp_path / "long.rmr").write_text((LABS / "twoway" / "twoway.rmr").read_text())
    return tmp_path


def inside(trace, robot, until_s):
    """Return from when to when the robot had its turn inside."""
    begins = next(entry["t"] for entry in trace if entry["what"] == "entered" and entry["robot"] == robot)
    ends = [entry["t"] for entry in trace if entry["what"] == "left" and entry["robot"] == robot]
    return begins, min(ends, default=until_s)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("at_s", "robot"),
    [
        (0.2, 3),
        (0.6, 3),
        (3.0, 1),
        (6.0, 1),
        (6.0, 4),
        (9.0, 3),
        (18.0, 6),
    ],
)
def test_living_pass_a_robot_that_died_before_its_slot_in_the_queue_or_beyond(at_s, robot):
    """One silent for 15 s does not leave the queue any more: those behind it drive around it."""
    _, report, _ = ran(LABS / "corridor", kill(at_s, robot))
    assert report["finished"]
    assert report["dead"] == [robot]


@pytest.mark.slow
def test_two_dead_one_of_them_the_leader_do_not_keep_the_living_from_finishing():
    _, free, trace = ran(LABS / "corridor")
    leader = next(entry["robot"] for entry in trace if entry["what"] == "leads")
    assert free["finished"]
    other = 1 if leader != 1 else 3
    _, report, _ = ran(LABS / "corridor", kill(2.0, leader), kill(2.0, other))
    assert report["finished"]
    assert report["dead"] == sorted([leader, other])


@pytest.mark.slow
def test_schedule_closes_over_a_dead_leader_within_seconds():
    _, _, trace = ran(LABS / "corridor")
    leader = next(entry["robot"] for entry in trace if entry["what"] == "leads")
    _, _, trace = ran(LABS / "corridor", kill(3.0, leader))
    assert any(entry["what"] == "leads" and 3.0 < entry["t"] < 6.0 for entry in trace)


@pytest.mark.parametrize(
    ("at_s", "robot"),
    [
        pytest.param(6.0, 2, id="at the gate", marks=pytest.mark.slow),
        pytest.param(9.0, 4, id="inside", marks=pytest.mark.slow),
        pytest.param(15.0, 3, id="with others inside behind it", marks=pytest.mark.medium),
    ],
)
def test_robots_behind_a_body_in_the_bottleneck_are_told_and_fail_in_time(at_s, robot):
    simulation, report, trace = ran(LABS / "corridor", kill(at_s, robot))
    told = {entry["robot"]: entry["reason"] for entry in trace if entry["what"] == "blocked"}
    failed = failures(trace)
    left = {one.robot for one in simulation.robots if one.alive and not one.finished()}
    assert not report["finished"]
    assert left
    assert {*failed} == {*told} == left
    last_s = max(in_seconds(one.node.peers.known[robot].hello_at) for one in simulation.robots if one.robot in left)
    for at, why in failed.values():
        found = re.fullmatch(
            rf"no way there: the bottleneck is blocked by robot {robot}, which has been silent since ([0-9.]+) s", why
        )
        assert found is not None
        assert at_s - 0.6 <= float(found[1]) <= at_s
        assert float(found[1]) == round(last_s, 1)
        assert at < last_s + TOLD_S
    for one in left:  # the program has its violation action, and knows why
        assert any(entry["what"] == "deadline_missed" and entry["robot"] == one for entry in trace)
        assert any(action == f"broadcast(@{one})" for _, action in report["robots"][str(one)]["actions"])
        assert "which has been silent since" in report["robots"][str(one)]["first_failure"][2]


@pytest.mark.slow
def test_standstill_report_names_the_body_in_the_bottleneck():
    """The rule of progress reports who has stood for 30 s; a drive may still be under way then."""
    _, report, _ = ran(LABS / "corridor", kill(6.0, 6), seed=2)
    words = [found["words"] for found in report["violations"] if found["check"] == "stands still"]
    assert any("the bottleneck is blocked by robot 6, which has been silent since" in each for each in words)


@pytest.mark.slow
def test_job_whose_move_has_failed_gives_its_turn_back():
    simulation, _, trace = ran(LABS / "corridor", kill(6.0, 2))
    failed = failures(trace)
    for one in failed:
        crossings = simulation.robots[one - 1].node.crossings
        assert crossings.current is None
    last = max(at for at, _ in failed.values())
    assert not [entry for entry in trace if entry["what"] == "slotted" and entry["t"] > last + 1.0]


@pytest.mark.slow
def test_place_of_a_dead_robot_is_left_to_it_and_the_others_take_other_places():
    """Robot 6 dies on its place at the exit: no other robot goes there."""
    simulation, report, _ = ran(LABS / "corridor", kill(16.0, 6))
    assert report["finished"]
    assert report["robots"]["6"]["finish_s"] is not None
    places = simulation.lab.arena.area("exit").places
    at = {one.robot: simulation.world.pose(one.robot) for one in simulation.robots}
    taken = [min(range(6), key=lambda k: (places[k].x - p.x) ** 2 + (places[k].y - p.y) ** 2) for p in at.values()]
    assert len({*taken}) == len(taken)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("stall_s", [14.0, 30.0])
def test_nobody_enters_towards_a_robot_that_is_stopped_inside(long, seed, stall_s):
    """What it announced stands until the robot itself ends it: it was inside when it said last where it is."""
    _, _, trace = ran(long, seed=seed)
    first = min((entry["t"], entry["robot"]) for entry in trace if entry["what"] == "entered")
    at_s, robot = first[0] + 9.0, first[1]
    stall = Stall(seconds(at_s), seconds(at_s + stall_s), robot)
    _, report, trace = ran(long, stall, seed=seed, duration_s=150.0)
    assert report["finished"]
    assert report["collisions"] == 0
    one, other = inside(trace, robot, 150.0), inside(trace, 3 - robot, 150.0)
    assert one[1] < other[0]
    assert one[1] > at_s + stall_s


def test_opposite_direction_fails_in_time_behind_a_body_in_the_middle(long):
    _, _, trace = ran(long, seed=1)
    first = min((entry["t"], entry["robot"]) for entry in trace if entry["what"] == "entered")
    at_s, robot = first[0] + 9.0, first[1]
    _, report, trace = ran(long, kill(at_s, robot), seed=1)
    at, why = failures(trace)[3 - robot]
    assert f"the bottleneck is blocked by robot {robot}" in why
    assert at < at_s + TOLD_S
    assert report["collisions"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["queue", "gate", "inside", "beyond"])
@pytest.mark.parametrize("back_s", [3.0, 20.0])
def test_robot_that_restarts_with_amnesia_passes_wherever_it_was(phase, back_s):
    """Neighbours on both sides: it is the third of six. A restart after 20 s comes after it counted as dead."""
    _, _, trace = ran(LABS / "corridor")
    robot = [entry["robot"] for entry in trace if entry["what"] == "entered"][2]
    entered, left = inside(trace, robot, 100.0)
    at_s = {"queue": entered - 4.0, "gate": entered - 0.3, "inside": entered + 2.0, "beyond": left + 0.5}[phase]
    _, report, _ = ran(LABS / "corridor", kill(at_s, robot), Restart(seconds(at_s + back_s), robot), duration_s=200.0)
    assert report["finished"]
    assert report["dead"] == []
