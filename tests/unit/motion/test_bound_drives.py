"""A turn that ends without a passage: the drive that goes on is bound to the passage no longer."""

from types import SimpleNamespace

import bench
import pytest

from rmr.base.arena import Area, Arena, FloorPassage
from rmr.base.geometry import Point, Pose
from rmr.base.time import seconds
from rmr.base.values import Robot
from rmr.node.crossing.command_executor import CommandExecutor
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.phases import Inside
from rmr.node.crossing.situation import CrossingPlan
from rmr.node.motion.navigator import Navigator
from rmr.vm.job import TimedJob

HERE = Pose(0.7, 0.75, 0.0)
BESIDE = Point(0.3, 1.2)


def room(name):
    """Return two rooms with a door between them."""
    ends = (Area("door_w", (Point(1.0, 0.75),)), Area("door_e", (Point(1.4, 0.75),)))
    walls = tuple(bench.box(1.0, low, 1.4, high) for low, high in ((0.0, 0.6), (0.9, 1.5)))
    return Arena(2.4, 1.5, 0.05, walls, ends, passages=(FloorPassage(name, ends),))


@pytest.mark.parametrize("name", ["door", "bottleneck"])
def test_a_robot_that_is_given_a_place_on_this_side_as_it_may_enter_finds_a_way_to_it(name):
    arena = room(name)
    nav = Navigator(arena, 1)
    nav.go(0, HERE, BESIDE, through_gate=True)
    job = TimedJob(1, 0, "crossing", "crossing(exit)", "at(@1, exit)", 0, seconds(20.0), (), Robot(1))
    crossing = Crossing(job, b"group.", b"group.", 0, None)
    crossing.plan = CrossingPlan(gated=True, passage=name)
    crossing.phase = Inside(0, None)
    host = SimpleNamespace(
        config=SimpleNamespace(arena=arena),
        driver=SimpleNamespace(navigator=nav),
        driving=SimpleNamespace(gate=crossing),
        trace=lambda *_, **__: None,
    )
    left = []
    core = SimpleNamespace(leave=lambda _, group: left.append(group))
    executor = CommandExecutor(host, core, SimpleNamespace())
    executor.execute(0, crossing, [crossing.hold_line()])
    assert nav._replan(0, HERE, keep=True) is arena.passages[0].by_event, "the turn binds the drive to the door"
    executor.execute(0, crossing, crossing.leave())
    assert left == [b"group."]
    assert nav._replan(0, HERE, keep=True)
