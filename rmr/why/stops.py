"""The stops of one robot's recorded past, in order: each firing, each input of its logic, each start of an action.

All lives of the robot are replayed once, forwards, and indexed (`rmr.why.mind_index`). A stop is a stretch of the
records: what happened there, and all that came of it at once. What held at a stop follows from the places of facts, so
that going back costs a look-up, and what happens within one instant is told apart.

An input is what comes to the rules from outside of them: facts that are given, sensed or delivered, ends of actions,
deadlines, another program, another life. The samples and frames of the node, which are many more, are not stops.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from rmr.base.time import NEVER, Instant, in_seconds
from rmr.base.values import Robot, Value, format_fact
from rmr.bytecode.program import Kind, Program
from rmr.mind.mind_reader import MindLogError
from rmr.mind.mind_replay import MindReplay
from rmr.mind.recorded_minds import RecordedMind
from rmr.node.actions.action_log import ActionBegun, ActionEnded
from rmr.node.robot_state import ProgramBegun
from rmr.node.trace import fact_text
from rmr.vm.interpreter import UNRANKED, plans_of
from rmr.vm.machine_events import JobFinished, JobMissed, JobStarted
from rmr.vm.match import Search, pattern_agrees
from rmr.vm.provenance import (
    Cause,
    EffectCause,
    FiringCause,
    FiringRecord,
    HandlerCause,
    InsertionRecord,
    JobRecord,
    MissedCause,
    ProvenanceLog,
    ProvenanceRecord,
    StepCause,
    ToldRecord,
)
from rmr.vm.ranks import goal_key
from rmr.vm.store import Fact, Store
from rmr.why.mind_index import MindIndex
from rmr.why.past_items import PastFact, PastGoal

MATCHES_MAX: Final = 200
"""Matches of a rule that are looked for at one firing."""


class StopKind(Enum):
    """What a stop is."""

    FIRING = "firing"
    INPUT = "input"
    BEGINNING = "beginning"
    """An action of the robot begins: no fact changes."""


@dataclass(slots=True, eq=False)
class PastStop:
    """One stop."""

    kind: StopKind
    at: Instant
    part: int
    """Which of the robot's `MindIndex`es: one for each program of each life."""
    run: int
    """Equal for all from which the engine chooses without having been at rest in between."""
    place: int
    """Of its last record."""
    firing: FiringRecord | None = None
    cause: Cause | None = None
    """Of an input that is neither the end of an action nor another program."""
    action: int = 0
    """The serial number of the action that begins or ends."""
    life: bool = False
    """Whether the robot begins here, or begins again, or goes on with another program."""
    records: list[ProvenanceRecord] = field(default_factory=list)
    due: dict[int, Instant] = field(default_factory=dict)
    """When the jobs are due that start here, by their serial numbers."""
    finished: list[str] = field(default_factory=list)
    """The jobs that have their finish fact from here, in words."""


class Agenda(NamedTuple):
    """From what the engine chooses at a stop."""

    firing: FiringRecord | None
    """The firing that is chosen; None: no rule is satisfied."""
    inputs: int = 0
    """How many more inputs come before the engine chooses."""
    resumes: bool = False
    """Whether the engine stopped here although a rule was satisfied, and goes on in a later call of the robot."""


class Choice(NamedTuple):
    """A satisfied rule, with the match with which it would fire."""

    rule: int
    matched: tuple[int, ...]
    rank: int | None
    urgency: int
    fires: bool


