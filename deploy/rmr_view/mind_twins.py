"""Twins of recorded minds: what a robot knew at any instant, from the replay of its log.

A twin is executed once, forwards, and keeps a snapshot of its facts and goals at each call that changed them. So going
back on the slider costs a look-up. While a run goes on the twin goes on from where it was, as far as the log reaches.
"""

from bisect import bisect_right
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rmr.base.time import NEVER, Instant, in_seconds
from rmr.base.values import format_fact
from rmr.bytecode.program import Kind, Program
from rmr.mind.mind_reader import MindLogError
from rmr.mind.mind_replay import MindReplay
from rmr.mind.recorded_minds import TOPIC, program_of
from rmr.node.trace import TraceLevel
from rmr.record.growing_recording import GrowingRecording
from rmr.record.recording import RUN_FILE, Recording, open_recording, part_files
from rmr.vm.machine import Machine

SNAPSHOTS_MAX = 20_000
"""Snapshots of one twin: every second of the older half goes when there are more."""
LISTED_MAX = 50
"""Firings, actions and achieved goals in one answer at most, the newest."""
CHANGES = frozenset({"fired", "inserted", "removed", "achieved"})
"""Words of the trace after which facts or goals may be others."""


class MindSnapshot(NamedTuple):
    """Facts and goals after a call."""

    at: float
    facts: Sequence[str]
    sensed: Sequence[str]
    goals: Sequence[Any]


class MindTwin:
    """One incarnation of one robot."""

    def __init__(self, program: Program, first: bytes) -> None:
        """`first` is the first batch of its log. Raises MindLogError."""
        self._replay = MindReplay([first], program, trace=TraceLevel.FACTS)
        self._snapshots: list[MindSnapshot] = []
        self.fired: list[dict[str, Any]] = []
        self.actions: list[dict[str, Any]] = []
        self.achieved: list[list[Any]] = []
        self.problem: str | None = None
        """Why the twin goes no further, or differs from the robot."""

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
                self._note()
        except MindLogError as error:
            self.problem = f"its log is damaged: {error}"
        difference = self._replay.difference
        if difference is not None:
            self.problem = (
                f"from {in_seconds(difference.at):.3f} s on the replay differs from the robot ({difference.what})"
            )

    def _note(self) -> None:
        entries = self._replay.node.trace_log
        if not entries:
            return
        changed = not self._snapshots
        for entry in entries:
            changed = changed or entry["what"] in CHANGES
            self._take(entry)
        entries.clear()
        if changed:
            machine = self._replay.node.machine
            goals = machine.goals()["open"]
            self._snapshots.append(
                MindSnapshot(in_seconds(self._replay.now), machine.facts(), sensed_facts(machine), goals)
            )
            if len(self._snapshots) > SNAPSHOTS_MAX:
                half = SNAPSHOTS_MAX // 2
                self._snapshots[:half] = self._snapshots[:half:2]

    def _take(self, entry: dict[str, Any]) -> None:
        match entry["what"]:
            case "fired":
                self.fired.append({"t": entry["t"], "rule": entry["rule"]})
            case "achieved":
                self.achieved.append([entry["goal"], entry["t"]])
            case "action":
                started = {"begin_s": entry["t"], "action": entry["action"], "end_s": None, "failure": None}
                self.actions.append(started)
            case "action_ended":
                self._end_action(entry)
            case _:
                pass

    def _end_action(self, entry: dict[str, Any]) -> None:
        for action in reversed(self.actions):
            if action["action"] == entry["action"] and action["end_s"] is None:
                action["end_s"] = entry["t"]
                action["failure"] = entry["failure"]
                return

    def state(self, t: float) -> dict[str, Any]:
        """Return facts, goals, firings and actions at `t` seconds."""
        index = bisect_right(self._snapshots, t, key=lambda snapshot: snapshot.at) - 1
        snapshot = self._snapshots[index] if index >= 0 else MindSnapshot(0.0, (), (), ())
        fired = self.fired[: bisect_right(self.fired, t, key=lambda one: float(one["t"]))]
        achieved = self.achieved[: bisect_right(self.achieved, t, key=lambda one: float(one[1]))]
        actions = self.actions[: bisect_right(self.actions, t, key=lambda one: float(one["begin_s"]))]
        return {
            "facts": list(snapshot.facts),
            "sensed": list(snapshot.sensed),
            "goals": {"achieved": achieved[-LISTED_MAX:], "open": list(snapshot.goals)},
            "fired": fired[-LISTED_MAX:],
            "actions": [_as_of(action, t) for action in actions[-LISTED_MAX:]],
        }


def sensed_facts(machine: Machine) -> list[str]:
    """Return the facts that the robot states of itself, such as `at` and `turn`, in program syntax, sorted."""
    return sorted(
        format_fact(predicate.name, (machine.robot, *args))
        for index, predicate in enumerate(machine.program.predicates)
        if predicate.provided or predicate.kind is Kind.SENSED
        for args in machine.each(index)
    )


def _as_of(action: dict[str, Any], t: float) -> dict[str, Any]:
    """Return an action as it stood at `t`: its end is not known before."""
    if action["end_s"] is not None and action["end_s"] > t:
        return {**action, "end_s": None, "failure": None}
    return action


class RobotTwins:
    """The incarnations of one robot, and how far their logs have been read."""

    def __init__(self) -> None:
        self.twins: dict[int, MindTwin] = {}
        self.problem: str | None = None
        self.complete = False
        """Whether the whole log of a run that is over has been read."""
        self.read_to: Instant = 0
        self.last: set[tuple[int, bytes]] = set()
        """The batches of the instant `read_to`: it may get more."""


class MindTwins:
    """The twins of one run, each made when it is first asked for."""

    def __init__(self, path: Path) -> None:
        """`path` is a run folder or a recording. Raises RecordingError."""
        self._recording: Recording = opened(path)
        self._robots: dict[int, RobotTwins] = {}
        self._program = program_of(self._recording)

    def state(self, robot: int, t: float | None) -> dict[str, Any]:
        """Return what `robot` knew and did at `t` seconds (None: as far as it is known)."""
        known = self._robots.setdefault(robot, RobotTwins())
        self._read(robot, known)
        begun = [epoch for epoch, twin in known.twins.items() if t is None or twin.began_s <= t]
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
        twin = known.twins[epoch]
        return {**twin.state(in_seconds(NEVER) if t is None else t), "epoch": epoch, "problem": twin.problem}

    def _read(self, robot: int, known: RobotTwins) -> None:
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
        for twin in known.twins.values():
            twin.go_on()

    def _feed(self, known: RobotTwins, at: Instant, epoch: int, batch: bytes) -> None:
        if at > known.read_to:
            known.read_to = at
            known.last.clear()
        if (epoch, batch) in known.last:
            return
        known.last.add((epoch, batch))
        twin = known.twins.get(epoch)
        if twin is not None:
            twin.feed(batch)
            return
        try:
            known.twins[epoch] = MindTwin(self._program, batch)
        except MindLogError as error:
            known.problem = f"what it knew cannot be replayed: {error}"


def opened(path: Path) -> Recording:
    """Return the recording at `path`, which may still grow. Raises RecordingError."""
    if path.is_dir() and not (path / RUN_FILE).exists() and part_files(path):
        return GrowingRecording(path)
    return open_recording(path)
