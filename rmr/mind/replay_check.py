"""Replays the minds of a recording side by side, in one pass over the file, and tells what became of each."""

import heapq
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from rmr.base.mistake import words
from rmr.base.time import NEVER, NS_PER_S, Instant, in_seconds
from rmr.bytecode import codec
from rmr.bytecode.program import Program
from rmr.mind.mind_header import MindHeader, decode_header
from rmr.mind.mind_reader import MindLogError, read_batch
from rmr.mind.mind_replay import MindReplay
from rmr.mind.mind_versions import differences
from rmr.mind.recorded_minds import MindSource, batches_of, program_of
from rmr.node.trace import TraceLevel
from rmr.record.run_files import BYTE_CODE
from rmr.vm.engines import Engine

TraceSink = Callable[[dict[str, Any]], None]


@dataclass(slots=True)
class MindCheck:
    """What became of the replay of one mind."""

    robot: int
    epoch: int
    replay: MindReplay | None = None
    header: MindHeader | None = None
    problem: str = ""
    """Why it could not be replayed, or not to its end."""
    stale: tuple[tuple[str, str, str], ...] = ()
    """What the recording depends on that is another one here: what, recorded, here."""
    stop: Instant | None = None
    """When its robot was stopped in order, if the recording tells so."""
    took_s: float = 0.0
    """Time that the replay took, by the given clock."""

    @property
    def seconds(self) -> float:
        """Length of what was replayed, seconds of lab time."""
        replay = self.replay
        return 0.0 if replay is None or replay.began is None else in_seconds(replay.now - replay.began)

    @property
    def name(self) -> str:
        """The mind in words."""
        return f"robot {self.robot}" + (f" (restart {self.epoch})" if self.epoch else "")

    def as_dict(self) -> dict[str, Any]:
        """Return the check as JSON."""
        replay = self.replay
        found: dict[str, Any] = {"robot": self.robot, "epoch": self.epoch, "problem": self.problem or None}
        found["versions"] = [{"what": what, "recorded": then, "here": now} for what, then, now in self.stale]
        if replay is None or self.header is None:
            return found | {"equal": None}
        difference = replay.difference
        samples, frames, refused = replay.not_delivered
        return found | {
            "equal": difference is None and not self.problem,
            "begin_s": in_seconds(replay.began or 0),
            "end_s": in_seconds(replay.now),
            "inputs": replay.inputs,
            "outputs": replay.outputs,
            "times_real_time": round(self.seconds / self.took_s, 1) if self.took_s > 0 else None,
            "ended": replay.ended,
            "stopped_s": None if self.stop is None else in_seconds(self.stop),
            "compiled": self.header.compiled,
            "not_delivered": {"samples": samples, "frames": frames, "refused": refused},
            "difference": None
            if difference is None
            else {
                "t_s": in_seconds(difference.at),
                "what": difference.what,
                "recorded": difference.recorded,
                "replayed": difference.replayed,
            },
        }


@dataclass(frozen=True, slots=True)
class CheckOptions:
    """What of a recording is replayed, and how."""

    robots: Collection[int] = ()
    """The robots; empty: all."""
    begin: Instant = 0
    """Differences before this instant are ignored."""
    end: Instant = NEVER
    """Instant after which nothing is replayed."""
    engine: Engine | None = None
    """None: that of the recording."""
    anyway: bool = False
    """Whether minds are replayed that depend on other versions than those here."""
    trace: TraceSink | None = None
    """Takes the entries of the trace, with the facts, by instant and robot."""
    clock: Callable[[], float] = field(default=lambda: 0.0)
    """Seconds of any zero: measures how long the replays take."""


