"""The localiser: from samples of a standing robot to where it is."""

import math
from pathlib import Path

import pytest

from rmr.base.time import tick_start
from rmr.node.peers.perception import Localiser
from rmr_world.lab_file import load_lab
from rmr_world.physics import World

LABS = Path(__file__).parents[3] / "deploy" / "labs"
TICKS = 120


@pytest.mark.parametrize("seed", range(24, 32))
def test_a_robot_far_from_both_beacons_and_near_their_wall_finds_itself_on_its_side_of_it(seed):
    lab = load_lab(LABS / "twoway")  # of seed 28 the first ranges of robot 3 meet on the wall itself
    world = World(lab, seed)
    localisers = {robot.id: Localiser(lab.arena) for robot in lab.robots}
    for tick in range(1, TICKS + 1):
        world.step(tick_start(tick))
        for robot, localiser in localisers.items():
            localiser.feed(world.sense(robot, tick_start(tick)))
    for robot, localiser in localisers.items():
        assert localiser.pose is not None
        assert math.dist(localiser.pose[:2], world.pose(robot)[:2]) < 0.03
