"""What all parts of one robot share: its configuration, its program at work, its body, what it knows of the others.

`RobotState` lies below the parts: it calls none of them. It also says what one call of the node knows of itself: the
instant, how old its input may be, what is still to be done.
"""

from typing import Any, NamedTuple

from rmr.base.streams import Choices
from rmr.base.time import Instant, milliseconds
from rmr.bytecode.program import Anything, Program
from rmr.node.actions.action_log import ActionBegun, ActionEnded, ActionLog
from rmr.node.config import FinishPattern, NodeConfig
from rmr.node.driver import Driver
from rmr.node.logic.sensed_facts import SensedFacts
from rmr.node.peers.link_sensing import ROBOTS_MAX, LinkSensing
from rmr.node.peers.perception import Peers
from rmr.node.ports import BodyPort
from rmr.node.trace import Trace, TraceLevel
from rmr.vm.engines import new_machine
from rmr.vm.machine import Machine


class ProgramBegun(NamedTuple):
    """The numbers in the provenance log are those of this program from here on."""

    program: Program


class RobotState:
    """One robot."""

    def __init__(
        self,
        config: NodeConfig,
        program: Program,
        body: BodyPort | None,
        digest: int,
        before: "RobotState | None" = None,
    ) -> None:
        """`before` is the state under another program, of which the robot keeps all that no program knows."""
        self.config = config
        self.robot = config.robot
        self.program = program
        self.digest = digest & 0xFFFF
        """Identity of the program in frames."""
        self.changes: int = 0 if before is None else before.changes + 1
        """How often the robot has changed its program in this life."""
        self.notes: Trace = Trace(config.robot, config.trace) if before is None else before.notes
        self.action_log: ActionLog = ActionLog() if before is None else before.action_log
        choices = Choices(f"{config.seed}/robot{config.robot}/vm" + (f"/{self.changes}" if self.changes else ""))
        traced = config.trace is TraceLevel.FACTS
        self.machine = new_machine(
            program, config.robot, choices, engine=config.engine, trace=traced, log=config.provenance
        )
        self.senses = SensedFacts(program, self.machine)
        self.finish = FinishFact(config.finish, program, self.machine, self.senses)
        self.peers: Peers = Peers(_links(config)) if before is None else before.peers
        self.driver: Driver | None = None if body is None else Driver(config, body)
        """None: a robot without a body."""
        self.now: Instant = 0
        """The instant of the present call of the node."""
        if before is not None:
            self.now = before.now
            if config.provenance is not None:
                config.provenance.told(self.now, ProgramBegun(program))
            self.finish.at = before.finish.at
            if self.driver is not None and before.driver is not None:
                self.driver.follow(before.driver)
        self.heard_at: Instant = 0
        """Lower bound of when the frames arrived that are handled in this call."""
        self.due = True
        """Whether the node itself asked for this call; else the host had input for it."""
        self.dirty = True
        """Whether rules, actions or crossings have something to look at in this call."""
        self.reschedule = True
        """Whether this call may have changed when the robot is due next; hellos of others alone do not."""

    def begin(self, now: Instant, next_wake: Instant) -> None:
        """Begin a call at `now`; `next_wake` is when the node wanted to be called."""
        self.heard_at = self.now if self.suspended(now) else now
        self.now = now
        self.due = now >= next_wake
        self.reschedule = self.due

    def suspended(self, now: Instant) -> bool:
        """Return whether a call at `now` would come after a suspension of the host."""
        # Time without a call after which the host counts as suspended: input may then be as old as the previous call.
        return now - self.now > milliseconds(150)

    def mark_dirty(self) -> None:
        """Have rules, actions and crossings looked at in this call."""
        self.dirty = True

    def trace(self, now: Instant, what: str, **fields: Any) -> None:
        """Record an entry of the trace (`rmr.node.trace`)."""
        self.notes.note(now, what, **fields)

    def tell(self, event: object) -> None:
        """Report `event`: to the checkers of the run and the provenance log, of actions to report and trace as well."""
        if isinstance(event, ActionBegun):
            self.action_log.begun(self.now, event)
            self.trace(self.now, "action", action=event.action)
        elif isinstance(event, ActionEnded):
            self.action_log.ended(self.now, event)
            self.trace(self.now, "action_ended", action=event.action, failure=event.failure)
        if self.config.witness is not None:
            self.config.witness(self.robot, self.now, event)
        if self.config.provenance is not None:
            self.config.provenance.told(self.now, event)


def _links(config: NodeConfig) -> LinkSensing | None:
    """Return the sensing of links; None where the radio does not reach over the floor, or the robots are too many."""
    if not config.reaches_all or len(config.roster) > ROBOTS_MAX:
        return None
    crowd = config.profile.promises_to_stay
    return LinkSensing(config.robot, config.roster, crowd=crowd, begins_late=config.epoch > 0)


# ---- whether the lab's finish fact holds for a robot, which ends its part of the run


class FinishFact:
    """Watches one robot's finish fact."""

    def __init__(self, pattern: FinishPattern | None, program: Program, machine: Machine, senses: SensedFacts) -> None:
        self._pattern = pattern
        self._index = None if pattern is None else program.index(pattern[0])
        self._machine = machine
        self._senses = senses
        self._looked: Instant = 0
        self.holds = False
        """As of the last call of the runtime system."""
        self.at: Instant | None = None
        """When it held first."""

    def update(self, now: Instant) -> bool:
        """Look again if facts may have changed; return whether the finish fact holds for the first time."""
        # Neither the machine nor the senses have changed a fact since: nothing to search.
        if self._looked <= self._machine.called_at or self._looked <= self._senses.changed:
            self._looked = now
            self.holds = self._search()
        if self.at is not None or not self.holds:
            return False
        self.at = now
        return True

    def _search(self) -> bool:
        if self._pattern is None:
            return False
        name, patterns = self._pattern
        for args in self._senses.of(name):
            if all(isinstance(p, Anything) or p.value == a for p, a in zip(patterns, args, strict=False)):
                return True
        return self._index is not None and self._machine.holds(self._index, patterns)
