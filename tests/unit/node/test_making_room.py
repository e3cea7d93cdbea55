"""A robot that waits for its turn on the goal of the one whose turn it is drives out of the way; no other one does."""

from rmr.base.geometry import distance
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
LAB = """\
lab: swap
program: swap.rmr
duration: 45s
finish: done(R)
arena: {size: [2.0, 1.5]}
areas:
  west: {at: [0.4, 0.75]}
  east: {at: [1.6, 0.75]}
robots:
  - {id: 1, pose: [0.4, 0.8, 0deg]}
  - {id: 2, pose: [1.6, 0.7, 0deg]}
localisation: {beacons: [[0, 0], [2.0, 0]]}
facts:
"""


def swap(tmp_path, *facts):
    """Run a lab in which robot 1 wants to go to the east, where robot 2 stands; return whether it finishes, and it."""
    (tmp_path / "swap.rmr").write_text(PROGRAM)
    (tmp_path / "lab.yaml").write_text(LAB + "".join(f"  - {fact}\n" for fact in facts))
    simulation = load(tmp_path, Options()).simulation(1)
    return simulation.run(), simulation


def test_robots_that_want_to_each_other_s_place_one_at_a_time_both_arrive(tmp_path):
    finished, _ = swap(tmp_path, "goes(@1, east)", "due(@1, 20)", "goes(@2, west)", "due(@2, 40)")
    assert finished


def test_a_robot_that_waits_for_no_turn_stays_where_it_is(tmp_path):
    finished, simulation = swap(tmp_path, "goes(@1, east)", "due(@1, 20)", "goes(@2, west)")
    pose = simulation.robots[1].node.driver.localiser.pose
    assert not finished
    assert distance(pose.x, pose.y, 1.6, 0.7) < 0.02
