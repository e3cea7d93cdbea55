"""Hostile messages of every type through the real decoding and the real handlers of robot, world, launcher and fault.

Each field of a valid message is replaced by each of a list of values that no sender means. What is malformed is
counted and dropped; whatever passes leads to no exception, no traceback and no escape sequence on a terminal.
"""

import asyncio
import math
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import msgpack
import pytest
import zenoh

from rmr.base.printable import printable
from rmr.base.time import NS_PER_S, seconds
from rmr.base.values import Robot, Symbol
from rmr.bus import wire
from rmr.bus.keys import last_id
from rmr.bus.line import Line
from rmr.bus.process import Ending
from rmr.bus.session import Bus
from rmr.lang.compiler import compile_source
from rmr.load.load_messages import LoadKind, LoadMessage
from rmr.radio.air import Announcement
from rmr.radio.frame import DataFrame, encode_data
from rmr.radio.links import Disturbance
from rmr.radio.phy import airtime
from rmr_agent.bytecode import Loaded
from rmr_agent.robot import HostedRobot
from rmr_agent.robot_setup import RobotSetup
from rmr_deploy import disturb
from rmr_deploy.lab_run import make_report
from rmr_deploy.preparation import RunPlan
from rmr_deploy.run_options import RunOptions
from rmr_deploy.run_outcome import RunOutcome
from rmr_deploy.status_monitor import StatusMonitor
from rmr_world import run_report
from rmr_world.lab_file import load_lab
from rmr_world.lab_program import LoadedProgram
from rmr_world.server import WorldServer

pytestmark = pytest.mark.medium

DASH = Path(__file__).parents[2] / "integration" / "labs" / "dash"
ESCAPE = "\x1b]0;owned\x07\x1b[2J"
DEEP: Any = 0
for _ in range(100):
    DEEP = [DEEP]
HOSTILE = [
    *(None, True, -1, 0, 1, 17, 65534, 1 << 31, (1 << 63) - 1, -(1 << 63), (1 << 64) - 1),
    *(0.0, -1.0, 5e-324, 1e9, 1e308, math.nan, math.inf, -math.inf),
    *("", ESCAPE, "x" * 70_000, "at(@1, goal", "9" * 5000, b"", b"\x00" * 200),
    *([], [[]], [1, 2, 3], {}, {"a": None}, {"lost": -1}, DEEP),
]
JOB = {"name": "crossing", "job": "at(@1, goal)", "start_s": 0.0, "finish_s": 1.0, "deadline_s": 9.0, "met": True}
PART = {
    "finish_s": 1.0,
    "distance_m": 0.5,
    "assertions": [JOB | {"cause": None}],
    "facts": ["at(@1, goal)"],
    "goals": {"achieved": [["x(@1)", 0.0]], "open": ["y(@1)"]},
    "actions": [[0.0, "moveto(@1, goal)"]],
    "restarts": 0,
    "undelivered": 0,
    "frames": {"sent": 1},
    "schedules": [{"event": "e", "leader": 1, "term": 1, "order": [1, 2], "formed_s": 0.5}],
    "bus": {"lost": 0, "malformed": 0},
    "faults": [{"from": 1.0, "to": 2.0, "loss": 0.5}],
}


class Process:
    """A process on the bus without a network: what its subscriptions are handed, and what goes wrong in them."""

    def __init__(self, sender: int) -> None:
        self.bus = Bus(Line(MagicMock()), sender, is_client=True)

    def hand(self, key: str, data: bytes) -> None:
        """Let `data` arrive on `key` at each subscription that covers it."""
        sample = SimpleNamespace(key_expr=key, kind=zenoh.SampleKind.PUT)
        for expression, (_, listeners) in list(self.bus._line._topics.items()):
            if zenoh.KeyExpr(expression).intersects(zenoh.KeyExpr(key)):
                self.bus._line._taker(expression, listeners)((sample, data), 0)


def world(process: Process) -> WorldServer:
    server = WorldServer(load_lab(DASH), 3, process.bus, Ending(), when_ready=True)
    server._serve()
    return server


