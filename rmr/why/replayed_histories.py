"""The histories of a recorded run: each robot's minds are replayed once, when an explanation first needs them.

What the recording does not hold (a robot without a log, a log that is damaged) is told in `problems`; what the other
robots did is explained all the same.
"""

from collections import defaultdict
from collections.abc import Iterator
from functools import cached_property
from typing import Any, Final, NamedTuple

from rmr.base.time import NEVER, Instant, in_seconds, seconds
from rmr.bytecode import codec
from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_text
from rmr.lang.lower.robot_rules import Derived, Environment, inner_parts
from rmr.lang.read.source_text import SourceText
from rmr.mind.mind_reader import MindLogError
from rmr.mind.mind_replay import MindReplay
from rmr.mind.mind_versions import differences
from rmr.mind.recorded_minds import TOPIC, RecordedMind, minds, program_of
from rmr.record.recording import Recording
from rmr.record.run_files import BYTE_CODE, PATHS_NAME, SOURCE
from rmr.why.history_listener import HistoryListener, TruePlaces
from rmr.why.mind_index import MindIndex
from rmr.why.past import Variables
from rmr.why.radio_time import Attempt
from rmr.why.robot_history import RobotHistory

PLACES: Final = "/tf"
"""The true places, which the world writes and no robot reads."""
FRAMES: Final = "/frames"
FAULTS: Final = "/faults"
GONE_AFTER: Final = seconds(2)
"""A robot whose log ends by more than this before the run's was stopped: one that lives is called several times a
second, and robots that are stopped together at the end leave within this time."""


class UnexplainableError(Exception):
    """The recording does not hold what an explanation needs; one sentence."""


class RecordedHistories(NamedTuple):
    """What all robots of a run did."""

    program: Program
    robots: dict[int, RobotHistory]
    attempts: dict[tuple[int, int], list[Attempt]]
    """The frames on the air, by sender and handle."""
    problems: tuple[str, ...]


class ReplayedHistories:
    """The histories of a recording, robot by robot."""

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
            self._minds, recording.attachment(BYTE_CODE) or b""
        )
        self.variables = _variables(recording, self.program)
        """Names of the rules' variables, if the recording holds the source."""
        self._listeners: dict[int, HistoryListener] = {}
        self._doubtful: set[int] = set()
        """Robots whose replay is not what they did, or not all of it."""
        self._left: set[int] = set()
        """Robots whose last life has ended in good order."""

    def end_with(self, robot: int) -> None:
        """Let the run be known until the last that `robot` has recorded: processes do not write at the same time."""
        own = [message.at for message in self._recording.messages((TOPIC,)) if message.data.get("robot") == robot]
        if own:
            self.known_until = min(self.known_until, own[-1])

    def minds(self, robot: int) -> list[MindIndex]:
        """Return the incarnations of `robot`, the oldest first, replayed."""
        return self._listener(robot).history.minds

    def whole_run(self) -> RecordedHistories:
        """Return what all robots did, and when their processes ended. Raises UnexplainableError if that is nothing."""
        found = {robot: self._listener(robot) for robot in self.robots}
        listeners = {robot: listener for robot, listener in found.items() if listener.history.minds}
        if not listeners:
            raise UnexplainableError(f"the run cannot be explained: {'; '.join(self.problems)}")
        ends = max(listener.history.ends for listener in listeners.values())
        for robot, listener in listeners.items():
            if robot not in self._doubtful:
                end_early(listener, ends, in_order=robot in self._left)
            listener.ended(ends)
        histories = {robot: listener.history for robot, listener in listeners.items()}
        return RecordedHistories(self.program, histories, _attempts(self._recording), tuple(self.problems))

    @cached_property
    def _truth(self) -> dict[int, TruePlaces]:
        return _true_places(self._recording)

    @cached_property
    def _kills(self) -> defaultdict[int, list[Instant]]:
        return _kills(self._recording)

    def _listener(self, robot: int) -> HistoryListener:
        """Return what has listened to all lives of `robot`."""
        if robot not in self._listeners:
            listener = self._listeners[robot] = HistoryListener(robot, self.program, self._truth.get(robot))
            own = [mind for mind in self._minds if mind.robot == robot]
            for mind in own:
                self._replay(mind, listener, again=mind is not own[-1])
        return self._listeners[robot]

    def _replay(self, mind: RecordedMind, listener: HistoryListener, *, again: bool) -> None:
        """Let `listener` hear one life; `again`: another one follows."""
        listener.begin()
        try:
            replay = mind.replay(witness=_nobody, provenance=listener.log)
        except MindLogError as error:
            self._doubt(mind, f"what robot {mind.robot} did is not known: {error}")
            return
        began = False
        whose = f"robot {mind.robot}" + (f" (incarnation {mind.epoch})" if mind.epoch else "")
        try:
            for at in replay.run():
                if not began:
                    listener.born(replay.node, at)
                    began = True
                elif replay.node.now == at:
                    listener.called(replay.node, at)
                else:
                    listener.touched(replay.node)
        except MindLogError as error:
            self._doubt(mind, f"the log of {whose} ends early: {error}")
        if replay.changed_at is not None:
            self.known_until = min(self.known_until, replay.now)
        problem = _problem(replay, whose)
        if problem:
            self._doubt(mind, problem)
        (self._left.add if replay.ended else self._left.discard)(mind.robot)
        killed = [at for at in self._kills[mind.robot] if replay.now <= at]
        killed = [at for at in killed if not (replay.ended and at > replay.now + GONE_AFTER)]
        if began and (killed or again):
            listener.died(min(killed, default=replay.now), stopped=replay.ended and not killed)

    def _doubt(self, mind: RecordedMind, problem: str) -> None:
        self._doubtful.add(mind.robot)
        self.problems.append(problem)