class Stops:
    """All stops of one robot."""

    def __init__(self, robot: int) -> None:
        self.robot = robot
        self.all: list[PastStop] = []
        self.parts: list[MindIndex] = []
        self.known_until: Instant = 0
        self.problems: list[str] = []
        """Why the past is known no further, or not as the robot had it."""
        self._unfinished: set[tuple[int, int]] = set()
        """Part and number of firings after which a run ended with rules satisfied."""
        self._run = 0
        self._goal_ends: dict[int, dict[int, int]] = {}

    # -- the replay ---------------------------------------------------------------------------------------------------

    def replay(self, mind: RecordedMind, program: Program, until: Instant = NEVER) -> Iterator[Instant]:
        """Replay one life up to `until`; yield the instant that has been reached. Lives come in their order."""
        whose = f"life {mind.epoch} of robot {self.robot}" if mind.epoch else f"robot {self.robot}"
        log = ProvenanceLog()
        try:
            replay = MindReplay(mind.log(), program, provenance=log)
            begins = replay.next_call
            if begins is None or begins > until:
                return
            self._begin(mind.epoch, program, begins)
            for at in replay.run(until):
                self._take_all(log)
                if not replay.node.machine.busy:
                    self._run += 1
                self.known_until = at
                replay.node.trace_log.clear()
                yield at
        except MindLogError as error:
            self.problems.append(f"{whose} is known until {_s(self.known_until)}: {error}")
            return
        if replay.difference is not None:
            self.problems.append(
                f"the replay of {whose} differs from its recording from {_s(replay.difference.at)} on "
                f"({replay.difference.what}): what comes later may not be what it did"
            )
        self._run += 1

    def _begin(self, epoch: int, program: Program, at: Instant) -> None:
        before = self.parts[-1] if self.parts else None
        self.parts.append(MindIndex(self.robot, epoch, program, at, before))
        place = 0 if before is None else before.place
        self.all.append(PastStop(StopKind.INPUT, at, len(self.parts) - 1, self._run, place, life=True))

    def _take_all(self, log: ProvenanceLog) -> None:
        for record in log.records:
            if isinstance(record, ToldRecord) and isinstance(record.event, ProgramBegun):
                self._begin(self.parts[-1].epoch, record.event.program, record.at)
            else:
                self.parts[-1].take(record)
                self._take(record)
        self._unfinished |= {(len(self.parts) - 1, number) for number in log.unfinished}
        log.records.clear()
        log.unfinished.clear()

    def _take(self, record: ProvenanceRecord) -> None:
        """Put a record to its stop: to the present one, or to one that it begins."""
        mind = self.parts[-1]
        stop = self.all[-1]
        new: PastStop | None = None
        match record:
            case FiringRecord():
                new = self._stop(StopKind.FIRING, record)
                new.firing = record
            case ToldRecord(event=ActionEnded() | ActionBegun() as event) if event.serial in mind.actions:
                begins = isinstance(event, ActionBegun)
                new = self._stop(StopKind.BEGINNING if begins else StopKind.INPUT, record)
                new.action = event.serial
            case ToldRecord(event=JobStarted() | JobFinished() | JobMissed() as event):
                new = self._job(record, event)
            case ToldRecord() | JobRecord():
                pass
            case _ if not self._belongs(stop, record.cause):
                new = self._stop(StopKind.INPUT, record)
                new.cause = record.cause
                new.action = _action_of(record.cause)
            case _:
                pass
        if new is not None:
            self.all.append(new)
            stop = new
        stop.records.append(record)
        stop.place = mind.place

    def _job(self, record: ToldRecord, event: JobStarted | JobFinished | JobMissed) -> PastStop | None:
        """Put what became of a job to the stop that it is of: the robot tells it when its engine is at rest again.

        A missed deadline from which nothing follows gets a stop of its own.
        """
        job = event.job
        mind = self.parts[-1]
        for stop in reversed(self.all):
            if stop.run != self._run or stop.part != len(self.parts) - 1:
                break
            match event:
                case JobStarted() if any(
                    isinstance(each, JobRecord) and each.job == job.serial for each in stop.records
                ):
                    stop.due[job.serial] = job.deadline
                    return None
                case JobFinished() if job.assertion >= 0:
                    finish = mind.program.assertions[job.assertion].finish.predicate
                    if any(isinstance(each, InsertionRecord) and each.predicate == finish for each in stop.records):
                        stop.finished.append(f"{job.name} of {job.text}")
                        return None
                case JobMissed() if stop.cause == MissedCause(job.serial):
                    return None
                case _:
                    pass
        if not isinstance(event, JobMissed):
            return None
        new = self._stop(StopKind.INPUT, record)
        new.cause = MissedCause(job.serial)
        return new

    def _stop(self, kind: StopKind, record: ProvenanceRecord) -> PastStop:
        return PastStop(kind, record.at, len(self.parts) - 1, self._run, self.parts[-1].place)

    def _belongs(self, stop: PastStop, cause: Cause) -> bool:
        """Return whether a thing with this cause is part of the present stop."""
        if isinstance(cause, FiringCause):
            return stop.firing is not None  # a firing's consequences come at once
        if stop.kind is not StopKind.INPUT or stop.run != self._run or stop.firing is not None:
            return False
        if stop.action and stop.action == _action_of(cause):
            return True
        return stop.cause == cause and not stop.life

    # -- what is asked ------------------------------------------------------------------------------------------------

    def last_at(self, at: Instant) -> int:
        """Return the index of the last stop at or before an instant; -1: there is none."""
        return bisect_right(self.all, at, key=lambda stop: stop.at) - 1

    def mind(self, index: int) -> MindIndex:
        """Return the history of the program that runs at a stop; before the first stop the first one."""
        return self.parts[self.all[max(index, 0)].part]

    def held(self, index: int) -> Iterator[PastFact]:
        """Yield the facts that hold at a stop, by predicate, the oldest first."""
        if index >= 0:
            place = self.all[index].place
            for facts in dict(self.mind(index).by_predicate).values():
                yield from (fact for fact in facts if fact.place <= place < fact.removed_place)

    def open_goals(self, index: int) -> list[PastGoal]:
        """Return the goals that are open at a stop, each once, in the order in which they were opened."""
        if index < 0:
            return []
        place = self.all[index].place
        ends = self._ends_of_goals(self.all[index].part)
        found = {
            goal_key(goal.predicate, goal.args): goal
            for goal in self.mind(index).goals
            if goal.place <= place < ends[goal.number]
        }
        return list(found.values())

    def _ends_of_goals(self, part: int) -> dict[int, int]:
        """Return by number the place from which on each goal of a part was not open any more."""
        if part not in self._goal_ends:
            mind = self.parts[part]
            self._goal_ends[part] = {goal.number: self._end_of_goal(mind, part, goal) for goal in mind.goals}
        return self._goal_ends[part]

    def _end_of_goal(self, mind: MindIndex, part: int, goal: PastGoal) -> int:
        """Return the place of what ended a goal: its record tells the instant alone."""
        at = goal.withdrawn if goal.achieved is None else goal.achieved
        if at is None:
            return 1 << 62
        if goal.achieved is not None:
            for fact in mind.by_predicate[goal.predicate]:
                if pattern_agrees(goal.args, fact.args, (Robot(mind.robot),)):
                    if fact.place <= goal.place < fact.removed_place:
                        return goal.place  # it held already
                    if fact.place > goal.place and fact.at == at:
                        return fact.place
        key = goal.predicate, goal.args
        stops = self.all[self.last_at(at - 1) + 1 : self.last_at(at) + 1]
        own = [stop for stop in stops if stop.part == part and stop.place >= goal.place]
        asked = [stop.place for stop in own if stop.firing is not None and key in stop.firing.goals]
        return max(asked, default=own[0].place if own else goal.place)

    def agenda(self, index: int) -> Agenda:
        """Return from what the engine chooses at a stop."""
        reached = index
        while reached >= 0 and self.all[reached].kind is StopKind.BEGINNING:
            reached -= 1
        stop = self.all[max(reached, 0)]
        inputs = 0
        for later in self.all[index + 1 :]:
            if later.run != stop.run:
                break
            if later.kind is StopKind.FIRING:
                resumes = stop.firing is not None and (stop.part, stop.firing.number) in self._unfinished
                return Agenda(later.firing, inputs, resumes)
            if later.kind is StopKind.INPUT:
                if stop.firing is not None and (stop.part, stop.firing.number) not in self._unfinished:
                    break  # it was at rest before this input came
                inputs += 1
        return Agenda(None)


