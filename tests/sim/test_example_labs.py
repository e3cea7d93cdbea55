"""The labs of docs/examples/labs: they are checked without a warning, finish, and survive faults at random."""

import math
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest
from command_runner import invoke

from rmr.base.time import in_seconds, seconds
from rmr.commands.subcommands import command as main
from rmr.node.trace import TraceLevel
from rmr_sim.run_setup import Options, load, report_of

LABS = Path(__file__).parents[2] / "docs" / "examples" / "labs"
SHELF = (1.8, 1.5)
"""The area `north` of the lab aisles."""
TIER = {
    "aisles/lab.yaml": pytest.mark.slow,
    "aisles/through.yaml": pytest.mark.slow,
    "charging/lab.yaml": pytest.mark.slow,
    "crossing/lab.yaml": pytest.mark.medium,
    "junction/intersection.yaml": pytest.mark.medium,
    "junction/lab.yaml": pytest.mark.medium,
    "office/lab.yaml": pytest.mark.medium,
}
"""The labs; a run of each is shared by the tests of one tier."""
FILES = list(TIER)


@cache
def ran(file, seed, *, chaos=False):
    """Return the simulation of a lab when it is over, and whether it finished."""
    simulation = load(LABS / file, Options(chaos=chaos)).simulation(seed)
    return simulation, simulation.run()


def turns_of(simulation, event):
    """Return the turns of an event, each with its begin, its end and its robot, in order of their begin."""
    begun, turns = {}, []
    for entry in simulation.trace():
        if entry["what"] == "entered" and entry["event"] == event:
            begun[entry["robot"]] = entry["t"]
        elif entry["what"] == "left" and entry["event"] == event:
            turns.append((begun.pop(entry["robot"]), entry["t"], entry["robot"]))
    return sorted(turns)


@pytest.mark.parametrize("program", sorted(LABS.glob("*/*.rmr")), ids=lambda path: path.stem)
def test_rmr_check_has_no_warning_about_an_example_lab(program):
    result = invoke(main, ["check", str(program)])
    assert (result.exit_code, result.output) == (0, "")


@pytest.mark.parametrize("file", FILES)
def test_an_example_lab_is_judged_without_a_warning(file):
    assert load(LABS / file, Options()).warnings == ()


@pytest.mark.parametrize("file", [pytest.param(file, marks=TIER[file]) for file in FILES])
def test_an_example_lab_finishes_without_contact(file):
    simulation, finished = ran(file, 1)
    assert finished
    assert [violation.words for violation in simulation.violations] == []


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES)
def test_an_example_lab_finishes_after_faults_at_random(file):
    _, finished = ran(file, 3, chaos=True)
    assert finished


@pytest.mark.slow
def test_one_turn_covers_the_way_in_the_loading_and_the_way_out():
    simulation, _ = ran("aisles/lab.yaml", 1)
    for event in ("fetching(north)", "fetching(south)"):
        turns = turns_of(simulation, event)
        assert len(turns) == 6
        assert all(end <= begin for (_, end, _), (begin, _, _) in pairwise(turns))


@pytest.mark.slow
def test_a_robot_restarted_in_an_aisle_without_localisation_leaves_the_aisle_before_it_asks_for_a_turn():
    lab = LABS / "aisles"
    simulation = load(lab / "lab.yaml", Options(actions=lab / "actions.py")).simulation(1, TraceLevel.FACTS)
    restarts = []

    def restart_the_first_robot_at_the_north_shelf(now):
        at_shelf = [r.robot for r in simulation.robots if math.dist(simulation.world.pose(r.robot)[:2], SHELF) < 0.05]
        if at_shelf and not restarts:
            restarts.append((in_seconds(now), at_shelf[0]))
            simulation.kill(at_shelf[0])
            simulation.silence(at_shelf[0], now + seconds(5))
            simulation.restart(at_shelf[0])

    simulation.observers.append(restart_the_first_robot_at_the_north_shelf)
    assert simulation.run()
    ((at, robot),) = restarts
    new_life = [entry for entry in simulation.trace() if entry["robot"] == robot and entry["t"] > at]
    left_aisle = next(e["t"] for e in new_life if e["what"] == "removed" and "in_" in e["fact"])
    asked = next(e["t"] for e in new_life if e["what"] == "asks")
    assert left_aisle < asked


@pytest.mark.slow
def test_both_aisles_are_in_use_at_one_time():
    simulation, _ = ran("aisles/lab.yaml", 1)
    north, south = (turns_of(simulation, f"fetching({aisle})")[0] for aisle in ("north", "south"))
    assert north[0] < south[1]
    assert south[0] < north[1]


@pytest.mark.slow
def test_turns_of_an_aisle_that_is_no_bottleneck_do_not_overlap():
    simulation, _ = ran("aisles/through.yaml", 1)
    turns = turns_of(simulation, "through(south)")
    assert sorted(robot for _, _, robot in turns) == [5, 6, 7, 8]
    assert all(end <= begin for (_, end, _), (begin, _, _) in pairwise(turns))


@pytest.mark.slow
def test_each_charging_place_has_one_robot_at_a_time():
    simulation, _ = ran("charging/lab.yaml", 1)
    for place in ("west", "east"):
        turns = turns_of(simulation, f"charging({place})")
        assert len(turns) >= 3
        assert all(end <= begin for (_, end, _), (begin, _, _) in pairwise(turns))


@pytest.mark.medium
def test_eight_robots_cross_the_intersection_one_at_a_time():
    simulation, _ = ran("crossing/lab.yaml", 1)
    turns = turns_of(simulation, "crossing()")
    assert len({robot for _, _, robot in turns}) == 8
    assert all(end <= begin for (_, end, _), (begin, _, _) in pairwise(turns))


@pytest.mark.medium
@pytest.mark.parametrize("file", ["junction/intersection.yaml", "junction/lab.yaml"])
def test_where_corridors_meet_robots_are_inside_together_and_most_are_on_time(file):
    simulation, finished = ran(file, 1)
    turns = turns_of(simulation, "junction_1")
    assert {robot for _, _, robot in turns} == set(range(1, 9))
    assert sum(begin < end for (_, end, _), (begin, _, _) in pairwise(turns)) >= 2
    assert report_of(simulation, finished)["deadlines"]["met"] >= 6  # without turns one


@pytest.mark.slow
def test_robots_that_meet_in_the_hall_between_four_rooms_come_out_of_the_jam():
    simulation, finished = ran("office/lab.yaml", 3)
    assert finished
    assert [violation.words for violation in simulation.violations] == []


@pytest.mark.slow
def test_a_robot_that_turns_round_in_a_door_comes_out_of_it():
    _, finished = ran("office/lab.yaml", 6, chaos=True)
    assert finished
