"""A robot that changes its program goes on where it stands: its body, its place and who goes first there are known."""

from dataclasses import replace
from pathlib import Path

from rmr.base.arena import RobotShape
from rmr.base.geometry import Pose, Twist
from rmr.base.time import Instant, milliseconds
from rmr.node.config import NodeConfig
from rmr.node.driver import Driver, OwnDriver
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


class Led(Body):
    """A body with a driver of its own, which is told where to drive."""

    def __init__(self) -> None:
        self.orders: list[tuple[int, Pose | None]] = []

    def head(self, serial: int, target: Pose | None, stamp: Instant) -> None:
        self.orders.append((serial, target))


def test_an_order_to_the_bodys_own_driver_is_repeated_twice_a_second_until_it_has_ended():
    body = Led()
    own = OwnDriver(body)
    there = Pose(1.0, 0.5, 0.0)
    for tick in range(61):
        own.head(7 + milliseconds(20) * tick, there)
    assert body.orders == [(7, there)] * 3
    assert own.reached([(6, "")]) is None, "that was another order"
    assert own.reached([(7, "")]) == there
    assert own.reached([(7, "")]) is None
    own.head(milliseconds(5000), Pose(1.01, 0.5, 3.0))
    assert len(body.orders) == 3, "a heading, or a centimetre, is no news"
    own.head(milliseconds(5000), None)
    assert len(body.orders) == 3, "what has ended is not cancelled"


def test_a_new_place_is_a_new_order_and_to_stand_cancels_it():
    body = Led()
    own = OwnDriver(body)
    own.head(1, Pose(1.0, 0.5, 0.0))
    own.head(2, Pose(1.2, 0.5, 0.0))
    own.head(3, None)
    own.head(4, None)
    assert body.orders == [(1, Pose(1.0, 0.5, 0.0)), (2, Pose(1.2, 0.5, 0.0)), (2, None)]
    own.head(5, Pose(1.2, 0.5, 0.0))
    assert own.reached([(5, "no path")]) is None
    assert own.failure == "no path"


def test_while_it_drives_the_speed_is_that_of_the_wheels():
    own = OwnDriver(Led())
    own.rolled(milliseconds(100), 1.0)
    own.rolled(milliseconds(150), 1.5)
    own.rolled(milliseconds(300), 1.03)
    assert abs(own.speed - 0.15) < 1e-9
