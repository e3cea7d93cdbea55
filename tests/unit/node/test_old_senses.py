"""What a robot senses or hears may be old, as on a machine that is too slow: then it slows down, or stands."""

from collections import deque
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from rmr.base.arena import NOWHERE, RobotShape
from rmr.base.geometry import Pose, Twist
from rmr.base.motion_scale import scale_of
from rmr.base.time import NEVER, Duration, Instant, milliseconds, tick_start
from rmr.lang.compiler import compile_source
from rmr.node.config import NodeConfig
from rmr.node.driver import STALE, Driver
from rmr.node.motion.hearing import OVERDUE
from rmr.node.node import Node
from rmr.node.payloads import PAYLOAD_OCTETS_MAX, Hello, encode_hello
from rmr.node.peers.perception import Peers
from rmr.node.ports import Ports, Received, Sensed
from rmr_world.lab import Lab
from rmr_world.lab_file import load_lab
from rmr_world.physics import World

LABS = Path(__file__).parents[3] / "deploy" / "labs"
HERE = Pose(0.3, 2.25, 0.0)
FULL = 0.2
NOT_AT_ALL: Duration = 1 << 60


@cache
def hall() -> Lab:
    return load_lab(LABS / "hall")


class Slow:
    """A robot that drives straight on by hand, in virtual time; its samples take a while to come."""

    def __init__(self, ahead: Pose | None = None, full: float = FULL) -> None:
        lab = hall()
        lab = replace(lab, arena=replace(lab.arena, shape=RobotShape(speed=full)))
        self.full = full
        poses = [HERE] if ahead is None else [HERE, ahead]
        robots = [replace(robot, pose=pose) for robot, pose in zip(lab.robots, poses, strict=False)]
        self.world = World(replace(lab, robots=tuple(robots)), 7)
        self.robot = robots[0].id
        self.driver = Driver(NodeConfig(self.robot, (self.robot,), lab.arena, 7), self)
        self.under_way: deque[Sensed] = deque()
        self.delay: Duration = 0
        self.tick = 0

    @property
    def now(self) -> Instant:
        return tick_start(self.tick)

    def sense(self) -> list[Sensed]:
        come = [sample for sample in self.under_way if sample.stamp + self.delay <= self.now]
        for _ in come:
            self.under_way.popleft()
        return come

    def act(self, twist: Twist, stamp: Instant) -> None:
        self.world.act(self.robot, twist, stamp, self.now)

    def run(self, ticks: int, delay: Duration = 0) -> float:
        """Return the speed that is commanded in the end."""
        self.delay = delay
        for _ in range(ticks):
            self.tick += 1
            self.world.step(self.now)
            self.under_way.append(self.world.sense(self.robot, self.now))
            if self.driver.localiser.pose is not None and self.driver.navigator.status == "idle":
                self.driver.navigator.drive(self.full, 0.0)
            self.driver.step(self.now, lambda: 0, Peers())
        return self.driver.speed


def test_a_robot_whose_samples_are_older_slows_down_stands_and_goes_on_when_new_ones_come():
    robot = Slow()
    assert robot.run(60) == FULL
    assert robot.run(60, milliseconds(33)) == FULL, "a process that is called in time has samples of that age"
    assert 0.0 < robot.run(60, milliseconds(80)) <= FULL * scale_of(RobotShape()).unwatched / milliseconds(80)
    assert robot.run(60, milliseconds(150)) == 0.0
    stood = robot.world.pose(robot.robot)
    robot.run(60, milliseconds(150))
    assert robot.world.pose(robot.robot) == stood
    assert robot.run(60) == FULL


def test_it_brakes_within_a_fifth_of_a_second_when_no_sample_comes_any_more():
    robot = Slow()
    robot.run(60)
    went = robot.world.distance_m(robot.robot)
    robot.run(60, NOT_AT_ALL)
    unwatched_s = (STALE + milliseconds(100)) / 1e9
    assert robot.world.distance_m(robot.robot) - went < FULL * unwatched_s + 0.025
    assert robot.driver.speed == 0.0


def test_one_that_brakes_from_a_high_speed_and_drives_on_has_been_unwatched_meanwhile():
    robot = Slow(full=1.5)
    assert robot.run(60) == 1.5
    robot.driver.navigator.drive(0.0, 0.0)
    assert robot.run(3, NOT_AT_ALL) == 0.0
    robot.driver.navigator.stop()
    unwatched = scale_of(RobotShape(speed=1.5)).unwatched
    assert 0.0 < robot.run(1, NOT_AT_ALL) <= 1.5 * unwatched / tick_start(4)


@pytest.mark.parametrize("stops_at", range(60, 150, 9))
def test_whenever_samples_stop_to_come_it_does_not_touch_who_stands_ahead(stops_at):
    robot = Slow(ahead=Pose(0.75, 2.25, 0.0))
    robot.run(stops_at)
    robot.run(120, NOT_AT_ALL)
    assert robot.world.collisions == 0


@pytest.mark.parametrize("delay_ms", [0, 40, 80, 120, 400])
def test_however_late_samples_are_it_does_not_touch_who_stands_ahead(delay_ms):
    robot = Slow(ahead=Pose(0.75, 2.25, 0.0))
    robot.run(60)
    robot.run(240, milliseconds(delay_ms))
    assert robot.world.collisions == 0


class Ear:
    """A link on which one frame has come."""

    payload_max = PAYLOAD_OCTETS_MAX

    def __init__(self) -> None:
        self.received: list[Received] = []

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: int = NEVER) -> None:
        raise AssertionError("a robot without a body has no place to tell")

    def receive(self) -> list[Received]:
        received, self.received = self.received, []
        return received

    def confirmations(self) -> list:
        return []


@pytest.mark.parametrize("overheard", [False, True])
def test_a_hello_that_has_waited_for_long_tells_where_a_robot_was_when_it_was_said(overheard):
    program = compile_source("done(R).").program
    ear = Ear()
    node = Node(NodeConfig(1, (1, 2), NOWHERE, 0), program, Ports(ear, None), {})
    node.start(0)
    payload = encode_hello(Hello(0.8, 0.5, 0.0, 0.2, False, 0, None, node.state.digest))
    now = milliseconds(1000)
    for waited in (0, OVERDUE, OVERDUE + 1, milliseconds(400)):
        now += milliseconds(1000)
        node.tick(now)
        frame = Received(payload, 2, False, -50.0, 255, now - waited)
        if overheard and 2 in node.peers.known:
            assert node.overhear(now, frame)
        else:
            ear.received = [frame]
            node.tick(now)
        assert node.peers.known[2].hello_at == (now if waited <= OVERDUE else now - waited)
