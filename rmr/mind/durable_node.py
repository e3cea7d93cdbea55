"""A node whose process may die at any instant and be started again: it goes on as if it had been stopped meanwhile.

What the node is given is logged (`recorded_node`), and the log is on disk (`journal`) before anything that comes of it
leaves: frames and wheel commands of a call are held until its record is written. A node is a function of its inputs, so
executing it anew with the logged inputs (`mind_replay` shows them equal) gives the very state that it died in, with its
place in a passage, its jobs and deadlines, and the numbers of its deliveries.

    begin    the header is written, then each call runs, is recorded, and lets go what it has held
    bring    the recorded calls run with inputs from the journal; what they send goes nowhere
    resume   a mark is written; actions of users that were under way are interrupted (`durable_actions`)

A *shadow* is a node that is brought back to the end of a segment of the journal, beside the robot, and not to go on:
its state is the snapshot there (`snapshot`).

What had left before the death, or was about to, is not sent at the resumption: to the others the robot was silent for a
while. Deliveries without acknowledgement are repeated with their numbers, as after any silence, and receivers drop what
they have. Frames whose outcome the radio still owed are taken for lost.

Inputs of which nothing has come yet wait in memory, up to a second: if the robot dies before anything leaves, it is as
if they had never arrived. Facts inserted from outside and steps of users' handlers are written with their call.

This module is compiled where a build is, as `RecordedNode` is.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final

from rmr.base.geometry import Pose, Twist
from rmr.base.time import NEVER, Duration, Instant, in_seconds
from rmr.base.values import Value
from rmr.bytecode.program import Program
from rmr.mind import mind_format as form
from rmr.mind.durable_actions import DurableActions
from rmr.mind.graph_restoration import GeneratedFunctions, GraphMismatchError
from rmr.mind.journal import CALLS, HEADER, RESUMED, Journal, JournalError, JournalRecord
from rmr.mind.mind_reader import MindCall, MindLogError, calls_of
from rmr.mind.mind_versions import is_compiled
from rmr.mind.object_graph import Skeleton
from rmr.mind.recorded_node import RecordedNode
from rmr.mind.replay_feed import ReplayFeed
from rmr.node.actions.dispatcher import Handler
from rmr.node.config import NodeConfig
from rmr.node.crossing.coordination_link import UNCONFIRMED_MAX
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.ports import Confirmed, Ports, Received, Sensed
from rmr.vm.shared import Shared

Witness = Callable[[int, Instant, object], None]
OPAQUE: Final = (Program, NodeConfig, Shared, RuleSwitches)
"""What never changes, is derived from the program alone, or is shared with other robots: no part of a node's state."""