class ReplayCheck:
    """The replays of one recording."""

    def __init__(self, source: MindSource, options: CheckOptions) -> None:
        """Raise MindLogError if the recording holds no sound program."""
        self.program: Final[Program] = program_of(source)
        data = source.attachment(BYTE_CODE)
        assert data is not None
        self._digest = codec.digest(data)
        self._source = source
        self._options = options
        self._minds: dict[tuple[int, int], MindCheck] = {}
        self._entries: list[tuple[float, int, int, dict[str, Any]]] = []
        """Heap of the entries of the trace that may not be the next ones: instant, robot, number."""
        self._noted = 0
        self.present: dict[int, None] = {}
        """The robots of which the recording has a mind."""

    def run(self) -> Iterator[Instant]:
        """Replay all minds; yield the instant that has been reached. Raises MindLogError for foreign messages."""
        options = self._options
        for at, robot, epoch, data in batches_of(self._source):
            if (at // NS_PER_S) * NS_PER_S > options.end:
                break  # a batch is of one second
            self.present[robot] = None
            if not options.robots or robot in options.robots:
                self._take(robot, epoch, data)
                self._pass_on(at // NS_PER_S)
                yield at
        self._pass_on(None)
        self._take_stops()

    def _take_stops(self) -> None:
        """Find which robots were stopped in order: a stop is of the last mind that had begun by then."""
        for message in self._source.messages({"/faults"}):
            robot = message.data["fault"].get("stop")
            minds = [
                check
                for check in self.checks
                if check.robot == robot and check.replay is not None and (check.replay.began or 0) <= message.at
            ]
            if minds:
                minds[-1].stop = message.at

    @property
    def checks(self) -> list[MindCheck]:
        """What became of each mind, by robot and epoch."""
        return [self._minds[key] for key in sorted(self._minds)]

    def _take(self, robot: int, epoch: int, data: bytes) -> None:
        check = self._minds.get((robot, epoch))
        if check is None:
            check = self._minds[robot, epoch] = MindCheck(robot, epoch)
            self._begin(check, data)
        elif check.replay is not None and not check.problem:
            check.replay.feed(data)
        if check.replay is None or check.problem:
            return
        began = self._options.clock()
        try:
            for _ in check.replay.run(self._options.end):
                if check.replay.node.trace_log:
                    self._collect(check.replay)
        except MindLogError as error:
            check.problem = str(error)
        check.took_s += self._options.clock() - began

    def _begin(self, check: MindCheck, data: bytes) -> None:
        """Begin the replay of a mind with the first batch of its log, unless something speaks against it."""
        options = self._options
        try:
            batch = read_batch(data)
            if not batch.header:
                raise MindLogError("its beginning is missing")
            check.header = header = decode_header(batch.header)
            check.stale = tuple(differences(header.versions))
            if header.program != self._digest:
                check.stale = (("program", f"{header.program:08x}", f"{self._digest:08x}"), *check.stale)
            if check.stale and not options.anyway:
                check.problem = "it was recorded by another version"
                return
            level = TraceLevel.NOTES if options.trace is None else TraceLevel.FACTS
            check.replay = MindReplay([data], self.program, engine=options.engine, trace=level, since=options.begin)
        except ValueError as error:
            check.problem = str(error)
        except Exception as error:  # a header that is well-formed, and that no robot can have
            check.problem = f"its node cannot be made anew: {words(error)}"

    # -- the trace ----------------------------------------------------------------------------------------------

    def _collect(self, replay: MindReplay) -> None:
        begin_s = in_seconds(self._options.begin)
        if self._options.trace is not None:
            for entry in replay.node.trace_log:
                if entry["t"] >= begin_s:
                    self._noted += 1
                    heapq.heappush(self._entries, (entry["t"], entry["robot"], self._noted, entry))
        replay.node.trace_log.clear()

    def _pass_on(self, second: int | None) -> None:
        """Pass on the entries before `second` (None: all): batches come in order, and each is of one second."""
        sink = self._options.trace
        while sink is not None and self._entries and (second is None or self._entries[0][0] < second):
            sink(heapq.heappop(self._entries)[3])
