"""One life of a robot: when its node is called, driven by a clock and a node that the test plays."""

import asyncio
import time
from dataclasses import asdict, replace

import pytest

from rmr.base import arena
from rmr.base.time import NEVER, NS_PER_MS, NS_PER_S
from rmr.base.values import Symbol
from rmr.bus import wire
from rmr.bus.checks import MalformedError
from rmr.bytecode.program import ANY, Base, Constant, Kind, Predicate, Program, Type
from rmr.node.motion.grid import grid_of
from rmr.radio.air import Announcement
from rmr.radio.frame import DataFrame, encode_data
from rmr.radio.phy import Bursts, airtime
from rmr.radio.station import RadioConfig
from rmr_agent import incarnation as lives
from rmr_agent.bytecode import Loaded, RefusedError
from rmr_agent.clock import LabClock
from rmr_agent.incarnation import Incarnation, Outlets, make_station, node_config

MS = NS_PER_MS
FLOAT, INT, LIST = Type(Base.FLOAT), Type(Base.INT), Type(Base.LIST, element=Type(Base.FLOAT))
PROGRAM = Program(
    (
        Predicate("due", Kind.PERSISTENT, (FLOAT,)),
        Predicate("count", Kind.TEMPORARY, (INT,)),
        Predicate("row", Kind.TEMPORARY, (LIST,)),
    )
)
RADIO = {"pan": 7, "seed": 1} | asdict(RadioConfig())


def known(facts=(), finish=None, floor=None):
    floor = arena.to_data(arena.Arena(1.0, 1.0, 0.05)) if floor is None else floor
    message = wire.Map("x", True, False, 0, 3, (1, 2), floor, RADIO, tuple(facts), finish, "waiting", ())
    return wire.decode(wire.encode(-1, 1, 1, message)).body


# --- what the world tells becomes the node's configuration ---------------------------------------------------


def test_the_labs_facts_take_the_types_of_the_program():
    facts = [("due", 1, (25,)), ("count", None, (25,)), ("row", 1, ((1, 2.5),)), ("due", 2, (9,))]
    config = node_config(1, known(facts), PROGRAM, 4)
    assert [repr(fact) for fact in config.facts] == [
        "('due', 1, (25.0,))",
        "('count', None, (25,))",
        "('row', 1, ((1.0, 2.5),))",
    ]
    assert (config.robot, config.roster, config.seed, config.epoch) == (1, (1, 2), 3, 4)


def test_the_finish_pattern_arrives_with_its_anonymous_parts():
    config = node_config(1, known(finish=("at", (Symbol("exit"), None))), PROGRAM, 0)
    assert config.finish == ("at", (Constant(Symbol("exit")), ANY))
    assert node_config(1, known(), PROGRAM, 0).finish is None


def test_the_node_knows_when_the_process_before_it_had_ended():
    told = wire.encode(-1, 1, 1, known()._replace(lives=1, predecessor_ended=5 * MS))
    assert node_config(1, wire.decode(told).body, PROGRAM, 1).predecessor_ended == 5 * MS
    assert node_config(1, known(), PROGRAM, 0).predecessor_ended is None


