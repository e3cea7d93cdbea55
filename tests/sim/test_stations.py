"""Stations: a place is held from before the drive into it until the hull has left; never more robots than places."""

import math
from itertools import pairwise
from pathlib import Path

import pytest
from lab_maker import traced

from rmr.base.geometry import Point
from rmr.base.time import in_seconds, seconds
from rmr.node.crossing.station_area import touches
from rmr.node.report import progress
from rmr_sim.run_setup import Options, load, prepare

LABS = Path(__file__).parents[2] / "deploy" / "labs"

PROGRAM = """
type action moveto(R: robot, A: area) -o at(R, A) else stuck(R).
type action wait(R: robot, S: float) -o charged(R).
type sensor at(robot, area).
type !bay(robot, area).
start(R).
start(R) -o low(R).
charging: assert(low(R), charged(R), 60, say(R, "late")).
low(R) -o moveto(R, dock) then wait(R, 4.0).
{then}
"""
LEAVES = "charged(R), bay(R, A) -o moveto(R, A) then done(R)."

LAB = """
lab: small
program: small.rmr
seed: 1
duration: {duration}
finish: {finish}
arena: {{size: [2.0, 1.5], cell: 0.05}}
areas:
  dock: {{slots: {slots}}}
  one: {{at: [0.2, 0.2]}}
  two: {{at: [0.2, 0.7]}}
  three: {{at: [0.2, 1.2]}}
{stations}
{radio}
robots:
  - {{id: 1, pose: [{first}, 0deg]}}
  - {{id: 2, pose: [0.2, 0.7, 0deg]}}
  - {{id: 3, pose: [0.2, 1.2, 0deg]}}
facts: ["bay(@1, one)", "bay(@2, two)", "bay(@3, three)"]
localisation: {{beacons: [[0, 0], [2.0, 0]], sigma: 0.005}}
{faults}
"""


DEAD_INSIDE = {"first": "1.7, 0.75", "faults": "faults: [{at: 3s, kill: 1}]", "last": "80s"}
"""Robot 1 begins in the station and dies there."""


def dock(
    folder,
    *,
    stations="stations: [dock]",
    slots="[[1.7, 0.75]]",
    then=LEAVES,
    finish="done(R)",
    faults="",
    last="60s",
    program=PROGRAM,
    radio="",
    first="0.2, 0.2",
):
    """Return the simulation of three robots that charge at `slots`, and the list of those there at each tick."""
    text = LAB.format(
        stations=stations, slots=slots, finish=finish, faults=faults, duration=last, radio=radio, first=first
    )
    (folder / "lab.yaml").write_text(text)
    (folder / "small.rmr").write_text(program.format(then=then))
    return watched(prepare(folder, seed=1))


def watched(simulation):
    """Return `simulation`, and a list that will hold the robots in its station whenever they change."""
    arena = simulation.lab.arena
    (area,) = (arena.area(name) for name in ("dock", "charger") if arena.area(name))
    there = [(0.0, frozenset())]

    def observe(now):
        found = [
            robot.robot
            for robot in simulation.robots
            if touches(arena, area, Point(*simulation.world.pose(robot.robot)[:2]))
        ]
        if frozenset(found) != there[-1][1]:
            there.append((in_seconds(now), frozenset(found)))

    simulation.observers.append(observe)
    return simulation, there


def turns(simulation):
    """Return (begin, end, robot) of each turn, in order of the begins; the end is None for one that was not left."""
    left = [(entry["robot"], entry["t"]) for entry in traced(simulation, "left")]
    found = []
    for entry in traced(simulation, "entered"):
        ends = [t for robot, t in left if robot == entry["robot"] and t > entry["t"]]
        found.append((entry["t"], min(ends, default=None), entry["robot"]))
    return sorted(found)


def test_a_place_is_held_from_the_drive_there_through_charging_until_the_hull_has_left(tmp_path):
    simulation, there = dock(tmp_path)
    assert simulation.run()
    assert simulation.violations == []
    found = turns(simulation)
    assert sorted(robot for *_, robot in found) == [1, 2, 3]
    assert all(end <= begin for (_, end, _), (begin, _, _) in pairwise(found))
    assert max(len(robots) for _, robots in there) == 1
    drives = {e["robot"]: e["t"] for e in traced(simulation, "action") if "dock" in e["action"]}
    waits = {e["robot"]: e["t"] for e in traced(simulation, "action_ended") if e["action"].startswith("wait")}
    for begin, end, robot in found:
        assert begin <= drives[robot] < waits[robot] < end


def test_without_the_station_robots_are_at_the_place_together(tmp_path):
    """What the key is for: a turn of the event covers one action, so the next robot comes while one charges."""
    simulation, _ = dock(tmp_path, stations="", last="25s")
    simulation.run()
    drives = sorted(e["t"] for e in traced(simulation, "action") if "dock" in e["action"])
    waits = sorted(e["t"] for e in traced(simulation, "action_ended") if e["action"].startswith("wait"))
    assert drives[1] < waits[0]


