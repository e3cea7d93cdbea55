"""The world server's bookkeeping, with a bus that keeps what it is given."""

import asyncio
import math
from itertools import count
from types import SimpleNamespace

import pytest
from world_labs import LABS

from rmr.base.geometry import Pose, Twist
from rmr.base.time import NS_PER_S, seconds, tick_start
from rmr.bus import wire
from rmr.bus.losses import Losses
from rmr.bus.process import Ending
from rmr.node.ports import PoseFix, SeenBody, Sensed
from rmr.radio.links import Disturbance, partition
from rmr_world import server
from rmr_world.incarnation_claims import CLOCKS_APART
from rmr_world.lab_file import load_lab
from rmr_world.server import BEHIND_MAX, CATCH_UP_MAX, WorldServer


class StubBus:
    """Keeps what is published."""

    def __init__(self) -> None:
        self.losses = Losses()
        self.excess: list[list[int]] = []
        self.published: list[tuple[str, object]] = []

    def publish(self, key: str, body: object) -> None:
        self.published.append((key, body))


class Held:
    """A world that has been held up until some tick."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0
        monkeypatch.setattr(server.time, "monotonic_ns", lambda: self.now)
        self.server = WorldServer(load_lab(LABS / "testbed" / "lab.yaml"), 1, StubBus(), Ending(), when_ready=False)
        self.server._time.start(0, 0)

    def catch_up(self, tick: int, calls: int) -> dict[str, int]:
        self.now = tick_start(tick)
        for _ in range(calls):
            self.server._catch_up()
        return self.server._report()


def test_late_tick_that_is_caught_up_is_counted_once(monkeypatch):
    held = Held(monkeypatch)
    assert held.catch_up(1, 1)["ticks_late"] == 0
    behind = 3 * CATCH_UP_MAX
    assert held.catch_up(1 + behind, 3)["ticks_late"] == behind - 1


def test_world_too_far_behind_resets_lab_time_and_catches_up_no_tick(monkeypatch):
    report = Held(monkeypatch).catch_up(BEHIND_MAX + 10, 1)
    assert (report["ticks_late"], report["set_back"]) == (0, 1)


def test_stalled_world_keeps_current_disturbances_when_lab_time_is_reset(monkeypatch):
    held = Held(monkeypatch)
    wish = wire.Envelope(wire.OPERATOR_ID, 1, 1, wire.AskDisturbances("add", Disturbance(0, 5 * NS_PER_S, loss=0.5)))
    held.server._answer_disturbances(wish, 0)
    held.now = 60 * NS_PER_S  # and its questions are answered before its physics notices
    held.server._answer_disturbances(wish, 0)
    asyncio.run(telling(held.server))
    held.server._catch_up()
    back = held.server._time.at(held.now)
    assert back < NS_PER_S
    since = [one.since for one in held.server._disturbances.added]
    assert len(since) == 2
    assert max(since) < back + 2 * NS_PER_S


async def telling(world: WorldServer) -> None:
    """Let the world tell its state once."""
    task = asyncio.ensure_future(world._publish_periodically())
    await asyncio.sleep(0)
    task.cancel()


class Asked:
    """A world that operators ask about disturbances."""

    def __init__(self) -> None:
        self.bus = StubBus()
        self.server = WorldServer(load_lab(LABS / "testbed" / "lab.yaml"), 1, self.bus, Ending(), when_ready=True)

    def ask(self, wish: str, added: Disturbance | None = None) -> wire.Disturbances:
        question = wire.Envelope(wire.OPERATOR_ID, 1, 1, wire.AskDisturbances(wish, added))
        answer = self.server._answer_disturbances(question, 0)
        assert isinstance(answer, wire.Disturbances)
        return answer

    @property
    def told(self) -> list[tuple[Disturbance, ...]]:
        """What the robots have been told, news by news."""
        bodies = [body for key, body in self.bus.published if key == "rmr/testbed/disturbances"]
        return [body.held for body in bodies if isinstance(body, wire.Disturbances)]

    def arrives(self, robot: int, token: int = 5) -> wire.Map:
        answer = self.server._answer_map(wire.Envelope(robot, 1, 1, wire.AskMap(robot, token)), 0)
        assert isinstance(answer, wire.Map)
        return answer


def test_disturbances_of_the_operator_are_sent_to_present_and_later_robots():
    world = Asked()
    held = world.ask("add", partition([[1], [2]])).held
    assert len(held) == 1
    assert world.told == [held]
    assert world.arrives(1).disturbances == held
    cleared = world.ask("clear").held
    assert world.told == [held, cleared]
    assert world.arrives(2).disturbances == cleared


def test_who_asks_for_the_place_of_another_robot_gets_no_answer_and_takes_nothing():
    world = Asked()
    assert world.server._answer_map(wire.Envelope(2, 1, 1, wire.AskMap(1, 5)), 0) is None
    assert not world.arrives(1, token=6).taken


def test_a_new_process_of_a_robot_is_told_when_the_earlier_one_had_vanished():
    world = Asked()
    assert world.arrives(1).predecessor_ended is None
    world.server._incarnations.release(1)
    world.server._incarnations.vanished(1, seconds(3))
    again = world.arrives(1, token=6)
    assert (again.lives, again.predecessor_ended) == (1, seconds(3) + CLOCKS_APART)


def test_disturbances_changed_by_an_operator_are_sent_even_if_cleared_before_the_start():
    world = Asked()

    asyncio.run(telling(world.server))
    assert world.told == []
    world.ask("add", partition([[1], [2]]))
    world.ask("clear")
    before = len(world.told)
    asyncio.run(telling(world.server))
    assert world.told[before:] == [()]


def test_unchanged_disturbances_are_not_published():
    world = Asked()
    assert world.ask("list").held == ()
    refusal = world.ask("add", partition([[1], [77]]))
    assert (refusal.held, refusal.refused[:27]) == ((), "lab testbed has no robot 77")
    world.ask("clear")
    assert world.told == []


def test_ready_messages_of_unknown_robots_are_not_counted():
    world = Asked().server
    ready = wire.Status("ready", "", False, False, 0, {})
    for sender in (*range(10_000, 10_100), *world._lab.roster[1:]):
        world._on_status("k", wire.Envelope(sender, 1, 1, ready))
    assert world._report()["ready"] == list(world._lab.roster[1:])


# -- bodies from outside


class Bridge:
    """A bridge with the body of robot 2, without ROS."""

    robots = (2,)
    view = None

    def __init__(self) -> None:
        self.at = Pose(1.0, 0.9, 0.0)
        self.acts: list[tuple[object, ...]] = []
        self.performing: list[tuple[object, ...]] = []
        self.silent = False
        self.seen: tuple[SeenBody, ...] = ()

    def step(self, now: int) -> None:
        self.now = now

    def body(self, robot: int) -> object:
        return SimpleNamespace(pose=self.at, twist=Twist(0.1, 0.0), travelled_m=0.5)

    def sense(self, robot: int, now: int, bodies: tuple[SeenBody, ...]) -> Sensed | None:
        self.seen = bodies
        fix = PoseFix(*self.at, 0.02, 0.03)
        return None if self.silent else Sensed(now, 0.1, 0.2, 0.0, None, (), bodies, False, tuple(self.at), fix)

    def told(self, robot: int) -> None:
        return None

    def act(self, *command: object) -> None:
        self.acts.append(command)

    def perform(self, *wish: object) -> None:
        self.performing.append(wish)

    def performed(self) -> list[tuple[tuple[int, int, int], str]]:
        ended, self.performing = self.performing, []
        return [(asked, "jammed") for asked, _name, _args in ended]

    def report(self) -> dict[str, object]:
        return {"2": {"odometry": 7}}


def test_a_body_from_outside_is_commanded_and_sensed_by_the_bridge_and_seen_by_the_simulated(monkeypatch):
    monkeypatch.setattr(server.time, "monotonic_ns", lambda: tick_start(30))
    bridge = Bridge()
    bus = StubBus()
    world = WorldServer(load_lab(LABS / "testbed" / "lab.yaml"), 1, bus, Ending(), when_ready=False, bridge=bridge)
    world._time.start(0, 0)
    world._alive |= {1, 2}
    for robot in (1, 2):
        world._on_act("", wire.Envelope(robot, 1, 1, wire.Act(0.1, 0.0, tick_start(30))))
    assert bridge.acts == [(2, Twist(0.1, 0.0), tick_start(30), tick_start(30))]
    x, y, theta = world._physics.pose(1)
    bridge.at = Pose(
        x + 0.3 * math.cos(theta), y + 0.3 * math.sin(theta), theta + math.pi
    )  # before robot 1, face to face
    for _ in range(3):
        world._catch_up()
    assert bridge.now == tick_start(30)
    sensed = {key: body for key, body in bus.published if isinstance(body, wire.Sense)}
    of_1, of_2 = (sensed[world._keys.sense(robot)] for robot in (1, 2))
    assert math.dist(of_1.bodies[0][:2], (0.3, 0.0)) < 0.05
    assert of_1.bodies[0][2] == pytest.approx(-0.1, abs=0.03)
    assert of_1.fix is None
    assert len(of_2.bodies) == 1
    assert (of_2.compass, of_2.fix) == (None, (*bridge.at, 0.02, 0.03))
    assert {robot: at for robot, *at in bus.published[-1][1].robots}[2][3] == 0.5
    assert world._report()["ros2"] == {"2": {"odometry": 7}}
    bridge.silent = True
    bus.published.clear()
    world._publish_sense(2)
    assert bus.published == []


def test_an_action_that_the_world_performs_is_answered_but_not_one_of_before_it_began(monkeypatch):
    monkeypatch.setattr(server.time, "monotonic_ns", lambda: tick_start(30))
    bridge = Bridge()
    bus = StubBus()
    world = WorldServer(load_lab(LABS / "testbed" / "lab.yaml"), 1, bus, Ending(), when_ready=False, bridge=bridge)
    wish = wire.Perform(7, "grip", (0.5,), tick_start(20))
    world._on_act("", wire.Envelope(2, 99, 1, wish))
    world._time.start(0, 0)
    world._on_act("", wire.Envelope(2, 99, 1, wish))
    assert bridge.performing == [], "lab time did not run, then the robot was not there"
    world._alive |= {2}
    world._on_act("", wire.Envelope(2, 99, 1, wish))
    assert bridge.performing == [((2, 99, 7), "grip", (0.5,))]
    world._catch_up()
    answers = [(key, body) for key, body in bus.published if isinstance(body, wire.Performed)]
    assert answers == [(world._keys.sense(2), wire.Performed(7, "jammed"))]
    bus.published.clear()
    world._begun = tick_start(25)
    world._on_act("", wire.Envelope(2, 99, 1, wish))
    assert bus.published == [
        (world._keys.sense(2), wire.Performed(7, "the world was started again meanwhile")),
    ]
    world._on_act("", wire.Envelope(2, 99, 1, wish._replace(name=None, args=())))
    assert bridge.performing == [((2, 99, 7), None, ())], "what it does not know it breaks off all the same"


class View:
    """What is shown to ROS 2, which wants all robots to drive."""

    def __init__(self) -> None:
        self.shown: list[tuple[int, dict[int, object]]] = []

    def commanded(self, minds: set[int]) -> list[tuple[int, Twist]]:
        return [(robot, Twist(0.1, 0.0)) for robot in (1, 2, 3) if robot not in minds]

    def show(self, now: int, bodies: dict[int, object]) -> None:
        self.shown.append((now, bodies))


def test_a_view_shows_all_bodies_and_drives_those_without_a_mind(monkeypatch):
    ticks = count(1)
    monkeypatch.setattr(server.time, "monotonic_ns", lambda: tick_start(next(ticks)))
    bridge = SimpleNamespace(
        robots=(),
        view=View(),
        step=lambda _now: None,
        told=lambda _robot: ((("battery", (0.5,)),)),
        performed=lambda: (),
    )
    lab = load_lab(LABS / "testbed" / "lab.yaml")
    world = WorldServer(lab, 1, StubBus(), Ending(), when_ready=False, bridge=bridge)
    world._time.start(0, 0)
    world._alive.add(2)
    while world._tick < 30:
        world._catch_up()
    shown, bodies = bridge.view.shown[-1]
    assert shown == tick_start(30)
    assert bodies.keys() == set(lab.roster)
    assert {robot for robot, (_, twist, *_) in bodies.items() if twist.v > 0.05} == {1, 3}
    pose, _, left_m, right_m = bodies[1]
    assert pose == world._physics.pose(1)
    assert left_m == pytest.approx(right_m, rel=0.1)
    assert left_m > 0.01
