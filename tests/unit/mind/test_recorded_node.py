"""What a host answers and hands in beside frames and samples is logged and replayed."""

import re
from dataclasses import replace

import pytest
from mind_runs import LABS, MindRun, replayed

from rmr.base.arena import NOWHERE
from rmr.base.time import milliseconds, seconds, tick_start
from rmr.base.values import Robot, Symbol
from rmr.bytecode.codec import decode, encode
from rmr.bytecode.program import ANY, Constant
from rmr.coord.timing import ClaimTiming, Order, ScheduleTiming, Timing
from rmr.lang.compiler import compile_source
from rmr.mind import mind_format as form
from rmr.mind.fact_values import pack, unpack
from rmr.mind.mind_header import decode_header, encode_header
from rmr.mind.mind_reader import read_batch
from rmr.mind.mind_versions import differences, source_digest, versions
from rmr.mind.recorded_node import RecordedNode
from rmr.node.config import NodeConfig
from rmr.node.executive import FRAME_BUDGET
from rmr.node.ports import Ports, PoseFix, Sensed
from rmr.node.trace import TraceLevel
from rmr.radio.phy import Bursts, RadioConfig
from rmr.vm.engines import Engine
from rmr.vm.machine_events import RuleFired

SOURCE = """
type near(R: robot, N: int).
type given(R: robot, A: symbol, B: string, C: float, D: list int, E: robot).
neighbor(R, S) -o saw(R, S).
given(R, A, B, C, D, E) -o got(R, E, C).
ping(R, N) -o pong(R, N + 1).
"""


class Host:
    """A host without a radio, whose answers are set by the test."""

    payload_max = 100

    def __init__(self, source=SOURCE, body=None, **config):
        self.spent_ns = 0
        self.offered = [(2, 1.0)]
        self.log = []
        compilation = compile_source(source)
        assert compilation.program is not None, compilation.diagnostics
        self.program = decode(encode(compilation.program, debug=True))
        self.node = RecordedNode(
            NodeConfig(1, {1: None, 2: None, 3: None}, NOWHERE, 5, **config),
            self.program,
            Ports(self, body, lambda: self.spent_ns, lambda: self.offered),
            {},
            7,
            lambda _at, _robot, _epoch, data: self.log.append(data),
        )

    def transmit(self, payload, destination, handle, due):
        """Nobody hears it."""

    def receive(self):
        return []

    def confirmations(self):
        return []

    def replay(self):
        """End the log and return its replay."""
        self.node.end_log()
        replay = replayed(self.log, self.program)
        assert replay.difference is None
        assert replay.ended
        assert replay.node.machine.facts() == self.node.machine.facts()
        return replay


def test_processor_time_used_up_midway_is_replayed_at_the_same_task():
    host = Host()
    asked = []

    def spent():
        asked.append(len(asked))
        return FRAME_BUDGET + 1 if len(asked) % 7 in (3, 4) else 5

    host.node.executive._spent.__self__._spent = spent
    host.node.start(0)
    for frame in range(60):
        host.node.tick(milliseconds(17) * frame)
    skipped = [task.skipped for task in host.node.executive.tasks]
    assert sum(map(bool, skipped)) >= 3
    twin = host.replay().node
    assert [task.skipped for task in twin.executive.tasks] == skipped


class FixedBody:
    """A body without a compass whose samples come with fixes now and then."""

    def __init__(self):
        self.samples = []
        self.sensed = []

    def sense(self):
        samples, self.samples = self.samples, []
        self.sensed += samples
        return samples

    def act(self, twist, stamp):
        """Nothing drives."""


