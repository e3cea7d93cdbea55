"""What a robot of a recorded run knew and did at any instant, from the replay of its minds.

Each incarnation is replayed once, forwards, into the history that explanations read, too (`rmr.why.mind_index`). So
going back on the slider costs a look-up. While a run goes on the replay goes on from where it was, as far as the log
reaches.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rmr.base.time import NEVER, Instant, in_seconds, seconds
from rmr.base.values import Robot, format_fact
from rmr.bytecode.program import ANY, Constant, Program
from rmr.mind.mind_reader import MindLogError
from rmr.mind.mind_replay import MindReplay
from rmr.mind.recorded_minds import TOPIC, program_of
from rmr.node.robot_state import ProgramBegun
from rmr.node.trace import goal_text, rule_text
from rmr.record.recording import RUN_FILE, GrowingRecording, Recording, open_recording, part_files
from rmr.vm.machine import Machine
from rmr.vm.provenance import ProvenanceLog, ToldRecord
from rmr.vm.ranks import goal_key
from rmr.why.mind_index import MindIndex
from rmr.why.past_items import PastAction, PastGoal
from rmr.why.stops import is_hidden, is_sensed, known_text

LISTED_MAX = 50
"""Firings, actions and achieved goals in one answer at most, the newest."""


class FollowedMind:
    """One incarnation of one robot."""

    def __init__(self, program: Program, first: bytes) -> None:
        """`first` is the first batch of its log. Raises MindLogError."""
        self._log = ProvenanceLog()
        self._replay = MindReplay([first], program, provenance=self._log)
        self._minds = [MindIndex(self._replay.robot, self._replay.epoch, program)]
        """Its history, a part for each program that it ran."""
        self.problem: str | None = None
        """Why it is known no further, or the replay differs from the robot."""

    @property
    def began_s(self) -> float:
        """Instant of its first call, seconds; 0 before it."""
        return in_seconds(self._replay.began or 0)

    def feed(self, batch: bytes) -> None:
        """Add the next batch of its log."""
        self._replay.feed(batch)

    def go_on(self) -> None:
        """Execute all calls that are known."""
        if self.problem is not None and self._replay.difference is None:
            return
        try:
            while self._replay.step():
                self._take()
        except MindLogError as error:
            self.problem = f"its log is damaged: {error}"
        difference = self._replay.difference
        if difference is not None:
            self.problem = (
                f"from {in_seconds(difference.at):.3f} s on the replay differs from the robot ({difference.what})"
            )

    def _take(self) -> None:
        """Take in the new records; the trace is not needed."""
        for record in self._log.records:
            if isinstance(record, ToldRecord) and isinstance(record.event, ProgramBegun):
                before = self._minds[-1]
                self._minds.append(MindIndex(before.robot, before.epoch, record.event.program, record.at, before))
            else:
                self._minds[-1].take(record)
        self._log.records.clear()
        self._replay.node.trace_log.clear()

    def state(self, now: Instant) -> dict[str, Any]:
        """Return facts, goals, firings and actions after all that happened at `now`."""
        mind = next((each for each in reversed(self._minds) if each.begins <= now), self._minds[0])
        fired = [
            {"t": _s(firing.at), "rule": rule_text(each.program, firing.rule)}
            for each in self._minds
            for firing in each.firings.values()
            if firing.at <= now
        ]
        achieved = [
            [goal_text(each.program, goal.predicate, each.robot, _values(goal)), _s(goal.achieved)]
            for each in self._minds
            for goal in each.achieved
            if goal.achieved is not None and goal.achieved <= now
        ]
        actions = [
            _as_of(each, action, now)
            for each in self._minds
            for action in each.begun
            if action.begun is not None and action.begun <= now
        ]
        return {
            "facts": sorted(_facts(mind, now)),
            "sensed": sorted(_sensed(mind, now)),
            "goals": {"achieved": achieved[-LISTED_MAX:], "open": sorted(_open_goals(mind, now))},
            "fired": fired[-LISTED_MAX:],
            "actions": actions[-LISTED_MAX:],
        }


def _s(at: Instant) -> float:
    """Return an instant as the trace has it."""
    return round(in_seconds(at), 6)


def _facts(mind: MindIndex, now: Instant) -> Iterator[str]:
    """Yield what the robot knew by its rules, in program syntax."""
    for index in range(len(mind.program.predicates)):
        if not (is_sensed(mind.program, index) or is_hidden(mind.program, index)):
            for fact in mind.held(index, now):
                yield known_text(mind.program, index, mind.robot, fact.args)


def _sensed(mind: MindIndex, now: Instant) -> Iterator[str]:
    for index in range(len(mind.program.predicates)):
        if is_sensed(mind.program, index):
            for fact in mind.held(index, now):
                yield known_text(mind.program, index, mind.robot, fact.args)


def sensed_facts(machine: Machine) -> list[str]:
    """Return the facts that the robot states of itself, in program syntax, sorted.

    What it has heard of its neighbours' shared facts is among them, in words.
    """
    return sorted(
        known_text(machine.program, index, int(machine.robot), args)
        for index in range(len(machine.program.predicates))
        if is_sensed(machine.program, index)
        for args in machine.each(index)
    )


def _open_goals(mind: MindIndex, now: Instant) -> list[str]:
    """Return the goals that were open, each once, however often it was opened meanwhile."""
    still = {
        goal_key(goal.predicate, goal.args): goal_text(mind.program, goal.predicate, mind.robot, _values(goal))
        for goal in mind.goals
        if goal.at <= now and min(_or_never(goal.achieved), _or_never(goal.withdrawn)) > now
    }
    return list(still.values())


def _or_never(at: Instant | None) -> Instant:
    return NEVER if at is None else at


def _values(goal: PastGoal) -> tuple[object, ...]:
    """Return the arguments of a goal, ANY for one that is free."""
    return tuple([each.value if isinstance(each, Constant) else ANY for each in goal.args])


def _as_of(mind: MindIndex, action: PastAction, now: Instant) -> dict[str, Any]:
    """Return an action as it stood at `now`: its end is not known before."""
    assert action.begun is not None
    over = action.ended is not None and action.ended <= now
    return {
        "begin_s": _s(action.begun),
        "action": format_fact(mind.program.predicates[action.predicate].name, (Robot(mind.robot), *action.args)),
        "end_s": _s(action.ended) if over and action.ended is not None else None,
        "failure": action.failure if over else None,
    }


class FollowedRobot:
    """The incarnations of one robot, and how far their logs have been read."""

    def __init__(self) -> None:
        self.lives: dict[int, FollowedMind] = {}
        self.problem: str | None = None
        self.complete = False
        """Whether the whole log of a run that is over has been read."""
        self.read_to: Instant = 0
        self.last: set[tuple[int, bytes]] = set()
        """The batches of the instant `read_to`: it may get more."""


class FollowedMinds:
    """The minds of one run, each made when it is first asked for."""

    def __init__(self, path: Path) -> None:
        """`path` is a run folder or a recording. Raises RecordingError."""
        self._recording: Recording = opened(path)
        self._robots: dict[int, FollowedRobot] = {}
        self._program = program_of(self._recording)

    def state(self, robot: int, t: float | None) -> dict[str, Any]:
        """Return what `robot` knew and did at `t` seconds (None: as far as it is known)."""
        known = self._robots.setdefault(robot, FollowedRobot())
        self._read(robot, known)
        begun = [epoch for epoch, life in known.lives.items() if t is None or life.began_s <= t]
        if not begun:
            problem = known.problem or f"nothing of robot {robot} was recorded by then"
            return {
                "facts": [],
                "sensed": [],
                "goals": {"achieved": [], "open": []},
                "fired": [],
                "actions": [],
                "problem": problem,
            }
        epoch = max(begun)
        life = known.lives[epoch]
        return {**life.state(NEVER - 1 if t is None else seconds(t)), "epoch": epoch, "problem": life.problem}

    def _read(self, robot: int, known: FollowedRobot) -> None:
        recording = self._recording
        if isinstance(recording, GrowingRecording):
            recording.refresh()
        elif not recording.complete:
            for part in recording.parts:
                part.scan.extend()
        elif known.complete:
            return
        known.complete = recording.complete
        for message in self._recording.messages((TOPIC,), known.read_to):
            if message.data.get("robot") == robot:
                self._feed(known, message.at, message.data["epoch"], message.data["data"])
        for life in known.lives.values():
            life.go_on()

    def _feed(self, known: FollowedRobot, at: Instant, epoch: int, batch: bytes) -> None:
        if at > known.read_to:
            known.read_to = at
            known.last.clear()
        if (epoch, batch) in known.last:
            return
        known.last.add((epoch, batch))
        life = known.lives.get(epoch)
        if life is not None:
            life.feed(batch)
            return
        try:
            known.lives[epoch] = FollowedMind(self._program, batch)
        except MindLogError as error:
            known.problem = f"what it knew cannot be replayed: {error}"


def opened(path: Path) -> Recording:
    """Return the recording at `path`, which may still grow. Raises RecordingError."""
    if path.is_dir() and not (path / RUN_FILE).exists() and part_files(path):
        return GrowingRecording(path)
    return open_recording(path)
