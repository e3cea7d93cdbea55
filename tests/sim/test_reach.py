"""The action `reach`: straight to a point, between two instants, or not at all."""

import math

import pytest
from lab_maker import small_lab, traced

PROGRAM = """
type action reach(R: robot, X: float, Y: float, B: float, E: float) -o there(R) else astray(R).
go(@1).
go(R) -o reach(R, {where}, {begins}, {ends}).
"""


def ended(simulation):
    simulation.run()
    (entry,) = traced(simulation, "action_ended")
    return entry["t"], entry["failure"]


def test_a_robot_leaves_and_arrives_when_it_is_told_to(tmp_path):
    simulation = small_lab(tmp_path, PROGRAM.format(where="0.7, 0.8", begins=2, ends=7), finish="there(R)")
    places = {}
    simulation.observers.append(lambda now: places.setdefault(now // 10**9, simulation.world.pose(1)[:2]))
    at, failure = ended(simulation)
    assert failure is None
    assert 6.5 <= at <= 7.2
    assert math.dist(places[2], (0.2, 0.2)) < 0.01
    assert math.dist(simulation.world.pose(1)[:2], (0.7, 0.8)) < 0.03


def test_robot_already_at_its_place_arrives_with_the_others(tmp_path):
    simulation = small_lab(tmp_path, PROGRAM.format(where="0.2, 0.2", begins=1, ends=3), finish="there(R)")
    at, failure = ended(simulation)
    assert failure is None
    assert 2.5 <= at <= 2.6


@pytest.mark.parametrize("where", ["1.5, 0.2", "9.0, 9.0", "1e300, -1e300"])
def test_no_straight_way_into_a_wall_is_tried(tmp_path, where):
    simulation = small_lab(tmp_path, PROGRAM.format(where=where, begins=0, ends=3), finish="astray(R)")
    at, failure = ended(simulation)
    assert failure == "the wall is in the straight way there"
    assert at < 1.0


def test_reach_fails_without_contact_when_a_robot_blocks_the_straight_path(tmp_path):
    program = PROGRAM.format(where="0.9, 0.2", begins=0, ends=4)
    simulation = small_lab(tmp_path, program, robots=2, duration="12s")
    at, failure = ended(simulation)
    assert failure == "robot 2 stands in the straight way there"
    assert 9.0 <= at <= 9.1
    assert simulation.world.collisions == 0


def test_reach_with_unreachable_instants_is_no_error(tmp_path):
    program = PROGRAM.format(where="0.7, 0.8", begins="-1e300", ends="1e300")
    simulation = small_lab(tmp_path, program, duration="2s")
    assert not traced(simulation, "action_ended")
    simulation.run()
    assert math.dist(simulation.world.pose(1)[:2], (0.2, 0.2)) < 0.02