async def _describe() -> wire.Map:
    return world(Process(wire.WORLD_ID))._map


MAP = asyncio.run(_describe())


def air() -> Announcement:
    psdu = encode_data(DataFrame(load_lab(DASH).pan, 1, 2, 1, True, b"\x20x"))
    return Announcement(2, 1, 0, 0, airtime(len(psdu)), 0.0, 0.5, 0.5, psdu)


HELD = Disturbance(0, NS_PER_S, ((1,), (2,)), loss=0.5)
MESSAGES = [
    wire.Air(air()),
    wire.Handshake(air()),
    wire.Sense(5, 0.1, 0.1, 0.0, 0.0, ((0, 0.5),), ((0.3, 0.0, 0.1, 0.0),), False, (0.4, 0.2, 0.0)),
    wire.Act(0.1, 0.0, 1),
    wire.Perform(1, "grip", (True, Robot(1), (1, 2.0)), 1),
    wire.Performed(1, "the gripper is hot"),
    wire.AskClock(),
    wire.Clock("running", 0, 0),
    wire.AskMap(1, 7),
    MAP._replace(facts=(("due", 1, (1, 2.0, Symbol("x"), Robot(1), (1, 2))),)),
    wire.Truth(1, ((1, 0.5, 0.5, 0.0, 0.1),), 0, 0.1, 0, False),
    wire.Status("running", "driving", False, False, 1, PART),
    wire.Stop("enough"),
    wire.AskDisturbances("add", HELD),
    wire.Disturbances("dash", 0, (HELD,), 1, ""),
    wire.Part(1, 0, 2, b"x"),
    wire.Load(LoadMessage(LoadKind.OFFER, 5, octets=900, piece_octets=90).encode(100)),
    wire.LoadOrder(b"no program", (1, 2), False, True),
    wire.LoadOutcome(b"{}", ""),
    wire.Silence(1, NS_PER_S),
    wire.HostOrder(b'{"do": "kill", "robot": 1}'),
    wire.HostAnswer("b", b'{"refused": "there is no such robot"}'),
    wire.Launcher(
        "b", "running", (("a", ()), ("b", (1, 2))), (("rmr", "1"),), ((2, "died"),), "runs/x", False, "", b"[]"
    ),
]


def mutations(value: Any) -> Iterator[Any]:
    """Yield `value` with each of its parts, and itself, replaced by each hostile value."""
    yield from HOSTILE
    if isinstance(value, list | tuple):
        for place, item in enumerate(value):
            yield from ([*value[:place], changed, *value[place + 1 :]] for changed in mutations(item))
        yield [*value, *value]
        yield value[:-1]
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from (value | {key: changed} for changed in mutations(item))
            yield {other: kept for other, kept in value.items() if other != key}
        yield value | {ESCAPE: ESCAPE}


def hostile(message: Any) -> Iterator[bytes]:
    """Yield the octets of `message` with each field made hostile."""
    speaker = message.announcement.source if isinstance(message, wire.Air | wire.Handshake) else 1
    code, sender, run, number, *fields = msgpack.unpackb(wire.encode(speaker, 5, 1, message))
    for place, field in enumerate(fields):
        for changed in mutations(field):
            yield msgpack.packb([code, sender, run, number, *fields[:place], changed, *fields[place + 1 :]])
    for envelope in ([code, bad, run, number] for bad in HOSTILE):
        yield msgpack.packb([*envelope, *fields])
    for bad in HOSTILE:
        yield msgpack.packb([code, sender, bad, number, *fields])
        yield msgpack.packb([code, sender, run, bad, *fields])


def undisturbed(scene) -> None:
    """Run `scene`; fail if anything raises, also in a callback of the loop."""

    async def play() -> None:
        failures: list[dict[str, Any]] = []
        asyncio.get_running_loop().set_exception_handler(lambda _, context: failures.append(context))
        await scene()
        await asyncio.sleep(0)
        assert failures == []

    asyncio.run(play())


def of_kind(*kinds: type) -> list[Any]:
    return [message for message in MESSAGES if isinstance(message, kinds)]


