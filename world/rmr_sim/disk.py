"""The disk of a simulated durable robot, which does what a real one does at a crash.

What was written survives the end of the process, and what was synced a loss of power, too. The record that was being
written when the robot died is torn: a part of its octets is there, drawn from the stream ``SEED/robotN/disk``.

When a segment of the journal is closed, a snapshot is taken at once (`rmr.mind.snapshot`), where rmr is not compiled.
Of seven one is not taken, and one is torn, as if what takes it had died: drawn from ``SEED/robotN/snapshots``.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from rmr.base.streams import stream
from rmr.bytecode.program import Program
from rmr.mind.durable_node import DurableNode
from rmr.mind.journal import SEGMENT_OCTETS, Journal, JournalHeader
from rmr.mind.mind_header import decode_header, encode_header
from rmr.mind.mind_versions import is_compiled
from rmr.mind.segments import FoundState, find_state, superfluous
from rmr.mind.snapshot import Snapshot, taken_snapshot
from rmr.node.actions.dispatcher import Handler
from rmr.node.config import NodeConfig
from rmr.node.node import Node
from rmr.node.ports import Ports

SNAPSHOT_KEY = b"simulated"
"""Key of simulated snapshots, which never leave their process."""


class Disk:
    """One robot's disk (`rmr.mind.journal.JournalFile`)."""

    def __init__(self, seed: int, robot: int, segment_octets: int = SEGMENT_OCTETS) -> None:
        """A segment of the journal is closed at `segment_octets`."""
        self._rng = stream(f"{seed}/robot{robot}/disk")
        self._fates = stream(f"{seed}/robot{robot}/snapshots")
        self.segment_octets = segment_octets
        self.data = b""
        """What a crash has left of the last segment."""
        self.number = 0
        """Number of the last segment."""
        self.closed: dict[int, bytes] = {}
        """The segments before it."""
        self.snapshots: dict[int, bytes] = {}
        """By the segments before which they are."""
        self.from_snapshots = 0
        """How often the robot has gone on from a snapshot."""
        self.passed_over = 0
        """Snapshots that were damaged when the robot went on."""
        self.take: Callable[[FoundState, int], Snapshot] | None = None
        """Takes the snapshot behind a state, before a segment."""
        self._chunks: list[bytes] = []
        self._written = 0
        self._synced = 0

    def append(self, data: bytes) -> None:
        """Write `data` at the end."""
        self._chunks.append(data)
        self._written += len(data)

    def sync(self) -> None:
        """Let what was written survive a loss of power."""
        self._synced = self._written

    def end(self, node: Node) -> None:
        """End the process of the robot's `node` while it writes its next record."""
        if isinstance(node, DurableNode):
            self.crash(node.next_record())

    def crash(self, record: bytes, *, power: bool = False) -> None:
        """End the process while it writes `record`; with `power` what was not synced is lost, too."""
        whole = b"".join([self.data, *self._chunks])
        if power:
            whole, record = whole[: self._synced], whole[self._synced :] + record
        self.data = whole + record[: self._rng.randrange(len(record))] if record else whole
        self._chunks = []
        self._written = len(self.data)
        self._synced = min(self._synced, self._written)

    def keep(self, found: FoundState) -> None:
        """Keep what could be read: so many octets of the last segment, and nothing behind it."""
        segments = self.segments
        self.from_snapshots += found.snapshot is not None
        self.passed_over += len(found.passed_over)
        self.number = found.last
        self.data = segments.get(found.last, b"")[: found.whole]
        self.closed = {number: data for number, data in segments.items() if number < found.last}
        self.snapshots = {number: data for number, data in self.snapshots.items() if number <= found.last}
        for number, _ in found.passed_over:
            self.snapshots.pop(number, None)
        self._chunks = []
        self._written = self._synced = len(self.data)

    @property
    def segments(self) -> dict[int, bytes]:
        """All segments."""
        last = b"".join([self.data, *self._chunks])
        return {**self.closed, self.number: last} if last else dict(self.closed)

    def begin_segment(self, number: int, data: bytes) -> None:
        """Close the segment, and begin another one; take the snapshot before that, unless the draw is against it."""
        self.closed = self.segments
        fate = self._fates.randrange(7)
        if self.take is not None and fate:
            octets = self.take(find_state(self.closed, self.snapshots, SNAPSHOT_KEY), number).octets(SNAPSHOT_KEY)
            self.snapshots[number] = octets if fate > 1 else octets[: self._fates.randrange(len(octets))]
            segments, snapshots = superfluous(self.closed, self.snapshots, SNAPSHOT_KEY)
            self.closed = {each: data for each, data in self.closed.items() if each not in segments}
            self.snapshots = {each: data for each, data in self.snapshots.items() if each not in snapshots}
        self.number = number
        self.data = b""
        self._chunks = [data]
        self._written = self._synced = len(data)


def durable_node(
    disk: Disk,
    config: NodeConfig,
    program: Program,
    ports: Ports,
    handlers: Mapping[str, Handler],
    digest: int,
    *,
    synced: bool = False,
) -> DurableNode:
    """Return the node of a robot that goes on from its `disk`, or begins if that is empty."""
    found = find_state(disk.segments, disk.snapshots, SNAPSHOT_KEY)
    disk.keep(found)
    header = found.header
    disk.take = None if is_compiled() else partial(_taken, program)
    journal = Journal(
        disk,
        synced=synced,
        crc=found.crc,
        header=header,
        filled=found.whole,
        segment_octets=disk.segment_octets,
    )
    if header is None:
        mind = encode_header(
            config,
            digest,
            handlers,
            payload_max=ports.link.payload_max,
            bodily=ports.body is not None,
            timed=False,
            neighbors=False,
            witnessed=config.witness is not None,
        )
        journal.header(JournalHeader(config.robot, "simulated", config.seed, digest, False, mind))
    else:
        config = replace(decode_header(header.mind).config, witness=config.witness, firings=config.firings)
    state = None if found.snapshot is None else found.snapshot.state
    return DurableNode(config, program, ports, handlers, digest, journal, found.records, snapshot=state)


def _taken(program: Program, found: FoundState, segment: int) -> Snapshot:
    assert found.header is not None
    return taken_snapshot(program, found.header, found.records, found.snapshot, segment, found.crc)
