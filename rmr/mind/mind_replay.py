"""Executes a mind anew from its log, and compares what it does with what is in the log.

The node of the replay is a `RecordedNode`, too: it writes a log of its own, whose operations must be those of the
recorded log, octet for octet. Its ports give it what the log holds: the inputs of the present call, one after the
other. So the first operation that differs is named with both values.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

from rmr.base.time import NEVER, Instant
from rmr.bytecode import codec
from rmr.bytecode.program import Program
from rmr.mind import mind_format as form
from rmr.mind.mind_header import MindHeader, decode_header
from rmr.mind.mind_reader import Batch, LoggedOperation, MindCall, MindLogError, operations_of, read_batch
from rmr.mind.recorded_node import RecordedNode
from rmr.mind.replay_feed import ReplayFeed
from rmr.mind.replayed_actions import replayed_handlers
from rmr.node.node import Node
from rmr.node.ports import Ports
from rmr.node.trace import EVENTS, TraceLevel
from rmr.vm.engines import Engine
from rmr.vm.provenance import ProvenanceLog

Witness = Callable[[int, Instant, object], None]


@dataclass(frozen=True, slots=True)
class MindDifference:
    """The first operation in which a replay differs from its log."""

    at: Instant
    """Instant of the call."""
    what: str
    """Kind of the operation."""
    recorded: str
    """As the log has it; "nothing" if it has none."""
    replayed: str
    """As the replay has it; "nothing" if it has none."""


class MindReplay:
    """The replay of one incarnation."""

    def __init__(
        self,
        log: Iterable[bytes],
        program: Program,
        *,
        engine: Engine | None = None,
        trace: TraceLevel = TraceLevel.NOTES,
        witness: Witness | None = None,
        provenance: ProvenanceLog | None = None,
        one_program: bool = False,
        since: Instant = 0,
    ) -> None:
        """`log` are the batches of one incarnation, from its first on; they are read as the replay goes on.

        More of them can be given by `feed`. `engine` is that of the recording unless another is given; all do the
        same; with a log of `provenance` it is the interpreter. The numbers in that log are those of the program that
        runs, and `ProgramBegun` tells where another begins; with `one_program` the replay ends before it does. Calls
        before `since` are carried out, but neither compared nor counted. Raises MindLogError if the log has no
        beginning.
        """
        self._since = since
        self._one_program = one_program
        self.changed_at: Instant | None = None
        """The change of the program before which the replay has ended."""
        self._log = iter(log)
        self._fed: deque[bytes] = deque()
        self._number = 0
        """Number of the next batch."""
        first = self._next_batch()
        if first is None or not first.header:
            raise MindLogError("its beginning is missing")
        self.header: Final[MindHeader] = _header(first.header)
        self.robot: Final = self.header.config.robot
        self.epoch: Final = self.header.config.epoch
        self._feed = ReplayFeed(self.header.payload_max)
        self._witness = witness
        node = self._make_node(program, engine, trace, witness, provenance)
        self._recorded = node
        self._own_log = self._feed.log = node.log
        self.node: Final[Node] = node
        self.now: Instant = 0
        """Instant of the last call."""
        self.began: Instant | None = None
        """Instant of the first call that is compared."""
        self.difference: MindDifference | None = None
        """The first one, if there is any."""
        self.inputs = 0
        """Calls, frames, outcomes, samples and other inputs so far."""
        self.outputs = 0
        """Frames, wheel commands and entries of the trace so far."""
        self.not_delivered = (0, 0, 0)
        """Samples and frames that the host dropped, and frames that it refused, so far."""
        self.ended = False
        """Whether the log has ended in good order."""
        self._calls: list[MindCall] = []
        self._place = 0
        self._end: tuple[int, int, int] | None = None
        self._open(first)

    def _make_node(
        self,
        program: Program,
        engine: Engine | None,
        trace: TraceLevel,
        witness: Witness | None,
        provenance: ProvenanceLog | None,
    ) -> RecordedNode:
        header = self.header
        feed = self._feed
        # The entries that the log has are made even if nobody wants the trace: they are compared.
        trace = max(trace, min(header.config.trace, TraceLevel.NOTES))
        told = self._told if header.witnessed else witness
        config = replace(header.config, trace=trace, witness=told, engine=engine or header.config.engine)
        config = replace(config, provenance=provenance)
        ports = Ports(
            feed,
            feed if header.bodily else None,
            feed.spent if header.timed else None,
            feed.neighbors if header.neighbors else None,
        )
        noted = header.config.trace > TraceLevel.NOTHING
        return RecordedNode(
            config, program, ports, replayed_handlers(header.actions, feed), header.program, None, noted
        )

    def _told(self, robot: int, now: Instant, event: object) -> None:
        """Tell the witness what has happened, and insert the facts that were inserted in answer to it."""
        if self._witness is not None:
            self._witness(robot, now, event)
        node = self._recorded
        while (fact := self._feed.nested(node.events)) is not None:
            with suppress(ValueError):
                node.insert(now, *fact)

    def feed(self, batch: bytes) -> None:
        """Add the next batch of the log."""
        self._fed.append(batch)

    def _next_batch(self) -> Batch | None:
        """Return the next batch; None if there is none yet. Raises MindLogError for one that is damaged or missing."""
        data = self._fed.popleft() if self._fed else next(self._log, None)
        if data is None:
            return None
        batch = read_batch(data)
        if batch.number != self._number:
            first = self._number
            if first == 0:
                raise MindLogError("its beginning is missing")
            if batch.number == first + 1:
                raise MindLogError(f"batch {first} of its log is missing")
            raise MindLogError(f"batches {first} to {batch.number - 1} of its log are missing")
        self._number += 1
        return batch

    def _open(self, batch: Batch) -> None:
        self._calls = batch.calls
        self._place = 0
        self._own_log.rebase(batch.base)
        self._end = batch.end
        if batch.not_delivered is not None:
            self.not_delivered = batch.not_delivered

    @property
    def next_call(self) -> Instant | None:
        """The instant of the next call; None if the log has no more, yet. Raises MindLogError where it is damaged."""
        while self._place >= len(self._calls):
            self._check_end()
            batch = self._next_batch()
            if batch is None:
                return None
            self._open(batch)
        call = self._calls[self._place]
        if call.kind == form.CHANGE and self._one_program:
            self.changed_at = call.at
            return None
        return call.at

    def _check_end(self) -> None:
        """Compare the last digest, once all calls before it are carried out."""
        if self._end is None or self.ended:
            return
        self.ended = True
        found = self._own_log.digests(self._recorded.state_octets())
        if found != self._end and self.difference is None and self._since <= self.now:
            self.difference = _digests_compared(self.now, self._end, found)

    def step(self) -> bool:
        """Carry out the next call; return whether there was one. Raises MindLogError where the log is damaged."""
        if self.next_call is None:
            return False
        call = self._calls[self._place]
        self._place += 1
        base = self._own_log.base
        self.now = call.at
        if _interrupted(call):
            self._since = NEVER
            return True
        if self.began is None and call.at >= self._since:
            self.began = call.at
        self._carry_out(call)
        octets = self._own_log.take()
        if call.at < self._since:
            return True
        self._count(call)
        if octets != call.octets and self.difference is None:
            self.difference = compared(call, operations_of(octets, base))
        return True

    def run(self, until: Instant = NEVER) -> Iterator[Instant]:
        """Carry out all calls up to `until`; yield the instant of each when it is over."""
        while (at := self.next_call) is not None and at <= until:
            self.step()
            yield at

    def _carry_out(self, call: MindCall) -> None:
        node = self.node
        feed = self._feed
        feed.begin(call.inputs())
        with suppress(Exception):  # the log of the replay has it, and is compared
            if call.kind == form.TICK:
                node.tick(call.at)
            elif call.kind == form.OVERHEAR:
                node.overhear(call.at, feed.offer())
            elif call.kind == form.START:
                node.start(call.at)
            elif call.kind == form.CHANGE:
                digest, octets = feed.take(form.PROGRAM)
                node.change_program(call.at, codec.decode(octets), digest)
            else:
                name, args = feed.take(form.FACT)
                node.insert(call.at, name, args)

    def _count(self, call: MindCall) -> None:
        self.inputs += 1
        for operation in call.operations:
            if operation.kind in (form.RECEIVED, form.CONFIRMED, form.SENSED):
                value = operation.value
                self.inputs += len(value[1]) + value[0] if operation.kind == form.RECEIVED else len(value)
            elif operation.kind < form.TRANSMIT:
                self.inputs += 1
            elif operation.kind in (form.TRANSMIT, form.ACT, form.NOTE):
                self.outputs += 1


def _interrupted(call: MindCall) -> bool:
    """Return whether Ctrl-C broke the call off: what came of it, and of all after it, cannot be known."""
    last = call.operations[-1:]
    return any(each.kind == form.RAISED and each.value.startswith("KeyboardInterrupt") for each in last)


def _header(data: bytes) -> MindHeader:
    try:
        return decode_header(data)
    except ValueError as error:
        raise MindLogError(str(error)) from None


NAMES: Final = {
    form.START: "start",
    form.TICK: "tick",
    form.OVERHEAR: "overhear",
    form.INSERT: "insert",
    form.CHANGE: "change of program",
    form.OFFERED: "frame overheard",
    form.FACT: "fact inserted",
    form.PROGRAM: "program",
    form.RECEIVED: "frames received",
    form.CONFIRMED: "outcomes",
    form.SENSED: "samples",
    form.OVERRUN: "time used up",
    form.NEIGHBORS: "neighbors",
    form.ACTED: "step of a handler",
    form.NESTED: "fact inserted within",
    form.TRANSMIT: "frame sent",
    form.ACT: "wheel command",
    form.NOTE: "trace",
    form.TAKEN: "frame taken in at once",
    form.RAISED: "exception",
    form.DIGEST: "digest",
}
"""Kinds of operations in words."""


DIGESTS: Final = ("outputs", "inputs and outputs", "state")
"""Of what the numbers of a digest are."""


def compared(recorded: MindCall, replayed: MindCall) -> MindDifference:
    """Return the first difference of two calls that are not equal."""
    pairs = zip(recorded.operations, replayed.operations, strict=False)
    place = next((i for i, (one, other) in enumerate(pairs) if one.octets != other.octets), None)
    if place is None:
        place = min(len(recorded.operations), len(replayed.operations))
    one = recorded.operations[place] if place < len(recorded.operations) else None
    other = replayed.operations[place] if place < len(replayed.operations) else None
    if one is not None and other is not None and one.kind == other.kind == form.DIGEST:
        return _digests_compared(recorded.at, one.value, other.value)
    kinds = [NAMES[each.kind] for each in (one, other) if each is not None]
    what = " / ".join(dict.fromkeys(kinds)) or NAMES[recorded.kind]
    return MindDifference(recorded.at, what, _shown(one), _shown(other))


def _digests_compared(at: Instant, recorded: Sequence[int], replayed: Sequence[int]) -> MindDifference:
    parts = [part for part, then, now in zip(DIGESTS, recorded, replayed, strict=True) if then != now]
    what = f"digest of the time before: {', '.join(parts)}"
    return MindDifference(at, what, _digests_shown(recorded), _digests_shown(replayed))


def _digests_shown(digests: Sequence[int]) -> str:
    return ", ".join(f"{part} {crc:08x}" for part, crc in zip(DIGESTS, digests, strict=True))


def _shown(operation: LoggedOperation | None) -> str:
    if operation is None:
        return "nothing"
    value = operation.value
    match operation.kind:
        case form.TRANSMIT:
            to, handle, payload = value
            return (
                f"{len(payload)} octets to {'all' if to is None else f'robot {to}'} (handle {handle}): {payload.hex()}"
            )
        case form.ACT:
            return f"{value[0]!r} m/s, {value[1]!r} rad/s"
        case form.NOTE:
            word, crc = value
            return f"{list(EVENTS)[word]} (check sum {crc:08x})"
        case form.DIGEST:
            return _digests_shown(value)
        case form.TAKEN:
            return "taken in"
        case _:
            return f"{NAMES[operation.kind]} {value!r}"[:200]