def test_a_drive_that_serves_no_job_holds_a_place_as_well(tmp_path):
    simulation, there = dock(tmp_path, program=PROGRAM.replace("charging: assert(low(R), charged(R), 60, say", "// ("))
    assert simulation.run()
    assert simulation.violations == []
    assert max(len(robots) for _, robots in there) == 1
    assert [entry["event"] for entry in traced(simulation, "entered")] == ["dock"] * 3


def test_two_places_are_used_at_a_time_and_no_more(tmp_path):
    simulation, there = dock(tmp_path, slots="[[1.7, 0.4], [1.7, 1.1]]")
    assert simulation.run()
    assert simulation.violations == []
    assert max(len(robots) for _, robots in there) == 2
    begins = [begin for begin, *_ in turns(simulation)]
    assert begins[1] - begins[0] < 1.0
    first = min(end for _, end, _ in turns(simulation))
    assert begins[2] >= first


def test_a_smaller_capacity_than_places_is_kept(tmp_path):
    simulation, there = dock(tmp_path, slots="[[1.7, 0.4], [1.7, 1.1]]", stations="stations: {dock: {capacity: 1}}")
    assert simulation.run()
    assert max(len(robots) for _, robots in there) == 1


def test_a_robot_that_never_leaves_goes_on_holding_its_place(tmp_path):
    simulation, there = dock(tmp_path, then="charged(R) -o done(R).", last="40s")
    assert not simulation.run()
    ((_, end, holder),) = turns(simulation)
    assert end is None
    assert {robots for _, robots in there[1:]} == {frozenset([holder])}
    waiting = [robot for robot in simulation.robots if robot.robot != holder]
    assert all(robot.node.finish_at is None for robot in waiting)
    words = f"station dock is full: robot {holder}"
    assert all(words in progress(robot.node, seconds(40.0)) for robot in waiting)


def test_a_robot_that_starts_or_is_restarted_in_a_station_holds_its_place(tmp_path):
    stay = "start(@3) -o done(@3).\nstart(@1) -o done(@1).\nstart(@2) -o low(@2)."
    dock(tmp_path, program=PROGRAM.replace("start(R) -o low(R).", stay), last="30s")
    text = (tmp_path / "lab.yaml").read_text().replace("{id: 1, pose: [0.2, 0.2,", "{id: 1, pose: [1.7, 0.75,")
    (tmp_path / "lab.yaml").write_text(text + "\nfaults: [{at: 8s, kill: 1}, {at: 9s, restart: 1}]\n")
    simulation, there = watched(prepare(tmp_path, seed=1))
    assert not simulation.run()
    assert {robots for _, robots in there[1:]} == {frozenset([1])}
    assert {entry["robot"] for entry in traced(simulation, "entered")} == {1}


def test_a_drive_that_is_tried_again_at_once_fails_once_in_twenty_seconds(tmp_path):
    again = PROGRAM.replace("{then}", "stuck(R) -o moveto(R, dock) then wait(R, 4.0).\n{then}")
    simulation, _ = dock(tmp_path, program=again, **DEAD_INSIDE)
    assert not simulation.run()
    failed = [e for e in traced(simulation, "action_ended") if e["failure"] and "is blocked by robot" in e["failure"]]
    assert {e["robot"] for e in failed} == {2, 3}
    for robot in (2, 3):
        times = [e["t"] for e in failed if e["robot"] == robot]
        assert all(later - earlier > 20.0 for earlier, later in pairwise([8.0, *times]))


def test_a_robot_that_may_have_left_unheard_blocks_no_station(tmp_path):
    near = "radio: {tx_power_dbm: -34}"  # surely heard within a metre, and hardly ever beyond 1.4 m
    simulation, _ = dock(tmp_path, radio=near, **DEAD_INSIDE)
    assert not simulation.run()
    assert not [e for e in traced(simulation, "action_ended") if e["failure"]]


@pytest.mark.slow
def test_a_drive_to_a_station_whose_places_the_dead_have_fails_and_names_them(tmp_path):
    simulation, _ = dock(tmp_path, faults="faults: [{at: 14s, kill: 1}, {at: 14s, kill: 2}, {at: 14s, kill: 3}]")
    simulation.run()
    holder = next(robot for begin, end, robot in turns(simulation) if begin < 14.0 and (end is None or end > 14.0))
    simulation, _ = dock(tmp_path, faults=f"faults: [{{at: 14s, kill: {holder}}}]", last="80s")
    simulation.run()
    failed = [e for e in traced(simulation, "action_ended") if "dock" in e["action"] and e["failure"]]
    assert failed
    assert f"the station dock is blocked by robot {holder}, which has been silent" in failed[0]["failure"]


