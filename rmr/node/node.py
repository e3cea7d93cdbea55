"""One robot: the same object in a robot process, in the simulator and in `rmr eval`.

It joins the virtual machine, the coordination core, the exchange of facts, localisation and the navigator, and
runs them as the executive's tasks in the order of the paper's priorities: motor control with stop-if-dangerous,
radio, localisation, runtime system, telemetry. It reads no clock, opens nothing, and knows neither zenoh nor
the source language. The host calls `tick` at `next_wake` and whenever the radio or the body has something new.

Nothing but hosts imports this module: the parts see each other through `rmr.node.parts`.
"""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from typing import Any, Final

from rmr.base.streams import stream
from rmr.base.time import NEVER, Instant
from rmr.base.values import Robot, Value
from rmr.bytecode.program import Program
from rmr.coord.coordination import Coordination
from rmr.coord.events import CoordEvent
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import Dispatcher, Handler, check_handlers
from rmr.node.config import NodeConfig
from rmr.node.crossing.coordination_link import CoordLink
from rmr.node.crossing.crossings import Crossings
from rmr.node.executive import Executive, ExecutiveTask
from rmr.node.logic.deliveries import Deliveries
from rmr.node.logic.exchange import Exchange
from rmr.node.logic.machine_runner import MachineRunner
from rmr.node.logic.shared_facts import SharedFacts
from rmr.node.messenger import Messenger, Transmitter
from rmr.node.peers.presence import Presence
from rmr.node.peers.proximity import Proximity
from rmr.node.ports import Confirmed, Ports, Received
from rmr.node.program_change import NodeParts, ProgramChanged, take_over
from rmr.node.robot_state import RobotState
from rmr.node.services import RobotServices
from rmr.vm.carrying import Carried
from rmr.vm.machine import FIRING_BUDGET
from rmr.vm.provenance import GivenCause
from rmr.vm.shared import shared_of

OFFERS_HELD: Final = "offers held"
"""No name of a predicate: what a host orders in the form of an insertion (`Node.insert`), so that logs have it."""