def test_every_type_of_message_is_made_hostile():
    assert {type(message) for message in MESSAGES} == {row.kind for row in wire.TABLE}


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_hostile_message_is_malformed_or_decoded_and_nothing_else(message):
    passed = dropped = 0
    for data in hostile(message):
        try:
            decoded = wire.decode(data)
        except wire.MalformedError:
            dropped += 1
            continue
        passed += 1
        shown = [field for field in decoded.body if isinstance(field, str)]
        assert all(printable(text) == text and len(text) <= 500 for text in shown)
    assert dropped > passed or len(message) == 0


def hosted(process: Process, known: wire.Map) -> HostedRobot:
    program = compile_source((DASH / "dash.rmr").read_text()).program
    assert program is not None
    ending = Ending()
    robot = HostedRobot(
        1, 1, process.bus, "tcp/127.0.0.1:1", "dash", RobotSetup(Loaded(program, 1, b"code"), dict, None), ending
    )
    robot._listen()
    robot._begin(wire.Envelope(wire.WORLD_ID, 9, 1, known))
    return robot


HEARD = (wire.Sense, wire.Air, wire.Handshake, wire.Disturbances, wire.Clock, wire.Load, wire.LoadOrder)


def test_robot_survives_hostile_messages_on_its_keys():
    known = wire.decode(wire.encode(wire.WORLD_ID, 9, 1, MAP)).body

    async def scene() -> None:
        process = Process(1)
        robot = hosted(process, known)
        life = robot._incarnation
        assert life is not None
        process.hand("rmr/dash/body/1/sense", wire.encode(-1, 9, 1, of_kind(wire.Sense)[0]))
        now = time.monotonic_ns()
        life._clock.sample("running", now, NS_PER_S, NS_PER_S, now)
        life.wake()
        keys = [
            "rmr/dash/call/1",
            "rmr/dash/body/1/sense",
            "rmr/dash/disturbances",
            "rmr/dash/clock",
            "rmr/dash/load/1",
        ]
        for message in of_kind(*HEARD):
            for data in hostile(message):
                for key in keys:
                    process.hand(key, data)
                await asyncio.sleep(0)
        assert process.bus.losses.malformed > 1000
        assert (robot._ending.asked, robot._ending.reason) == (False, "")
        assert life.started
        assert life.turns > 1
        assert not life._over
        life.end()

    undisturbed(scene)


def test_robot_hears_no_frame_of_another_transmitter_than_its_sender():
    async def scene() -> None:
        process = Process(1)
        robot = hosted(process, MAP)
        heard: list[Announcement] = []
        robot._incarnation.hear = heard.append  # type: ignore[method-assign, union-attr]
        for sender in (3, 2):
            process.hand("rmr/dash/call/1", wire.encode(sender, 9, 1, wire.Handshake(air())))
        assert [announcement.source for announcement in heard] == [2]
        assert process.bus.losses.malformed_last == "a frame of another transmitter than its sender"
        robot._incarnation.end()  # type: ignore[union-attr]

    undisturbed(scene)


def test_robot_survives_forged_maps():
    async def scene() -> None:
        for data in hostile(MAP):
            try:
                envelope = wire.decode(data)
            except wire.MalformedError:
                continue
            process = Process(1)
            robot = hosted(process, wire.decode(wire.encode(-1, 9, 1, MAP)).body)
            if robot._accepted(envelope.body, math.inf):
                robot._begin(envelope)
            assert "internal error" not in robot._ending.reason
            assert printable(robot._ending.reason) == robot._ending.reason
            if robot._incarnation is not None:
                robot._incarnation.end()

    undisturbed(scene)


@pytest.mark.parametrize("change", [{"lab": "other"}, {"listed": False}, {"taken": True}, {"roster": (7,)}], ids=str)
def test_robot_that_asks_its_world_again_takes_no_answer_of_another(change):
    forged = wire.Envelope(wire.WORLD_ID, 4, 1, MAP._replace(**change))
    true = wire.Envelope(wire.WORLD_ID, 9, 1, MAP)

    async def scene() -> None:
        robot = hosted(Process(1), MAP)

        async def ask(*_: Any) -> list[tuple[wire.Envelope, int]]:
            return [(forged, 0), (true, 0)]

        robot._bus.ask = ask  # type: ignore[method-assign]
        robot._world = 9
        assert await robot._join() is true
        assert not robot._ending.asked

    undisturbed(scene)