def choices(firing: FiringRecord) -> list[Choice]:
    """Return the rules that were satisfied when a firing was chosen, each with its match, in the engine's order.

    Rules of one rank and urgency stand in the order of the text; which of them fires is drawn, or it is the first one.
    """
    found = [Choice(firing.rule, firing.matched, firing.rank, firing.urgency, True)]
    found += [Choice(each.rule, each.matched, each.rank, each.urgency, False) for each in firing.rivals]
    return sorted(found, key=lambda each: (UNRANKED if each.rank is None else each.rank, each.urgency, each.rule))


def other_matches(mind: MindIndex, firing: FiringRecord) -> list[tuple[int, ...]] | None:
    """Return the other matches of the rule that fired, those of the oldest facts first; None: they are drawn.

    Of a rule that consumes nothing those that had fired before are left out. At most `MATCHES_MAX` are looked at.
    """
    planned = plans_of(mind.program)[firing.rule]
    if planned.drawn:
        return None
    place = mind.firing_places[firing.number]
    store = Store(mind.program.predicates)
    serials: dict[int, int] = {}
    for fact in sorted(mind.facts.values(), key=lambda each: each.serial):
        if fact.place < place < fact.removed_place:
            serials[store.insert(fact.predicate, fact.args, fact.at).serial] = fact.serial
    fired: set[tuple[int, ...]] = {firing.matched}
    if not planned.taken:
        fired |= {
            each.matched for each in mind.firings.values() if each.rule == firing.rule and each.number < firing.number
        }
    found: list[tuple[int, ...]] = []
    env: list[Value] = [Robot(mind.robot)] * planned.slots
    search = Search(planned.steps, store, env, firing.at, _ignored)
    for count, facts in enumerate(search.matches()):
        if count >= MATCHES_MAX:
            break
        matched = tuple([serials[fact.serial] for fact in facts if fact.serial in serials])
        if matched not in fired and planned.derive(store, env, facts, firing.at, _ignored_in_head) is not None:
            found.append(matched)
    return found