def test_processes_have_their_frames_one_after_the_other_and_the_robots_of_one_together():
    roster = (7, 3, 90, 12)
    assert sorted(lives.phase_of(first, roster) for first in roster) == [lives.FRAME * k // 4 for k in range(4)]
    assert lives.phase_of(8, roster) == lives.phase_of(12, roster), "the lab may have no robot 8"
    assert node_config(2, known(), PROGRAM, 0, lives.phase_of(2, (1, 2))).phase == lives.FRAME // 2


@pytest.mark.parametrize("setting", [{"exponent": "3"}, {"tx_power_dbm": float("nan")}])
def test_radio_settings_without_a_valid_cell_grid_are_refused(setting):
    config = node_config(1, known(), PROGRAM, 0)
    assert lives.floor_grid(config).width_m > 1.0
    with pytest.raises(RefusedError, match="radio"):
        lives.floor_grid(replace(config, radio=lives.radio_config(RADIO | setting)))


@pytest.mark.parametrize("fact", [("late", 1, (3,)), ("due", None, (1, 2)), ("count", 1, ("x",)), ("count", 1, (2.5,))])
def test_a_fact_that_does_not_fit_the_program_is_refused(fact):
    with pytest.raises(RefusedError, match=fact[0]):
        node_config(1, known([fact]), PROGRAM, 0)


def test_finish_fact_of_wrong_arity_is_refused_and_sensed_finish_fact_is_accepted():
    with pytest.raises(RefusedError, match="finish fact due"):
        node_config(1, known(finish=("due", (3, None))), PROGRAM, 0)
    assert node_config(1, known(finish=("at", (Symbol("exit"),))), PROGRAM, 0).finish is not None


def test_malformed_arena_is_rejected_and_implausible_arena_is_refused():
    with pytest.raises(MalformedError, match="Map: expected an arena"):
        known(floor={"width": 3})
    with pytest.raises(RefusedError, match="arena"):
        node_config(1, known()._replace(arena={"width": 3}), PROGRAM, 0)


def test_radio_settings_from_the_world_include_burst_losses():
    config = RadioConfig(loss=0.1, shadowing_db=4.0, bursts=Bursts(2 * NS_PER_S, 200 * MS, 0.9))
    told = wire.decode(wire.encode(-1, 1, 1, known()._replace(radio={"pan": 7, "seed": 1} | asdict(config)))).body
    assert lives.radio_config(told.radio) == config


@pytest.mark.parametrize("bursts", [3, {"good": 1}, {"good": 0, "bad": 0}, {"good": "x", "bad": "y"}, {"worse": 1}])
def test_malformed_burst_settings_are_refused(bursts):
    with pytest.raises(RefusedError, match="radio"):
        lives.radio_config(RADIO | {"bursts": bursts})


def test_unknown_radio_settings_are_refused(monkeypatch):
    with pytest.raises(RefusedError, match="radio"):
        lives.radio_config(RADIO | {"colour": 3})
    with pytest.raises(RefusedError, match="radio"):
        lives.make_station(node_config(1, known(), PROGRAM, 0), {"seed": 1})


def test_radio_power_out_of_range_is_refused():
    config = replace(node_config(1, known(), PROGRAM, 0), radio=RadioConfig(sensitivity_dbm=1e9))
    with pytest.raises(RefusedError, match="radio"):
        lives.make_station(config, RADIO)


# --- when the node is called -------------------------------------------------------------------------------------


class StubNode:
    """Notes when it is called, and wants to be called when it is told."""

    def __init__(self, config, program, ports, handlers, digest):
        self.ports, self.next_wake = ports, 0
        self.calls, self.started = [], None
        self.wakes = []

    def start(self, now):
        self.started = now

    def overhear(self, now, frame):
        return False

    def hold_offers(self, now, held):
        assert not held  # no program is loaded

    def tick(self, now):
        self.calls.append(now)
        self.ports.body.sense()
        self.ports.link.receive()
        assert self.ports.spent() >= 0
        self.next_wake = self.wakes.pop(0) if self.wakes else NEVER


class DeafAir:
    """Notes where the robot listens."""

    def __init__(self):
        self.places = []

    def publish(self, announcement):
        pass

    def move(self, x, y):
        self.places.append((x, y))

    def leave(self):
        self.places.append(None)


def live(monkeypatch, scene):
    """Run `scene(life, clock, node, failures)` with a stub for the node."""
    monkeypatch.setattr(lives, "Node", StubNode)

    async def play():
        clock, failures = LabClock(), []
        silent = Outlets(DeafAir(), lambda body: None, lambda body: None)
        config = node_config(1, known(), PROGRAM, 0)
        station = make_station(config, RADIO)
        life = Incarnation(config, Loaded(PROGRAM, 1, b"code"), {}, station, clock, silent, failures.append)
        try:
            await scene(life, clock, life.node, failures)
        finally:
            life.end()

    asyncio.run(play())


def start(clock, ahead=0):
    now = time.monotonic_ns()
    clock.sample("running", now, -ahead, -ahead, now)


def sample(stamp=0):
    return wire.Sense(stamp, 0.0, 0.0, 0.0, 0.0, (), (), False, (0.5, 0.5, 0.0))


async def until(claim):
    async with asyncio.timeout(5):
        while not claim():
            await asyncio.sleep(0.001)


def test_a_robot_is_ready_when_its_body_answers_and_it_knows_lab_time(monkeypatch):
    async def scene(life, clock, node, failures):
        assert not life.ready
        life.sense(sample())
        assert not life.ready
        clock.sample("waiting", 0, 0, 0, 0)
        assert life.ready
        await asyncio.sleep(0.01)
        assert (life.started, node.calls) == (False, [])

    live(monkeypatch, scene)


def test_planning_grid_is_precomputed_before_a_robot_is_ready(monkeypatch):
    async def scene(life, clock, node, failures):
        floor = node_config(1, known(), PROGRAM, 0).arena
        before = grid_of.cache_info().misses
        grid_of(floor)
        assert grid_of.cache_info().misses == before

    grid_of.cache_clear()
    live(monkeypatch, scene)


def test_robot_receives_frames_from_its_first_sample_to_its_end(monkeypatch):
    async def scene(life, clock, node, failures):
        assert life._air.places == []
        life.sense(sample())
        assert life._air.places == [(0.5, 0.5)]
        assert (life.link.station._x, life.link.station._y) == (0.5, 0.5)
        life.end()
        assert life._air.places == [(0.5, 0.5), None]

    live(monkeypatch, scene)


def test_robot_receives_nothing_before_its_first_position(monkeypatch):
    async def scene(life, clock, node, failures):
        start(clock)
        psdu = encode_data(DataFrame(RADIO["pan"], 1, 2, 5, True, b"x"))
        for sequence, heard in ((1, False), (2, True)):
            begins = life.now() + NS_PER_S
            life.hear(Announcement(2, sequence, 0, begins, begins + airtime(len(psdu)), 0.0, 0.0, 0.0, psdu))
            assert (life.link.station.next_wake < NEVER) is heard
            life.sense(sample())

    live(monkeypatch, scene)


def test_a_robot_does_not_start_before_lab_time_0(monkeypatch):
    async def scene(life, clock, node, failures):
        life.sense(sample())
        start(clock, ahead=30 * MS)
        life.wake()
        await until(lambda: life.started)
        assert node.started >= 0

    live(monkeypatch, scene)


def test_node_is_called_at_its_next_wake_and_not_before(monkeypatch):
    async def scene(life, clock, node, failures):
        node.wakes = [40 * MS, 80 * MS]
        life.sense(sample())
        start(clock)
        life.wake()
        await until(lambda: len(node.calls) == 3)
        await asyncio.sleep(0.02)
        assert len(node.calls) == 3
        assert node.calls[1] >= 40 * MS
        assert node.calls[2] >= 80 * MS

    live(monkeypatch, scene)


def test_sample_wakes_an_idle_node_unless_it_wakes_within_a_frame(monkeypatch):
    async def scene(life, clock, node, failures):
        life.sense(sample())
        start(clock)
        life.wake()
        await until(lambda: node.calls)
        life.sense(sample(1))
        await until(lambda: len(node.calls) == 2)
        node.next_wake = life.now() + 10 * MS
        life.sense(sample(2))
        await asyncio.sleep(0.003)
        assert len(node.calls) == 2

    live(monkeypatch, scene)


def test_busy_node_does_not_starve_the_event_loop(monkeypatch):
    async def scene(life, clock, node, failures):
        node.wakes = [0] * 40
        life.sense(sample())
        start(clock)
        life.wake()
        rounds = 0
        while len(node.calls) < 41:
            await asyncio.sleep(0)
            rounds += 1
        assert rounds >= 41 // lives.TURNS_MAX

    live(monkeypatch, scene)


def test_an_error_of_the_node_is_handed_to_the_host_once(monkeypatch):
    async def scene(life, clock, node, failures):
        node.start = lambda now: 1 // 0
        life.sense(sample())
        start(clock)
        life.wake()
        await until(lambda: failures)
        await asyncio.sleep(0.01)
        assert [type(error) for error in failures] == [ZeroDivisionError]

    live(monkeypatch, scene)


def test_ended_incarnation_is_never_called_again(monkeypatch):
    async def scene(life, clock, node, failures):
        life.sense(sample())
        start(clock)
        life.end()
        life.wake()
        life.sense(sample(1))
        await asyncio.sleep(0.01)
        assert (node.calls, life.started) == ([], False)

    live(monkeypatch, scene)


def test_a_clock_that_is_a_second_ahead_of_the_robots_is_followed(monkeypatch):
    async def scene(life, clock, node, failures):
        start(clock, ahead=-NS_PER_S)
        assert NS_PER_S <= life.now() < 2 * NS_PER_S

    live(monkeypatch, scene)