def test_fixes_and_the_want_of_a_compass_are_logged_and_the_replay_is_located_as_the_robot_was():
    body = FixedBody()
    host = Host("start(R).", body)
    host.node.start(0)
    for tick in range(1, 40):
        fix = PoseFix(0.5, 0.25, -1.0, 0.02, 0.05) if tick % 9 == 0 else None
        body.samples = [Sensed(tick_start(tick), 0.1, 0.2, 0.0, None, (), (), tick % 2 == 0, (0.0, 0.0, 0.0), fix)]
        host.node.tick(tick_start(tick))
    replay = host.replay()
    assert replay.node.driver.localiser.pose == host.node.driver.localiser.pose is not None
    operations = [op for data in host.log for call in read_batch(data).calls for op in call.operations]
    assert [one for op in operations if op.kind == form.SENSED for one in op.value] == body.sensed


def test_facts_from_outside_hold_with_the_newest_sample_are_logged_and_replayed():
    source = "type sensor dock(robot, area).\ntype sensor charge(robot, float).\ncharge(R, C), C < 0.2 -o low(R)."
    body = FixedBody()
    host = Host(source, body)
    host.node.start(0)
    area = Symbol("north")
    told = [
        (("charge", (0.9,)), ("dock", (area,))),
        None,
        (("charge", (0.1,)), ("unknown", (1,)), ("dock", (3,)), ("dock", (area, area))),
    ]
    held = []
    for tick, facts in enumerate(told, start=1):
        sample = Sensed(tick_start(tick), 0.0, 0.0, 0.0, None, (), (), False, (0.0, 0.0, 0.0))
        body.samples = [sample if facts is None else sample.telling(facts)]
        host.node.tick(tick_start(tick))
        held.append((host.node.senses.of("charge"), host.node.senses.of("dock")))
    assert held == [([(0.9,)], [(area,)]), ([(0.9,)], [(area,)]), ([(0.1,)], [])]
    assert "low(@1)" in host.node.machine.facts()
    assert host.replay().node.senses.of("charge") == [(0.1,)]


def test_neighbors_that_the_host_offers_are_logged_when_they_change():
    host = Host()
    host.node.start(0)
    for tick in range(10):
        if tick == 5:
            host.offered = [(3, 2.5)]
        host.node.tick(milliseconds(20 * tick))
    assert {"saw(@1, @2)", "saw(@1, @3)"} <= set(host.node.machine.facts())
    host.replay()


def test_facts_from_outside_keep_their_types_and_refused_ones_are_refused_again():
    host = Host()
    host.node.start(0)
    host.node.insert(1000, "given", (Symbol("a"), 'te"xt', 2.0, (1, 2), Robot(3)))
    for name, args in (("given", (1,)), ("unheard", ()), ("ping", ("x", "y"))):
        with pytest.raises(ValueError, match=r"near|given|unheard|ping"):
            host.node.insert(2000, name, args)
    host.node.insert(3000, "given", (Symbol("b"), "", 2, (), Robot(2)))
    host.node.tick(milliseconds(1))
    assert {"got(@1, @3, 2.0)", "got(@1, @2, 2.0)"} <= set(host.node.machine.facts())
    host.replay()


def test_a_fact_that_a_witness_inserts_within_a_call_is_inserted_at_the_same_event():
    inserted = []

    def witness(_robot, now, event):
        if isinstance(event, RuleFired) and len(inserted) < 3:
            inserted.append(event)
            host.node.insert(now, "ping", (10 + len(inserted),))

    host = Host(witness=witness)
    host.node.start(0)
    host.node.insert(0, "ping", (1,))
    for tick in range(5):
        host.node.tick(milliseconds(20 * tick))
    assert {"pong(@1, 2)", "pong(@1, 12)", "pong(@1, 13)", "pong(@1, 14)"} <= set(host.node.machine.facts())
    host.replay()


def test_an_exception_that_ended_a_call_is_named_if_the_replay_does_not_raise_it():
    host = Host("start(R), peer(R, S) -o hello(S, R).\nstart(@1).")

    def transmit(payload, destination, handle, due):
        raise OSError("the radio is gone")

    host.transmit = transmit
    host.node.start(0)
    with pytest.raises(OSError, match="the radio is gone"):
        host.node.tick(0)
    host.node.end_log()
    difference = replayed(host.log, host.program).difference
    assert (difference.what, difference.replayed) == ("exception", "nothing")
    assert "OSError: the radio is gone" in difference.recorded


