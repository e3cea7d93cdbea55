"""One incarnation of a robot: one node, from the moment it knows the lab until it ends or the world begins anew.

The process runs in real time: the node is called at its `next_wake`, the station at its own, and both whenever
something has arrived; in between the process sleeps. A sample of a body does not wake the node if it will read it
within a frame anyway.
"""

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

from rmr.base import arena
from rmr.base.streams import stream
from rmr.base.time import FRAME, NEVER, NS_PER_S, Duration, Instant, in_seconds
from rmr.base.values import Value
from rmr.bus import wire
from rmr.bus.bridge import PATIENCE
from rmr.bus.late_messages import LateSamples
from rmr.bytecode.program import ANY, Base, Constant, Program, Type
from rmr.mind.durable_node import DurableNode
from rmr.mind.journal import DurableState
from rmr.mind.mind_log import MindSink
from rmr.mind.recorded_node import RecordedNode
from rmr.node.actions.dispatcher import Handler
from rmr.node.config import GivenFact, NodeConfig
from rmr.node.crossing import approach
from rmr.node.node import Node
from rmr.node.ports import Ports
from rmr.radio.air import Announcement
from rmr.radio.cells import Grid, grid_of
from rmr.radio.links import Disturbance
from rmr.radio.network import NetworkStation
from rmr.radio.phy import NETWORK, Bursts
from rmr.radio.security import Security
from rmr.radio.station import RadioConfig, Station
from rmr.vm.outside import Gate
from rmr_agent.bus_ports import RADIO_GRACE, BusBody, RadioLink
from rmr_agent.bytecode import Loaded, RefusedError
from rmr_agent.clock import LabClock
from rmr_agent.local_air import LocalAir
from rmr_agent.program_updates import ProgramUpdates

TURNS_MAX: Final = 4
"""Calls of the node in one go: what it sends may come due at once. More wait for the event loop's next round."""


def phase_of(first: int, roster: tuple[int, ...]) -> Duration:
    """Return when in the lab's frames those of a process begin whose first robot is `first`.

    Processes have their frames one after the other; the robots of one have them together, so that it wakes once.
    """
    return FRAME * sum(robot < first for robot in roster) // len(roster)


def node_config(robot: int, known: wire.Map, program: Program, epoch: int, phase: Duration = 0) -> NodeConfig:
    """Return the node's configuration from what the world tells. Raises RefusedError if it does not fit the program."""
    finish = None
    if known.finish is not None:
        name, patterns = known.finish
        finish = name, tuple(ANY if value is None else Constant(value) for value in patterns)
        _check_arity(program, f"finish fact {name}", program.index(name), len(patterns))
    try:
        floor = arena.from_data(known.arena)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise RefusedError(f"its world describes no arena that this robot understands ({error})") from None
    return NodeConfig(
        robot=robot,
        roster=known.roster,
        arena=floor,
        seed=known.seed,
        radio=radio_config(known.radio),
        facts=tuple(_fitted(program, *fact) for fact in known.facts if fact[1] in {None, robot}),
        finish=finish,
        epoch=epoch,
        predecessor_ended=known.predecessor_ended,
        phase=phase,
        navigates=known.navigates,
    )


Configure = Callable[[Program], NodeConfig]
"""Returns the configuration under a program. Raises RefusedError if the lab does not fit it."""


def configuration(robot: int, known: wire.Map, loaded: Loaded, phase: Duration) -> tuple[NodeConfig, Configure | None]:
    """Return the node's configuration, and for a robot that waits for its first program what gives it under that one.

    Raises RefusedError if the lab does not fit the program.
    """
    if loaded.octets:
        return node_config(robot, known, loaded.program, known.lives, phase), None
    bare = known._replace(facts=())  # an empty program knows no fact
    config = node_config(robot, bare, loaded.program, known.lives, phase)
    return config, lambda program: node_config(robot, known, program, known.lives, phase)


def _fitted(program: Program, name: str, owner: int | None, args: tuple[Value, ...]) -> GivenFact:
    """Return a fact of the lab with its integers made floats where the program declares floats."""
    index = program.index(name)
    if index is None:
        raise RefusedError(f"its fact {name}(...) means nothing to the program, which has no such predicate")
    _check_arity(program, f"fact {name}", index, len(args))
    types = program.predicates[index].types
    fitted = tuple(_as(kind, value) for kind, value in zip(types, args, strict=True))
    try:
        return name, owner, Gate(program.predicates).fact(index, fitted)
    except ValueError as error:
        raise RefusedError(f"its fact {name}(...) does not fit the program: {error}") from None


def _check_arity(program: Program, what: str, index: int | None, count: int) -> None:
    """Raise RefusedError unless a fact with `count` arguments is one of predicate `index`, if the program has it."""
    wanted = count if index is None else len(program.predicates[index].types)
    if count != wanted:
        raise RefusedError(f"its {what}(...) has {count} arguments beside the owner, the program's {wanted}")