def _problem(replay: MindReplay, whose: str) -> str:
    """Return why a replay is not what the robot did, or not all of it; empty if it is."""
    if replay.difference is not None:
        at = in_seconds(replay.difference.at)
        return (
            f"the replay of {whose} differs from its recording from {at:.3f} s on ({replay.difference.what}): "
            "what happened later may be explained wrongly; `rmr replay` tells more"
        )
    if replay.changed_at is not None:
        at = in_seconds(replay.changed_at)
        return f"{whose} changed its program at {at:.3f} s: what happened later is not explained"
    return ""


def run_history(recording: Recording) -> RecordedHistories:
    """Replay the minds of `recording`. Raises UnexplainableError if it has no program, or no mind at all."""
    return ReplayedHistories(recording).whole_run()


def end_early(listener: HistoryListener, ends: Instant, *, in_order: bool) -> None:
    """Note the end of a robot's process that ended, perhaps in good order, long before the run, which `ends` then."""
    history = listener.history
    if history.minds[-1].died == NEVER and ends - history.ends > GONE_AFTER:
        listener.died(history.ends, stopped=in_order)


def _variables(recording: Recording, program: Program) -> Variables:
    source = recording.attachment(SOURCE)
    path = recording.parts[0].scan.metadata.get(PATHS_NAME, {}).get(SOURCE, SOURCE)
    return () if source is None else variable_names(program, source.decode("utf-8", "replace"), path)


def variable_names(program: Program, source: str, file: str) -> Variables:
    """Return the names of the variables of each rule of `program`; none if `source`, the text of `file`, is another."""
    compilation = compile_text(SourceText(file, source))
    checked = compilation.checked
    if checked is None or compilation.program is None or compilation.program.rules != program.rules:
        return ()
    return tuple([dict(_slot_names(projected.environment, projected.head)) for projected in checked.rules])


def _slot_names(environment: Environment, head: tuple[Derived, ...]) -> Iterator[tuple[int, str]]:
    """Yield slots with their names; of a slot that two inner bodies use the name in the first one comes last."""
    inner = [part.environment for part in inner_parts(head)]
    for each in (*reversed(inner), environment):
        for name, slot in each.slots.items():
            if name.isidentifier():
                yield slot, name


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


def _nobody(robot: int, now: Instant, event: object) -> None:
    """Hear nothing: a node tells of its frames only where it has a witness."""


def _kills(recording: Recording) -> defaultdict[int, list[Instant]]:
    """Return when the process of each robot was killed, or died."""
    kills: defaultdict[int, list[Instant]] = defaultdict(list)
    for message in recording.messages((FAULTS,)):
        fault = message.data.get("fault", {})
        for word in ("killed", "kill", "die"):
            robot = fault.get(word)
            if isinstance(robot, int):
                kills[robot].append(seconds(fault.get("at", message.at / 1e9)))
    return kills


def _attempts(recording: Recording) -> dict[tuple[int, int], list[Attempt]]:
    attempts: dict[tuple[int, int], list[Attempt]] = {}
    for message in recording.messages((FRAMES,)):
        frame = message.data
        handle = frame.get("handle")
        start = frame.get("start_s")
        end = frame.get("end_s")
        if handle is not None and start is not None and end is not None:
            attempts.setdefault((frame["source"], handle), []).append(Attempt(seconds(start), seconds(end)))
    return attempts


def _true_places(recording: Recording) -> dict[int, TruePlaces]:
    """Return the true places of each robot of `recording`; what is damaged is left out."""
    found: defaultdict[int, TruePlaces] = defaultdict(TruePlaces)
    for message in recording.messages((PLACES,)):
        transforms: Any = message.data.get("transforms", ())
        for each in transforms:
            try:
                kind, _, robot = each["child_frame_id"].partition("/")
                where = each["translation"]
                if kind == "robot" and robot.isdigit():
                    found[int(robot)].add(message.at, float(where["x"]), float(where["y"]))
            except (KeyError, TypeError, ValueError, AttributeError):
                continue
    return dict(found)
