"""Simulated runs with the logs of their minds, and changes of such logs."""

from collections.abc import Callable
from pathlib import Path
from zlib import crc32

from rmr.mind import mind_format as form
from rmr.mind.mind_reader import Batch, MindCall, read_batch
from rmr.mind.mind_replay import MindReplay
from rmr_sim.run_setup import Options, load
from rmr_sim.simulation import Simulation

LABS = Path(__file__).parents[3] / "deploy" / "labs"

TOKENS = """
type token(robot, int).
type door(robot, symbol).
type !next(robot, robot).
type !left(robot, int).
!next(@1, @2).
!next(@2, @1).
token(@1, 1).
token(R, N), N < 30, !next(R, S) -o token(S, N + 1), ?door(R, left), ?left(R, N + 3).
token(R, 30), !next(R, S) -o left(R, 30), door(R, left), door(S, left), token(S, 31).
"""
"""Two robots pass a token on, with open goals that are reached late."""
AFTER_TOKENS = """
type !extra(robot, symbol).
type !next(robot, robot).
type token(robot, int).
!extra(R, fresh).
token(R, N), N < 900, !next(R, S) -o token(S, N + 1).
"""
"""The program that takes its place: a fact of its own, and other numbers of predicates."""

Logs = dict[tuple[int, int], list[bytes]]


class MindRun:
    """A simulated run whose minds have been logged."""

    def __init__(
        self,
        lab: Path,
        seed: int | None = None,
        prepare: Callable[[Simulation], None] = lambda _: None,
        **options: object,
    ) -> None:
        loaded = load(lab, Options(**options))  # type: ignore[arg-type]
        self.logs: Logs = {}
        self.simulation = loaded.simulation(seed, minds=self._take)
        self.program = loaded.program.program
        self.octets = loaded.program.octets
        prepare(self.simulation)
        self.finished = self.simulation.run()

    def _take(self, _at: int, robot: int, epoch: int, data: bytes) -> None:
        self.logs.setdefault((robot, epoch), []).append(data)

    def replay(self, robot: int, epoch: int = 0, **options: object) -> MindReplay:
        """Return the replay of one mind, carried out to its end."""
        return replayed(self.logs[robot, epoch], self.program, **options)


def replayed(log: list[bytes], program: object, **options: object) -> MindReplay:
    """Return the replay of `log`, carried out to its end."""
    replay = MindReplay(log, program, **options)  # type: ignore[arg-type]
    for _ in replay.run():
        pass
    return replay


def resealed(data: bytes, body: bytes) -> bytes:
    """Return the batch `data` with other operations, and a check sum that fits."""
    *_, header_octets = form.HEAD.unpack_from(data)
    whole = data[: form.HEAD.size + header_octets] + body
    return whole + form.CRC.pack(crc32(whole))


def body_of(data: bytes) -> bytes:
    """Return the operations of a batch."""
    *_, header_octets = form.HEAD.unpack_from(data)
    return data[form.HEAD.size + header_octets : -form.CRC.size]


def with_changed_octet(log: list[bytes], kind: int, place: int, number: int = 0) -> tuple[list[bytes], MindCall]:
    """Return `log` with one octet inverted, and the call to which it belongs.

    The octet is that at `place` of the operation `kind` that comes `number`-th in the log.
    """
    for index, data in enumerate(log):
        batch: Batch = read_batch(data)
        at = 0
        for call in batch.calls:
            within = form.CALL.size
            for operation in call.operations:
                if operation.kind == kind:
                    if number == 0:
                        body = bytearray(body_of(data))
                        body[at + within + place] ^= 0xFF
                        return [*log[:index], resealed(data, bytes(body)), *log[index + 1 :]], call
                    number -= 1
                within += len(operation.octets)
            at += len(call.octets)
    raise AssertionError("the log has no such operation")


def without_call(log: list[bytes], kind: int, number: int = 0) -> tuple[list[bytes], MindCall]:
    """Return `log` without the call `kind` that comes `number`-th; the call after it keeps its instant."""
    for index, data in enumerate(log):
        body = body_of(data)
        at = 0
        calls = read_batch(data).calls
        for place, call in enumerate(calls[:-1]):
            if call.kind == kind:
                if number == 0:
                    rest = body[at + len(call.octets) :]
                    base = calls[place - 1].at if place else form.HEAD.unpack_from(data)[4]
                    moved = form.CALL.pack(calls[place + 1].kind, calls[place + 1].at - base)
                    changed = body[:at] + moved + rest[form.CALL.size :]
                    return [*log[:index], resealed(data, changed), *log[index + 1 :]], call
                number -= 1
            at += len(call.octets)
    raise AssertionError("the log has no such call")