def _as(kind: Type, value: Value) -> Value:
    if kind.base is Base.FLOAT and type(value) is int:
        return float(value)
    if kind.element is not None and isinstance(value, tuple):
        return tuple(_as(kind.element, item) for item in value)
    return value


def radio_config(radio: dict[str, Any]) -> RadioConfig:
    """Return the radio's model from the settings that the world tells. Raises RefusedError."""
    settings = {name: value for name, value in radio.items() if name not in {"pan", "seed", "security"}}
    try:
        if settings.get("bursts") is not None:
            settings["bursts"] = Bursts(**settings["bursts"])
        return RadioConfig(**settings)
    except (TypeError, ValueError) as error:
        raise RefusedError(f"its radio is set in a way that this robot does not know ({error})") from None


def make_station(
    config: NodeConfig, radio: dict[str, Any], security: Security | None = None
) -> Station | NetworkStation:
    """Return the robot's radio from the settings that the world tells. Raises RefusedError."""
    rng = stream(f"{config.seed}/robot{config.robot}/csma/{config.epoch}")
    try:
        if config.radio.mode == NETWORK:
            return NetworkStation(config.robot, radio["pan"], radio["seed"], rng, config.radio, PATIENCE)
        return Station(
            config.robot,
            radio["pan"],
            radio["seed"],
            rng,
            config.radio,
            RADIO_GRACE,
            security=security,
            patience=PATIENCE,
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise RefusedError(f"its radio is set in a way that this robot does not know ({error})") from None


def floor_grid(config: NodeConfig) -> Grid:
    """Return the cells by which the lab's robots listen to each other. Raises RefusedError."""
    try:
        return grid_of(config.radio, config.arena.shape.speed)
    except (TypeError, ValueError, OverflowError) as error:
        raise RefusedError(f"its radio is set in a way that this robot does not know ({error})") from None


class Incarnation:
    """A node with its ports and its timer."""

    def __init__(
        self,
        config: NodeConfig,
        loaded: Loaded,
        handlers: dict[str, Handler],
        station: Station | NetworkStation,
        clock: LabClock,
        send: "Outlets",
        fail: Callable[[BaseException], None],
        minds: MindSink | None = None,
        state: DurableState | None = None,
        configure: Configure | None = None,
    ) -> None:
        """`minds` takes the log of the node's inputs (`rmr.mind`); without it there is none.

        With a `state` the robot is durable, and `minds` gets nothing. `configure` returns the configuration under the
        first program of a robot that waits for one. Raises JournalError if a durable robot cannot go on.
        """
        self._clock = clock
        self._fail = fail
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._soon = False
        self._over = False
        self._wakes: Instant = NEVER
        """Lab time at which the timer rings."""
        self._begun_cpu = 0
        self._air = send.air
        self._beacons = len(config.arena.beacons)
        self.late_samples = LateSamples(config.robot)
        self.link = RadioLink(station, self.now, send.air.publish)
        self.body = BusBody(send.act)
        ports = Ports(self.link, self.body, self._spent)
        self.node: Node
        if state is not None:
            own = (state.journal, state.stored, state.noted, state.snapshot)
            self.node = DurableNode(config, loaded.program, ports, handlers, loaded.digest, *own)
        elif minds is None:
            self.node = Node(config, loaded.program, ports, handlers, loaded.digest)
        else:
            self.node = RecordedNode(config, loaded.program, ports, handlers, loaded.digest, minds)
        self.programs = ProgramUpdates(self.node, config, station, loaded, handlers, send.answer, self.now, configure)
        self.link.programs = self.programs.heard
        approach.foresee(config.arena)
        self.started = False
        self.after_turn: Callable[[Instant], None] | None = None
        """Called after each turn with the instant of the node's last call, where the robot is recorded."""
        self.turns = 0
        """How often the node has been called."""

    def now(self) -> Instant:
        """Return lab time."""
        return self._clock.at(time.monotonic_ns())

    def _spent(self) -> Duration:
        return time.thread_time_ns() - self._begun_cpu

    @property
    def _start_due(self) -> Instant:
        """When a robot is to start: at the start of lab time, or when it knows which program the others run."""
        return 0 if self.now() < 0 else NEVER

    @property
    def resumption(self) -> str:
        """How a durable robot goes on, in words; empty if it begins."""
        node = self.node
        if not isinstance(node, DurableNode) or not node.brought_back:
            return ""
        return f", and goes on as it was at {in_seconds(node.now):.3f} s of lab time"

    @property
    def resumed(self) -> dict[str, Any]:
        """What the report says of a durable robot that goes on: it covers the time before, too."""
        return {"resumed": True} if self.resumption else {}

    @property
    def ready(self) -> bool:
        """Whether the robot has all that it needs to start: its body answers and it knows lab time."""
        return self.body.place is not None and self._clock.state != "unknown"

    # -- input ----------------------------------------------------------------------------------------------

    def sense(self, sample: wire.Sense) -> None:
        """Take in a sample of the body."""
        if sample.ranges and max(sample.ranges)[0] >= self._beacons:
            self.link.malformed += 1  # of another arena: a world has begun anew, and the robot has not noticed yet
            return
        first = self.body.place is None
        if self.started:
            self.late_samples.note(sample.stamp, self.now())
        self._clock.hear(sample.stamp, time.monotonic_ns())
        self.body.feed(sample)
        assert self.body.place is not None
        self.link.station.move(*self.body.place)
        self._air.move(*self.body.place)
        if not self.started:
            self.body.keep_newest()
        if first or not self.started or self.node.next_wake - self.now() > FRAME:
            self.wake()

    def hear(self, announcement: Announcement) -> None:
        """Take in the announcement of a radio frame. Frames without acknowledgement are decided together.

        A robot that does not know its place hears nothing yet: some calls reach it wherever it is.
        """
        station = self.link.station
        if self.body.place is None:
            return
        now = self.link.hear(announcement)
        if station.next_wake < self._wakes or (station.soonest <= now and self._wakes - now > FRAME):
            self.wake()

    def load(self, body: wire.Message) -> None:
        """Take in what an operator says about a new program."""
        if self._clock.running and self.body.place is not None:
            self.programs.told(self.now(), body)
            self.wake()

    def disturb(self, held: tuple[Disturbance, ...]) -> None:
        """Let these disturbances of the radio, and no others, hold."""
        self.link.station.links.replace(held)

    def wake(self) -> None:
        """Look soon at what is due."""
        if not self._soon and not self._over:
            self._soon = True
            self._loop.call_soon(self._turn)

    def end(self) -> None:
        """Do nothing more."""
        self._over = True
        if isinstance(self.node, RecordedNode):
            self._tell_not_delivered(self.node)
            with suppress(OSError):  # of a full disk the robot has told when it stopped
                self.node.end_log()
        self._air.leave()
        if self._timer is not None:
            self._timer.cancel()

    def commit(self) -> None:
        """Let the disk have all that a durable robot has done, before others are told of it."""
        if isinstance(self.node, DurableNode):
            try:
                self.node.commit()
            except OSError as error:
                self._fail(error)

    def _tell_not_delivered(self, node: RecordedNode) -> None:
        node.not_delivered(self.body.dropped, self.link.dropped, self.link.malformed)

    # -- turns ----------------------------------------------------------------------------------------------

    def _turn(self) -> None:
        self._soon = False
        if self._over:
            return
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._wakes = NEVER
        try:
            self._advance()
            if self.after_turn is not None and self.started:
                self.after_turn(self.node.now)
        except (Exception, SystemExit) as error:  # an action that calls exit() does not take the report with it
            self._fail(error)
            return
        self._sleep()

    def _advance(self) -> None:
        if not self._clock.running or self.body.place is None:
            return
        now = self.now()
        if now < 0:
            return
        if not self.started:
            self.link.advance(now, *self.body.place)
            if not self.programs.may_start(now):
                return
            self.started = True
            self.link.overhear = self.node.overhear
            self.node.start(now)
        self.programs.advance(now)
        if isinstance(self.node, RecordedNode):
            self._tell_not_delivered(self.node)
        x, y = self.body.place
        sampled = self.body.waiting and self.node.next_wake - now > FRAME
        for _ in range(TURNS_MAX):
            self.link.advance(now, x, y)
            if not (sampled or self.link.waiting or now >= self.node.next_wake):
                return
            sampled = False
            self.turns += 1
            self._begun_cpu = time.thread_time_ns()
            self.node.tick(now)
            now = self.now()

    def _sleep(self) -> None:
        if not self._clock.running or self.body.place is None:
            return  # the clock's start, or the first sample, wakes
        wake = min(self.node.next_wake if self.started else self._start_due, self.link.station.next_wake, NEVER)
        wake = min(wake, self.programs.next_wake)
        delay_s = (wake - self.now()) / NS_PER_S
        if delay_s <= 0:
            self.wake()
        else:
            self._wakes = wake
            # A second at most: a bound on what a wrong `next_wake` could cost.
            self._timer = self._loop.call_later(min(delay_s, 1.0), self._turn)


class Outlets:
    """Where an incarnation's output goes."""

    def __init__(
        self, air: LocalAir, act: Callable[[wire.Message], None], answer: Callable[[wire.Message], None]
    ) -> None:
        """`answer` sends to operators."""
        self.air = air
        self.act = act
        self.answer = answer
