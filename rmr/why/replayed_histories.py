"""The histories of a recorded run: each mind is replayed with a provenance log when an explanation first needs it."""

from rmr.base.time import Instant, in_seconds
from rmr.bytecode import codec
from rmr.bytecode.program import Program
from rmr.mind.mind_reader import MindLogError
from rmr.mind.mind_versions import differences
from rmr.mind.recorded_minds import PROGRAM, TOPIC, RecordedMind, minds, program_of
from rmr.node.trace import TraceLevel
from rmr.record.recording import Recording
from rmr.record.run_files import PATHS_NAME, SOURCE
from rmr.vm.provenance import ProvenanceLog, ProvenanceRecord
from rmr.why.variable_names import Variables, variable_names


class UnexplainableError(Exception):
    """The recording does not hold what an explanation needs; one sentence."""


class ReplayedHistory:
    """One incarnation."""

    def __init__(self, mind: RecordedMind) -> None:
        """Replay `mind`. Raises MindLogError if it cannot be."""
        self.robot = mind.robot
        self.epoch = mind.epoch
        self.problem = ""
        """Why the replay may not be what the robot did; empty if it is."""
        log = ProvenanceLog()
        replay = mind.replay(trace=TraceLevel.NOTES, provenance=log)
        whose = f"robot {mind.robot}" + (f" (incarnation {mind.epoch})" if mind.epoch else "")
        self.records: list[ProvenanceRecord] = log.records
        try:
            while replay.step():
                pass
        except MindLogError as error:
            self.problem = f"the log of {whose} ends early: {error}"
        if replay.changed_at is not None:
            at = in_seconds(replay.changed_at)
            self.problem = f"{whose} changed its program at {at:.3f} s: what happened later is not explained"
        if replay.difference is not None:
            at = in_seconds(replay.difference.at)
            self.problem = (
                f"the replay of {whose} differs from its recording from {at:.3f} s on ({replay.difference.what}): "
                "what happened later may be explained wrongly; `rmr replay` tells more"
            )
        self.changed = replay.changed_at is not None
        """Whether it ends at a change of the program."""
        self.known_until: Instant = replay.now


class ReplayedHistories:
    """The histories of a recording."""

    def __init__(self, recording: Recording) -> None:
        """Raise UnexplainableError if the recording has no minds or no program."""
        try:
            self.program: Program = program_of(recording)
            self._minds = minds(recording)
        except MindLogError as error:
            raise UnexplainableError(f"the run cannot be explained: {error}") from None
        if not self._minds:
            raise UnexplainableError("the run cannot be explained: its recording holds no minds of robots")
        self.robots = sorted({*recording.about.roster, *[mind.robot for mind in self._minds]})
        self.known_until: Instant = recording.span[1]
        """The last instant of the recording, or of a robot of it (`end_with`)."""
        self._recording = recording
        self.problems: list[str] = list(recording.problems) + _foreign(
            self._minds, recording.attachment(PROGRAM) or b""
        )
        self.variables = _variables(recording, self.program)
        """Names of the rules' variables, if the recording holds the source."""
        self._made: dict[int, list[ReplayedHistory]] = {}

    def end_with(self, robot: int) -> None:
        """Let the run be known until the last that `robot` has recorded: processes do not write at the same time."""
        own = [message.at for message in self._recording.messages((TOPIC,)) if message.data.get("robot") == robot]
        if own:
            self.known_until = min(self.known_until, own[-1])

    def histories(self, robot: int) -> list[ReplayedHistory]:
        """Return the incarnations of `robot`, the oldest first, replayed."""
        if robot not in self._made:
            self._made[robot] = [
                history for mind in self._minds if mind.robot == robot and (history := self._replayed(mind)) is not None
            ]
        return self._made[robot]

    def _replayed(self, mind: RecordedMind) -> ReplayedHistory | None:
        try:
            history = ReplayedHistory(mind)
        except MindLogError as error:
            self.problems.append(f"what robot {mind.robot} did is not known: {error}")
            return None
        if history.changed:
            self.known_until = min(self.known_until, history.known_until)
        if history.problem:
            self.problems.append(history.problem)
        return history


def _variables(recording: Recording, program: Program) -> Variables:
    source = recording.attachment(SOURCE)
    path = recording.parts[0].scan.metadata.get(PATHS_NAME, {}).get(SOURCE, SOURCE)
    return () if source is None else variable_names(program, source.decode("utf-8", "replace"), path)


def _foreign(found: list[RecordedMind], octets: bytes) -> list[str]:
    """Return a sentence if other versions recorded the run than those here.

    Raises UnexplainableError if the robots ran another program.
    """
    digest = codec.digest(octets)
    stale: dict[str, str] = {}
    for mind in found:
        if mind.header is not None:
            if mind.header.program != digest:
                raise UnexplainableError(
                    f"robot {mind.robot} ran another program than the one that is in the recording: "
                    f"{mind.header.program:08x}, not {digest:08x}"
                )
            stale |= {what: f"{what} {then}, here {here}" for what, then, here in differences(mind.header.versions)}
    if not stale:
        return []
    listed = "; ".join(stale.values())
    return [f"the run was recorded by another version ({listed}): its replay may differ, which is told"]
