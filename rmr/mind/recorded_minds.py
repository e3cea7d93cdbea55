"""The minds of a recording: which incarnations of which robots it has logs of, and their replays."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, Final, Protocol

from rmr.base.time import NEVER, Instant
from rmr.bytecode import codec
from rmr.bytecode.program import Program
from rmr.mind.mind_header import MindHeader, decode_header
from rmr.mind.mind_reader import MindLogError, read_batch
from rmr.mind.mind_replay import MindReplay, Witness
from rmr.node.trace import TraceLevel
from rmr.record.run_files import BYTE_CODE
from rmr.vm.engines import Engine
from rmr.vm.provenance import ProvenanceLog

TOPIC: Final = "/mind"


class MindMessage(Protocol):
    """A message of a recording."""

    @property
    def at(self) -> Instant:
        """Its instant."""

    @property
    def data(self) -> dict[str, Any]:
        """Its content: robot, epoch and data, the octets of a batch."""


class MindSource(Protocol):
    """What a replay needs of a recording (`rmr.record.recording.Recording`)."""

    def messages(
        self, topics: Collection[str] | None = None, begin: Instant = 0, end: Instant = NEVER
    ) -> Iterator[MindMessage]:
        """Yield the messages of `topics` by time."""

    def attachment(self, name: str) -> bytes | None:
        """Return the attachment `name`; None if there is none."""


@dataclass(frozen=True, slots=True)
class RecordedMind:
    """One incarnation of one robot in a recording."""

    robot: int
    epoch: int
    header: MindHeader | None
    """None if its beginning is missing or damaged: it cannot be replayed."""
    problem: str
    """Why not; empty if it can."""
    source: MindSource

    def log(self) -> Iterator[bytes]:
        """Yield the batches of its log, reading the recording anew."""
        for _, robot, epoch, data in batches_of(self.source):
            if (robot, epoch) == (self.robot, self.epoch):
                yield data

    def replay(
        self,
        *,
        engine: Engine | None = None,
        trace: TraceLevel = TraceLevel.NOTES,
        witness: Witness | None = None,
        provenance: ProvenanceLog | None = None,
    ) -> MindReplay:
        """Return its replay. Raises MindLogError if it has no beginning, or the recording no program."""
        program = program_of(self.source)
        options: dict[str, Any] = {"engine": engine, "trace": trace, "witness": witness, "provenance": provenance}
        return MindReplay(self.log(), program, one_program=provenance is not None, **options)


def batches_of(source: MindSource) -> Iterator[tuple[Instant, int, int, bytes]]:
    """Yield (instant, robot, epoch, batch) of all minds by time. Raises MindLogError for a message of another form."""
    for message in source.messages((TOPIC,)):
        found = message.data
        robot = found.get("robot")
        epoch = found.get("epoch")
        data = found.get("data")
        if not (isinstance(robot, int) and isinstance(epoch, int) and isinstance(data, bytes)):
            raise MindLogError(
                f"a message of {TOPIC} is none of rmr's: it has {', '.join(map(str, found)) or 'nothing'}"
            )
        yield message.at, robot, epoch, data


def minds(source: MindSource) -> list[RecordedMind]:
    """Return the minds of a recording, by robot and epoch. Raises MindLogError for messages that are not rmr's."""
    found: dict[tuple[int, int], RecordedMind] = {}
    for _, robot, epoch, data in batches_of(source):
        if (robot, epoch) not in found:
            found[robot, epoch] = _mind(robot, epoch, data, source)
    return [found[key] for key in sorted(found)]


def _mind(robot: int, epoch: int, first: bytes, source: MindSource) -> RecordedMind:
    try:
        batch = read_batch(first)
        if not batch.header:
            raise MindLogError("its beginning is missing")
        return RecordedMind(robot, epoch, decode_header(batch.header), "", source)
    except ValueError as error:
        return RecordedMind(robot, epoch, None, str(error), source)


def program_of(source: MindSource) -> Program:
    """Return the program of a recording. Raises MindLogError if it has none that is sound."""
    data = source.attachment(BYTE_CODE)
    if data is None:
        raise MindLogError(f"the recording holds no program ({BYTE_CODE})")
    try:
        return codec.decode(data)
    except codec.BytecodeError as error:
        raise MindLogError(f"the recording's program ({BYTE_CODE}): {error}") from None