LATE = """
type action moveto(R: robot, A: area) -o at(R, A).
type action goto(R: robot, X: float, Y: float).
type sensor at(robot, area).
type !bay(robot, area).
start(@1) -o low(@1, 40), goto(@1, 1.2, 0.2) then goto(@1, 0.2, 0.2) then early(@1).
start(@2) -o low(@2, 60), early(@2).
start(@3) -o low(@3, 60), early(@3).
charging: assert(low(R, D), at(R, dock), D, say(R, "late")).
early(R), low(R, _) -o moveto(R, dock).
at(R, dock), bay(R, A) -o moveto(R, A) then done(R).
start(R).
"""


def test_robots_without_a_turn_wait_in_the_queue_and_leave_room_for_those_that_drive_out(tmp_path):
    queue = "[[1.7, 0.75]], queue: {path: [[1.2, 0.75], [0.6, 0.75]], spacing: 0.25}"
    lines_up = PROGRAM.replace("low(R) -o moveto", "low(R) -o waiting(R), moveto") + (
        "type action lineup(robot, area, int).\n$waiting(R), turn(R, charging, K) -o lineup(R, dock, K).\n"
    )
    leaves = "charged(R), bay(R, A), waiting(R) -o moveto(R, A) then done(R)."
    simulation, there = dock(tmp_path, slots=queue, program=lines_up, then=leaves)
    assert simulation.run()
    assert simulation.violations == []
    assert max(len(robots) for _, robots in there) == 1
    lined_up = {e["robot"] for e in traced(simulation, "action_ended") if e["action"].startswith("lineup")}
    assert lined_up == {1, 2, 3}


def test_a_job_that_is_not_ready_for_its_slot_loses_it_to_others_and_is_served_later(tmp_path):
    """Robot 1 is due first and asks at once, but drives elsewhere before: the others do not wait for it."""
    simulation, there = dock(tmp_path, program=LATE, last="90s")
    assert simulation.run()
    asked = min(entry["t"] for entry in traced(simulation, "asks") if entry["robot"] == 1)
    ready = max(entry["t"] for entry in traced(simulation, "action_ended") if entry["action"].startswith("goto"))
    found = turns(simulation)
    first, _, robot = found[0]
    assert asked < first < ready
    assert robot != 1
    assert sorted(robot for *_, robot in found) == [1, 2, 3]
    assert max(len(robots) for _, robots in there) == 1


@pytest.mark.slow
def test_the_dock_charges_everybody_and_never_more_than_two_at_a_time():
    simulation, there = watched(load(LABS / "dock", Options()).simulation(7))
    assert simulation.run()
    assert simulation.violations == []
    assert max(len(robots) for _, robots in there) == 2
    places = simulation.lab.arena.area("charger").places
    taken = []
    for robot in simulation.robots:
        nearest = [math.dist(simulation.world.pose(robot.robot)[:2], place) for place in places]
        taken += [k for k, far in enumerate(nearest) if far < 0.1]
    assert len(taken) == len(set(taken))


BEHIND_A_DOOR = """
lab: small
program: small.rmr
seed: 1
duration: 120s
finish: done(R)
arena: {size: [3.6, 1.5], cell: 0.05}
obstacles:
  - {box: [1.6, 0.0, 2.0, 0.6]}
  - {box: [1.6, 0.9, 2.0, 1.5]}
areas:
  dock: {at: [3.3, 0.75]}
  one: {at: [0.2, 0.2]}
  two: {at: [0.2, 0.7]}
  three: {at: [0.2, 1.2]}
stations: [dock]
robots:
  - {id: 1, pose: [0.2, 0.2, 0deg]}
  - {id: 2, pose: [0.2, 0.7, 0deg]}
  - {id: 3, pose: [0.2, 1.2, 0deg]}
facts: ["bay(@1, one)", "bay(@2, two)", "bay(@3, three)"]
localisation: {beacons: [[0, 0], [3.6, 0]], sigma: 0.005}
"""


def test_a_robot_that_has_its_place_in_a_station_takes_turns_at_the_door_before_it(tmp_path):
    (tmp_path / "lab.yaml").write_text(BEHIND_A_DOOR)
    (tmp_path / "small.rmr").write_text(PROGRAM.format(then=LEAVES))
    simulation, there = watched(prepare(tmp_path, seed=1))
    assert simulation.run()
    assert simulation.violations == []
    assert simulation.world.collisions == 0
    assert max(len(robots) for _, robots in there) == 1
    entries = [(entry["robot"], entry["event"]) for entry in traced(simulation, "entered")]
    passed = [entry["robot"] for entry in traced(simulation, "left") if entry["event"] == "passage_1"]
    for robot in (1, 2, 3):  # the place first, then the door there and back; who meets one before it asks anew
        first, *others = [event for one, event in entries if one == robot]
        assert (first, set(others)) == ("charging()", {"passage_1"})
        assert passed.count(robot) == 2
