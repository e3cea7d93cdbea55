"""Discrete-event run of an evaluation: the nodes of all robots over one ether, in virtual time, until quiescence.

A robot is called only when needed: the event heap holds frames under way, events from outside, and for each robot the
one instant of its next call. The run is quiescent when every robot is idle (`Node.idle`: no rule satisfied, nothing
under way from it, no action, no deadline ahead), no program frame is in the air and no event from outside is
outstanding. A robot's idleness changes only in a call, so it is updated only then.

The time of the last event (`happened`) counts notes of robots, firings and events from outside. It does not count
acknowledgements and repeats of earlier frames, nor changes of schedules.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from rmr.base.arena import NOWHERE
from rmr.base.kernel import RADIO, ROBOT, Alarm, Kernel
from rmr.base.streams import stream
from rmr.base.time import NEVER, Duration, Instant, in_seconds, milliseconds
from rmr.base.values import Robot, Value
from rmr.bytecode.program import InitialFact, Program
from rmr.eval.acting import Acting
from rmr.eval.eval_ether import LATENCY, EvalEther, Messages, frame_text
from rmr.eval.eval_report import (
    dropped,
    entry,
    hopeless,
    lost_in_restarts,
    omitted,
    outstanding,
    past_life,
    repeating,
    slowed,
    undelivered,
    unheard,
    unmatched,
)
from rmr.eval.given import Given, Insertion, facts_by_owner, values
from rmr.eval.options import Death
from rmr.eval.topology import Topology
from rmr.node.config import GivenFact, NodeConfig
from rmr.node.node import Node
from rmr.node.ports import Ports
from rmr.node.trace import TraceLevel
from rmr.vm.engines import Engine

FIRINGS_MAX = 2_000_000
"""Firings of one run; each robot adds 1 % (`most`). A program that never becomes quiescent fires 30,000 times in a
second, so the bound ends it after about a minute."""
FRAMES_MAX = 200_000
"""Program frames of one run (facts, goals, actions, their results); each robot adds 1 % (`most`). A frame costs as much
as ten firings."""
LOOK_EVERY = 256
"""Calls between two polls of the caller: progress, and whether the run is to stop."""
UNDELIVERED_MAX = 64
"""Distinct delivery failures whose names are kept; the report counts all of them."""
REPEATS_MAX = 64
"""Rules in livelock whose places are kept, and jobs that cannot be in time."""
RANGE_M = 1.0
"""Distance D of every fact `range(R, B, D)`: robots without bodies have no position."""

UNKNOWN = 1e-9
"""Probability, at most, that a neighbour has not heard what a robot has told of its shared facts."""
SHARED_REPEATS_MAX = 64
"""So many repeats reach it up to a loss of 72 %."""

ABOUT_SCHEDULES = frozenset({"asks", "slotted", "slot_lost", "entered", "left", "withdrawn", "scheduled", "leads"})
ABOUT_FRAMES = frozenset({"repeated", "delivered", "malformed", "other_program"})
"""Kinds of notes that are no events of the program: they do not count as the last event."""

Note = dict[str, Any]
Sink = Callable[[Sequence[Note]], None]
"""Receives notes in order of time."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """The conditions of a run: robots, topology, radio, actions and deaths."""

    robots: Mapping[int, None]
    """Their ids, ascending."""
    topology: Topology
    seed: int = 0
    loss: float = 0.0
    latency: Duration = LATENCY
    action_time: Duration = 0
    """Duration of the actions that `action_times` does not name."""
    action_times: Mapping[str, Duration] = field(default_factory=dict)
    deaths: tuple[Death, ...] = ()
    """In order of time."""
    engine: Engine = Engine.GENERATED


class Hosted:
    """A node with its link and its entry in the event heap."""

    def __init__(self, ensemble: "Ensemble", robot: int) -> None:
        self.robot = robot
        self._ensemble = ensemble
        self._alarm = Alarm(ensemble.kernel, ROBOT, self._tick)
        self._link = ensemble.ether.link(robot, self._alarm.set)
        self.node = ensemble.make_node(robot, self._link)
        self.idle = False
        self.alive = True
        self._killed_at: Instant = 0
        self.past: list[dict[str, Any]] = []
        """Report parts of the robot's earlier incarnations."""
        self.firings = 0
        """Firings of the present node."""
        self.last_rule: str | None = None
        """Place of the last rule that was traced as fired."""

    def start(self, now: Instant) -> None:
        """Start the node with its facts and schedule its first call."""
        self.node.start(now)
        self._alarm.set(now)

    def insert(self, now: Instant, name: str, args: tuple[Value, ...]) -> None:
        """Insert a fact from outside; its consequences follow in the node's next call, scheduled for `now`."""
        self.node.insert(now, name, args)
        self._ensemble.note_idle(self, False)
        self._alarm.set(now)

    def kill(self) -> None:
        """Kill the robot's process: it is not called and does not answer any more."""
        if self.alive:
            self._killed_at = self._ensemble.kernel.now
        self.alive = False
        self._alarm.set(NEVER)
        self._ensemble.ether.switch_off(self._link)
        self._ensemble.note_idle(self, True)  # a dead robot must not keep the run from quiescence

    def restart(self, now: Instant) -> None:
        """Start a new incarnation with the initial facts; its epoch distinguishes its frames from earlier ones."""
        self.past.append(past_life(self))
        self.alive = True
        self.firings = 0
        self._link = self._ensemble.ether.link(self.robot, self._alarm.set)
        self.node = self._ensemble.make_node(self.robot, self._link, len(self.past), self._killed_at)
        near = self._ensemble.conditions.topology.neighbors(self.robot)
        self.node.miss(now, [other for other in near if not self._ensemble.robots[other].alive])
        self._ensemble.note_idle(self, False)
        self.start(now)

    def look_around(self, now: Instant) -> None:
        """Schedule a call of the node: its neighbours have changed."""
        if self.alive:
            self._ensemble.note_idle(self, False)
            self._alarm.set(now)

    def _tick(self, now: Instant) -> None:
        if not self.alive:
            return
        self.node.tick(now)
        self._ensemble.looked_at(self)
        self._alarm.set(max(self.node.next_wake, now + 1))  # later than now: virtual time must advance