class DurableNode(RecordedNode):
    """One robot whose state is on disk."""

    def __init__(
        self,
        config: NodeConfig,
        program: Program,
        ports: Ports,
        handlers: Mapping[str, Handler],
        digest: int,
        journal: Journal,
        stored: Sequence[JournalRecord] = (),
        noted: bool = False,
        snapshot: bytes | None = None,
        shadow: Callable[[Skeleton], None] | None = None,
    ) -> None:
        """`stored` are the records of the robot's journal, if it goes on; `config` is then that of its header.

        `noted` says whether entries of the trace are logged; of a robot that goes on its header says it. `snapshot` is
        the state before these records, if the journal did not begin with them. A shadow calls `shadow` with its
        skeleton.

        Raises JournalError if the robot cannot go on from these records.
        """
        self._journal = journal
        self._feed = feed = ReplayFeed(ports.link.payload_max)
        self._gate = gate = PortGate(ports, feed)
        self._seen: Witness | None = config.witness
        self._durable = durable = DurableActions(program, feed)
        self._durable_base: Instant = 0
        """Instant of the call before the first one that is not written."""
        self.resumed = 0
        """How often the robot has been started again."""
        self._began = False
        self.brought_back = False
        """Whether it goes on from what an earlier process did."""
        self._broken = False
        """The journal cannot be written: nothing leaves any more."""
        if config.witness is not None:
            config = replace(config, witness=self._witnessed)
        gated = Ports(
            gate,
            None if ports.body is None else gate,
            None if ports.spent is None else gate.spent,
            None if ports.neighbors is None else gate.neighbors,
        )
        super().__init__(config, program, gated, durable.handlers(handlers), digest, None, noted)
        feed.log = self.log
        durable.join(self.log, self.commit)
        if snapshot is not None or shadow is not None:
            skeleton = self._skeleton([handlers[name].run for name in sorted(handlers)])
            if snapshot is not None:
                self._restore(skeleton, snapshot)
            if shadow is not None:
                shadow(skeleton)
        if snapshot is not None or len(stored) > 1:
            self._bring(stored)
        else:
            self._go_live()

    def _skeleton(self, runs: list[object]) -> Skeleton:
        """Return the skeleton of the node, which has just been made; of its host and the handlers' `runs` nothing."""
        return Skeleton(
            self, [self._gate.host, self._journal, self._seen, *runs], OPAQUE, GeneratedFunctions(self.machine)
        )

    @staticmethod
    def _restore(skeleton: Skeleton, snapshot: bytes) -> None:
        if is_compiled():  # an object of a compiled class is never made without its constructor
            raise JournalError("its snapshot was taken by an rmr that is not compiled; set RMR_COMPILED= to go on")
        try:
            skeleton.restore(snapshot)
        except GraphMismatchError as error:
            raise JournalError(f"its snapshot does not fit: {error}") from None

    # -- bringing back --------------------------------------------------------------------------------------------

    def _bring(self, stored: Sequence[JournalRecord]) -> None:
        """Execute what is recorded. Raises JournalError where it does not come out as recorded."""
        octets: list[bytes] = []
        base: Instant = 0
        for record in stored:
            if record.kind == HEADER:
                continue
            if record.kind == RESUMED:
                self._again(octets, base)
                octets = []
                self._mark()
                continue
            assert record.kind == CALLS
            if not octets:
                base = record.base
            octets.append(record.octets)
        self._again(octets, base)
        self.settle()
        self.brought_back = self._began = self._started
        if not self._began:
            self._go_live()

    def settle(self) -> None:
        """Forget the inputs of the last call, and the entries of the trace, which its host has had."""
        self.notes.entries.clear()
        self._feed.begin([])

    def _again(self, octets: list[bytes], base: Instant) -> None:
        """Execute the calls between two starts of the process; the last may have been broken off."""
        try:
            calls = calls_of(b"".join(octets), base)
        except MindLogError as error:
            raise JournalError(str(error)) from None
        last = len(calls) - 1
        for number, call in enumerate(calls):
            self._feed.begin(call.inputs())
            with suppress(Exception):  # the log of the replay has it, and is compared
                self._carry_out(call)
            found = self.log.take()
            if found != call.octets and not (number == last and found.startswith(call.octets)):
                raise JournalError(
                    f"what the robot did at {in_seconds(call.at):.3f} s of lab time does not come out again: "
                    "something that it depends on has changed, or rmr has a defect; begin anew with an empty state"
                )
        self._durable_base = self.log.base

    def _carry_out(self, call: MindCall) -> None:
        if call.kind == form.TICK:
            RecordedNode.tick(self, call.at)
        elif call.kind == form.OVERHEAR:
            RecordedNode.overhear(self, call.at, self._feed.offer())
        elif call.kind == form.START:
            RecordedNode.start(self, call.at)
        else:
            name, args = self._feed.take(form.FACT)
            RecordedNode.insert(self, call.at, name, args)

    def _mark(self) -> None:
        """Let the process have died here."""
        self.resumed += 1
        self._inside = False
        self._durable.interrupt(self.actions.running)
        self.state.mark_dirty()
        self.next_wake = 0

    def _go_live(self) -> None:
        self._gate.live = True
        self._durable.go_live(self.services.state)
        handles = self._gate.handles
        outcomes = [Confirmed(handle, "no_ack") for handle in handles[-UNCONFIRMED_MAX:]]
        self._gate.unanswered = [outcome for outcome in outcomes if self.awaits(outcome)]
        handles.clear()

    def _witnessed(self, robot: int, now: Instant, event: object) -> None:
        """Pass an event on, but of one that is done again only insert the facts that were inserted in answer to it."""
        if self._gate.live:
            assert self._seen is not None
            self._seen(robot, now, event)
            return
        while (fact := self._feed.nested(self.events)) is not None:
            with suppress(ValueError):
                self.insert(now, *fact)

    # -- the calls of the host ------------------------------------------------------------------------------------

    def start(self, now: Instant) -> None:
        """Begin; or go on, if the robot was brought back."""
        if self._began:
            self._began = False
            self._journal.resumed(self.log.base)
            self._mark()
            self._go_live()
            return
        self._durable_base = now
        super().start(now)
        self.commit()

    def tick(self, now: Instant) -> None:
        """Run all that is due at `now`, and let what comes of it leave once it is recorded."""
        if now >= self._second:
            self.commit()
        super().tick(now)
        if self._durable.acted or self._gate.holds:
            self.commit()

    def overhear(self, now: Instant, frame: Received) -> bool:
        """Take in `frame` as it arrives, if no task has to look at it."""
        if now >= self._second:
            self.commit()
        return super().overhear(now, frame)

    def insert(self, now: Instant, name: str, args: Sequence[Value]) -> None:
        """Insert a fact of this robot from outside; it is recorded at once."""
        if self._inside:
            super().insert(now, name, args)
            return
        if now >= self._second:
            self.commit()
        super().insert(now, name, args)
        self.commit()

    def commit(self) -> None:
        """Write what has been logged, then let go what is held. Raises OSError; then nothing has left."""
        octets = self.log.take()
        if self._broken:
            return
        if octets:
            try:
                self._journal.calls(self._durable_base, octets)
            except OSError:
                self._broken = True
                raise
            self._durable_base = self.log.base
        if not self._inside:
            self._durable.acted = False
            self._gate.release()
            if self._journal.full:
                self._next_segment()

    def _next_segment(self) -> None:
        try:
            self._journal.next_segment()
        except OSError:
            self._broken = True
            raise

    def next_record(self) -> bytes:
        """Return the record that would be written next, empty if there is nothing to write; the node is over then."""
        octets = self.log.take()
        return self._journal.next_calls(self._durable_base, octets) if octets else b""

    def end_log(self) -> None:
        """Write what is left: the node is not called any more."""
        if not self.log.closed:
            self.commit()
            self.log.closed = True