def test_robot_takes_lab_time_and_disturbances_from_its_own_world_alone():
    news = wire.Disturbances("dash", 0, (Disturbance(0, seconds(9), loss=0.5),), 1, "")

    async def scene() -> None:
        robot = hosted(Process(1), MAP)
        robot._world = 9
        told = []
        robot._disturb = told.append  # type: ignore[method-assign]

        async def ask(*_: Any) -> list[tuple[wire.Envelope, int]]:
            now = time.monotonic_ns()
            answers = [(9, wire.Clock("running", 50, 50)), (4, wire.Clock("running", seconds(7000), seconds(7000)))]
            return [(wire.Envelope(wire.WORLD_ID, run, 1, clock), now) for run, clock in answers]

        robot._bus.ask = ask  # type: ignore[method-assign]
        for _ in range(3):
            await robot._ask_time()
        assert robot._clock.running
        assert robot._clock.at(time.monotonic_ns()) < seconds(60)
        for run in (4, 9):
            robot._on_disturbances("", wire.Envelope(wire.WORLD_ID, run, 2, news))
        assert told == [news]

    undisturbed(scene)


def test_world_survives_hostile_messages_on_its_keys():
    async def scene() -> None:
        process = Process(wire.WORLD_ID)
        server = world(process)
        server._alive = {1, 2, 3}
        server._start()
        for message in MESSAGES:
            for data in hostile(message):
                for key in ("rmr/dash/body/1/act", "rmr/dash/ops/1/status", "rmr/dash/silence"):
                    process.hand(key, data)
                envelope = process.bus._decode(SimpleNamespace(to_bytes=lambda data=data: data))
                if envelope is not None:
                    answers = (server._answer_map, server._answer_clock, server._answer_disturbances)
                    for told in filter(None, (answer(envelope, 0) for answer in answers)):
                        wire.decode(wire.encode(wire.WORLD_ID, 1, 1, told))
        server._catch_up()
        server._publish_truth(final=False)
        assert not server._ending.asked

    undisturbed(scene)


@pytest.mark.parametrize("key", ["9" * 5000, "-1", "65534", "٣", "", "1e3", "0x1", "007"])
def test_a_liveliness_token_without_a_robots_id_is_none(key):
    assert last_id(f"rmr/dash/alive/robot/{key}") is None


def test_launcher_survives_hostile_messages_on_its_keys(tmp_path):
    lab = load_lab(DASH)
    plan = RunPlan(RunOptions(lab=DASH), lab, LoadedProgram(None, b"", 0, ""), tmp_path)

    async def scene() -> None:
        process = Process(wire.OPERATOR_ID)
        watch = StatusMonitor(process.bus, "dash")
        watch._alive("rmr/dash/alive/robot/1", True)
        for message in of_kind(wire.Status, wire.Truth):
            for data in hostile(message):
                before = process.bus.losses.malformed
                for who, sender in (("1", b"\x01"), ("world", b"\xff")):
                    process.hand(f"rmr/dash/ops/{who}/status", data[:2] + sender + data[3:])
                    process.hand("rmr/dash/truth", data)
                if process.bus.losses.malformed - before < 4:
                    shown(make_report(plan, RunOutcome(reason="over"), watch))

    undisturbed(scene)


def shown(record: dict[str, Any]) -> None:
    assert "\x1b" not in run_report.table_text(record)
    assert "\x1b" not in run_report.to_json(record)


def test_disturbances_from_a_world_are_shown_without_terminal_escapes():
    for data in hostile(of_kind(wire.Disturbances)[0]):
        try:
            told = wire.decode(data).body
        except wire.MalformedError:
            continue
        text = "\n".join([told.refused, *disturb.lines(told), str(disturb.record(told))])
        assert "\x1b" not in text
