"""A robot that waits for its turn in the way of the one whose turn it is, or on its goal, drives off; no other does."""

import pytest

from rmr.base.geometry import distance
from rmr.base.time import seconds
from rmr_sim.run_setup import Options, load

PROGRAM = """\
type action moveto(R: robot, A: area) -o at(R, A) else stuck(R, A).
type sensor at(robot, area).
type !goes(robot, area).
type !due(robot, float).

start(R).
start(R), due(R, D), goes(R, A) -o crossing(R, D), moveto(R, A).
at(R, A), goes(R, A) -o done(R).

crossing: assert(crossing(R, D), done(R), D, broadcast(R)).

stuck(R, A) -o moveto(R, A).
"""
RING = f"""\
{PROGRAM}
type !free(robot).

start(R), free(R), goes(R, A) -o moveto(R, A).
"""
LAB = """\
lab: swap
program: swap.rmr
duration: 45s
finish: done(R)
arena: {size: [2.0, 1.5]}
obstacles:
  - {box: [0.95, 0.0, 1.05, 0.62]}
  - {box: [0.95, 0.88, 1.05, 1.5]}
areas:
  west: {at: [0.4, 0.75]}
  east: {at: [1.6, 0.75]}
robots:
  - {id: 1, pose: [0.4, 0.8, 0deg]}
  - {id: 2, pose: [X, 0.75, 0deg]}
localisation: {beacons: [[0, 0], [2.0, 0]]}
facts:
"""


RING_LAB = """\
lab: ring
program: swap.rmr
duration: 45s
finish: done(R)
arena: {size: [2.0, 1.5]}
areas:
  west: {at: [0.4, 0.4]}
  east: {at: [1.6, 0.4]}
  north: {at: [1.0, 1.2]}
robots:
  - {id: 1, pose: [0.4, 0.4, 0deg]}
  - {id: 2, pose: [1.0, 1.2, 0deg]}
  - {id: 3, pose: [1.6, 0.4, 0deg]}
localisation: {beacons: [[0, 0], [2.0, 0]]}
facts: ['goes(@1, north)', 'due(@1, 40)', 'goes(@2, east)', 'due(@2, 20)', 'goes(@3, west)', 'free(@3)']
"""


def run(tmp_path, x, *facts):
    """Run a lab in which robot 1 wants to go to the east, and robot 2 stands at `x`."""
    (tmp_path / "swap.rmr").write_text(PROGRAM)
    (tmp_path / "lab.yaml").write_text(LAB.replace("X", str(x)) + "".join(f"  - {fact}\n" for fact in facts))
    simulation = load(tmp_path, Options()).simulation(1)
    return simulation.run(), simulation


def test_robots_that_want_to_each_other_s_place_one_at_a_time_both_arrive(tmp_path):
    finished, _ = run(tmp_path, 1.6, "goes(@1, east)", "due(@1, 20)", "goes(@2, west)", "due(@2, 40)")
    assert finished


def test_a_robot_that_waits_in_a_door_lets_the_one_pass_whose_turn_it_is(tmp_path):
    finished, simulation = run(tmp_path, 1.0, "goes(@1, east)", "due(@1, 20)", "goes(@2, west)", "due(@2, 40)")
    assert finished
    assert simulation.robots[0].node.finish_at < seconds(20)  # its first drive has not failed


def test_robots_that_stand_on_each_other_s_goals_in_a_ring_all_arrive(tmp_path):
    """Robot 1 waits for its turn on the goal of 3, which needs none and stands on the goal of 2, whose turn it is."""
    (tmp_path / "swap.rmr").write_text(RING)
    (tmp_path / "lab.yaml").write_text(RING_LAB)
    simulation = load(tmp_path, Options()).simulation(1)
    assert simulation.run()
    assert all(host.node.finish_at < seconds(30) for host in simulation.robots)


@pytest.mark.parametrize("free", ["due(@3, 40)", "free(@3)"])
def test_robots_that_stand_in_the_stations_of_each_other_in_a_ring_all_arrive(tmp_path, free):
    (tmp_path / "swap.rmr").write_text(RING)
    lab = RING_LAB.replace("free(@3)", free) + "stations: [west, east, north]\n"
    (tmp_path / "lab.yaml").write_text(lab)
    simulation = load(tmp_path, Options()).simulation(1)
    assert simulation.run()


def test_a_robot_in_a_station_that_nobody_else_wants_waits_there_for_the_next_one(tmp_path):
    (tmp_path / "swap.rmr").write_text(RING)
    facts = "facts: ['goes(@1, north)', 'due(@1, 40)', 'goes(@3, west)']"
    lab = RING_LAB[: RING_LAB.index("facts:")] + f"{facts}\nstations: [west, north]\n"
    (tmp_path / "lab.yaml").write_text(lab)
    simulation = load(tmp_path, Options()).simulation(1)
    assert not simulation.run(), "robot 2 never leaves the north, and robot 3 does not set out"
    pose = simulation.robots[0].node.driver.localiser.pose
    assert distance(pose.x, pose.y, 0.4, 0.4) < 0.02


def test_a_robot_that_waits_for_no_turn_stays_where_it_is(tmp_path):
    finished, simulation = run(tmp_path, 1.6, "goes(@1, east)", "due(@1, 20)", "goes(@2, west)")
    pose = simulation.robots[1].node.driver.localiser.pose
    assert not finished
    assert distance(pose.x, pose.y, 1.6, 0.75) < 0.02


def test_a_robot_whose_goal_is_taken_waits_a_few_widths_before_it(tmp_path):
    finished, simulation = run(tmp_path, 1.6, "goes(@1, east)", "due(@1, 20)")
    pose = simulation.robots[0].node.driver.localiser.pose
    assert not finished
    assert distance(pose.x, pose.y, 1.6, 0.75) == pytest.approx(0.42, abs=0.03)