class Node:
    """One robot."""

    def __init__(
        self,
        config: NodeConfig,
        program: Program,
        ports: Ports,
        handlers: Mapping[str, Handler],
        digest: int = 0,
        before: RobotState | None = None,
    ) -> None:
        """Raise MissingHandlers when an action of `program` has no handler in `handlers` or among the provided.

        `before` is the robot's state under another program (`change_program`).
        """
        check_handlers(program, {**PROVIDED, **handlers})
        self._ports = ports
        self._handlers = handlers
        self.config = config
        self.robot = config.robot
        self.program = program
        self.next_wake: Instant = 0
        """When the host is to call `tick` at the latest."""
        self._started = False
        self.state = state = RobotState(config, program, ports.body, digest, before)
        self.machine = state.machine
        self.driver = state.driver
        self.peers = state.peers
        self.senses = state.senses
        self.notes = state.notes

        name = f"{config.seed}/robot{config.robot}"
        payload_max = ports.link.payload_max
        self.radio = radio = Transmitter(state, ports.link)
        self.services = services = RobotServices(state, radio, handlers)
        timing = replace(config.timing, payload_max=payload_max)
        self.core = Coordination(
            config.robot, stream(f"{name}/coord"), lambda: len(config.roster) - 1, timing, self._stands_inside
        )
        """The coordination core, for checkers of a run to look at."""
        self.crossings = Crossings(services, self.core, digest)
        self._coordination = CoordLink(self.core, radio.transmit, self._coordinated)
        self.actions = Dispatcher(services)
        exchange = Exchange(digest, config.epoch, stream(f"{name}/exchange"), payload_max)
        exchange.tell = state.tell
        deliveries = Deliveries(state, exchange)
        self._presence = Presence(state, radio, self.crossings, self.actions)
        link = self._coordination
        shared = SharedFacts(state, radio, payload_max, ports.neighbors)
        self.messenger = Messenger(state, ports.link, radio, link, self._presence, deliveries, shared)
        self.runner = MachineRunner(state, deliveries, self.crossings, self.actions, services.handler)
        self._proximity = Proximity(state, ports.neighbors)
        runtime = RuntimeSystem(state, self.runner, self.actions, self.crossings, link, self.messenger)
        tasks = [
            ExecutiveTask("motor", self._motor, periodic=True),
            ExecutiveTask("radio", self.messenger.run, periodic=False),
            ExecutiveTask("localisation", self._localise, periodic=False),
            ExecutiveTask("runtime", runtime.run, periodic=False),
            ExecutiveTask("telemetry", self._presence.telemetry, periodic=True),
        ]
        self.executive = Executive(tasks, ports.spent, config.phase)
        services.join(self.actions, self.crossings, self._presence, self.runner, self.executive)

    def _coordinated(self, now: Instant, event: CoordEvent) -> None:
        self.state.tell(event)
        self.crossings.handle(now, event)

    def _stands_inside(self, group_id: bytes, robot: int) -> bool:
        return self.crossings.stands_inside(group_id, robot)

    def _parts(self) -> NodeParts:
        return NodeParts(
            self.state,
            self.radio,
            self.services,
            self.crossings,
            self.actions,
            self.messenger,
            self.runner,
            self.executive,
        )

    # -- start and tick ---------------------------------------------------------------------------------------

    def start(self, now: Instant) -> None:
        """Insert the initial facts and begin."""
        self.state.now = now
        self._started = True
        ended = self.config.predecessor_ended
        # Where frames take no time, it may have taken one that left in the very instant of its end.
        self.messenger.exchange.predecessor_ended = max(0, now if ended is None else ended + 1)
        self.machine.start(now)
        self._state_life(now)
        self._restarted(now)
        self._state_roster(now)
        for name, owner, args in self.config.facts:
            if owner is None or owner == self.robot:
                with suppress(ValueError) if self.state.changes else nullcontext():  # the lab's facts fit its program
                    self.services.insert(now, name, args, GivenCause("lab"))
        self._presence.start(now)
        self.next_wake = now

    def _state_roster(self, now: Instant) -> None:
        if self.senses.used("peer"):
            others = [other for other in self.config.roster if other != self.robot]
            self.senses.replace(now, "peer", [(Robot(other),) for other in others])
        if self.senses.used("robots"):
            self.senses.replace(now, "robots", [(len({*self.config.roster, self.robot}),)])

    def _state_life(self, now: Instant) -> None:
        life = shared_of(self.program).life
        if life is not None:
            self.machine.insert(now, life, (self.config.epoch,), GivenCause("robot"))

    def _restarted(self, now: Instant) -> None:
        """After a restart tell the program of each other robot: what they asked of an earlier life is forgotten."""
        predicate = shared_of(self.program).restarted
        if predicate is None or not self.config.epoch:
            return
        for other in self.config.roster:
            if other != self.robot:
                self.machine.insert(now, predicate, (Robot(other),), GivenCause("robot"))

    def insert(self, now: Instant, name: str, args: Sequence[Value]) -> None:
        """Insert a fact of this robot from outside. Raises ValueError when the program does not know it.

        With the name `OFFERS_HELD` it is an order: true, to offer nothing more by ensemble rules; false, to go on.
        """
        if name == OFFERS_HELD:
            self.messenger.hold_offers(now, bool(args[0]))
        else:
            self.services.insert(now, name, args)
        self.next_wake = min(self.next_wake, now)

    def hold_offers(self, now: Instant, held: bool) -> bool:
        """Offer nothing by ensemble rules while `held`: a change of programs is ahead. Return whether that is new."""
        offers = self._started and shared_of(self.program).count is not None
        news = offers and held != self.messenger.offers_are_held
        if news:
            self.insert(now, OFFERS_HELD, (held,))
        return news

    def miss(self, now: Instant, others: Sequence[int]) -> None:
        """Note, before the start, robots that `Ports.neighbors` would offer if they lived."""
        self._proximity.miss(now, others)

    def change_program(self, now: Instant, program: Program, digest: int) -> ProgramChanged:
        """Go on with another program, in the same life; tell what is kept and what ends (`program_change`).

        Raises MissingHandlers as the constructor does; then the present program goes on.
        """
        check_handlers(program, {**PROVIDED, **self._handlers})
        before = self._parts()
        started = self._started
        if started:
            before.settle(now)
        Node.__init__(self, self.config, program, self._ports, self._handlers, digest, before.state)
        if not started:
            return ProgramChanged(digest, Carried())
        self._started = True
        self.next_wake = now
        changed = take_over(now, before, self._parts(), digest)
        self._state_life(now)
        self._restarted(now)
        self._state_roster(now)
        self._presence.start(now)
        return changed

    def tick(self, now: Instant) -> None:
        """Run all that is due at `now`."""
        self.state.begin(now, self.next_wake)
        if not self._started:
            return
        self.executive.tick(now)
        if not self.state.reschedule:
            return
        executive = self.executive
        machine = self.machine
        # While something goes on that every frame matters to, each frame is due; else the robot sleeps.
        busy = self.actions.polling or (self.driver is not None and self.driver.moving)
        self.next_wake = min(
            executive.next_frame(busy) or NEVER,
            self._coordination.next_wake,
            executive.frame_ends if machine.busy or self.messenger.waiting else machine.due,
            self.actions.next_wake,
            self.messenger.next_wake,
            self.crossings.next_wake,
            self._proximity.next_wake,
        )

    def _motor(self, now: Instant) -> None:
        self.state.mark_dirty()
        if self.driver is not None:
            self.driver.step(now, self._rank, self.peers)

    def _rank(self) -> int:
        return self.crossings.rank

    def _localise(self, now: Instant) -> None:
        if self.driver is not None:
            for area in self.driver.state(now, self.senses):
                self.state.trace(now, "at", area=area.name)
        self._proximity.state(now)

    # -- what hosts ask ---------------------------------------------------------------------------------------

    def overhear(self, now: Instant, frame: Received) -> bool:
        """Take in `frame` as it arrives, if no task has to look at it; else return False: it is to wait for a call."""
        return self._started and self.messenger.overhear(now, frame)

    def awaits(self, outcome: Confirmed) -> bool:
        """Return whether `outcome` matters here: else it need not be handed over. That of no broadcast does."""
        return self._coordination.awaits(outcome)

    @property
    def now(self) -> Instant:
        """The instant of the last call."""
        return self.state.now

    def finished(self) -> bool:
        """Return whether the finish fact holds, as of the last call."""
        return self.state.finish.holds

    @property
    def finish_at(self) -> Instant | None:
        """When the finish fact held first."""
        return self.state.finish.at

    @property
    def outstanding(self) -> tuple[str, ...]:
        """What goes on or is waited for, in words; schedules, beacons and hellos do not count."""
        machine = self.machine
        checks = (
            ("a satisfied rule", not machine.quiescent),
            ("facts set aside", bool(machine.program.ensemble) and bool(machine.set_aside())),
            ("a delivery that has arrived", self.messenger.waiting),
            ("an offer of an earlier program", any(each.open for each in self.messenger.earlier.values())),
            ("a fact under way", not self.messenger.exchange.idle),
            ("a shared fact to be told", self.messenger.shared.outstanding),
            ("an action", not self.actions.idle),
            ("a deadline", machine.quiescent and machine.next_wake < NEVER),
            ("the silence of a robot", self._proximity.next_wake < NEVER),
        )
        return tuple([words for words, holds in checks if holds])

    @property
    def trace_log(self) -> list[dict[str, Any]]:
        """What the robot has noted since the host last cleared it."""
        return self.notes.entries


