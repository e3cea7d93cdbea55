"""Who may be presumed dead stands: of robots that do not hear each other only those of a majority drive on."""

from pathlib import Path

import pytest
from lab_maker import small_lab

from rmr.base.time import Instant, milliseconds, seconds
from rmr.node.peers.link_sensing import LISTED
from rmr.radio.links import Disturbance, muted, partition
from rmr_sim.simulation import Simulation

pytestmark = pytest.mark.medium

SHUTTLE = """
type action goto(robot, float, float).
go(R, X, Y, U, V) -o goto(R, X, Y) then go(R, U, V, X, Y).
go(@1, 1.3, 0.75, 0.2, 0.75). go(@2, 0.75, 1.3, 0.75, 0.2). go(@3, 1.25, 0.15, 1.25, 1.35).
"""
"""Robots that drive to and fro for ever, on ways that cross."""
CUT = seconds(1)
HEALED = seconds(30)
KNOWS = CUT + 2 * LISTED + milliseconds(500)
"""By when a robot that is cut off stands: the others list it for LISTED, and their last lists hold as long."""
PRESUMED = seconds(17)
"""By when a robot that is not heard is presumed dead, before as well as after the change."""


def shuttle(folder: Path, robots: int, *disturbances: Disturbance, faults: str = "[]") -> tuple[Simulation, "Moved"]:
    """Run robots that drive to and fro until 40 s; return the run and who moved when."""
    simulation = small_lab(folder, SHUTTLE, robots=robots, duration="40s", faults=faults)
    for disturbance in disturbances:
        simulation.disturb(disturbance)
    moved = Moved(simulation)
    simulation.observers.append(moved)
    simulation.run()
    assert simulation.world.collisions == 0
    return simulation, moved


class Moved:
    """Instants at which the wheels of each robot turned forwards or backwards."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.at: dict[int, list[Instant]] = {robot.robot: [] for robot in simulation.robots}

    def __call__(self, now: Instant) -> None:
        for robot in self.simulation.robots:
            if robot.alive and robot.node.driver.speed:
                self.at[robot.robot].append(now)

    def between(self, robot: int, since: Instant, until: Instant) -> bool:
        return any(since <= at < until for at in self.at[robot])


def test_of_two_robots_that_presume_each_other_dead_only_the_one_with_the_least_id_drives(tmp_path):
    _, moved = shuttle(tmp_path, 2, partition(((1,), (2,)), CUT, HEALED))
    assert not moved.between(2, KNOWS, HEALED)
    assert moved.between(1, PRESUMED, HEALED)
    assert moved.between(2, HEALED + seconds(1), seconds(40)), "it goes on as soon as they hear each other"


def test_a_mute_robot_stands_and_the_others_pass_it_until_it_is_heard_again(tmp_path):
    _, moved = shuttle(tmp_path, 3, muted(3, (1, 2, 3), CUT, HEALED))
    assert not moved.between(3, KNOWS, HEALED)
    assert moved.between(1, PRESUMED, HEALED)
    assert moved.between(3, HEALED + seconds(1), seconds(40))


def test_a_robot_restarted_in_the_smaller_part_stands_however_long_it_has_listened(tmp_path):
    faults = "[{at: 5.0, kill: 3}, {at: 6.0, restart: 3}]"
    _, moved = shuttle(tmp_path, 3, partition(((1, 2), (3,)), CUT, HEALED), faults=faults)
    assert not moved.between(3, KNOWS, HEALED)
    assert moved.between(3, HEALED + seconds(1), seconds(40))


def test_robots_that_hear_each_other_do_not_miss_one_that_has_died_for_long(tmp_path):
    _, moved = shuttle(tmp_path, 3, faults="[{at: 3.0, kill: 3}]")
    assert moved.between(1, seconds(20), seconds(25))
    assert moved.between(2, seconds(20), seconds(25))
