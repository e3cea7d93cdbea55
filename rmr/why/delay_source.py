"""The histories of a recorded run: each mind is replayed once, and a listener writes down what it does.

What the recording does not hold (a robot without a log, a log that is damaged) is told in `problems`; the delays of the
other robots are explained all the same.
"""

from collections import defaultdict
from dataclasses import dataclass
from typing import Final

from rmr.base.time import NEVER, Instant, seconds
from rmr.bytecode.program import Program
from rmr.mind.mind_reader import MindLogError
from rmr.mind.recorded_minds import RecordedMind, minds
from rmr.record.recording import Recording
from rmr.why.history_listener import HistoryListener
from rmr.why.radio_time import Attempt
from rmr.why.replayed_histories import ReplayedHistories, UnexplainableError
from rmr.why.robot_history import RobotHistory
from rmr.why.true_places import true_places

FRAMES: Final = "/frames"
FAULTS: Final = "/faults"
GONE_AFTER: Final = seconds(2)
"""A robot whose log ends by more than this before the run's was stopped: one that lives is called several times a
second, and robots that are stopped together at the end leave within this time."""


@dataclass(frozen=True, slots=True)
class RecordedHistories:
    """What all robots of a run did."""

    program: Program
    robots: dict[int, RobotHistory]
    attempts: dict[tuple[int, int], list[Attempt]]
    """The frames on the air, by sender and handle."""
    problems: tuple[str, ...]


def run_history(recording: Recording) -> RecordedHistories:
    """Replay the minds of `recording`. Raises UnexplainableError if it has no program, or no mind at all."""
    known = ReplayedHistories(recording)  # checks the recording; its own replays are not needed
    program = known.program
    found = minds(recording)
    kills = _kills(recording)
    truth = true_places(recording)
    listeners: dict[int, HistoryListener] = {}
    problems = list(known.problems)
    doubtful: set[int] = set()
    in_order: set[int] = set()
    """Robots whose last life ended in order."""
    for mind, following in zip(found, [*found[1:], None], strict=True):
        listener = listeners.setdefault(mind.robot, HistoryListener(mind.robot, program, truth.get(mind.robot)))
        again = following is not None and following.robot == mind.robot
        problem, ended = _replayed(mind, listener, kills[mind.robot], again=again)
        (in_order.add if ended else in_order.discard)(mind.robot)
        if problem:
            problems.append(f"robot {mind.robot}, life {mind.epoch + 1}: {problem}")
            doubtful.add(mind.robot)
    listeners = {robot: listener for robot, listener in listeners.items() if listener.history.lives}
    if not listeners:
        raise UnexplainableError(f"the run cannot be explained: {'; '.join(problems)}")
    ends = max((listener.history.ends for listener in listeners.values()), default=0)
    for robot, listener in listeners.items():
        if robot not in doubtful:
            end_early(listener, ends, in_order=robot in in_order)
        listener.ended(ends)
    histories = {robot: listener.history for robot, listener in listeners.items()}
    return RecordedHistories(program, histories, _attempts(recording), tuple(problems))


def end_early(listener: HistoryListener, ends: Instant, *, in_order: bool) -> None:
    """Note the end of a robot's process that ended, perhaps in good order, long before the run, which `ends` then."""
    history = listener.history
    if history.lives[-1][1] == NEVER and ends - history.ends > GONE_AFTER:
        listener.died(history.ends, stopped=in_order)


def _replayed(mind: RecordedMind, listener: HistoryListener, kills: list[Instant], *, again: bool) -> tuple[str, bool]:
    """Replay one incarnation; return what was wrong, empty if nothing was, and whether it ended in good order.

    `again`: another one follows.
    """
    listener.begin()
    at: Instant = 0
    began = ended = False
    try:
        replay = mind.replay(witness=_nobody, provenance=listener.log)
        node = replay.node
        for at in replay.run():
            if not began:
                listener.born(node, at)
                began = True
            elif node.now == at:
                listener.called(node, at)
            else:
                listener.touched(node)
        ended = replay.ended
        if replay.difference is not None:
            difference = replay.difference
            problem = f"its replay differs from the recording from {difference.at / 1e9:.3f} s on ({difference.what})"
        else:
            problem = ""
    except MindLogError as error:
        problem = str(error)
    if not began:
        return problem or "its log is empty", ended
    killed = [kill for kill in kills if at <= kill and not (ended and kill > at + GONE_AFTER)]
    if killed or again:
        listener.died(min(killed, default=at), stopped=ended and not killed)
    return problem, ended


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