# ---- the ports of a durable robot's node (`durable_node`): inputs from journal or host, outputs held until recorded
#
# This module is compiled where a build is, as `DurableNode` is.


class HeldFrame:
    """A frame that leaves when the call is recorded."""

    def __init__(self, payload: bytes, destination: int | None, handle: int, due: Instant) -> None:
        self.payload = payload
        self.destination = destination
        self.handle = handle
        self.due = due


class PortGate:
    """The node's ports: from the journal while the node is brought back, then the host's, with outputs held."""

    def __init__(self, ports: Ports, feed: ReplayFeed) -> None:
        self.host = ports
        """The host's ports."""
        self._feed = feed
        self.live = False
        self.frames: list[HeldFrame] = []
        """What the present call sends."""
        self.twist: Twist | None = None
        """The wheel command of the present call, the last one."""
        self._stamp: Instant = 0
        self.handles: list[int] = []
        """The newest frames of the node that is brought back, whose outcomes may be awaited."""
        self.unanswered: list[Confirmed] = []
        """Outcomes that the radio did not live to tell."""

    @property
    def holds(self) -> bool:
        """Whether something waits to leave."""
        return bool(self.frames) or self.twist is not None

    def release(self) -> None:
        """Let go what is held."""
        frames = self.frames
        if frames:
            self.frames = []
            for frame in frames:
                self.host.link.transmit(frame.payload, frame.destination, frame.handle, frame.due)
        twist = self.twist
        body = self.host.body
        if twist is not None and body is not None:
            self.twist = None
            body.act(twist, self._stamp)

    # -- ports --------------------------------------------------------------------------------------------------

    @property
    def payload_max(self) -> int:
        """Octets of payload that a frame holds."""
        return self.host.link.payload_max

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Hold a frame."""
        if self.live:
            self.frames.append(HeldFrame(payload, destination, handle, due))
            return
        self.handles.append(handle)
        if len(self.handles) > 2 * UNCONFIRMED_MAX:
            del self.handles[:UNCONFIRMED_MAX]

    def receive(self) -> list[Received]:
        """Return what has arrived."""
        return self.host.link.receive() if self.live else self._feed.receive()

    def confirmations(self) -> list[Confirmed]:
        """Return the outcomes that have become known."""
        if not self.live:
            return self._feed.confirmations()
        if self.unanswered:
            outcomes = self.unanswered
            self.unanswered = []
            return outcomes + self.host.link.confirmations()
        return self.host.link.confirmations()

    def sense(self) -> list[Sensed]:
        """Return the new samples."""
        if not self.live:
            return self._feed.sense()
        return [] if self.host.body is None else self.host.body.sense()

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Hold a wheel command; a later one of the same call takes its place."""
        if self.live:
            self.twist = twist
            self._stamp = stamp

    def head(self, serial: int, target: Pose | None, stamp: Instant) -> None:
        """Let another one drive."""
        if self.live and self.host.body is not None:
            self.host.body.head(serial, target, stamp)

    def spent(self) -> Duration:
        """Return the processor time of the present call."""
        if not self.live:
            return self._feed.spent()
        return 0 if self.host.spent is None else self.host.spent()

    def neighbors(self) -> Sequence[tuple[int, float]]:
        """Return who is in range."""
        if not self.live:
            return self._feed.neighbors()
        neighbors = self.host.neighbors
        assert neighbors is not None
        return neighbors()
