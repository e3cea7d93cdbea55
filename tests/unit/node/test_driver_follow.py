"""A robot that changes its program goes on where it stands: its body, its place and who goes first there are known."""

from dataclasses import replace
from pathlib import Path

from rmr.base.arena import RobotShape
from rmr.base.geometry import Pose, Twist
from rmr.base.time import Instant, milliseconds
from rmr.node.config import NodeConfig
from rmr.node.driver import Driver
from rmr.node.payloads import Hello
from rmr.node.peers.perception import Peers
from rmr.node.ports import Sensed
from rmr_world.lab_file import load_lab

LAB = load_lab(Path(__file__).parents[3] / "deploy" / "labs" / "corridor")
OF_THE_LAB = {"arena", "_scale", "_listens", "_robot", "_roster", "_body", "_areas", "_switches"}
"""The same under every program."""
BEGUN_ANEW = {"navigator", "approach", "_apply_hellos_at", "_stated_pose", "_stated_place", "held_by"}
"""The drive has ended, and the new program is told afresh where the robot is."""


class Body:
    def sense(self) -> list[Sensed]:
        return []

    def act(self, twist: Twist, stamp: Instant) -> None:
        pass


def driver(shape: RobotShape = LAB.arena.shape) -> Driver:
    return Driver(NodeConfig(2, (1, 2, 3), replace(LAB.arena, shape=shape), 7), Body())


def test_no_field_of_a_driver_is_forgotten():
    old, new = driver(), driver()
    state = sorted(set(vars(old)) - OF_THE_LAB - BEGUN_ANEW)
    for name in state:
        setattr(old, name, object())
    new.follow(old)
    assert [name for name in state if getattr(new, name) is not getattr(old, name)] == []


def test_a_place_is_still_yielded_to_a_robot_that_goes_first():
    old, new = driver(), driver()
    exit_area = next(area for area in LAB.arena.areas if area.name == "exit")
    old._known = Pose(0.5, 0.5, 0.0)
    place = old.take_place(0, exit_area, 2, 1, Peers())
    new.follow(old)
    peers = Peers()
    hello = Hello(0.6, 0.5, 0.0, 0.2, False, 1, place)
    peers.heard(1, 1, -50.0)
    peers.hello(1, 1, hello)
    assert new.disputes(1, hello, outside=False)
    assert new.choose_again(1, peers) not in (None, place)


def test_a_fast_robot_that_brakes_still_says_how_fast_it_drives():
    shape = RobotShape(speed=0.6)
    old, new = driver(shape), driver(shape)
    for at in range(0, 2000, 20):
        old.navigator.control.wheels.command(milliseconds(at), Twist(0.6, 0.0))
    new.follow(old)
    assert new.driven(milliseconds(2000)) == old.driven(milliseconds(2000)) > 0.5