# ---- the executive's runtime task: rules fire and actions go on until nothing more happens at this instant
#
# What one of them does may give the other work at once: an action that ends inserts a fact, which satisfies a rule,
# which derives an action. So they run in rounds, to a fixed point, bounded by `ROUNDS_MAX`.
#
# Deliveries take effect one at a time: each in a robot in which no rule is satisfied any more. Bounds keep a robot
# responsive, and its deliveries from waiting for ever: once `FIRING_BUDGET` rules have fired in a call, those that
# are left wait for the next one, and in a robot that never becomes quiet they take effect all the same.

ROUNDS_MAX: Final = 64
"""Bound of the rounds in one call, and after each delivery: actions that end at once could repeat endlessly. The rest
waits for a frame."""


class RuntimeSystem:
    """Runs one robot's program, actions, crossings and coordination."""

    def __init__(
        self,
        state: RobotState,
        runner: MachineRunner,
        actions: Dispatcher,
        crossings: Crossings,
        coordination: CoordLink,
        messenger: Messenger,
    ) -> None:
        self._state = state
        self._machine = state.machine
        self._runner = runner
        self._actions = actions
        self._crossings = crossings
        self._coordination = coordination
        self._messenger = messenger

    def run(self, now: Instant) -> None:
        """Do what is to be done at `now`. Where others have only said where they are, that is nothing."""
        state = self._state
        if not (state.dirty or state.due or self._unforeseen(now)):
            return
        state.dirty = False
        state.reschedule = True
        self._rounds(now)
        self._runner.watch_quiescence(now)
        if self._messenger.shared.used:
            self._messenger.shared.look(now)
        if state.finish.update(now):
            state.trace(now, "finished")

    def _unforeseen(self, now: Instant) -> bool:
        """Return whether there is something to do that was not foreseen at the end of the last call."""
        machine = self._machine
        return machine.busy or self._messenger.waiting or self._coordination.due(now) or self._actions.released(now)

    def _rounds(self, now: Instant) -> None:
        """Do what is due, then let the deliveries that have arrived take effect, each when all is done before it."""
        messenger = self._messenger
        while messenger.waiting and self._runner.restless:
            messenger.take_up(now)
        machine = self._machine
        firings_max = machine.firings + FIRING_BUDGET
        rounds = 0
        more = machine.busy
        while rounds < ROUNDS_MAX:
            if not more and messenger.waiting:
                messenger.take_up(now)
                rounds = 0
            more = self._round(now)
            rounds += 1
            if not more and (not messenger.waiting or machine.busy or machine.firings >= firings_max):
                break

    def _round(self, now: Instant) -> bool:
        """Let each part do once what is due; return whether that has left more to do."""
        # A deadline at `now` is not missed before all deliveries of this instant have taken effect.
        last = not self._messenger.waiting
        machine = self._machine
        actions = self._actions
        self._coordinate(now)
        if machine.has_due(now):
            if machine.due == now:
                actions.resume(now)  # what ends at the very instant of a deadline is in time
            self._runner.run(now, last)
        actions.step(now)
        self._crossings.step(now)
        # Again, since actions and crossings have asked for slots: what the core says to that leaves in this call.
        self._coordinate(now)
        self._messenger.flush(now)
        more = machine.has_due(now) and (self._runner.settle(now) or self._runner.due(now, last))
        return more or actions.released(now)

    def _coordinate(self, now: Instant) -> None:
        if self._coordination.due(now):
            self._coordination.run(now)
