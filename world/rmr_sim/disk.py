"""The disk of a simulated durable robot, which does what a real one does at a crash.

What was written survives the end of the process, and what was synced a loss of power, too. The record that was being
written when the robot died is torn: a part of its octets is there, drawn from the stream ``SEED/robotN/disk``.
"""

from collections.abc import Mapping
from dataclasses import replace

from rmr.base.streams import stream
from rmr.bytecode.program import Program
from rmr.mind.durable_node import DurableNode
from rmr.mind.journal import Journal, JournalHeader, read_journal
from rmr.mind.mind_header import decode_header, encode_header
from rmr.node.actions.dispatcher import Handler
from rmr.node.config import NodeConfig
from rmr.node.ports import Ports


class Disk:
    """One robot's disk (`rmr.mind.journal.JournalFile`)."""

    def __init__(self, seed: int, robot: int) -> None:
        self._rng = stream(f"{seed}/robot{robot}/disk")
        self.data = b""
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

    def crash(self, record: bytes, *, power: bool = False) -> None:
        """End the process while it writes `record`; with `power` what was not synced is lost, too."""
        whole = b"".join([self.data, *self._chunks])
        if power:
            whole, record = whole[: self._synced], whole[self._synced :] + record
        self.data = whole + record[: self._rng.randrange(len(record))] if record else whole
        self._chunks = []
        self._written = len(self.data)
        self._synced = min(self._synced, self._written)

    def truncate(self, octets: int) -> None:
        """Keep so many octets."""
        self.data = b"".join([self.data, *self._chunks])[:octets]
        self._chunks = []
        self._written = self._synced = octets


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
    found = read_journal(disk.data)
    disk.truncate(found.whole)
    journal = Journal(disk, synced=synced, crc=found.crc)
    header = found.header
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
    return DurableNode(config, program, ports, handlers, digest, journal, found.records)