def test_what_the_host_did_not_deliver_is_told_by_the_replay():
    host = Host()
    host.node.start(0)
    host.node.not_delivered(3, 1)
    host.node.tick(seconds(1.5))
    host.node.not_delivered(4, 1, 2)
    assert host.replay().not_delivered == (4, 1, 2)


@pytest.mark.medium
def test_a_stalled_robot_loses_samples_and_frames_and_its_replay_says_so():
    def stall(simulation):
        simulation.kernel.at(seconds(2), 0, lambda _: simulation.stall(3, seconds(30)))

    run = MindRun(LABS / "corridor", 7, stall)
    replays = {key: run.replay(*key) for key in run.logs}
    losses = {key: replay.not_delivered for key, replay in replays.items()}
    assert {key: lost for key, lost in losses.items() if any(lost)} == {(3, 0): losses[3, 0]}
    assert losses[3, 0][0] > 0
    assert all(replay.difference is None for replay in replays.values())


# -- the header


CONFIG = NodeConfig(
    3,
    {1: None, 3: None, 65533: None},
    NOWHERE,
    10**18 - 1,
    RadioConfig(loss=0.25, shadowing_db=3.0, bursts=Bursts(seconds(2), seconds(1), 0.5)),
    (("given", 3, (Symbol("a"), "b", 1.5, (1, (2, 3)), Robot(4), True, -(1 << 63))), ("all", None, ())),
    ("at", (Constant(Symbol("exit")), ANY, Constant(2.0), Constant((Robot(1),)))),
    epoch=2,
    phase=12345,
    trace=TraceLevel.FACTS,
    engine=Engine.INTERPRETER,
    turn=seconds(3),
    timing=Timing(Order.EDF, 90, schedule=ScheduleTiming(wait=seconds(0.5)), claim=ClaimTiming(finals=5)),
    without=frozenset({"promise", "unwatched"}),
)


@pytest.mark.parametrize("config", [CONFIG, NodeConfig(1, (1,), NOWHERE, 0)])
def test_a_header_holds_the_whole_configuration(config):
    data = encode_header(config, 77, {}, payload_max=90, bodily=True, timed=False, neighbors=False, witnessed=True)
    header = decode_header(data)
    assert replace(header.config, roster=tuple(header.config.roster)) == replace(config, roster=tuple(config.roster))
    assert [type(value) for fact in header.config.facts for value in fact[2]] == [
        type(value) for fact in config.facts for value in fact[2]
    ]
    assert (header.program, header.payload_max, header.bodily, header.timed) == (77, 90, True, False)
    assert header.versions == versions()


def test_facts_of_other_robots_are_not_in_the_header():
    config = replace(CONFIG, facts=(("mine", 3, ()), ("others", 1, ())))
    data = encode_header(config, 7, {}, payload_max=90, bodily=True, timed=False, neighbors=False, witnessed=False)
    assert [fact[0] for fact in decode_header(data).config.facts] == ["mine"]


@pytest.mark.parametrize("data", [b"", b"\xc1", b"\x80", pack({"config": {}}), pack([1, 2])])
def test_octets_that_are_no_header_are_told(data):
    with pytest.raises(ValueError, match="mind's log"):
        decode_header(data)


def test_values_of_facts_come_back_as_they_are():
    values = (1, True, 1.0, "text", Symbol("text"), Robot(1), (Robot(2), (1.5,)), "\ud800")
    found = unpack(pack(list(values[:-1])))
    assert found == values[:-1]
    assert list(map(type, found)) == list(map(type, values[:-1]))


def test_other_versions_are_named():
    assert differences(versions()) == []
    [(what, then, now)] = differences(versions() | {"python": "CPython 2.7"})
    assert (what, then, now) == ("Python", "CPython 2.7", versions()["python"])
    assert re.fullmatch("[0-9a-f]{16}", source_digest())
    assert len(differences({})) == len(versions())