def _ignored(step: int, facts: Sequence[Fact], reason: str) -> None:
    del step, facts, reason


def _ignored_in_head(part: int, step: int, facts: Sequence[Fact], reason: str) -> None:
    del part, step, facts, reason


def _action_of(cause: Cause) -> int:
    """Return the serial number of the action whose end is the cause; 0: it is none."""
    return cause.action if isinstance(cause, EffectCause | StepCause | HandlerCause) else 0


def _s(at: Instant) -> str:
    return f"{in_seconds(at):.3f} s"


# -- facts in program syntax, as a robot itself tells them


def is_sensed(program: Program, predicate: int) -> bool:
    """Return whether the robot states facts of a predicate of itself, such as `at` and `turn`."""
    return program.predicates[predicate].provided or program.predicates[predicate].kind is Kind.SENSED


def is_hidden(program: Program, predicate: int) -> bool:
    """Return whether the compiler has made a predicate for a rule over several robots."""
    return any(each.predicate == predicate for each in program.ensemble)


def known_text(program: Program, predicate: int, robot: int, args: tuple[Value, ...]) -> str:
    """Return a fact that the robot knows or senses; one of the compiler's own is told in words."""
    if is_hidden(program, predicate):
        return fact_text(program, predicate, Robot(robot), args)
    mark = "!" if program.predicates[predicate].kind is Kind.PERSISTENT and not is_sensed(program, predicate) else ""
    return format_fact(program.predicates[predicate].name, (Robot(robot), *args), mark)