class Ensemble:
    """All robots of one evaluation."""

    def __init__(self, program: Program, given: Given, conditions: Conditions, sink: Sink | None = None) -> None:
        """`sink` receives the robots' notes; None: no trace."""
        self.program = program
        self.conditions = conditions
        self.kernel = Kernel()
        self.firings = 0
        self.happened: Instant = 0
        """Instant of the last event."""
        self.outstanding: list[Insertion | Death] = sorted(
            (*conditions.deaths, *given.insertions), key=lambda each: each.at
        )
        """Future events from outside, in order of time."""
        self.unheard: list[tuple[int, str]] = []
        """(robot, --insert) of facts that came while the robot was dead."""
        self.undelivered: dict[tuple[int, int, str, str], None] = {}
        """(source, destination, predicate, why) of what could not be delivered."""
        self.repeats: dict[tuple[int, str], int] = {}
        """(robot, rule): firings for the same facts, of rules that repeated themselves while a goal stayed open."""
        self.hopeless: list[tuple[int, Note]] = []  # robots, and their words of jobs that cannot be in time
        self._digest = given.digest
        self._sink = sink
        self._stopping = False
        self.acting = Acting(program, conditions.action_times, conditions.action_time, given.failing)
        self.changes = 0
        """Number of deaths and restarts: the version of the neighbourhoods that nodes cache."""
        self._facts = facts_by_owner(given.facts)
        self._edges = None if given.edges is None else program.predicates[given.edges].name
        self.ether = EvalEther(
            self.kernel,
            conditions.topology,
            stream(f"{conditions.seed}/ether"),
            loss=conditions.loss,
            latency=conditions.latency,
            lost=None if sink is None else self._lost,
        )
        self.robots = {robot: Hosted(self, robot) for robot in conditions.robots}
        self.busy = len(self.robots)
        """Robots that are not idle."""

    def make_node(self, robot: int, link: Any, epoch: int = 0, ended: Instant | None = None) -> Node:
        """Return the node of `robot`."""
        conditions = self.conditions
        # Where actions take no time a slot is as long as the resolution of schedules.
        config = NodeConfig(
            robot,
            conditions.robots.keys(),
            NOWHERE,
            conditions.seed,
            facts=tuple(self._facts_of(robot)),
            epoch=epoch,
            predecessor_ended=ended,
            trace=TraceLevel.NOTES if self._sink is None else TraceLevel.FIRINGS,
            turn=max(self.acting.longest, milliseconds(10)),
            engine=conditions.engine,
            shared_repeats=_shared_repeats(conditions.loss),
        )
        ports = Ports(link, None, neighbors=_Neighbors(self, robot))
        return Node(config, self.program, ports, self.acting.handlers, self._digest)

    def _facts_of(self, robot: int) -> Iterable[GivenFact]:
        for fact in (*self._facts.get(None, ()), *self._facts.get(robot, ())):
            yield self.program.predicates[fact.predicate].name, robot, values(fact, robot)
        if self._edges is not None:
            for other in self.conditions.topology.neighbors(robot):
                yield self._edges, robot, (Robot(other),)

    # ---- the run

    @property
    def quiescent(self) -> bool:
        """Whether all robots are idle, no program frame is under way and no event from outside is to come."""
        return not (self.busy or self.ether.pending or self.outstanding)

    @property
    def exhausted(self) -> bool:
        """Whether the run has used up its firings or frames."""
        robots = len(self.robots)
        return self.firings >= most(FIRINGS_MAX, robots) or self.frames >= most(FRAMES_MAX, robots)

    @property
    def now(self) -> Instant:
        """The present instant of virtual time."""
        return self.kernel.now

    @property
    def messages(self) -> Messages:
        """Counts of the frames on the air."""
        return self.ether.messages

    @property
    def frames(self) -> int:
        """Number of program frames."""
        return self.ether.carried

    def run(self, until: Instant, look: Callable[[], None] = lambda: None) -> bool:
        """Run to quiescence, or to `until` (included) at the latest; return whether it became quiescent.

        `look` is called every `LOOK_EVERY` calls. `stop`, and the bounds on firings and frames, end the run earlier.
        """
        for event in self.outstanding:
            happen = partial(self._befall, event) if isinstance(event, Death) else partial(self._insert, event)
            self.kernel.at(event.at, RADIO, happen)
        for robot in self.robots.values():
            robot.start(0)
        calls = 0
        while not self.quiescent:
            if self.kernel.due > until or self.exhausted or self._stopping:
                return False
            self.kernel.step()
            calls += 1
            if calls % LOOK_EVERY == 0:
                look()
        return True

    def stop(self) -> None:
        """End the run after the present call."""
        self._stopping = True

    # ---- report

    def entries(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield each robot with its part of the report."""
        return ((robot, entry(hosted)) for robot, hosted in self.robots.items())

    def unfinished(self) -> Iterator[tuple[int, Iterator[str]]]:
        """Yield the robots that are not idle, each with its outstanding work."""
        return ((robot, outstanding(hosted)) for robot, hosted in self.robots.items() if not hosted.idle)

    @property
    def unsendable(self) -> int:
        """How many facts, goals and actions no frames can carry; they were dropped."""
        hosted = self.robots.values()
        past = sum(int(life.get("unsendable", 0)) for one in hosted for life in one.past)
        return past + sum(one.node.messenger.deliveries.unsendable for one in hosted)

    def warnings(self) -> tuple[Iterator[str], ...]:
        """Return the warnings of the run, by kind."""
        lost = undelivered(self), lost_in_restarts(self), unheard(self)
        return *lost, hopeless(self), dropped(self), repeating(self), unmatched(self), slowed(self), omitted(self)

    # ---- events

    def _insert(self, insertion: Insertion, now: Instant) -> None:
        del self.outstanding[0]
        self.happened = now
        fact: InitialFact = insertion.fact
        name = self.program.predicates[fact.predicate].name
        for robot in self.robots if fact.owner is None else (fact.owner,):
            if robot in self.robots and self.robots[robot].alive:
                self.robots[robot].insert(now, name, values(fact, robot))
            elif robot in self.robots and len(self.unheard) < UNDELIVERED_MAX:
                self.unheard.append((robot, insertion.text))

    def _befall(self, death: Death, now: Instant) -> None:
        del self.outstanding[0]
        self.happened = now
        self.changes += 1
        hosted = self.robots[death.robot]
        if death.restart:
            hosted.restart(now)
        else:
            hosted.kill()
        # Provided facts such as neighbor/2 name living robots only: the neighbours must update theirs.
        for robot in self.conditions.topology.neighbors(death.robot):
            self.robots[robot].look_around(now)
        if self._sink is not None:
            fault = "restarted" if death.restart else "killed"
            self._sink([{"t": round(in_seconds(now), 6), "robot": death.robot, "what": "fault", "fault": fault}])

    def looked_at(self, hosted: Hosted) -> None:
        """Collect a robot's firings, notes and idleness after a call."""
        node = hosted.node
        self.note_idle(hosted, not node.outstanding)
        fired = node.machine.firings - hosted.firings
        if fired:
            self.firings += fired
            hosted.firings += fired
            self.happened = self.kernel.now
        if node.trace_log:
            self._take_notes(hosted, node.trace_log)
            node.trace_log.clear()

    def note_idle(self, hosted: Hosted, idle: bool) -> None:
        """Update whether a robot is idle, and the number of busy robots."""
        if idle != hosted.idle:
            self.busy += -1 if idle else 1
            hosted.idle = idle

    def _take_notes(self, hosted: Hosted, notes: list[Note]) -> None:
        for note in notes:
            what = note["what"]
            if what == "fired":
                hosted.last_rule = note["rule"]
            elif what == "repeats" and len(self.repeats) < REPEATS_MAX:
                self.repeats[hosted.robot, note["rule"]] = note["firings"]
            elif what == "cannot_meet" and len(self.hopeless) < REPEATS_MAX:
                self.hopeless.append((hosted.robot, note))
            elif what == "undelivered" and len(self.undelivered) < UNDELIVERED_MAX:
                key = (hosted.robot, note["destination"], note["predicate"], note["why"])
                self.undelivered[key] = None
            if what not in ABOUT_SCHEDULES and what not in ABOUT_FRAMES:
                self.happened = self.kernel.now
        if self._sink is not None:
            self._sink(notes)

    def _lost(self, now: Instant, source: int, destination: int, payload: bytes) -> None:
        assert self._sink is not None
        note = {"what": "lost", "destination": destination, "frame": frame_text(payload)}
        self._sink([{"t": round(in_seconds(now), 6), "robot": source, **note}])


def _shared_repeats(loss: float) -> int:
    """Return how often shared facts are told again, so that hardly any is unknown to a neighbour when the run ends."""
    if loss <= 0.0:
        return 0
    return SHARED_REPEATS_MAX if loss >= 1.0 else min(SHARED_REPEATS_MAX, math.ceil(math.log(UNKNOWN) / math.log(loss)))


def most(count: int, robots: int) -> int:
    """Return the bound of a run: `count` plus 1 % of it for each of `robots` robots, rounded up."""
    return -(-count * (100 + robots) // 100)


class _Neighbors:
    """The living robots in range of one robot, as (robot, metres): computed on demand, cached until a death."""

    def __init__(self, ensemble: Ensemble, robot: int) -> None:
        self._ensemble = ensemble
        self._robot = robot
        self._known: list[tuple[int, float]] | None = None
        self._changes = 0

    def __call__(self) -> Sequence[tuple[int, float]]:
        ensemble = self._ensemble
        if self._known is None or self._changes != ensemble.changes:
            self._changes = ensemble.changes
            near = ensemble.conditions.topology.neighbors(self._robot)
            self._known = [(other, RANGE_M) for other in near if ensemble.robots[other].alive]
        return self._known
